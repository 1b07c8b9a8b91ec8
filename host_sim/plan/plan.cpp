#include "host_sim/plan/plan.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "host_sim/plan/guard.hpp"
#include "host_sim/plan/table.hpp"

namespace esmc::host::plan {
namespace {

using Shares = std::array<double, kinds>;
/// Where no plant is to saturate: share of the torque that is left to the sampled loop, and time in which the
/// acceleration of the path changes from one value to another. A loop that samples cannot follow a jump.
constexpr double loop_reserve = 0.07, loop_ticks = 8.0;
constexpr double at_limit = 0.99;                  ///< share from which a limit counts as active
constexpr double longest = 1e6, most_ticks = 4e9;  ///< s, of a program; of its table

template <class M>
class Planner {
 public:
  explicit Planner(const Problem<M>& p) : p_(p), route_(p), motors_(p), guard_(p, motors_) {}

  Plan run() {
    out_.deviation = route_.deviation();
    out_.from = route_.from();
    out_.from_base = route_.from_base();
    out_.end.assign(p_.moves.size(), 0.0);
    for (const Stretch& s : route_.stretches()) {
      rest_until(s.first, s.rest);
      stretch_ = &s;
      set_grid();
      check_way();
      const Timing timing = s.time ? in_time() : optimal();
      append(timing);
    }
    rest_until(p_.moves.size(), route_.last_rest());
    out_.duration = now_;
    if (const double most = std::min(longest, most_ticks * p_.tick); !(now_ <= most))
      refuse(p_.moves.size() - 1, "time",
             fmt::format("ends after {:.3g} s, at most {:g} are allowed", now_, most));
    out_.ticks = static_cast<std::uint32_t>(std::ceil(now_ / p_.tick - 1e-9));
    for (auto& kind : out_.use) {
      for (Use& use : kind) use.active /= std::max(moving_, p_.tick);
    }
    return out_;
  }

 private:
  [[noreturn]] static void refuse(std::size_t move, const char* key, const std::string& why) {
    throw Refused(move, key, why);
  }

  /// Dwells before move `next`: all moves before it have ended by then.
  void rest_until(std::size_t next, double rest) {
    for (std::size_t i = 0; i < next; ++i) {
      if (p_.moves[i].kind == MoveKind::dwell && out_.end[i] == 0.0) out_.end[i] = now_ += *p_.moves[i].time;
    }
    out_.bound += rest;
  }

  /// Points of the stretch: dense at rest, where time passes slowly along the path.
  void set_grid() {
    const auto& pieces = stretch_->pieces;
    grid_.s.clear();
    place_.clear();
    for (std::size_t k = 0; k < pieces.size(); ++k) {
      const Piece& piece = pieces[k];
      const double share = piece.length() / stretch_->length;
      const auto n =
          std::max<std::size_t>(12, static_cast<std::size_t>(share * static_cast<double>(p_.grid)));
      const bool begins = k == 0, ends = k + 1 == pieces.size();
      for (std::size_t i = 0; i < n + (ends ? 1 : 0); ++i) {
        const double x = static_cast<double>(i) / static_cast<double>(n);
        double y = x;
        if (begins && ends) {
          y = x - 0.9 * std::sin(2.0 * std::numbers::pi * x) / (2.0 * std::numbers::pi);
        } else if (begins) {
          y = x * (0.1 + 0.9 * x);
        } else if (ends) {
          y = 1.0 - (1.0 - x) * (0.1 + 0.9 * (1.0 - x));
        }
        grid_.s.push_back(piece.at + y * piece.length());
        const auto at = route_.place(piece, piece.begin + y * piece.length());
        if (!at)
          refuse(piece.move, "to",
                 "leads out of reach at " + place_text(piece.point(piece.begin + y * piece.length()).p));
        place_.push_back(*at);
      }
    }
    low_.assign(grid_.s.size(), Loads{});
    high_ = low_;
  }

  [[nodiscard]] const Piece& piece_at(double s) const { return Route<M>::piece_at(*stretch_, s); }

  /// Guards of the controller along the stretch.
  void check_way() {
    for (std::size_t i = 0; i < place_.size(); ++i) guard_.check(place_[i], piece_at(grid_.s[i]).move);
    for (std::size_t i = stretch_->first; i <= stretch_->last; ++i) {
      if (guard_.changes_mode(i))
        refuse(i, "working_mode", "is not that at the end of the move, which is mechanism.working_mode");
    }
  }

