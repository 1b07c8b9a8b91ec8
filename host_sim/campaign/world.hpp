#pragma once
/// Mechanism and drives of an episode, with what can be wrong with a drive or its sensor. The brake holds the
/// mechanism until every motor has confirmed torque control.

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <memory>
#include <utility>
#include <vector>

#include "host_sim/campaign/faulty_bus.hpp"
#include "host_sim/campaign/judge.hpp"
#include "host_sim/drives/actuators.hpp"
#include "host_sim/drives/placed_axes.hpp"
#include "host_sim/plant/motion.hpp"

namespace esmc::host {

template <class Plant>
class World {
 public:
  using Joints = typename Plant::Joints;

  /// `defective`: the same scene with drives that have the defect of the fault, if it is one. `lockstep`: a
  /// tick of the drives is one of the controller's.
  World(Motion<Plant> motion, const Scene& scene, const Scene& defective, const Injection& injection,
        const ProtocolTraits& dialect, bool lockstep = true)
      : motion_(std::move(motion)),
        actuators_(scene.effects, scene.motor_joints(), scene.seed),
        scene_(&scene),
        injection_(&injection),
        dialect_(&dialect),
        lockstep_(lockstep) {
    const Joints angle = Plant::joint_angles(motion_.state().angle);
    const auto places = placed_axes(scene);
    for (std::size_t i = 0; i < places.size(); ++i) {
      axes_.push_back({places[i],
                       make_axis(i == injection.drive ? defective : scene, places[i], lockstep),
                       {},
                       places[i].joint,
                       {},
                       angle[static_cast<std::size_t>(places[i].joint)]});
      nodes_.push_back(places[i].mount.node);
      if (!places[i].motor) continue;
      MotorState& m = axes_[i].state;
      m.limit = scene.torque_limit[i];
      m.step = dialect.torque_step(scene, i);
      m.none = dialect.zero_is_a_step ? 0.0 : 0.5 * m.step * (1.0 + 1e-6);
    }
    if (injection.kind() == Injected::swapped_nodes) std::swap(axes_[0].joint, axes_[1].joint);
    for (Axis& a : axes_) a.axis->settle(angle[static_cast<std::size_t>(a.joint)]);
  }

  [[nodiscard]] const std::vector<int>& nodes() const { return nodes_; }
  [[nodiscard]] const Motion<Plant>& motion() const { return motion_; }
  [[nodiscard]] bool released() const { return released_; }
  /// The mechanism goes on as `motion`, with the effects of `scene`, which lives as long; the drives notice
  /// nothing.
  void go_on(Motion<Plant> motion, const Scene& scene) {
    motion_ = std::move(motion);
    actuators_ = Actuators<Plant>(scene.effects, scene.motor_joints(), scene.seed);
    scene_ = &scene;
  }
  /// Every motor is in torque control.
  [[nodiscard]] bool closed_loop() const {
    return std::all_of(axes_.begin(), axes_.end(),
                       [](const Axis& a) { return !a.placed.motor || a.axis->closed_loop(); });
  }
  /// A drive reports an error.
  [[nodiscard]] bool failed() const {
    return std::any_of(axes_.begin(), axes_.end(), [](const Axis& a) { return a.axis->error() != 0; });
  }
  /// The brake closes, and opens when every motor has confirmed torque control again.
  void hold() { released_ = false; }
  [[nodiscard]] std::size_t motors() const { return static_cast<std::size_t>(scene_->motors()); }
  [[nodiscard]] const MotorState& motor(std::size_t i) const { return axes_[i].state; }
  /// Distance a motor's joint has turned since the last tick, rad.
  [[nodiscard]] double turned(std::size_t i) const { return axes_[i].turned; }

  /// Every drive says how it is and where its shaft stands. `active`: the fault acts; `first`: it begins now.
  void publish(FaultyBus& wire, bool active, bool first) {
    released_ = released_ || armed();
    if (first) strike(wire);
    active_ = active;
    for (std::size_t i = 0; i < axes_.size(); ++i) {
      Axis& a = axes_[i];
      const auto shaft = motion_.shaft(static_cast<std::size_t>(a.joint));
      Shown s{shaft.angle, released_ ? shaft.rate : 0.0};
      a.turned = std::abs(shaft.angle - a.last_angle);
      a.last_angle = shaft.angle;
      if (without_power(i, active)) continue;
      if (i == injection_->drive) s = sensed(a, s, active, first);
      a.axis->publish(s.angle, s.rate, [&](const hal::CanFrame& f) { wire.from_drive(i, f); });
    }
  }

