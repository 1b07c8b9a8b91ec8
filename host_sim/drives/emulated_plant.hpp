#pragma once
/// The plant's end of the bus: mechanism, emulated drives, and the brake that holds the mechanism until every
/// motor has confirmed torque control.
///
/// A tick: publish (heartbeats, samples), then the frames of the controller (collect, or hand_over one by
/// one), then advance under the torques that the drives have been told.

#include <algorithm>
#include <cstdint>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "host_sim/drives/actuators.hpp"
#include "host_sim/drives/placed_axes.hpp"
#include "host_sim/plant/motion.hpp"

namespace esmc::host {

/// A drive on the joint that it turns.
struct SeatedAxis {
  PlacedAxis placed;
  std::unique_ptr<EmulatedAxis> drive;
  bool answered = false;  ///< its torque command of the tick has come
};
/// The drives of a scene as power-up leaves them, in the order of [drives].
[[nodiscard]] inline std::vector<SeatedAxis> make_axes(const Scene& scene, bool lockstep) {
  std::vector<SeatedAxis> out;
  for (const PlacedAxis& a : placed_axes(scene)) out.push_back({a, make_axis(scene, a, lockstep)});
  return out;
}

template <class Plant>
class EmulatedPlant {
 public:
  using Joints = typename Plant::Joints;
  using Reading = Shaft;

  /// `lockstep`: a tick of the drives is one of the controller's.
  EmulatedPlant(Motion<Plant> motion, const Scene& scene, bool lockstep = true)
      : EmulatedPlant(std::move(motion), scene, make_axes(scene, lockstep)) {}
  /// Takes the drives `axes` instead of the scene's. They begin at rest in the plant's present pose.
  EmulatedPlant(Motion<Plant> motion, const Scene& scene, std::vector<SeatedAxis> axes)
      : motion_(std::move(motion)),
        axes_(std::move(axes)),
        actuators_(scene.effects, scene.motor_joints(), scene.seed),
        tick_(scene.tick()) {
    const Joints angle = Plant::joint_angles(motion_.state().angle);
    for (SeatedAxis& a : axes_) a.drive->settle(angle[static_cast<std::size_t>(a.placed.joint)]);
  }

  [[nodiscard]] Motion<Plant>& motion() { return motion_; }
  [[nodiscard]] const Motion<Plant>& motion() const { return motion_; }
  [[nodiscard]] std::vector<SeatedAxis>& axes() { return axes_; }  ///< in the order of [drives]
  [[nodiscard]] const std::vector<SeatedAxis>& axes() const { return axes_; }
  /// Replaces the mechanism's motion and the effects on its actuators; the drives keep their state.
  void set_motion(Motion<Plant> motion, const Scene& scene) {
    motion_ = std::move(motion);
    actuators_ = Actuators<Plant>(scene.effects, scene.motor_joints(), scene.seed);
  }
  /// Replaces a drive by one as after power-up, on a shaft at rest at its present angle.
  void restart_drive(std::size_t axis, const Scene& scene, bool lockstep) {
    SeatedAxis& a = axes_[axis];
    a.drive = make_axis(scene, a.placed, lockstep);
    a.drive->settle(shaft(a).angle);
  }

  /// True from t = 0 on: every motor has confirmed torque control in two reports, and the brake is off.
  [[nodiscard]] bool released() const { return released_; }
  /// Closes the brake until every motor has confirmed torque control again.
  void close_brake() { released_ = false; }
  /// Virtual time since the start of arming, s.
  [[nodiscard]] double time() const { return static_cast<double>(ticks_) * tick_; }

  /// Begins a tick: the brake opens if every motor has confirmed; time() grows by a tick.
  void begin_tick() {
    released_ = released_ || all_motors([](const EmulatedAxis& d) { return d.confirmations() >= 2; });
    ++ticks_;
  }
  /// Every drive sends its reports of the tick. `send(axis, frame)`; `sense(axis, Reading)` returns the
  /// reading of its encoder, or none where the drive has no power.
  template <class Send, class Sense>
  void publish(const Send& send, const Sense& sense) {
    for (std::size_t i = 0; i < axes_.size(); ++i) {
      SeatedAxis& a = axes_[i];
      a.answered = false;
      const Reading now = shaft(a);
      const std::optional<Reading> seen = sense(i, Reading{now.angle, released_ ? now.rate : 0.0});
      if (seen) a.drive->publish(seen->angle, seen->rate, [&](const hal::CanFrame& f) { send(i, f); });
    }
  }
  /// Begins a tick in which every drive reports its true state; `send(axis, frame)` takes each frame.
  template <class Send>
  void publish_from(const Send& send) {
    begin_tick();
    publish(send, [](std::size_t, const Reading& now) { return std::optional(now); });
  }
  /// Begins a tick as publish_from does, with all frames to `bus`; one that it does not take is lost.
  template <hal::CanBus Bus>
  void publish(Bus& bus) {
    publish_from([&](std::size_t, const hal::CanFrame& f) { (void)bus.try_send(f); });
  }

