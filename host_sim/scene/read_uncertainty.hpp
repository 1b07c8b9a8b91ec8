#pragma once
/// [uncertainty] of a scene.

#include "host_sim/scene/reader.hpp"
#include "host_sim/scene/scene.hpp"

namespace esmc::host {

/// The mechanism of the scene must have been read. Throws InputError.
UncertaintyScene read_uncertainty(Section s, const Scene& scene);

}  // namespace esmc::host
