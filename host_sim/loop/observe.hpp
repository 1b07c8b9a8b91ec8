#pragma once
#include "host_sim/bus/host_bus.hpp"
#include "host_sim/record/run_options.hpp"
#include "host_sim/scene/scene.hpp"

namespace esmc::host {

/// `esmc controller --observe`: what the controller sees of the drives, for scene.duration s of wall time or
/// until Ctrl-C, without a frame sent. Returns 1 where a drive was silent at the end.
int run_observe(const Scene& scene, const RunOptions& o, HostBus& bus);

}  // namespace esmc::host
