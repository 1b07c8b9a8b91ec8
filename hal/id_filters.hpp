#pragma once
/// The identifiers that a node receives, for the acceptance filter of its CAN controller.

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "hal/can.hpp"

namespace esmc::hal {

/// Accepts the frames, data and remote, whose identifier equals `id` in the bits of `mask`.
struct IdFilter {
  std::uint32_t id = 0, mask = 0;  ///< 11 bits, or 29 with `extended`
  bool extended = false;

  /// True if the filter accepts f.
  [[nodiscard]] constexpr bool matches(const CanFrame& f) const {
    return f.extended == extended && ((f.id ^ id) & mask) == 0;
  }
  friend constexpr bool operator==(const IdFilter&, const IdFilter&) = default;
};

/// List of filters. A frame passes if one of them accepts it; with an empty list all frames pass.
class IdFilters {
 public:
  static constexpr std::size_t capacity = 16, extended_max = 8;  ///< as many fit into an STM32G4

  /// Adds a filter that is not in the list. A list that would overflow passes all frames from then on.
  constexpr void add(const IdFilter& filter) {
    for (const IdFilter& known : list()) {
      if (known == filter) return;
    }
    extended_ += filter.extended ? 1U : 0U;
    overflown_ = overflown_ || size_ == capacity || extended_ > extended_max;
    if (!overflown_) filters_[size_++] = filter;
  }
  /// The filters; empty: all frames pass.
  [[nodiscard]] constexpr std::span<const IdFilter> list() const {
    return {filters_.data(), overflown_ ? 0 : size_};
  }

 private:
  std::array<IdFilter, capacity> filters_{};
  std::size_t size_ = 0, extended_ = 0;
  bool overflown_ = false;
};

}  // namespace esmc::hal
