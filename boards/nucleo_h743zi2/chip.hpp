#pragma once
/// STM32H743ZI on a NUCLEO-144 (MB1364): 8 MHz from the ST-LINK, core 400 MHz, FDCAN1 on PD0, PD1. RM0433.

#include "boards/stm32/peripherals.hpp"
#include "hal/fdcan/fdcan.hpp"
#include "hal/flash/bank_slots.hpp"

namespace esmc::stm32 {

inline constexpr Word flash_base = 0x5200'2000U;

/// Reader of flash that may be damaged. Reading a flash word or sector whose programming or erasure was cut
/// short gives a bus fault, which must not be a crash at every start. With CCR.BFHFNMIGN and FAULTMASK the
/// load ignores it, and the status registers show it.
struct DamagedFlash {
  /// Loads the word at `address`. False, `word` untouched: it is damaged.
  [[nodiscard]] static bool load(Word address, Word& word) {
    constexpr Word ccr = 0xE000'ED14U, cfsr = 0xE000'ED28U, bus_fault = 0xFF00U, ignore = 1U << 8,
                   dbeccerr = 1U << 26;
    reg(flash_base + 0x114) = dbeccerr;  // CCR2
    set_bits(ccr, ignore);
    asm volatile("cpsid f\n dsb\n isb" ::: "memory");
    const Word value = reg(address);
    asm volatile("dsb\n isb" ::: "memory");
    const Word damage = (reg(cfsr) & bus_fault) | (reg(flash_base + 0x110) & dbeccerr);  // SR2; no branch
    reg(cfsr) = bus_fault;
    asm volatile("dsb\n cpsie f\n isb" ::: "memory");
    set_field(ccr, ignore, 0);
    if (damage == 0) word = value;
    return damage == 0;
  }
  /// An uncorrectable error is a bus fault, whatever was corrected before.
  static void forget_corrected() {}
};

/// Addresses, pins, clocks and drivers of this board, for stm32/board.hpp.
struct NucleoH743zi2 {
  static constexpr Word gpio_b = 0x5802'0400U, gpio_d = 0x5802'0C00U, gpio_e = 0x5802'1000U,
                        rcc = 0x5802'4400U, pwr = 0x5802'4800U;
  static constexpr Word reset_clock_hz = 64'000'000U;  // its own oscillator, before start_clocks()
  static constexpr Word timer_clock_hz = 200'000'000U, console_clock_hz = 100'000'000U;
  [[nodiscard]] static constexpr Word can_clock_hz(bool) { return 40'000'000U; }
  using CanMemory = FdcanMemory<0x4000'A000U, 0x4000'AC00U>;
  using Can = hal::Fdcan<hal::fdcan::H7, CanMemory>;
  using Slots = hal::flash::H7Slots<FlashMemory<flash_base, DamagedFlash>>;  // the last two sectors of bank 2
  static constexpr IndependentWatchdog watchdog{0x5800'4800U};
  static constexpr Word console = 0x4000'4800U;   // USART3, to the ST-LINK
  static constexpr Pin enable{gpio_e, 13};        // D3
  static constexpr Pin drive_enable{gpio_e, 11};  // D5
  static constexpr Pin brake{gpio_e, 9};          // D6
  static constexpr Pin light{gpio_b, 0};          // LD1

  static constexpr Function functions[] = {
      {{gpio_d, 0}, 9, true}, {{gpio_d, 1}, 9}, {{gpio_d, 8}, 7}};  // FDCAN1_RX, FDCAN1_TX, USART3_TX

  /// Starts the clocks of the ports and of the console.
  static void start_ports() {
    set_bits(rcc + 0xE0, (1U << 1) | (1U << 3) | (1U << 4));  // AHB4ENR: ports B, D, E
    set_bits(rcc + 0xE8, 1U << 18);                           // APB1LENR: USART3
    finish_access(rcc + 0xE0);
  }

  /// Starts the clocks: 8 MHz x 100 / 2 = 400 MHz at voltage scale 1, possible with every revision of the
  /// chip; buses at 200 and 100 MHz; 40 MHz for the CAN controller from the same PLL.
  [[nodiscard]] static StartFault start_clocks() {
    set_field(pwr + 0x0C, 7, 2);  // CR3: the internal regulator, and no other source
    if (!await(pwr + 0x04, 1U << 13, 1U << 13)) return StartFault::core_voltage;
    set_field(pwr + 0x18, 3U << 14, 3U << 14);  // D3CR: scale 1
    if (!await(pwr + 0x18, 1U << 13, 1U << 13)) return StartFault::core_voltage;
    set_bits(rcc, 1U << 18);  // CR: HSEBYP, then HSEON
    set_bits(rcc, 1U << 16);
    if (!await(rcc, 1U << 17, 1U << 17)) return StartFault::oscillator;
    reg(rcc + 0x28) = 2U | (1U << 4);                       // PLLCKSELR: HSE, M 1
    reg(rcc + 0x2C) = (3U << 2) | (1U << 16) | (1U << 17);  // PLLCFGR: 8 to 16 MHz in, wide VCO, P and Q
    reg(rcc + 0x30) = 99U | (1U << 9) | (19U << 16) | (1U << 24);  // PLL1DIVR: N 100, P 2, Q 20, R 2
    set_bits(rcc, 1U << 24);                                       // PLL1ON
    if (!await(rcc, 1U << 25, 1U << 25)) return StartFault::pll;
    set_field(0x5200'2000U, 0x3FU, 0x22U);  // FLASH_ACR: 2 wait states, programming delay 2
    if (!await(0x5200'2000U, 0x3FU, 0x22U)) return StartFault::clock_switch;
    reg(rcc + 0x18) = 8U | (4U << 4);         // D1CFGR: core 1/1, AHB 1/2, APB3 1/2
    reg(rcc + 0x1C) = (4U << 4) | (4U << 8);  // D2CFGR: APB1, APB2 1/2
    reg(rcc + 0x20) = 4U << 4;                // D3CFGR: APB4 1/2
    set_field(rcc + 0x10, 7, 3);              // CFGR: PLL1
    if (!await(rcc + 0x10, 7U << 3, 3U << 3)) return StartFault::clock_switch;
    set_bits(rcc, 1U << 19);                    // HSECSSON
    set_field(rcc + 0x50, 3U << 28, 1U << 28);  // D2CCIP1R: FDCAN from PLL1 Q
    set_bits(rcc + 0xE8, 1U);                   // APB1LENR: TIM2
    set_bits(rcc + 0xEC, 1U << 8);              // APB1HENR: FDCAN
    finish_access(rcc + 0xEC);
    start_instruction_cache();
    return StartFault::none;
  }
  /// Bypasses the clock calibration unit (CCU_CCFG.BCC) in FDCAN1's configuration mode.
  static void prepare_can(bool) {
    constexpr Word cccr = 0x4000'A018U;
    reg(cccr) = 1;
    (void)await(cccr, 1, 1);
    reg(cccr) = 3;
    reg(0x4000'A804U) = 1U << 6;
  }

  /// A word of the random number generator, on the 48 MHz oscillator; 0: it gives none.
  [[nodiscard]] static Word random() {
    set_bits(rcc, 1U << 12);  // CR: HSI48ON
    if (!await(rcc, 1U << 13, 1U << 13)) return 0;
    set_bits(rcc + 0xDC, 1U << 6);  // AHB2ENR: RNG
    finish_access(rcc + 0xDC);
    return random_word(0x4802'1800U);
  }

  /// Brown-out level, 0 to 3 (FLASH_OPTSR_CUR): the chip is in reset below about 1.7, 2.1, 2.4 or 2.7 V.
  [[nodiscard]] static Word brown_out_level() { return (reg(flash_base + 0x1C) >> 2) & 3U; }
  static constexpr Word brown_out_level_max = 3;

  static constexpr Word watchdog_reset = 1U << 26;
  /// Flags of the last reset (RCC_RSR), which it clears; bits: 28 window watchdog, 26 independent watchdog,
  /// 24 software, 23 power, 22 pin, 21 brown-out.
  [[nodiscard]] static Word reset_cause() {
    const Word cause = reg(rcc + 0xD0) & 0xFFFE'0000U;
    set_bits(rcc + 0xD0, 1U << 16);
    return cause;
  }

 private:
  /// Data lies in the core's own memory, which needs no cache.
  static void start_instruction_cache() {
    asm volatile("dsb\n isb" ::: "memory");
    reg(0xE000'EF50U) = 0;  // ICIALLU
    asm volatile("dsb\n isb" ::: "memory");
    set_bits(0xE000'ED14U, 1U << 17);  // CCR.IC
    asm volatile("dsb\n isb" ::: "memory");
  }
};
using Chip = NucleoH743zi2;

}  // namespace esmc::stm32
