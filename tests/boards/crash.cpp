/// Image of an emulated Cortex-M that provokes faults one after the other and prints, after the reset that
/// each one causes, the record that it left: reading where nothing is, a stack that runs out of its memory,
/// and a program that goes on for ever.

#include "tests/boards/crash.hpp"

#include "boards/mps2/board.hpp"

namespace {
[[gnu::section(".noinit")]] std::uint32_t boots;

struct Port {
  esmc::Uart uart{0x4000'4000U};
  void put(char c) {
    while (!uart.try_write({&c, 1})) {
    }
  }
};
}  // namespace

extern "C" [[gnu::noinline, gnu::used]] std::uint32_t read_nowhere() {
  return *reinterpret_cast<volatile std::uint32_t*>(0x9000'0000U);
}

extern "C" [[gnu::noinline, gnu::used]] std::uint32_t hang() {
  for (;;) asm volatile("");
}

extern "C" [[noreturn]] void esmc_main() {
  static Port port;
  const auto overflow = [] { return esmc::test::dig(0); };
  const auto bite = [] {
    esmc::Watchdog watchdog;
    watchdog.start(10'000);
    return hang();
  };
  esmc::test::crash_again(port, boots, read_nowhere, overflow, bite);
}
