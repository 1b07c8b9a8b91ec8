#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <memory>

#include "host_sim/bus/open_bus.hpp"
#include "host_sim/loop/progress.hpp"
#include "host_sim/loop/run.hpp"
#include "host_sim/loop/timed_exchange.hpp"
#include "host_sim/record/finish.hpp"

namespace esmc::host {
namespace {

/// The frames of a tick on a bus that delivers every frame.
template <class Plant, class Controller>
class DirectExchange {
 public:
  DirectExchange(Plant& plant, Controller& controller, std::string interface)
      : plant_(plant), controller_(controller), interface_(std::move(interface)) {}

  void samples() {
    plant_.publish();
    if (controller_.await_samples() != Waited::silent || stop_requested()) return;
    controller_.shut_down();
    throw RunError("the drives' frames did not reach the controller within 5 s: lost on " + interface_ + "?");
  }
  /// False: Ctrl-C.
  bool torques() {
    const bool all = plant_.await_torques();
    if (!all) (void)plant_.await_last_torques();
    plant_.advance(controller_.view());
    return all;
  }
  /// After an overload it is unknown which tick the next samples belong to.
  [[nodiscard]] bool ended() const { return controller_.overloaded(); }
  bool idle_tick() {
    (void)plant_.await_last_torques();
    plant_.publish();
    return controller_.await_last_samples();
  }
  void close() {
    controller_.shut_down([] { return false; });
    plant_.drain();
  }
  void report(RunEnd&) const {}

 private:
  Plant& plant_;
  Controller& controller_;
  std::string interface_;
};

/// Both ends in one process, in lockstep. `exchange` carries the frames of each tick between them.
template <class Plant, class Controller, class Exchange>
int run_lockstep(const Scene& scene, const RunOptions& o, BusRunFiles& files, Plant& plant,
                 Controller& controller, Exchange& exchange) {
  const auto begin = std::chrono::steady_clock::now();
  const auto idle_tick = [&] { return exchange.idle_tick(); };
  bool stop = false, ended = false;
  Progress progress(tick_count(scene));
  while (!plant.finished() && !stop && !ended) {
    progress.at(plant.done());
    exchange.samples();
    stop = must_stop(o, plant.done() + (plant.released() ? 1U : 0U));
    ended = exchange.ended();
    if (stop) controller.stop();
    controller.tick(true);
    if (controller.supervisor().state() == State::fault && !plant.released() && !armed_by_link(scene)) {
      const std::string why = controller.refusal();
      controller.shut_down(idle_tick);
      throw RunError("the controller refused to arm: " + why);
    }
    stop = !exchange.torques() || stop;
  }
  RunEnd end = plant.end(begin);
  end.interrupted = stop;
  exchange.report(end);
  if (stop) controller.shut_down(idle_tick);
  set_outcome(end, controller.supervisor());
  end.odd_encoder = controller.odd_encoder();
  if (!stop) exchange.close();
  return finish_run(o, scene, "hil", plant.recorder(), end, files);
}

template <class World, class C = typename World::Mechanism, class PlantBus, class ControlBus>
int run_direct(const Scene& scene, const RunOptions& o, PlantBus& plant_bus, ControlBus& control_bus,
               const std::string& interface) {
  BusRunFiles files(o, scene, interface);
  PlantEnd<World, PlantBus> plant(scene, o, plant_bus, files.frames, files.log, true);
  ControllerEnd<World, ControlBus, C> controller(scene, Pacing::lockstep, control_bus);
  DirectExchange exchange(plant, controller, interface);
  return run_lockstep(scene, o, files, plant, controller, exchange);
}

template <class World>
int run_timed(const Scene& scene, const RunOptions& o) {
  BusRunFiles files(o, scene, "virtual");
  TimedBus bus({scene.drives.nodes.size(), static_cast<double>(scene.bitrate), scene.effects, scene.seed});
  BusPort port(bus, TimedBus::controller);
  PlantEnd<World, BusPort> plant(scene, o, port, files.frames, files.log, true);
  ControllerEnd<World, BusPort> controller(scene, Pacing::lockstep, port);
  TimedExchange<World> exchange(scene, bus, port, plant, controller, files.frames);
  return run_lockstep(scene, o, files, plant, controller, exchange);
}

template <class World>
int run_hil(const Scene& scene, const RunOptions& o) {
  require_reachable<World>(scene, o.realtime ? Pacing::realtime : Pacing::lockstep);
  const bool on_bus = std::ranges::any_of(scene.effects, acts_on_bus);
  if (on_bus && (o.realtime || o.bus != "virtual")) refuse_bus_effects(scene, no_effects_on_interface);
  if (o.single_precision && (on_bus || o.realtime || o.bus != "virtual")) {
    throw InputError("", "--scalar float: only in lockstep on the virtual bus without effects of the bus");
  }
  if (on_bus) return run_timed<World>(scene, o);
  if (o.realtime) return run_hil_realtime(scene, o);
  if (o.bus == "virtual") {
    const std::string interface = o.again.comparison != nullptr ? o.again.interface : "virtual";
    const auto bus = std::make_unique<hal::VirtualBus<2>>();
    if (o.single_precision) {
      return run_direct<World, typename World::SinglePrecision>(scene, o, bus->port(0), bus->port(1),
                                                                interface);
    }
    return run_direct<World>(scene, o, bus->port(0), bus->port(1), interface);
  }
  BusEnds ends = open_both_ends(o.bus, scene.bitrate);
  return run_direct<World>(scene, o, ends.plant, ends.control, ends.plant.interface());
}

}  // namespace

int run_hil(const RunOptions& o) {
  const Scene scene = read_loop_scene(o);
  require_confirmed(scene);
  return scene.type == MechanismType::five_bar ? run_hil<FiveBarTraits>(scene, o)
                                               : run_hil<RrTraits>(scene, o);
}

}  // namespace esmc::host
