#pragma once
/// The frames of a tick of `esmc hil` on a bus with effects: frames take time or get lost, so a tick has a
/// deadline.
///
///   samples   every drive asks its node to send; until every axis' sample of this tick has arrived, or no
///   node
///             has a frame left to send, or the tick is over
///   (tick)    with the samples received; missing ones are extrapolated up to limits.max_age_ticks
///   torques   until the tick is over; each torque acts from the instant at which the drive received it
///
/// A frame that comes later than its tick is read in the next as if it belonged to it: frames carry no time.
/// It does not make the controller tick earlier.

#include <algorithm>
#include <chrono>
#include <cmath>
#include <optional>
#include <vector>

#include "host_sim/bus/timed_bus.hpp"
#include "host_sim/loop/controller_end.hpp"
#include "host_sim/loop/plant_end.hpp"

namespace esmc::host {

/// The bus part of the summary of a run on a bus with effects.
BusSummary timed_bus_summary(TimedBus& bus, const Scene& scene, std::uint64_t frames);

template <class World>
class TimedExchange {
 public:
  using Plant = PlantEnd<World, BusPort>;
  using Controller = ControllerEnd<World, BusPort>;

  /// All outlive this.
  TimedExchange(const Scene& scene, TimedBus& bus, BusPort& port, Plant& plant, Controller& controller,
                FrameLog& frames)
      : scene_(scene), bus_(bus), port_(port), plant_(plant), controller_(controller), frames_(frames) {}

  /// Begins a tick, up to the controller's samples.
  void samples() {
    begin();
    const auto awaited = [](const auto& report) { return report.has_value(); };
    while (std::ranges::any_of(due_, awaited) && !bus_.quiet() && step()) {
    }
    controller_.receive();
  }
  /// Completes the tick on the bus, then moves the plant over it. Always true: never interrupted.
  bool torques() {
    rest();
    plant_.advance(commands_, controller_.view());
    return true;
  }
  /// An overload makes the samples late, not the loop meaningless.
  [[nodiscard]] static bool ended() { return false; }
  /// One tick more in which time passes for the drives only.
  bool idle_tick() {
    rest();
    samples();
    return true;
  }
  /// Shuts the drives down after the last tick of a run that was not stopped.
  void close() {
    controller_.shut_down([&] { return idle_tick(); });
  }
  void report(RunEnd& end) const {
    end.bus = timed_bus_summary(bus_, scene_, frames_.frames());
    end.histograms = {{"Feedback latency",
                       "drives' frames, from the request to send to the last bit; virtual time", feedback_},
                      {"Command latency", "controller's frames, likewise", command_}};
  }

 private:
  void begin() {
    const bool released = plant_.released();
    begin_ = end_;
    end_ = std::llround(static_cast<double>(++ticks_) * scene_.tick() * static_cast<double>(scene_.bitrate));
    frames_.begin_tick(bus_.seconds(begin_));
    // The last frame that an axis sends in publish() is its report of the tick.
    due_.assign(plant_.plant().axes().size(), std::nullopt);
    plant_.plant().publish_from([&](std::size_t axis, const hal::CanFrame& f) {
      const bool taken = bus_.send(axis + 1, f) == hal::SendStatus::ok;
      due_[axis] = taken ? std::optional(arbitration(f)) : std::nullopt;
    });
    plant_.require_armed_in_time();
    if (plant_.released() && !released) bus_.begin_run();
    commands_.assign(1, {0.0, plant_.plant().asked()});
  }
  void rest() {
    while (step()) {
    }
  }
  /// The next frame; false: the tick is over.
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
    auto& plant = plant_.plant();
    const auto reply = [&](std::size_t axis, const hal::CanFrame& f) { (void)bus_.send(axis + 1, f); };
    for (std::size_t i = 0; i < plant.axes().size(); ++i) {
      if ((d->receivers >> (i + 1) & 1U) != 0) plant.hand_over(i, d->frame, reply);
    }
    const auto asked = plant.asked();
    if (asked != commands_.back().torque) commands_.push_back({bus_.seconds(d->at - begin_), asked});
    return true;
  }

  const Scene& scene_;
  TimedBus& bus_;
  BusPort& port_;
  Plant& plant_;
  Controller& controller_;
  FrameLog& frames_;
  TimedBus::Time begin_ = 0, end_ = 0;
  std::uint64_t ticks_ = 0;
  std::vector<typename Plant::TorqueCommand> commands_;  ///< of the tick
  Histogram feedback_, command_;
  std::vector<std::optional<std::uint32_t>> due_;  ///< arbitration of each axis' report, until it has arrived
};

}  // namespace esmc::host
