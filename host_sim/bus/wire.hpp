#pragma once
/// A CAN frame as bits on the wire (ISO 11898-1, classic and FD): its length and priority. Lengths are in bit
/// times of the arbitration; `fast` is the time of a bit in the data phase of a CAN FD frame that switches.

#include <array>
#include <cmath>
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

/// Bits of a CAN FD frame up to the switch of the bit rate, without stuff bits.
[[nodiscard]] constexpr std::uint32_t fd_arbitration_bits(bool extended) { return extended ? 36 : 17; }
/// Bits behind the data: stuff count and CRC, of 17 bits up to 16 bytes, then of 21, with their fixed stuff
/// bits, one before and one after every four.
[[nodiscard]] constexpr std::uint32_t fd_check_bits(std::uint32_t n) {
  return n <= 16 ? 4 + 17 + 6 : 4 + 21 + 7;
}
/// Length of a CAN FD frame with n data bytes, a size that CAN FD has, interframe space included: with the
/// most stuff bits, or with none.
[[nodiscard]] inline std::uint32_t fd_bits(std::uint32_t n, bool extended, double fast, bool most_stuffed) {
  const std::uint32_t slow = fd_arbitration_bits(extended), data = 5 + 8 * n;
  const std::uint32_t early = most_stuffed ? (slow - 1) / 4 : 0;
  const std::uint32_t all = most_stuffed ? (slow + data - 2) / 4 : 0;
  const std::uint32_t quick = data + (all - early) + fd_check_bits(n);
  return slow + early + trailer_bits + interframe_bits +
         static_cast<std::uint32_t>(std::ceil(quick * fast - 1e-9));
}
/// Length of a well-formed frame with its interframe space and the most stuff bits.
[[nodiscard]] inline std::uint32_t worst_bits(const hal::CanFrame& f, double fast) {
  if (f.fd) return fd_bits(hal::can_fd_size(f.size), f.extended, f.bit_rate_switch ? fast : 1.0, true);
  return worst_bits(f.remote ? 0U : f.size, f.extended);
}

/// Start of frame to CRC, stuff bits included; true: recessive. Of CAN FD, whose CRC is stuffed at fixed
/// places, up to the end of the data: the CRC of different data decides nothing.
struct WireFrame {
  static constexpr std::uint32_t size_max = (36 + 5 + 512) * 5 / 4;
  std::array<bool, size_max> bit{};
  std::uint32_t size = 0;
  std::uint32_t stuffed = 0;    ///< stuff bits among them
  std::uint32_t slow = 0xFFFF;  ///< bits up to the switch of the bit rate; more than all without one

  /// Time to the end of bit `i`.
  [[nodiscard]] std::uint32_t until(std::uint32_t i, double fast) const {
    if (i < slow) return i + 1;
    return slow + static_cast<std::uint32_t>(std::ceil((i + 1 - slow) * fast - 1e-9));
  }
};
/// Bits of `f`, which must be well-formed, and of CAN FD have a size that there is: it is not checked.
[[nodiscard]] WireFrame on_the_wire(const hal::CanFrame& f);

/// The exact length of a well-formed frame with its interframe space.
[[nodiscard]] inline std::uint32_t exact_bits(const hal::CanFrame& f, double fast = 1.0) {
  const WireFrame w = on_the_wire(f);
  const std::uint32_t last = w.size - 1 + (f.fd ? fd_check_bits(f.size) : 0);
  return w.until(last, fast) + trailer_bits + interframe_bits;
}

using hal::arbitration;

}  // namespace esmc::host
