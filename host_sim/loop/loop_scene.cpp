#include "host_sim/loop/run.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <limits>

#include "host_sim/controller/axes_config.hpp"
#include "host_sim/controller/bake.hpp"
#include "host_sim/error.hpp"

namespace esmc::host {

BusObstacle bus_obstacle(const Scene& scene, bool with_accuracy) {
  if (!scene.closed_loop()) {
    return {scene.control_where,
            "'control.law' = open_loop and none run in esmc sim only: there is no controller"};
  }
  if (scene.accuracy && !with_accuracy) return {scene.simulation_where, no_accuracy_on_bus};
  const bool on_command = scene.drives.protocol == Protocol::mit || scene.drives.protocol == Protocol::moteus;
  if (on_command && scene.all_sensors && !scene.all_motors) {
    return {scene.control_where,
            "passive encoders (control.sensors = \"all\" with two motors) need 'drives.protocol' = odrive or "
            "odrive_0.5: a drive in MIT mode or a moteus speaks only when it is commanded"};
  }
  if (scene.odrive() && std::ranges::find(scene.drives.nodes, 0) != scene.drives.nodes.end()) {
    return {scene.drives.where,
            "'drives.nodes' must be 1 or more on a bus: command 0 of node 0 has the identifier of CANopen's "
            "NMT, and a "
            "drive without a number of its own may be 0"};
  }
  return {scene.control_where, scene.drives.missing};
}

double arming_time_max(const Scene& s, bool realtime) {
  if (!armed_by_link(s)) return enabling_time_max(s) + 1.0;
  return realtime ? std::numeric_limits<double>::infinity() : 60.0;
}

std::string to_confirm(const Scene& scene) {
  const DriveScene& d = scene.drives;
  std::string out;
  const auto list = [&](const char* what) { out += (out.empty() ? "" : "; ") + std::string(what); };
  switch (d.protocol) {
    case Protocol::odrive:
    case Protocol::odrive_0_5: {
      const auto unread = [&](OdriveValue v) { return !d.endpoints || !d.endpoints->has(v); };
      const bool constant = d.torque_constant.empty();
      if (d.protocol == Protocol::odrive_0_5)
        list("control_mode is torque and input_mode passthrough, as stored");
      if (unread(OdriveValue::enable_watchdog) || unread(OdriveValue::watchdog_timeout))
        list("enable_watchdog, and watchdog_timeout as in drives.watchdog_timeout");
      if (unread(OdriveValue::torque_mode_limit)) list("enable_torque_mode_vel_limit is off");
      if (unread(OdriveValue::vel_limit) || unread(OdriveValue::overspeed_error))
        list("vel_limit above limits.joint_speed at the shaft, and overspeed trips");
      if (unread(OdriveValue::torque_constant) || constant) list("torque_constant is the motor's");
      if (unread(OdriveValue::current_limit) || constant)
        list("the current limit allows control.torque_limit");
      if (unread(OdriveValue::heartbeat_period)) list("heartbeats come every 10 ms at most");
      break;
    }
    case Protocol::cia402:
      list("the unit of object 6076 is drives.rated_torque_unit");
      list(
          "object 6072, or on a drive without it the drive's own current limit, allows control.torque_limit");
      list("object 6064 counts drives.counts_per_turn per turn, and 606C is in drives.velocity_unit");
      break;
    case Protocol::mit:
      list("position_range, velocity_range and torque_range are the drives'");
      list("their time-out is drives.watchdog_timeout");
      list("their zero: the joints stay inside position_range of it");
      break;
    case Protocol::moteus:
      list("servo.max_current_A and the motor's calibration allow control.torque_limit");
      list("servopos.position_min and position_max leave the joints' range free");
      list("servo.pid_position.ki is 0");
      list("servo.timeout_mode is 0: as delivered, a drive damps after a time-out");
      break;
  }
  if (scene.hardware) {  // the wiring; of emulated drives the scene decides
    list("each of drives.nodes moves the joint that it is listed for");
    if (d.zero == Zero::absolute) list("the encoders are absolute, with drives.offset");
  }
  return out;
}

void require_confirmed(const Scene& scene) {
  const std::string open = to_confirm(scene);
  if (open.empty() || scene.drives.confirmed.value_or(!scene.hardware)) return;
  throw InputError(scene.drives.where,
                   "'drives.confirmed' must be true before these drives are armed; set it after checking "
                   "what cannot be read back: " +
                       open);
}

Scene read_loop_scene(const RunOptions& o, bool with_accuracy) {
  Scene scene = read_scene(o.scene, o.sets);
  scene.seed = o.seed;
  const BusObstacle obstacle = bus_obstacle(scene, with_accuracy);
  if (!obstacle.what.empty()) throw InputError(obstacle.where, obstacle.what);
  if (scene.command) scene.identity = identity_of(scene, o.realtime ? Pacing::realtime : Pacing::lockstep);
  return scene;
}

void require_known_version(std::uint8_t version) {
  if (version > link::protocol_version)
    throw RunError(
        fmt::format("the controller has version {} of the command interface, this program knows {}: a later "
                    "esmc is needed",
                    version, link::protocol_version));
}

void require_same_scene(const Scene& scene, const hal::CanFrame& f) {
  if (!scene.command || scene.identity == 0) return;
  const auto other = link::decode_identity(f, static_cast<std::uint32_t>(scene.command->base_id));
  if (!other) return;
  require_known_version(other->version);
  if (other->scene == 0 || other->scene == scene.identity) return;
  // An image in lockstep may have a plant in real time beside it, for the console that arms it.
  for (const Pacing p : {Pacing::lockstep, Pacing::realtime}) {
    if (other->scene == identity_of(scene, p)) return;
  }
  throw RunError(
      fmt::format("the controller on the bus was made from another scene: it announces {:08x}, {} is {:08x}",
                  other->scene, scene.file, scene.identity));
}

}  // namespace esmc::host
