#pragma once
/// The two checksums of the command interface, bit by bit: there are few bytes to check.

#include <cstdint>
#include <span>

namespace esmc::link {

/// CRC-8/SAE-J1850: polynomial 0x1D, start 0xFF, result inverted, nothing reflected.
inline constexpr std::uint8_t crc8_start = 0xFF;
inline constexpr std::uint8_t crc8_inverted = 0xFF;
/// Adds a byte to the state before the inversion, at first crc8_start.
[[nodiscard]] constexpr std::uint8_t crc8_add(std::uint8_t crc, std::uint8_t byte) {
  constexpr unsigned polynomial = 0x1D;
  unsigned c = crc ^ byte;
  for (int bit = 0; bit < 8; ++bit) c = (c & 0x80U) != 0 ? (c << 1U) ^ polynomial : c << 1U;
  return static_cast<std::uint8_t>(c);
}
/// CRC-32/ISO-HDLC (Ethernet, zip): polynomial 0x04C11DB7, reflected, start and result inverted.
inline constexpr std::uint32_t crc32_start = 0xFFFF'FFFF;
/// Adds a byte to the state before the inversion, at first crc32_start.
[[nodiscard]] constexpr std::uint32_t crc32_add(std::uint32_t crc, std::uint8_t byte) {
  constexpr std::uint32_t polynomial_reflected = 0xEDB8'8320;
  crc ^= byte;
  for (int bit = 0; bit < 8; ++bit) crc = (crc & 1U) != 0 ? (crc >> 1U) ^ polynomial_reflected : crc >> 1U;
  return crc;
}
/// CRC-32/ISO-HDLC of all bytes; 0 of none.
[[nodiscard]] constexpr std::uint32_t crc32(std::span<const std::uint8_t> bytes) {
  std::uint32_t c = crc32_start;
  for (const std::uint8_t b : bytes) c = crc32_add(c, b);
  return ~c;
}

}  // namespace esmc::link
