#pragma once
/// Time as the firmware sees it. No file in firmware/ calls a clock: the caller of a tick passes the instant
/// in.

#include <chrono>
#include <concepts>
#include <cstdint>

namespace esmc::hal {

using Duration = std::chrono::duration<std::int64_t, std::micro>;
/// Microseconds since the node started; monotonic.
struct ClockBase {
  using rep = std::int64_t;
  using period = std::micro;
  using duration = Duration;
};
using Instant = std::chrono::time_point<ClockBase, Duration>;

/// A monotonic clock.
template <class C>
concept Clock = requires(const C& clock) {
  { clock.now() } -> std::same_as<Instant>;
};

}  // namespace esmc::hal
