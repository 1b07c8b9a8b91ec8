#pragma once
/// STM32G474RE on a NUCLEO-64 (MB1367): crystal 24 MHz, core 170 MHz, FDCAN1 on PA11, PA12. RM0440, UM2505.

#include "boards/stm32/peripherals.hpp"
#include "hal/fdcan/fdcan.hpp"
#include "hal/flash/bank_slots.hpp"

/// ECCD while a word of the slots is loaded; else 0: an uncorrectable error is a crash. The non-maskable
/// interrupt of such an error adds 1: damaged_flash.cpp.
extern "C" volatile std::uint32_t esmc_flash_damaged;

namespace esmc::stm32 {

inline constexpr Word flash_base = 0x4002'2000U;

/// Reader of flash that may be damaged. Reading a double word or page whose programming or erasure was cut
/// short gives a non-maskable interrupt (RM0440, 3.3.4), which must not be a crash at every start.
struct DamagedFlash {
  static constexpr Word eccr = flash_base + 0x18, eccd = 1U << 31, eccc = 1U << 30;

  /// Loads the word at `address`. False, `word` untouched: it is damaged.
  [[nodiscard]] static bool load(Word address, Word& word) {
    forget_corrected();
    esmc_flash_damaged = eccd;
    const Word value = reg(address);
    asm volatile("dsb\n isb" ::: "memory");
    const bool reported = (reg(eccr) & eccd) != 0;  // else cleared by the interrupt
    const bool damaged = reported || esmc_flash_damaged != eccd;
    esmc_flash_damaged = 0;
    if (!damaged) word = value;
    return !damaged;
  }
  /// Forgets a corrected error: while it stands, no uncorrectable one is reported (RM0440, 3.7.7). Call
  /// again and again.
  static void forget_corrected() { reg(eccr) = eccc; }
};

/// Addresses, pins, clocks and drivers of this board, for stm32/board.hpp.
struct NucleoG474re {
  static constexpr Word gpio_a = 0x4800'0000U, gpio_b = 0x4800'0400U, rcc = 0x4002'1000U;
  static constexpr Word reset_clock_hz = 16'000'000U;  // its own oscillator, before start_clocks()
  static constexpr Word timer_clock_hz = 170'000'000U, console_clock_hz = 170'000'000U;
  /// Of classic frames the crystal, without a PLL between it and the bus; 5 Mbit/s cannot be made of it.
  [[nodiscard]] static constexpr Word can_clock_hz(bool fd) { return fd ? 170'000'000U : 24'000'000U; }
  using CanMemory = FdcanMemory<0x4000'6400U, 0x4000'A400U>;
  using Can = hal::Fdcan<hal::fdcan::G4, CanMemory>;
  using Slots = hal::flash::G4Slots<FlashMemory<flash_base, DamagedFlash>>;  // the last two pages of bank 2
  static constexpr IndependentWatchdog watchdog{0x4000'3000U};
  static constexpr Word console = 0x4000'4400U;   // USART2, to the ST-LINK
  static constexpr Pin enable{gpio_a, 8};         // D7
  static constexpr Pin drive_enable{gpio_b, 10};  // D6
  static constexpr Pin brake{gpio_b, 5};          // D4
  static constexpr Pin light{gpio_a, 5};          // LD2

  static constexpr Function functions[] = {
      {{gpio_a, 11}, 9, true}, {{gpio_a, 12}, 9}, {{gpio_a, 2}, 7}};  // FDCAN1_RX, FDCAN1_TX, USART2_TX

  /// Starts the clocks of the ports and of the console.
  static void start_ports() {
    set_bits(rcc + 0x4C, 3);         // AHB2ENR: ports A and B
    set_bits(rcc + 0x58, 1U << 17);  // APB1ENR1: USART2
    finish_access(rcc + 0x4C);
  }

  /// Starts the clocks: 24 MHz / 6 x 85 / 2 = 170 MHz (boost). A crystal that stops later gives an NMI.
  [[nodiscard]] static StartFault start_clocks() {
    set_bits(rcc + 0x58, 1U << 28);  // APB1ENR1: PWR
    set_bits(rcc, 1U << 16);         // CR: HSEON
    if (!await(rcc, 1U << 17, 1U << 17)) return StartFault::oscillator;
    reg(0x4000'7080U) = reg(0x4000'7080U) & ~(1U << 8);          // PWR_CR5: R1MODE, boost
    reg(rcc + 0x0C) = 3U | (5U << 4) | (85U << 8) | (1U << 24);  // PLLCFGR: HSE, M 6, N 85, R 2 enabled
    set_bits(rcc, 1U << 24);                                     // PLLON
    if (!await(rcc, 1U << 25, 1U << 25)) return StartFault::pll;
    set_field(0x4002'2000U, 0xFU, 4U | (7U << 8));  // FLASH_ACR: 4 wait states, prefetch, caches
    if (!await(0x4002'2000U, 0xFU, 4)) return StartFault::clock_switch;
    set_field(rcc + 0x08, 0xFU << 4, 8U << 4);  // CFGR: half speed for a microsecond, as the manual asks
    set_field(rcc + 0x08, 3, 3);                // PLL
    if (!await(rcc + 0x08, 0xC, 0xC)) return StartFault::clock_switch;
    for (int n = 0; n < 200; ++n) asm volatile("nop");
    set_field(rcc + 0x08, 0xFU << 4, 0);
    set_bits(rcc, 1U << 19);                // CSSON
    set_bits(rcc + 0x58, (1U << 25) | 1U);  // APB1ENR1: FDCAN, TIM2
    finish_access(rcc + 0x58);
    return StartFault::none;
  }
  /// The CAN controller's clock (CCIPR): HSE, or PCLK1 for FD frames.
  static void prepare_can(bool fd) { set_field(rcc + 0x88, 3U << 24, fd ? 2U << 24 : 0U); }

  /// A word of the random number generator, on the 48 MHz oscillator; 0: it gives none.
  [[nodiscard]] static Word random() {
    set_bits(rcc + 0x98, 1);  // CRRCR: HSI48
    if (!await(rcc + 0x98, 2, 2)) return 0;
    set_bits(rcc + 0x4C, 1U << 26);  // AHB2ENR: RNG
    finish_access(rcc + 0x4C);
    return random_word(0x5006'0800U);
  }

  /// Brown-out level, 0 to 4 (FLASH_OPTR): the chip is in reset below about 1.7, 2.0, 2.2, 2.5 or 2.8 V.
  [[nodiscard]] static Word brown_out_level() { return (reg(flash_base + 0x20) >> 8) & 7U; }
  static constexpr Word brown_out_level_max = 4;

  static constexpr Word watchdog_reset = 1U << 29;
  /// Flags of the last reset (RCC_CSR), which it clears; bits: 31 low power, 30 window watchdog, 29
  /// independent watchdog, 28 software, 27 brown-out, 26 pin.
  [[nodiscard]] static Word reset_cause() {
    const Word cause = reg(rcc + 0x94) & 0xFE00'0000U;
    set_bits(rcc + 0x94, 1U << 23);
    return cause;
  }
};
using Chip = NucleoG474re;

}  // namespace esmc::stm32