  /// Rows of all points; `motors_only`: of the motors without reserve.
  void set_rows(const std::vector<Shares>& most, bool motors_only = false) {
    grid_.rows.clear();
    grid_.first.clear();
    for (std::size_t i = 0; i < place_.size(); ++i) {
      grid_.first.push_back(grid_.rows.size());
      const Loads none{};
      motors_.add_rows(place_[i], motors_only ? none : low_[i], motors_only ? none : high_[i],
                       motors_only ? 1.0 : most[i][static_cast<std::size_t>(LimitKind::torque)], grid_.rows);
      if (!motors_only) add_motion_rows(p_, piece_at(grid_.s[i]), place_[i], most[i], grid_.rows);
    }
    grid_.first.push_back(grid_.rows.size());
  }

  Squares solve() {
    std::size_t blocked = 0;
    auto x = fastest(grid_, blocked);
    if (x) return *x;
    const std::size_t at = std::min(blocked, place_.size() - 1);
    refuse(piece_at(grid_.s[at]).move, "to",
           fmt::format("no speed passes {}: the motors' torque within its limits, less what [uncertainty] "
                       "needs, does not "
                       "keep the mechanism on the way there",
                       place_text(place_[at].tip.p)));
  }

  /// Reserve for the worst plant at every point, of the motion with x.
  void set_reserve(const Squares& x) {
    for (std::size_t i = 0; i < x.size(); ++i) {
      low_[i] = high_[i] = Loads{};
      for (const std::size_t k : {i, i + 1}) {  // acceleration before and after the point
        if (k == 0 || k == x.size()) continue;
        const double u = (x[k] - x[k - 1]) / (2.0 * (grid_.s[k] - grid_.s[k - 1]));
        const Motion2<double> m = motion_at(place_[i], {grid_.s[i], std::sqrt(x[i]), u});
        const auto d = desired(m);
        if (!d) continue;
        const auto [low, high] = motors_.reserve(*d, m);
        for (std::size_t j = 0; j < low.size(); ++j) {
          low_[i][j] = std::min(low_[i][j], low[j]);
          high_[i][j] = std::max(high_[i][j], high[j]);
        }
      }
    }
  }

  Timing optimal() {
    Shares all;
    for (std::size_t k = 0; k < kinds; ++k) all[k] = allowed(static_cast<LimitKind>(k));
    std::vector<Shares> most(place_.size(), all);  // share of each limit that may be used, point by point
    Timing timing;
    constexpr int passes = 12;
    for (int pass = 0; pass < passes; ++pass) {
      set_rows(most);
      Squares x = solve();
      for (int k = 0; p_.uncertain && pass == 0 && k < 4; ++k) {
        set_reserve(x);
        set_rows(most);
        x = solve();
      }
      timing = Timing(grid_.s, x);
      if (p_.uncertain) timing.smooth(loop_ticks * p_.tick);
      limit_jerk(timing);
      excess_.clear();
      (void)measured(timing, table(timing));
      if (excess_.empty()) return timing;
      lower(most);
    }
    for (int pass = 0; pass < 100; ++pass) {  // slower: every share falls, down to that at rest
      excess_.clear();
      (void)measured(timing, table(timing));
      double share = 1.0;
      for (const Excess& e : excess_) share = std::max(share, e.share / allowed(e.kind));
      if (share <= 1.0) break;
      timing.stretch(std::sqrt(std::clamp(share, 1.0002, 1.05)));
    }
    return timing;
  }
  /// Share of a limit that an optimal timing may use.
  [[nodiscard]] double allowed(LimitKind kind) const {
    return kind == LimitKind::torque && p_.uncertain ? 1.0 - loop_reserve : 1.0;
  }
  /// Takes from the points around every excess the share that was too much there.
  void lower(std::vector<Shares>& most) const {
    constexpr double least = 0.5;  // beyond that slower motion helps, not less torque
    const std::vector<Shares> before = most;
    const auto index = [&](double s) {
      return static_cast<std::size_t>(std::upper_bound(grid_.s.begin(), grid_.s.end(), s) - grid_.s.begin());
    };
    for (const Excess& e : excess_) {
      const auto k = static_cast<std::size_t>(e.kind);
      const std::size_t first = index(e.from), last = std::min(index(e.to) + 1, most.size() - 1);
      for (std::size_t i = first > 1 ? first - 2 : 0; i <= last; ++i) {
        const double less = before[i][k] * allowed(e.kind) / (e.share * (1.0 + 1e-6));
        most[i][k] = std::min(most[i][k], std::max(least, less));
      }
    }
  }

