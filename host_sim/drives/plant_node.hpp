#pragma once
/// The plant's end of the bus: mechanism, drives and the brake that holds the mechanism until they are armed.
///
/// One lockstep tick:  publish (heartbeats, encoder estimates)  ->  collect until every motor has its torque
/// ->  advance over the tick with those torques.

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "host_sim/drives/actuators.hpp"
#include "host_sim/drives/placed_axes.hpp"
#include "host_sim/plant/motion.hpp"

namespace esmc::host {

template <class Plant>
class PlantNode {
 public:
  using Joints = typename Plant::Joints;

  /// `lockstep`: a tick of the drives is one of the controller's.
  PlantNode(Motion<Plant> motion, const Scene& scene, bool lockstep = true)
      : motion_(std::move(motion)),
        actuators_(scene.effects, scene.motor_joints(), scene.seed),
        tick_(scene.tick()) {
    const Joints angle = Plant::joint_angles(motion_.state().angle);
    for (const PlacedAxis& a : placed_axes(scene)) {
      axes_.push_back({a, make_axis(scene, a, lockstep), false});
      axes_.back().axis->settle(angle[static_cast<std::size_t>(a.joint)]);
    }
  }

  [[nodiscard]] Motion<Plant>& motion() { return motion_; }

  /// True from t = 0 on: every motor has confirmed closed-loop control in two heartbeats, and the brake is
  /// off.
  [[nodiscard]] bool released() const { return released_; }
  /// Virtual time since the start of arming, s.
  [[nodiscard]] double time() const { return static_cast<double>(published_) * tick_; }

  /// Begins a tick: every drive says how it is and where its shaft stands.
  template <hal::CanBus Bus>
  void publish(Bus& bus) {
    publish_from(
        [&](std::size_t, const hal::CanFrame& f) { (void)bus.try_send(f); });  // the tap counts losses
  }
  /// The same where every drive has an end of the bus of its own: `send(axis, frame)`.
  template <class Send>
  void publish_from(const Send& send) {
    released_ = released_ || armed();
    for (std::size_t i = 0; i < axes_.size(); ++i) {
      Axis& a = axes_[i];
      a.answered = false;
      const auto shaft = motion_.shaft(static_cast<std::size_t>(a.placed.joint));
      a.axis->publish(shaft.angle, released_ ? shaft.rate : 0.0, [&](const hal::CanFrame& f) { send(i, f); });
    }
    ++published_;
  }
  /// A frame that one drive has received.
  template <class Send>
  void hand_over(std::size_t axis, const hal::CanFrame& f, const Send& send) {
    Axis& a = axes_[axis];
    a.answered = a.axis->receive(f, [&](const hal::CanFrame& reply) { send(axis, reply); }) || a.answered;
  }
  [[nodiscard]] std::size_t axes() const { return axes_.size(); }

  static constexpr int frames_at_once = 4096;  ///< then the caller looks at its deadline again

  /// Hands waiting frames to the drives, up to the one that completes this tick's torques: what comes after
  /// belongs to the next tick.
  template <hal::CanBus Bus>
  void collect(Bus& bus) {
    for (int n = 0; n < frames_at_once && !answered() && take(bus); ++n) {
    }
  }
  /// Hands over all that waits. Returns how many commands to our drives were among it: frames of others are
  /// no sign of a controller.
  template <hal::CanBus Bus>
  int drain(Bus& bus) {
    int commands = 0;
    const auto count = [&](const hal::CanFrame& f) {
      for (const Axis& a : axes_) commands += a.axis->commanded_by(f) ? 1 : 0;
    };
    for (int n = 0; n < frames_at_once && take(bus, count); ++n) {
    }
    return commands;
  }

  /// Every motor got a torque setpoint since publish().
  [[nodiscard]] bool answered() const {
    for (const Axis& a : axes_) {
      if (a.placed.motor && !a.answered) return false;
    }
    return true;
  }

  /// Torque at the joints for the next `seconds`, after what the drives can deliver. Call once before
  /// advance().
  [[nodiscard]] Joints torque(double seconds, bool& clipped) { return deliver(asked(), seconds, clipped); }
  /// The same for what the drives were told at another time.
  [[nodiscard]] Joints deliver(const Joints& asked, double seconds, bool& clipped) {
    return actuators_.deliver(asked, seconds, clipped);
  }
  /// What the drives have been told, N m at the joints.
  [[nodiscard]] Joints asked() const {
    Joints out{};
    for (const Axis& a : axes_) {
      if (a.placed.motor) out[static_cast<std::size_t>(a.placed.joint)] = a.axis->joint_torque();
    }
    return out;
  }

  /// Moves over `seconds` in steps no longer than `step`; the brake holds until released.
  void advance(double t, double seconds, double step, const Joints& torque) {
    if (released_) actuators_.advance(motion_, t, seconds, step, torque);
  }
  [[nodiscard]] int state_dimension() const { return motion_.state_dimension() + actuators_.states(); }

  /// A motor that has left closed-loop control after the release.
  [[nodiscard]] bool disarmed() const { return released_ && !all_closed_loop(); }
  /// Likewise of one that stays in it, with zero torque, because it hears no commands.
  [[nodiscard]] bool timed_out() const {
    for (const Axis& a : axes_) {
      if (released_ && a.placed.motor && a.axis->timed_out()) return true;
    }
    return false;
  }
  [[nodiscard]] std::uint32_t drive_errors() const {
    std::uint32_t bits = 0;
    for (const Axis& a : axes_) bits |= a.axis->error();
    return bits;
  }

 private:
  struct Axis {
    PlacedAxis placed;
    std::unique_ptr<EmulatedAxis> axis;
    bool answered;
  };
  template <hal::CanBus Bus>
  bool take(Bus& bus) {
    return take(bus, [](const hal::CanFrame&) {});
  }
  template <hal::CanBus Bus, class Look>
  bool take(Bus& bus, const Look& look) {
    hal::CanFrame f;
    if (!bus.try_receive(f)) return false;
    look(f);
    const auto send = [&](const hal::CanFrame& reply) { (void)bus.try_send(reply); };
    for (Axis& a : axes_) a.answered = a.axis->receive(f, send) || a.answered;
    return true;
  }
  [[nodiscard]] bool armed() const {
    for (const Axis& a : axes_) {
      if (a.placed.motor && a.axis->confirmations() < 2) return false;
    }
    return true;
  }
  [[nodiscard]] bool all_closed_loop() const {
    for (const Axis& a : axes_) {
      if (a.placed.motor && !a.axis->closed_loop()) return false;
    }
    return true;
  }

  Motion<Plant> motion_;
  std::vector<Axis> axes_;
  Actuators<Plant> actuators_;
  double tick_;
  std::uint64_t published_ = 0;
  bool released_ = false;
};

}  // namespace esmc::host
