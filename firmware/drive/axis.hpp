#pragma once
/// The interface of a motor drive to the controller. One type per protocol satisfies `Drive`.

#include <array>
#include <concepts>
#include <cstdint>

#include "hal/can.hpp"
#include "hal/id_filters.hpp"

/// Motor drives, from the side of the controller.
namespace esmc::drive {

/// Node of a drive, and the relation between its motor shaft and the joint (model convention).
struct AxisConfig {
  std::uint8_t node = 0;    ///< of the drive on its bus
  float direction = 1.0F;   ///< +1: the motor turns with the joint angle of the model, -1: against it
  float gear_ratio = 1.0F;  ///< motor turns per joint turn, > 0
  float offset = 0.0F;      ///< joint angle at encoder zero, rad
};

/// Result of offering a frame to an axis.
enum class Received : std::uint8_t {
  not_mine,
  accepted,
  malformed,        ///< of this axis, with a wrong length or format: without side effect
  foreign_command,  ///< a command to this axis from another node
};

/// Joint side of an axis, as last reported.
template <class S>
struct JointSample {
  S angle{};  ///< rad, model convention
  S rate{};   ///< rad/s
};

/// Age, in ticks, of an event that has not occurred.
inline constexpr std::uint32_t age_max = 0xFFFF'FFFF;

/// Largest shaft torque that is sent, N m: more than any motor has. Beyond it the gear ratio is wrong.
inline constexpr float shaft_torque_max = 1e4F;

/// Torque at the motor shaft (N m, positive as the motor counts) of a torque at the joint (N m, model
/// convention). A NaN stays NaN, an overflow is infinite: see can_carry().
template <class S>
[[nodiscard]] constexpr float shaft_torque(const AxisConfig& c, S joint_torque) {
  return static_cast<float>(joint_torque) * c.direction / c.gear_ratio;
}
/// True if a shaft torque (N m) may be sent: finite, and at most shaft_torque_max in magnitude.
[[nodiscard]] constexpr bool can_carry(float torque) { return __builtin_fabsf(torque) <= shaft_torque_max; }

/// True if a drive that answers every tick has been silent for so long that it may have restarted: an eighth
/// of its retry_ticks (19 of 150 ms), and more than two ticks.
[[nodiscard]] constexpr bool may_have_restarted(std::uint32_t silent_ticks, std::uint32_t retry_ticks) {
  return silent_ticks > retry_ticks / 8U && silent_ticks > 2U;
}

/// Frames that a protocol sends once per bus instead of per axis: none for most protocols.
struct NoLine {
  /// Requests samples; sends nothing, because these drives send them without a request.
  template <class Send>
  void request(Send&&) {}
  /// Sends the frames of the tick that belong to no axis: none. `good`: the controller has no fault.
  template <class Send>
  void end_tick(Send&&, bool /*good*/) {}
};

/// One axis of the cycle: a motor's drive, or a passive encoder. No call blocks; `send(frame)` returns
/// whether the bus took the frame.
///
///   add_filters    adds the identifiers that receive() takes or judges; never changes
///   begin_tick     counts the ages; once per tick, before the frames of the tick are received
///   receive        takes a frame; no side effect unless `accepted`
///   enable         sends the next frames towards torque control; every tick while enabling
///   disable        sends frames that end torque control; every tick until idle()
///   put_torque     the torque command of a tick as a classic data frame
template <class D>
concept Drive = requires(D& d, const D& c, const hal::CanFrame& f, hal::CanFrame& out,
                         bool (*send)(const hal::CanFrame&), float torque, typename D::Line& line,
                         hal::IdFilters& filters) {
  c.add_filters(filters);
  d.begin_tick();
  { d.receive(f) } -> std::same_as<Received>;
  { c.heard_this_tick() } -> std::same_as<bool>;               ///< its cyclic frames of the tick are complete
  { c.sample_age_ticks() } -> std::same_as<std::uint32_t>;     ///< 0: of this tick; age_max before the first
  { c.brought_sample() } -> std::same_as<bool>;                ///< the last accepted frame completed a sample
  { c.heartbeat_age_ticks() } -> std::same_as<std::uint32_t>;  ///< 0: of this tick; age_max before the first
  { c.ready() } -> std::same_as<bool>;  ///< torque control confirmed in two ticks, without error
  { c.idle() } -> std::same_as<bool>;   ///< no torque, as far as the protocol can confirm
  { c.alive() } -> std::same_as<bool>;  ///< the axis has sent a frame of its own
  { c.error() } -> std::same_as<bool>;  ///< the drive reports an error
  { c.error_code() } -> std::same_as<std::uint32_t>;  ///< in the codes of the protocol; 0: none
  { c.closed_loop() } -> std::same_as<bool>;          ///< the drive reports torque control
  { c.must_be_released() } -> std::same_as<bool>;     ///< torque control was requested, and not idle() since
  { c.emergency_stopped() } -> std::same_as<bool>;    ///< on the bus or reported, not acknowledged since
  { c.config_mismatch() } -> std::same_as<bool>;      ///< a value read back is not the configured one
  { c.tx_suspended() } -> std::same_as<bool>;         ///< nothing may be sent: its watchdog is being tested
  { c.setting_up() } -> std::same_as<bool>;           ///< in a set-up of limited duration
  d.acknowledge();                                    ///< resets emergency_stopped(), for the operator
  d.ask_again();                                      ///< makes the next enable() repeat the last request
  d.enable(send);
  d.disable(send);
  { c.can_carry(torque) } -> std::same_as<bool>;  ///< monotonic in abs(torque), constant over time
  c.put_torque(out, torque);                      ///< N m at the joint; sets id, size and data of `out` alone
  c.template sample<float>();                     ///< JointSample of the last report; see sample_age_ticks()
  line.request(send);
  line.end_tick(send, true);
};

}  // namespace esmc::drive
