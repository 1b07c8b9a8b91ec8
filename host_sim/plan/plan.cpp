#include "host_sim/plan/plan.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "host_sim/plan/measure.hpp"

namespace esmc::host::plan {
namespace {

using Shares = std::array<double, kinds>;
/// Time in which the acceleration of the path changes from one value to another where no plant is to
/// saturate: a loop that samples cannot follow a jump.
constexpr double loop_ticks = 8.0;
constexpr double longest = 1e6, most_ticks = 4e9;  ///< s, of a program; of its table

template <class M>
class Planner {
 public:
  explicit Planner(const Problem<M>& p)
      : p_(p), route_(p), motors_(p), guard_(p, motors_), measured_(p, route_, motors_) {}

  Plan run() {
    out_.deviation = route_.deviation();
    out_.from = route_.from();
    out_.from_base = route_.from_base();
    out_.end.assign(p_.moves.size(), 0.0);
    for (const Stretch& s : route_.stretches()) {
      rest_until(s.first, s.rest);
      stretch_ = &s;
      measured_.begin(s);
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
    piece_.clear();
    for (std::size_t k = 0; k < pieces.size(); ++k) {
      const Piece& piece = pieces[k];
      const double share = piece.length() / stretch_->length;
      const auto n = std::max<std::size_t>(
          8, static_cast<std::size_t>((0.4 * share + 0.6 / static_cast<double>(pieces.size())) *
                                      static_cast<double>(p_.grid)));
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
        const double at = piece.at + y * piece.length();
        if (!grid_.s.empty()) add_place(0.5 * (grid_.s.back() + at));
        grid_.s.push_back(at);
        add_place(at);
      }
    }
    low_.assign(place_.size(), Loads{});
    high_ = low_;
  }

  void add_place(double s) {
    const auto at = route_.place(*stretch_, s);
    const Piece& piece = piece_at(s);
    if (!at)
      refuse(piece.move, "to",
             "leads out of reach at " + place_text(piece.point(piece.begin + s - piece.at).p));
    place_.push_back(*at);
    piece_.push_back(&piece);
  }
  [[nodiscard]] const Piece& piece_at(double s) const { return Route<M>::piece_at(*stretch_, s); }

  /// Guards of the controller along the stretch.
  void check_way() {
    for (std::size_t i = 0; i < place_.size(); ++i) guard_.check(place_[i], piece_[i]->move);
    for (std::size_t i = stretch_->first; i <= stretch_->last; ++i) {
      if (guard_.changes_mode(i))
        refuse(i, "working_mode", "is not that at the end of the move, which is mechanism.working_mode");
    }
  }

  /// Rows of all points; `motors_only`: of the motors without reserve.
  void set_rows(bool motors_only = false) {
    grid_.rows.clear();
    grid_.first.clear();
    for (std::size_t i = 0; i < place_.size(); ++i) {
      grid_.first.push_back(grid_.rows.size());
      const Loads none{};
      motors_.add_rows(place_[i], motors_only ? none : low_[i], motors_only ? none : high_[i], grid_.rows);
      if (!motors_only) add_motion_rows(p_, *piece_[i], place_[i], grid_.rows);
    }
    grid_.first.push_back(grid_.rows.size());
  }

  /// The fastest timing with a share of each limit, point by point.
  Squares solve(const std::vector<Shares>& most, const Squares& start) {
    const std::vector<Row> whole = grid_.rows;
    for (std::size_t i = 0; i < most.size(); ++i) {
      for (std::size_t k = grid_.first[i]; k < grid_.first[i + 1]; ++k) {
        Row& row = grid_.rows[k];
        row.c = lowered(row, most[i][static_cast<std::size_t>(row.kind)]);
      }
    }
    Squares x = solve(start);
    grid_.rows = whole;
    return x;
  }
  Squares solve(const Squares& start) {
    std::size_t blocked = 0;
    auto x = fastest(grid_, start, blocked);
    if (x) return *x;
    const std::size_t at = std::min(2 * blocked, place_.size() - 1);
    refuse(piece_[at]->move, "to",
           fmt::format("no speed passes {}: the motors' torque within its limits, less what [uncertainty] "
                       "needs, does not "
                       "keep the mechanism on the way there",
                       place_text(place_[at].tip.p)));
  }

  /// Reserve for the worst plant at every point, of the motion with x.
  void set_reserve(const std::vector<double>& x) {
    for (std::size_t i = 0; i < place_.size(); ++i) {
      low_[i] = high_[i] = Loads{};
      const double root = std::sqrt(0.5 * (x[i / 2] + x[(i + 1) / 2]));
      for (const std::size_t k : {(i - 1) / 2, i / 2}) {  // intervals before and after the place
        if (i == 0 || k + 1 == x.size()) continue;
        const double u = (x[k + 1] - x[k]) / (2.0 * (grid_.s[k + 1] - grid_.s[k]));
        const Motion2<double> m = motion_at(place_[i].tip, {0.0, root, u});
        const auto d = measured_.desired(m);
        if (!d) continue;
        const auto [low, high] = motors_.reserve(*d, m);
        for (std::size_t j = 0; j < low.size(); ++j) {
          low_[i][j] = std::min(low_[i][j], low[j]);
          high_[i][j] = std::max(high_[i][j], high[j]);
        }
        if (i % 2 == 1) break;
      }
    }
  }

