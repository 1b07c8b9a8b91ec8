#pragma once
/// The firmware's controller on the simulator's plant, tick by tick as `esmc sim` does it: B7 of
/// reference/benchmarks.md unless told otherwise.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <numbers>
#include <optional>
#include <vector>

#include "firmware/cycle/instances.hpp"
#include "host_sim/drives/actuators.hpp"
#include "host_sim/effects/shaft_sensor.hpp"
#include "host_sim/plant/kinematics.hpp"
#include "host_sim/plant/motion.hpp"

namespace esmc::test {

inline FiveBarParams<double> b7_mechanism(double gravity = 9.8) {
  const LegParams<double> leg{0.12, 0.16, 0.06, 0.068, 0.1, 0.1, 2e-4, 7e-4};
  return {0.05, 0.0, gravity, {leg, leg}};
}

/// Masses, inertias and mass centres times `factor`: what a controller may wrongly believe.
inline FiveBarParams<double> scaled_bars(FiveBarParams<double> p, double factor) {
  p.m0 *= factor;
  for (auto& leg : p.legs) {
    for (double* v : {&leg.m1, &leg.m2, &leg.J1, &leg.J2, &leg.lg1, &leg.lg2}) *v *= factor;
  }
  return p;
}

struct LoopSetup {
  FiveBarParams<double> truth = b7_mechanism(), believed = b7_mechanism();
  LawKind law = LawKind::esmc;
  Reaching reaching = Reaching::implicit;
  double lambda = 40.0, gain = 150.0, layer = 1.0;  ///< layer: not of the implicit law
  double told_delay = 0.0;                          ///< ticks, for the implicit law
  double kp = 1600.0, kd = 80.0;                    ///< ctc
  double tick = 1e-3, torque_limit = 2.0;
  double radius = 0.07, speed = 10.0;            ///< of the circle about (0, 0.17)
  std::optional<host::V2> hold{};                ///< rest here instead
  std::optional<Reference<double>> reference{};  ///< this instead
  std::optional<host::V2> start{};               ///< at rest here; else where the reference begins
  std::vector<host::Effect> effects{};
  Motors motors = Motors::base;
  Sensors sensors = Sensors::base;
  double min_type2 = 0.05;
  int substeps = 2;
  HomingConfig<double> homing{};
  std::function<void(Vec<double, 4>&)> wiring{};                     ///< what the cables make of the torques
  std::function<void(ControllerConfig<FiveBar<double>>&)> adjust{};  ///< the last word on the configuration
};

inline ControllerConfig<FiveBar<double>> controller_of(const LoopSetup& s) {
  ControllerConfig<FiveBar<double>> c;
  c.mechanism = FiveBar<double>(s.believed);
  c.mode = {{{1, 1}}, -1};
  c.law = s.law;
  c.reaching = s.reaching;
  const double layer =
      s.reaching == Reaching::implicit ? implicit_layer(s.gain, s.tick, s.told_delay) : s.layer;
  c.gains.lambda.setConstant(s.lambda);
  c.gains.k.setConstant(s.gain);
  c.gains.layer.setConstant(layer);
  c.gains.independent = {s.lambda, s.gain, layer, s.kp, s.kd};
  if (s.reference) {
    c.reference = *s.reference;
  } else if (s.hold) {
    c.reference = {.kind = ReferenceKind::path, .centre = {s.hold->x, s.hold->y}};
  } else {
    c.reference = {.kind = ReferenceKind::circle,
                   .centre = {0.0, 0.17},
                   .amplitude = {s.radius, s.radius},
                   .speed = {s.speed, s.speed}};
    const double turns = s.speed * s.tick / (2.0 * std::numbers::pi);
    c.reference.phase[0] = {0, static_cast<std::uint64_t>(std::ldexp(turns, 64))};
  }
  c.limits = {
      .min_abs_sin_type1 = 0.02, .min_abs_sin_type2 = s.min_type2, .joint_speed = 50.0, .closure = 1e-3};
  c.torque_limit.setConstant(s.torque_limit);
  c.torque_weight.setConstant(0.25);
  c.sample_time = s.tick;
  c.motors = s.motors;
  c.allocate = allocation_for<FiveBar<double>>(s.motors);
  c.sensors = s.sensors;
  if (s.adjust) s.adjust(c);
  return c;
}

class ControlLoop {
 public:
  using M = FiveBar<double>;
  using Plant = host::FiveBarPlant;

