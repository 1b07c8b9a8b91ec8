#pragma once
/// MIT mode on the wire (mini cheetah, T-Motor AK, Damiao and similar): a command of eight bytes requests the
/// torque kp (p - q) + kd (v - dq) + t, and the drive answers with one frame. Big-endian bit fields, each a
/// range in 2^n - 1 steps; rad, rad/s and N m at the drive's output shaft.
///
///   command  p 16 | v 12 | kp 12 | kd 12 | t 12         identifier: the drive's node
///   special  seven bytes FF, then FC (enter motor mode), FD (leave it) or FE (set zero)
///   reply    node 8 | p 16 | v 12 | t 12 | vendor bytes  identifier: the master's, or the drive's node
///
/// CubeMars AK with driver board V3 has identifiers of 29 bits, another order, no special frames (every
/// command acts at once), and integers with a unit instead of codes in its reply:
///
///   command  kp 12 | kd 12 | p 16 | v 12 | t 12                           identifier: 0800h + node
///   reply    p 16, 0.1 deg | speed 16, 10 electrical rpm | current 16, 0.01 A | temperature 8 | error 8
///            signed                                                       identifier: 2900h + node
///
/// Zero is not a multiple of a step: the two nearest codes are half a step away, so "no torque" is
/// range / 4095 (4.4 mN m of 18 N m). `code` rounds to nearest, and zero up.

#include <cstdint>
#include <optional>

#include "hal/can.hpp"

