/// From reset to esmc_main() on the Cortex-R5F, and the handling of exceptions. All of it runs in system
/// mode, so that no exception overwrites a register of the interrupted code.

#include "boards/cortex_m/memory.hpp"

extern "C" {
/// The exception vectors, at address 0, in Arm state. Number n, of the word at 4 n, goes into the record.
[[gnu::naked, gnu::target("arm"), gnu::section(".vectors"), gnu::used]] void esmc_vectors() {
  asm volatile(
      "ldr pc, [pc, #24]\n"  // reset
      "ldr pc, [pc, #24]\n"  // undefined instruction
      "ldr pc, [pc, #24]\n"  // supervisor call
      "ldr pc, [pc, #24]\n"  // prefetch abort
      "ldr pc, [pc, #24]\n"  // data abort
      "ldr pc, [pc, #24]\n"  // not used
      "ldr pc, [pc, #24]\n"  // interrupt
      "ldr pc, [pc, #24]\n"  // fast interrupt
      ".word esmc_entry, esmc_undefined, esmc_call, esmc_prefetch_abort\n"
      ".word esmc_data_abort, esmc_unused, esmc_irq, esmc_fiq\n");
}

/// Resets the processor's state. Subnormal numbers are kept, rounding is to nearest, as on the host.
[[gnu::naked, gnu::target("arm"), gnu::used]] void esmc_entry() {
  asm volatile(
      "cpsid aif, #31\n"             // system mode, everything masked
      "mrc p15, 0, r0, c1, c0, 0\n"  // SCTLR
      "bic r0, r0, #0x2000\n"        // V: vectors at 0
      "bic r0, r0, #0x40000000\n"    // TE: in Arm state
      "bic r0, r0, #1\n"             // M: no guard yet
      "mcr p15, 0, r0, c1, c0, 0\n"
      "mrc p15, 0, r0, c1, c0, 2\n"  // CPACR: full access to the FPU
      "orr r0, r0, #0x00F00000\n"
      "mcr p15, 0, r0, c1, c0, 2\n"
      "isb\n"
      "mov r0, #0x40000000\n"  // FPEXC.EN
      "vmsr fpexc, r0\n"
      "mov r0, #0\n"
      "vmsr fpscr, r0\n"
      "ldr sp, =esmc_stack_top\n"
      "ldr r0, =esmc_reset\n"
      "bx r0\n"
      ".ltorg\n");
}

[[noreturn]] void esmc_reset() {
  esmc::prepare_memory();
  // No access to the lowest 256 bytes of the stack: a stack that grows too far faults at once.
  asm volatile("mcr p15, 0, %0, c6, c2, 0" ::"r"(0U));                  // RGNR
  asm volatile("mcr p15, 0, %0, c6, c1, 0" ::"r"(&esmc_stack_bottom));  // DRBAR
  asm volatile("mcr p15, 0, %0, c6, c1, 4" ::"r"(1U << 12));        // DRACR: no access, nothing to execute
  asm volatile("mcr p15, 0, %0, c6, c1, 2" ::"r"((7U << 1) | 1U));  // DRSR: 256 bytes
  std::uint32_t control = 0;
  asm volatile("mrc p15, 0, %0, c1, c0, 0" : "=r"(control));
  control |= (1U << 17) | 1U;  // SCTLR: BR, the default map around it; M
  asm volatile("dsb\n mcr p15, 0, %0, c1, c0, 0\n isb" ::"r"(control) : "memory");
  asm volatile("cpsie a" ::: "memory");  // a write that the bus rejects is an exception, too
  esmc_main();
}

[[gnu::section(".noinit"), gnu::used]] alignas(8) unsigned char esmc_crash_stack[256];

/// Unexpected exceptions: keeps a record, then restarts the image; the controller starts disabled.
#define ESMC_EXCEPTION(name, number)                                                 \
  [[gnu::naked, gnu::target("arm"), gnu::used]] void name() {                        \
    asm volatile("mov r0, #" #number "\n mov r1, lr\n b esmc_fault\n" ::: "memory"); \
  }
ESMC_EXCEPTION(esmc_undefined, 1)
ESMC_EXCEPTION(esmc_call, 2)
ESMC_EXCEPTION(esmc_prefetch_abort, 3)
ESMC_EXCEPTION(esmc_data_abort, 4)
ESMC_EXCEPTION(esmc_unused, 5)
ESMC_EXCEPTION(esmc_irq, 6)
ESMC_EXCEPTION(esmc_fiq, 7)
#undef ESMC_EXCEPTION

[[gnu::naked, gnu::target("arm"), gnu::used]] void esmc_fault() {
  asm volatile(
      "cpsid aif, #31\n"
      "mov r2, sp\n"
      "mov r3, lr\n"
      "ldr sp, =esmc_crash_stack + 256\n"  // the stack in use may have failed
      "ldr ip, =esmc_crash\n"
      "bx ip\n"
      ".ltorg\n");
}
[[gnu::used, noreturn]] void esmc_crash(std::uint32_t exception, std::uint32_t back, std::uint32_t sp,
                                        std::uint32_t lr) {
  const bool prefetch = exception == 3;
  std::uint32_t data_status = 0, instruction_status = 0, address = 0;
  asm volatile("mrc p15, 0, %0, c5, c0, 0" : "=r"(data_status));
  asm volatile("mrc p15, 0, %0, c5, c0, 1" : "=r"(instruction_status));
  if (prefetch) {
    asm volatile("mrc p15, 0, %0, c6, c0, 2" : "=r"(address));
  } else {
    asm volatile("mrc p15, 0, %0, c6, c0, 0" : "=r"(address));
  }
  esmc::crash_record = {};
  esmc::crash_record.exception = exception;
  esmc::crash_record.fault_status = data_status;
  esmc::crash_record.hard_status = instruction_status;
  esmc::crash_record.address = address;
  esmc::crash_record.sp = sp;
  const std::uint32_t past = exception == 4 ? 8U : exception < 3 ? 2U : 4U;  // of an image in Thumb state
  esmc::crash_record.pc = back - past;
  esmc::crash_record.lr = lr;
  esmc::crash_record.seal();
  asm volatile("dsb\n ldr ip, =esmc_entry\n bx ip\n .ltorg" ::: "memory");
  for (;;) asm volatile("dsb");
}
}

namespace esmc {
[[gnu::section(".noinit")]] CrashRecord crash_record;
}
