#include "host_sim/plan/plan.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "host_sim/plan/measure.hpp"
#include "host_sim/plan/spots.hpp"

namespace esmc::host::plan {
namespace {

using Shares = std::array<double, kinds>;
/// Time in which the acceleration of the path changes from one value to another where no plant is to
/// saturate under a law that answers a jump slowly.
constexpr double loop_ticks = 8.0;
constexpr double longest = 1e6, most_ticks = 4e9;  ///< s, of a program; of its table

template <class M>
class Planner {
 public:
  explicit Planner(const Problem<M>& p)
      : p_(p),
        route_(p),
        motors_(p),
        guard_(p, motors_),
        measured_(p, route_, motors_, guard_),
        spots_(p, route_, motors_) {}

  Plan run() {
    out_.deviation = route_.deviation();
    out_.from = route_.from();
    out_.from_base = route_.from_base();
    out_.end.assign(p_.moves.size(), 0.0);
    for (const Stretch& s : route_.stretches()) {
      rest_until(s.first, s.rest);
      stretch_ = &s;
      measured_.begin(s);
      spots_.begin(s);
      check_way();
      const Timing timing = s.time ? in_time() : optimal();
      append(timing);
    }
    rest_until(p_.moves.size(), route_.last_rest());
    out_.duration = now_;
    if (const double most = std::min(longest, most_ticks * p_.tick); !(now_ <= most))
      throw Refused(p_.moves.size() - 1, "time", "ends after {:.3g} s, at most {:g} are allowed", now_, most);
    out_.ticks = static_cast<std::uint32_t>(std::ceil(now_ / p_.tick - 1e-9));
    for (auto& kind : out_.use) {
      for (Use& use : kind) use.active /= std::max(moving_, p_.tick);
    }
    return out_;
  }

 private:
  /// Dwells before move `next`: all moves before it have ended by then.
  void rest_until(std::size_t next, double rest) {
    for (std::size_t i = 0; i < next; ++i) {
      if (p_.moves[i].kind == MoveKind::dwell && out_.end[i] == 0.0) out_.end[i] = now_ += *p_.moves[i].time;
    }
    out_.bound += rest;
  }

  [[nodiscard]] const Piece& piece_at(double s) const { return Route<M>::piece_at(*stretch_, s); }

  /// Refuses the way between s, which a guard lets pass, and `end`, where it does not, by the place where it
  /// begins.
  void refuse_from(double s, double end) {
    for (int pass = 0; pass < 12; ++pass) {
      const double middle = 0.5 * (s + end);
      const auto at = route_.place(*stretch_, middle);
      if (!at) return;
      try {
        guard_.check(at->at.pose, [&] { return piece_at(middle).move; });
        s = middle;
      } catch (const Refused&) {
        end = middle;
      }
    }
    guard_.check(route_.place(*stretch_, end)->at.pose, [&] { return piece_at(end).move; });
  }
  /// Guards of the controller along the stretch.
  void check_way() {
    for (std::size_t i = 0; i < spots_.size(); ++i) {
      if (!spots_.at(i)) continue;
      const typename M::Pose& pose = spots_.at(i)->at.pose;
      try {
        guard_.check(pose, [&] { return spots_[i].piece->move; });
      } catch (const Refused&) {
        if (i >= 2) refuse_from(spots_[i - 2].s, spots_[i].s);
        throw;
      }
      guard_.check_holding(pose, spots_[i].piece->move);
    }
    for (std::size_t i = stretch_->first; i <= stretch_->last; ++i) {
      if (guard_.changes_mode(i))
        throw Refused(i, "working_mode",
                      "is not that at the end of the move, which is mechanism.working_mode");
    }
  }

  /// The fastest timing with a share of each limit, point by point.
  Squares solve(const std::vector<Shares>& most, const Squares& start) {
    const std::vector<Row> whole = grid_.rows;
    for (std::size_t i = 0; i < most.size(); ++i) {
      for (std::size_t k = grid_.first[i]; k < grid_.first[i + 1]; ++k)
        plan::lower(grid_.rows[k], most[i][static_cast<std::size_t>(grid_.rows[k].kind)]);
    }
    Squares x = solve(start);
    grid_.rows = whole;
    return x;
  }
  Squares solve(const Squares& start, bool rough = false) {
    std::size_t blocked = 0;
    auto x = fastest(grid_, start, blocked, rough);
    if (x) return *x;
    const std::size_t at = std::min(2 * blocked, spots_.size() - 1);
    throw Refused(spots_[at].piece->move, "to",
                  "no speed passes {}: the motors' torque within its limits, less what [uncertainty] needs, "
                  "does not keep the mechanism on the way there",
                  place_text(spots_.at(at)->tip.p));
  }

