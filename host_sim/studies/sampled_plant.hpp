#pragma once
/// Plants out of the intervals of [uncertainty], to be simulated; and whether a scene's own plant is one of
/// them.

#include <cstdint>
#include <string>
#include <vector>

#include "host_sim/scene/scene.hpp"

namespace esmc::host {

/// The scene with plant `index` instead of its own: every second one at a corner of all intervals, the others
/// anywhere between. Delays that the controller is told are in it, where the scene has no longer ones: the
/// torque's as compute_delay; of what is measured whole ticks as delay, where no encoder or noise brings an
/// observer of its own. What the controller believes stays. `lengths`: with the tolerances of l1, l2,
/// half_base as well. A function of its arguments.
Scene sampled_plant(const Scene& scene, std::uint64_t seed, std::uint64_t index, bool lengths);

/// What of the scene's own mechanism and effects lies outside [uncertainty], one phrase each; and what the
/// promise of a design knows nothing of. A delay that is told, or part of it, it knows.
std::vector<std::string> outside(const Scene& scene);
std::vector<std::string> not_covered(const Scene& scene);

}  // namespace esmc::host