  Timing optimal() {
    Shares all;
    for (std::size_t k = 0; k < kinds; ++k) all[k] = measured_.allowed(static_cast<LimitKind>(k));
    std::vector<Shares> most(place_.size(), all);  // share of each limit that may be used, point by point
    Timing timing;
    Squares x;
    double share = 0.0;
    constexpr int passes = 12;
    constexpr double near = 1.005;  // of a limit: what is beyond is mended where it is, less by slowing all
    set_rows();
    for (int pass = 0; pass < passes; ++pass) {
      x = solve(most, x);
      for (int k = 0; p_.uncertain && pass == 0 && k < 4; ++k) {
        set_reserve(x.x);
        set_rows();
        x = solve(most, x);
      }
      timing = Timing(grid_.s, x);
      if (p_.uncertain) timing.smooth(loop_ticks * p_.tick);
      limit_jerk(timing);
      share = excess(timing);
      if (share <= near) break;
      lower(most);
    }
    slow_down(timing, share);
    return timing;
  }
  /// Stretches a timing until no share is above what is allowed; `share`: its excess().
  void slow_down(Timing& timing, double share) {
    double last_share = 0.0, last_square = 0.0;  // and 1 / duration^2, of the timing before
    for (int pass = 0; pass < 100 && share > 1.0; ++pass) {
      const double square = 1.0 / (timing.duration() * timing.duration()),
                   slope = (last_share - share) / (last_square - square);
      double factor = share;  // of 1 / duration^2, in which a share is linear: what holds the pose stays
      if (pass > 0 && slope > 0.0) factor = 1.0 / std::max(0.1, 1.0 - (share - 1.0) / (slope * square));
      last_share = share;
      last_square = square;
      timing.stretch(std::sqrt(std::clamp(factor, 1.0, 1.05) + spare()));
      share = excess(timing);
    }
  }
  /// Measures a timing: its largest share of what is allowed, 1 if that is not exceeded.
  double excess(const Timing& timing) {
    (void)measured_.take(timing);
    double share = 1.0;
    for (const Excess& e : measured_.excess()) share = std::max(share, e.share / measured_.allowed(e.kind));
    return share;
  }
  /// What is taken beyond an excess: places between those that were measured may take a little more.
  [[nodiscard]] double spare() const { return 10.0 / static_cast<double>(place_.size() * place_.size()); }
  /// Takes from the places around every excess the share that was too much there.
  void lower(std::vector<Shares>& most) const {
    constexpr double least = 0.5;  // beyond that slower motion helps, not less torque
    const std::vector<Shares> before = most;
    const auto index = [&](double s) {
      return static_cast<std::size_t>(std::upper_bound(grid_.s.begin(), grid_.s.end(), s) - grid_.s.begin());
    };
    for (const Excess& e : measured_.excess()) {
      const auto k = static_cast<std::size_t>(e.kind);
      const std::size_t first = 2 * index(e.from), last = std::min(2 * index(e.to), most.size() - 1);
      for (std::size_t i = first > 2 ? first - 3 : 0; i <= last; ++i) {
        const double less = before[i][k] * measured_.allowed(e.kind) / (e.share * (1.0 + spare()));
        most[i][k] = std::min(most[i][k], std::max(least, less));
      }
    }
  }

  Timing in_time() {
    Timing timing = Timing::quintic(stretch_->length, *stretch_->time);
    const double where = measured_.take(timing);
    const Uses use = measured_.use();
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
      const Motion2<double> m = motion_at(at->tip, s);
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
      if (!out_.path.empty() && out_.path.back().start_tick == segment.start_tick) out_.path.pop_back();
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
    set_rows();
    const std::vector<double> limits = speed_limits(grid_);
    for (std::size_t i = 0; i < limits.size(); i += 2) {
      if (limits[i] >= 0.0)
        out_.limit_curve.emplace_back(now_ + timing.time_of(grid_.s[i / 2]),
                                      place_[i].tip.d1.norm() * std::sqrt(limits[i]));
    }
    set_rows(true);
    const Squares x = solve({});
    out_.bound += Timing(grid_.s, x).duration();
  }

  const Problem<M>& p_;
  Route<M> route_;
  MotorLimits<M> motors_;
  WayGuard<M> guard_;
  Measurement<M> measured_;
  const Stretch* stretch_ = nullptr;
  Grid grid_;
  std::vector<Place<M>> place_;      // points of the grid and the middles between them
  std::vector<const Piece*> piece_;  // of each place
  std::vector<Loads> low_, high_;    // reserve
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