  /// Without a motion to begin with; between the points of a coarse grid limits may leave no speed, then of a
  /// finer one. `rough`: for a start, with all rows, otherwise with those of the motors.
  Squares solve_anew(bool rough) {
    for (double share = 4.0;; share *= 4.0) {
      try {
        spots_.set_rows(!rough);
        return solve({}, rough);
      } catch (const Refused&) {
        if (share > 16.0) throw;
        spots_.set(share);
      }
    }
  }

  /// Reserve for the worst plant at every point, near the motion with x.
  void set_reserve(const std::vector<double>& x) {
    for (std::size_t i = 0; i < spots_.size(); ++i) {
      Reserve less{};
      for (const std::size_t k : {(i - 1) / 2, i / 2}) {  // intervals before and after the place
        if (i == 0 || k + 1 == x.size()) continue;
        add_reserve(spots_.at(i)->tip, 0.5 * (x[i / 2] + x[(i + 1) / 2]),
                    (x[k + 1] - x[k]) / (2.0 * (grid_.s[k + 1] - grid_.s[k])), less);
        if (i % 2 == 1) break;
      }
      spots_.set_reserve(i, less);
    }
    spots_.forget_rows();
    spots_.set_rows();
  }
  /// Of what `less` holds and the tangents at this motion, those that are further away there.
  void add_reserve(const CurvePoint& tip, double x, double u, Reserve& less) {
    const auto at = [&](double square, double bend) -> std::optional<std::pair<Loads, Loads>> {
      const Motion2<double> m = motion_at(tip, {0.0, std::sqrt(square), bend});
      Desired<M> d;
      return measured_.desired(m, d) ? std::optional(motors_.reserve(d, m)) : std::nullopt;
    };
    constexpr double share = 1e-3, least = 1e-6;
    const double du = share * std::abs(u) + least, dx = share * x + least;
    const auto here = at(x, u), faster = at(x, u + du), further = at(x + dx, u), hold = at(0.0, 0.0);
    if (!here || !faster || !further || !hold) return;
    const auto tangent = [&](double value, double more_u, double more_x, double held, double sign,
                             Affine& out) {
      if (sign * value <= sign * (out.rest + out.per_u * u + out.per_x * x)) return;
      out.per_u = (more_u - value) / du;
      out.per_x = (more_x - value) / dx;
      out.rest = value - out.per_u * u - out.per_x * x;
      if (sign * out.rest <= sign * held || !(x > 0.0)) return;
      out.rest = held;  // concave in x, as viscous friction is: from rest through this motion
      out.per_x = (value - held - out.per_u * u) / x;
    };
    for (std::size_t j = 0; j < here->first.size(); ++j) {
      tangent(here->first[j], faster->first[j], further->first[j], hold->first[j], -1.0, less.low[j]);
      tangent(here->second[j], faster->second[j], further->second[j], hold->second[j], 1.0, less.high[j]);
    }
  }

