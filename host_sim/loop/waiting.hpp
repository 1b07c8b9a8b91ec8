#pragma once
/// Waiting for a frame: a socket is polled, a virtual bus has it already or never will.

#include <poll.h>

#include <cstddef>

#include "hal/linux/socketcan.hpp"
#include "hal/virtual/virtual_bus.hpp"
#include "host_sim/loop/frame_log.hpp"

namespace esmc::host {

/// Up to `milliseconds` for a frame to receive; false when there is none.
inline bool wait_for_frame(hal::SocketCan& bus, int milliseconds) {
  pollfd p{bus.descriptor(), POLLIN, 0};
  return ::poll(&p, 1, milliseconds) > 0;
}
template <class Port>
  requires requires(const Port& p) { p.waiting(); }
bool wait_for_frame(Port& port, int) {
  return port.waiting() > 0;
}

template <class Bus>
bool wait_for_frame(Tapped<Bus>& tap, int milliseconds) {
  return wait_for_frame(tap.bus(), milliseconds);
}

/// Whether a frame may still come while one waits.
template <class Bus>
inline constexpr bool can_wait = std::is_same_v<Bus, hal::SocketCan> || std::is_same_v<Bus, Tapped<hal::SocketCan>>;

}  // namespace esmc::host
