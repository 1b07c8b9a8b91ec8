#pragma once
/// [drives] and [sensors]: the axes on the bus.

#include "host_sim/scene/reader.hpp"
#include "host_sim/scene/scene.hpp"

namespace esmc::host {

/// Mechanism, control and limits of the scene must have been read. Throws InputError.
void read_drives(Section s, Scene& scene);
/// Passive encoders of a five-bar with two motors follow the motors in the lists of nodes. [drives] must have
/// been read; `given` is [sensors], `root` the table that it stands in. Throws InputError.
void read_sensors(const std::optional<Section>& given, Section& root, Scene& scene);

}  // namespace esmc::host
