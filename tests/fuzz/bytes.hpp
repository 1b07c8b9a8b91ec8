#pragma once
/// What a fuzz target needs: an input read as numbers and frames, a bus that remembers, and checks that end
/// the process.

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <span>
#include <type_traits>
#include <vector>

#include "hal/can.hpp"

namespace esmc::fuzz {

/// Ends the process where a statement does not hold; the fuzzer keeps the input.
inline void require(bool holds, const char* what, const char* file = __builtin_FILE(),
                    int line = __builtin_LINE()) {
  if (holds) return;
  std::fprintf(stderr, "%s:%d: broken: %s\n", file, line, what);
  std::abort();
}

/// The input, from its beginning; zeros after its end.
class Bytes {
 public:
  Bytes(const std::uint8_t* data, std::size_t size) : at_(data), left_(size) {}

  [[nodiscard]] bool empty() const { return left_ == 0; }
  std::uint8_t u8() {
    if (left_ == 0) return 0;
    --left_;
    return *at_++;
  }
  std::uint16_t u16() { return static_cast<std::uint16_t>(u8() | u8() << 8U); }
  std::uint32_t u32() {
    const std::uint32_t low = u16();
    return low | std::uint32_t{u16()} << 16U;
  }
  /// Any bit pattern: NaN, infinities and subnormal numbers as well.
  float f32() { return std::bit_cast<float>(u32()); }
  double f64() {
    const std::uint64_t low = u32();
    return std::bit_cast<double>(low | std::uint64_t{u32()} << 32U);
  }
  /// 0 .. n - 1, n up to 256.
  unsigned below(unsigned n) { return u8() % n; }
  /// Does one of these, by a number below n; the last one also for all that are left.
  template <class... Do>
  void one_of(unsigned n, Do&&... these) {
    unsigned which = std::min<unsigned>(below(n), sizeof...(these) - 1);
    (void)((which-- == 0 && (these(), true)) || ...);
  }
  bool yes() { return (u8() & 1U) != 0; }

  /// A frame with this identifier: format, length and bytes are the input's. Zero as first byte: a classic
  /// frame of eight.
  hal::CanFrame frame(std::uint32_t id) {
    hal::CanFrame f;
    const unsigned format = u8();
    f.id = id;
    f.extended = (format & 1U) != 0;
    f.remote = (format & 2U) != 0;
    f.fd = (format & 4U) != 0;
    f.bit_rate_switch = (format & 8U) != 0;
    f.size =
        (format & 16U) != 0 ? static_cast<std::uint8_t>(below(hal::can_fd_size_max + 1U)) : std::uint8_t{8};
    for (std::uint8_t i = 0; i < f.size; ++i) f.data[i] = u8();
    return f;
  }
  hal::CanFrame frame() {
    const std::uint32_t id = u16();
    return frame((id & 0x8000U) != 0 ? id | std::uint32_t{u16()} << 16U : id & 0x7FFU);
  }

 private:
  const std::uint8_t* at_;
  std::size_t left_;
};

/// A bus under the hand of the input. Frames wait without limit; what was sent, or tried, stays until
/// clear().
class Bus {
 public:
  /// Of `waiting`, what has not been taken.
  [[nodiscard]] std::span<const hal::CanFrame> unread() const { return std::span(waiting).subspan(next_); }
  std::vector<hal::CanFrame> waiting, sent, tried;
  hal::SendStatus status = hal::SendStatus::ok;
  unsigned room = 0xFFFF'FFFF;  ///< so many frames it takes, and then none: its queue is full
  std::uint32_t age_us = 0;     ///< of every frame

  void clear() {
    sent.clear();
    tried.clear();
  }
  hal::SendStatus try_send(const hal::CanFrame& f) {
    require(hal::well_formed(f), "only well-formed frames are sent");
    require(!f.extended && !f.fd && !f.bit_rate_switch, "only classic frames with 11 bits are sent");
    tried.push_back(f);
    const hal::SendStatus now =
        status == hal::SendStatus::ok && room == 0 ? hal::SendStatus::bus_full : status;
    if (now != hal::SendStatus::ok) return now;
    sent.push_back(f);
    --room;
    return now;
  }
  bool try_receive(hal::CanFrame& f) {
    if (next_ == waiting.size()) {
      waiting.clear();
      next_ = 0;
      return false;
    }
    f = waiting[next_++];
    return true;
  }
  [[nodiscard]] std::uint32_t frame_age_us() const { return age_us; }

 private:
  std::size_t next_ = 0;
};
static_assert(hal::TimesFrames<Bus>);

/// The object as it lies in memory: what must not change is compared to the last bit.
template <class T>
class Image {
 public:
  explicit Image(const T& t) {
    static_assert(std::is_trivially_copyable_v<T>);
    std::memcpy(bytes_.data(), &t, sizeof(T));
  }
  [[nodiscard]] bool is(const T& t) const { return std::memcmp(bytes_.data(), &t, sizeof(T)) == 0; }

 private:
  std::array<std::uint8_t, sizeof(T)> bytes_;
};

/// First `n` bytes of two frames.
inline bool same_bytes(const hal::CanFrame& a, const hal::CanFrame& b, std::size_t n) {
  return std::equal(a.data.begin(), a.data.begin() + static_cast<std::ptrdiff_t>(n), b.data.begin());
}

}  // namespace esmc::fuzz
