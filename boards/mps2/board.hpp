#pragma once
/// Peripherals of an Arm MPS2 board: UART0 carries CAN as slcan, the FPGA's counter is the clock. Application
/// notes AN386 and AN500; QEMU's machines mps2-an386 and mps2-an500.

#include <cstdint>
#include <span>

#include "boards/node.hpp"
#include "hal/slcan/slcan.hpp"

namespace esmc {

/// The register at an absolute address.
[[nodiscard]] inline volatile std::uint32_t& reg(std::uint32_t address) {
  return *reinterpret_cast<volatile std::uint32_t*>(address);
}

/// CMSDK APB UART, polled, as a hal::BytePort. Bytes that cannot be sent at once wait in a ring.
class Uart {
 public:
  /// Starts the UART whose registers begin at `base`.
  explicit Uart(std::uint32_t base) : base_(base) {
    reg(base_ + bauddiv) = 217;  // 115 200 of 25 MHz; ignored by the emulator
    reg(base_ + control) = 3;    // transmitter and receiver on, no interrupts
  }
  /// Queues all bytes. False: they do not fit the ring, none is taken.
  bool try_write(std::span<const char> bytes) {
    drain();
    if (bytes.size() > ring_size - 1 - ((head_ - tail_) % ring_size)) return false;
    for (const char c : bytes) {
      ring_[head_ % ring_size] = c;
      head_ = (head_ + 1) % ring_size;
    }
    drain();
    return true;
  }
  /// Reads the next received byte. False: there is none, `byte` untouched.
  bool try_read(char& byte) {
    drain();
    if ((reg(base_ + state) & 2U) == 0) return false;
    byte = static_cast<char>(reg(base_ + data) & 0xFFU);
    return true;
  }

 private:
  static constexpr std::uint32_t data = 0, state = 4, control = 8, bauddiv = 16, ring_size = 512;
  void drain() {
    while (tail_ != head_ && (reg(base_ + state) & 1U) == 0) {
      reg(base_ + data) = static_cast<std::uint8_t>(ring_[tail_]);
      tail_ = (tail_ + 1) % ring_size;
    }
  }
  std::uint32_t base_, head_ = 0, tail_ = 0;
  char ring_[ring_size] = {};
};

/// CMSDK APB watchdog. The first time-out is an NMI, which keeps a crash record and restarts the program; a
/// second one without a refresh resets the processor.
class Watchdog {
 public:
  /// Starts it with a time-out of time_us, below 171 s, not checked.
  void start(std::uint32_t time_us) {
    reg(base + lock) = 0x1ACC'E551U;
    reg(base + load) = 25U * time_us;
    reg(base + control) = 3;
  }
  void refresh() { reg(base + clear) = 1; }  ///< restarts the time-out

 private:
  static constexpr std::uint32_t base = 0x4000'8000U, load = 0, control = 8, clear = 0xC, lock = 0xC00;
};

/// Bus, watchdog, light and clock of an MPS2 board for the loops of node.hpp.
class Mps2Board {
 public:
  static constexpr std::uint32_t watchdog_us = 100'000;  ///< of the emulator's time; a tick takes < 1 ms

  /// Starts clock and watchdog: the first refresh is due within watchdog_us.
  Mps2Board() {
    reg(fpgaio + prescale) = 24;  // 25 MHz to 1 MHz
    watchdog_.start(watchdog_us);
  }

  [[nodiscard]] hal::SlcanBus<Uart>& bus() { return bus_; }
  [[nodiscard]] std::uint32_t now_us() const { return reg(fpgaio + counter); }  ///< wraps after 71 minutes

  /// The light that shows `drive_enable`.
  struct Led {
    void set(bool on) { reg(fpgaio) = on ? 1U : 0U; }
  };
  [[nodiscard]] Watchdog& watchdog() { return watchdog_; }
  [[nodiscard]] NoContact& enable() { return enable_; }
  [[nodiscard]] Led& drive_enable() { return led_; }

 private:
  static constexpr std::uint32_t fpgaio = 0x4002'8000U, counter = 0x18, prescale = 0x1C;
  Uart uart_{0x4000'4000U};
  hal::SlcanBus<Uart> bus_{uart_};
  Watchdog watchdog_;
  NoContact enable_;
  Led led_;
};
static_assert(Board<Mps2Board>);

}  // namespace esmc
