#pragma once
/// Plants out of the intervals of [uncertainty], to be simulated; and whether a scene's own plant is one of
/// them.

#include <cstdint>
#include <string>
#include <vector>

#include "host_sim/scene/scene.hpp"

namespace esmc::host {

/// The scene with plant `index` instead of its own: every second one at a corner of all intervals, the others
/// anywhere between. What the controller believes stays. `lengths`: with the tolerances of l1, l2, half_base
/// as well. A function of its arguments.
Scene sampled_plant(const Scene& scene, std::uint64_t seed, std::uint64_t index, bool lengths);

/// What of the scene's own mechanism and effects lies outside [uncertainty], one phrase each; and what the
/// promise of a design knows nothing of.
std::vector<std::string> outside(const Scene& scene);
std::vector<std::string> not_covered(const Scene& scene);

}  // namespace esmc::host
