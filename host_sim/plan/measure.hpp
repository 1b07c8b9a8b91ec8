#pragma once
/// What a timed stretch takes of every limit, by the table that the firmware reads.

#include <algorithm>
#include <cmath>

#include "host_sim/plan/guard.hpp"
#include "host_sim/plan/table.hpp"

namespace esmc::host::plan {

/// Shares of the torque that are left to the loop where no plant is to saturate: a torque holds for a tick,
/// while what the motion takes changes. 2 % in a tick of 1 ms, where two mechanisms at their limits took
/// 0.5 %. Other laws than ESMC with implicit reaching answer a wrong model with more than it takes.
inline constexpr double loop_reserve_per_s = 20.0, loop_reserve_max = 0.2, slow_law_reserve = 0.07;
inline constexpr std::size_t most_shares = 40'000'000;  ///< kept for a stretch: 1.3 GB
inline constexpr double at_limit = 0.99;                ///< share from which a limit counts as active

/// More of a limit than is allowed.
struct Excess {
  double from, to;  ///< part of the path
  LimitKind kind;
  double share;
};

template <class M>
class Measurement {
 public:
  Measurement(const Problem<M>& p, const Route<M>& route, MotorLimits<M>& motors, WayGuard<M>& guard)
      : p_(p), route_(route), motors_(motors), guard_(guard) {}

  /// The stretch whose timings follow.
  void begin(const Stretch& stretch) {
    stretch_ = &stretch;
    guard_.begin();
    limits_moves_ = joint_moves_ = false;
    for (std::size_t i = stretch.first; i <= stretch.last; ++i) {
      limits_moves_ = limits_moves_ || p_.moves[i].speed || p_.moves[i].acceleration;
      joint_moves_ = joint_moves_ || p_.moves[i].kind == MoveKind::joint;
    }
    slots_.clear();
    for (std::size_t k = 0; k < motors_.models().size(); ++k) {
      for (std::size_t i = 0; i < static_cast<std::size_t>(motors_.count()); ++i)
        slots_.push_back({LimitKind::torque, i});
    }
    for (const std::size_t i : {0U, 1U}) slots_.push_back({LimitKind::joint_speed, i});
    if (limits_moves_) slots_.insert(slots_.end(), {{LimitKind::speed, 0}, {LimitKind::acceleration, 0}});
  }

