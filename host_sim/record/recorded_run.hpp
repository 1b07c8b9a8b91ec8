#pragma once
/// A run that was recorded: its log and the scene it is of.

#include <string>

#include "host_sim/record/table.hpp"
#include "host_sim/scene/scene.hpp"

namespace esmc::host {

struct RecordedRun {
  std::string log, scene_file;
  Scene scene;
};

/// `log`: a directory of `esmc sim|hil|controller --out`, or a log.csv. `scene` empty: the scene.toml beside
/// it. Throws InputError.
RecordedRun open_run(const std::string& log, const std::string& scene);

/// "theta11", ...: the joints of a mechanism, in the order of the model.
std::vector<std::string> joint_names(MechanismType type);

}  // namespace esmc::host