  /// Hands the frames of the tick to the drives, which began at `now_ms`.
  void deliver(FaultyBus& wire, double now_ms) {
    for (Axis& a : axes_) {
      a.state.heard_now = a.state.heard_stranger = a.state.armed_now = false;
      settle_zero(a, now_ms);  // what a watchdog did when the tick began
    }
    for (const FaultyBus::Delivery& d : wire.to_drives()) {
      for (std::size_t i = 0; i < axes_.size(); ++i) {
        if (!wire.hears(i) || without_power(i, active_)) continue;
        Axis& a = axes_[i];
        const bool armed_before = a.axis->closed_loop();
        const bool command = a.axis->commanded_by(d.frame);
        (void)a.axis->receive(d.frame, [&](const hal::CanFrame& f) { wire.from_drive(i, f); });
        if (command && !d.ours) a.state.heard_stranger = a.state.strangers = true;
        if (command && d.ours) {
          a.state.heard_now = true;
          a.state.heard_ms = now_ms + d.ms;
        }
        const bool feeds =
            dialect_->is_sign_of_life != nullptr ? dialect_->is_sign_of_life(*scene_, d.frame) : command;
        if (feeds && d.ours) a.state.fed_ms = now_ms + d.ms;
        a.state.armed_now = a.state.armed_now || (!armed_before && a.axis->closed_loop());
        settle_zero(a, now_ms + d.ms);
      }
    }
  }

  /// Over the tick that began at `t` seconds.
  void advance(double t) { advance(t, scene_->tick()); }
  /// Over a part of it.
  void advance(double t, double seconds) {
    if (!released_) return;
    Joints asked{};
    bool clipped = false;
    for (const Axis& a : axes_) {
      if (a.placed.motor) asked[static_cast<std::size_t>(a.joint)] = a.state.torque;
    }
    actuators_.advance(motion_, t, seconds, scene_->step, actuators_.deliver(asked, seconds, clipped));
  }

 private:
  struct Shown {
    double angle, rate;
  };
  struct Axis {
    PlacedAxis placed;
    std::unique_ptr<EmulatedAxis> axis;
    Shown kept;  ///< what a frozen sensor shows
    int joint;   ///< that it really sits on
    MotorState state;
    double last_angle = 0.0, turned = 0.0;
  };

  /// Drives that are switched on later: one of them, or all.
  [[nodiscard]] bool without_power(std::size_t i, bool active) const {
    return active && injection_->kind() == Injected::late_power &&
           (i == injection_->drive || injection_->choice % 2 == 0);
  }

  /// Faults that happen to a drive once.
  void strike(FaultyBus& wire) {
    Axis& a = axes_[injection_->drive];
    const int node = a.placed.mount.node;
    const auto told = [&](const FewFrames& frames) {
      for (const hal::CanFrame& f : frames.all()) {
        (void)a.axis->receive(f,
                              [&](const hal::CanFrame& reply) { wire.from_drive(injection_->drive, reply); });
      }
    };
    switch (injection_->kind()) {
      case Injected::drive_error:
        told(dialect_->fail(node));
        break;
      case Injected::drive_disarm:
        told(dialect_->disarm(node));
        break;
      case Injected::drive_reset:
        a.axis = make_axis(*scene_, a.placed, lockstep_);
        a.axis->settle(motion_.shaft(static_cast<std::size_t>(a.joint)).angle);
        break;
      default:
        break;
    }
  }

  Shown sensed(Axis& a, Shown s, bool active, bool first) const {
    if (first) a.kept = s;
    if (!active) return s;
    switch (injection_->kind()) {
      case Injected::frozen_sensor:
        // The angle alone, or both; the speed of a stuck counter may be shown as zero as well.
        if (injection_->choice % 3 == 0) return {a.kept.angle, s.rate};
        return {a.kept.angle, injection_->choice % 3 == 1 ? a.kept.rate : 0.0};
      case Injected::sensor_jump:
      case Injected::sensor_step:
        return {s.angle + injection_->amount, s.rate};
      case Injected::sensor_flipped:
        return {-s.angle, -s.rate};
      default:
        return s;
    }
  }

  static void settle_zero(Axis& a, double now_ms) {
    const double torque = a.axis->joint_torque();
    const auto none = [&](double t) { return std::abs(t) <= a.state.none; };
    if (none(torque) && !none(a.state.torque)) a.state.zero_ms = now_ms;
    a.state.torque = torque;
  }

  [[nodiscard]] bool armed() const {
    for (const Axis& a : axes_) {
      if (a.placed.motor && a.axis->confirmations() < 2) return false;
    }
    return true;
  }

  Motion<Plant> motion_;
  Actuators<Plant> actuators_;
  const Scene* scene_;
  const Injection* injection_;
  const ProtocolTraits* dialect_;
  bool lockstep_;
  std::vector<Axis> axes_;
  std::vector<int> nodes_;
  bool released_ = false, active_ = false;
};

}  // namespace esmc::host
