#pragma once
/// From scenes to the cases of kernel.hpp.

#include <memory>

#include "host_sim/controller/controller_config.hpp"
#include "host_sim/scene/scene.hpp"
#include "host_sim/sweep/lanes/kernel.hpp"
#include "host_sim/sweep/spec.hpp"

namespace esmc::host {

/// A scene in a lane.
struct LaneJob {
  std::uint64_t index = 0;
  LaneSettings settings;
  LaneCase numbers;
  std::shared_ptr<const ReferenceBundle<double>> bundle;
  std::shared_ptr<const std::vector<double>> track;
};

/// False where the scene has a part that lanes do not cover, as effects, joining, a ramp or a sign test.
/// `wanted`: objectives; `one_reference`: no key of [reference] varies, and bundle and track that `out` has
/// are used again. Sets all of `out` but the index. Throws InputError where robust gains are refused.
[[nodiscard]] bool make_lane_job(const Scene& scene, const std::vector<Objective>& wanted, bool one_reference,
                                 LaneJob& out);

/// The same for a mechanism under given torques of `ticks` ticks, N m, which the caller adds to `out.numbers`
/// with the place of the states.
[[nodiscard]] bool make_driven_job(const Scene& scene, std::uint32_t ticks, std::uint32_t every,
                                   LaneJob& out);

/// Runs jobs of equal settings, 1 to kernel.lanes of them. `out[i].ok` = false: job i is to be run alone.
void run_lane_jobs(const LaneKernel& kernel, const std::vector<LaneJob>& jobs, std::vector<LaneScore>& out);

/// Whether an objective of `wanted` is an error of the base joints.
[[nodiscard]] bool wants_base_errors(const std::vector<Objective>& wanted);

}  // namespace esmc::host
