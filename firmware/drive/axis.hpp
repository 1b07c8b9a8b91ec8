#pragma once
/// What every motor drive has in common for the controller: how it sits in the mechanism, what it says, what
/// is asked of it. One type per protocol satisfies `Drive`; the cycle knows no other difference between them.

#include <array>
#include <concepts>
#include <cstdint>

#include "hal/can.hpp"

/// Motor drives, as the controller sees them.
namespace esmc::drive {

/// How a motor sits in the mechanism. Angles and torques of the model on one side, of the shaft on the other.
struct AxisConfig {
  std::uint8_t node = 0;
  float direction = 1.0F;   ///< +1: the motor turns with the joint angle of the model, -1: against it
  float gear_ratio = 1.0F;  ///< motor turns per joint turn, > 0
  float offset = 0.0F;      ///< joint angle at encoder zero, rad
};

/// What a frame was to an axis.
enum class Received : std::uint8_t {
  not_mine,
  accepted,
  malformed,        ///< of this axis, with a length or format that it does not have: without side effect
  foreign_command,  ///< what only we may send to this axis, sent by somebody else
};

/// Joint side of an axis, as last heard.
template <class S>
struct JointSample {
  S angle{};  ///< rad, model convention
  S rate{};   ///< rad/s
};

/// An age that has never begun.
inline constexpr std::uint32_t age_max = 0xFFFF'FFFF;

/// More than any motor gives; a gear ratio that makes such a number is a mistake. N m at the shaft.
inline constexpr float shaft_torque_max = 1e4F;

/// Torque at the shaft for one at the joint (N m, model convention), rounded to float.
template <class S>
[[nodiscard]] constexpr float shaft_torque(const AxisConfig& c, S joint_torque) {
  return static_cast<float>(joint_torque) * c.direction / c.gear_ratio;
}
/// Whether a shaft torque may go on the bus: a finite float not above shaft_torque_max.
[[nodiscard]] constexpr bool can_carry(float torque) { return __builtin_fabsf(torque) <= shaft_torque_max; }

/// What a protocol needs once per bus and not per axis. Most need nothing.
struct NoLine {
  /// Asks the drives for the samples of the next tick.
  template <class Send>
  void request(Send&&) {}
  /// Frames of the tick that belong to no axis. `good`: nothing is wrong, the drives may trust us.
  template <class Send>
  void end_tick(Send&&, bool /*good*/) {}
};

/// One axis as the cycle sees it. Nothing here blocks; `send` says whether the bus took the frame.
///
///   begin_tick     counts the ages; once per tick, before the frames of the tick are received
///   receive        takes a frame; no side effect unless `accepted`
///   enable         frames that bring the axis to torque control, one step further; every tick while enabling
///   disable        frames that take it out of torque control; every tick until idle()
///   put_torque     the command of a tick into a classic data frame, in every state; zero unless the cycle
///   says otherwise
template <class D>
concept Drive = requires(D& d, const D& c, const hal::CanFrame& f, hal::CanFrame& out,
                         bool (*send)(const hal::CanFrame&), float torque, typename D::Line& line) {
  d.begin_tick();
  { d.receive(f) } -> std::same_as<Received>;
  { c.heard_this_tick() } -> std::same_as<bool>;  ///< its frame of the tick: the last one completes a set
  {
    c.sample_age_ticks()
    } -> std::same_as<std::uint32_t>;            ///< 0: arrived in this tick; age_max before the first
  { c.brought_sample() } -> std::same_as<bool>;  ///< the frame accepted last did, or completed one
  { c.heartbeat_age_ticks() } -> std::same_as<std::uint32_t>;
  { c.ready() } -> std::same_as<bool>;  ///< torque control confirmed twice, without error
  { c.idle() } -> std::same_as<bool>;   ///< no torque, as far as is known
  { c.alive() } -> std::same_as<bool>;  ///< the axis itself has said something
  { c.error() } -> std::same_as<bool>;
  { c.error_code() } -> std::same_as<std::uint32_t>;  ///< in the words of the drive
  { c.closed_loop() } -> std::same_as<bool>;
  { c.must_be_released() } -> std::same_as<bool>;  ///< asked into torque control, not seen idle since
  { c.emergency_stopped() } -> std::same_as<bool>;
  { c.config_mismatch() } -> std::same_as<bool>;  ///< what it let us read back is not what it must be
  { c.tx_suspended() } -> std::same_as<bool>;     ///< nothing is sent to it: its watchdog is being starved
  {
    c.setting_up()
    } -> std::same_as<bool>;  ///< works through a set-up that ends by itself; false: waits for the drive
  d.acknowledge();            ///< the operator's reset of an emergency stop
  d.ask_again();              ///< nobody can have heard the last request
  d.enable(send);
  d.disable(send);
  {
    c.can_carry(torque)
    }
    -> std::same_as<bool>;  ///< of configuration alone; whoever can carry a torque can carry less, either way
  c.put_torque(out, torque);
  c.template sample<float>();
  line.request(send);
  line.end_tick(send, true);
};

}  // namespace esmc::drive
