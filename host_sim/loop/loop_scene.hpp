#pragma once
/// What a scene needs before its loop may run on a bus.

#include <string>

#include "hal/can.hpp"
#include "host_sim/record/run_options.hpp"
#include "host_sim/scene/scene.hpp"

namespace esmc::host {

/// Why a scene that `esmc sim` runs cannot run on a bus; `what` empty: it can.
struct BusObstacle {
  std::string where, what;
};
BusObstacle bus_obstacle(const Scene& scene);  ///< the first one
/// Throws InputError where there is an obstacle.
void require_bus_loop(const Scene& scene);
/// Settings that decide over torque and cannot be read back from these drives, in one line.
std::string to_confirm(const Scene& scene);
/// Throws InputError with to_confirm() where the scene must confirm those settings and does not.
void require_confirmed(const Scene& scene);
/// Reads the scene of a command that uses a bus. Throws InputError, for a scene with an obstacle as well.
Scene read_loop_scene(const RunOptions& o);
/// Throws RunError if `f` announces a controller with this command.base_id that was made from another scene.
void require_same_scene(const Scene& scene, const hal::CanFrame& f);
/// Time, s (in lockstep: virtual), until the plant's end reports that its drives are not armed: more than
/// the controller takes to report it, and more again where a supervisor computer arms.
[[nodiscard]] double arming_time_max(const Scene& scene);

}  // namespace esmc::host
