/// Image of a NUCLEO board that measures the cycle: cycles of the core, and FDCAN in loop-back.

#include "boards/bench.hpp"

#include "boards/stm32/board.hpp"

namespace {
using namespace esmc;

struct Target : stm32::NucleoBoard {
  static constexpr const char* unit = "cycles";
  [[nodiscard]] static std::uint32_t count() { return stm32::reg(0xE000'1004U); }  // DWT_CYCCNT
  static void start_count() {
    stm32::set_bits(0xE000'EDFCU, 1U << 24);  // DEMCR.TRCENA
    stm32::reg(0xE000'1FB0U) = 0xC5AC'CE55U;  // DWT_LAR, of a Cortex-M7
    stm32::set_bits(0xE000'1000U, 1U);        // DWT_CTRL.CYCCNTENA
  }
  /// The console's ring is short: what it holds goes out first.
  [[nodiscard]] stm32::Console& out() {
    while (!console().idle()) console().pump();
    return console();
  }
};
}  // namespace

extern "C" [[noreturn]] void esmc_main() {
  static Target target;
  auto fault = target.start();
  // Its interrupt stays off: the bench calls the handler.
  if (fault == stm32::StartFault::none && !target.open(baked::bitrate, baked::data_bitrate, {}, true, 60'000))
    fault = stm32::StartFault::can;
  if (fault != stm32::StartFault::none) {
    target.out() << "start: " << name(fault) << "\r\n";
  } else {
    Target::start_count();
    bench::run(target);
  }
  for (;;) target.console().pump();
}
