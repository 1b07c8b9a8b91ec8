#pragma once
/// The controller's end of hardware in the loop on its CAN node: the firmware's cycle, and texts about it.

#include <algorithm>
#include <chrono>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "host_sim/controller/axes_config.hpp"
#include "host_sim/loop/waiting.hpp"
#include "host_sim/record/fault_record.hpp"
#include "host_sim/record/recorder.hpp"

namespace esmc::host {

// Samples and results of a controller in single precision as doubles, for records.

/// M and C: the same mechanism in double and in the controller's scalar type.
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

/// `C`: the mechanism in the controller's scalar type.
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
        axis_count_(static_cast<int>(scene.drives.nodes.size())),
        endpoints_(scene.drives.endpoints),
        shutdown_ticks_(static_cast<int>(std::ceil(std::clamp(scene.drives.heartbeat_timeout, 0.05, 1.0) *
                                                   scene.rate_hz)) +
                        1),
        cycle_(make_cycle<C>(scene, pacing, reference_)),
        scene_(scene),
        nodes_(scene.drives.nodes.size()),
        finder_(scene) {
    for (std::size_t i = 0; i < static_cast<std::size_t>(scene.motors()); ++i)
      motors_.emplace_back(static_cast<int>(axis_of(scene, i)), scene.drives.nodes[i]);
    for (std::size_t i = 0; i < nodes_.size(); ++i) nodes_[axis_of(scene, i)] = scene.drives.nodes[i];
    if (!armed_by_link(scene)) with([](auto& c) { c.command(Command::enable); });
  }

  [[nodiscard]] const Supervisor& supervisor() const {
    return with([](const auto& c) -> const Supervisor& { return c.supervisor(); });
  }
  [[nodiscard]] std::vector<Surface> surfaces() const {
    return with([&](const auto& c) { return surfaces_of<World>(scene_, c.controller().config()); });
  }
  [[nodiscard]] const Sample<M>& sample() const {
    if constexpr (std::is_same_v<C, M>) {
      return with([](const auto& c) -> const Sample<M>& { return c.sample(); });
    } else {
      return sample_;
    }
  }
  /// Whether any drive has sent a frame.
  [[nodiscard]] bool heard() const {
    return with([](const auto& c) { return c.heard(); });
  }
  /// Whether more frames came since the last tick than a tick may read.
  [[nodiscard]] bool overloaded() const {
    return with([](const auto& c) { return c.overloaded(); });
  }
  [[nodiscard]] const TickResult<M>& result() const { return result_; }  ///< of the last tick
  /// The first fault of a tick, with joint and node.
  [[nodiscard]] const std::optional<FaultRecord>& fault() const { return fault_; }
  /// Joint whose encoder contradicts the others, after a fault loop_not_closed; empty: unknown.
  [[nodiscard]] std::string odd_encoder() const {
    const int odd = with([](const auto& c) -> int { return c.controller().odd_encoder(); });
    return supervisor().fault() == Fault::loop_not_closed && odd != 0 ? World::joint_names[odd - 1] : "";
  }
  /// Shuts down and throws RunError where arming was refused.
  template <class Next>
  void require_armed(const Next& next) {
    if (supervisor().state() != State::fault) return;
    const std::string why = refusal();
    shut_down(next);
    throw RunError("the controller refused to arm: " + why);
  }
  /// Why it did not arm: the fault, with node and object where a drive reports one.
  [[nodiscard]] std::string refusal() const {
    std::string out = name(supervisor().fault());
    if (supervisor().fault() == Fault::enabling_timeout && !unready().empty())
      out += " (not ready: " + unready() + ")";
    if (!odd_encoder().empty()) out += " (the encoder of " + odd_encoder() + " contradicts the others)";
    with([&](const auto& c) {
      for (int i = 0; i < axis_count_; ++i) out += reported(c.axis(i), is_motor(i));
    });
    return out;
  }
  /// "node 1, node 2": the motors' drives that have not confirmed torque control.
  [[nodiscard]] std::string unready() const {
    std::string out;
    with([&](const auto& c) {
      for (const auto& [axis, node] : motors_) {
        if (c.axis(axis).ready()) continue;
        out += fmt::format("{}node {}{}", out.empty() ? "" : ", ", node,
                           c.axis(axis).alive() ? "" : " (silent)");
      }
    });
    return out;
  }
  [[nodiscard]] ControllerView<M> view() const { return {&result_, &sample(), std::is_same_v<C, M>}; }

