#pragma once
/// A control cycle on a fake bus with drives made of bytes: obedient axes that answer requests with the state
/// asked for, and report the joint angles a test chooses. No codec, no model of the firmware is used here.

#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include "firmware/cycle/instances.hpp"
#include "tests/support/cycle_setup.hpp"
#include "tests/support/fake_bus.hpp"
#include "tests/support/odrive_bytes.hpp"

namespace esmc::test {

// ---- the rig

template <class M, class Bus = FakeBus>
class Rig {
 public:
  using S = typename M::Scalar;
  static constexpr std::size_t axes_max = static_cast<std::size_t>(M::joints);

  explicit Rig(const Setup<M>& s = setup<M>())
      : angle(s.angle),
        rate(s.rate),
        controller_(s.controller),
        cycle(config(s, axes(s))),
        axes_(axes(s)),
        gear_(s.gear) {
    state.fill(axis_idle);
    sends_encoder.fill(true);
    sends_heartbeat.fill(true);
  }

  [[nodiscard]] std::size_t axis_count() const { return axes_; }
  [[nodiscard]] std::size_t motors() const { return static_cast<std::size_t>(controller_.motor_count()); }
  /// Joint of axis i, and axis of motor i: with four axes one per joint, with two those of the base.
  [[nodiscard]] std::size_t joint_of(std::size_t axis) const { return axis * (axes_max / axes_); }
  [[nodiscard]] std::size_t axis_of_motor(std::size_t motor) const { return motor * (axes_ / motors()); }
  static unsigned node(std::size_t axis) { return mountings[axis].node; }

  void push_encoder(std::size_t axis) {
    const Mounting& m = mountings[axis];
    const double per_turn = m.direction * gear_[axis] / turn;
    bus.push(encoder(m.node, static_cast<float>((angle[joint_of(axis)] - m.offset) * per_turn),
                     static_cast<float>(rate[joint_of(axis)] * per_turn)));
  }
  void push_heartbeat(std::size_t axis) { bus.push(heartbeat(node(axis), state[axis], error[axis])); }

  /// One tick as a healthy bus brings it: a heartbeat and a sample per axis, unless told otherwise.
  TickResult<M> tick(Command c = Command::none, bool answer = true) {
    for (std::size_t i = 0; i < axes_; ++i) {
      if (sends_heartbeat[i]) push_heartbeat(i);
      if (sends_encoder[i]) push_encoder(i);
    }
    return bare_tick(c, answer);
  }
  /// One tick with what the test has queued and nothing else.
  TickResult<M> bare_tick(Command c = Command::none, bool answer = true) {
    bus.clear();
    cycle.receive(bus);
    if (c != Command::none) cycle.command(c);
    const TickResult<M> r = cycle.tick(bus, answer);
    if (obedient) obey();
    return r;
  }
  /// Healthy ticks until the cycle is in this state; false if it is not within `ticks`.
  bool until(State wanted, int ticks = 20) {
    for (int i = 0; i < ticks && cycle.supervisor().state() != wanted; ++i) tick();
    return cycle.supervisor().state() == wanted;
  }
  /// Enables and ticks up to the first tick that runs.
  bool start(int ticks = 20) {
    tick(Command::enable);
    return until(State::running, ticks);
  }

  /// Torque frames of the last tick to the node of an axis, and all of them.
  [[nodiscard]] int torque_frames(std::size_t axis) const { return count(axis, cmd_torque); }
  [[nodiscard]] int torque_frames() const {
    int n = 0;
    for (const auto& f : bus.sent()) n += command_of(f) == cmd_torque ? 1 : 0;
    return n;
  }
  /// What the last torque frame of the tick told the axis, N m at the shaft; NaN without one.
  [[nodiscard]] float shaft_torque(std::size_t axis) const {
    float torque = NAN;
    for (const auto& f : bus.sent()) {
      if (node_of(f) == node(axis) && command_of(f) == cmd_torque) torque = real(f, 0);
    }
    return torque;
  }
  /// True when every motor was told exactly zero in the last tick, once each.
  [[nodiscard]] bool all_zero() const {
    bool zero = torque_frames() == static_cast<int>(motors());
    for (std::size_t i = 0; i < motors(); ++i) {
      zero = zero && torque_frames(axis_of_motor(i)) == 1 && shaft_torque(axis_of_motor(i)) == 0.0F;
    }
    return zero;
  }
  [[nodiscard]] bool asked(std::size_t axis, std::uint8_t wanted) const {
    bool yes = false;
    for (const auto& f : bus.sent()) {
      yes = yes || (node_of(f) == node(axis) && command_of(f) == cmd_axis_state && word(f, 0) == wanted);
    }
    return yes;
  }
  [[nodiscard]] int count(std::size_t axis, unsigned command) const {
    int n = 0;
    for (const auto& f : bus.sent()) n += node_of(f) == node(axis) && command_of(f) == command ? 1 : 0;
    return n;
  }
  [[nodiscard]] const ControllerConfig<M>& controller() const { return controller_; }

  std::array<double, axes_max> angle, rate;
  std::array<std::uint8_t, axes_max> state{};
  std::array<std::uint32_t, axes_max> error{};
  std::array<bool, axes_max> sends_encoder{}, sends_heartbeat{};
  bool obedient = true;  ///< axes go to the state they are asked for
  Bus bus;

 private:
  static std::size_t axes(const Setup<M>& s) {
    const bool all = s.controller.motors == Motors::all || s.controller.sensors == Sensors::all;
    return all ? axes_max : 2;
  }
  static typename OdriveCycle<M>::Config config(const Setup<M>& s, std::size_t axes) {
    typename OdriveCycle<M>::Config c;
    c.controller = s.controller;
    c.controller.allocate = allocation_for<M>(c.controller.motors);
    for (std::size_t i = 0; i < axes; ++i) {
      const Mounting& m = mountings[i];
      c.axes[i] = drive::OdriveAxis({m.node, static_cast<float>(m.direction), static_cast<float>(s.gear[i]),
                                     static_cast<float>(m.offset)},
                                    s.version, s.retry_ticks);
    }
    c.axis_count = static_cast<int>(axes);
    c.heartbeat_age_ticks_max = s.heartbeat_age_ticks_max;
    c.torque_mismatch = static_cast<S>(s.torque_mismatch);
    c.samples_timed = s.samples_timed;
    c.confirmed = s.confirmed;
    c.zero_absolute = s.zero_absolute;
    c.zero_pose = s.zero_pose;
    c.homing = s.homing;
    c.link = s.link;
    return c;
  }
  void obey() {
    for (const auto& f : bus.sent()) {
      for (std::size_t i = 0; i < axes_; ++i) {
        if (node_of(f) == node(i) && command_of(f) == cmd_axis_state) {
          state[i] = static_cast<std::uint8_t>(word(f, 0));
        }
      }
    }
  }

  ControllerConfig<M> controller_;

 public:
  OdriveCycle<M> cycle;

 private:
  std::size_t axes_;
  std::array<double, 4> gear_;
};

}  // namespace esmc::test
