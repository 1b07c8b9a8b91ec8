#pragma once
/// An emulated drive: reports its shaft, takes commands from the bus and turns them into torque. Written from
/// the drives' documents; shares wire formats with the firmware and nothing else.

#include <cmath>
#include <cstdint>
#include <functional>
#include <numbers>

#include "hal/can.hpp"
#include "host_sim/effects/shaft_sensor.hpp"

namespace esmc::host {

/// How the motor sits in the mechanism: model angle = direction * shaft angle / gear_ratio + offset.
struct AxisMount {
  int node = 0;
  double direction = 1.0, gear_ratio = 1.0, offset = 0.0;  ///< offset: rad

  /// Turns of the shaft per radian of the joint, signed.
  [[nodiscard]] double rev_per_rad() const { return direction * gear_ratio / (2.0 * std::numbers::pi); }
};

class EmulatedAxis {
 public:
  using Send = std::function<void(const hal::CanFrame&)>;

  virtual ~EmulatedAxis() = default;

  /// Resets the sensor to a joint that has been at rest at this angle, rad, for long.
  virtual void settle(double joint_angle) { sensor_.settle(truth(joint_angle, 0.0)); }
  /// Does one period of the drive (sensor, watchdog, periodic frames), its joint at rad and rad/s. In
  /// lockstep this begins a tick, and exactly one of the frames is the axis' report of the tick.
  virtual void publish(double joint_angle, double joint_rate, const Send& send) = 0;
  /// Takes a frame from the bus, of any node; replies go to `send`. True: it completes the command of a tick.
  virtual bool receive(const hal::CanFrame& f, const Send& send) = 0;
  /// True for a command to this axis that only a controller sends: no request, no emergency stop, no frame of
  /// a drive.
  [[nodiscard]] virtual bool commanded_by(const hal::CanFrame& f) const = 0;

  /// Torque at the joint, N m, model convention: zero unless in torque control.
  [[nodiscard]] double joint_torque() const { return shaft_torque() * mount_.direction * mount_.gear_ratio; }
  /// Whether the drive is in torque control.
  [[nodiscard]] virtual bool closed_loop() const = 0;
  /// Error word of the drive; 0: none.
  [[nodiscard]] virtual std::uint32_t error() const = 0;
  /// Whether its watchdog has set the torque to zero, in a protocol that does not report that as an error.
  [[nodiscard]] virtual bool timed_out() const { return false; }
  /// Consecutive reports of torque control without error; the controller waits for two.
  [[nodiscard]] int confirmations() const { return confirmations_; }

 protected:
  /// `joint`: index in the model; with `seed` it decides the noise of the sensor.
  EmulatedAxis(const AxisMount& mount, const SensorEffects& sensor, double period, int joint,
               std::uint64_t seed)
      : mount_(mount), sensor_(sensor, period, mount.rev_per_rad(), joint, seed) {}
  EmulatedAxis(const EmulatedAxis&) = default;
  EmulatedAxis& operator=(const EmulatedAxis&) = default;

  /// N m, before gear and direction.
  [[nodiscard]] virtual double shaft_torque() const = 0;
  [[nodiscard]] ShaftReading truth(double joint_angle, double joint_rate) const {
    return {(joint_angle - mount_.offset) * mount_.rev_per_rad(), joint_rate * mount_.rev_per_rad()};
  }

  [[nodiscard]] std::uint8_t node() const { return static_cast<std::uint8_t>(mount_.node); }

  AxisMount mount_;
  ShaftSensor sensor_;
  ShaftReading reading_{};
  int confirmations_ = 0;
};

/// A shaft with inertia and viscous friction under a load, for a drive that has no mechanism.
struct LoneShaft {
  double inertia = 1e-3;   ///< kg m2, > 0
  double friction = 1e-3;  ///< N m s/rad, >= 0
  double load = 0.0;       ///< N m, against the positive direction, at any speed
  double angle = 0.0;      ///< rad
  double rate = 0.0;       ///< rad/s

  /// Moves the shaft exactly, under a constant torque, N m: inertia dw/dt = torque - load - friction w.
  void advance(double torque, double seconds) {
    const double net = torque - load, x = friction * seconds / inertia;
    if (x < 1e-9) {  // the terms left out are below rounding
      const double acceleration = (net - friction * rate) / inertia;
      angle += seconds * (rate + 0.5 * seconds * acceleration);
      rate += seconds * acceleration;
      return;
    }
    const double last = net / friction, share = -std::expm1(-x);
    angle += last * seconds + (rate - last) * share * inertia / friction;
    rate += (last - rate) * share;
  }
};

}  // namespace esmc::host
