#include <fmt/format.h>

#include <chrono>
#include <memory>

#include "host_sim/commands/finish.hpp"
#include "host_sim/commands/halves.hpp"
#include "host_sim/commands/realtime.hpp"

namespace esmc::host {
namespace {

/// Both halves in one process, in lockstep: publish, tick, collect, advance.
template <class World, class PlantBus, class ControlBus>
int run_lockstep(const Scene& scene, const RunOptions& o, PlantBus& plant_bus, ControlBus& control_bus,
                 const std::string& interface) {
  OutputDirectory out(o.out);
  FrameLog frames(out.path("frames.log"), interface, static_cast<std::uint32_t>(scene.bitrate));
  PlantHalf<World, PlantBus> plant(scene, o, plant_bus, frames, out.path("log.csv"), true);
  ControllerHalf<World, ControlBus> controller(scene, Pacing::lockstep, control_bus);
  const auto begin = std::chrono::steady_clock::now();
  bool stop = false;
  Progress progress(tick_count(scene));
  while (!plant.finished() && !stop) {
    progress.at(plant.done());
    stop = stop_requested();
    if (stop) controller.stop();
    plant.publish();
    controller.await_set();
    controller.tick(true);
    if (controller.supervisor().state() == State::fault && !plant.released()) {
      throw RunError(fmt::format("the controller refused to arm: {}", name(controller.supervisor().fault())));
    }
    plant.await_torques();
    plant.advance(controller.view());
  }
  RunEnd end = plant.end(begin);
  end.interrupted = stop;
  end.final_state = name(controller.supervisor().state());
  end.faults.clear();
  if (controller.supervisor().fault() != Fault::none)
    end.faults.emplace_back(name(controller.supervisor().fault()));
  controller.shut_down();
  plant.drain();
  frames.close();
  return finish_run(o, scene, "hil", plant.recorder().statistics(), end, plant.recorder().log(), out);
}

template <class World>
int run_hil(const Scene& scene, const RunOptions& o) {
  require_reachable<World>(scene, o.realtime ? Pacing::realtime : Pacing::lockstep);
  if (o.realtime) return run_hil_realtime<World>(scene, o);
  if (o.bus == "virtual") {
    const auto bus = std::make_unique<hal::VirtualBus<2>>();
    return run_lockstep<World>(scene, o, bus->port(0), bus->port(1), "virtual");
  }
  const std::string interface = socketcan_interface(o.bus);
  hal::SocketCan plant_bus = open_socketcan(interface), control_bus = open_socketcan(interface);
  return run_lockstep<World>(scene, o, plant_bus, control_bus, interface);
}

}  // namespace

int run_hil(const RunOptions& o) {
  const Scene scene = read_loop_scene(o);
  return scene.type == MechanismType::five_bar ? run_hil<FiveBarWorld>(scene, o) : run_hil<RrWorld>(scene, o);
}

}  // namespace esmc::host
