#pragma once
/// CiA 402 in cyclic synchronous torque mode: objects, state machine, and the three PDOs of the loop.

#include <cstdint>
#include <optional>

#include "firmware/drive/canopen.hpp"

/// CiA 402 on the wire.
namespace esmc::drive::cia402 {

using canopen::Object;

// ---- object dictionary

inline constexpr Object device_type{0x1000, 0}, error_register{0x1001, 0}, sync_cob_id{0x1005, 0},
    sync_period{0x1006, 0};  ///< us
inline constexpr Object emergency_cob_id{0x1014, 0};
inline constexpr Object consumer_heartbeat{0x1016, 1};  ///< node << 16 | time-out in ms
inline constexpr Object producer_heartbeat{0x1017, 0};  ///< ms, 0: off
inline constexpr Object error_behaviour{0x1029, 1};  ///< after a communication error, 0: to pre-operational
inline constexpr std::uint8_t error_keeps_state = 1;
inline constexpr Object abort_connection_option{0x6007, 0}, error_code{0x603F, 0}, controlword{0x6040, 0},
    statusword{0x6041, 0}, quick_stop_option{0x605A, 0}, fault_reaction_option{0x605E, 0};
inline constexpr Object mode_of_operation{0x6060, 0}, mode_display{0x6061, 0}, supported_modes{0x6502, 0};
inline constexpr Object position{0x6064, 0}, velocity{0x606C, 0};
inline constexpr Object target_torque{0x6071, 0}, actual_torque{0x6077, 0};  ///< 1/1000 of the rated torque
inline constexpr Object max_torque{0x6072, 0};                               ///< 1/1000 of the rated torque
inline constexpr Object torque_offset{0x60B2, 0};                            ///< the same unit; adds to 6071
inline constexpr Object rated_torque{0x6076, 0};  ///< unit of the drive: mN m, uN m
inline constexpr Object interpolation_value{0x60C2, 1},
    interpolation_index{0x60C2, 2};  ///< value * 10^index s

/// RPDO and TPDO 1..4: communication sub 1 COB-ID, sub 2 transmission type, sub 5
/// event timer, ms (of an RPDO the deadline for the next one; optional); mapping sub 0 count, sub n entry.
inline constexpr std::uint16_t rpdo_communication = 0x1400, rpdo_mapping = 0x1600,
                               tpdo_communication = 0x1800, tpdo_mapping = 0x1A00;
inline constexpr std::uint8_t transmission_every_sync = 1, transmission_at_once = 255;

/// Entry of a PDO mapping: index << 16 | sub << 8 | bits.
[[nodiscard]] constexpr std::uint32_t mapped(Object o, std::uint8_t bits) {
  return (std::uint32_t{o.index} << 16U) | (std::uint32_t{o.sub} << 8U) | bits;
}

inline constexpr std::int8_t mode_cyclic_torque = 10;
inline constexpr std::uint32_t supports_cyclic_torque = 1U << 9U;  ///< in supported_modes

// ---- state machine

/// States of the drive's machine.
enum class State : std::uint8_t {
  not_ready,
  switch_on_disabled,
  ready_to_switch_on,
  switched_on,
  operation_enabled,
  quick_stop_active,
  fault_reaction_active,
  fault,
  unknown,  ///< a combination of bits without meaning
};

/// State that a statusword (6041) reports.
[[nodiscard]] constexpr State state_of(std::uint16_t status) {
  switch (status & 0x4FU) {
    case 0x00:
      return State::not_ready;
    case 0x40:
      return State::switch_on_disabled;
    case 0x0F:
      return State::fault_reaction_active;
    case 0x08:
      return State::fault;
    default:
      break;
  }
  switch (status & 0x6FU) {
    case 0x21:
      return State::ready_to_switch_on;
    case 0x23:
      return State::switched_on;
    case 0x27:
      return State::operation_enabled;
    case 0x07:
      return State::quick_stop_active;
    default:
      return State::unknown;
  }
}
/// True if the power stage gives no torque in this state, which is two steps or more from operation_enabled.
/// False in switched_on, one step from it, and in unknown.
[[nodiscard]] constexpr bool is_torque_free(State s) {
  return s == State::not_ready || s == State::switch_on_disabled || s == State::ready_to_switch_on ||
         s == State::fault;
}

/// Controlwords (6040).
inline constexpr std::uint16_t control_disable_voltage = 0x00, control_quick_stop = 0x02,
                               control_shutdown = 0x06, control_switch_on = 0x07,
                               control_enable_operation = 0x0F,
                               control_fault_reset = 0x80;  ///< its rising edge

// ---- process data

/// RPDO1: controlword, target torque.
struct Command {
  std::uint16_t control;
  std::int16_t torque;  ///< 1/1000 of the rated torque
};
/// TPDO1: statusword, position, actual torque.
struct Report {
  std::uint16_t status;
  std::int32_t position;  ///< counts
  std::int16_t torque;    ///< 1/1000 of the rated torque
};
/// TPDO2: velocity, and the mode, which shows at once that a drive has left torque control.
struct Motion {
  std::int32_t velocity;  ///< unit of the drive
  std::int8_t mode;       ///< object 6061
};

/// Writes RPDO1 of a node into f, a classic data frame already: only identifier, size and data change.
constexpr void put_command(hal::CanFrame& f, std::uint8_t node, Command c) {
  f.id = canopen::id_rpdo1 + node;
  f.size = 4;
  put_field(f, 0, c.control, 2);
  put_field(f, 2, static_cast<std::uint16_t>(c.torque), 2);
}
/// RPDO1 of a node (1..127, not checked) as a frame of its own.
[[nodiscard]] constexpr hal::CanFrame encode_command(std::uint8_t node, Command c) {
  hal::CanFrame f;
  put_command(f, node, c);
  return f;
}
/// Decodes TPDO1; empty for a wrong length, remote or FD frame. The caller checks the identifier.
[[nodiscard]] constexpr std::optional<Report> decode_report(const hal::CanFrame& f) {
  if (!canopen::has_size(f, 8)) return std::nullopt;
  return Report{static_cast<std::uint16_t>(get_field(f, 0, 2)), static_cast<std::int32_t>(get_field(f, 2, 4)),
                static_cast<std::int16_t>(get_field(f, 6, 2))};
}
/// Decodes TPDO2; empty for a wrong length, remote or FD frame. The caller checks the identifier.
[[nodiscard]] constexpr std::optional<Motion> decode_motion(const hal::CanFrame& f) {
  if (!canopen::has_size(f, 5)) return std::nullopt;
  return Motion{static_cast<std::int32_t>(get_field(f, 0, 4)), static_cast<std::int8_t>(f.data[4])};
}

// By hand: node 3, operation enabled, -2 thousandths.
static_assert(encode_command(3, {control_enable_operation, -2}) ==
              hal::CanFrame{.id = 0x203, .size = 4, .data = {0x0F, 0x00, 0xFE, 0xFF}});

}  // namespace esmc::drive::cia402
