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
inline constexpr double at_limit = 0.99;  ///< share from which a limit counts as active

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
    limits_moves_ = false;
    for (std::size_t i = stretch.first; i <= stretch.last; ++i)
      limits_moves_ = limits_moves_ || p_.moves[i].speed || p_.moves[i].acceleration;
    slots_.clear();
    for (int k = p_.loaded ? 0 : 1; k < 2; ++k) {
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
    triples_.clear();
    near_.clear();
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
    const double square = 1.0 / (factor * factor);
    for (const auto& [first, second, third] : triples_) {
      const std::array<const Look*, 3> at{&looks_[first], &looks_[second], &looks_[third]};
      const double sixth = factor * (at[2]->t - at[0]->t) / 6.0;
      for (std::size_t k = 0; k < slots_.size(); ++k) {
        const auto [kind, i] = slots_[k];
        const double scale = falls_by_speed(kind) ? 1.0 / factor : square;
        const double a = at[0]->of[k].at(scale), b = at[1]->of[k].at(scale), c = at[2]->of[k].at(scale);
        const double limit = allowed(kind), share = peak(a, b, c);
        Use& use = use_[static_cast<std::size_t>(kind)][i];
        use.share = std::max(use.share, share);
        if (share > at_limit * limit)
          for (const double v : {a, b, b, b, b, c}) use.active += v > at_limit * limit ? sixth : 0.0;
        if (share > limit) excess_.push_back({at[0]->t, at[2]->t, kind, share});
        if (share <= most * limit) continue;
        most = share / limit;
        where_ = at[1]->t;
      }
    }
    return most;
  }
  /// Makes all times longer, as judge() was asked.
  void stretch(double factor) {
    for (TimedPiece& piece : table_) {
      piece.begin *= factor;
      piece.curve.duration *= factor;
    }
    for (Look& look : looks_) {
      look.t *= factor;
      for (std::size_t k = 0; k < slots_.size(); ++k)
        look.of[k].push /= falls_by_speed(slots_[k].kind) ? factor : factor * factor;
    }
  }
  /// Measures the ticks as well, where a limit is near; `begin`: of the stretch, s. Returns the largest
  /// share.
  double take_ticks(double begin) {
    looks_.resize(between_);
    while (!triples_.empty() && triples_.back()[0] >= between_) triples_.pop_back();
    guard_.rewind();
    for (std::size_t i = 0; i < table_.size(); ++i) {
      const TimedPiece& piece = table_[i];
      auto n = static_cast<std::uint64_t>(std::ceil((begin + piece.begin) / p_.tick - 1e-9));
      for (double t = 0.0; near_[i]; ++n) {
        t = static_cast<double>(n) * p_.tick - begin - piece.begin;
        if (!(t < piece.curve.duration)) break;
        triples_.push_back({looks_.size(), looks_.size(), looks_.size()});
        looks_.push_back(look(piece.begin + t, piece.curve.at(std::max(t, 1e-6 * piece.curve.duration))));
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
  /// Whether judge() is exact: neither friction nor a reserve falls otherwise.
  [[nodiscard]] bool scales() const { return !p_.uncertain && !motors_.rubs(); }

  [[nodiscard]] std::optional<Desired<M>> desired(const Motion2<double>& m) const {
    return desired_at_effector(p_.controller.mechanism, p_.controller.mode, m.position, m.velocity,
                               m.acceleration);
  }

 private:
  /// The share of a limit: what a longer time leaves, either way, and what it makes less.
  struct Share {
    double up = 0.0, down = 0.0, push = 0.0;
    [[nodiscard]] double at(double scale) const { return std::max(up + push * scale, down - push * scale); }
  };
  struct Slot {
    LimitKind kind;
    std::size_t i;
  };
  struct Look {
    double t = 0.0;  // s
    std::array<Share, 12> of{};
  };

  static bool falls_by_speed(LimitKind kind) {
    return kind == LimitKind::speed || kind == LimitKind::joint_speed;
  }
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
    const auto at = [&](std::size_t i, std::size_t n) {
      // At rest itself dry friction has no direction: a look is beside it.
      const double t = length * std::clamp(static_cast<double>(i) / static_cast<double>(n), 1e-6, 1.0 - 1e-6);
      return look(piece.begin + t, piece.curve.at(t));
    };
    const auto n = 2 * static_cast<std::size_t>(std::ceil(0.5 * length / step));
    std::vector<Look> far;
    double share = 0.0;
    for (std::size_t i = 0; i <= n; ++i) {
      far.push_back(at(i, n));
      for (std::size_t k = 0; k < slots_.size(); ++k) share = std::max(share, far[i].of[k].at(1.0));
    }
    near_.push_back(share > calm);
    for (std::size_t i = 2; i <= n; i += 2)
      triples_.push_back({looks_.size() + i - 2, looks_.size() + i - 1, looks_.size() + i});
    looks_.insert(looks_.end(), far.begin(), far.end());
  }
  /// Measures the motion m of time t.
  Look look(double t, const Motion2<double>& m) {
    const auto d = desired(m);
    if (!d)
      throw Refused(Route<M>::piece_at(*stretch_, timing_->at(t).s).move, "to",
                    "leads out of reach at " + place_text(m.position));
    const Piece& piece = Route<M>::piece_at(*stretch_, timing_->at(t).s);
    guard_.check(d->pose, piece.move);
    Look out;
    out.t = t;
    Share* to = out.of.data();
    const std::pair<Loads, Loads> less = motors_.reserve(*d, m);
    for (const M* model : {p_.loaded ? &*p_.loaded : nullptr, &p_.controller.mechanism}) {
      if (model == nullptr) continue;
      const auto [rest, push] = motors_.split(*model, *d);
      for (std::size_t i = 0; i < static_cast<std::size_t>(motors_.count()); ++i) {
        *to++ = {rest[i] - less.first[i], less.second[i] - rest[i], push[i]};
        if (std::isnan(push[i])) to[-1] = {std::numeric_limits<double>::infinity(), 0.0, 0.0};
      }
    }
    const Vec2<double> rate = M::base(d->rates), acceleration = M::base(d->acceleration);
    for (int i = 0; i < 2; ++i)
      *to++ = {0.0, 0.0, std::abs(rate[i]) / (speed_reserve * p_.controller.limits.joint_speed)};
    if (!limits_moves_) return out;
    for (std::size_t k = piece.move; k <= piece.next; ++k) {
      const MoveScene& move = p_.moves[k];
      const bool joint = move.kind == MoveKind::joint;
      const double v = joint ? rate.cwiseAbs().maxCoeff() : m.velocity.norm(),
                   a = joint ? acceleration.cwiseAbs().maxCoeff() : m.acceleration.norm();
      if (move.speed) to[0].push = std::max(to[0].push, v / *move.speed);
      if (move.acceleration) to[1].push = std::max(to[1].push, a / *move.acceleration);
    }
    return out;
  }

  const Problem<M>& p_;
  const Route<M>& route_;
  MotorLimits<M>& motors_;
  WayGuard<M>& guard_;
  const Stretch* stretch_ = nullptr;
  const Timing* timing_ = nullptr;
  bool limits_moves_ = false;  // a move of the stretch limits speed or acceleration
  std::vector<TimedPiece> table_;
  std::vector<Slot> slots_;  // of the shares of every look
  std::vector<Look> looks_;
  std::vector<std::array<std::size_t, 3>> triples_;  // of looks on one quintic; of a tick thrice the same
  std::vector<bool> near_;                           // of quintics: a limit is near
  std::size_t between_ = 0;                          // looks that are not ticks
  std::vector<Excess> excess_;                       // by time
  Uses use_{};
  double where_ = 0.0;
};

}  // namespace esmc::host::plan
