/// The non-maskable interrupt of an STM32G4. An uncorrectable error in bank 2 of the flash is a record of
/// parameters that was cut short, and only marked; an error in bank 1, or a stopped crystal, is a crash.

#include "chip.hpp"

extern "C" {
volatile std::uint32_t esmc_flash_damaged;

[[gnu::naked]] void esmc_nmi() {
  asm volatile(
      "ldr r0, =0x40022018\n"  // FLASH_ECCR
      "ldr r1, [r0]\n"
      "ldr r2, =0x80600000\n"  // ECCD, SYSF_ECC, BK_ECC
      "ldr r3, =0x80200000\n"  // ECCD in bank 2, and not in what ST has put there
      "ands r2, r1\n"
      "cmp r2, r3\n"
      "bne esmc_fault\n"
      "str r1, [r0]\n"  // cleared by writing it; others that are pending come again
      "ldr r0, =esmc_flash_damaged\n"
      "movs r1, #1\n"
      "str r1, [r0]\n"
      "dsb\n"
      "bx lr\n"
      ".ltorg\n");
}
}
