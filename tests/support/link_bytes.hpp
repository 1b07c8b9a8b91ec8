#pragma once
/// A supervisor computer made of bytes: its own layout of the command interface, its own checksum by long
/// division, nothing of firmware/link. Units in integers as they are on the wire.

#include <array>
#include <bit>
#include <cstdint>
#include <vector>

#include "hal/can.hpp"

namespace esmc::test {

/// Remainder of the bits, the first eight inverted, times x^8, by x^8 + x^4 + x^3 + x^2 + 1, inverted.
inline std::uint8_t j1850(const std::vector<std::uint8_t>& bytes) {
  std::vector<bool> bits;
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    for (int b = 7; b >= 0; --b) bits.push_back((((i == 0 ? ~bytes[i] : bytes[i]) >> b) & 1) != 0);
  }
  bits.resize(bits.size() + 8, false);
  const std::array<bool, 9> divisor{true, false, false, false, true, true, true, false, true};
  for (std::size_t i = 0; i + 8 < bits.size(); ++i) {
    if (!bits[i]) continue;
    for (std::size_t k = 0; k < divisor.size(); ++k) bits[i + k] = bits[i + k] != divisor[k];
  }
  unsigned rest = 0;
  for (std::size_t i = bits.size() - 8; i < bits.size(); ++i) rest = rest * 2 + (bits[i] ? 1 : 0);
  return static_cast<std::uint8_t>(~rest);
}

struct Desk {
  static constexpr unsigned command = 0, point = 1, position = 2, velocity = 3, write = 4, request = 5;
  static constexpr unsigned none = 0, arm = 1, disarm = 2, off = 3, reset = 4, confirm_zero = 5, hold = 6,
                            reference = 7, stream = 8, store = 9, forget = 10, home = 11, override_speed = 19,
                            resume = 20;
  static constexpr unsigned status = 0x10, record = 0x11, detail = 0x12, value = 0x13, table = 0x14,
                            counts = 0x15, effector = 0x16, error = 0x17, joint = 0x18, identity = 0x1C,
                            slots = 0x1D, capture = 0x1E;

  unsigned base = 0x780;
  std::uint8_t session = 1;
  std::uint32_t tick = 0;   ///< of the last Status
  std::uint32_t crc32 = 0;  ///< of the last Parameter_Table
  unsigned state = 0, fault = 0, reaction = 0, source = 0, pace = 0;
  bool streaming = false;
  std::array<std::uint8_t, 6> counter{};
  std::vector<hal::CanFrame> heard;  ///< of the block, since clear()

  [[nodiscard]] hal::CanFrame seal(hal::CanFrame f, unsigned with_session) const {
    std::vector<std::uint8_t> bytes{static_cast<std::uint8_t>(f.id & 0xFF),
                                    static_cast<std::uint8_t>(f.id >> 8),
                                    static_cast<std::uint8_t>(with_session)};
    for (std::size_t i = 1; i < 8; ++i) bytes.push_back(f.data[i]);
    f.data[0] = j1850(bytes);
    return f;
  }
  /// `low`, `high`: the 48 bits after the two bytes of the header.
  hal::CanFrame make(unsigned message, std::uint64_t payload, unsigned tag = 0) {
    hal::CanFrame f;
    f.id = base + message;
    f.size = 8;
    counter[message] = (counter[message] + 1) & 15;
    f.data[1] = static_cast<std::uint8_t>(counter[message] | (tag << 4));
    for (unsigned i = 0; i < 6; ++i) f.data[2 + i] = static_cast<std::uint8_t>(payload >> (8 * i));
    return seal(f, session);
  }
  hal::CanFrame order(unsigned what, unsigned percent = 0) {
    return make(command, what | (percent << 8) | (std::uint64_t{tick & 0xFFFF} << 16) |
                             (std::uint64_t{crc32 & 0xFFFF} << 32));
  }
  hal::CanFrame pair(unsigned message, int a, int b, unsigned space = 0) {
    const auto u24 = [](int v) { return static_cast<std::uint64_t>(static_cast<unsigned>(v) & 0xFFFFFFU); };
    return make(message, u24(a) | (u24(b) << 24), space);
  }
  hal::CanFrame set_gain(unsigned index, float v) {
    return make(write, index | (std::uint64_t{std::bit_cast<std::uint32_t>(v)} << 16));
  }
  hal::CanFrame ask(unsigned subject, unsigned index = 0) { return make(request, subject | (index << 8)); }

  static std::uint32_t word(const hal::CanFrame& f, std::size_t at, std::size_t bytes) {
    std::uint32_t v = 0;
    for (std::size_t i = bytes; i-- > 0;) v = v * 256 + f.data[at + i];
    return v;
  }
  static float real(const hal::CanFrame& f, std::size_t at) { return std::bit_cast<float>(word(f, at, 4)); }

  void hear(const hal::CanFrame& f) {
    if (f.id < base || f.id >= base + 32) return;
    heard.push_back(f);
    if (f.id == base + status) {
      state = f.data[1] >> 4;
      fault = f.data[2];
      reaction = f.data[3] & 3;
      source = (f.data[3] >> 2) & 3;
      streaming = (f.data[3] & 0x10) != 0;
      pace = f.data[3] >> 6;
      tick = word(f, 4, 3);
      session = f.data[7];
    }
    if (f.id == base + table) crc32 = word(f, 0, 4);
  }
  [[nodiscard]] int count(unsigned message) const {
    int n = 0;
    for (const auto& f : heard) n += f.id == base + message ? 1 : 0;
    return n;
  }
  /// The last one heard; size 0 without.
  [[nodiscard]] hal::CanFrame last(unsigned message) const {
    hal::CanFrame out;
    for (const auto& f : heard) {
      if (f.id == base + message) out = f;
    }
    return out;
  }
};

}  // namespace esmc::test
