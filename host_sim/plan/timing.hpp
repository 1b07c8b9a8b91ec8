#pragma once
/// Timing along a path: the largest speed at every point that all limits allow, from rest to rest.
///
/// With x the square of the path's speed and u its acceleration, dx/ds = 2 u, and a limit is a row
/// low <= a u + b x + d sqrt(x) <= high. On a grid u is constant between points. Backwards from the end the
/// speeds are found from which the end can still be reached (a linear program of two variables per point),
/// forwards the largest u that stays among them: no switch point is searched for, and zero inertia (a = 0) is
/// a row like any other. Both ends and the middle of an interval meet their rows, with the slope of u that
/// the solution before had: the error falls with the square of the grid.

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

namespace esmc::host::plan {

enum class LimitKind : std::uint8_t { torque, joint_speed, speed, acceleration, jerk, count };

/// Largest share of a limit along the program, and the share of the time of motion at the limit.
struct Use {
  double share = 0.0, active = 0.0;
};

/// Per kind, and per motor or joint.
inline constexpr auto kinds = static_cast<std::size_t>(LimitKind::count);
using Uses = std::array<std::array<Use, 4>, kinds>;

inline constexpr double unlimited = 1e300;

/// low <= a u + b x + d sqrt(x) <= high.
struct Row {
  double a = 0.0, b = 0.0, d = 0.0, low = -unlimited, high = unlimited;
  LimitKind kind = LimitKind::torque;
};

/// Limits along a path: at its points, and in the middle between every two.
struct Grid {
  std::vector<double> s;           ///< points, ascending
  std::vector<Row> rows;           ///< place by place: point 0, middle after it, point 1, and so on
  std::vector<std::size_t> first;  ///< row of each place, and one more: their number
  double enough = 1e-9;            ///< change of the time, as a share of it, with which iterations end
};

/// x at every point, 0 at both ends; and the slope of u by s between every two points.
struct Squares {
  std::vector<double> x, slope;
  [[nodiscard]] bool empty() const { return x.empty(); }
};

/// The largest x, point by point: nothing where there is none. `start`: of rows that differ little, or empty.
/// Sets `blocked` to the index of a point that no speed passes, where it fails.
[[nodiscard]] std::optional<Squares> fastest(const Grid& grid, const Squares& start, std::size_t& blocked,
                                             bool rough = false);

/// The largest x, place by place, for which the rows there leave some u: the limit curve of the speed.
/// Viscous rows by tangents, so that it is a little low where they rule.
[[nodiscard]] std::vector<double> speed_limits(const Grid& grid);

/// Position on the path as a function of time, from rest to rest.
class Timing {
 public:
  struct State {
    double s = 0.0, rate = 0.0, acceleration = 0.0;
  };
  Timing() = default;
  /// Of x on a grid: acceleration is linear in time between its points.
  Timing(const std::vector<double>& s, const Squares& of);
  /// Quintic over `duration`, s > 0.
  [[nodiscard]] static Timing quintic(double length, double duration);

  /// The mean of this timing over `window`, s >= 0: acceleration then does not jump, and its slope is at most
  /// its span divided by the window.
  void smooth(double window) { window_ = window; }
  /// All times become `factor` times as long.
  void stretch(double factor) { stretch_ *= factor; }

  [[nodiscard]] double duration() const { return stretch_ * (raw_duration() + window_); }  ///< s
  /// State at a time, clamped to [0, duration]. Where acceleration jumps, that after it, or `before` it.
  [[nodiscard]] State at(double time, bool before = false) const;
  /// The part of the path, from s to s, whose accelerations make that of a time: more than a point if
  /// smoothed.
  [[nodiscard]] std::pair<double, double> span(double time) const;
  /// Ascending times from 0 to the end, between which acceleration is smooth.
  [[nodiscard]] std::vector<double> breaks() const;
  /// First time at which the path is at s or beyond.
  [[nodiscard]] double time_of(double s) const;

 private:
  [[nodiscard]] double raw_duration() const { return t_.empty() ? 0.0 : t_.back(); }
  [[nodiscard]] State raw(double time, bool before) const;
  /// Integral of raw s, from 0 to a time that may lie outside.
  [[nodiscard]] double integral(double time) const;
  [[nodiscard]] std::size_t cell(double time, bool before) const;

  // Of points; a_, j_: acceleration at the begin of a cell and its slope by time; sum_: integral of s.
  std::vector<double> t_, s_, v_, a_, j_, sum_;
  double window_ = 0.0, stretch_ = 1.0;
  bool quintic_ = false;
  mutable std::size_t last_ = 0;  // cell that was asked for last
};

}  // namespace esmc::host::plan
