#pragma once
/// A Linux computer with a CAN interface.

#include "boards/node.hpp"
#include "hal/linux/gpio_line.hpp"
#include "hal/linux/realtime.hpp"
#include "hal/linux/socketcan.hpp"

namespace esmc {

/// Bus, contacts and clock of a Linux computer for the loops of node.hpp.
class LinuxBoard {
 public:
  explicit LinuxBoard(hal::SocketCan& bus) : bus_(bus) {}  ///< `bus` must outlive the board

  /// An output that makes a system call only when it changes.
  class Output {
   public:
    /// Sets the level. False: the kernel refused; the next call tries again.
    bool set(bool high) {
      if (!known_ || high != high_) known_ = line_.set(high);
      high_ = high;
      return known_;
    }
    [[nodiscard]] hal::GpioLine& line() { return line_; }  ///< the GPIO line; not wired before request()

   private:
    hal::GpioLine line_;
    bool known_ = false, high_ = false;
  };
  [[nodiscard]] hal::SocketCan& bus() { return bus_; }
  /// There is no watchdog: the drives' own ones react if the computer stops.
  [[nodiscard]] NoWatchdog& watchdog() { return watchdog_; }
  /// A line without a request is not wired: the contact counts as closed, an output has no effect.
  [[nodiscard]] hal::GpioLine& enable() { return enable_; }
  [[nodiscard]] Output& drive_enable() { return drive_enable_; }
  [[nodiscard]] Output& brake() { return brake_; }
  /// Monotonic time, us; wraps after 71 minutes.
  [[nodiscard]] std::uint32_t now_us() const {
    return static_cast<std::uint32_t>(hal::monotonic_ns() / 1000U);
  }

 private:
  hal::SocketCan& bus_;
  NoWatchdog watchdog_;
  hal::GpioLine enable_;
  Output drive_enable_, brake_;
};
static_assert(Board<LinuxBoard>);

}  // namespace esmc
