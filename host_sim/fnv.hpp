#pragma once
/// FNV-1a 64, the hash of digests: byte by byte, to be continued with what it gave.

#include <cstdint>
#include <string_view>

namespace esmc::host {

inline constexpr std::uint64_t fnv_start = 0xCBF29CE484222325ULL;
[[nodiscard]] constexpr std::uint64_t fnv_byte(std::uint64_t hash, std::uint8_t byte) {
  return (hash ^ byte) * 0x100000001B3ULL;
}
[[nodiscard]] constexpr std::uint64_t fnv(std::uint64_t hash, std::string_view text) {
  for (const char c : text) hash = fnv_byte(hash, static_cast<std::uint8_t>(c));
  return hash;
}

}  // namespace esmc::host
