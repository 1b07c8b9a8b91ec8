#pragma once
/// A single-board computer with a CAN interface as the loop sees it.

#include "boards/node.hpp"
#include "hal/linux/gpio_line.hpp"
#include "hal/linux/realtime.hpp"
#include "hal/linux/socketcan.hpp"

namespace esmc {

class LinuxBoard {
 public:
  explicit LinuxBoard(hal::SocketCan& bus) : bus_(bus) {}

  /// An output that costs a system call when it changes and not in every tick.
  class Output {
   public:
    /// False: the kernel refused; the next call tries again.
    bool set(bool high) {
      if (!known_ || high != high_) known_ = line_.set(high);
      high_ = high;
      return known_;
    }
    [[nodiscard]] hal::GpioLine& line() { return line_; }

   private:
    hal::GpioLine line_;
    bool known_ = false, high_ = false;  // a call that failed is made again
  };
  /// The drives' own watchdogs see to a computer that has stopped.
  struct NoWatchdog {
    static void refresh() {}
  };
  [[nodiscard]] hal::SocketCan& bus() { return bus_; }
  [[nodiscard]] NoWatchdog& watchdog() { return watchdog_; }
  /// Lines that nobody requests are not wired: the contact is closed, the outputs go nowhere.
  [[nodiscard]] hal::GpioLine& enable() { return enable_; }
  [[nodiscard]] Output& drive_enable() { return drive_enable_; }
  [[nodiscard]] Output& brake() { return brake_; }
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
