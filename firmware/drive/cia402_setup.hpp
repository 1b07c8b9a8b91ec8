#pragma once
/// The set-up of a CiA 402 drive, entry by entry, before it goes operational: heartbeats and the reaction to
/// their loss, mode, torque scale, and the three PDOs of the loop.

#include <array>
#include <cstdint>

#include "firmware/drive/cia402.hpp"

namespace esmc::drive {

/// Settings of a drive and its bus, with every unit that a drive may choose.
struct Cia402Settings {
  float rated_torque = 0.0F;        ///< N m at the shaft: required of object 6076, to 1 %
  float rated_torque_unit = 1e-3F;  ///< N m per LSB of object 6076
  float torque_limit = 0.0F;        ///< N m at the shaft that object 6072 must allow, where there is one
  std::uint32_t counts_per_turn = 1'048'576;  ///< of object 6064, > 0
  float velocity_unit = 1.0471976e-4F;        ///< rad/s per LSB of object 606C; here 0.001 rpm
  std::uint32_t period_us = 1000;             ///< between two SYNC
  std::uint16_t heartbeat_ms = 10;            ///< period of the drive's heartbeat
  std::uint16_t consumer_ms = 10;   ///< without our heartbeat, or our RPDO, for this long, the drive stops
  std::uint8_t master_node = 127;   ///< our own
  std::uint16_t retry_ticks = 150;  ///< until a sequence without progress restarts, > 0
  std::uint16_t sdo_ticks = 100;    ///< time allowed for an answer, > 0
  /// Option codes: a lost connection is a fault; a fault and a quick stop take the torque away at once.
  std::int16_t abort_connection = 1, fault_reaction = 0, quick_stop = 0;
};

namespace cia402 {

/// The interpolation period in object 60C2: value * 10^index s; in ms if it is a whole number of ms.
struct Interpolation {
  std::uint8_t value;
  std::int8_t index;
};
/// Interpolation period of `period_us`, rounded to at most 255 units; above 255 s it is 255 s.
[[nodiscard]] constexpr Interpolation interpolation(std::uint32_t period_us) {
  std::uint32_t value = period_us;
  std::int8_t index = -6;
  while (index < -3 && value % 10 == 0) {
    value /= 10;
    ++index;
  }
  while (value > 255 && index < 0) {
    value = (value + 5) / 10;
    ++index;
  }
  return {static_cast<std::uint8_t>(value > 255 ? 255U : value), index};
}
static_assert(interpolation(1000).value == 1 && interpolation(1000).index == -3);
static_assert(interpolation(250).value == 25 && interpolation(250).index == -5);

/// Action for an entry.
enum class Task : std::uint8_t {
  write,     ///< not read back
  attempt,   ///< write, not read back; the drive may refuse
  verify,    ///< write, read back, compare under the mask
  expect,    ///< read, compare under the mask
  rated,     ///< read the rated torque: the scale of all torques
  at_least,  ///< read the max torque: must allow torque_limit; not checked where it is absent
};
/// Source of the value of an entry: itself, or a field of Cia402Settings.
enum class Source : std::uint8_t {
  constant,
  plus_node,  ///< constant + node of the drive
  heartbeat,
  consumer,
  deadline,  ///< of RPDO1
  abort_connection,
  fault_reaction,
  quick_stop,
  period_value,
  period_index,
  period_us,
};

/// An object of the drive and its required value.
struct Entry {
  Object object;
  std::uint8_t bytes;
  Task task;
  std::uint32_t constant = 0;
  Source source = Source::constant;
  bool optional = false;  ///< the drive need not have the object
  std::uint32_t mask = 0xFFFF'FFFF;
};

namespace detail {
/// A COB-ID without the RTR bit, which a drive may force.
inline constexpr std::uint32_t cob_mask = ~canopen::cob_no_rtr;

constexpr Entry disabled(std::uint16_t communication, std::uint32_t id) {
  return {{communication, 1}, 4,    Task::verify,        canopen::cob_invalid | id,
          Source::plus_node,  true, canopen::cob_invalid};
}
constexpr Entry cob(std::uint16_t communication, Task task, std::uint32_t id,
                    std::uint32_t mask = 0xFFFF'FFFF) {
  return {{communication, 1}, 4, task, id, Source::plus_node, false, mask};
}
constexpr Entry map(std::uint16_t mapping, std::uint8_t sub, Object o, std::uint8_t bits) {
  return {{mapping, sub}, 4, Task::verify, mapped(o, bits)};
}
}  // namespace detail

/// A PDO can be remapped in this order only: off, no entries, transmission, entries, their count, on. Each
/// TPDO is written with bit 30: devices that answer no remote frame may refuse a COB-ID without it.
// std::to_array, for gcc 12 puts a constant with deduced class template arguments into writable data.
inline constexpr auto setup = std::to_array<Entry>({
    Entry{controlword, 2, Task::write, control_disable_voltage},
    Entry{producer_heartbeat, 2, Task::verify, 0, Source::heartbeat},
    Entry{consumer_heartbeat, 4, Task::verify, 0, Source::consumer},
    Entry{error_behaviour, 1, Task::attempt, error_keeps_state},
    Entry{emergency_cob_id, 4, Task::expect, canopen::id_emergency, Source::plus_node, true,
          detail::cob_mask},
    // A drive without it has the SYNC of the profile, or sends no PDO and is never ready.
    Entry{sync_cob_id, 4, Task::expect, canopen::id_sync, Source::constant, true, 0x7FFF'FFFF},
    Entry{sync_period, 4, Task::verify, 0, Source::period_us, true},
    Entry{abort_connection_option, 2, Task::verify, 0, Source::abort_connection},
    Entry{fault_reaction_option, 2, Task::verify, 0, Source::fault_reaction},
    Entry{quick_stop_option, 2, Task::verify, 0, Source::quick_stop},
    Entry{supported_modes, 4, Task::expect, supports_cyclic_torque, Source::constant, false,
          supports_cyclic_torque},
    Entry{mode_of_operation, 1, Task::verify, static_cast<std::uint32_t>(mode_cyclic_torque)},
    Entry{rated_torque, 4, Task::rated},
    Entry{max_torque, 2, Task::at_least, 0, Source::constant, true},
    Entry{torque_offset, 2, Task::verify, 0, Source::constant, true},  // it adds to 6071
    Entry{interpolation_value, 1, Task::verify, 0, Source::period_value, true},
    Entry{interpolation_index, 1, Task::verify, 0, Source::period_index, true},
    // Commands from other nodes, and reports that would load the bus.
    detail::disabled(rpdo_communication + 1, canopen::id_rpdo2),
    detail::disabled(rpdo_communication + 2, canopen::id_rpdo3),
    detail::disabled(rpdo_communication + 3, canopen::id_rpdo4),
    detail::disabled(tpdo_communication + 2, canopen::cob_no_rtr | canopen::id_tpdo3),
    detail::disabled(tpdo_communication + 3, canopen::cob_no_rtr | canopen::id_tpdo4),
    detail::cob(rpdo_communication, Task::write, canopen::cob_invalid | canopen::id_rpdo1),
    Entry{{rpdo_mapping, 0}, 1, Task::write, 0},
    Entry{{rpdo_communication, 2}, 1, Task::verify, transmission_at_once},
    Entry{{rpdo_communication, 5}, 2, Task::verify, 0, Source::deadline, true},
    detail::map(rpdo_mapping, 1, controlword, 16),
    detail::map(rpdo_mapping, 2, target_torque, 16),
    Entry{{rpdo_mapping, 0}, 1, Task::verify, 2},
    detail::cob(rpdo_communication, Task::verify, canopen::id_rpdo1, detail::cob_mask),
    detail::cob(tpdo_communication, Task::write,
                canopen::cob_invalid | canopen::cob_no_rtr | canopen::id_tpdo1),
    Entry{{tpdo_mapping, 0}, 1, Task::write, 0},
    Entry{{tpdo_communication, 2}, 1, Task::verify, transmission_every_sync},
    detail::map(tpdo_mapping, 1, statusword, 16),
    detail::map(tpdo_mapping, 2, position, 32),
    detail::map(tpdo_mapping, 3, actual_torque, 16),
    Entry{{tpdo_mapping, 0}, 1, Task::verify, 3},
    detail::cob(tpdo_communication, Task::verify, canopen::cob_no_rtr | canopen::id_tpdo1, detail::cob_mask),
    detail::cob(tpdo_communication + 1, Task::write,
                canopen::cob_invalid | canopen::cob_no_rtr | canopen::id_tpdo2),
    Entry{{tpdo_mapping + 1, 0}, 1, Task::write, 0},
    Entry{{tpdo_communication + 1, 2}, 1, Task::verify, transmission_every_sync},
    detail::map(tpdo_mapping + 1, 1, velocity, 32),
    detail::map(tpdo_mapping + 1, 2, mode_display, 8),
    Entry{{tpdo_mapping + 1, 0}, 1, Task::verify, 2},
    detail::cob(tpdo_communication + 1, Task::verify, canopen::cob_no_rtr | canopen::id_tpdo2,
                detail::cob_mask),
});

/// The value that an entry writes, or compares under `e.mask`, for this drive; the object holds the low
/// `e.bytes` bytes of it. Not for Task::rated and Task::at_least, which are judged against torques of `s`: 0.
[[nodiscard]] constexpr std::uint32_t value_of(const Entry& e, const Cia402Settings& s, std::uint8_t node) {
  const auto low16 = [](std::int16_t v) { return std::uint32_t{static_cast<std::uint16_t>(v)}; };
  switch (e.source) {
    case Source::plus_node:
      return e.constant + node;
    case Source::heartbeat:
      return s.heartbeat_ms;
    case Source::deadline:  // RPDO1 is sent every tick, the heartbeat less often
      return s.consumer_ms;
    case Source::consumer:
      return (std::uint32_t{s.master_node} << 16U) | s.consumer_ms;
    case Source::abort_connection:
      return low16(s.abort_connection);
    case Source::fault_reaction:
      return low16(s.fault_reaction);
    case Source::quick_stop:
      return low16(s.quick_stop);
    case Source::period_value:
      return interpolation(s.period_us).value;
    case Source::period_index:
      return static_cast<std::uint8_t>(interpolation(s.period_us).index);
    case Source::period_us:
      return s.period_us;
    default:
      return e.constant;
  }
}
/// True if an SDO abort code says that the drive does not have the object.
[[nodiscard]] constexpr bool absent(std::uint32_t abort_code) {
  return abort_code == canopen::abort_no_object || abort_code == canopen::abort_no_sub_index;
}

}  // namespace cia402
}  // namespace esmc::drive
