#pragma once
/// Reactions of joints at rest and impulses of stops: complementarity problems of a few rows
///   r_j = lower if a_j > 0,  r_j = upper if a_j < 0,  else between
/// whose accelerations are unique (Gauss's principle), solved by trial of every assignment.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <span>
#include <vector>

namespace esmc::host {

/// Values of the guards of modes; the modes hold while none is negative.
template <std::size_t capacity>
struct GuardValues {
  std::array<double, capacity> value{};
  std::size_t count = 0;
  [[nodiscard]] double least() const {
    double out = std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i < count; ++i) out = std::min(out, value[i]);
    return out;
  }
};

/// The joints held by friction or stops. Under their reactions r, N m, lower <= r <= upper, the joints have
/// the accelerations  free + sum of by[k] r[k],  rad/s2. Two independent ones hold the mechanism.
template <class Joints>
struct HeldJoints {
  static constexpr std::size_t joints = std::tuple_size_v<Joints>;
  static constexpr double inf = std::numeric_limits<double>::infinity();

  Joints free{};
  std::array<Joints, joints> by{};
  std::array<double, joints> lower{}, upper{};

  void add(std::size_t joint) { rows_[count_++] = joint; }  ///< in ascending order
  [[nodiscard]] std::span<const std::size_t> held() const { return std::span(rows_).first(count_); }

  /// What is left, N m, until the held joints give way. One: of its reaction. Two and more (reactions may be
  /// indeterminate): the loads that they can hold are a polygon, one pair of edges per held joint (a sum of
  /// segments); this is the distance to the nearest edge. `rounding`: of a reaction, relative.
  [[nodiscard]] double reserve(double rounding) const {
    if (count_ > 1) return polygon_reserve(rounding);
    const std::size_t j = rows_[0];
    const double r = -free[j] / by[j][j];
    return std::min(upper[j] - r, r - lower[j]) + rounding * slack(j);
  }

  /// The direction in which each held joint gives way, 0: it stays. The assignment that violates its
  /// conditions least is the solution, unique in its accelerations.
  [[nodiscard]] std::array<int, joints> directions(double rounding) const {
    double scale = 0.0;
    for (const double a : free) scale = std::max(scale, std::abs(a));
    std::size_t patterns = 1;
    for (std::size_t i = 0; i < count_; ++i) patterns *= 3;
    double least = inf;
    std::array<int, joints> chosen{};
    for (std::size_t p = 0; p < patterns; ++p) {
      std::array<int, joints> way{};
      std::size_t rest = p;
      for (const std::size_t j : held()) {
        way[j] = static_cast<int>(rest % 3) == 2 ? -1 : static_cast<int>(rest % 3);
        rest /= 3;
      }
      const double wrong = violation(way, rounding);
      if (wrong >= least - 1e-15 * scale) continue;
      least = wrong;
      chosen = way;
    }
    return chosen;
  }

 private:
  /// Size of a reaction, N m, for its rounding.
  [[nodiscard]] double slack(std::size_t j) const {
    const auto finite = [](double v) { return std::isfinite(v) ? std::abs(v) : 0.0; };
    return finite(lower[j]) + finite(upper[j]) + 1e-3;
  }
  [[nodiscard]] double polygon_reserve(double rounding) const {
    std::size_t p = 0, q = 1;  // the best pair of joints for coordinates
    double best = 0.0;
    for (const std::size_t i : held()) {
      for (const std::size_t k : held()) {
        const double minor = std::abs(by[i][i] * by[k][k] - by[i][k] * by[k][i]);
        if (i < k && minor > best) best = minor, p = i, q = k;
      }
    }
    double least = 1e3;
    for (const std::size_t e : held()) {
      for (const double sign : {-1.0, 1.0}) {
        const double nx = -sign * by[e][q], ny = sign * by[e][p];
        double reach = nx * free[p] + ny * free[q], scale = 0.0;  // less the load -free
        double rounded = 0.0;
        for (const std::size_t k : held()) {
          if (k == e) continue;
          const double along = nx * by[k][p] + ny * by[k][q];
          if (along != 0.0) reach += along * (along > 0.0 ? upper[k] : lower[k]);
          rounded += std::abs(along) * (rounding * slack(k));
          scale = std::max(scale, std::abs(along));
        }
        if (scale > 0.0) least = std::min(least, (reach + rounded) / scale);
      }
    }
    return least;
  }
  /// How far, rad/s2, an assignment (0: held, or its direction) is from a solution.
  [[nodiscard]] double violation(const std::array<int, joints>& way, double rounding) const {
    Joints a = free;
    std::size_t resting = 0, j = 0;
    for (const std::size_t k : held()) {
      if (way[k] == 0) {
        ++resting;
        j = k;
        continue;
      }
      const double r = way[k] > 0 ? lower[k] : upper[k];
      if (!std::isfinite(r)) return inf;
      for (std::size_t i = 0; i < joints; ++i) a[i] += r * by[k][i];
    }
    if (resting > 1) return resting < count_ ? inf : std::max(0.0, -polygon_reserve(rounding)) * by[j][j];
    double wrong = 0.0;
    if (resting == 1) {
      const double r = -a[j] / by[j][j];
      wrong = std::max({0.0, r - upper[j], lower[j] - r}) * by[j][j];
      for (std::size_t i = 0; i < joints; ++i) a[i] += r * by[j][i];
    }
    for (const std::size_t k : held()) wrong = std::max(wrong, -way[k] * a[k]);
    return wrong;
  }

  std::array<std::size_t, joints> rows_{};
  std::size_t count_ = 0;
};

/// A rigid stop that is touched: the joint may turn towards it with at most -rebound, rad/s.
template <class Angles>
struct StopImpact {
  std::size_t joint;
  int side;
  double rebound;
  Angles by;  ///< what a unit impulse at the joint adds to the rates of the bars
};

/// Adds the impulses of the stops to the bars' rates `after`. `before`: rates of the joints. Returns the
/// work, J.
template <class Plant>
double push_back(const std::vector<StopImpact<typename Plant::Angles>>& rows,
                 const typename Plant::Joints& before, typename Plant::Angles& after) {
  const auto start = after;
  double least = std::numeric_limits<double>::infinity(), work = 0.0;
  for (unsigned active = 0; active < 1U << rows.size(); ++active) {
    std::array<double, 4> p{};
    auto rate = start;
    const auto w = [&](std::size_t i) {
      return rows[i].side * Plant::joint_rates(rate)[rows[i].joint] + rows[i].rebound;  // <= 0 is allowed
    };
    for (int sweep = 0; sweep < 200; ++sweep) {  // both at once, by relaxation; one needs one sweep
      for (std::size_t i = 0; i < rows.size(); ++i) {
        if ((active >> i & 1U) == 0) continue;
        const double d = -w(i) / (rows[i].side * Plant::joint_rates(rows[i].by)[rows[i].joint]);
        p[i] += d;
        for (std::size_t k = 0; k < rate.size(); ++k) rate[k] += d * rows[i].by[k];
      }
    }
    double wrong = 0.0, done = 0.0;
    const auto now = Plant::joint_rates(rate);
    for (std::size_t i = 0; i < rows.size(); ++i) {
      wrong = std::max({wrong, w(i), rows[i].side * p[i] > 0.0 ? std::abs(p[i]) : 0.0});
      done += 0.5 * p[i] * (before[rows[i].joint] + now[rows[i].joint]);
    }
    if (wrong >= least) continue;
    least = wrong;
    after = rate;
    work = done;
  }
  return work;
}

}  // namespace esmc::host
