#pragma once
/// [command]: the interface to a supervisor computer.

#include "host_sim/scene/reader.hpp"
#include "host_sim/scene/scene.hpp"

namespace esmc::host {

/// Identifiers that the drives of a scene use or listen to, in either direction.
std::vector<std::uint32_t> drive_identifiers(const Scene& scene);

/// Mechanism, control, limits and drives of the scene must have been read. Throws InputError.
CommandScene read_command(Section s, const Scene& scene);

}  // namespace esmc::host
