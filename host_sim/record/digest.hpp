#pragma once
/// FNV-1a 64, and the digests of runs and scenes made with it.

#include <fmt/format.h>

#include <bit>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

namespace esmc::host {

inline constexpr std::uint64_t fnv_start = 0xCBF29CE484222325ULL;
/// Continues `hash`, which begins with fnv_start, with a byte.
[[nodiscard]] constexpr std::uint64_t fnv_byte(std::uint64_t hash, std::uint8_t byte) {
  return (hash ^ byte) * 0x100000001B3ULL;
}
/// Continues `hash` with the bytes of `text`.
[[nodiscard]] constexpr std::uint64_t fnv(std::uint64_t hash, std::string_view text) {
  for (const char c : text) hash = fnv_byte(hash, static_cast<std::uint8_t>(c));
  return hash;
}
/// The hash as sixteen hexadecimal digits.
[[nodiscard]] inline std::string digest_text(std::uint64_t hash) { return fmt::format("{:016x}", hash); }

/// FNV-1a 64 over the little-endian doubles of q then qd at every tick from t = 0.
///
/// A chain of dependent multiplications: the processor overlaps portions with other work between them.
class Digest {
 public:
  void add(std::span<const double> values) {
    for (const double v : values) {
      auto bits = std::bit_cast<std::uint64_t>(v);
      for (int i = 0; i < 8; ++i, bits >>= 8U) hash_ = fnv_byte(hash_, static_cast<std::uint8_t>(bits));
    }
  }
  [[nodiscard]] std::string text() const { return digest_text(hash_); }
  [[nodiscard]] std::uint64_t value() const { return hash_; }

 private:
  std::uint64_t hash_ = fnv_start;
};

}  // namespace esmc::host
