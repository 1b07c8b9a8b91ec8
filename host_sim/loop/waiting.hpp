#pragma once
/// Waiting for frames: a socket is polled, a virtual bus has them already or never will.

#include <poll.h>

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <ctime>
#include <thread>
#include <type_traits>

#include "hal/linux/socketcan.hpp"
#include "hal/virtual/virtual_bus.hpp"
#include "host_sim/bus/frame_log.hpp"
#include "host_sim/bus/host_bus.hpp"

namespace esmc::host {

/// Up to `patience`; true: there is something to read.
inline bool readable_within(pollfd p, std::chrono::nanoseconds patience) {
  const auto seconds = std::chrono::floor<std::chrono::seconds>(patience);
  const timespec time{static_cast<time_t>(seconds.count()), static_cast<long>((patience - seconds).count())};
  if (::ppoll(&p, 1, &time, nullptr) <= 0) return false;
  // A dead interface is always "ready": whoever asks again at once would burn the processor.
  if ((p.revents & (POLLERR | POLLHUP | POLLNVAL)) != 0)
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  return (p.revents & POLLIN) != 0;
}

/// Up to `milliseconds` for a frame to receive; false when there is none.
inline bool wait_for_frame(hal::SocketCan& bus, int milliseconds) {
  return readable_within({bus.descriptor(), POLLIN, 0}, std::chrono::milliseconds(milliseconds));
}
inline bool wait_for_frame(HostBus& bus, std::chrono::nanoseconds patience) {
  if (const RecordedBus* r = bus.recorded()) return r->has_input();
  if (bus.has_input()) return true;
  const bool input = readable_within(bus.polled(), patience);
  bus.flush();
  return input;
}
inline bool wait_for_frame(HostBus& bus, int milliseconds) {
  return wait_for_frame(bus, std::chrono::milliseconds(milliseconds));
}
template <class Port>
requires requires(const Port& p) { p.waiting(); }
bool wait_for_frame(Port& port, int) { return port.waiting() > 0; }

template <class Bus>
bool wait_for_frame(Tapped<Bus>& tap, int milliseconds) {
  return wait_for_frame(tap.bus(), milliseconds);
}

/// Whether the bus is lost for good.
template <class Bus>
bool is_gone(Bus& bus) {
  if constexpr (requires { bus.gone(); }) {
    return bus.gone();
  } else {
    return false;
  }
}
template <class Bus>
bool is_gone(Tapped<Bus>& tap) {
  return is_gone(tap.bus());
}

/// Whether a frame may still come while one waits.
template <class Bus>
inline constexpr bool can_wait = std::is_same_v<Bus, hal::SocketCan> || std::is_same_v<Bus, HostBus>;
template <class Bus>
inline constexpr bool can_wait<Tapped<Bus>> = can_wait<Bus>;

/// Whether it is worth while to wait on this very bus.
template <class Bus>
bool may_come(const Bus&) {
  return can_wait<Bus>;
}
inline bool may_come(const HostBus& bus) { return bus.recorded() == nullptr; }
inline bool may_come(const Tapped<HostBus>& tap) { return may_come(tap.bus()); }

enum class Waited : std::uint8_t { done, stopped, silent };

/// Waits until `done`, which takes what has arrived and is asked again after each arrival. `stop` (Ctrl-C)
/// and the deadline count at every pass, whatever arrives: frames of others on the bus are no reason to wait
/// on.
template <class Bus, class Done, class Stop>
Waited wait_until(Bus& bus, const Done& done, const Stop& stop, std::chrono::milliseconds patience) {
  // On a virtual bus everything is there already, and a look at the clock would cost as much as the frames.
  if (done()) return Waited::done;
  using Clock = std::chrono::steady_clock;
  constexpr std::chrono::milliseconds slice(100);
  const auto deadline = Clock::now() + patience;
  do {
    if (stop()) return Waited::stopped;
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(deadline - Clock::now());
    if (left.count() <= 0) return Waited::silent;
    const bool frame = wait_for_frame(bus, static_cast<int>(std::min(left, slice).count()));
    if (!frame && !may_come(bus)) return Waited::silent;
  } while (!done());
  return Waited::done;
}

}  // namespace esmc::host
