#pragma once
/// Readers of a scene's sections, in the order of their calls: each needs those before. All throw InputError.

#include <optional>

#include "host_sim/scene/reader.hpp"
#include "host_sim/scene/scene.hpp"

namespace esmc::host {

void read_uncertainty(Section s, Scene& scene);
void read_reference(Section s, Scene& scene);
void read_drives(Section s, Scene& scene);
/// Passive encoders, which follow the motors in the lists of nodes. `given` is [sensors], `root` its table.
void read_sensors(const std::optional<Section>& given, Section& root, Scene& scene);
void read_command(Section s, Scene& scene);
void read_effects(Section& root, Scene& scene);

}  // namespace esmc::host
