#pragma once
/// mjbots moteus on the wire: registers, written and read in one CAN FD frame.
///
///   identifier  source << 8 | destination, of 7 bits each; bit 15: a reply is wanted. We are node 0, so a
///               command is 8000h + node (29 bits) and its reply node << 8 (11 bits up to node 7)
///   data        subframes, little-endian, and no-operation 50h up to a size that CAN FD has
///   subframe    code, [count], first register, values.  code: kind << 4 | type << 2 | count; a count of 0
///               follows as a number of 7 bits per byte, low ones first, as the register does.
///               Errors, 30h (write) and 31h (read): register, number
///
/// Source of registers and formats: the vendor's documents "CAN protocol" and "Register reference".

#include <bit>
#include <cstdint>
#include <limits>
#include <optional>

#include "hal/can.hpp"

/// mjbots moteus on the wire.
namespace esmc::drive::moteus {

/// Kinds of subframe.
enum class Kind : std::uint8_t { write, read, reply, error };
/// Types of the values of a subframe: integers of 8, 16, 32 bits, binary32.
enum class Type : std::uint8_t { i8, i16, i32, f32 };

/// Registers, in turns, N m and seconds at the drive's output where they are no plain numbers.
namespace reg {
enum : std::uint16_t {
  mode = 0x000,
  position = 0x001,
  velocity = 0x002,
  torque = 0x003,
  home_state = 0x00C,  ///< 0: position is relative to power-up
  fault_code = 0x00F,  ///< of mode fault; in other modes which limit acts
  position_command = 0x020,
  velocity_command = 0x021,
  feedforward_torque = 0x022,
  kp_scale = 0x023,
  kd_scale = 0x024,
  max_torque = 0x025,
  stop_position = 0x026,
  watchdog_timeout = 0x027,
  velocity_limit = 0x028,
  commands = 9,         ///< registers from position_command on
  map_version = 0x102,  ///< of the registers
};
}  // namespace reg
inline constexpr std::uint32_t map_version_known = 5;
inline constexpr std::uint32_t no_register = 0xFFFF'FFFF;

/// Destination of a frame that every moteus obeys (mjbots mjlib, multiplex/format.h).
inline constexpr std::uint32_t to_all = 0x7F;

/// Values of register mode. Stopped clears faults and is the only way out of a time-out.
inline constexpr std::uint8_t mode_stopped = 0, mode_fault = 1, mode_position = 10, mode_timeout = 11;

inline constexpr std::uint8_t no_operation = 0x50;
inline constexpr std::uint32_t reply_wanted = 0x8000;
inline constexpr float i16_torque = 0.01F, i16_time = 0.001F;  ///< N m and s of an i16

/// Number of bytes of a value.
[[nodiscard]] constexpr std::uint8_t width(Type t) {
  return t == Type::f32 ? 4 : static_cast<std::uint8_t>(1U << static_cast<unsigned>(t));
}

/// Value of one step of an integer in register `name`: turns, turns/s, N m, s; 1 for plain numbers and f32.
[[nodiscard]] constexpr float unit(std::uint32_t name, Type t) {
  constexpr float units[][3] = {{1e-2F, 1e-4F, 1e-5F},    // turns
                                {1e-1F, 2.5e-4F, 1e-5F},  // turns/s
                                {0.5F, i16_torque, 1e-3F},
                                {1e-2F, i16_time, 1e-6F},
                                {1.0F / 127.0F, 1.0F / 32767.0F, 1.0F / 2147483647.0F}};
  constexpr std::uint8_t of_commands[] = {0, 1, 2, 4, 4, 2, 0, 3, 1};  // rows for position_command and on
  const std::uint32_t state = name - reg::position, command = name - reg::position_command;
  if (t == Type::f32 || (state > 2 && command >= reg::commands)) return 1.0F;
  return units[state <= 2 ? state : of_commands[command]][static_cast<int>(t)];
}

/// Number at data byte `at` of a frame, in the unit of register `name`; NaN for the most negative integer.
/// The caller ensures that its bytes are in the frame.
[[nodiscard]] constexpr float value_at(const hal::CanFrame& f, std::uint8_t at, Type t, std::uint32_t name) {
  const std::uint32_t raw = hal::get_field(f, at, width(t));
  if (t == Type::f32) return std::bit_cast<float>(raw);
  const std::uint32_t sign = 1U << (8U * width(t) - 1U);
  if (raw == sign) return std::numeric_limits<float>::quiet_NaN();
  const auto number = static_cast<std::int32_t>((raw ^ sign) - sign);
  return static_cast<float>(number) * unit(name, t);
}

/// One subframe as Subframes reads it.
struct Subframe {
  Kind kind = Kind::read;
  Type type = Type::i8;
  std::uint32_t first = 0;  ///< register; of an error the one that is refused
  std::uint32_t count = 0;  ///< of registers, > 0; 0 for an error
  std::uint8_t at = 0;      ///< data byte of the first value
};

/// Reads the subframes of a frame in order; any bytes are safe. The frame must outlive this object.
class Subframes {
 public:
  explicit constexpr Subframes(const hal::CanFrame& f)
      : f_(&f), size_(f.size < hal::can_fd_size_max ? f.size : hal::can_fd_size_max) {}

