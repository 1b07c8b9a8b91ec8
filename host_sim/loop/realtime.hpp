#pragma once
/// The loop against the wall clock: each half has its own ticks at absolute instants, as drives and a board
/// have. A torque acts from the moment it arrives (to within one integration step), one tick late at most.

#include <chrono>
#include <memory>
#include <thread>

#include "host_sim/bus/open_bus.hpp"
#include "host_sim/bus/response.hpp"
#include "host_sim/loop/halves.hpp"
#include "host_sim/loop/pace.hpp"
#include "host_sim/record/controller_recorder.hpp"
#include "host_sim/record/finish.hpp"

namespace esmc::host {

/// The plant's ticks until the scene's duration, Ctrl-C, `over` or 5 s without a command from the controller.
template <class World, class Bus, class Over>
RunEnd pace_plant(const Scene& scene, const RunOptions& o, PlantHalf<World, Bus>& plant, const Over& over) {
  const auto begin = std::chrono::steady_clock::now();
  const auto silence = std::chrono::milliseconds(silence_ms);
  const auto arming = std::chrono::duration<double>(arming_time_max(scene));
  auto heard = begin;
  Pace pace(scene.tick() / plant.substeps(), o.again.bus == nullptr);
  std::uint64_t late = 0;
  Progress progress(tick_count(scene));
  while (!plant.finished() && !must_stop(o, plant.done()) && !over()) {
    progress.at(plant.done());
    if (!plant.released() && std::chrono::steady_clock::now() - begin > arming) {
      throw RunError(fmt::format(
          "the drives were not in closed-loop control after {} s (controller dead or not started)",
          arming_time_max(scene)));
    }
    plant.publish();
    const std::uint64_t before = pace.late();
    for (int part = 0; part < plant.substeps(); ++part) {
      pace.wait();
      plant.advance_part(part, part == 0, {});
      if (plant.drain() > 0) heard = std::chrono::steady_clock::now();
    }
    if (pace.late() > before) ++late;
    // A board says nothing to the drives before a supervisor computer has armed it.
    if ((plant.released() || !armed_by_link(scene)) && std::chrono::steady_clock::now() - heard > silence)
      throw RunError("the controller was not heard for 5 s");
  }
  RunEnd end = plant.end(begin);
  end.interrupted = stop_requested();
  end.late_ticks = late;
  return end;
}

/// The controller's ticks; `done` tells when to end. Returns how many were late.
template <class World, class Bus, class Done>
std::uint64_t pace_controller(const Scene& scene, const RunOptions& o, ControllerHalf<World, Bus>& controller,
                              ControllerRecorder<World>& recorder, const Done& done) {
  Pace pace(scene.tick(), o.again.bus == nullptr);
  // Samples that are later than this are the next tick's, one tick old.
  const auto patience = std::chrono::duration_cast<std::chrono::microseconds>(
      std::chrono::duration<double>(patience_ticks * scene.tick()));
  const auto part = [&] {
    controller.part([&] {
      pace.wait();
      controller.sample(patience);
      return true;
    });
  };
  const auto begin = std::chrono::steady_clock::now();
  while (!done() && !must_stop(o, recorder.ticks())) {
    pace.wait();
    controller.sample(patience);
    controller.tick(true);
    recorder.tick(controller.result(), controller.sample(), pace.since());
    const bool never = recorder.ticks() == 0 && std::chrono::steady_clock::now() - begin >
                                                    std::chrono::duration<double>(arming_time_max(scene));
    if (controller.supervisor().state() == State::fault && recorder.ticks() == 0 && !armed_by_link(scene)) {
      const std::string why = controller.refusal();
      part();
      throw RunError("the controller refused to arm: " + why);
    }
    if (never) {
      const std::string why = armed_by_link(scene)
                                  ? "no supervisor computer armed them"
                                  : "plant dead or not started, or not ready: " + controller.unready();
      part();
      throw RunError(fmt::format("the drives were not in closed-loop control after {} s ({})",
                                 arming_time_max(scene), why));
    }
  }
  const std::uint64_t late = pace.late();
  part();
  return late;
}

/// The drives go on talking, with the mechanism left as it is, until the controller has heard that they are
/// idle.
template <class World, class Bus, class Done>
void linger(const Scene& scene, PlantHalf<World, Bus>& plant, const Done& done) {
  Pace pace(scene.tick());
  const auto give_up = std::chrono::steady_clock::now() + std::chrono::seconds(2);
  while (!done() && std::chrono::steady_clock::now() < give_up) {
    pace.wait();
    plant.publish();
    (void)plant.drain();
  }
}

template <class World>
int plant_realtime(const Scene& scene, const RunOptions& o, HostBus& bus) {
  OutputDirectory out = output_of(o);
  FrameLog frames(out.open("frames.log"), bus.interface(), static_cast<std::uint32_t>(scene.bitrate),
                  out.open("frames.csv"));
  PlantHalf<World, HostBus> plant(scene, o, bus, frames, out.open("log.csv"), false);
  if (!armed_by_link(scene) && !o.again.of_hil &&
      wait_for(bus, [&] { return plant.drain() > 0; }) == Waited::silent) {
    throw RunError("no controller was heard for 5 s on " + bus.name());
  }
  const RunEnd end = pace_plant(scene, o, plant, [] { return false; });
  frames.close();
  return finish_run(o, scene, "plant", plant.recorder().statistics(), end, plant.recorder().log(), out);
}

template <class World>
int controller_realtime(const Scene& scene, const RunOptions& o, HostBus& bus) {
  OutputDirectory out = output_of(o);
  FrameLog frames(out.open("frames.log"), bus.interface(), static_cast<std::uint32_t>(scene.bitrate),
                  out.open("frames.csv"));
  Tapped<HostBus> tap(bus, frames);
  ControllerHalf<World, Tapped<HostBus>> controller(scene, Pacing::realtime, tap);
  ControllerRecorder<World> recorder(scene, out.open("log.csv"));
  const auto begin = std::chrono::steady_clock::now();
  const std::uint64_t late = pace_controller(scene, o, controller, recorder,
                                             [&] { return recorder.ticks_released() >= tick_count(scene); });
  if (!stop_requested()) recorder.require_run();
  RunEnd end = recorder.end(begin, o, controller.supervisor(), frames, tap.lost(),
                            std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count());
  end.interrupted = stop_requested();
  end.late_ticks = late;
  frames.close();
  return finish_run(o, scene, "controller", recorder.statistics(), end, recorder.log(), out);
}

/// Both halves in one process: the plant in this thread, the controller in another, each on its own socket.
template <class World>
int run_hil_realtime(const Scene& scene, const RunOptions& o) {
  if (o.bus == "virtual") {
    throw InputError("",
                     "--realtime needs --bus socketcan:INTERFACE or slcan:PLANT,CONTROLLER: the virtual bus "
                     "has no clock of its own");
  }
  BusEnds ends = open_both_ends(o.bus, scene.bitrate);
  OutputDirectory out = output_of(o);
  FrameLog frames(out.open("frames.log"), ends.plant.interface(), static_cast<std::uint32_t>(scene.bitrate),
                  out.open("frames.csv"));
  PlantHalf<World, HostBus> plant(scene, o, ends.plant, frames, out.open("log.csv"), false);
  ControllerHalf<World, HostBus> controller(scene, Pacing::realtime, ends.control);
  ControllerRecorder<World> seen(scene, nullptr);
  std::atomic<bool> over{false}, parted{false};
  std::exception_ptr plant_failure, controller_failure;
  std::uint64_t late = 0;
  std::thread thread([&] {
    try {
      late = pace_controller(scene, o, controller, seen, [&] { return over.load(); });
    } catch (...) {
      controller_failure = std::current_exception();
    }
    parted = true;
  });
  RunEnd end;
  try {
    end = pace_plant(scene, o, plant, [&] { return parted.load(); });
    over = true;
    linger(scene, plant, [&] { return parted.load(); });
  } catch (...) {
    plant_failure = std::current_exception();
  }
  over = true;
  thread.join();
  if (controller_failure) std::rethrow_exception(controller_failure);
  if (plant_failure) std::rethrow_exception(plant_failure);
  end.late_ticks = end.late_ticks.value_or(0) + late;
  end.fault_t = seen.statistics().fault_time();
  end.histograms = seen.latencies();
  const Supervisor& supervisor = controller.supervisor();
  end.final_state = name(supervisor.state());
  end.faults.clear();
  if (supervisor.fault() != Fault::none) end.faults.emplace_back(name(supervisor.fault()));
  frames.close();
  return finish_run(o, scene, "hil", plant.recorder().statistics(), end, plant.recorder().log(), out);
}

}  // namespace esmc::host
