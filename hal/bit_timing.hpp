#pragma once
/// Bit timing of a CAN controller from its kernel clock.

#include <cstdint>

namespace esmc::hal {

/// Lengths in time quanta: a bit has 1 + segment1 + segment2 of them, each `prescaler` periods of the kernel
/// clock. The prescaler is 0 if the bit rate is not exactly possible.
struct BitTiming {
  std::uint32_t prescaler = 0, segment1 = 0, segment2 = 0, jump_width = 0;
  [[nodiscard]] constexpr bool exact() const { return prescaler != 0; }  ///< the bit rate is possible
};

/// Largest values that a controller's registers hold.
struct BitTimingLimits {
  std::uint32_t prescaler, segment1, segment2, jump_width;
};

/// The finest quanta, at least 8, that give exactly `bit_rate` (bit/s) from `clock` (Hz); none: not exact().
/// Sample point 1/`share` of the bit before its end or just after, two quanta or more; largest jump width.
[[nodiscard]] constexpr BitTiming bit_timing(std::uint32_t clock, std::uint32_t bit_rate,
                                             const BitTimingLimits& most, std::uint32_t share) {
  if (bit_rate == 0 || clock % bit_rate != 0) return {};
  const std::uint32_t periods = clock / bit_rate;
  for (std::uint32_t prescaler = 1; prescaler <= most.prescaler; ++prescaler) {
    if (periods % prescaler != 0) continue;
    const std::uint32_t quanta = periods / prescaler;
    if (quanta < 8) break;
    const std::uint32_t after = quanta / share;  // the sample point
    const std::uint32_t segment2 = after < 2 ? 2 : after, segment1 = quanta - 1 - segment2;
    if (segment1 > most.segment1 || segment2 > most.segment2) continue;
    return {prescaler, segment1, segment2, segment2 < most.jump_width ? segment2 : most.jump_width};
  }
  return {};
}

}  // namespace esmc::hal
