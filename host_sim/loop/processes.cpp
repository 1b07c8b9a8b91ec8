#include <fmt/format.h>

#include <chrono>

#include "host_sim/bus/open_bus.hpp"
#include "host_sim/loop/halves.hpp"
#include "host_sim/loop/observe.hpp"
#include "host_sim/loop/realtime.hpp"
#include "host_sim/record/controller_recorder.hpp"
#include "host_sim/record/finish.hpp"

namespace esmc::host {
namespace {

/// `esmc plant` in lockstep: waits for the controller's first frame, then sets the pace.
template <class World>
int plant_lockstep(const Scene& scene, const RunOptions& o, HostBus& bus) {
  OutputDirectory out = output_of(o);
  FrameLog frames(out.open("frames.log"), bus.interface(), static_cast<std::uint32_t>(scene.bitrate),
                  out.open("frames.csv"));
  PlantHalf<World, HostBus> plant(scene, o, bus, frames, out.open("log.csv"), false);
  if (wait_for(bus, [&] { return plant.drain() > 0; }) == Waited::silent) {
    throw RunError("no controller was heard for 5 s on " + bus.name());
  }
  const auto begin = std::chrono::steady_clock::now();
  bool stop = stop_requested();
  Progress progress(tick_count(scene));
  while (!plant.finished() && !stop) {
    progress.at(plant.done());
    plant.publish();
    stop = (o.again.ticks && plant.done() >= *o.again.ticks) || !plant.await_torques();
    if (!stop) plant.advance({});
  }
  RunEnd end = plant.end(begin);
  end.interrupted = stop;
  frames.close();
  return finish_run(o, scene, "plant", plant.recorder().statistics(), end, plant.recorder().log(), out);
}

/// `esmc controller` in lockstep: asks the drives to arm until they answer, then answers every complete set.
template <class World>
int controller_lockstep(const Scene& scene, const RunOptions& o, HostBus& bus) {
  OutputDirectory out = output_of(o);
  FrameLog frames(out.open("frames.log"), bus.interface(), static_cast<std::uint32_t>(scene.bitrate),
                  out.open("frames.csv"));
  Tapped<HostBus> tap(bus, frames);
  ControllerHalf<World, Tapped<HostBus>> controller(scene, Pacing::lockstep, tap);
  ControllerRecorder<World> recorder(scene, out.open("log.csv"));
  const auto begin = std::chrono::steady_clock::now();
  if (controller.await_drives(std::chrono::milliseconds(150)) == Waited::silent) {
    throw RunError("no drive was heard for 5 s on " + bus.name());
  }
  bool stop = false, overloaded = false;
  std::uint64_t sets = 0;
  // An overload ends the loop: which set the next samples belong to is no longer known.
  Progress progress(tick_count(scene));
  while (recorder.ticks_released() < tick_count(scene) && !stop && !overloaded) {
    progress.at(recorder.ticks());
    const Waited set = controller.await_set();
    stop = set == Waited::stopped || must_stop(o, recorder.ticks() + 1);
    if (set == Waited::silent && !stop) {
      controller.shut_down();
      throw RunError("the drives sent no complete set of encoder frames for 5 s (plant dead or not started)");
    }
    overloaded = controller.overloaded();
    if (stop) controller.stop();
    controller.tick(true);
    frames.tick(static_cast<double>(++sets) * scene.tick());
    recorder.tick(controller.result(), controller.sample());
    if (controller.supervisor().state() == State::fault && recorder.ticks() == 0) {
      const std::string why = controller.refusal();
      controller.shut_down();
      throw RunError("the controller refused to arm: " + why);
    }
  }
  if (stop || recorder.tested_only()) controller.shut_down();
  if (!stop) recorder.require_run();
  RunEnd end = recorder.end(begin, o, controller.supervisor(), frames, tap.lost(),
                            static_cast<double>(sets) * scene.tick());
  end.interrupted = stop;
  if (!stop) controller.shut_down();
  frames.close();
  return finish_run(o, scene, "controller", recorder.statistics(), end, recorder.log(), out);
}

HostBus bus_of(const RunOptions& o, const Scene& scene) {
  return o.again.bus != nullptr ? HostBus(*o.again.bus) : open_bus(o.bus, scene.bitrate);
}

template <class World>
int plant(const Scene& scene, const RunOptions& o) {
  require_reachable<World>(scene, o.realtime ? Pacing::realtime : Pacing::lockstep);
  HostBus bus = bus_of(o, scene);
  return o.realtime ? plant_realtime<World>(scene, o, bus) : plant_lockstep<World>(scene, o, bus);
}

template <class World>
int controller(const Scene& scene, const RunOptions& o) {
  require_reachable<World>(scene, o.realtime ? Pacing::realtime : Pacing::lockstep);
  HostBus bus = bus_of(o, scene);
  return o.realtime ? controller_realtime<World>(scene, o, bus) : controller_lockstep<World>(scene, o, bus);
}

/// In lockstep the halves find each other by the request to arm.
Scene read_half_scene(const RunOptions& o) {
  Scene scene = read_loop_scene(o);
  if (armed_by_link(scene) && !o.realtime) {
    throw InputError(scene.control_where, "command.arm = \"link\" with two processes needs --realtime");
  }
  return scene;
}

}  // namespace

int run_plant(const RunOptions& o) {
  const Scene scene = read_half_scene(o);
  refuse_bus_effects(scene, "a CAN interface is not ours to disturb");
  return scene.type == MechanismType::five_bar ? plant<FiveBarWorld>(scene, o) : plant<RrWorld>(scene, o);
}

int run_controller(const RunOptions& o) {
  Scene scene = read_half_scene(o);
  refuse_bus_effects(scene, "a CAN interface is not ours to disturb");
  if (o.observe) {
    HostBus bus = open_bus(o.bus, scene.bitrate);
    return run_observe(scene, o, bus);
  }
  if (o.again.bus == nullptr) {
    scene.hardware = o.realtime && carries_real_drives(o.bus);
    require_confirmed(scene);
  }
  return scene.type == MechanismType::five_bar ? controller<FiveBarWorld>(scene, o)
                                               : controller<RrWorld>(scene, o);
}

}  // namespace esmc::host