  /// Share of a limit that an optimal timing may use.
  [[nodiscard]] double allowed(LimitKind kind) const {
    if (kind != LimitKind::torque || !p_.uncertain) return 1.0;
    const double least = fast_law() ? 0.0 : slow_law_reserve;
    return 1.0 - std::max(least, std::min(loop_reserve_max, loop_reserve_per_s * p_.tick));
  }
  /// The law corrects an error of the model within a tick or two.
  [[nodiscard]] bool fast_law() const {
    const ControllerConfig<M>& c = p_.controller;
    return c.law == LawKind::esmc && c.reaching == Reaching::implicit && c.reach == nullptr;
  }
  /// Measures a timing by its table: at both ends and halfway of its quintics, of long ones every four ticks,
  /// with a parabola between. Returns the largest share of what is allowed.
  double take(const Timing& timing) {
    timing_ = &timing;
    table_ = fitted();
    guard_.rewind();
    looks_.clear();
    shares_.clear();
    triples_.clear();
    for (const TimedPiece& piece : table_) look_along(piece);
    between_ = looks_.size();
    return judge(1.0);
  }
  /// The shares of the timing that was taken, had all its times been `factor` times as long: what holds the
  /// pose stays, what accelerates falls with the square. Returns the largest share of what is allowed.
  double judge(double factor) {
    use_ = {};
    excess_.clear();
    double most = 0.0;
    std::vector<double> value(looks_.size());
    for (std::size_t k = 0; k < slots_.size(); ++k) {
      const auto [kind, i] = slots_[k];
      const double limit = allowed(kind), active = at_limit * limit;
      Use& use = use_[static_cast<std::size_t>(kind)][i];
      for (std::size_t n = 0; n < value.size(); ++n)
        value[n] = shares_[n * slots_.size() + k].at(1.0 / factor);
      const auto note = [&, kind = kind](double share, std::size_t from, std::size_t to) {
        use.share = std::max(use.share, share);
        if (share > limit) excess_.push_back({looks_[from], looks_[to], kind, share});
        if (share <= most * limit) return;
        most = share / limit;
        where_ = 0.5 * (looks_[from] + looks_[to]);
      };
      for (const Triple& three : triples_) {
        const double a = value[three.first], b = value[three.first + 1], c = value[three.first + 2];
        const double share = peak(a, b, c),
                     sixth = factor * (looks_[three.first + 2] - looks_[three.first]) / 6.0;
        if (share > active)
          for (const double v : {a, b, b, b, b, c}) use.active += v > active ? sixth : 0.0;
        note(share, three.first, three.first + 2);
      }
      for (std::size_t n = between_; n < value.size(); ++n) note(value[n], n, n);
    }
    return most;
  }
  /// Makes all times longer, as judge() was asked.
  void stretch(double factor) {
    for (TimedPiece& piece : table_) {
      piece.begin *= factor;
      piece.curve.duration *= factor;
    }
    for (double& t : looks_) t *= factor;
    for (Share& share : shares_) {
      share.drag /= factor;
      share.push /= factor * factor;
    }
  }
  /// Measures the ticks as well, where a limit is near; `begin`: of the stretch, s. Returns the largest
  /// share.
  double take_ticks(double begin) {
    looks_.resize(between_);
    shares_.resize(between_ * slots_.size());
    guard_.rewind();
    for (const Triple& three : triples_) {
      if (!three.motors_near && !three.moves_near) continue;
      const TimedPiece& piece = table_[three.piece];
      const double from = looks_[three.first], to = looks_[three.first + 2];
      auto n = static_cast<std::uint64_t>(std::ceil((begin + from) / p_.tick - 1e-9));
      for (;; ++n) {
        const double t = static_cast<double>(n) * p_.tick - begin;
        if (!(t < to)) break;
        look(t, piece.curve.at(std::max(t - piece.begin, 1e-6 * piece.curve.duration)),
             three.motors_near || joint_moves_);
      }
    }
    return judge(1.0);
  }
  // Of the last timing.
  [[nodiscard]] const std::vector<TimedPiece>& table() const { return table_; }
  [[nodiscard]] const Uses& use() const { return use_; }
  [[nodiscard]] std::vector<Excess> excess() const {
    std::vector<Excess> out = excess_;
    for (Excess& e : out) e = {timing_->span(e.from).first, timing_->span(e.to).second, e.kind, e.share};
    return out;
  }
  [[nodiscard]] double where() const { return where_; }  ///< time of the largest share, s
  /// Whether judge() is exact: no reserve falls otherwise.
  [[nodiscard]] bool scales() const { return !p_.uncertain; }

  [[nodiscard, gnu::noinline, gnu::flatten]] bool desired(const Motion2<double>& m, Desired<M>& d) const {
    return desired_at_effector(p_.controller.mechanism, p_.controller.mode, m.position, m.velocity,
                               m.acceleration, d.pose, d.rates, d.acceleration);
  }

 private:
  /// The share of a limit: what a longer time leaves, either way, what falls with it and with its square.
  struct Share {
    double up = 0.0, down = 0.0, drag = 0.0, push = 0.0;
    [[nodiscard]] double at(double pace) const {
      const double moving = (drag + push * pace) * pace;
      return std::max(up + moving, down - moving);
    }
  };
  struct Slot {
    LimitKind kind;
    std::size_t i;
  };
  /// Three looks in a row on one quintic, at equal distances.
  struct Triple {
    std::size_t first, piece;
    bool motors_near = false, moves_near = false;  // a limit: of motors and joints, of a move itself
  };