  /// Reads the next subframe. False: there is none, or the rest is malformed().
  [[nodiscard]] constexpr bool next(Subframe& s) {
    while (at_ < size_ && f_->data[at_] == no_operation) ++at_;
    if (at_ == size_ || malformed_) return false;
    const std::uint8_t code = f_->data[at_++];
    s.kind = static_cast<Kind>(code >> 4U);
    s.type = static_cast<Type>(code >> 2U & 3U);
    s.count = code & 3U;
    malformed_ = code > 0x31 || !rest(s);
    return !malformed_;
  }
  [[nodiscard]] constexpr bool malformed() const { return malformed_; }  ///< latched by a malformed subframe

 private:
  constexpr bool rest(Subframe& s) {
    if (s.kind == Kind::error) {
      s.count = 0;
      std::uint32_t number = 0;
      return unsigned_number(s.first) && unsigned_number(number);
    }
    if (s.count == 0 && !unsigned_number(s.count)) return false;
    if (s.count == 0 || s.count > hal::can_fd_size_max || !unsigned_number(s.first)) return false;
    s.at = at_;
    if (s.kind == Kind::read) return true;
    const std::uint32_t bytes = s.count * width(s.type);
    if (bytes > static_cast<std::uint32_t>(size_ - at_)) return false;
    at_ = static_cast<std::uint8_t>(at_ + bytes);
    return true;
  }
  /// At most 32 bits.
  constexpr bool unsigned_number(std::uint32_t& v) {
    v = 0;
    for (unsigned shift = 0; at_ < size_; shift += 7) {
      const std::uint32_t byte = f_->data[at_++];
      if (shift == 28 && byte > 0x0F) return false;
      v |= (byte & 0x7FU) << shift;
      if (byte < 0x80) return true;
    }
    return false;
  }

  const hal::CanFrame* f_;
  std::uint8_t size_, at_ = 0;
  bool malformed_ = false;
};

/// Appends subframes to a frame, whose data it overwrites. The caller ensures that they fit into 64 bytes.
class Builder {
 public:
  /// `f` becomes a CAN FD frame with 29 bits of identifier where it needs them.
  constexpr Builder(hal::CanFrame& f, std::uint32_t id) : f_(&f) {
    f.id = id;
    f.extended = id > 0x7FF;
    f.fd = f.bit_rate_switch = true;
    f.size = 0;
  }
  /// Begins a subframe of 1 to 3 registers, below 4000h.
  constexpr void begin(Kind k, Type t, std::uint32_t count, std::uint32_t first) {
    byte(static_cast<std::uint32_t>(k) << 4U | static_cast<std::uint32_t>(t) << 2U | count);
    unsigned_number(first);
  }
  /// Appends a value: the low bytes of an integer.
  constexpr void value(Type t, std::int32_t v) { field(static_cast<std::uint32_t>(v), width(t)); }
  /// Appends a value of type f32.
  constexpr void value(float v) { field(std::bit_cast<std::uint32_t>(v), 4); }
  /// Appends an error subframe: reading or writing register `name`, below 4000h, is refused with `number`.
  constexpr void error(bool read, std::uint32_t name, std::uint32_t number) {
    byte(read ? 0x31 : 0x30);
    unsigned_number(name);
    byte(number);
  }
  /// Appends no-operation up to the next size of CAN FD.
  constexpr void pad() {
    const std::uint8_t size = hal::can_fd_size(f_->size);
    while (f_->size < size) byte(no_operation);
  }
  /// Appends the reads of every command: mode, position, velocity, torque, fault. The reply has 20 bytes.
  constexpr void query() {
    begin(Kind::read, Type::i8, 1, reg::mode);
    begin(Kind::read, Type::f32, 3, reg::position);
    begin(Kind::read, Type::i8, 1, reg::fault_code);
  }

 private:
  constexpr void byte(std::uint32_t v) { field(v, 1); }
  constexpr void unsigned_number(std::uint32_t v) {
    if (v > 0x7F) byte((v & 0x7FU) | 0x80U);
    byte(v > 0x7F ? v >> 7U : v);
  }
  constexpr void field(std::uint32_t v, std::uint8_t bytes) {
    hal::put_field(*f_, f_->size, v, bytes);
    f_->size = static_cast<std::uint8_t>(f_->size + bytes);
  }

