#pragma once
/// Plants from the intervals of [uncertainty], to simulate; and whether the scene's own plant is one.

#include <cstdint>
#include <string>
#include <vector>

#include "host_sim/scene/scene.hpp"

namespace esmc::host {

/// The scene with plant `index` in place of its own: even ones at a corner of all intervals, the others
/// anywhere between. It has the delays that the controller assumes, where the scene has no longer ones: of
/// the torque as compute_delay; of measurements, whole ticks as delay, unless encoder or noise has an
/// observer. The controller's belief stays. `lengths`: with the tolerances of l1, l2, half_base too. Depends
/// on its arguments only.
Scene sampled_plant(const Scene& scene, std::uint64_t seed, std::uint64_t index, bool lengths);

/// Parameters of the scene's own mechanism and effects outside [uncertainty], one phrase each; and effects
/// that the guarantee of a design does not cover: all but delays that the controller assumes.
std::vector<std::string> outside(const Scene& scene);
std::vector<std::string> not_covered(const Scene& scene);

}  // namespace esmc::host