  /// The largest value of the parabola through three values at equal distances, between them.
  static double peak(double a, double b, double c) {
    const double bend = 2.0 * b - a - c, slope = c - a;
    return bend > 0.0 && std::abs(slope) < 2.0 * bend ? b + slope * slope / (8.0 * bend)
                                                      : std::max({a, b, c});
  }
  [[nodiscard]] std::vector<TimedPiece> fitted() const {
    return fit_quintics(
        timing_->breaks(),
        [&](double t) {
          const Timing::State after = timing_->at(t);
          const CurvePoint tip = route_.tip(*stretch_, after.s);
          return Knot{motion_at(tip, timing_->at(t, true)), motion_at(tip, after)};
        },
        [&](double t) {
          const Timing::State s = timing_->at(t);
          return motion_at(route_.tip(*stretch_, s.s), s);
        });
  }
  void look_along(const TimedPiece& piece) {
    constexpr double farthest = 4.0, calm = 0.75, most = 10000.0;  // ticks; share; looks
    const double length = piece.curve.duration,
                 step = std::max(farthest * p_.tick, timing_->duration() / most);
    const auto n = 2 * static_cast<std::size_t>(std::ceil(0.5 * length / step));
    const std::size_t first = looks_.size() - (piece.joins ? 1 : 0);
    for (std::size_t i = piece.joins ? 1 : 0; i <= n; ++i) {
      // At rest itself dry friction has no direction: a look is beside it.
      const double t = length * std::clamp(static_cast<double>(i) / static_cast<double>(n), 1e-6, 1.0 - 1e-6);
      look(piece.begin + t, piece.curve.at(t), true);
      if (i % 2 == 1 || i == 0) continue;
      Triple& three =
          triples_.emplace_back(Triple{first + i - 2, static_cast<std::size_t>(&piece - table_.data())});
      const Share* const at = &shares_[three.first * slots_.size()];
      for (std::size_t k = 0; k < slots_.size(); ++k) {
        const Share &a = at[k], &b = at[k + slots_.size()], &c = at[k + 2 * slots_.size()];
        const double bend = std::abs(a.push - 2.0 * b.push + c.push);  // where it is large, more is between
        if (!(std::max({a.at(1.0), b.at(1.0), c.at(1.0)}) + 0.25 * bend > calm)) continue;
        (k < moves_slot() ? three.motors_near : three.moves_near) = true;
      }
    }
  }
  /// The first slot of limits that moves have themselves.
  [[nodiscard]] std::size_t moves_slot() const { return slots_.size() - (limits_moves_ ? 2 : 0); }
  /// Measures the motion m of time t; without `motors` only what the moves themselves limit.
  void look(double t, const Motion2<double>& m, bool motors) {
    const auto piece = [&]() -> const Piece& { return Route<M>::piece_at(*stretch_, timing_->at(t).s); };
    const std::size_t begin = shares_.size(), most_ticks = most_shares / slots_.size();
    if (begin > most_shares)
      throw Refused(piece().move, "time",
                    "takes more than {:.2g} ticks near a limit: a faster move, or a stated time",
                    static_cast<double>(most_ticks));
    shares_.resize(begin + slots_.size());
    Share* to = &shares_[begin];
    Vec2<double> rate(0, 0), acceleration(0, 0);
    if (motors) {
      Desired<M> d;
      if (!desired(m, d))
        throw Refused(piece().move, "to", "leads out of reach at {}", place_text(m.position));
      guard_.check(d.pose, [&] { return piece().move; });
      const std::pair<Loads, Loads> less = motors_.reserve(d, m);
      const auto scale = motors_.scale(d.pose);
      for (const Inertia<M>& model : motors_.models()) {
        const auto [rest, drag, push] = motors_.split(model, d, scale);
        for (std::size_t i = 0; i < static_cast<std::size_t>(motors_.count()); ++i) {
          *to++ = {rest[i] - less.first[i], less.second[i] - rest[i], drag[i], push[i]};
          if (std::isnan(push[i])) to[-1] = {std::numeric_limits<double>::infinity()};
        }
      }
      rate = M::base(d.rates);
      acceleration = M::base(d.acceleration);
      for (int i = 0; i < 2; ++i)
        (to++)->drag = std::abs(rate[i]) / (speed_reserve * p_.controller.limits.joint_speed);
    }
    looks_.push_back(t);
    if (!limits_moves_) return;
    Share* const own = &shares_[begin + moves_slot()];
    const Piece& on = piece();
    for (std::size_t k = on.move; k <= on.next; ++k) {
      const MoveScene& move = p_.moves[k];
      const bool joint = move.kind == MoveKind::joint;
      const double v = joint ? rate.cwiseAbs().maxCoeff() : m.velocity.norm(),
                   a = joint ? acceleration.cwiseAbs().maxCoeff() : m.acceleration.norm();
      if (move.speed) own[0].drag = std::max(own[0].drag, v / *move.speed);
      if (move.acceleration) own[1].push = std::max(own[1].push, a / *move.acceleration);
    }
  }

  const Problem<M>& p_;
  const Route<M>& route_;
  MotorLimits<M>& motors_;
  WayGuard<M>& guard_;
  const Stretch* stretch_ = nullptr;
  const Timing* timing_ = nullptr;
  bool limits_moves_ = false,
       joint_moves_ = false;  // a move of the stretch limits speed or acceleration; in joints
  std::vector<TimedPiece> table_;
  std::vector<Slot> slots_;    // of the shares of every look
  std::vector<double> looks_;  // s
  std::vector<Share> shares_;  // look by look
  std::vector<Triple> triples_;
  std::size_t between_ = 0;  // looks that are not ticks
  std::vector<Excess> excess_;
  Uses use_{};
  double where_ = 0.0;
};

}  // namespace esmc::host::plan
