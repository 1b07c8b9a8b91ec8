#pragma once
/// Frames of MIT mode written byte by byte from the field table, without the firmware's codec: the fields of
/// a frame are the digits of one big number, most significant first.

#include <cstddef>
#include <cstdint>
#include <vector>

#include "hal/can.hpp"

namespace esmc::test {

inline hal::CanFrame bytes(std::uint32_t id, const std::vector<unsigned>& data) {
  hal::CanFrame f;
  f.id = id;
  f.size = static_cast<std::uint8_t>(data.size());
  for (std::size_t i = 0; i < data.size(); ++i) f.data[i] = static_cast<std::uint8_t>(data[i]);
  return f;
}
inline hal::CanFrame mit_command(std::uint32_t id, std::uint64_t p, std::uint64_t v, std::uint64_t kp,
                                 std::uint64_t kd, std::uint64_t t) {
  std::uint64_t number = (((p * 4096 + v) * 4096 + kp) * 4096 + kd) * 4096 + t;
  hal::CanFrame f;
  f.id = id;
  f.size = 8;
  for (std::size_t i = 8; i-- > 0; number /= 256) f.data[i] = static_cast<std::uint8_t>(number % 256);
  return f;
}
inline hal::CanFrame mit_special(std::uint32_t id, unsigned last) {
  return bytes(id, {255, 255, 255, 255, 255, 255, 255, last});
}
/// Codes p, v and t behind the first byte; `size` bytes in all.
inline hal::CanFrame mit_reply(std::uint32_t id, unsigned first, std::uint64_t p, std::uint64_t v,
                               std::uint64_t t, std::uint8_t size = 6) {
  std::uint64_t number = (p * 4096 + v) * 4096 + t;
  hal::CanFrame f;
  f.id = id;
  f.size = size;
  f.data[0] = static_cast<std::uint8_t>(first);
  for (std::size_t i = 6; i-- > 1; number /= 256) f.data[i] = static_cast<std::uint8_t>(number % 256);
  return f;
}
inline std::uint64_t mit_number(const hal::CanFrame& f, std::size_t from, std::size_t count) {
  std::uint64_t n = 0;
  for (std::size_t i = 0; i < count; ++i) n = n * 256 + f.data[from + i];
  return n;
}
/// Fields of a reply.
inline unsigned mit_p(const hal::CanFrame& f) { return static_cast<unsigned>(mit_number(f, 1, 2)); }
inline unsigned mit_v(const hal::CanFrame& f) { return static_cast<unsigned>(mit_number(f, 3, 2) / 16); }
inline unsigned mit_t(const hal::CanFrame& f) { return static_cast<unsigned>(mit_number(f, 4, 2) % 4096); }

inline bool is_special(const hal::CanFrame& f, unsigned last) {
  return f.size == 8 && mit_number(f, 0, 7) == 0xFFFFFFFFFFFFFFU && f.data[7] == last;
}

}  // namespace esmc::test
