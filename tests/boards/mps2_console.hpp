#pragma once
/// What measurements on an emulated board need: a timer, and a console.

#include "boards/mps2/board.hpp"

namespace esmc {

/// Counts 1.6 per instruction: with QEMU's -icount shift=6 one takes 64 ns, and the timer runs at 25 MHz.
class Timer {
 public:
  Timer() {
    reg(base + 8U) = 0xFFFF'FFFFU;
    reg(base + 4U) = 0xFFFF'FFFFU;
    reg(base) = 1U;
  }
  [[nodiscard]] std::uint32_t now() const { return 0xFFFF'FFFFU - reg(base + 4U); }

 private:
  static constexpr std::uint32_t base = 0x4000'0000U;
};

/// Text over a UART; waits until it fits.
struct Text {
  Uart& port;
  void put(char c) {
    while (!port.try_write({&c, 1})) {
    }
  }
  Text& operator<<(const char* s) {
    for (; *s != '\0'; ++s) put(*s);
    return *this;
  }
  Text& operator<<(std::uint32_t v) {
    std::uint32_t place = 1;
    while (v / place >= 10U) place *= 10U;
    for (; place > 0; place /= 10U) put(static_cast<char>('0' + v / place % 10U));
    return *this;
  }
};

}  // namespace esmc