  /// Reads frames until every axis has sent its sample, or more came than a tick may read (bus_overload).
  Waited await_samples() {
    return wait_for(bus_, [&] { return receive_samples(); });
  }
  /// Asks the drives to arm, every `retry`, until one answers or a fault is latched: done. Silent: after 5 s.
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
  /// Reads the waiting frames. tick() acts on them; `answer`: it sends torque commands.
  void receive() {
    with([&](auto& c) { c.receive(bus_); });
  }
  void tick(bool answer) {
    with([&](auto& c) {
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
      with([&](const auto& c) {
        for (int i = axis_count_ - 1; i >= 0; --i) blame(c.axis(i), i);
      });
    }
    expected_ += (result_.torque - expected_) / (scene_.drives.torque_time * scene_.rate_hz + 1.0);
  }
  /// Begins a tick against the clock: reads the waiting frames and, where the drives sample on demand, asks
  /// them and waits for their answers, no longer than `patience`.
  void sample(std::chrono::microseconds patience) {
    if constexpr (requires { bus_.look(); }) bus_.look();
    receive();
    if (!with([](const auto& c) { return c.samples_on_demand; })) return;
    with([&](auto& c) { c.request(bus_); });
    const auto deadline = std::chrono::steady_clock::now() + patience;
    while (!receive_samples() && std::chrono::steady_clock::now() < deadline) (void)wait_for_frame(bus_, 0);
  }
  /// Asks the drives to arm, in a tick without torque commands.
  void request_arming() {
    with([](auto& c) { c.ask_again(); });
    tick(false);
  }
  /// Orders zero torque and idle drives, from the next tick on.
  void stop() {
    with([](auto& c) { c.command(Command::stop); });
  }
  /// Zero torque and the order to go idle, until every drive reports idle or has been silent for too long.
  /// `next` brings about the next tick; false: there is none.
  template <class Next>
  void shut_down(const Next& next) {
    stop();
    tick(true);
    bool more = true;
    for (int n = 0; more && !at_rest() && n < shutdown_ticks_; ++n) {
      more = next();
      tick(true);
    }
  }
  /// Shuts down as above; each tick waits at most 20 ms for the samples of the other end.
  void shut_down() {
    shut_down([&] { return await_last_samples(); });
  }
  /// Waits at most 20 ms for samples, after a stop. False: not all came.
  bool await_last_samples() {
    return wait_briefly(bus_, [&] { return receive_samples(); });
  }

 private:
  [[nodiscard]] bool at_rest() const {
    return (supervisor().state() == State::disabled || supervisor().state() == State::fault) &&
           with([](const auto& c) { return c.all_idle(); });
  }
  bool receive_samples() {
    receive();
    return with([](const auto& c) { return c.complete() || c.overloaded(); });
  }
  template <class F>
  decltype(auto) with(F&& f) {
    return std::visit(std::forward<F>(f), cycle_);
  }
  template <class F>
  decltype(auto) with(F&& f) const {
    return std::visit(std::forward<F>(f), cycle_);
  }

  [[nodiscard]] bool is_motor(int axis) const {
    return std::ranges::any_of(motors_, [&](const auto& m) { return m.first == axis; });
  }
  /// Reasons not to arm that the axis knows of.
  template <class Axis>
  [[nodiscard]] std::string reported(const Axis& a, bool motor) const {
    std::string out;
    if constexpr (requires { a.encoder_unconnected(); }) {
      if (!motor && a.encoder_unconnected()) {
        out += fmt::format(
            " (node {} reports position 0, as firmware 0.5.6 does until its first closed loop: no passive "
            "encoder)",
            a.node());
      }
    }
    if constexpr (requires { a.refused_endpoint(); }) {
      if (const auto e = a.refused_endpoint())
        out += fmt::format(" (node {}, {})", a.node(), endpoint_path(*e));
    }
    if constexpr (requires { a.contradicting_object(); }) {
      if (const auto o = a.contradicting_object())
        out += fmt::format(" (node {}, object {:04X}:{:02X})", a.node(), o->index, o->sub);
    }
    return out;
  }
  /// Adds what axis i knows of the fault.
  template <class Axis>
  void blame(const Axis& a, int i) {
    FaultRecord& f = *fault_;
    const int joint = axis_count_ == M::joints ? i : i * (M::joints / 2);
    const std::string node = fmt::format("node {}", nodes_[static_cast<std::size_t>(i)]);
    const auto put = [&](std::optional<double> measured, std::optional<double> limit, const char* unit) {
      f.where = fmt::format("{}, {}", World::joint_names[joint], node);
      f.measured = measured;
      f.limit = limit;
      f.unit = unit;
    };
    if (f.where == World::joint_names[joint]) f.where += ", " + node;
    const auto is = [&](Fault fault) { return f.name == name(fault); };
    const double age = a.heartbeat_age_ticks() * scene_.tick();
    if (is(Fault::emergency_stop) && a.emergency_stopped()) put({}, {}, "");
    if (is(Fault::drive_configuration) && a.config_mismatch()) put({}, {}, "");
    if (!is_motor(i)) return;
    if (is(Fault::drive_error) && a.error()) put(a.error_code(), {}, "as error code of the drive");
    if (is(Fault::drive_disarmed) && !a.closed_loop()) put({}, {}, "");
    if (is(Fault::heartbeat_lost) && age > scene_.drives.heartbeat_timeout)
      put(age, scene_.drives.heartbeat_timeout, "s without a heartbeat");
    if (is(Fault::stale_feedback) && f.where.empty() &&
        a.sample_age_ticks() > static_cast<std::uint32_t>(scene_.limits.max_age_ticks))
      put(a.sample_age_ticks(), scene_.limits.max_age_ticks, "ticks without a sample");
    if constexpr (requires { a.observed_torque(); }) {
      if (const auto seen = a.observed_torque(); is(Fault::torque_mismatch) && seen) {
        const double off = std::abs(static_cast<double>(*seen) - expected_[joint]);
        if (off > f.measured.value_or(0.0)) put(off, scene_.drives.torque_mismatch, "N m from its command");
      }
    }
  }
  /// The vendor's name of an endpoint of the scene.
  [[nodiscard]] std::string endpoint_path(std::uint16_t id) const {
    if (id == drive::OdriveReadBack::version_endpoint) return "version of the firmware";
    if (endpoints_) {
      for (const OdriveEndpoint& e : endpoints_->list) {
        if (e.id == id) return odrive_values[static_cast<std::size_t>(e.value)].path;
      }
    }
    return fmt::format("endpoint {}", id);
  }

  ReferenceBundle<S> reference_;
  Bus& bus_;
  bool lockstep_;
  std::vector<std::pair<int, int>> motors_;  // axis and node of each
  int axis_count_;
  std::optional<OdriveEndpoints> endpoints_;
  int shutdown_ticks_;
  AnyCycle<C> cycle_;
  TickResult<M> result_{};
  Sample<M> sample_{};  // of a controller in another scalar type
  const Scene& scene_;
  std::vector<int> nodes_;  // per axis
  FaultFinder<World> finder_;
  std::optional<FaultRecord> fault_;
  Vec<double, M::joints> expected_ =
      Vec<double, M::joints>::Zero();  // torques as TorqueFeedbackCheck has them
};

}  // namespace esmc::host