  Timing optimal() {
    Shares all;
    for (std::size_t k = 0; k < kinds; ++k) all[k] = measured_.allowed(static_cast<LimitKind>(k));
    Squares x = solve_anew(true);
    for (int pass = 1; spots_.refine(x) && pass < refinements; ++pass) {
      spots_.set_rows();
      x = solve(x, true);
    }
    spots_.set_rows();
    x = solve(x);
    std::vector<Shares> most;  // share of each limit that may be used, spot by spot; empty: all
    if (p_.uncertain) most.assign(spots_.size(), all);
    Timing timing;
    double share = 0.0;
    constexpr int passes = 12;
    constexpr double near = 1.005;  // of a limit: what is beyond is mended where it is, less by slowing all
    for (int pass = 0; pass < passes; ++pass) {
      if (pass > 0 || p_.uncertain) {
        try {
          x = solve(most, x);
        } catch (const Refused&) {  // a place keeps less than holding takes there: slower in all is left
          if (pass == 0) throw;
          break;
        }
      }
      for (int k = 0; p_.uncertain && pass == 0 && k < 4; ++k) {
        set_reserve(x.x);
        x = solve(most, x);
      }
      timing = Timing(grid_.s, x);
      if (p_.uncertain && !measured_.fast_law()) timing.smooth(loop_ticks * p_.tick);
      limit_jerk(timing);
      share = measured_.take(timing);
      // Where dry friction turns, a tick tells more than a parabola.
      if (share <= near && motors_.rubs() && !p_.uncertain)
        share = std::max(share, measured_.take_ticks(now_));
      if (share <= near) break;
      if (most.empty()) most.assign(spots_.size(), all);
      lower(most);
    }
    slow_down(timing, share);
    return timing;
  }
  /// Stretches a timing until no share is above what is allowed; `share`: its largest.
  void slow_down(Timing& timing, double share) {
    for (int pass = 0; pass < 20; ++pass) {
      if (share <= 1.0) share = measured_.take_ticks(now_);
      if (share <= 1.0) break;
      double factor = 1.0, last_share = 0.0, last_square = 0.0;  // and 1 / factor^2 of the last one
      // Longer, the ticks fall elsewhere: again and again more is left.
      const double most = 1.0 - std::min(1e-3, std::ldexp(spare(share), pass));
      while (share > most && factor < 10.0) {
        const double square = 1.0 / (factor * factor), slope = (last_share - share) / (last_square - square);
        double less = most / share;  // of 1 / factor^2, in which a share is linear: what holds the pose stays
        if (last_square > 0.0 && slope > 0.0) less = 1.0 - (share - most) / (slope * square);
        last_share = share;
        last_square = square;
        factor /= std::sqrt(std::clamp(less, 0.9, 1.0 - 1e-9));
        share = measured_.judge(factor);
        if (!measured_.scales()) break;  // it is measured anew
      }
      timing.stretch(factor);
      measured_.stretch(factor);
      if (!measured_.scales()) share = measured_.take(timing);
    }
  }
  /// What is taken beyond an excess: a parabola between looks may miss a part of it.
  static double spare(double share) { return std::clamp(0.2 * (share - 1.0), 0.0, 2e-4); }
  /// Takes from the places around every excess the share that was too much there.
  void lower(std::vector<Shares>& most) const {
    constexpr double least = 0.5;  // beyond that slower motion helps, not less torque
    const std::vector<Shares> before = most;
    const auto index = [&](double s) {
      return static_cast<std::size_t>(std::upper_bound(grid_.s.begin(), grid_.s.end(), s) - grid_.s.begin());
    };
    for (const Excess& e : measured_.excess()) {
      const auto k = static_cast<std::size_t>(e.kind == LimitKind::joint_speed ? LimitKind::speed : e.kind);
      const std::size_t first = 2 * index(e.from), last = std::min(2 * index(e.to), most.size() - 1);
      for (std::size_t i = first > 2 ? first - 3 : 0; i <= last; ++i) {
        const double less = before[i][k] * measured_.allowed(e.kind) / (e.share * (1.0 + spare(e.share)));
        most[i][k] = std::min(most[i][k], std::max(least, less));
      }
    }
  }

  Timing in_time() {
    constexpr double least_ticks = 4.0;  // in fewer the law sees nothing of a quintic
    if (*stretch_->time < least_ticks * p_.tick)
      throw Refused(stretch_->first, "time", "{:g} s is less than four ticks", *stretch_->time);
    Timing timing = Timing::quintic(stretch_->length, *stretch_->time);
    (void)measured_.take(timing);
    const Uses use = measured_.use();
    for (std::size_t k = 0; k < kinds; ++k) {
      for (std::size_t i = 0; i < use[k].size(); ++i) {
        if (use[k][i].share <= 1.0) continue;
        const double s = timing.at(measured_.where()).s;
        const std::size_t move = piece_at(s).move;
        const double least = optimal().duration();
        throw Refused(move, "time",
                      "in {:g} s takes {:.4g} % of {}{}, most at {}; \"optimal\" takes {:.4g} s",
                      *stretch_->time, 100.0 * use[k][i].share, kind_text[k],
                      k == 0 ? fmt::format(" (motor {})", i + 1) : "",
                      place_text(route_.place(*stretch_, s)->tip.p), least);
      }
    }
    if (const double share = limits_jerk() ? jerk_share(timing) / jerk_room : 0.0; share > 1.0)
      throw Refused(stretch_->first, "time", "in {:g} s takes {:.4g} % of jerk; \"optimal\" takes {:.4g} s",
                    *stretch_->time, 100.0 * share, optimal().duration());
    return timing;
  }

