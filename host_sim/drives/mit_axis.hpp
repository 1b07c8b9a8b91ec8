#pragma once
/// An emulated drive in MIT mode, as the original firmware behaves: one reply per command, sent before the
/// command takes effect; codes truncated and not clamped, so that a value out of range wraps around; a
/// time-out that sets the command to zero and leaves the drive in motor mode.

#include <cstdint>
#include <numbers>

#include "firmware/drive/mit.hpp"
#include "host_sim/drives/emulated_axis.hpp"
#include "host_sim/scene/drive_defects.hpp"

namespace esmc::host {

class MitAxis final : public EmulatedAxis {
 public:
  using Dialect = drive::mit::Dialect;

  struct Settings {
    Dialect dialect = Dialect::mini_cheetah;
    std::uint16_t master_id = 0;   ///< identifier of the replies; the node itself: on its own identifier
    std::uint8_t reply_size = 6;   ///< bytes; mini_cheetah: 5 to 7, the others: 8
    double position_range = 12.5;  ///< rad, velocity_range rad/s, torque_range N m: half widths, at the shaft
    double velocity_range = 50.0;
    double torque_range = 18.0;
    double velocity_unit = std::numbers::pi / (3.0 * 21 * 9);  ///< cubemars_v3: rad/s per 10 electrical rpm
    double period = 1e-3;           ///< s of virtual time between calls of publish()
    double control_period = 25e-6;  ///< s, of the drive's own loop: the unit of its time-out
    int timeout_cycles = 1000;
    bool realtime = false;  ///< replies at once, with the last reading; else one reply per publish()
    Defects defects{};
  };

  MitAxis(const AxisMount& mount, const Settings& settings, const SensorEffects& sensor, int joint,
          std::uint64_t seed);

  void settle(double joint_angle) override;
  /// In lockstep this sends the reply to the command of the tick before, sampled now; the first one without
  /// a command.
  void publish(double joint_angle, double joint_rate, const Send& send) override;
  bool receive(const hal::CanFrame& received, const Send& send) override;
  [[nodiscard]] bool commanded_by(const hal::CanFrame& f) const override;
  [[nodiscard]] bool closed_loop() const override { return enabled_; }
  [[nodiscard]] std::uint32_t error() const override { return 0; }
  [[nodiscard]] bool timed_out() const override { return timed_out_; }

 private:
  static constexpr double turn = 2.0 * std::numbers::pi;
  static constexpr int v3_replies_before = 2;
  struct Demand {  // of the last command; rad, rad/s, N m/rad, N m s/rad, N m
    double position = 0.0, velocity = 0.0, kp = 0.0, kd = 0.0, torque = 0.0;
  };

  [[nodiscard]] bool mine(const hal::CanFrame& f) const;
  /// rad, of the last reading, from the drive's zero.
  [[nodiscard]] double shaft_angle() const { return (reading_.position_rev - zero_rev_) * turn; }
  [[nodiscard]] double shaft_rate() const { return reading_.velocity_rev_s * turn; }
  [[nodiscard]] double shaft_torque() const override;
  void reply(const Send& send);
  void confirm();
  [[nodiscard]] bool v3() const { return settings_.dialect == Dialect::cubemars_v3; }
  void act(drive::mit::Special s);

  Settings settings_;
  Demand demand_{};
  StaleBytes stale_;
  double zero_rev_ = 0.0;
  double since_command_ = 0.0;
  bool enabled_ = false;
  bool timed_out_ = false;
  bool counted_ = false;  // a reply of this period is in confirmations_
};

}  // namespace esmc::host