  explicit ControlLoop(const LoopSetup& s) : ControlLoop(s, start_angles(s)) {}
  ControlLoop(const LoopSetup& s, const std::array<double, 4>& theta)
      : setup_(s),
        controller_(controller_of(s)),
        supervisor_(controller_.supervision()),
        homing_(s.homing, s.tick, controller_.config().halt_ticks),
        motion_({Plant(s.truth), Plant(s.truth), s.effects, motor_joints(s), host::Method::rk4},
                Plant::from_joints(theta, {})),
        actuators_(s.effects, motor_joints(s), 1) {
    const host::SensorEffects effects(s.effects);
    exact_ = effects.none();
    for (int joint = 0; joint < 4; ++joint) {
      sensor_.emplace_back(effects, s.tick, per_radian, joint, 1);
      sensor_.back().settle({theta[static_cast<std::size_t>(joint)] * per_radian, 0.0});
    }
    supervisor_.begin_tick(Command::enable, {});
  }

  /// One tick: measure, compute, move the plant.
  const TickResult<M>& tick(Command command = Command::none, DriveStatus drives = {true, false}) {
    supervisor_.begin_tick(command, drives, result_.stage_done);
    for (int joint = 0; joint < 4; ++joint) {
      const auto u = static_cast<std::size_t>(joint);
      const auto shaft = motion_.shaft(u);
      sample_.angle[joint] = shaft.angle;
      sample_.rate[joint] = shaft.rate;
      if (exact_) continue;
      const auto r = sensor_[u].read({shaft.angle * per_radian, shaft.rate * per_radian});
      sample_.angle[joint] = r.position_rev / per_radian;
      sample_.rate[joint] = r.velocity_rev_s / per_radian;
    }
    result_ = supervisor_.homing() ? controller_.home(sample_, supervisor_, homing_)
                                   : controller_.tick(sample_, supervisor_);
    Vec<double, 4> tau = result_.torque;
    if (setup_.wiring) setup_.wiring(tau);
    bool clipped = false;
    const auto torque = actuators_.deliver({tau[0], tau[1], tau[2], tau[3]}, setup_.tick, clipped);
    actuators_.advance(motion_, n_ * setup_.tick, setup_.tick, setup_.tick / setup_.substeps, torque);
    ++n_;
    return result_;
  }

  [[nodiscard]] const TickResult<M>& result() const { return result_; }
  [[nodiscard]] const Sample<M>& sample() const { return sample_; }
  [[nodiscard]] const Controller<M>& controller() const { return controller_; }
  [[nodiscard]] const Supervisor& supervisor() const { return supervisor_; }
  [[nodiscard]] Controller<M>& controller() { return controller_; }
  [[nodiscard]] Supervisor& supervisor() { return supervisor_; }
  [[nodiscard]] int ticks() const { return n_; }
  /// Where the mechanism truly is, and how fast it moves.
  [[nodiscard]] Plant::Output truth() const { return motion_.output(); }
  [[nodiscard]] Vec2<double> effector() const {
    const auto o = motion_.output();
    return {o.effector.x, o.effector.y};
  }

  static std::array<double, 4> start_angles(const LoopSetup& s) {
    const host::V2 at = s.start ? *s.start : (s.hold ? *s.hold : host::V2{s.radius, 0.17});
    return host::reach(s.truth, at, {1, 1}).value();
  }
  static std::vector<std::size_t> motor_joints(const LoopSetup& s) {
    return s.motors == Motors::base ? std::vector<std::size_t>{0, 2} : std::vector<std::size_t>{0, 1, 2, 3};
  }

 private:
  static constexpr double per_radian = 0.5 / std::numbers::pi;
  LoopSetup setup_;
  Controller<M> controller_;
  Supervisor supervisor_;
  Homing<double> homing_;
  host::Motion<Plant> motion_;
  host::Actuators<Plant> actuators_;
  std::vector<host::ShaftSensor> sensor_;
  Sample<M> sample_{};
  TickResult<M> result_{};
  int n_ = 0;
  bool exact_ = true;
};

}  // namespace esmc::test
