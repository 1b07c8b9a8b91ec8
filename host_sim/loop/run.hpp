#pragma once
/// The run commands. Each returns the exit status, 1 for a run that ended in a fault, and throws InputError
/// and RunError.

#include <string>

#include "host_sim/bus/host_bus.hpp"
#include "host_sim/record/run_options.hpp"

namespace esmc::host {

struct Scene;

int run_sim(const RunOptions& o);
int run_hil(const RunOptions& o);
int run_plant(const RunOptions& o);
int run_controller(const RunOptions& o);
/// `esmc hil --realtime`, for a scene that may run on o.bus.
int run_hil_realtime(const Scene& scene, const RunOptions& o);
/// `esmc controller --observe`: prints what the controller sees of the drives, for scene.duration s of wall
/// time or until Ctrl-C, and sends no frame. Throws RunError where a drive is silent at the end.
int run_observe(const Scene& scene, const RunOptions& o, HostBus& bus);

/// Why effects of the bus are refused outside the virtual bus.
inline constexpr const char* no_effects_on_interface = "a CAN interface is not ours to disturb";

struct ReplayOptions {
  std::string directory;
  bool any_version = false;  ///< the recording may be of another version of this program
  bool json = false;
};
/// `esmc replay`: repeats a recorded run and compares. Returns 1 where a value differs.
int run_replay(const ReplayOptions& o);

}  // namespace esmc::host
