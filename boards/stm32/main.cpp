/// The image of a NUCLEO board. After any reset it is disabled: it listens, and is armed by a supervisor computer alone.

#include "boards/cortex_m/crash.hpp"
#include "boards/stm32/board.hpp"
#include "scene.hpp"

namespace {
using namespace esmc;

[[gnu::section(".noinit")]] std::uint32_t starts;  // any number without power, another one at each start

void tell_start(stm32::Console& out, std::uint32_t cause) {
  out << "\r\nesmc; reset flags ";
  out.hex(cause) << "\r\n";
  if (!crash_record.sealed()) return;
  out << "crash: exception " << crash_record.exception << " CFSR ";
  out.hex(crash_record.fault_status) << " HFSR ";
  out.hex(crash_record.hard_status) << " pc ";
  out.hex(crash_record.pc) << " sp ";
  out.hex(crash_record.sp) << "\r\n";
}

template <class Loop>
void tell_status(stm32::Console& out, const baked::Node& node, const Loop& loop, stm32::NucleoBoard& board) {
  out << "state " << static_cast<std::uint32_t>(node.supervisor().state()) << " fault "
      << static_cast<std::uint32_t>(node.supervisor().fault()) << " late " << loop.late() << " lost " << board.bus().lost()
      << " withdrawn " << board.bus().withdrawn() << " bus errors ";
  out.hex(board.bus().error_counters()) << "\r\n";
}
}  // namespace

extern "C" [[noreturn]] void esmc_main() {
  static_assert(!baked::lockstep, "a board has its own time: bake with --realtime");
  static_assert(baked::armed_by_link, "a board is armed by a supervisor computer: command.arm = \"link\" in the scene");
  static_assert(baked::period_ns <= 100'000'000, "the watchdog of a board waits for half a second at most");
  static stm32::NucleoBoard board;
  // Without clocks or bus nothing can be asked and nothing is: the outputs stay low. The fault number is for a debugger.
  static volatile stm32::StartFault start_fault;
  start_fault = board.start(baked::bitrate);
  while (start_fault != stm32::StartFault::none) asm volatile("wfi");

  ++starts;
  static baked::Node node(baked::config(static_cast<std::uint8_t>(1U + starts % 255U)));
  tell_start(board.console(), board.reset_cause());
  // After a crash it does not arm until the record is gone, with the power.
  const bool crashed = crash_record.sealed();
  TimedLoop loop(node, board, baked::period_ns);
  constexpr std::uint32_t period_us = baked::period_ns / 1000U;
  stm32::Chip::watchdog.start(period_us < 1000U ? 5000U : 5U * period_us);
  std::uint32_t told_us = board.now_us();
  for (;;) {
    if (crashed) node.command(Command::stop);
    if (loop.turn()) stm32::Chip::light.set(node.drive_enable());
    board.console().pump();
    if (board.now_us() - told_us >= 1'000'000U) {
      told_us += 1'000'000U;
      tell_status(board.console(), node, loop, board);
    }
  }
}
