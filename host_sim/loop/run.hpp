#pragma once
/// The run commands, and the conditions for a scene to run on a bus. Each command returns the exit status, 1
/// after a fault, and throws InputError and RunError.

#include <optional>
#include <string>
#include <vector>

#include "hal/can.hpp"
#include "host_sim/bus/host_bus.hpp"
#include "host_sim/drives/emulated_axis.hpp"
#include "host_sim/plant/plant.hpp"
#include "host_sim/record/run_options.hpp"
#include "host_sim/record/summary.hpp"
#include "host_sim/scene/scene.hpp"

namespace esmc::host {

int run_sim(const RunOptions& o);         ///< `esmc sim`: runs without a bus
int run_hil(const RunOptions& o);         ///< `esmc hil`: both ends, in lockstep or real time
int run_plant(const RunOptions& o);       ///< `esmc plant`: the plant's end
int run_controller(const RunOptions& o);  ///< `esmc controller`: the controller's end
/// `esmc hil --realtime`, for a scene that may run on o.bus.
int run_hil_realtime(const Scene& scene, const RunOptions& o);
/// `esmc controller --observe`: prints the drives' reports, for scene.duration s of wall time or until
/// Ctrl-C, and sends no frame. Throws RunError where a drive is silent at the end.
int run_observe(const Scene& scene, const RunOptions& o, HostBus& bus);

inline constexpr const char* no_accuracy_on_bus =
    "'simulation.accuracy' is for esmc sim, sweep and hil on the virtual bus: elsewhere simulation.step is "
    "needed";
/// Why effects of the bus are refused outside the virtual bus.
inline constexpr const char* no_effects_on_interface = "a CAN interface is not ours to disturb";

/// Options of `esmc replay`.
struct ReplayOptions {
  std::string directory;
  bool any_version = false;  ///< the recording may be of another version of this program
  bool json = false;
};
/// `esmc replay`: repeats a recorded run and compares. Returns 1 where a value differs.
int run_replay(const ReplayOptions& o);

/// Options of `esmc drive`.
struct DriveOptions {
  std::string protocol, bus;
  int node = 1;
  int bit_rate = 1'000'000;        ///< bit/s, slcan only
  std::optional<double> duration;  ///< s; else until Ctrl-C
  double rate_hz = 1000.0;         ///< of samples (odrive) and of the shaft's steps
  double watchdog = 0.1;           ///< s
  LoneShaft shaft;
  std::vector<std::string> defects;
  // mit
  std::string dialect = "mini_cheetah";
  int master_id = 0;
  double position_range = 12.5, velocity_range = 50.0, torque_range = 18.0;
  double rated_torque = 1.0;  ///< cia402, N m
  bool json = false;
};

/// Names and meanings of the defects, one per line.
std::string defects_text();
/// `esmc drive`: one emulated drive with a shaft of its own on a CAN interface, in real time.
int run_drive(const DriveOptions& o);

/// A closed loop run for a study: no files, no summary, every effector position kept.
struct Trace {
  Statistics statistics;
  RunEnd end;
  std::vector<V2> effector;     ///< m, true position at every tick of a closed loop
  std::vector<double> torque;   ///< N m as delivered, motor by motor at every tick; of probe() only
  std::vector<bool> saturated;  ///< at every tick; of probe() only
  bool reference_left = false;  ///< the reference has left the reach of the true mechanism
};

/// Runs a scene as `esmc sim` does. `single_precision`: the controller computes in float.
Trace trace(const Scene& scene, bool single_precision = false);

/// Runs a scene as `esmc sim` does and keeps the torques, for the few ticks that `esmc check` looks at.
/// `in_frames`: samples and torques in the steps of the drives' frames.
Trace probe(const Scene& scene, bool in_frames);

/// Runs a case of a sweep, without path, digest and, unless wanted, base_errors. Throws InputError where the
/// reference leaves the reach of the true mechanism, RunError where simulation.accuracy is not met; a state
/// that is not finite shows in end.q.
Trace run_case(const Scene& scene, bool base_errors, bool single_precision = false);

/// Reason why a scene of `esmc sim` cannot run on a bus: place in the file, text; `what` empty: none.
struct BusObstacle {
  std::string where, what;
};
/// The first obstacle of a scene. `with_accuracy`: simulation.accuracy is allowed.
BusObstacle bus_obstacle(const Scene& scene, bool with_accuracy = false);
/// One line: settings that affect torque and cannot be read back from the scene's drives; "": none.
std::string to_confirm(const Scene& scene);
/// Throws InputError with the text of to_confirm() where drives.confirmed must be true and is not.
void require_confirmed(const Scene& scene);
/// Reads the scene of `o` for a command that uses a bus. Throws InputError, also for a bus_obstacle().
Scene read_loop_scene(const RunOptions& o, bool with_accuracy = false);
/// Throws RunError for a version of the command interface later than link::protocol_version.
void require_known_version(std::uint8_t version);
/// Throws RunError if `f` announces a later version, or a controller with this command.base_id that was made
/// from another scene.
void require_same_scene(const Scene& scene, const hal::CanFrame& f);
/// Time, s (in lockstep: virtual), until an end reports that its drives are not armed: for the plant more
/// than the controller takes to report it. Infinite in real time where a supervisor computer arms.
[[nodiscard]] double arming_time_max(const Scene& scene, bool realtime);

}  // namespace esmc::host
