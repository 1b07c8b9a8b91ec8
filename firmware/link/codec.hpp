#pragma once
/// The command interface on the wire: identifiers, bytes and units. docs/command-interface.md says what the
/// messages are for, docs/esmc.dbc has the same layout in the words of a DBC file, and tests/link compares
/// the two.
///
/// id = base + Message, 11 bits, base a multiple of block_size; classic frames of 8 bytes, little endian.
/// Every frame to the controller, and Status, begins with
///
///   byte 0  CRC-8/SAE-J1850 over: identifier (low byte, high byte), session, bytes 1..7
///   byte 1  bits 0..3 alive counter, bits 4..7 belong to the message

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

inline constexpr std::uint32_t block_size = 32;  ///< identifiers: as many as one node of CANSimple has

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
  identity = 0x1C,  ///< which scene the controller was made of
  parameter_slots = 0x1D,
};
inline constexpr std::uint8_t incoming_count = 6;
inline constexpr std::uint8_t outgoing_first = 0x10;
inline constexpr std::uint8_t joints_max = 4;

/// Orders.
enum class Order : std::uint8_t {
  none,          ///< a sign of life
  arm,           ///< Command::enable
  disarm,        ///< Command::halt: to rest first, where the configuration allows it
  off,           ///< Command::stop: no torque from the next tick on
  reset,         ///< Command::reset: the operator has seen the fault
  confirm_zero,  ///< Command::confirm_zero
  hold,          ///< where the mechanism is: from the next start on, or at once while it is guided
  reference,     ///< the reference of the configuration: from the next start on
  stream,        ///< set points and samples: from the next start on
  store,         ///< the gains as they are, for power-ups to come
  forget,        ///< the baked gains, now and for power-ups to come
};
inline constexpr std::uint8_t order_count = 11;

/// Where the reference comes from.
enum class Source : std::uint8_t { hold, reference, stream };

/// What a set point is given in: metres or radians.
enum class Space : std::uint8_t { effector, base_joints };

/// What became of a write.
enum class Answer : std::uint8_t {
  ok,
  unknown_index,
  read_only,
  out_of_bounds,
  not_now,  ///< only while disabled
};

/// What can be asked for.
enum class Subject : std::uint8_t { faults, parameter, table };
inline constexpr std::uint8_t subject_count = 3;

/// A session that no controller has: disarm and off are taken with it as well, from whoever has not heard a
/// Status.
inline constexpr std::uint8_t any_session = 0;
inline constexpr std::uint8_t no_axis = 0xFF;

inline constexpr float position_unit = 1e-6F;  ///< m or rad
inline constexpr float velocity_unit = 1e-5F;  ///< m/s or rad/s

namespace detail {
using Frame = hal::CanFrame;
constexpr void put(Frame& f, unsigned at, std::uint32_t v, unsigned bytes) {
  for (unsigned i = 0; i < bytes; ++i) f.data[at + i] = static_cast<std::uint8_t>(v >> (8U * i));
}
constexpr std::uint32_t get(const Frame& f, unsigned at, unsigned bytes) {
  std::uint32_t v = 0;
  for (unsigned i = 0; i < bytes; ++i) v |= std::uint32_t{f.data[at + i]} << (8U * i);
  return v;
}
constexpr void put_float(Frame& f, unsigned at, float v) { put(f, at, std::bit_cast<std::uint32_t>(v), 4); }
[[nodiscard]] constexpr float get_float(const Frame& f, unsigned at) {
  return std::bit_cast<float>(get(f, at, 4));
}
/// Two's complement of 24 bits.
[[nodiscard]] constexpr std::int32_t get_i24(const Frame& f, unsigned at) {
  constexpr std::uint32_t sign = 0x80'0000;
  return static_cast<std::int32_t>((get(f, at, 3) ^ sign)) - static_cast<std::int32_t>(sign);
}
[[nodiscard]] constexpr Frame frame(std::uint32_t base, std::uint8_t message) {
  Frame f;
  f.id = base + message;
  f.size = 8;
  return f;
}
[[nodiscard]] constexpr Frame frame(std::uint32_t base, Message m) {
  return frame(base, static_cast<std::uint8_t>(m));
}
}  // namespace detail

/// What byte 0 of a frame must be.
[[nodiscard]] constexpr std::uint8_t checksum(const hal::CanFrame& f, std::uint8_t session) {
  std::uint8_t c = crc8_part(crc8_start, static_cast<std::uint8_t>(f.id));
  c = crc8_part(c, static_cast<std::uint8_t>(f.id >> 8U));
  c = crc8_part(c, session);
  for (unsigned i = 1; i < 8; ++i) c = crc8_part(c, f.data[i]);
  return static_cast<std::uint8_t>(c ^ crc8_inverted);
}
[[nodiscard]] constexpr bool intact(const hal::CanFrame& f, std::uint8_t session) {
  return f.data[0] == checksum(f, session);
}
[[nodiscard]] constexpr std::uint8_t counter_of(const hal::CanFrame& f) { return f.data[1] & 0x0FU; }

