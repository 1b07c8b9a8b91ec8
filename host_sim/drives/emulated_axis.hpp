#pragma once
/// What every emulated drive does: it reports its shaft, takes commands from the bus and turns them into
/// torque. Written from the drives' documents, with wire formats shared with the firmware and nothing else.

#include <cstdint>
#include <functional>
#include <numbers>

#include "hal/can.hpp"

namespace esmc::host {

/// How the motor sits in the mechanism: model angle = direction * shaft angle / gear_ratio + offset.
struct AxisMount {
  int node = 0;
  double direction = 1.0, gear_ratio = 1.0, offset = 0.0;

  [[nodiscard]] double rev_per_rad() const { return direction * gear_ratio / (2.0 * std::numbers::pi); }
};

class EmulatedAxis {
 public:
  using Send = std::function<void(const hal::CanFrame&)>;

  virtual ~EmulatedAxis() = default;

  /// The joint has rested here for long, rad.
  virtual void settle(double joint_angle) = 0;
  /// One period of the drive: sensor, watchdog, whatever it sends by itself. In lockstep this begins a tick,
  /// and exactly one frame is then the axis' report of the tick.
  virtual void publish(double joint_angle, double joint_rate, const Send& send) = 0;
  /// A frame from the bus; `send` for its replies. Returns true when it completes the command of a tick.
  virtual bool receive(const hal::CanFrame& f, const Send& send) = 0;
  /// True for what a controller sends to this axis and nobody else does: no requests, no emergency stop,
  /// nothing that drives say.
  [[nodiscard]] virtual bool commanded_by(const hal::CanFrame& f) const = 0;

  /// Torque at the joint, N m, model convention: zero unless in torque control.
  [[nodiscard]] virtual double joint_torque() const = 0;
  [[nodiscard]] virtual bool closed_loop() const = 0;
  /// In the words of the drive; 0: none.
  [[nodiscard]] virtual std::uint32_t error() const = 0;
  /// Its watchdog has taken the torque away, and it says nothing of it: a drive for which that is no error.
  [[nodiscard]] virtual bool timed_out() const { return false; }
  /// Reports in a row that said torque control without error, as many as the controller wants to hear or
  /// more.
  [[nodiscard]] virtual int confirmations() const = 0;

 protected:
  EmulatedAxis() = default;
  EmulatedAxis(const EmulatedAxis&) = default;
  EmulatedAxis& operator=(const EmulatedAxis&) = default;
};

}  // namespace esmc::host
