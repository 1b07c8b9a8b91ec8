#pragma once
/// Kinematics for setting up and judging a scene, by the law of cosines in angles; independent of firmware/.

#include <array>
#include <optional>

#include "host_sim/plant/plant.hpp"

namespace esmc::host {

/// Joint angles (theta1, theta2), rad, of a leg with its tip at p in its own frame, m; `bend` = sign of sin
/// theta2. Empty: out of reach.
std::optional<std::array<double, 2>> reach(const LegParams<double>& leg, V2 p, int bend);

/// All joint angles, rad, of a five-bar with its effector at p, m; `bend` per leg. Empty: out of reach.
std::optional<std::array<double, 4>> reach(const FiveBarParams<double>& m, V2 p,
                                           const std::array<int, 2>& bend);

/// All four joint angles from the base joints, rad; `assembly` = sign of sin(phi12 + phi22), +1 or -1. Empty:
/// the legs cannot be closed.
std::optional<std::array<double, 4>> close(const FiveBarParams<double>& m, const std::array<double, 2>& base,
                                           int assembly);

/// Joint rates, rad/s, of a leg whose tip moves with v, m/s, in the leg's frame; not finite at type 1.
std::array<double, 2> joint_rates(const LegParams<double>& leg, const std::array<double, 2>& theta, V2 v);

/// Tip of a leg in its own frame, m.
V2 leg_tip(const LegParams<double>& leg, const std::array<double, 2>& theta);

/// sin(phi12 + phi22): 0 at type 2.
double type2_sine(const std::array<double, 4>& theta);

}  // namespace esmc::host
