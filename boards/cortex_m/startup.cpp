/// From reset to esmc_main() on a Cortex-M, and the handling of exceptions.

#include "boards/cortex_m/memory.hpp"

extern "C" {
[[noreturn]] void esmc_reset() {
  // Full access to the FPU, before the compiler uses it. Its reset state is that of the host: subnormal
  // numbers are kept, rounding is to nearest.
  auto* const cpacr = reinterpret_cast<volatile std::uint32_t*>(0xE000ED88U);
  *cpacr = *cpacr | 0x00F0'0000U;
  // Own exception numbers for bus, usage and memory faults.
  auto* const shcsr = reinterpret_cast<volatile std::uint32_t*>(0xE000ED24U);
  *shcsr = *shcsr | 0x0007'0000U;
  asm volatile("dsb\n isb" ::: "memory");
  esmc::prepare_memory();
  // No access to the lowest 256 bytes of the stack: a stack that grows too far faults at once.
  const auto mpu = [](std::uint32_t at) -> volatile std::uint32_t& {
    return *reinterpret_cast<volatile std::uint32_t*>(at);
  };
  mpu(0xE000ED98U) = 0;  // RNR
  mpu(0xE000ED9CU) =
      static_cast<std::uint32_t>(reinterpret_cast<std::uintptr_t>(&esmc_stack_bottom));  // RBAR
  mpu(0xE000EDA0U) = (1U << 28) | (7U << 1) | 1U;                                        // RASR: 256 bytes
  mpu(0xE000ED94U) = 5;  // CTRL: on, with the default map around it
  asm volatile("dsb\n isb" ::: "memory");
  esmc_main();
}
constexpr std::uintptr_t stack_guard = 256;

/// Unexpected exceptions: keeps a record of the stacked registers, then resets.
[[gnu::naked]] void esmc_fault() {
  asm volatile(
      "mrs r0, msp\n"
      "ldr r1, =esmc_crash_stack + 256\n"  // the stack in use may have failed
      "mov sp, r1\n"
      "b esmc_crash\n"
      ".ltorg\n");
}
/// A board may replace it for non-maskable interrupts that are no crash; it must leave the stack as it is and
/// branch to esmc_fault for all others.
[[gnu::weak, gnu::alias("esmc_fault"), gnu::nothrow]] void esmc_nmi();
[[gnu::section(".noinit"), gnu::used]] alignas(8) unsigned char esmc_crash_stack[256];
[[gnu::used, noreturn]] void esmc_crash(const std::uint32_t* stacked) {
  const auto reg = [](std::uint32_t at) { return *reinterpret_cast<volatile std::uint32_t*>(at); };
  const std::uint32_t exception = reg(0xE000ED04U) & 0x1FFU;
  // A stack that ran into its guard cannot be read again.
  const auto at = reinterpret_cast<std::uintptr_t>(stacked);
  const bool readable = at >= reinterpret_cast<std::uintptr_t>(&esmc_stack_bottom) + stack_guard &&
                        at + 32 <= reinterpret_cast<std::uintptr_t>(&esmc_stack_top);
  esmc::crash_record = {};
  esmc::crash_record.exception = exception;
  esmc::crash_record.fault_status = reg(0xE000ED28U);
  esmc::crash_record.address = reg(0xE000ED38U);
  esmc::crash_record.sp = at;
  esmc::crash_record.pc = readable ? stacked[6] : 0;
  esmc::crash_record.lr = readable ? stacked[5] : 0;
  esmc::crash_record.hard_status = reg(0xE000ED2CU);
  esmc::crash_record.seal();
  asm volatile("dsb" ::: "memory");
  *reinterpret_cast<volatile std::uint32_t*>(0xE000ED0CU) = 0x05FA'0004U;  // reset request
  for (;;) asm volatile("dsb");
}
}

namespace esmc {
[[gnu::section(".noinit")]] CrashRecord crash_record;
}

namespace {
using Vector = void (*)();
constexpr int vectors = 16 + 150;
struct Table {
  const void* stack;
  Vector handler[vectors - 1];
};
constexpr Table table() {
  Table t{&esmc_stack_top, {}};
  for (Vector& v : t.handler) v = esmc_fault;  // also of an interrupt that the board does not use
#ifdef ESMC_CAN_INTERRUPT
  t.handler[15 + ESMC_CAN_INTERRUPT] = esmc_can_interrupt;
#endif
  t.handler[0] = esmc_reset;
  t.handler[1] = esmc_nmi;
  return t;
}
}  // namespace
[[gnu::section(".vectors"), gnu::used]] constinit const Table esmc_vectors = table();
