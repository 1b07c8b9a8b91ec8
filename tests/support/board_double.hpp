#pragma once
/// A board whose clock and contact a test sets, and whose outputs and watchdog it reads; see boards/node.hpp.

#include <cstdint>

namespace esmc::test {

struct PinDouble {
  bool on = false;
  [[nodiscard]] bool closed() const { return on; }
  void set(bool v) { on = v; }
};
struct WatchdogDouble {
  unsigned refreshed = 0;
  void refresh() { ++refreshed; }
};
template <class Bus>
struct BoardDouble {
  Bus bus_;
  WatchdogDouble dog;
  PinDouble contact{true}, power, brake_;
  std::uint32_t now = 0;
  Bus& bus() { return bus_; }
  WatchdogDouble& watchdog() { return dog; }
  PinDouble& enable() { return contact; }
  PinDouble& drive_enable() { return power; }
  PinDouble& brake() { return brake_; }
  [[nodiscard]] std::uint32_t now_us() const { return now; }
};

}  // namespace esmc::test