// ---- to the controller: empty where a bit that has no meaning is set, or a value has none
// ------------------------

/// An order, and the sign of life.
struct CommandFrame {
  Order order = Order::none;
  std::uint16_t tick = 0;  ///< of the last Status heard, its low 16 bits
  std::uint16_t parameters =
      0;  ///< low half of the CRC-32 of the table: what is armed is what the operator knows
};
[[nodiscard]] constexpr std::optional<CommandFrame> decode_command(const hal::CanFrame& f) {
  if ((f.data[1] >> 4U) != 0 || f.data[2] >= order_count || f.data[3] != 0) return std::nullopt;
  return CommandFrame{static_cast<Order>(f.data[2]), static_cast<std::uint16_t>(detail::get(f, 4, 2)),
                      static_cast<std::uint16_t>(detail::get(f, 6, 2))};
}

/// Two coordinates: the effector's x and y, or the base joints.
struct Pair {
  Space space = Space::effector;
  std::array<float, 2> value{};
};
/// `unit`: position_unit or velocity_unit.
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
[[nodiscard]] constexpr std::optional<ParameterWrite> decode_parameter_write(const hal::CanFrame& f) {
  if ((f.data[1] >> 4U) != 0 || f.data[3] != 0) return std::nullopt;
  return ParameterWrite{f.data[2], detail::get_float(f, 4)};
}

/// A question.
struct RequestFrame {
  Subject subject = Subject::faults;
  std::uint8_t index = 0;  ///< of a parameter
};
[[nodiscard]] constexpr std::optional<RequestFrame> decode_request(const hal::CanFrame& f) {
  if ((f.data[1] >> 4U) != 0 || f.data[2] >= subject_count || detail::get(f, 4, 4) != 0) return std::nullopt;
  return RequestFrame{static_cast<Subject>(f.data[2]), f.data[3]};
}

// ---- from the controller
// --------------------------------------------------------------------------------------

/// What stands in Status about the reaction to the latched fault.
enum class Reacted : std::uint8_t { none, zero_torque, halt };

/// What the controller says cyclically.
struct Status {
  State state = State::disabled;
  Fault fault = Fault::none;
  Reacted reaction = Reacted::none;
  Source source = Source::reference;
  bool streaming = false;
  std::uint32_t tick = 0;  ///< 24 bits are sent
  std::uint8_t session = 1;
};
[[nodiscard]] constexpr hal::CanFrame encode_status(std::uint32_t base, const Status& s,
                                                    std::uint8_t counter) {
  hal::CanFrame f = detail::frame(base, Message::status);
  f.data[1] = static_cast<std::uint8_t>((counter & 0x0FU) | (static_cast<unsigned>(s.state) << 4U));
  f.data[2] = static_cast<std::uint8_t>(s.fault);
  f.data[3] = static_cast<std::uint8_t>(static_cast<unsigned>(s.reaction) |
                                        (static_cast<unsigned>(s.source) << 2U) | (s.streaming ? 0x10U : 0U));
  detail::put(f, 4, s.tick, 3);
  f.data[7] = s.session;
  f.data[0] = checksum(f, s.session);
  return f;
}

/// A fault as it is reported.
struct FaultRecord {
  Fault fault = Fault::none;      ///< none: the end of a readout, `count` of them were sent
  std::uint8_t axis = no_axis;    ///< motor that had something to say about it; loop_not_closed: the encoder,
                                  ///< after the motors where it is passive
  std::uint16_t count = 0;        ///< since power-up
  std::uint32_t time_us = 0;      ///< of the last one, since power-up, modulo 2^32
  std::uint32_t drive_error = 0;  ///< in the words of the drive
};
[[nodiscard]] constexpr hal::CanFrame encode_fault_record(std::uint32_t base, const FaultRecord& r) {
  hal::CanFrame f = detail::frame(base, Message::fault_record);
  f.data[0] = static_cast<std::uint8_t>(r.fault);
  f.data[1] = r.axis;
  detail::put(f, 2, r.count, 2);
  detail::put(f, 4, r.time_us, 4);
  return f;
}
[[nodiscard]] constexpr hal::CanFrame encode_fault_detail(std::uint32_t base, const FaultRecord& r) {
  hal::CanFrame f = detail::frame(base, Message::fault_detail);
  f.data[0] = static_cast<std::uint8_t>(r.fault);
  f.data[1] = r.axis;
  detail::put(f, 4, r.drive_error, 4);
  return f;
}

