#pragma once
/// `esmc hil` on a bus with effects: frames take time or get lost, so a tick cannot wait for them for ever.
///
///   begin    every drive asks its node to send: sample, heartbeat
///   listen   until every axis' sample of this tick is through, or nobody has anything left to send, or the
///   tick is over tick     with what has come; what is missing is extrapolated up to limits.max_age_ticks
///   rest     until the tick is over: each drive takes its torque when the bus has carried it
///   advance  the plant over the tick, under each torque from the instant it was received on
///
/// What comes later than its tick is read in the next, as if it were of it: these frames carry no time. It
/// does not make the controller tick earlier.

#include <algorithm>
#include <chrono>
#include <cmath>
#include <optional>
#include <span>
#include <vector>

#include "host_sim/bus/timed_bus.hpp"
#include "host_sim/loop/halves.hpp"
#include "host_sim/record/finish.hpp"

namespace esmc::host {

inline TimedBus::Config bus_config(const Scene& scene) {
  return {scene.drives.nodes.size(), static_cast<double>(scene.bitrate), scene.effects, scene.seed};
}

/// The bus as the summary has it. `bus_time`: s.
BusSummary bus_summary(TimedBus& bus, const Scene& scene, std::uint64_t frames);

template <class World>
class TimedLoop {
 public:
  using Plant = PlantHalf<World, BusPort>;
  using TorqueCommand = typename Plant::TorqueCommand;

  TimedLoop(const Scene& scene, TimedBus& bus, BusPort& port, Plant& plant,
            ControllerHalf<World, BusPort>& controller, FrameLog& frames)
      : scene_(scene), bus_(bus), port_(port), plant_(plant), controller_(controller), frames_(frames) {}

  void begin() {
    const bool released = plant_.released();
    begin_ = end_;
    end_ = std::llround(static_cast<double>(++ticks_) * scene_.tick() * static_cast<double>(scene_.bitrate));
    frames_.begin_tick(bus_.seconds(begin_));
    // The last frame that an axis sends by itself is its report of the tick.
    due_.assign(plant_.node().axes(), std::nullopt);
    plant_.node().publish_from([&](std::size_t axis, const hal::CanFrame& f) {
      const bool taken = bus_.send(axis + 1, f) == hal::SendStatus::ok;
      due_[axis] = taken ? std::optional(arbitration(f)) : std::nullopt;
    });
    plant_.look_at_arming();
    if (plant_.released() && !released) bus_.begin_run();
    told_.assign(1, {0.0, plant_.node().asked()});
  }
  void listen() {
    const auto awaited = [](const auto& report) { return report.has_value(); };
    while (std::ranges::any_of(due_, awaited) && !bus_.quiet() && step()) {
    }
    controller_.receive();
  }
  void rest() {
    while (step()) {
    }
  }
  /// What the drives were told in the tick.
  [[nodiscard]] std::span<const TorqueCommand> told() const { return told_; }
  [[nodiscard]] std::vector<NamedHistogram> latencies() const {
    return {{"Feedback latency", "drives' frames, from the request to send to the last bit; virtual time",
             feedback_},
            {"Command latency", "controller's frames, likewise", command_}};
  }

 private:
  /// One frame further; false: the tick is over.
  bool step() {
    const auto d = bus_.next(end_);
    if (!d) return false;
    frames_.frame_at(bus_.seconds(d->at), d->bits, d->frame);
    const bool to_controller = (d->receivers & 1U) != 0;
    (to_controller ? feedback_ : command_).add(bus_.seconds(d->at - d->asked));
    if (to_controller) port_.deliver(d->frame);
    for (auto& report : due_) {
      if (d->asked >= begin_ && report == arbitration(d->frame)) report.reset();
    }
    auto& node = plant_.node();
    const auto reply = [&](std::size_t axis, const hal::CanFrame& f) { (void)bus_.send(axis + 1, f); };
    for (std::size_t i = 0; i < node.axes(); ++i) {
      if ((d->receivers >> (i + 1) & 1U) != 0) node.hand_over(i, d->frame, reply);
    }
    const auto asked = node.asked();
    if (asked != told_.back().torque) told_.push_back({bus_.seconds(d->at - begin_), asked});
    return true;
  }

  const Scene& scene_;
  TimedBus& bus_;
  BusPort& port_;
  Plant& plant_;
  ControllerHalf<World, BusPort>& controller_;
  FrameLog& frames_;
  TimedBus::Time begin_ = 0, end_ = 0;
  std::uint64_t ticks_ = 0;
  std::vector<TorqueCommand> told_;
  Histogram feedback_, command_;
  std::vector<std::optional<std::uint32_t>> due_;  ///< arbitration of each axis' report, until it is through
};

template <class World>
int run_hil_timed(const Scene& scene, const RunOptions& o) {
  OutputDirectory out = output_of(o);
  FrameLog frames(out.open("frames.log"), "virtual", static_cast<std::uint32_t>(scene.bitrate));
  TimedBus bus(bus_config(scene));
  BusPort port(bus, TimedBus::controller);
  PlantHalf<World, BusPort> plant(scene, o, port, frames, out.open("log.csv"), true);
  ControllerHalf<World, BusPort> controller(scene, Pacing::lockstep, port);
  TimedLoop<World> loop(scene, bus, port, plant, controller, frames);
  const auto begin = std::chrono::steady_clock::now();
  // One more tick of both halves after the run: time passes for the drives only.
  const auto next = [&] {
    loop.rest();
    loop.begin();
    loop.listen();
    return true;
  };
  bool stop = false;
  Progress progress(tick_count(scene));
  while (!plant.finished() && !stop) {
    progress.at(plant.done());
    loop.begin();
    loop.listen();
    stop = must_stop(o, plant.done() + (plant.released() ? 1U : 0U));
    if (stop) controller.stop();
    controller.tick(true);
    if (controller.supervisor().state() == State::fault && !plant.released() && !armed_by_link(scene)) {
      const std::string refusal = controller.refusal();
      controller.part(next);
      throw RunError("the controller refused to arm: " + refusal);
    }
    loop.rest();
    plant.advance(loop.told(), controller.view());
  }
  RunEnd end = plant.end(begin);
  end.interrupted = stop;
  end.bus = bus_summary(bus, scene, frames.frames());
  end.histograms = loop.latencies();
  if (stop) controller.part(next);
  end.final_state = name(controller.supervisor().state());
  end.faults.clear();
  if (controller.supervisor().fault() != Fault::none)
    end.faults.emplace_back(name(controller.supervisor().fault()));
  end.odd_encoder = controller.odd_encoder();
  if (!stop) controller.part(next);
  frames.close();
  return finish_run(o, scene, "hil", plant.recorder().statistics(), end, plant.recorder().log(), out);
}

}  // namespace esmc::host
