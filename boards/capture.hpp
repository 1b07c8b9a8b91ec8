#pragma once
/// Memory for the last ticks, which the command interface reads: ESMC_CAPTURE_TICKS of 24 bytes, 0: none.

#include <array>

#include "firmware/link/capture.hpp"

namespace esmc {

/// Lets the node record its last ESMC_CAPTURE_TICKS ticks in static memory; call once, before the first tick.
template <class Node>
void keep_ticks(Node& node) {
  constexpr std::size_t ticks = ESMC_CAPTURE_TICKS;
  static_assert(ticks <= link::Capture::records_max, "ESMC_CAPTURE_TICKS: at most 16383");
  if constexpr (ticks > 0) {
    static std::array<link::CaptureRecord, ticks> memory;
    node.link().capture_into(memory);
  }
}

}  // namespace esmc
