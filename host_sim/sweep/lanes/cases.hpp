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
};

/// The rows of a reference at all ticks, for every group of lanes that follows it.
struct SharedTrack {
  std::shared_ptr<const ReferenceBundle<double>> of;
  double tick = 0.0;  ///< s
  std::vector<double> rows;
};

/// False where the scene has a part that lanes do not cover, as effects, joining, a ramp or a sign test.
/// `wanted`: objectives; a `bundle` that `out` has is kept where that of the scene has the same numbers. Sets
/// all of `out` but the index. Throws InputError where robust gains are refused.
[[nodiscard]] bool make_lane_job(const Scene& scene, const std::vector<Objective>& wanted, LaneJob& out);

/// Lets a group of jobs with one bundle follow `track`, computed where it is not yet that of the bundle; it
/// must live as long as they run. Without one bundle each lane follows its own.
void share_reference(std::vector<LaneJob>& jobs, SharedTrack& track);

/// The same for a mechanism under given torques of `ticks` ticks, N m, which the caller adds to `out.numbers`
/// with the place of the states.
[[nodiscard]] bool make_driven_job(const Scene& scene, std::uint32_t ticks, std::uint32_t every,
                                   LaneJob& out);

/// Runs jobs of equal settings, 1 to kernel.lanes of them. `out[i].ok` = false: job i is to be run alone, or
/// stop_requested() came in between.
void run_lane_jobs(const LaneKernel& kernel, const std::vector<LaneJob>& jobs, std::vector<LaneScore>& out);

/// Whether an objective of `wanted` is an error of the base joints.
[[nodiscard]] bool wants_base_errors(const std::vector<Objective>& wanted);

}  // namespace esmc::host
