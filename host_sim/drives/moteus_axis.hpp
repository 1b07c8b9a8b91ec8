#pragma once
/// An emulated moteus: registers, one reply per frame that wants one, a watchdog that each command sets and
/// whose expiry takes the torque away until a stop. The reply shows the mode before the frame acts, and its
/// new registers.

#include <array>
#include <cstdint>
#include <limits>
#include <optional>

#include "firmware/drive/moteus.hpp"
#include "host_sim/drives/emulated_axis.hpp"
#include "host_sim/scene/drive_defects.hpp"

namespace esmc::host {

class MoteusAxis final : public EmulatedAxis {
 public:
  struct Settings {
    double period = 1e-3;      ///< s of virtual time between calls of publish()
    double timeout = 0.1;      ///< s, servo.default_timeout_s: of a command that names none
    double torque_max = 10.0;  ///< N m at the output, of servo.max_current_A
    bool realtime = false;     ///< replies at once, with the last reading; else one reply per publish()
    Defects defects{};
  };

  MoteusAxis(const AxisMount& mount, const Settings& settings, const SensorEffects& sensor, int joint,
             std::uint64_t seed);

  void settle(double joint_angle) override;
  /// In lockstep this sends the reply to the command of the tick before, sampled now; the first one without
  /// a command.
  void publish(double joint_angle, double joint_rate, const Send& send) override;
  bool receive(const hal::CanFrame& f, const Send& send) override;
  [[nodiscard]] bool commanded_by(const hal::CanFrame& f) const override;
  [[nodiscard]] bool closed_loop() const override { return mode_ == drive::moteus::mode_position; }
  /// Fault code; the mode of a time-out.
  [[nodiscard]] std::uint32_t error() const override;

 private:
  static constexpr double not_set = std::numeric_limits<double>::quiet_NaN();
  /// Registers of a command, from position_command on, with the values that they have unless a frame writes
  /// them: position, velocity, torque, scales of kp and kd, largest torque, stop, time-out, limit of the
  /// speed.
  using Demand = std::array<double, drive::moteus::reg::commands>;
  static constexpr Demand unwritten{0.0, 0.0, 0.0, 1.0, 1.0, not_set, not_set, 0.0, not_set};

  [[nodiscard]] double demand(std::uint32_t name) const {
    return demand_[name - drive::moteus::reg::position_command];
  }
  [[nodiscard]] std::optional<double> value(std::uint32_t name) const;
  [[nodiscard]] bool takes(std::uint32_t name) const;
  bool write(const hal::CanFrame& f);
  void act(std::uint8_t mode);
  void reply(const hal::CanFrame& request, const Send& send);
  [[nodiscard]] double limited(double torque) const;
  [[nodiscard]] double shaft_torque() const override;

  Settings settings_;
  Demand demand_ = unwritten;
  hal::CanFrame request_{};  ///< lockstep: of the tick before
  double since_command_ = 0.0;
  std::uint8_t mode_ = drive::moteus::mode_stopped, shown_ = mode_, fault_ = 0;
};

}  // namespace esmc::host
