#pragma once
/// ODrive CANSimple frames written byte by byte from the message table, without the firmware's codec: what a
/// drive says, and how to read what it is told. id = node << 5 | command, everything little endian.

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>

#include "hal/can.hpp"

namespace esmc::test {

inline constexpr unsigned cmd_heartbeat = 0x01, cmd_axis_state = 0x07, cmd_encoder = 0x09, cmd_mode = 0x0B,
                          cmd_torque = 0x0E, cmd_clear_errors = 0x18, cmd_torques = 0x1C;
inline constexpr std::uint8_t axis_idle = 1, axis_closed_loop = 8;

/// Messages that only a controller sends, by the vendor's tables of both versions: 0x10 to 0x13 are 0.5.6's.
inline bool is_command(unsigned command, bool newer) {
  switch (command) {
    case 0x07:
    case 0x0B:
    case 0x0C:
    case 0x0D:
    case 0x0E:
    case 0x0F:
    case 0x10:
    case 0x11:
    case 0x12:
    case 0x13:
    case 0x16:
    case 0x18:
    case 0x19:
    case 0x1A:
    case 0x1B:
      return true;
    case 0x06:
      return !newer;
    case 0x1F:
      return newer;
    default:
      return false;
  }
}

inline unsigned node_of(const hal::CanFrame& f) { return f.id / 32; }
inline unsigned command_of(const hal::CanFrame& f) { return f.id % 32; }

inline std::uint32_t word(const hal::CanFrame& f, std::size_t at) {
  return f.data[at] + 0x100U * f.data[at + 1] + 0x10000U * f.data[at + 2] + 0x1000000U * f.data[at + 3];
}
inline float real(const hal::CanFrame& f, std::size_t at) { return std::bit_cast<float>(word(f, at)); }

inline hal::CanFrame message(unsigned node, unsigned command, std::uint32_t low, std::uint32_t high,
                             std::uint8_t size = 8) {
  hal::CanFrame f;
  f.id = node * 32 + command;
  f.size = size;
  for (std::size_t i = 0; i < 4; ++i) {
    f.data[i] = static_cast<std::uint8_t>(low % 256);
    f.data[i + 4] = static_cast<std::uint8_t>(high % 256);
    low /= 256;
    high /= 256;
  }
  return f;
}

/// u32 axis error, u8 axis state, three more bytes (their meaning depends on the version).
inline hal::CanFrame heartbeat(unsigned node, std::uint8_t state, std::uint32_t error = 0,
                               std::array<std::uint8_t, 3> rest = {}) {
  return message(node, cmd_heartbeat, error,
                 state + 0x100U * rest[0] + 0x10000U * rest[1] + 0x1000000U * rest[2]);
}

/// f32 position in revolutions, f32 velocity in revolutions per second.
inline hal::CanFrame encoder(unsigned node, float position, float velocity) {
  return message(node, cmd_encoder, std::bit_cast<std::uint32_t>(position),
                 std::bit_cast<std::uint32_t>(velocity));
}
/// f32 torque as told, f32 torque as estimated, N m at the shaft.
inline hal::CanFrame torques(unsigned node, float target, float estimate) {
  return message(node, cmd_torques, std::bit_cast<std::uint32_t>(target),
                 std::bit_cast<std::uint32_t>(estimate));
}

}  // namespace esmc::test