[[nodiscard]] constexpr hal::CanFrame encode_parameter_value(std::uint32_t base, std::uint8_t index,
                                                             Answer answer, bool writable, float value) {
  hal::CanFrame f = detail::frame(base, Message::parameter_value);
  f.data[0] = index;
  f.data[1] = static_cast<std::uint8_t>(answer);
  f.data[2] = writable ? 1 : 0;
  detail::put_float(f, 4, value);
  return f;
}
[[nodiscard]] constexpr hal::CanFrame encode_parameter_table(std::uint32_t base, std::uint32_t crc,
                                                             std::uint8_t count) {
  hal::CanFrame f = detail::frame(base, Message::parameter_table);
  detail::put(f, 0, crc, 4);
  f.data[4] = count;
  return f;
}

inline constexpr std::uint8_t interface_version = 1;
/// `scene`: CRC-32 of what of the scene is in the controller; 0: not known.
[[nodiscard]] constexpr hal::CanFrame encode_identity(std::uint32_t base, std::uint32_t scene) {
  hal::CanFrame f = detail::frame(base, Message::identity);
  detail::put(f, 0, scene, 4);
  f.data[4] = interface_version;
  return f;
}
/// Empty: not the controller's at this base. For whoever wants to know whom it is talking to.
[[nodiscard]] constexpr std::optional<std::uint32_t> decode_identity(const hal::CanFrame& f,
                                                                     std::uint32_t base) {
  if (f.id != base + static_cast<std::uint32_t>(Message::identity) || f.extended || f.remote || f.fd ||
      f.size != 8) {
    return std::nullopt;
  }
  return static_cast<std::uint32_t>(detail::get(f, 0, 4));
}

/// What has become of the last order to the store of parameters.
enum class StoreState : std::uint8_t {
  none,  ///< there is no store, or it cannot be used
  idle,  ///< nothing was ordered since power-up
  storing,
  stored,
  forgetting,
  forgotten,
  failed,
};
/// What is in a slot of the store.
enum class SlotContent : std::uint8_t {
  empty,
  valid,
  damaged,        ///< torn, or never one of our records
  other_format,   ///< of another version of the firmware
  other_scene,    ///< intact, of an image that was made of another scene
  out_of_bounds,  ///< a value is not finite, not within the baked bounds, or not writable and another one
};
[[nodiscard]] constexpr const char* name(StoreState s) {
  switch (s) {
    case StoreState::none:
      return "none";
    case StoreState::idle:
      return "idle";
    case StoreState::storing:
      return "storing";
    case StoreState::stored:
      return "stored";
    case StoreState::forgetting:
      return "forgetting";
    case StoreState::forgotten:
      return "forgotten";
    case StoreState::failed:
      return "failed";
  }
  return "unknown";
}
[[nodiscard]] constexpr const char* name(SlotContent c) {
  switch (c) {
    case SlotContent::empty:
      return "empty";
    case SlotContent::valid:
      return "valid";
    case SlotContent::damaged:
      return "damaged";
    case SlotContent::other_format:
      return "other_format";
    case SlotContent::other_scene:
      return "other_scene";
    case SlotContent::out_of_bounds:
      return "out_of_bounds";
  }
  return "unknown";
}
/// The slots of parameters.
struct StoreStatus {
  StoreState state = StoreState::none;
  std::uint8_t used =
      0;  ///< slot that the gains were taken from at power-up, 1 or 2; 0: none, they were the baked ones
  std::array<SlotContent, 2> slots{};
  std::uint32_t sequence = 0;  ///< of the newest valid record
  friend constexpr bool operator==(const StoreStatus&, const StoreStatus&) = default;
};
[[nodiscard]] constexpr hal::CanFrame encode_parameter_slots(std::uint32_t base, const StoreStatus& s) {
  hal::CanFrame f = detail::frame(base, Message::parameter_slots);
  f.data[0] = static_cast<std::uint8_t>(s.state);
  f.data[1] = s.used;
  f.data[2] = static_cast<std::uint8_t>(s.slots[0]);
  f.data[3] = static_cast<std::uint8_t>(s.slots[1]);
  detail::put(f, 4, s.sequence, 4);
  return f;
}

/// What came in, since power-up; each stops at 65535.
struct Counters {
  std::uint16_t obeyed = 0;
  std::uint16_t bad_crc = 0;
  std::uint16_t bad_counter = 0;
  std::uint16_t refused = 0;  ///< everything else: length, format, value, age, not in this state
};
[[nodiscard]] constexpr hal::CanFrame encode_counters(std::uint32_t base, const Counters& c) {
  hal::CanFrame f = detail::frame(base, Message::link_counters);
  detail::put(f, 0, c.obeyed, 2);
  detail::put(f, 2, c.bad_crc, 2);
  detail::put(f, 4, c.bad_counter, 2);
  detail::put(f, 6, c.refused, 2);
  return f;
}
/// Two floats: effector m, tracking_error m, joint_i rad and N m.
[[nodiscard]] constexpr hal::CanFrame encode_floats(std::uint32_t base, std::uint8_t message, float first,
                                                    float second) {
  hal::CanFrame f = detail::frame(base, message);
  detail::put_float(f, 0, first);
  detail::put_float(f, 4, second);
  return f;
}

}  // namespace esmc::link