/// MIT mode on the wire.
namespace esmc::drive::mit {

/// Formats of the reply, by vendor.
enum class Dialect : std::uint8_t {
  mini_cheetah,  ///< 5 bytes (without the low eight bits of the torque), 6, or 7 (with the supply voltage)
  cubemars,      ///< 8 bytes: ... temperature, error
  damiao,        ///< 8 bytes: error in the high half of byte 0, node in the low half; ... two temperatures
  cubemars_v3,   ///< of the driver board V3, see above
};

/// Ranges of position, speed and torque: codes stand for -range .. +range. They must equal those set in the
/// drive, which cannot be read back; a wrong one scales every number.
struct Ranges {
  float position = 12.5F;  ///< rad
  float velocity = 50.0F;  ///< rad/s
  float torque = 18.0F;    ///< N m
};

/// Last byte of the special frames.
enum class Special : std::uint8_t { enter = 0xFC, leave = 0xFD, set_zero = 0xFE };

inline constexpr std::uint16_t code_max_16 = 0xFFFF, code_max_12 = 0x0FFF;
inline constexpr std::uint16_t middle_16 = 0x8000, middle_12 = 0x0800;

/// Fields as they are on the wire: position has 16 bits, each other 12, which is not checked.
struct Command {
  std::uint16_t position = middle_16, velocity = middle_12, kp = 0, kd = 0, torque = middle_12;
};
/// Reply of a drive, as integers of the wire; of cubemars_v3 position and speed plus 8000h.
struct Reply {
  std::uint16_t position = middle_16, velocity = middle_12;
  std::uint16_t torque = middle_12;
  std::uint8_t error = 0;    ///< error code of the drive; 0 where the reply has none
  bool whole_torque = true;  ///< false: no torque, or without its low eight bits (5 bytes)
};

/// Code nearest to `value`: codes 0..code_max stand for -range..range, in the unit of `value`, and beyond is
/// clamped. The middle (just above zero) for a NaN, or unless the range is above 0.
[[nodiscard]] constexpr std::uint16_t code(float value, float range, std::uint16_t code_max) {
  if (!(range > 0.0F)) return static_cast<std::uint16_t>(code_max / 2U + 1U);
  if (value >= range) return code_max;
  if (value <= -range) return 0;
  if (!(value < range)) return static_cast<std::uint16_t>(code_max / 2U + 1U);
  const float steps = (value / range + 1.0F) * (0.5F * static_cast<float>(code_max));
  return static_cast<std::uint16_t>(steps + 0.5F);
}
/// The value of a code, in the unit of `range` (rad, rad/s or N m): the inverse of `code`.
[[nodiscard]] constexpr float value(std::uint16_t code, float range, std::uint16_t code_max) {
  return (2.0F * static_cast<float>(code) - static_cast<float>(code_max)) / static_cast<float>(code_max) *
         range;
}

/// Identifiers of cubemars_v3 without the node (8 bits): the control mode << 8. Modes above 10h are reports.
inline constexpr std::uint32_t v3_command = 0x0800, v3_reply = 0x2900, v3_command_max = 0x10FF;

/// Writes a command, in codes of the wire (see `code`), into f, which is a classic data frame already: only
/// identifier, size and data change. `node`: 11 bits. Not of cubemars_v3.
constexpr void put_command(hal::CanFrame& f, std::uint32_t node, const Command& c) {
  f.id = node;
  f.size = 8;
  f.data[0] = static_cast<std::uint8_t>(c.position >> 8U);
  f.data[1] = static_cast<std::uint8_t>(c.position);
  f.data[2] = static_cast<std::uint8_t>(c.velocity >> 4U);
  f.data[3] = static_cast<std::uint8_t>(c.velocity << 4U | c.kp >> 8U);
  f.data[4] = static_cast<std::uint8_t>(c.kp);
  f.data[5] = static_cast<std::uint8_t>(c.kd >> 4U);
  f.data[6] = static_cast<std::uint8_t>(c.kd << 4U | c.torque >> 8U);
  f.data[7] = static_cast<std::uint8_t>(c.torque);
}
/// Writes a command of any dialect into f, otherwise as above; `node` of cubemars_v3: 8 bits.
constexpr void put_command(hal::CanFrame& f, std::uint32_t node, const Command& c, Dialect d) {
  if (d != Dialect::cubemars_v3) return put_command(f, node, c);
  put_command(f, v3_command | node,
              {static_cast<std::uint16_t>(c.kp << 4U | c.kd >> 8U),
               static_cast<std::uint16_t>((c.kd & 0xFFU) << 4U | c.position >> 12U),
               static_cast<std::uint16_t>(c.position & 0x0FFFU), c.velocity, c.torque});
  f.extended = true;
}
/// Command in codes of the wire (see `code`) as a classic data frame. `node`: as in put_command().
[[nodiscard]] constexpr hal::CanFrame encode_command(std::uint32_t node, const Command& c,
                                                     Dialect d = Dialect::mini_cheetah) {
  hal::CanFrame f;
  put_command(f, node, c, d);
  return f;
}
/// Special frame to a node (11 bits): seven bytes FF, then `s`.
[[nodiscard]] constexpr hal::CanFrame encode_special(std::uint32_t node, Special s) {
  hal::CanFrame f = hal::data_frame(node, 8);
  for (unsigned i = 0; i < 7; ++i) f.data[i] = 0xFF;
  f.data[7] = static_cast<std::uint8_t>(s);
  return f;
}

/// True if a reply of this dialect may have `size` bytes: 5 to 7 for mini_cheetah, 8 for the others.
[[nodiscard]] constexpr bool has_reply_size(std::uint8_t size, Dialect d) {
  return d == Dialect::mini_cheetah ? size >= 5 && size <= 7 : size == 8;
}
/// True if the first byte of a reply names this node; of Damiao only the low four bits are compared.
[[nodiscard]] constexpr bool names(std::uint8_t first, std::uint8_t node, Dialect d) {
  return d == Dialect::damiao ? ((first ^ node) & 0x0FU) == 0 : first == node;
}

/// Decodes a reply; empty for a wrong length, remote or FD frame. The caller checks identifier and `names`.
[[nodiscard]] constexpr std::optional<Reply> decode_reply(const hal::CanFrame& f, Dialect d) {
  if (f.remote || f.fd || !has_reply_size(f.size, d)) return std::nullopt;
  Reply r;
  if (d == Dialect::cubemars_v3) {
    r.position = static_cast<std::uint16_t>((f.data[0] << 8U | f.data[1]) ^ middle_16);
    r.velocity = static_cast<std::uint16_t>((f.data[2] << 8U | f.data[3]) ^ middle_16);
    r.whole_torque = false;  // a current, in whose sign sources differ
    r.error = f.data[7];
    return r;
  }
  r.position = static_cast<std::uint16_t>(f.data[1] << 8U | f.data[2]);
  r.velocity = static_cast<std::uint16_t>(f.data[3] << 4U | f.data[4] >> 4U);
  r.torque = static_cast<std::uint16_t>((f.data[4] & 0x0FU) << 8U | (f.size > 5 ? f.data[5] : 0U));
  r.whole_torque = f.size > 5;
  if (d == Dialect::cubemars) r.error = f.data[7];
  if (d == Dialect::damiao) r.error = static_cast<std::uint8_t>(f.data[0] >> 4U);
  return r;
}

/// Reply of an emulated drive as a frame with identifier `id`, not of cubemars_v3. `size`: bytes of the
/// frame, for which the caller ensures has_reply_size(); vendor bytes other than the error are 0.
[[nodiscard]] constexpr hal::CanFrame encode_reply(std::uint32_t id, std::uint8_t node, const Reply& r,
                                                   Dialect d, std::uint8_t size) {
  hal::CanFrame f = hal::data_frame(id, size);
  f.data[0] = d == Dialect::damiao
                  ? static_cast<std::uint8_t>((std::uint32_t{r.error} << 4U) | (node & 0x0FU))
                  : node;
  f.data[1] = static_cast<std::uint8_t>(r.position >> 8U);
  f.data[2] = static_cast<std::uint8_t>(r.position);
  f.data[3] = static_cast<std::uint8_t>(r.velocity >> 4U);
  f.data[4] = static_cast<std::uint8_t>(r.velocity << 4U | r.torque >> 8U);
  f.data[5] = static_cast<std::uint8_t>(r.torque);
  if (d == Dialect::cubemars) f.data[7] = r.error;
  return f;
}
/// Reply of an emulated cubemars_v3 with this node (8 bits); current and temperature are 0.
[[nodiscard]] constexpr hal::CanFrame encode_v3_reply(std::uint8_t node, const Reply& r) {
  hal::CanFrame f = hal::data_frame(v3_reply | node, 8);
  f.extended = true;
  f.data[0] = static_cast<std::uint8_t>((r.position ^ middle_16) >> 8U);
  f.data[1] = static_cast<std::uint8_t>(r.position);
  f.data[2] = static_cast<std::uint8_t>((r.velocity ^ middle_16) >> 8U);
  f.data[3] = static_cast<std::uint8_t>(r.velocity);
  f.data[7] = r.error;
  return f;
}
/// Command as an emulated drive reads it. The caller checks identifier, length (8), and decode_special().
[[nodiscard]] constexpr Command decode_command(const hal::CanFrame& f, Dialect d = Dialect::mini_cheetah) {
  const Command c{static_cast<std::uint16_t>(f.data[0] << 8U | f.data[1]),
                  static_cast<std::uint16_t>(f.data[2] << 4U | f.data[3] >> 4U),
                  static_cast<std::uint16_t>((f.data[3] & 0x0FU) << 8U | f.data[4]),
                  static_cast<std::uint16_t>(f.data[5] << 4U | f.data[6] >> 4U),
                  static_cast<std::uint16_t>((f.data[6] & 0x0FU) << 8U | f.data[7])};
  if (d != Dialect::cubemars_v3) return c;
  return {static_cast<std::uint16_t>((c.velocity & 0x0FU) << 12U | c.kp), c.kd,
          static_cast<std::uint16_t>(c.position >> 4U),
          static_cast<std::uint16_t>((c.position & 0x0FU) << 8U | c.velocity >> 4U), c.torque};
}
/// Kind of a special frame; empty for an ordinary command. The caller checks identifier and length (8).
[[nodiscard]] constexpr std::optional<Special> decode_special(const hal::CanFrame& f) {
  for (unsigned i = 0; i < 7; ++i) {
    if (f.data[i] != 0xFF) return std::nullopt;
  }
  if (f.data[7] < 0xFC || f.data[7] > 0xFE) return std::nullopt;
  return static_cast<Special>(f.data[7]);
}

// By hand from the field table: node 3, 9 of 18 N m is code 3071 = 0xBFF (3071.25 rounded).
static_assert(encode_command(3, {.torque = code(9.0F, 18.0F, code_max_12)}) ==
              hal::CanFrame{.id = 3, .size = 8, .data = {0x80, 0x00, 0x80, 0x00, 0x00, 0x00, 0x0B, 0xFF}});

}  // namespace esmc::drive::mit
