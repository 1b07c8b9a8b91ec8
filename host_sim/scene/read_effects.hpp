#pragma once
/// The [[effects]] of a scene.

#include "host_sim/scene/reader.hpp"
#include "host_sim/scene/scene.hpp"

namespace esmc::host {

/// Mechanism and motors of the scene must have been read. Throws InputError.
std::vector<Effect> read_effects(Section& root, const Scene& scene);
/// Throws InputError where a scene names effects that need a bus which is not there: `why`, "esmc sim has no
/// bus".
void refuse_bus_effects(const Scene& scene, const std::string& why);

}  // namespace esmc::host
