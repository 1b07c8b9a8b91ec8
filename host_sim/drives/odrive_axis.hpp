#pragma once
/// An emulated ODrive axis: the same bytes on the bus, the same rules (closed-loop control, errors,
/// watchdog).

#include <cstdint>
#include <functional>
#include <numbers>
#include <optional>

#include "firmware/drive/odrive.hpp"
#include "hal/can.hpp"
#include "host_sim/effects/shaft_sensor.hpp"

namespace esmc::host {

/// How the motor sits in the mechanism: model angle = direction * 2 pi * position_rev / gear_ratio + offset.
struct AxisMount {
  int node = 0;
  double direction = 1.0, gear_ratio = 1.0, offset = 0.0;

  [[nodiscard]] double rev_per_rad() const { return direction * gear_ratio / (2.0 * std::numbers::pi); }
};

class OdriveAxis {
 public:
  using Version = drive::odrive::Version;
  using Send = std::function<void(const hal::CanFrame&)>;

  struct Settings {
    Version version = Version::v0_6;
    double period = 1e-3;            ///< s of virtual time between calls of publish(): encoder_msg_rate
    double heartbeat_period = 0.01;  ///< s, heartbeat_msg_rate
    double watchdog_timeout = 0.01;  ///< s; config.enable_watchdog is set
  };

  /// `joint`: which one of the model the shaft turns; `seed`: of its sensor noise.
  OdriveAxis(const AxisMount& mount, const Settings& settings, const SensorEffects& sensor, int joint,
             std::uint64_t seed);

  /// The joint has rested here for long.
  void settle(double joint_angle);
  /// One period of the drive: watchdog, heartbeat when due, encoder estimates.
  void publish(double joint_angle, double joint_rate, const Send& send);
  /// A frame from the bus. RTR requests are answered. Returns true when it was a torque setpoint of this
  /// axis.
  bool receive(const hal::CanFrame& f, const Send& send);

  /// True for what a controller sends to this axis, and nobody else does: no requests, no emergency stop, nothing
  /// that drives say.
  [[nodiscard]] bool commanded_by(const hal::CanFrame& f) const;

  /// Torque at the joint, N m, model convention: zero unless in closed-loop torque control.
  [[nodiscard]] double joint_torque() const;
  [[nodiscard]] bool closed_loop() const { return state_ == drive::odrive::AxisState::closed_loop_control; }
  [[nodiscard]] std::uint32_t error() const { return error_; }
  [[nodiscard]] int node() const { return mount_.node; }
  /// Heartbeats sent in a row that reported closed-loop control without error.
  [[nodiscard]] int confirmations() const { return confirmations_; }

 private:
  [[nodiscard]] ShaftReading truth(double angle, double rate) const;
  [[nodiscard]] hal::CanFrame heartbeat() const;
  [[nodiscard]] hal::CanFrame estimates() const;
  void disarm(std::uint32_t error);
  void request_state(std::uint32_t state);
  void setpoint(float torque);

  AxisMount mount_;
  Settings settings_;
  ShaftSensor sensor_;
  ShaftReading reading_{};
  drive::odrive::AxisState state_ = drive::odrive::AxisState::idle;
  std::uint32_t error_ = 0;
  bool torque_mode_ = false;
  float input_torque_ = 0.0F;
  double since_heartbeat_ = 0.0, since_fed_ = 0.0;
  int confirmations_ = 0;
};

}  // namespace esmc::host
