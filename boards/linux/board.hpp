#pragma once
/// A single-board computer with a CAN interface as the loop sees it.

#include "boards/node.hpp"
#include "hal/linux/realtime.hpp"
#include "hal/linux/socketcan.hpp"

namespace esmc {

class LinuxBoard {
 public:
  explicit LinuxBoard(hal::SocketCan& bus) : bus_(bus) {}

  /// No contact and no output is wired: use the drives' own enable inputs.
  struct NoContact {
    [[nodiscard]] static bool closed() { return true; }
  };
  struct NoOutput {
    static void set(bool) {}
  };
  /// The drives' own watchdogs see to a computer that has stopped.
  struct NoWatchdog {
    static void refresh() {}
  };
  [[nodiscard]] hal::SocketCan& bus() { return bus_; }
  [[nodiscard]] NoWatchdog& watchdog() { return watchdog_; }
  [[nodiscard]] NoContact& enable() { return enable_; }
  [[nodiscard]] NoOutput& drive_enable() { return output_; }
  [[nodiscard]] std::uint32_t now_us() const { return static_cast<std::uint32_t>(hal::monotonic_ns() / 1000U); }

 private:
  hal::SocketCan& bus_;
  NoWatchdog watchdog_;
  NoContact enable_;
  NoOutput output_;
};
static_assert(Board<LinuxBoard>);

}  // namespace esmc
