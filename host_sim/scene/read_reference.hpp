#pragma once
/// [reference] of a scene, and the file of points that it may name.

#include "host_sim/scene/reader.hpp"
#include "host_sim/scene/scene.hpp"

namespace esmc::host {

/// Throws InputError.
void read_reference(Section s, Scene& scene);

}  // namespace esmc::host
