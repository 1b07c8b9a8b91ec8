#pragma once
/// Readers of a scene's sections, in the order in which read_scene_table calls them: each needs the sections
/// before it. All throw InputError.

#include <optional>
#include <vector>

#include "host_sim/scene/reader.hpp"
#include "host_sim/scene/scene.hpp"

namespace esmc::host {

UncertaintyScene read_uncertainty(Section s, const Scene& scene);
void read_reference(Section s, Scene& scene);
void read_drives(Section s, Scene& scene);
/// Passive encoders of a five-bar with two motors, which follow the motors in the lists of nodes. `given` is
/// [sensors], `root` its table.
void read_sensors(const std::optional<Section>& given, Section& root, Scene& scene);
CommandScene read_command(Section s, const Scene& scene);
std::vector<Effect> read_effects(Section& root, const Scene& scene);

}  // namespace esmc::host
