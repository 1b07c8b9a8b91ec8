/// The non-maskable interrupt of an STM32G4. An uncorrectable error while a slot is read is a record of
/// parameters that was cut short, and only marked; any other, or a stopped crystal, is a crash. The address
/// in FLASH_ECCR does not decide: an earlier error freezes it (RM0440, 3.3.2).

#include "chip.hpp"

extern "C" {
volatile std::uint32_t esmc_flash_damaged;

[[gnu::naked]] void esmc_nmi() {
  asm volatile(
      "ldr r0, =0x40022018\n"  // FLASH_ECCR
      "ldr r1, [r0]\n"
      "ldr r2, =esmc_flash_damaged\n"
      "ldr r3, [r2]\n"  // ECCD while a slot is read
      "ands r3, r1\n"
      "ands r3, r3, #0x80000000\n"
      "beq esmc_fault\n"
      "str r3, [r0]\n"  // cleared by writing it; others that are pending come again
      "orr r3, #1\n"
      "str r3, [r2]\n"
      "dsb\n"
      "bx lr\n"
      ".ltorg\n");
}
}
