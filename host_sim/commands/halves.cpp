#include "host_sim/commands/halves.hpp"

#include <cerrno>

namespace esmc::host {

std::string socketcan_interface(const std::string& bus) {
  constexpr std::string_view prefix = "socketcan:";
  if (!bus.starts_with(prefix) || bus.size() == prefix.size()) {
    throw InputError("", "--bus " + bus + ": allowed are socketcan:INTERFACE and, for hil, virtual");
  }
  return bus.substr(prefix.size());
}

hal::SocketCan open_socketcan(const std::string& interface) {
  std::error_code error;
  hal::SocketCan bus = hal::SocketCan::open(interface, error);
  if (bus.is_open()) return bus;
  const std::string label = "--bus socketcan:" + interface + ": ";
  switch (error.value()) {
    case ENODEV:
      throw InputError("", label + "no such CAN interface (ip link show type vcan, type can)");
    case ENETDOWN:
      throw InputError("", label + "the interface is down (ip link set up " + interface + ")");
    case EAFNOSUPPORT:
    case EPROTONOSUPPORT:
      throw InputError(
          "", label + "this kernel has no CAN; --bus virtual needs none, docs/hil.md shows a way to vcan");
    default:
      throw InputError("", label + error.message());
  }
}

BusObstacle bus_obstacle(const Scene& scene) {
  if (!scene.closed_loop()) {
    return {scene.control_where,
            "'control.law' = open_loop and none run in esmc sim only: there is no controller"};
  }
  if (scene.accuracy) {
    return {scene.simulation_where,
            "'simulation.accuracy' is for esmc sim; a loop on a bus needs simulation.step"};
  }
  if (scene.drives.protocol == Protocol::mit && scene.all_sensors && !scene.all_motors) {
    return {scene.control_where,
            "passive encoders (control.sensors = \"all\" with two motors) need 'drives.protocol' = odrive or "
            "odrive_0.5: a drive in MIT mode speaks only when it is commanded"};
  }
  return {scene.control_where, scene.drives.missing};
}

Scene read_loop_scene(const RunOptions& o) {
  Scene scene = read_scene(o.scene, o.sets);
  scene.seed = o.seed;
  const BusObstacle obstacle = bus_obstacle(scene);
  if (!obstacle.what.empty()) throw InputError(obstacle.where, obstacle.what);
  return scene;
}

}  // namespace esmc::host
