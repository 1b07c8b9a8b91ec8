#pragma once
/// Frames of a moteus written byte by byte from the vendor's tables, without the firmware's codec.

#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>

#include "hal/can.hpp"

namespace esmc::test {

/// CAN FD frame of hexadecimal digits; blanks between bytes are allowed. Beyond 7FFh the identifier has 29
/// bits.
inline hal::CanFrame fd_frame(std::uint32_t id, std::string_view digits) {
  hal::CanFrame f;
  f.id = id;
  f.extended = id > 0x7FF;
  f.fd = f.bit_rate_switch = true;
  for (std::size_t i = 0; i + 1 < digits.size(); i += digits[i] == ' ' ? 1U : 2U) {
    if (digits[i] != ' ')
      f.data[f.size++] = static_cast<std::uint8_t>(std::stoul(std::string(digits.substr(i, 2)), nullptr, 16));
  }
  return f;
}
inline std::string digits_of(const hal::CanFrame& f) {
  std::string out;
  for (const std::uint8_t b : f.payload()) {
    constexpr std::string_view digit = "0123456789abcdef";
    out += digit[b / 16];
    out += digit[b % 16];
  }
  return out;
}
/// Four bytes of a float, low byte first, as digits.
inline std::string float_digits(float v) {
  hal::CanFrame f;
  std::uint32_t raw = 0;
  std::memcpy(&raw, &v, 4);
  for (f.size = 0; f.size < 4; ++f.size, raw /= 256) f.data[f.size] = static_cast<std::uint8_t>(raw % 256);
  return digits_of(f);
}
inline std::string byte_digits(unsigned v) {
  hal::CanFrame f;
  f.size = 1;
  f.data[0] = static_cast<std::uint8_t>(v);
  return digits_of(f);
}
/// What a drive replies to the query: mode, position, velocity, torque, fault, and `more` subframes.
struct MoteusReply {
  unsigned mode = 0, fault = 0;
  float position = 0.0F, velocity = 0.0F, torque = 0.0F;
  std::string more{};
  [[nodiscard]] hal::CanFrame frame(std::uint32_t node) const {
    return fd_frame(node * 256, "2100" + byte_digits(mode) + "2f01" + float_digits(position) +
                                    float_digits(velocity) + float_digits(torque) + "210f" +
                                    byte_digits(fault) + more);
  }
};
inline constexpr const char* moteus_version = "21820205210c02";  ///< version 5, position of the output

}  // namespace esmc::test