  [[nodiscard]] bool limits_jerk() const {
    const auto first = p_.moves.begin() + static_cast<std::ptrdiff_t>(stretch_->first),
               last = p_.moves.begin() + static_cast<std::ptrdiff_t>(stretch_->last);
    return std::any_of(first, last + 1, [](const auto& move) { return move.jerk.has_value(); });
  }
  /// Smooths and slows a timing until no move exceeds its jerk: the mean over a window, then longer by what
  /// is left over, for the window with which that takes least.
  void limit_jerk(Timing& timing) const {
    if (!limits_jerk()) return;
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
  static constexpr double jerk_room = 1.02;
  /// Largest jerk as a share of what the moves allow, from differences over a thousandth of the stretch, with
  /// some room; shorter peaks pass.
  [[nodiscard]] double jerk_share(const Timing& timing) const {
    constexpr int parts = 1000;
    const double step = timing.duration() / parts;
    double most = 0.0;
    std::optional<std::pair<Vec2<double>, Vec2<double>>> last;
    for (int i = 0; i <= parts; ++i) {
      const Timing::State s = timing.at(i * step);
      const auto at = route_.place(*stretch_, s.s);
      if (!at) continue;
      const Motion2<double> m = motion_at(at->tip, s);
      const std::pair<Vec2<double>, Vec2<double>> now{
          m.acceleration, at->base2 * (s.rate * s.rate) + at->base1 * s.acceleration};
      const Piece& piece = piece_at(s.s);
      for (std::size_t k = piece.move; last && k <= piece.next; ++k) {
        if (!p_.moves[k].jerk) continue;
        const double jerk = p_.moves[k].kind == MoveKind::joint
                                ? (now.second - last->second).cwiseAbs().maxCoeff()
                                : (now.first - last->first).norm();
        most = std::max(most, jerk_room * jerk / (step * *p_.moves[k].jerk));
      }
      last = now;
    }
    return most;
  }

  /// Adds a stretch to the plan, with the timing that was measured last.
  void append(const Timing& timing) {
    const Uses& use = measured_.use();
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
    for (const TimedPiece& piece : measured_.table()) {
      const double begin = now_ + piece.begin, ticks = std::ceil(begin / p_.tick - 1e-9);
      const PathSegment<double> segment{static_cast<std::uint32_t>(std::min(ticks, most_ticks)),
                                        std::max(0.0, ticks * p_.tick - begin), piece.curve};
      if (!out_.path.empty() && out_.path.back().start_tick == segment.start_tick) {
        Quintic<double> rest;  // before the first one the path holds where the next one begins
        rest.c[0] = out_.path.back().curve.c[0];
        out_.path.pop_back();
        if (out_.path.empty() && segment.start_tick > 0) out_.path.push_back({0, 0.0, rest});
      }
      out_.path.push_back(segment);
    }
    for (const Piece& piece : stretch_->pieces)  // a blend is halved between its moves
      out_.end[piece.move] = now_ + timing.time_of(piece.at + (piece.blend() ? 0.5 : 1.0) * piece.length());
    out_.end[stretch_->last] = now_ + timing.duration();
    if (p_.bound) add_bound(timing);
    now_ += timing.duration();
    moving_ += timing.duration();
  }
  void add_bound(const Timing& timing) {
    spots_.set(1.0);
    spots_.set_rows();
    const std::vector<double> limits = speed_limits(grid_);
    for (std::size_t i = 0; i < limits.size(); i += 2) {
      if (limits[i] >= 0.0)
        out_.limit_curve.emplace_back(now_ + timing.time_of(grid_.s[i / 2]),
                                      spots_.at(i)->tip.d1.norm() * std::sqrt(limits[i]));
    }
    spots_.forget_rows();
    Squares x = solve_anew(false);
    for (int pass = 0; pass < refinements && spots_.refine(x); ++pass) {
      spots_.set_rows(true);
      x = solve(x);
    }
    out_.bound += Timing(grid_.s, x).duration();
  }

  const Problem<M>& p_;
  Route<M> route_;
  MotorLimits<M> motors_;
  WayGuard<M> guard_;
  Measurement<M> measured_;
  const Stretch* stretch_ = nullptr;
  Spots<M> spots_;
  Grid& grid_ = spots_.grid();
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
