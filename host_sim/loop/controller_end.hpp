#pragma once
/// The controller's end of hardware in the loop on its CAN node: the firmware's cycle, and texts about it.

#include <algorithm>
#include <chrono>
#include <cmath>
#include <functional>
#include <string>
#include <utility>

#include "host_sim/controller/axes_config.hpp"
#include "host_sim/loop/drive_reports.hpp"
#include "host_sim/loop/waiting.hpp"
#include "host_sim/record/fault_record.hpp"
#include "host_sim/record/recorder.hpp"

namespace esmc::host {

// Samples and results of a controller in single precision as doubles, for records.

/// A result with its numbers in double. M, C: the mechanism in double and in the controller's scalar type.
template <class M, class C>
TickResult<M> in_double(const TickResult<C>& r) {
  TickResult<M> out;
  out.state = r.state;
  out.fault = r.fault;
  out.running_tick = r.running_tick;
  out.saturated = r.saturated;
  out.stage_done = r.stage_done;
  out.torque = r.torque.template cast<double>();
  out.effector = r.effector.template cast<double>();
  out.desired_effector = r.desired_effector.template cast<double>();
  for (int i = 0; i < 2; ++i) out.desired_direction[i] = r.desired_direction[i].template cast<double>();
  out.sliding = r.sliding.template cast<double>();
  return out;
}

template <class M, class C>
Sample<M> in_double(const Sample<C>& s) {
  Sample<M> out;
  out.angle = s.angle.template cast<double>();
  out.rate = s.rate.template cast<double>();
  out.age_ticks = s.age_ticks;
  for (std::size_t i = 0; i < out.phase.size(); ++i) out.phase[i] = static_cast<double>(s.phase[i]);
  return out;
}

/// The cycle of a scene on its bus, with waiting, arming, shutting down. `C`: mechanism in its scalar type.
template <class World, class Bus, class C = typename World::Mechanism>
class ControllerEnd {
 public:
  using M = typename World::Mechanism;
  using S = typename C::Scalar;

  /// `bus` must outlive this. Orders arming at once, unless a supervisor computer arms.
  ControllerEnd(const Scene& scene, Pacing pacing, Bus& bus)
      : reference_(make_reference<S>(scene, pacing)),
        bus_(bus),
        lockstep_(pacing == Pacing::lockstep),
        shutdown_ticks_(static_cast<int>(std::ceil(std::clamp(scene.drives.heartbeat_timeout, 0.05, 1.0) *
                                                   scene.rate_hz)) +
                        1),
        cycle_(make_cycle<C>(scene, pacing, reference_)),
        scene_(scene),
        finder_(scene),
        reports_(scene, cycle_) {
    if (scene.command) {
      captured_.resize(static_cast<std::size_t>(std::clamp(captured_s * scene.rate_hz, 1.0, 16383.0)));
      with_cycle([&](auto& c) { c.link().capture_into(captured_); });
    }
    if (!armed_by_link(scene)) with_cycle([](auto& c) { c.command(Command::enable); });
  }
  ControllerEnd(const ControllerEnd&) = delete;  // members refer to others
  ControllerEnd& operator=(const ControllerEnd&) = delete;

  [[nodiscard]] const Supervisor& supervisor() const {
    return with_cycle([](const auto& c) -> const Supervisor& { return c.supervisor(); });
  }
  /// The sliding surfaces of the controller, for the record.
  [[nodiscard]] std::vector<Surface> surfaces() const {
    return with_cycle([&](const auto& c) { return surfaces_of<World>(scene_, c.controller().config()); });
  }
  /// Measurements of the last tick.
  [[nodiscard]] const Sample<M>& sample() const {
    if constexpr (std::is_same_v<C, M>) {
      return with_cycle([](const auto& c) -> const Sample<M>& { return c.sample(); });
    } else {
      return sample_;
    }
  }
  /// Whether any drive has sent a frame.
  [[nodiscard]] bool heard() const {
    return with_cycle([](const auto& c) { return c.heard(); });
  }
  /// Whether any drive has sent a frame that is not of its protocol.
  [[nodiscard]] bool malformed() const {
    return with_cycle([](const auto& c) { return c.counters().malformed > 0; });
  }
  /// Whether more frames came since the last tick than a tick may read.
  [[nodiscard]] bool overloaded() const {
    return with_cycle([](const auto& c) { return c.overloaded(); });
  }
  [[nodiscard]] const TickResult<M>& result() const { return result_; }  ///< of the last tick
  /// The first fault since the start, with joint and node; empty: none.
  [[nodiscard]] const std::optional<FaultRecord>& fault() const { return fault_; }
  /// The drives in words.
  [[nodiscard]] const DriveReports<World, C>& reports() const { return reports_; }
  /// Throws RunError, after shut_down(next), if a fault ended arming.
  void require_armed(const std::function<bool()>& next) {
    if (supervisor().state() != State::fault) return;
    const std::string why = reports_.refusal();
    shut_down(next);
    throw RunError("the controller refused to arm: " + why);
  }
  /// Result and sample of the last tick for a recorder; valid until the next tick.
  [[nodiscard]] ControllerView<M> view() const { return {&result_, &sample(), std::is_same_v<C, M>}; }

