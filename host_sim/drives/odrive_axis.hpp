#pragma once
/// An emulated ODrive axis: the bytes on the bus and the rules for closed-loop control, errors and watchdog.

#include <cstdint>

#include "firmware/drive/odrive.hpp"
#include "host_sim/drives/emulated_axis.hpp"
#include "host_sim/scene/drive_defects.hpp"
#include "host_sim/scene/odrive_endpoints.hpp"

namespace esmc::host {

class OdriveAxis final : public EmulatedAxis {
 public:
  using Version = drive::odrive::Version;

  struct Settings {
    Version version = Version::v0_6;
    double period = 1e-3;            ///< s of virtual time between calls of publish(): encoder_msg_rate
    double heartbeat_period = 0.01;  ///< s, heartbeat_msg_rate
    double watchdog_timeout = 0.01;  ///< s; config.enable_watchdog is set
    double torque_max = 10.0;        ///< N m at the shaft
    double vel_limit = 2.0;  ///< rev/s; with vel_gain, N m s/rev, the limit of defects.torque_mode_limit
    double vel_gain = 1.0 / 6.0;
    double torque_constant = 0.1;  ///< N m/A; reported, like the next, and of no effect
    double current_limit = 100.0;  ///< A
    bool overspeed_error = true;   ///< reported
    bool says_torque = false;      ///< 0.6: Get_Torques with every heartbeat, torques_msg_rate
    OdriveEndpoints endpoints{};   ///< 0.6: readable values and version
    int partner = -1;              ///< node of the other axis of its board, -1: none
    Defects defects{};
  };

  OdriveAxis(const AxisMount& mount, const Settings& settings, const SensorEffects& sensor, int joint,
             std::uint64_t seed);

  void publish(double joint_angle, double joint_rate, const Send& send) override;
  bool receive(const hal::CanFrame& received, const Send& send) override;
  [[nodiscard]] bool commanded_by(const hal::CanFrame& f) const override;
  [[nodiscard]] bool closed_loop() const override {
    return state_ == drive::odrive::AxisState::closed_loop_control;
  }
  [[nodiscard]] std::uint32_t error() const override { return error_; }

 private:
  [[nodiscard]] bool new_version() const { return settings_.version == Version::v0_6; }  ///< else 0.5.6
  [[nodiscard]] ShaftReading sampled(double joint_angle, double joint_rate);
  void expire();
  void serve(const hal::CanFrame& request, const Send& send) const;
  [[nodiscard]] std::uint32_t raw(OdriveValue v) const;
  [[nodiscard]] hal::CanFrame heartbeat() const;
  [[nodiscard]] hal::CanFrame estimates() const;
  [[nodiscard]] hal::CanFrame torques() const;
  [[nodiscard]] double shaft_torque() const override;
  void disarm(std::uint32_t error);
  void request_state(std::uint32_t state);
  void setpoint(float torque);

  Settings settings_;
  drive::odrive::AxisState state_ = drive::odrive::AxisState::idle;
  std::uint32_t error_ = 0;
  std::uint32_t control_mode_ = 3, input_mode_ = 1;  // position and pass-through, as delivered
  std::uint32_t disarm_reason_ = 0;
  float input_torque_ = 0.0F;
  double since_heartbeat_ = 0.0, since_fed_ = 0.0;
  double phase_;  // age of a sample by its own clock, periods
  StaleBytes stale_;
  bool connected_ = false;  // defects.zero_until_closed_loop: closed loop has been entered since power-up
  bool dead_ = false;       // until it is restarted
};

}  // namespace esmc::host