  hal::CanFrame* f_;
};

/// Limits that go with every torque, as integers of 16 bits: steps of 0.01 N m and 1 ms, > 0.
struct Limits {
  std::int16_t torque = 1, time = 1;
};
/// Bytes of a torque command, and of the reply to it.
inline constexpr std::uint8_t torque_size = 32, reply_size = 20;

/// Writes a frame into f that reads, besides the query, the version of the registers and whether the position
/// is absolute. `stop`: it is a command, no torque and faults cleared.
constexpr void put_query(hal::CanFrame& f, std::uint8_t node, bool stop) {
  Builder b(f, reply_wanted | node);
  if (stop) {
    b.begin(Kind::write, Type::i8, 1, reg::mode);
    b.value(Type::i8, mode_stopped);
  }
  b.query();
  b.begin(Kind::read, Type::i8, 1, reg::map_version);
  b.begin(Kind::read, Type::i8, 1, reg::home_state);
  b.pad();
}

/// Writes a torque command into f, 32 bytes: position mode without gains, `torque` (N m at the output, not
/// checked) as feedforward, and the limits. `check`: no torque instead, and the limits are read back.
constexpr void put_torque(hal::CanFrame& f, std::uint8_t node, float torque, Limits l, bool check) {
  constexpr std::int32_t here = -128;  // NaN: the present position
  Builder b(f, reply_wanted | node);
  b.begin(Kind::write, Type::i8, 1, reg::mode);
  b.value(Type::i8, mode_position);
  b.begin(Kind::write, Type::i8, check ? 3 : 2, reg::position_command);
  b.value(Type::i8, here);
  b.value(Type::i8, 0);
  if (check) {
    b.value(Type::i8, 0);
  } else {
    b.begin(Kind::write, Type::f32, 1, reg::feedforward_torque);
    b.value(torque);
  }
  b.begin(Kind::write, Type::i8, 2, reg::kp_scale);
  b.value(Type::i8, 0);
  b.value(Type::i8, 0);
  b.begin(Kind::write, Type::i16, 1, reg::max_torque);
  b.value(Type::i16, l.torque);
  b.begin(Kind::write, Type::i16, 1, reg::watchdog_timeout);
  b.value(Type::i16, l.time);
  b.query();
  if (check) {
    b.begin(Kind::read, Type::i16, 1, reg::max_torque);
    b.begin(Kind::read, Type::i16, 1, reg::watchdog_timeout);
  }
  b.pad();
}

/// Values in a reply. NaN: not in the reply, or for position and velocity, not known to the drive.
struct Reply {
  static constexpr float none = std::numeric_limits<float>::quiet_NaN();
  float position = none, velocity = none, torque = none;              ///< turns, turns/s, N m at the output
  float mode = none, fault = none;                                    ///< whole, 0 to 255
  float version = none, home = none, max_torque = none, time = none;  ///< -, -, N m, s: see reg
  std::uint32_t refused = no_register;  ///< the last register with an error subframe
};

/// Decodes a reply; empty unless it is CAN FD, well-formed to its end and has mode, position, velocity,
/// torque and fault. Other registers are ignored. The caller checks the identifier.
[[nodiscard]] constexpr std::optional<Reply> decode_reply(const hal::CanFrame& f) {
  if (!f.fd) return std::nullopt;
  Reply r;
  unsigned seen = 0;  // bit i: register i
  Subframes in(f);
  for (Subframe s; in.next(s);) {
    if (s.kind == Kind::error) r.refused = s.first;
    if (s.kind != Kind::reply) continue;
    for (std::uint32_t i = 0; i < s.count; ++i) {
      const std::uint32_t name = s.first + i;
      const auto at = static_cast<std::uint8_t>(s.at + i * width(s.type));
      const float v = value_at(f, at, s.type, name);
      if (name < 16) seen |= 1U << name;
      if (name == reg::mode) r.mode = v;
      if (name == reg::position) r.position = v;
      if (name == reg::velocity) r.velocity = v;
      if (name == reg::torque) r.torque = v;
      if (name == reg::fault_code) r.fault = v;
      if (name == reg::home_state) r.home = v;
      if (name == reg::map_version) r.version = v;
      if (name == reg::max_torque) r.max_torque = v;
      if (name == reg::watchdog_timeout) r.time = v;
    }
  }
  constexpr unsigned wanted =
      1U << reg::mode | 1U << reg::position | 1U << reg::velocity | 1U << reg::torque | 1U << reg::fault_code;
  const auto byte = [](float v) { return v >= 0.0F && v <= 255.0F; };
  if (in.malformed() || (seen & wanted) != wanted || !byte(r.mode) || !byte(r.fault)) return std::nullopt;
  return r;
}

}  // namespace esmc::drive::moteus
