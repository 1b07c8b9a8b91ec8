#pragma once
/// What a batch of five-bars costs without generality: a yardstick for the lanes of host_sim/sweep/lanes.

#include <array>

#include "host_sim/sweep/lanes/kernel.hpp"

namespace esmc::bench {

inline constexpr int batch_lanes = 8;
/// Sum of the squared errors of the effector at all ticks, m2, per lane.
using BatchScore = std::array<double, batch_lanes>;

/// Eight closed loops of ESMC side by side, as run_lane_jobs runs them: the same plant, law, reference and
/// RK4 as straight-line code with fused multiply-add. Left out: guards, supervisor, limits but the torque's,
/// restoring the closure, statistics but one sum, the bits of a single run. Needs AVX-512.
void batch_yardstick(const host::LaneSettings& settings, const host::LaneCase* cases, BatchScore& out);
/// The same without fused multiply-add, the closure restored after each step.
void batch_rounded(const host::LaneSettings& settings, const host::LaneCase* cases, BatchScore& out);

}  // namespace esmc::bench
