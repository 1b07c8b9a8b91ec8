#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <memory>

#include "host_sim/bus/open_bus.hpp"
#include "host_sim/loop/halves.hpp"
#include "host_sim/loop/hil_timed.hpp"
#include "host_sim/loop/realtime.hpp"
#include "host_sim/record/finish.hpp"

namespace esmc::host {
namespace {

/// Both halves in one process, in lockstep: publish, tick, collect, advance.
template <class World, class C = typename World::Mechanism, class PlantBus, class ControlBus>
int run_lockstep(const Scene& scene, const RunOptions& o, PlantBus& plant_bus, ControlBus& control_bus,
                 const std::string& interface) {
  OutputDirectory out = output_of(o);
  FrameLog frames(out.open("frames.log"), interface, static_cast<std::uint32_t>(scene.bitrate));
  PlantHalf<World, PlantBus> plant(scene, o, plant_bus, frames, out.open("log.csv"), true);
  ControllerHalf<World, ControlBus, C> controller(scene, Pacing::lockstep, control_bus);
  const auto begin = std::chrono::steady_clock::now();
  bool stop = false, overloaded = false;
  // One more tick of both halves after the run: time passes for the drives only.
  const auto next = [&] {
    (void)plant.await_last_torques();
    plant.publish();
    return controller.await_last_set();
  };
  Progress progress(tick_count(scene));
  while (!plant.finished() && !stop && !overloaded) {
    progress.at(plant.done());
    plant.publish();
    if (controller.await_set() == Waited::silent && !stop_requested()) {
      controller.shut_down();
      throw RunError("the drives' frames did not reach the controller within 5 s: lost on " + interface +
                     "?");
    }
    stop = must_stop(o, plant.done() + (plant.released() ? 1U : 0U));
    overloaded = controller.overloaded();
    if (stop) controller.stop();
    controller.tick(true);
    if (controller.supervisor().state() == State::fault && !plant.released() && !armed_by_link(scene)) {
      const std::string why = controller.refusal();
      controller.part(next);
      throw RunError("the controller refused to arm: " + why);
    }
    if (!plant.await_torques()) {
      stop = true;
      (void)plant.await_last_torques();
    }
    plant.advance(controller.view());
  }
  RunEnd end = plant.end(begin);
  end.interrupted = stop;
  if (stop) controller.part(next);
  end.final_state = name(controller.supervisor().state());
  end.faults.clear();
  if (controller.supervisor().fault() != Fault::none)
    end.faults.emplace_back(name(controller.supervisor().fault()));
  end.odd_encoder = controller.odd_encoder();
  if (!stop) controller.part([] { return false; });
  plant.drain();
  frames.close();
  return finish_run(o, scene, "hil", plant.recorder().statistics(), end, plant.recorder().log(), out);
}

template <class World>
int run_hil(const Scene& scene, const RunOptions& o) {
  require_reachable<World>(scene, o.realtime ? Pacing::realtime : Pacing::lockstep);
  const bool on_bus = std::ranges::any_of(scene.effects, acts_on_bus);
  if (on_bus && (o.realtime || o.bus != "virtual"))
    refuse_bus_effects(scene, "a CAN interface is not ours to disturb");
  if (o.single_precision && (on_bus || o.realtime || o.bus != "virtual")) {
    throw InputError("", "--scalar float: only in lockstep on the virtual bus without effects of the bus");
  }
  if (on_bus) return run_hil_timed<World>(scene, o);
  if (o.realtime) return run_hil_realtime<World>(scene, o);
  if (o.bus == "virtual") {
    const std::string interface = o.again.comparison != nullptr ? o.again.interface : "virtual";
    const auto bus = std::make_unique<hal::VirtualBus<2>>();
    if (o.single_precision) {
      return run_lockstep<World, typename World::SinglePrecision>(scene, o, bus->port(0), bus->port(1),
                                                                  interface);
    }
    return run_lockstep<World>(scene, o, bus->port(0), bus->port(1), interface);
  }
  BusEnds ends = open_both_ends(o.bus, scene.bitrate);
  return run_lockstep<World>(scene, o, ends.plant, ends.control, ends.plant.interface());
}

}  // namespace

int run_hil(const RunOptions& o) {
  const Scene scene = read_loop_scene(o);
  require_confirmed(scene);
  return scene.type == MechanismType::five_bar ? run_hil<FiveBarWorld>(scene, o) : run_hil<RrWorld>(scene, o);
}

}  // namespace esmc::host
