#pragma once
/// The true mechanism of a scene in the formats of other programs.

#include <string>

#include "host_sim/scene/scene.hpp"

namespace esmc::host {

/// MuJoCo's MJCF, with the loop of the five-bar closed. Joint values are the scene's angles, the start is the
/// keyframe `start`. Throws InputError for a bar without mass or inertia, which MuJoCo cannot take.
std::string mjcf(const Scene& scene);

/// URDF: a tree. The joint between the distal bars of the five-bar is cut, and a comment says where. Throws
/// InputError as mjcf does: readers refuse or drop such links.
std::string urdf(const Scene& scene);

}  // namespace esmc::host
