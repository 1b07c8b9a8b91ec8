/// Image of the emulated Cortex-R5F that provokes faults one after the other and prints, after the new start
/// that each one causes, the record that it left: an instruction that does not exist (the emulated board
/// answers wherever one reads), and a stack that runs out of its memory.

#include "tests/boards/crash.hpp"

namespace {
[[gnu::section(".noinit")]] std::uint32_t boots;

/// UART0 (UG1087, module UART).
struct Port {
  Port() { reg(0) = (1U << 4) | (1U << 2); }  // Control: transmitter and receiver on
  void put(char c) {
    while ((reg(0x2C) & (1U << 4)) != 0) {  // Channel_sts: transmit FIFO full
    }
    reg(0x30) = static_cast<unsigned char>(c);
  }
  [[nodiscard]] static volatile std::uint32_t& reg(std::uint32_t at) {
    return *reinterpret_cast<volatile std::uint32_t*>(0xFF00'0000U + at);
  }
};
}  // namespace

extern "C" [[gnu::noinline, gnu::used]] std::uint32_t not_an_instruction() {
  asm volatile("udf #0");
  return 0;
}

extern "C" [[noreturn]] void esmc_main() {
  static Port port;
  esmc::test::crash_again(port, boots, not_an_instruction, [] { return esmc::test::dig(0); });
}
