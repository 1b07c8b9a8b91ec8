#pragma once
/// Peripherals of a ZCU102: CAN1, which has the board's transceiver (UG1182), and the core's cycle counter.
/// The first-stage boot loader sets up clocks and pins. Sources: UG1085, UG1087, Cortex-R5 TRM (DDI 0460).

#include <cstdint>

#include "boards/node.hpp"
#include "hal/zynqmp_can/zynqmp_can.hpp"

namespace esmc {

/// hal::ZynqmpCanAccess: registers by byte offset from `base`.
template <std::uint32_t base>
struct Registers {
  [[nodiscard]] std::uint32_t read(std::uint32_t at) const {
    return *reinterpret_cast<volatile std::uint32_t*>(base + at);
  }
  void write(std::uint32_t at, std::uint32_t value) {
    *reinterpret_cast<volatile std::uint32_t*>(base + at) = value;
  }
};

/// Bus and clock of a ZCU102 for the lockstep loop of node.hpp.
class Zcu102Board {
 public:
  /// The emulator's registers hold frames in another layout.
  static constexpr auto layout =
      ESMC_CAN_OF_QEMU ? hal::zynqmp_can::Layout::qemu_7_2 : hal::zynqmp_can::Layout::manual;
  using Can = hal::ZynqmpCan<layout, Registers<0xFF07'0000U>>;

  Zcu102Board() {
    asm volatile("mcr p15, 0, %0, c9, c12, 0" ::"r"(5U));        // PMCR: counters on, cycle counter from 0
    asm volatile("mcr p15, 0, %0, c9, c12, 1" ::"r"(1U << 31));  // PMCNTENSET: the cycle counter
  }
  /// Joins the bus at `bit_rate`, bit/s. False: as hal::ZynqmpCan::open.
  [[nodiscard]] bool start(std::uint32_t bit_rate) { return bus_.open(can_clock_hz, bit_rate); }

  [[nodiscard]] Can& bus() { return bus_; }
  /// Time, us. Call it at least every 4 s: the counter of cycles wraps.
  [[nodiscard]] std::uint32_t now_us() {
    std::uint32_t cycles = 0;
    asm volatile("mrc p15, 0, %0, c9, c13, 0" : "=r"(cycles));  // PMCCNTR
    rest_ += cycles - before_;
    before_ = cycles;
    us_ += rest_ / cycles_per_us;
    rest_ %= cycles_per_us;
    return us_;
  }

  // Lockstep needs no watchdog; the input `enable` is not wired (it reads as closed), nor is the output.
  [[nodiscard]] NoWatchdog& watchdog() { return watchdog_; }
  [[nodiscard]] NoContact& enable() { return enable_; }
  [[nodiscard]] NoOutput& drive_enable() { return drive_enable_; }

 private:
  static constexpr std::uint32_t can_clock_hz = 100'000'000U;  // CAN1_REF_CTRL as the board's preset has it
  static constexpr std::uint32_t cycles_per_us = 500;          // of the processor; an emulator has its own
  Can bus_{Registers<0xFF07'0000U>{}};
  std::uint32_t before_ = 0, rest_ = 0, us_ = 0;
  NoWatchdog watchdog_;
  NoContact enable_;
  NoOutput drive_enable_;
};
static_assert(Board<Zcu102Board>);

}  // namespace esmc