  Timing in_time() {
    Timing timing = Timing::quintic(stretch_->length, *stretch_->time);
    double where = 0.0;
    const Uses use = measured(timing, table(timing), &where);
    for (std::size_t k = 0; k < kinds; ++k) {
      for (std::size_t i = 0; i < use[k].size(); ++i) {
        if (use[k][i].share <= 1.0) continue;
        const double s = timing.at(where).s;
        const std::size_t move = piece_at(s).move;
        const double least = optimal().duration();
        refuse(move, "time",
               fmt::format("in {:g} s takes {:.4g} % of {}{}, most at {}; \"optimal\" takes {:.4g} s",
                           *stretch_->time, 100.0 * use[k][i].share, kind_text[k],
                           k == 0 ? fmt::format(" (motor {})", i + 1) : "",
                           place_text(route_.place(*stretch_, s)->tip.p), least));
      }
    }
    return timing;
  }

  /// Smooths and slows a timing until no move exceeds its jerk: the mean over a window, then longer by what
  /// is left over, for the window with which that takes least.
  void limit_jerk(Timing& timing) const {
    bool any = false;
    for (std::size_t i = stretch_->first; i <= stretch_->last; ++i) any = any || p_.moves[i].jerk.has_value();
    if (!any) return;
    const Timing plain = timing;
    double best = 1e300;
    for (int k = 2; k <= 14; ++k) {
      Timing tried = plain;
      tried.smooth(plain.duration() * std::pow(2.0, -0.5 * k));
      const double over = jerk_share(tried);
      if (over > 1.0) tried.stretch(std::cbrt(over));
      if (tried.duration() >= best) continue;
      best = tried.duration();
      timing = tried;
    }
  }
  /// Largest jerk as a share of what the moves allow, from differences over a short time, with some room.
  [[nodiscard]] double jerk_share(const Timing& timing) const {
    constexpr int parts = 1000;
    constexpr double room = 1.02;
    const double step = timing.duration() / parts;
    double most = 0.0;
    std::optional<std::pair<Vec2<double>, Vec2<double>>> last;
    for (int i = 0; i <= parts; ++i) {
      const Timing::State s = timing.at(i * step);
      const auto at = route_.place(*stretch_, s.s);
      if (!at) continue;
      const Motion2<double> m = motion_at(*at, s);
      const std::pair<Vec2<double>, Vec2<double>> now{
          m.acceleration, at->base2 * (s.rate * s.rate) + at->base1 * s.acceleration};
      const Piece& piece = piece_at(s.s);
      for (std::size_t k = piece.move; last && k <= piece.next; ++k) {
        if (!p_.moves[k].jerk) continue;
        const double jerk = p_.moves[k].kind == MoveKind::joint
                                ? (now.second - last->second).cwiseAbs().maxCoeff()
                                : (now.first - last->first).norm();
        most = std::max(most, room * jerk / (step * *p_.moves[k].jerk));
      }
      last = now;
    }
    return most;
  }

  [[nodiscard]] std::vector<TimedPiece> table(const Timing& timing) const {
    return fit_quintics(timing.breaks(), [&](double t, bool before) {
      const Timing::State s = timing.at(t, before);
      return motion_at(*route_.place(*stretch_, s.s), s);
    });
  }
  std::optional<Desired<M>> desired(const Motion2<double>& m) const {
    return desired_at_effector(p_.controller.mechanism, p_.controller.mode, m.position, m.velocity,
                               m.acceleration);
  }