  /// Reads frames until every axis has sent its sample, or more came than a tick may read (bus_overload).
  Waited await_samples() {
    return wait_for(bus_, [&] { return receive_samples(); });
  }
  /// Requests arming every `retry` until a drive answers or a fault is latched (done), or 5 s (silent).
  Waited await_drives(std::chrono::milliseconds retry) {
    const auto answered = [&] {
      receive();
      return heard() || overloaded();
    };
    const auto give_up = std::chrono::steady_clock::now() + std::chrono::milliseconds(silence_ms);
    Waited w = Waited::silent;
    while (w == Waited::silent && std::chrono::steady_clock::now() < give_up) {
      request_arming();
      if (supervisor().state() == State::fault) return Waited::done;
      w = wait_for(bus_, answered, static_cast<int>(retry.count()));
    }
    return w;
  }
  /// Reads the waiting frames, for tick().
  void receive() {
    with_cycle([&](auto& c) { c.receive(bus_); });
  }
  /// One tick of the cycle. `answer`: it sends torque commands.
  void tick(bool answer) {
    with_cycle([&](auto& c) {
      if constexpr (std::is_same_v<C, M>) {
        result_ = c.tick(bus_, answer);
      } else {
        result_ = in_double<M, C>(c.tick(bus_, answer));
        sample_ = in_double<M, C>(c.sample());
      }
      if (lockstep_) c.request(bus_);
    });
    finder_.see(result_, sample());
    if (finder_.found() && !fault_) {
      fault_ = finder_.found();
      reports_.add_details(expected_, *fault_);
    }
    expected_ += (result_.torque - expected_) / (scene_.drives.torque_time * scene_.rate_hz + 1.0);
  }
  /// Sets the lateness of the coming tick, s, for its record.
  void late_by(double seconds) {
    with_cycle([&](auto& c) { c.late_by(static_cast<std::uint32_t>(std::clamp(1e6 * seconds, 0.0, 1e9))); });
  }
  /// Begins a tick in real time: reads the waiting frames and, where the drives sample on demand, requests
  /// samples and waits for them, no longer than `patience`.
  void sample(std::chrono::microseconds patience) {
    if constexpr (requires { bus_.look(); }) bus_.look();
    receive();
    if (!with_cycle([](const auto& c) { return c.samples_on_demand; })) return;
    with_cycle([&](auto& c) { c.request(bus_); });
    const auto deadline = std::chrono::steady_clock::now() + patience;
    while (!receive_samples() && std::chrono::steady_clock::now() < deadline) (void)wait_for_frame(bus_, 0);
  }
  /// Repeats the request to arm, in a tick without torque commands.
  void request_arming() {
    with_cycle([](auto& c) { c.ask_again(); });
    tick(false);
  }
  /// Orders zero torque and idle drives, from the next tick on.
  void stop() {
    with_cycle([](auto& c) { c.command(Command::stop); });
  }
  /// Orders zero torque and idle drives and ticks until every drive reports idle, no frame has come for
  /// drives.heartbeat_timeout (0.05 to 1 s), or a second is over. `next` waits for the next tick; false:
  /// there is none.
  void shut_down(const std::function<bool()>& next) {
    stop();
    tick(true);
    bool more = true;
    const auto most = static_cast<int>(std::max(scene_.rate_hz, 1.0 * shutdown_ticks_));
    auto heard = received();
    for (int n = 0, silent = 0; more && !at_rest() && silent < shutdown_ticks_ && n < most; ++n) {
      more = next();
      tick(true);
      silent = received() == heard ? silent + 1 : 0;
      heard = received();
    }
  }
  /// shut_down(next), where each tick waits at most 20 ms for the samples of the other end.
  void shut_down() {
    shut_down([&] { return await_last_samples(); });
  }
  /// Waits at most 20 ms for samples, after a stop. False: not all came.
  bool await_last_samples() {
    return wait_briefly(bus_, [&] { return receive_samples(); });
  }

 private:
  /// Frames of drives so far.
  [[nodiscard]] auto received() const {
    return with_cycle([](const auto& c) { return c.counters().received; });
  }
  static constexpr double captured_s = 2.0;  ///< the last ticks, kept for a console
  [[nodiscard]] bool at_rest() const {
    return (supervisor().state() == State::disabled || supervisor().state() == State::fault) &&
           with_cycle([](const auto& c) { return c.all_idle(); });
  }
  bool receive_samples() {
    receive();
    return with_cycle([](const auto& c) { return c.complete() || c.overloaded(); });
  }
  /// f(cycle): f takes the cycle of any protocol.
  template <class F>
  decltype(auto) with_cycle(F&& f) {
    return std::visit(std::forward<F>(f), cycle_);
  }
  template <class F>
  decltype(auto) with_cycle(F&& f) const {
    return std::visit(std::forward<F>(f), cycle_);
  }

  ReferenceBundle<S> reference_;
  Bus& bus_;
  bool lockstep_;
  int shutdown_ticks_;
  AnyCycle<C> cycle_;
  TickResult<M> result_{};
  Sample<M> sample_{};  // of a controller in another scalar type
  const Scene& scene_;
  FaultFinder<World> finder_;
  DriveReports<World, C> reports_;
  std::optional<FaultRecord> fault_;
  std::vector<link::CaptureRecord> captured_;
  Vec<double, M::joints> expected_ =
      Vec<double, M::joints>::Zero();  // torques as TorqueFeedbackCheck has them
};

}  // namespace esmc::host
