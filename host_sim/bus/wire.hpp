#pragma once
/// A classic CAN frame as bits on the wire (ISO 11898-1, formats CBFF and CEFF): its length and priority.

#include <array>
#include <cstdint>

#include "hal/can.hpp"

namespace esmc::host {

inline constexpr std::uint32_t interframe_bits = 3;
/// CRC delimiter, ACK slot and delimiter, end of frame: never stuffed.
inline constexpr std::uint32_t trailer_bits = 10;

/// Bits of a data frame with n (0..8) data bytes, interframe space included, with the most stuff bits: one
/// after the first five equal bits, then, as each stuff bit begins the next run, one after every four. A
/// remote frame is as long as a frame without data.
[[nodiscard]] constexpr std::uint32_t worst_bits(std::uint32_t n, bool extended = false) {
  const std::uint32_t stuffable = (extended ? 54 : 34) + 8 * n;
  return stuffable + (stuffable - 1) / 4 + trailer_bits + interframe_bits;
}
static_assert(worst_bits(0) == 55 && worst_bits(4) == 95 && worst_bits(8) == 135 &&
              worst_bits(8, true) == 160);

/// Start of frame to CRC, stuff bits included; true: recessive.
struct WireFrame {
  static constexpr std::uint32_t size_max = 54 + 64 + (54 + 64 - 1) / 4;
  std::array<bool, size_max> bit{};
  std::uint32_t size = 0;
  std::uint32_t stuffed = 0;  ///< stuff bits among them
};
/// Bits of `f`, which must be a well-formed classic frame: it is not checked.
[[nodiscard]] WireFrame on_the_wire(const hal::CanFrame& f);

/// The exact length of a well-formed classic frame with its interframe space, in bits.
[[nodiscard]] inline std::uint32_t exact_bits(const hal::CanFrame& f) {
  return on_the_wire(f).size + trailer_bits + interframe_bits;
}

/// The arbitration field as a number: the smallest wins. Two frames with the same number collide.
[[nodiscard]] constexpr std::uint32_t arbitration(const hal::CanFrame& f) {
  const std::uint32_t remote = f.remote ? 1 : 0;
  if (!f.extended) return (f.id << 21U) | (remote << 20U);
  return ((f.id >> 18U) << 21U) | (3U << 19U) | ((f.id & 0x3'FFFFU) << 1U) | remote;
}

}  // namespace esmc::host
