#pragma once
/// The command interface on the wire: identifiers, bytes and units. docs/command-interface.md describes the
/// messages, docs/esmc.dbc holds the same layout as a DBC file; tests/link compares the two.
///
/// id = base + Message, 11 bits, base a multiple of block_size; classic frames of 8 bytes, little endian.
/// Every frame to the controller, and Status, begins with
///
///   byte 0  CRC-8/SAE-J1850 over: identifier (low byte, high byte), session, bytes 1..7
///   byte 1  bits 0..3 alive counter, bits 4..7 belong to the message
///
/// Values of enumerations are explicit, for they are sent: append only, never renumber.

#include <array>
#include <bit>
#include <cstdint>
#include <optional>

#include "firmware/link/crc.hpp"
#include "firmware/safety/faults.hpp"
#include "firmware/safety/supervisor.hpp"
#include "hal/can.hpp"

/// Command interface to a supervisor computer.
namespace esmc::link {

/// Sent in Identity. Counts up when a supervisor computer of the version before would misread a frame or be
/// misread; new messages, enumerators and fields in unused bytes do not change it.
inline constexpr std::uint8_t protocol_version = 1;
inline constexpr std::uint32_t block_size = 32;  ///< identifiers, as many as one node of CANSimple has

/// Offsets from the base identifier.
enum class Message : std::uint8_t {
  // supervisor computer -> controller
  command = 0x00,          ///< Order; also the sign of life
  set_point = 0x01,        ///< Pair, m or rad
  stream_position = 0x02,  ///< Pair, m or rad
  stream_velocity = 0x03,  ///< Pair, m/s or rad/s, with the counter of its position
  parameter_write = 0x04,
  request = 0x05,
  // controller -> supervisor computer
  status = 0x10,
  fault_record = 0x11,
  fault_detail = 0x12,
  parameter_value = 0x13,
  parameter_table = 0x14,
  link_counters = 0x15,
  effector = 0x16,
  tracking_error = 0x17,
  joint_1 = 0x18,   ///< ..joint_4: in the order of the joints that have a motor
  identity = 0x1C,  ///< scene of the controller and protocol_version
  parameter_slots = 0x1D,
  capture = 0x1E,  ///< part of a record of a tick, or the state of the capture
};
inline constexpr std::uint8_t incoming_count = 6;
inline constexpr std::uint8_t outgoing_first = 0x10;
inline constexpr std::uint8_t joints_max = 4;

/// Orders of the supervisor computer.
enum class Order : std::uint8_t {
  none = 0,          ///< a sign of life
  arm = 1,           ///< Command::enable
  disarm = 2,        ///< Command::halt: to rest first, where the configuration allows it
  off = 3,           ///< Command::stop: no torque from the next tick on
  reset = 4,         ///< Command::reset: the operator has seen the fault
  confirm_zero = 5,  ///< Command::confirm_zero
  hold = 6,          ///< the present position: from the next start on; while running to rest, on the path
  reference = 7,     ///< the reference of the configuration: from the next start on
  stream = 8,        ///< set points and samples: from the next start on
  store = 9,         ///< writes the present gains to the store, for later power-ups
  forget = 10,       ///< return to the baked gains, now and for later power-ups
  home = 11,         ///< Command::home
  override = 19,     ///< the reference at CommandFrame::percent of its speed, along its path
  resume = 20,       ///< after hold: the reference at the last percentage
};
/// True if the value has a meaning.
[[nodiscard]] constexpr bool is_order(std::uint8_t v) { return v <= 11 || v == 19 || v == 20; }

/// Source of the reference.
enum class Source : std::uint8_t { hold = 0, reference = 1, stream = 2 };

/// Coordinates of a set point: m, or rad of the base joints.
enum class Space : std::uint8_t { effector = 0, base_joints = 1 };

/// Answer to a write.
enum class Answer : std::uint8_t {
  ok = 0,
  unknown_index = 1,
  read_only = 2,
  out_of_bounds = 3,
  not_now = 4,  ///< only while disabled
};

/// Subject of a request.
enum class Subject : std::uint8_t { faults = 0, parameter = 1, table = 2, capture = 3 };
inline constexpr std::uint8_t subject_count = 4;

/// A session that no controller has: accepted for disarm and off, from a sender that has received no Status.
inline constexpr std::uint8_t any_session = 0;
inline constexpr std::uint8_t no_axis = 0xFF;  ///< in the place of a motor or encoder: none

inline constexpr float position_unit = 1e-6F;  ///< m or rad
inline constexpr float velocity_unit = 1e-5F;  ///< m/s or rad/s

namespace detail {
using Frame = hal::CanFrame;
constexpr void put_float(Frame& f, unsigned at, float v) {
  put_field(f, at, std::bit_cast<std::uint32_t>(v), 4);
}
[[nodiscard]] constexpr float get_float(const Frame& f, unsigned at) {
  return std::bit_cast<float>(get_field(f, at, 4));
}
/// Signed number of 24 bits (two's complement), little-endian, from byte `at` on.
[[nodiscard]] constexpr std::int32_t get_i24(const Frame& f, unsigned at) {
  constexpr std::uint32_t sign = 0x80'0000;
  return static_cast<std::int32_t>((get_field(f, at, 3) ^ sign)) - static_cast<std::int32_t>(sign);
}
[[nodiscard]] constexpr Frame frame(std::uint32_t base, Message m) {
  return hal::data_frame(base + static_cast<std::uint32_t>(m), 8);
}
}  // namespace detail

/// Required value of byte 0 of a frame: CRC-8 over identifier, session and bytes 1..7.
[[nodiscard]] constexpr std::uint8_t checksum(const hal::CanFrame& f, std::uint8_t session) {
  std::uint8_t c = crc8_add(crc8_start, static_cast<std::uint8_t>(f.id));
  c = crc8_add(c, static_cast<std::uint8_t>(f.id >> 8U));
  c = crc8_add(c, session);
  for (unsigned i = 1; i < 8; ++i) c = crc8_add(c, f.data[i]);
  return static_cast<std::uint8_t>(c ^ crc8_inverted);
}
/// True if byte 0 is the checksum for this session. The caller checks that the frame has 8 bytes.
[[nodiscard]] constexpr bool intact(const hal::CanFrame& f, std::uint8_t session) {
  return f.data[0] == checksum(f, session);
}
/// Alive counter of a frame, 0..15. The caller checks that the frame has two bytes.
[[nodiscard]] constexpr std::uint8_t counter_of(const hal::CanFrame& f) { return f.data[1] & 0x0FU; }

// ---- to the controller; a decoder returns nothing if a reserved bit is set or a value has no meaning

/// An order, and the sign of life.
struct CommandFrame {
  Order order = Order::none;
  std::uint8_t percent = 0;      ///< for override, 0 to 100; else 0
  std::uint16_t tick = 0;        ///< of the last Status received, its low 16 bits
  std::uint16_t parameters = 0;  ///< low half of the CRC-32 of the table that the operator knows
};
/// Decodes an order; empty: unknown, a reserved bit is set, or `percent` is not one of the order. The caller
/// checks identifier, size, intact().
[[nodiscard]] constexpr std::optional<CommandFrame> decode_command(const hal::CanFrame& f) {
  if ((f.data[1] >> 4U) != 0 || !is_order(f.data[2])) return std::nullopt;
  if (f.data[3] > (static_cast<Order>(f.data[2]) == Order::override ? 100 : 0)) return std::nullopt;
  return CommandFrame{static_cast<Order>(f.data[2]), f.data[3],
                      static_cast<std::uint16_t>(get_field(f, 4, 2)),
                      static_cast<std::uint16_t>(get_field(f, 6, 2))};
}

/// Two coordinates: the effector's x and y, or the base joints.
struct Pair {
  Space space = Space::effector;
  std::array<float, 2> value{};
};
/// Decodes two 24-bit numbers times `unit` (position_unit or velocity_unit); empty: a reserved bit is set.
[[nodiscard]] constexpr std::optional<Pair> decode_pair(const hal::CanFrame& f, float unit) {
  if ((f.data[1] >> 5U) != 0) return std::nullopt;
  return Pair{
      static_cast<Space>(f.data[1] >> 4U),
      {static_cast<float>(detail::get_i24(f, 2)) * unit, static_cast<float>(detail::get_i24(f, 5)) * unit}};
}

/// A new value for a gain.
struct ParameterWrite {
  std::uint8_t index = 0;
  float value = 0;
};
/// Decodes a write; empty: a reserved bit is set. Index and value are not checked: the value may be a NaN.
[[nodiscard]] constexpr std::optional<ParameterWrite> decode_parameter_write(const hal::CanFrame& f) {
  if ((f.data[1] >> 4U) != 0 || f.data[3] != 0) return std::nullopt;
  return ParameterWrite{f.data[2], detail::get_float(f, 4)};
}

/// A request for data: its subject and index.
struct RequestFrame {
  Subject subject = Subject::faults;
  std::uint8_t index = 0;  ///< of a parameter, or of a block of captured ticks
};
/// Decodes a request; empty: unknown subject, or a reserved bit is set. The index is not checked.
[[nodiscard]] constexpr std::optional<RequestFrame> decode_request(const hal::CanFrame& f) {
  if ((f.data[1] >> 4U) != 0 || f.data[2] >= subject_count || get_field(f, 4, 4) != 0) return std::nullopt;
  return RequestFrame{static_cast<Subject>(f.data[2]), f.data[3]};
}

// ---- from the controller

/// Reaction to the latched fault.
enum class Reacted : std::uint8_t { none = 0, zero_torque = 1, halt = 2 };

/// Wanted speed of the reference along its path.
enum class Pace : std::uint8_t { full = 0, reduced = 1, held = 2 };

/// Cyclic state of the controller.
struct Status {
  State state = State::disabled;
  Fault fault = Fault::none;
  Reacted reaction = Reacted::none;
  Source source = Source::reference;
  bool streaming = false;
  std::uint32_t tick = 0;  ///< 24 bits are sent
  std::uint8_t session = 1;
  Pace pace = Pace::full;
  bool zero_unknown = false;  ///< encoders that lose their zero without power, and it is not confirmed
};
/// Status with its checksum; the low four bits of `counter` are sent.
[[nodiscard]] constexpr hal::CanFrame encode_status(std::uint32_t base, const Status& s,
                                                    std::uint8_t counter) {
  hal::CanFrame f = detail::frame(base, Message::status);
  f.data[1] = static_cast<std::uint8_t>((counter & 0x0FU) | (static_cast<unsigned>(s.state) << 4U));
  f.data[2] = static_cast<std::uint8_t>(s.fault);
  f.data[3] = static_cast<std::uint8_t>(
      static_cast<unsigned>(s.reaction) | (static_cast<unsigned>(s.source) << 2U) |
      (s.streaming ? 0x10U : 0U) | (s.zero_unknown ? 0x20U : 0U) | (static_cast<unsigned>(s.pace) << 6U));
  put_field(f, 4, s.tick, 3);
  f.data[7] = s.session;
  f.data[0] = checksum(f, s.session);
  return f;
}

/// Record of a fault: its last occurrence and their number.
struct FaultRecord {
  Fault fault = Fault::none;      ///< none: end of a readout of `count` records
  std::uint8_t axis = no_axis;    ///< motor with a drive error; loop_not_closed: encoder, passive ones last
  std::uint16_t count = 0;        ///< occurrences since power-up
  std::uint32_t time_us = 0;      ///< of the last one, since power-up, modulo 2^32
  std::uint32_t drive_error = 0;  ///< error code of the drive
};
/// First of the two frames of a record: fault, axis, count, time.
[[nodiscard]] constexpr hal::CanFrame encode_fault_record(std::uint32_t base, const FaultRecord& r) {
  hal::CanFrame f = detail::frame(base, Message::fault_record);
  f.data[0] = static_cast<std::uint8_t>(r.fault);
  f.data[1] = r.axis;
  put_field(f, 2, r.count, 2);
  put_field(f, 4, r.time_us, 4);
  return f;
}
/// Second of the two frames of a record: fault, axis, drive error.
[[nodiscard]] constexpr hal::CanFrame encode_fault_detail(std::uint32_t base, const FaultRecord& r) {
  hal::CanFrame f = detail::frame(base, Message::fault_detail);
  f.data[0] = static_cast<std::uint8_t>(r.fault);
  f.data[1] = r.axis;
  put_field(f, 4, r.drive_error, 4);
  return f;
}

/// Value of a parameter, in the unit of its Index, with the answer to a write of it or a request.
[[nodiscard]] constexpr hal::CanFrame encode_parameter_value(std::uint32_t base, std::uint8_t index,
                                                             Answer answer, bool writable, float value) {
  hal::CanFrame f = detail::frame(base, Message::parameter_value);
  f.data[0] = index;
  f.data[1] = static_cast<std::uint8_t>(answer);
  f.data[2] = writable ? 1 : 0;
  detail::put_float(f, 4, value);
  return f;
}
/// Checksum of the table (Parameters::crc) and number of its entries.
[[nodiscard]] constexpr hal::CanFrame encode_parameter_table(std::uint32_t base, std::uint32_t crc,
                                                             std::uint8_t count) {
  hal::CanFrame f = detail::frame(base, Message::parameter_table);
  put_field(f, 0, crc, 4);
  f.data[4] = count;
  return f;
}

/// Identity. `scene`: CRC-32 of the values of the scene that the controller was made of; 0: not known.
/// `unattended`: its reference goes on without a sign of life.
[[nodiscard]] constexpr hal::CanFrame encode_identity(std::uint32_t base, std::uint32_t scene,
                                                      bool unattended) {
  hal::CanFrame f = detail::frame(base, Message::identity);
  put_field(f, 0, scene, 4);
  f.data[4] = protocol_version;
  f.data[5] = unattended ? 1 : 0;
  return f;
}
/// An Identity as received.
struct IdentityFrame {
  std::uint32_t scene = 0;   ///< as in encode_identity()
  std::uint8_t version = 0;  ///< protocol_version of the controller
  bool unattended = false;
};
/// Empty unless the frame is the Identity of a controller at this base: all but the version is checked.
[[nodiscard]] constexpr std::optional<IdentityFrame> decode_identity(const hal::CanFrame& f,
                                                                     std::uint32_t base) {
  if (f.id != base + static_cast<std::uint32_t>(Message::identity) || f.extended || f.remote || f.fd ||
      f.size != 8) {
    return std::nullopt;
  }
  return IdentityFrame{get_field(f, 0, 4), f.data[4], (f.data[5] & 1U) != 0};
}

/// Result of the last order to the store of parameters.
enum class StoreState : std::uint8_t {
  none = 0,  ///< there is no store, or it cannot be used
  idle = 1,  ///< no order since power-up
  storing = 2,
  stored = 3,
  forgetting = 4,
  forgotten = 5,
  failed = 6,
};
inline constexpr std::array<const char*, 7> store_state_names{"none",       "idle",      "storing", "stored",
                                                              "forgetting", "forgotten", "failed"};
[[nodiscard]] constexpr const char* name(StoreState s) { return name_in(store_state_names, s); }

/// Content of a slot of the store.
enum class SlotContent : std::uint8_t {
  empty = 0,
  valid = 1,
  damaged = 2,        ///< torn, or not one of our records
  other_format = 3,   ///< of another version of the firmware
  other_scene = 4,    ///< intact, of an image of another scene
  out_of_bounds = 5,  ///< a value is outside the baked bounds, or differs although it is not writable
};
inline constexpr std::array<const char*, 6> slot_content_names{
    "empty", "valid", "damaged", "other_format", "other_scene", "out_of_bounds"};
[[nodiscard]] constexpr const char* name(SlotContent c) { return name_in(slot_content_names, c); }

/// State of the store of parameters.
struct StoreStatus {
  StoreState state = StoreState::none;
  std::uint8_t used = 0;  ///< slot of the gains in use since power-up, 1 or 2; 0: the baked gains
  std::array<SlotContent, 2> slots{};
  std::uint32_t sequence = 0;  ///< of the newest valid record
  bool memory_busy = false;    ///< not sent: the memory goes on with an operation that timed out
  friend constexpr bool operator==(const StoreStatus&, const StoreStatus&) = default;
};
/// Frame Parameter_Slots: state of the store, slot in use, content of the slots, sequence number.
[[nodiscard]] constexpr hal::CanFrame encode_parameter_slots(std::uint32_t base, const StoreStatus& s) {
  hal::CanFrame f = detail::frame(base, Message::parameter_slots);
  f.data[0] = static_cast<std::uint8_t>(s.state);
  f.data[1] = s.used;
  f.data[2] = static_cast<std::uint8_t>(s.slots[0]);
  f.data[3] = static_cast<std::uint8_t>(s.slots[1]);
  put_field(f, 4, s.sequence, 4);
  return f;
}

/// Received frames since power-up, modulo 65536: what was done with a frame shows as a difference for ever.
struct Counters {
  std::uint16_t obeyed = 0;
  std::uint16_t bad_crc = 0;
  std::uint16_t bad_counter = 0;
  std::uint16_t refused = 0;  ///< everything else: length, format, value, age, not in this state
};
/// Frame Link_Counters with the counts of received frames.
[[nodiscard]] constexpr hal::CanFrame encode_counters(std::uint32_t base, const Counters& c) {
  hal::CanFrame f = detail::frame(base, Message::link_counters);
  put_field(f, 0, c.obeyed, 2);
  put_field(f, 2, c.bad_crc, 2);
  put_field(f, 4, c.bad_counter, 2);
  put_field(f, 6, c.refused, 2);
  return f;
}
/// Whether captured ticks can be read.
enum class CaptureState : std::uint8_t {
  none = 0,       ///< the board keeps none
  recording = 1,  ///< not now: the controller is armed
  ready = 2,
};
inline constexpr std::array<const char*, 3> capture_state_names{"none", "recording", "ready"};

/// A record travels in capture_parts frames; torques are in steps of their limit / capture_torque_steps.
inline constexpr std::size_t capture_record_size = 24, capture_part_size = 6,
                             capture_parts = capture_record_size / capture_part_size;
inline constexpr float capture_torque_steps = 32767.0F;
/// In the place of the number of a part: the bytes are CaptureState, 0, count of records (2), records made
/// since power-up (2), by which a reader sees that records have changed.
inline constexpr std::uint16_t capture_status = 0xFFFF;
using CapturePart = std::array<std::uint8_t, capture_part_size>;
/// Frame of a part; `number`: capture_parts * record, 0 the oldest, + part of it; or capture_status.
[[nodiscard]] constexpr hal::CanFrame encode_capture(std::uint32_t base, std::uint16_t number,
                                                     const CapturePart& part) {
  hal::CanFrame f = detail::frame(base, Message::capture);
  put_field(f, 0, number, 2);
  for (unsigned i = 0; i < capture_part_size; ++i) f.data[2 + i] = part[i];
  return f;
}
/// Frame of two floats from the controller; `message`: effector (m), tracking_error (m), joint_i (rad, N m).
[[nodiscard]] constexpr hal::CanFrame encode_floats(std::uint32_t base, std::uint8_t message, float first,
                                                    float second) {
  hal::CanFrame f = hal::data_frame(base + message, 8);
  detail::put_float(f, 0, first);
  detail::put_float(f, 4, second);
  return f;
}

}  // namespace esmc::link
