/// From reset to esmc_main() on a Cortex-M, and what happens when the processor can not go on.

#include "boards/cortex_m/crash.hpp"

extern "C" {
// From the linker script.
extern std::uint32_t esmc_stack_top, esmc_data_begin, esmc_data_end, esmc_bss_begin, esmc_bss_end,
    esmc_stack_bottom;
extern const std::uint32_t esmc_data_image;

[[noreturn]] void esmc_main();

[[noreturn]] void esmc_reset() {
  // Full access to the FPU, before the compiler uses it. Subnormal numbers are kept and rounding is to
  // nearest, as on the host: the state after reset.
  auto* const cpacr = reinterpret_cast<volatile std::uint32_t*>(0xE000ED88U);
  *cpacr = *cpacr | 0x00F0'0000U;
  // Bus, usage and memory faults under their own number.
  auto* const shcsr = reinterpret_cast<volatile std::uint32_t*>(0xE000ED24U);
  *shcsr = *shcsr | 0x0007'0000U;
  asm volatile("dsb\n isb" ::: "memory");
  const std::uint32_t* from = &esmc_data_image;
  for (std::uint32_t* to = &esmc_data_begin; to < &esmc_data_end;) *to++ = *from++;
  for (std::uint32_t* to = &esmc_bss_begin; to < &esmc_bss_end;) *to++ = 0;
  // Painted up to here, so that the deepest use can be read from memory.
  std::uint32_t* here = nullptr;
  asm volatile("mov %0, sp" : "=r"(here));
  for (std::uint32_t* to = &esmc_stack_bottom; to < here; ++to)
    *static_cast<volatile std::uint32_t*>(to) = esmc::stack_paint;
  // The lowest part of the stack is its guard: no access at all, so that a stack that grows too far faults at
  // once, whatever lies below it.
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

/// Any exception that nobody expects: what the processor stacked is kept, then it starts anew, disabled.
[[gnu::naked]] void esmc_fault() {
  asm volatile(
      "mrs r0, msp\n"
      "ldr r1, =esmc_crash_stack + 256\n"  // the stack in use may be what has failed
      "mov sp, r1\n"
      "b esmc_crash\n"
      ".ltorg\n");
}
/// A board whose chip has a non-maskable interrupt that is none to crash for has its own; it begins with the
/// stack as it finds it and ends in esmc_fault for all others.
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
constexpr int vectors = 16 + 150;  // no interrupt is used; each is a fault
struct Table {
  const void* stack;
  Vector handler[vectors - 1];
};
constexpr Table table() {
  Table t{&esmc_stack_top, {}};
  for (Vector& v : t.handler) v = esmc_fault;
  t.handler[0] = esmc_reset;
  t.handler[1] = esmc_nmi;
  return t;
}
}  // namespace
[[gnu::section(".vectors"), gnu::used]] constinit const Table esmc_vectors = table();