  /// Gives one drive a frame that it has received; its replies go to `send(axis, frame)`.
  template <class Send>
  void hand_over(std::size_t axis, const hal::CanFrame& f, const Send& send) {
    SeatedAxis& a = axes_[axis];
    a.answered = a.drive->receive(f, [&](const hal::CanFrame& reply) { send(axis, reply); }) || a.answered;
  }
  static constexpr int frames_at_once = 4096;  ///< read before the caller checks its deadline again
  /// Reads frames until every motor has its torque of this tick (later ones belong to the next), none waits,
  /// or frames_at_once are read. Judge by answered().
  template <hal::CanBus Bus>
  void collect(Bus& bus) {
    for (int n = 0; n < frames_at_once && !answered() && take_frame(bus, [](const hal::CanFrame&) {}); ++n) {
    }
  }
  /// Reads the waiting frames, at most frames_at_once. Returns the number of commands to these drives.
  template <hal::CanBus Bus>
  int drain(Bus& bus) {
    int commands = 0;
    const auto count = [&](const hal::CanFrame& f) {
      for (const SeatedAxis& a : axes_) commands += a.drive->commanded_by(f) ? 1 : 0;
    };
    for (int n = 0; n < frames_at_once && take_frame(bus, count); ++n) {
    }
    return commands;
  }
  /// Whether every motor has received a torque command since publish().
  [[nodiscard]] bool answered() const {
    return std::ranges::all_of(axes_, [](const SeatedAxis& a) { return !a.placed.motor || a.answered; });
  }

  /// Torques that the drives have been commanded, N m at the joints.
  [[nodiscard]] Joints asked() const {
    Joints out{};
    for (const SeatedAxis& a : axes_) {
      if (a.placed.motor) out[static_cast<std::size_t>(a.placed.joint)] = a.drive->joint_torque();
    }
    return out;
  }
  /// Torques (N m) that the drives deliver of `asked` over `seconds`. Call once before each advance(). Sets
  /// `clipped` where a limit acts, never clears it.
  [[nodiscard]] Joints deliver(const Joints& asked, double seconds, bool& clipped) {
    return actuators_.deliver(asked, seconds, clipped);
  }
  /// Moves the mechanism from t over `seconds` in steps no longer than `step`, s, under `torque` (N m at the
  /// joints, from deliver()); no effect until released().
  void advance(double t, double seconds, double step, const Joints& torque) {
    if (released_) actuators_.advance(motion_, t, seconds, step, torque);
  }
  [[nodiscard]] int state_dimension() const { return motion_.state_dimension() + actuators_.states(); }

  /// Whether every motor is in torque control.
  [[nodiscard]] bool closed_loop() const {
    return all_motors([](const EmulatedAxis& d) { return d.closed_loop(); });
  }
  /// Whether a motor is out of torque control after the release.
  [[nodiscard]] bool disarmed() const { return released_ && !closed_loop(); }
  /// Whether, after the release, a motor is in torque control whose watchdog has set its torque to zero.
  [[nodiscard]] bool timed_out() const {
    return released_ && !all_motors([](const EmulatedAxis& d) { return !d.timed_out(); });
  }
  /// Whether a drive reports an error.
  [[nodiscard]] bool failed() const { return drive_errors() != 0; }
  /// Error words of all drives, or-ed.
  [[nodiscard]] std::uint32_t drive_errors() const {
    std::uint32_t bits = 0;
    for (const SeatedAxis& a : axes_) bits |= a.drive->error();
    return bits;
  }

 private:
  [[nodiscard]] Reading shaft(const SeatedAxis& a) const {
    return motion_.shaft(static_cast<std::size_t>(a.placed.joint));
  }
  template <class Property>
  [[nodiscard]] bool all_motors(const Property& property) const {
    return std::ranges::all_of(axes_,
                               [&](const SeatedAxis& a) { return !a.placed.motor || property(*a.drive); });
  }
  /// Takes a frame from the bus: look(frame), then every drive receives it; a reply that the bus does not
  /// take is lost. False: no frame waits.
  template <hal::CanBus Bus, class Look>
  bool take_frame(Bus& bus, const Look& look) {
    hal::CanFrame f;
    if (!bus.try_receive(f)) return false;
    look(f);
    const auto send = [&](const hal::CanFrame& reply) { (void)bus.try_send(reply); };
    for (SeatedAxis& a : axes_) a.answered = a.drive->receive(f, send) || a.answered;
    return true;
  }

  Motion<Plant> motion_;
  std::vector<SeatedAxis> axes_;
  Actuators<Plant> actuators_;
  double tick_;
  std::uint64_t ticks_ = 0;
  bool released_ = false;
};

}  // namespace esmc::host
