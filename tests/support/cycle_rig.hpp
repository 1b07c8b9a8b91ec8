#pragma once
/// A control cycle on a fake bus with drives made of bytes: obedient axes that answer requests with the state
/// asked for, and report the joint angles a test chooses. No codec, no model of the firmware is used here.

#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include "firmware/cycle/instances.hpp"
#include "tests/support/fake_bus.hpp"
#include "tests/support/odrive_bytes.hpp"

namespace esmc::test {

inline constexpr double turn = 2 * 3.14159265358979323846;

/// How an axis is mounted: written down twice, here for the drive and in AxisConfig for the controller.
struct Mounting {
  std::uint8_t node;
  double direction, gear, offset;
};
inline constexpr std::array<Mounting, 4> mountings{
    {{1, 1.0, 1.0, 0.125}, {9, -1.0, 3.0, -0.25}, {0x21, -1.0, 0.5, 0.5}, {0x3E, 1.0, 8.0, 0.0}}};

/// What a test chooses before it builds a rig.
template <class M>
struct Setup {
  ControllerConfig<M> controller{};
  std::array<double, static_cast<std::size_t>(M::joints)> angle{}, rate{};  ///< of the joints, reported truthfully
  drive::odrive::Version version = drive::odrive::Version::v0_6;
  std::uint32_t retry_ticks = 150;
  std::uint32_t heartbeat_age_ticks_max = 20;
  bool samples_timed = true;
  bool zero_absolute = true;
  Vec<typename M::Scalar, M::joints> zero_pose = Vec<typename M::Scalar, M::joints>::Zero();
  link::LinkConfig link{};
  std::array<double, 4> gear{mountings[0].gear, mountings[1].gear, mountings[2].gear, mountings[3].gear};
};

// ---- the two machines ------------------------------------------------------------------------------------------

/// Joint angles of the leg whose base is at the origin and whose tip is at (x, y), elbow to the side `mode`.
inline std::array<double, 2> dyad_angles(double l1, double l2, double x, double y, int mode) {
  const double second = mode * std::acos((x * x + y * y - l1 * l1 - l2 * l2) / (2 * l1 * l2));
  return {std::atan2(y, x) - std::atan2(l2 * std::sin(second), l1 + l2 * std::cos(second)), second};
}

inline constexpr double half_base = 0.05, bar1 = 0.12, bar2 = 0.16;

/// theta11, theta12, theta21, theta22 with the effector at (x, y), working modes `mode1` and `mode2`.
inline std::array<double, 4> five_bar_angles(double x, double y, int mode1 = 1, int mode2 = 1) {
  const auto a = dyad_angles(bar1, bar2, x - half_base, y, mode1);
  const auto b = dyad_angles(bar1, bar2, -(x + half_base), y, mode2);
  return {a[0], a[1], b[0], b[1]};
}

template <class M>
Setup<M> setup();

template <>
inline Setup<FiveBar<double>> setup<FiveBar<double>>() {
  Setup<FiveBar<double>> s;
  auto& c = s.controller;
  FiveBarParams<double> p{.l0 = half_base, .m0 = 0.05, .g = 9.8, .legs = {}};
  p.legs[0] = {bar1, bar2, 0.06, 0.068, 0.1, 0.11, 2e-4, 7e-4, 0.01, 0.012, 0.0, 0.0};
  p.legs[1] = {bar1, bar2, 0.058, 0.07, 0.12, 0.1, 2.2e-4, 6.5e-4, 0.011, 0.01, 0.0, 0.0};
  c.mechanism = FiveBar<double>(p);
  c.mode = {{{1, 1}}, -1};
  c.gains.lambda.setConstant(20.0);
  c.gains.k.setConstant(8.0);
  c.gains.layer.setConstant(0.7);
  c.gains.independent = {20.0, 8.0, 0.7, 90.0, 15.0};
  c.reference = {.kind = ReferenceKind::circle,
                 .space = ReferenceSpace::effector,
                 .centre = {0.0, 0.17},
                 .amplitude = {0.02, 0.02},
                 .speed = {10.0, 0.0}};
  c.reference.phase[0] = {0, static_cast<std::uint64_t>(10.0 * 1e-3 / turn * 0x1p64)};
  c.limits = {.min_abs_sin_type1 = 0.02, .min_abs_sin_type2 = 0.05, .joint_speed = 50.0, .closure = 1e-3,
              .workspace_x = {-0.3, 0.3}, .workspace_y = {-0.05, 0.3},
              .joint_angle = {{{-3.2, 3.2}, {-3.2, 3.2}}}, .max_age_ticks = 2};
  c.torque_limit.setConstant(2.0);
  c.torque_weight = {1.0, 2.0, 0.5, 1.5};
  c.sample_time = 1e-3;
  s.angle = five_bar_angles(0.015, 0.18);
  return s;
}

template <>
inline Setup<Rr<float>> setup<Rr<float>>() {
  Setup<Rr<float>> s;
  auto& c = s.controller;
  const RrParams<float> p{
      {0.2F, 0.15F, 0.09F, 0.07F, 0.4F, 0.3F, 2e-3F, 1e-3F, 0.01F, 0.01F, 0.0F, 0.0F}, 9.8F};
  c.mechanism = Rr<float>(p);
  c.mode = {1};
  c.gains.lambda.setConstant(20.0F);
  c.gains.k.setConstant(8.0F);
  c.gains.layer.setConstant(0.7F);
  c.gains.independent = {20.0F, 8.0F, 0.7F, 90.0F, 15.0F};
  c.reference = {.kind = ReferenceKind::sine,
                 .space = ReferenceSpace::base_joints,
                 .centre = {0.45F, 0.85F},
                 .amplitude = {0.1F, 0.2F},
                 .speed = {10.0F, 10.0F}};
  c.reference.phase[0] = c.reference.phase[1] = {0, static_cast<std::uint64_t>(10.0 * 1e-3 / turn * 0x1p64)};
  c.limits = {.min_abs_sin_type1 = 0.02F, .min_abs_sin_type2 = 0.05F, .joint_speed = 50.0F, .closure = 1e-3F,
              .workspace_x = {-0.4F, 0.4F}, .workspace_y = {-0.4F, 0.4F},
              .joint_angle = {{{-3.2F, 3.2F}, {-3.2F, 3.2F}}}, .max_age_ticks = 2};
  c.torque_limit.setConstant(3.0F);
  c.sample_time = 1e-3F;
  s.angle = {0.4, 0.9};
  return s;
}

// ---- the rig ---------------------------------------------------------------------------------------------------

template <class M, class Bus = FakeBus>
class Rig {
 public:
  using S = typename M::Scalar;
  static constexpr std::size_t axes_max = static_cast<std::size_t>(M::joints);

  explicit Rig(const Setup<M>& s = setup<M>())
      : angle(s.angle), rate(s.rate), controller_(s.controller), cycle(config(s, axes(s))), axes_(axes(s)), gear_(s.gear) {
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
    for (std::size_t i = 0; i < axes; ++i) {
      const Mounting& m = mountings[i];
      c.axes[i] = drive::OdriveAxis({m.node, static_cast<float>(m.direction), static_cast<float>(s.gear[i]),
                                     static_cast<float>(m.offset)},
                                    s.version, s.retry_ticks);
    }
    c.axis_count = static_cast<int>(axes);
    c.heartbeat_age_ticks_max = s.heartbeat_age_ticks_max;
    c.samples_timed = s.samples_timed;
    c.zero_absolute = s.zero_absolute;
    c.zero_pose = s.zero_pose;
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
