#pragma once
/// Plants from the intervals of [uncertainty], to simulate; and whether the scene's own plant is one.

#include <cstdint>
#include <string>
#include <vector>

#include "host_sim/scene/scene.hpp"

namespace esmc::host {

/// The scene, which must have [uncertainty], with plant `index` in place of its own. An even index draws a
/// corner of all intervals, an odd one a point between. Friction and payload are drawn too and replace those
/// effects; the controller's belief stays. Delays are at least those that the controller assumes: of the
/// torque as compute_delay; of measurements, whole ticks as delay, unless there is an encoder or noise.
/// `lengths`: draws l1, l2 and half_base too. Depends on its arguments only.
Scene sampled_plant(const Scene& scene, std::uint64_t seed, std::uint64_t index, bool lengths);

/// Parameters of the scene's own mechanism and effects outside [uncertainty], one phrase each; not_covered:
/// effects that the guarantee of a design does not cover, all but delays that the controller assumes.
std::vector<std::string> outside(const Scene& scene);
std::vector<std::string> not_covered(const Scene& scene);

}  // namespace esmc::host
