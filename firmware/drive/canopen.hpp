#pragma once
/// CANopen (CiA 301) on the wire: network management, SYNC, heartbeat, emergency and expedited SDO, on the
/// identifiers of the predefined connection set. Classic data frames with 11-bit identifiers, little endian.

#include <cstddef>
#include <cstdint>
#include <optional>

#include "hal/can.hpp"

/// CANopen on the wire.
namespace esmc::drive::canopen {

inline constexpr std::uint8_t node_max = 127;  ///< nodes are 1..127; 0 addresses all in network management

/// Function codes: CAN identifier = code + node (1..127); id_nmt and id_sync stand alone.
inline constexpr std::uint32_t id_nmt = 0x000, id_sync = 0x080, id_emergency = 0x080;
inline constexpr std::uint32_t id_tpdo1 = 0x180, id_rpdo1 = 0x200, id_tpdo2 = 0x280, id_rpdo2 = 0x300;
inline constexpr std::uint32_t id_tpdo3 = 0x380, id_rpdo3 = 0x400, id_tpdo4 = 0x480, id_rpdo4 = 0x500;
inline constexpr std::uint32_t id_sdo_reply = 0x580, id_sdo_request = 0x600, id_heartbeat = 0x700;
inline constexpr std::uint32_t node_mask = 0x7F, function_mask = 0x780;

/// Bits of a COB-ID in the object dictionary.
inline constexpr std::uint32_t cob_invalid = 0x8000'0000;  ///< the PDO does not exist
inline constexpr std::uint32_t cob_no_rtr = 0x4000'0000;   ///< TPDO: not on remote frames

/// Commands of network management.
enum class NmtCommand : std::uint8_t {
  start = 0x01,
  stop = 0x02,
  enter_pre_operational = 0x80,
  reset_node = 0x81,
  reset_communication = 0x82,
};
/// State in a heartbeat.
enum class NmtState : std::uint8_t {
  boot_up = 0x00,
  stopped = 0x04,
  operational = 0x05,
  pre_operational = 0x7F
};

/// An entry of the object dictionary.
struct Object {
  std::uint16_t index = 0;
  std::uint8_t sub = 0;
  friend constexpr bool operator==(const Object&, const Object&) = default;
};

/// SDO abort codes (CiA 301).
inline constexpr std::uint32_t abort_time_out = 0x0504'0000, abort_command = 0x0504'0001,
                               abort_read_only = 0x0601'0002, abort_no_object = 0x0602'0000,
                               abort_not_mappable = 0x0604'0041, abort_pdo_length = 0x0604'0042,
                               abort_length = 0x0607'0010, abort_no_sub_index = 0x0609'0011,
                               abort_value = 0x0609'0030, abort_device_state = 0x0800'0022;

/// True for a classic data frame of exactly this size, whatever its identifier.
[[nodiscard]] constexpr bool has_size(const hal::CanFrame& f, std::uint8_t size) {
  return f.size == size && !f.remote && !f.fd;
}

// ---- network management, SYNC, heartbeat, emergency

/// An NMT frame.
struct Nmt {
  NmtCommand command;  ///< may hold a value without a name here
  std::uint8_t node;   ///< 0: all
};
/// Frame that gives a command to a node (1..127), or to all nodes (0).
[[nodiscard]] constexpr hal::CanFrame encode_nmt(NmtCommand command, std::uint8_t node) {
  hal::CanFrame f = hal::data_frame(id_nmt, 2);
  f.data[0] = static_cast<std::uint8_t>(command);
  f.data[1] = node;
  return f;
}
/// Decodes an NMT frame; empty for a wrong length, remote or FD frame. The caller checks the identifier.
[[nodiscard]] constexpr std::optional<Nmt> decode_nmt(const hal::CanFrame& f) {
  if (!has_size(f, 2)) return std::nullopt;
  return Nmt{static_cast<NmtCommand>(f.data[0]), f.data[1]};
}

/// SYNC without counter (object 1019 is 0).
[[nodiscard]] constexpr hal::CanFrame encode_sync() { return hal::data_frame(id_sync, 0); }

/// Heartbeat of a node (1..127) in this state; neither is checked.
[[nodiscard]] constexpr hal::CanFrame encode_heartbeat(std::uint8_t node, NmtState state) {
  hal::CanFrame f = hal::data_frame(id_heartbeat + node, 1);
  f.data[0] = static_cast<std::uint8_t>(state);
  return f;
}
/// State in a heartbeat, boot_up included; empty for an undefined state (node guarding's toggle bit too), a
/// wrong length, remote or FD frame. The caller checks the identifier.
[[nodiscard]] constexpr std::optional<NmtState> decode_heartbeat(const hal::CanFrame& f) {
  if (!has_size(f, 1)) return std::nullopt;
  switch (const auto s = static_cast<NmtState>(f.data[0])) {
    case NmtState::boot_up:
    case NmtState::stopped:
    case NmtState::operational:
    case NmtState::pre_operational:
      return s;
  }
  return std::nullopt;
}

/// An EMCY frame.
struct Emergency {
  std::uint16_t code;           ///< 0: no error any more
  std::uint8_t error_register;  ///< object 1001
};
/// EMCY frame of a node (1..127) with code and error register; vendor bytes 0.
[[nodiscard]] constexpr hal::CanFrame encode_emergency(std::uint8_t node, Emergency e) {
  hal::CanFrame f = hal::data_frame(id_emergency + node, 8);
  put_field(f, 0, e.code, 2);
  f.data[2] = e.error_register;
  return f;
}
/// Decodes EMCY; empty for a wrong length, remote or FD frame. The caller checks the identifier.
[[nodiscard]] constexpr std::optional<Emergency> decode_emergency(const hal::CanFrame& f) {
  if (!has_size(f, 8)) return std::nullopt;
  return Emergency{static_cast<std::uint16_t>(get_field(f, 0, 2)), f.data[2]};
}

// ---- SDO, expedited: up to four bytes in one frame

namespace detail {
/// SDO frame of 8 bytes: command byte `specifier`, object, four bytes 0. `id`: with the node.
[[nodiscard]] constexpr hal::CanFrame sdo(std::uint32_t id, std::uint8_t specifier, Object o) {
  hal::CanFrame f = hal::data_frame(id, 8);
  f.data[0] = specifier;
  put_field(f, 1, o.index, 2);
  f.data[3] = o.sub;
  return f;
}
/// Command byte of an expedited transfer with `bytes` (1..4) bytes of data.
[[nodiscard]] constexpr std::uint8_t with_size(std::uint8_t command, std::uint8_t bytes) {
  return static_cast<std::uint8_t>(command | 0x03U | ((4U - bytes) << 2U));
}
/// Data bytes that a command byte announces: 1..4; 0: not indicated.
[[nodiscard]] constexpr std::uint8_t size_of(std::uint8_t specifier) {
  return (specifier & 0x01U) == 0 ? std::uint8_t{0}
                                  : static_cast<std::uint8_t>(4U - ((specifier >> 2U) & 3U));
}
/// Object that an SDO frame names. The caller checks the size.
[[nodiscard]] constexpr Object object_of(const hal::CanFrame& f) {
  return {static_cast<std::uint16_t>(get_field(f, 1, 2)), f.data[3]};
}
}  // namespace detail

/// Request to read an object of a node (1..127).
[[nodiscard]] constexpr hal::CanFrame encode_sdo_read(std::uint8_t node, Object o) {
  return detail::sdo(id_sdo_request + node, 0x40, o);
}
/// Expedited request to write the low `bytes` (1, 2 or 4; not checked) bytes of `value` to an object.
[[nodiscard]] constexpr hal::CanFrame encode_sdo_write(std::uint8_t node, Object o, std::uint32_t value,
                                                       std::uint8_t bytes) {
  hal::CanFrame f = detail::sdo(id_sdo_request + node, detail::with_size(0x20, bytes), o);
  put_field(f, 4, value, bytes);
  return f;
}
/// A drive's answer to a read: the low `bytes` (1, 2 or 4; not checked) bytes of `value`.
[[nodiscard]] constexpr hal::CanFrame encode_sdo_value(std::uint8_t node, Object o, std::uint32_t value,
                                                       std::uint8_t bytes) {
  hal::CanFrame f = detail::sdo(id_sdo_reply + node, detail::with_size(0x40, bytes), o);
  put_field(f, 4, value, bytes);
  return f;
}
/// A drive's answer to a write that it carried out.
[[nodiscard]] constexpr hal::CanFrame encode_sdo_written(std::uint8_t node, Object o) {
  return detail::sdo(id_sdo_reply + node, 0x60, o);
}
/// A drive's refusal of a read or write. `code`: one of abort_*.
[[nodiscard]] constexpr hal::CanFrame encode_sdo_abort(std::uint8_t node, Object o, std::uint32_t code) {
  hal::CanFrame f = detail::sdo(id_sdo_reply + node, 0x80, o);
  put_field(f, 4, code, 4);
  return f;
}

/// Kinds of SDO frame.
enum class SdoKind : std::uint8_t {
  read,     ///< request
  write,    ///< request, expedited
  value,    ///< reply to read, expedited
  written,  ///< reply to write
  abort,    ///< from either side; `value` is the reason
  other,    ///< segmented and block transfers
};
/// An expedited SDO, request or answer.
struct Sdo {
  SdoKind kind;
  Object object;
  std::uint32_t value;  ///< of write, value and abort; bytes that are not data are zero
  std::uint8_t size;    ///< 1..4; 0: not indicated, all four bytes are in `value`
};

namespace detail {
/// Expedited SDO of this kind with its value; all four bytes where no size is indicated.
[[nodiscard]] constexpr Sdo transfer(const hal::CanFrame& f, SdoKind kind) {
  const std::uint8_t size = size_of(f.data[0]);
  return {kind, object_of(f), get_field(f, 4, size == 0 ? 4 : size), size};
}
}  // namespace detail

/// Decodes a request to a drive; empty for a wrong length, remote or FD frame. Caller checks the identifier.
[[nodiscard]] constexpr std::optional<Sdo> decode_sdo_request(const hal::CanFrame& f) {
  if (!has_size(f, 8)) return std::nullopt;
  const std::uint8_t command = f.data[0];
  if (command == 0x40) return Sdo{SdoKind::read, detail::object_of(f), 0, 0};
  if ((command & 0xF2U) == 0x22) return detail::transfer(f, SdoKind::write);
  if (command == 0x80) return Sdo{SdoKind::abort, detail::object_of(f), get_field(f, 4, 4), 4};
  return Sdo{SdoKind::other, detail::object_of(f), 0, 0};
}
/// Decodes a drive's answer; empty for a wrong length, remote or FD frame. Caller checks the identifier.
[[nodiscard]] constexpr std::optional<Sdo> decode_sdo_reply(const hal::CanFrame& f) {
  if (!has_size(f, 8)) return std::nullopt;
  const std::uint8_t command = f.data[0];
  if (command == 0x60) return Sdo{SdoKind::written, detail::object_of(f), 0, 0};
  if ((command & 0xF2U) == 0x42) return detail::transfer(f, SdoKind::value);
  if (command == 0x80) return Sdo{SdoKind::abort, detail::object_of(f), get_field(f, 4, 4), 4};
  return Sdo{SdoKind::other, detail::object_of(f), 0, 0};
}

// By hand from the message layouts: node 5, object 6071:0 := 1000, and the answer to reading it.
static_assert(encode_sdo_write(5, {0x6071, 0}, 1000, 2) ==
              hal::CanFrame{.id = 0x605, .size = 8, .data = {0x2B, 0x71, 0x60, 0x00, 0xE8, 0x03}});
static_assert(encode_sdo_value(5, {0x6071, 0}, 1000, 2) ==
              hal::CanFrame{.id = 0x585, .size = 8, .data = {0x4B, 0x71, 0x60, 0x00, 0xE8, 0x03}});

}  // namespace esmc::drive::canopen
