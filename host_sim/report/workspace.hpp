#pragma once
/// The map of a mechanism's workspace, for the page of a run, and the geometry that pages draw.

#include <array>
#include <nlohmann/json_fwd.hpp>
#include <vector>

#include "host_sim/plant/plant.hpp"

namespace esmc::host {

/// A motor: the joint it drives (theta11, theta12, theta21, theta22; RR: theta1, theta2) and its limit, N m.
struct MotorLimit {
  std::size_t joint = 0;
  double torque = 0.0;
};

/// Where a mechanism can be, where it is singular, and what its motors can do there.
struct WorkspaceMap {
  using Path = std::vector<V2>;

  double x0 = 0, x1 = 0, y0 = 0, y1 = 0;  ///< corners of the grid, m
  int columns = 0, rows = 0;  ///< nodes of the grid; a node is at x0 + (x1 - x0) column / (columns - 1)
  /// Row by row from y0, NaN out of reach: the largest force (N) that the motors can exert on the world in
  /// every direction, beside holding the mechanism at rest. Below 0: they cannot hold it. Empty without
  /// motors.
  std::vector<double> force;
  /// sin(phi12 + phi22) at the same nodes, whose sign is the assembly mode; empty for RR.
  std::vector<double> type2_sine;
  std::vector<Path> type1, type2;  ///< loci: sin theta_j2 = 0, and sin(phi12 + phi22) = 0
};

/// Map of a five-bar in the working mode `bend` (signs of sin theta_j2). `nodes` along the longer side, >= 2.
/// Without rows and columns where the legs cannot meet.
[[nodiscard]] WorkspaceMap workspace_map(const FiveBarParams<double>& m, const std::array<int, 2>& bend,
                                         const std::vector<MotorLimit>& motors, int nodes);
/// Map of the RR arm; `bend`: sign of sin theta2.
[[nodiscard]] WorkspaceMap workspace_map(const RrParams<double>& m, int bend,
                                         const std::vector<MotorLimit>& motors, int nodes);

/// The geometry that mechanism.js draws; RR: legs[0].
[[nodiscard]] nlohmann::ordered_json mechanism_json(const FiveBarParams<double>& m, bool five_bar);

}  // namespace esmc::host
