#pragma once
/// Error against work: every integrator on one problem over a range of steps, and the order it shows.

#include <algorithm>
#include <array>
#include <cmath>
#include <ctime>
#include <functional>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "host_sim/integrate/dopri5.hpp"
#include "host_sim/integrate/dopri8.hpp"
#include "host_sim/integrate/fixed_step.hpp"
#include "host_sim/integrate/radau5.hpp"

namespace esmc::host {

struct WorkPoint {
  std::string problem, method;
  bool adaptive = false;
  double setting = 0.0;  ///< step, s; or tolerance
  double error = 0.0;    ///< largest of the positions at the end, relative to their size or 1
  double cpu_ms = 0.0;   ///< smallest of some runs, this thread
};

/// What the fixed steps of a method showed on a problem.
struct OrderFound {
  std::string problem, method;
  int order = 0;       ///< theory
  double found = 0.0;  ///< slope of log error over log step; NaN where the errors did not settle on one
  [[nodiscard]] bool judged() const { return std::isfinite(found); }  ///< an order was found
  [[nodiscard]] bool holds() const { return !judged() || std::abs(found - order) <= 0.2; }
};

struct WorkPrecision {
  std::vector<WorkPoint> points;
  std::vector<OrderFound> orders;
  std::function<void()> after_run = [] {};  ///< called after each run; may throw
};

inline constexpr int instants = 8;  ///< equally spaced, at which a run is compared

/// A problem: a system, where it starts, and where its positions are at the end, known from elsewhere.
template <class S>
struct Problem {
  std::string name;
  const S* system;  ///< must outlive the problem
  typename S::State start;
  double end;                     ///< s
  typename S::State reference{};  ///< positions at `end`; the other entries are not looked at
  double rounding = 2e-15;        ///< errors up to some times this tell nothing of an order
  bool smooth = true;             ///< false: passes a place where theory promises no order; none is judged
  std::array<typename S::State, instants> track{};  ///< the way there, finely integrated; for the orders only
};

/// CPU time of this thread so far, s.
[[nodiscard]] inline double thread_cpu_s() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

/// Largest error of the positions, relative to their size or 1; NaN where one is not a number.
template <class S>
[[nodiscard]] double error_of(const typename S::State& y, const typename S::State& reference) {
  double worst = 0.0;
  for (std::size_t i = 0; i < S::positions; ++i) {
    const double e = std::abs(y[i] - reference[i]) / std::max(1.0, std::abs(reference[i]));
    worst = e <= worst ? worst : e;  // a NaN wins
  }
  return worst;
}

/// Fills the track with order 8 at `steps` steps between instants.
template <class S>
void integrate_track(Problem<S>& p, int steps) {
  Dopri8<S> m(*p.system);
  typename S::State y = p.start;
  const double h = p.end / (instants * steps);
  for (int k = 0; k < instants; ++k) {
    for (int i = 0; i < steps; ++i) m.step((k * steps + i) * h, h, y);
    p.track[static_cast<std::size_t>(k)] = y;
  }
}

/// Runs `once(y)` from the start up to five times or for 2 ms; sets error and least CPU time of `point`.
template <class S, class Once>
void measure(const Problem<S>& p, const Once& once, WorkPoint& point) {
  constexpr double patience_s = 2e-3;
  double best = 0.0, spent = 0.0;
  for (int k = 0; k < 5 && (k == 0 || spent < patience_s); ++k) {
    typename S::State y = p.start;
    const double begin = thread_cpu_s();
    once(y);
    const double took = thread_cpu_s() - begin;
    best = k == 0 ? took : std::min(best, took);
    spent += took;
    point.error = error_of<S>(y, p.reference);
  }
  point.cpu_ms = 1e3 * best;
}

/// Slope of the straight line through (log step, log error).
[[nodiscard]] inline double slope_of(const std::vector<std::pair<double, double>>& line) {
  double sx = 0, sy = 0, sxx = 0, sxy = 0;
  for (const auto& [step, error] : line) {
    const double x = std::log(step), y = std::log(error);
    sx += x;
    sy += y;
    sxx += x * x;
    sxy += x * y;
  }
  const auto n = static_cast<double>(line.size());
  return (n * sxy - sx * sy) / (n * sxx - sx * sx);
}

/// The order that steps and errors (coarse first) show at their fine end, above rounding. NaN where the slope
/// of the finest four differs from that of the window before by more than half of the tolerance on an order.
[[nodiscard]] inline double order_of(const std::vector<std::pair<double, double>>& step_error, int order,
                                     double rounding) {
  constexpr double inf = std::numeric_limits<double>::infinity();
  constexpr std::size_t window = 4, shift = 2;
  constexpr double settled = 0.1;
  std::vector<std::pair<double, double>> usable;
  for (const auto& p : step_error) {
    if (!(p.second > 30.0 * rounding)) break;
    // Many steps gather rounding of their own: the fine end is where errors stop to shrink as they should.
    const auto expected =
        usable.empty() ? inf : usable.back().second * std::pow(p.first / usable.back().first, 0.7 * order);
    if (!usable.empty() && p.second > expected && p.second < 1e-9) break;
    if (p.second < 1e-2) usable.push_back(p);
  }
  if (usable.size() < window + shift) return std::numeric_limits<double>::quiet_NaN();
  const auto end = usable.end();
  const double fine = slope_of({end - window, end}), before = slope_of({end - window - shift, end - shift});
  return std::abs(fine - before) <= settled ? fine : std::numeric_limits<double>::quiet_NaN();
}

/// Adds points of fixed steps, ever finer until rounding or `most_steps`, and the order, of the root mean
/// square over the track (integrate_track first): the error at one instant may pass through zero.
template <class Method, class S>
void fixed_steps(const Problem<S>& p, int first_steps, long most_steps, WorkPrecision& out) {
  std::vector<std::pair<double, double>> track_error;
  double wanted = std::max(1.0, static_cast<double>(first_steps) / instants);
  int last = 0;
  for (int k = 0; k < 60 && instants * wanted < static_cast<double>(most_steps);
       ++k, wanted *= 1.25992104989) {
    const int between = static_cast<int>(std::lround(wanted));
    if (between == last) continue;
    last = between;
    const double h = p.end / (instants * between);
    WorkPoint point{p.name, Method::name, false, h, 0.0, 0.0};
    double squares = 0.0;
    measure(
        p,
        [&](typename S::State& y) {
          Method m(*p.system);
          squares = 0.0;
          for (int n = 0; n < instants; ++n) {
            for (int i = 0; i < between; ++i) m.step((n * between + i) * h, h, y);
            const double e = error_of<S>(y, p.track[static_cast<std::size_t>(n)]);
            squares += e * e;
          }
        },
        point);
    out.points.push_back(point);
    out.after_run();
    const double rms = std::sqrt(squares / instants);
    if (std::isfinite(rms)) track_error.emplace_back(h, rms);
    if (rms < 3.0 * p.rounding) break;
  }
  out.orders.push_back({p.name, Method::name, Method::order,
                        p.smooth ? order_of(track_error, Method::order, p.rounding)
                                 : std::numeric_limits<double>::quiet_NaN()});
}

/// Adds a point for each tolerance from 1e-3 to 1e-14; its error is NaN where the method gave up.
template <class Method, class S>
void tolerances(const Problem<S>& p, WorkPrecision& out) {
  for (double tol = 1e-3; tol > 1e-14; tol *= 0.1) {
    WorkPoint point{p.name, Method::name, true, tol, 0.0, 0.0};
    measure(
        p,
        [&](typename S::State& y) {
          Method m(*p.system);
          Tolerance t;
          t.absolute = t.relative = tol;
          if (!m.advance(0.0, p.end, y, t).ok) y[0] = std::numeric_limits<double>::quiet_NaN();
        },
        point);
    out.points.push_back(point);
    out.after_run();
  }
}

/// Adds points and orders of all methods. `first_steps`: number of steps of RK4 that is just too coarse;
/// `most_steps` of one run.
template <class S>
void work_precision(const Problem<S>& p, int first_steps, long most_steps, WorkPrecision& out) {
  fixed_steps<SemiImplicitEuler<S>>(p, 8 * first_steps, most_steps, out);
  fixed_steps<Rk4<S>>(p, first_steps, most_steps, out);
  fixed_steps<Dopri5<S>>(p, std::max(1, first_steps / 2), most_steps, out);
  fixed_steps<Dopri8<S>>(p, std::max(1, first_steps / 8), most_steps, out);
  fixed_steps<Radau5<S>>(p, std::max(1, first_steps / 4), most_steps, out);
  tolerances<Dopri5<S>>(p, out);
  tolerances<Dopri8<S>>(p, out);
  tolerances<Radau5<S>>(p, out);
}

}  // namespace esmc::host
