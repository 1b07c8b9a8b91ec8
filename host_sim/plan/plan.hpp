#pragma once
/// From the moves of a program to a table of quintics that the firmware follows, timed within all limits.

#include <cstdint>
#include <vector>

#include "host_sim/plan/problem.hpp"
#include "host_sim/plan/timing.hpp"

namespace esmc::host::plan {

struct Plan {
  std::vector<PathSegment<double>> path;  ///< effector, m; at rest between and after them
  std::uint32_t ticks = 0;                ///< length of a round, rounded up
  double duration = 0.0;                  ///< s
  double bound = 0.0;      ///< s: along the same path with no limit but the motors' torque, and the dwells
  double deviation = 0.0;  ///< m: largest of all corners
  std::vector<Vec2<double>> from, from_base;  ///< where each move begins, m and rad; and the end of the last
  /// Time, s, and the largest speed of the effector, m/s, that the limits allow there at some acceleration:
  /// asked for with `bound`.
  std::vector<std::pair<double, double>> limit_curve;
  std::vector<double> end;  ///< s, when each move has ended; a blend is halved
  Uses use{};               ///< per kind, and per motor or joint; effector: the first
};

/// Plans a program. Throws Refused.
template <class M>
[[nodiscard]] Plan plan(const Problem<M>& p);

}  // namespace esmc::host::plan
