#pragma once
/// How long frames keep a CAN bus busy.

#include <cstdint>

namespace esmc::host {

/// Bits of a classic data frame with an 11-bit identifier and n data bytes, interframe space included, with the
/// most stuff bits there can be: 47 + 8 n + floor((34 + 8 n - 1) / 4).
[[nodiscard]] constexpr std::uint32_t worst_bits(std::uint32_t n) { return 47 + 8 * n + (34 + 8 * n - 1) / 4; }

static_assert(worst_bits(0) == 55 && worst_bits(4) == 95 && worst_bits(8) == 135);

}  // namespace esmc::host