  /// Shares of all limits, tick by tick and at the ends of the quintics. `where`: time of the largest, s.
  Uses measured(const Timing& timing, const std::vector<TimedPiece>& table, double* where = nullptr) {
    Uses out{};
    double most = 0.0;
    const double duration = timing.duration(), step = std::max(p_.tick, duration / 20000.0);
    const auto n = static_cast<std::uint64_t>(duration / step);
    std::size_t k = 0;
    const auto look = [&](double t, const Motion2<double>& m, double weight) {
      const auto d = desired(m);
      const double s = timing.at(t).s;
      const auto span = timing.span(t);
      const Piece& piece = piece_at(s);
      if (!d) refuse(piece.move, "to", "leads out of reach at " + place_text(m.position));
      const double before = most;
      add_use(s, span, *d, m, weight, out, most);
      if (most > before && where != nullptr) *where = t;
    };
    for (std::uint64_t i = 0; i <= n; ++i) {
      const double t = static_cast<double>(i) * step;
      while (k + 1 < table.size() && table[k + 1].begin <= t) ++k;
      look(t, table[k].curve.at(t - table[k].begin), step);
    }
    for (const TimedPiece& piece : table) {
      look(piece.begin, piece.curve.at(0.0), 0.0);
      look(piece.begin + piece.curve.duration, piece.curve.at(piece.curve.duration), 0.0);
    }
    return out;
  }
  void add_use(double s, const std::pair<double, double>& span, const Desired<M>& d, const Motion2<double>& m,
               double weight, Uses& out, double& most) {
    const Piece& piece = piece_at(s);
    const auto add = [&](LimitKind kind, std::size_t i, double share) {
      Use& use = out[static_cast<std::size_t>(kind)][i];
      use.share = std::max(use.share, share);
      most = std::max(most, share);
      if (share > allowed(kind)) excess_.push_back({span.first, span.second, kind, share});
      if (share > at_limit * allowed(kind)) use.active += weight;
    };
    const Loads loads = motors_.shares(d, m);
    for (std::size_t i = 0; i < static_cast<std::size_t>(motors_.count()); ++i)
      add(LimitKind::torque, i, loads[i]);
    const Vec2<double> rate = M::base(d.rates), acceleration = M::base(d.acceleration);
    for (std::size_t i = 0; i < 2; ++i)
      add(LimitKind::joint_speed, i,
          std::abs(rate[static_cast<int>(i)]) / (speed_reserve * p_.controller.limits.joint_speed));
    for (std::size_t k = piece.move; k <= piece.next; ++k) {
      const MoveScene& move = p_.moves[k];
      const bool joint = move.kind == MoveKind::joint;
      if (move.speed)
        add(LimitKind::speed, 0, (joint ? rate.cwiseAbs().maxCoeff() : m.velocity.norm()) / *move.speed);
      if (move.acceleration)
        add(LimitKind::acceleration, 0,
            (joint ? acceleration.cwiseAbs().maxCoeff() : m.acceleration.norm()) / *move.acceleration);
    }
  }

  /// Adds a timed stretch to the plan.
  void append(const Timing& timing) {
    const std::vector<TimedPiece> pieces = table(timing);
    const Uses use = measured(timing, pieces);
    for (std::size_t k = 0; k < kinds; ++k) {
      for (std::size_t i = 0; i < use[k].size(); ++i) {
        out_.use[k][i].share = std::max(out_.use[k][i].share, use[k][i].share);
        out_.use[k][i].active += use[k][i].active;
      }
    }
    for (std::size_t i = stretch_->first; i <= stretch_->last; ++i) {
      if (p_.moves[i].jerk) {
        Use& jerk = out_.use[static_cast<std::size_t>(LimitKind::jerk)][0];
        jerk.share = std::max(jerk.share, jerk_share(timing));
      }
    }
    for (const TimedPiece& piece : pieces) {
      const double begin = now_ + piece.begin, ticks = std::ceil(begin / p_.tick - 1e-9);
      const PathSegment<double> segment{static_cast<std::uint32_t>(std::min(ticks, most_ticks)),
                                        std::max(0.0, ticks * p_.tick - begin), piece.curve};
      if (!out_.path.empty() && out_.path.back().start_tick == segment.start_tick) out_.path.pop_back();
      out_.path.push_back(segment);
    }
    for (const Piece& piece : stretch_->pieces)  // a blend is halved between its moves
      out_.end[piece.move] = now_ + timing.time_of(piece.at + (piece.blend() ? 0.5 : 1.0) * piece.length());
    out_.end[stretch_->last] = now_ + timing.duration();
    now_ += timing.duration();
    moving_ += timing.duration();
    if (!p_.bound) return;
    set_rows({}, true);
    const Squares x = solve();
    out_.bound += Timing(grid_.s, x).duration();
  }

  const Problem<M>& p_;
  Route<M> route_;
  MotorLimits<M> motors_;
  WayGuard<M> guard_;
  const Stretch* stretch_ = nullptr;
  Grid grid_;
  std::vector<Place<M>> place_;
  std::vector<Loads> low_, high_;  // reserve
  struct Excess {
    double from, to;  // part of the path
    LimitKind kind;
    double share;
  };
  std::vector<Excess> excess_;  // of the last measurement
  Plan out_;
  double now_ = 0.0, moving_ = 0.0;  // s
};

}  // namespace

template <class M>
Plan plan(const Problem<M>& p) {
  return Planner<M>(p).run();
}

template Plan plan(const Problem<FiveBar<double>>&);
template Plan plan(const Problem<Rr<double>>&);

}  // namespace esmc::host::plan
