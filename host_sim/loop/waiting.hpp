#pragma once
/// Waiting for the clock, and for frames: a socket is polled; on a virtual bus they are there already or will
/// not come.

#include <poll.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <ctime>
#include <thread>

#include "hal/virtual/virtual_bus.hpp"
#include "host_sim/bus/frame_log.hpp"
#include "host_sim/bus/host_bus.hpp"
#include "host_sim/error.hpp"
#include "host_sim/record/run_options.hpp"

namespace esmc::host {

/// Clock of a loop in real time: instants k * period after construction. wait() sleeps until the next one;
/// one missed by more than a tick is counted as late, and the instants go on from now.
class Pace {
 public:
  /// `waits` false: wait() returns at once, for a replay. `tick_s`: of `parts` periods, s.
  explicit Pace(double tick_s, bool waits = true, int parts = 1)
      : waits_(waits), tick_(duration(tick_s)), period_(duration(tick_s / parts)), next_(Clock::now()) {}
  /// Sleeps until the next instant.
  void wait() {
    if (!waits_) return;
    next_ += period_;
    const auto now = Clock::now();
    if (now > next_ + tick_) {
      ++late_;
      next_ = now;
    }
    std::this_thread::sleep_until(next_);
  }
  [[nodiscard]] std::uint64_t late() const { return late_; }  ///< instants missed so far
  /// Time, s, since the instant that wait() waited for.
  [[nodiscard]] double since() const { return std::chrono::duration<double>(Clock::now() - next_).count(); }

 private:
  using Clock = std::chrono::steady_clock;
  static Clock::duration duration(double seconds) {
    return std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
  }
  bool waits_;
  Clock::duration tick_, period_;
  Clock::time_point next_;
  std::uint64_t late_ = 0;
};

/// Waits up to `patience` for input on p. False: there is none. On an error of p it sleeps 1 ms.
inline bool readable_within(pollfd p, std::chrono::nanoseconds patience) {
  const auto seconds = std::chrono::floor<std::chrono::seconds>(patience);
  const timespec time{static_cast<time_t>(seconds.count()), static_cast<long>((patience - seconds).count())};
  if (::ppoll(&p, 1, &time, nullptr) <= 0) return false;
  // A dead interface is always "ready": polling it in a loop would take the whole processor.
  if ((p.revents & (POLLERR | POLLHUP | POLLNVAL)) != 0)
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  return (p.revents & POLLIN) != 0;
}

/// Waits up to `patience` for a frame to receive. False: there is none.
inline bool wait_for_frame(HostBus& bus, std::chrono::nanoseconds patience) {
  if (const RecordedBus* r = bus.recorded()) return r->has_input();
  if (bus.has_input()) return true;
  const bool input = readable_within(bus.polled(), patience);
  bus.flush();
  return input;
}
/// Waits up to `milliseconds` for a frame to receive. False: there is none.
inline bool wait_for_frame(HostBus& bus, int milliseconds) {
  return wait_for_frame(bus, std::chrono::milliseconds(milliseconds));
}
/// A virtual bus: returns at once whether a frame waits.
template <class Port>
requires requires(const Port& p) { p.waiting(); }
bool wait_for_frame(Port& port, int) { return port.waiting() > 0; }

template <class Bus>
bool wait_for_frame(Tapped<Bus>& tap, int milliseconds) {
  return wait_for_frame(tap.bus(), milliseconds);
}

/// True if the bus is lost for good (an slcan adapter); false for buses without gone().
template <class Bus>
bool is_gone(Bus& bus) {
  if constexpr (requires { bus.bus(); }) return is_gone(bus.bus());
  if constexpr (requires { bus.gone(); }) return bus.gone();
  return false;
}

/// True if a frame may come while the program waits: not on a virtual bus or from a recording.
template <class Bus>
bool may_come(const Bus& bus) {
  if constexpr (requires { bus.bus(); }) return may_come(bus.bus());
  if constexpr (requires { bus.recorded(); }) return bus.recorded() == nullptr;
  return false;
}

/// Result of waiting: the condition holds; Ctrl-C or a lost bus; time is over or no frame can come.
enum class Waited : std::uint8_t { done, stopped, silent };

/// Waits until `done()`, which reads frames and is called after each arrival, `stop()` or `patience` is over;
/// both count at every pass, so that frames of other nodes do not prolong the wait.
template <class Bus, class Done, class Stop>
Waited wait_until(Bus& bus, const Done& done, const Stop& stop, std::chrono::milliseconds patience) {
  // First without the clock, which on a virtual bus would cost as much as the frames.
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

inline constexpr int silence_ms = 5000;      ///< without a frame of the other end: the run has failed
inline constexpr int shutdown_wait_ms = 20;  ///< per tick, for the other end after a stop
/// The slcan adapter has been unplugged, or closed at its other end.
class BusGone : public RunError {
 public:
  BusGone() : RunError("the slcan adapter is gone: unplugged, or closed at its other end") {}
};

/// Waits for the other end: until `done`, Ctrl-C or silence. Throws BusGone.
template <class Bus, class Done>
Waited wait_for(Bus& bus, const Done& done, int patience_ms = silence_ms) {
  const Waited w = wait_until(
      bus, done, [&] { return stop_requested().load() || is_gone(bus); },
      std::chrono::milliseconds(patience_ms));
  if (w != Waited::done && is_gone(bus)) throw BusGone();
  return w;
}
/// Waits at most shutdown_wait_ms for `done`, after a stop. False: it did not come.
template <class Bus, class Done>
bool wait_briefly(Bus& bus, const Done& done) {
  return wait_until(
             bus, done, [] { return false; }, std::chrono::milliseconds(shutdown_wait_ms)) == Waited::done;
}

}  // namespace esmc::host
