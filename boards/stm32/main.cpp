/// The image of a NUCLEO board: disabled, without torque, until a supervisor computer arms it.

#include "boards/capture.hpp"
#include "boards/cortex_m/crash.hpp"
#include "boards/light.hpp"
#include "boards/stm32/board.hpp"
#include "firmware/link/parameter_slots.hpp"
#include "scene.hpp"

namespace {
using namespace esmc;

[[gnu::section(".noinit")]] std::uint32_t starts;  // seed of the session, changed at each start

[[gnu::noinline]] void print_start(stm32::Console& out, std::uint32_t cause) {
  out << "\r\nesmc, link protocol " << link::protocol_version << "; reset flags ";
  out.hex(cause) << ", brown-out level " << stm32::Chip::brown_out_level() << " of "
                 << stm32::Chip::brown_out_level_max << "\r\n";
  if (!crash_record.sealed()) return;
  out << "crash: exception " << crash_record.exception << " CFSR ";
  out.hex(crash_record.fault_status) << " HFSR ";
  out.hex(crash_record.hard_status) << " pc ";
  out.hex(crash_record.pc) << " sp ";
  out.hex(crash_record.sp) << "\r\n";
}

template <class Loop>
[[gnu::noinline]] void print_status(stm32::Console& out, const baked::Node& node, const Loop& loop,
                                    stm32::NucleoBoard& board) {
  out << name(node.supervisor().state()) << ", fault " << name(node.supervisor().fault()) << ", enable "
      << (board.enable().closed() ? "closed" : "open") << (board.bus().off() ? ", off the bus" : "")
      << ", late " << loop.late() << ", overruns " << board.bus().overruns() << ", withdrawn "
      << board.bus().withdrawn() << ", bus errors ";
  out.hex(board.bus().error_counters()) << "\r\n";
}

[[gnu::noinline]] void print_store(stm32::Console& out, const link::StoreStatus& s) {
  out << "parameters: " << name(s.state) << ", at start ";
  if (s.used == 0) {
    out << "baked";
  } else {
    out << "slot " << s.used;
  }
  out << "; slot 1 " << name(s.slots[0]) << ", slot 2 " << name(s.slots[1]) << ", sequence " << s.sequence
      << "\r\n";
}

/// While nothing runs and the outputs are low: prints the reason, waits for about a second, and resets.
[[noreturn]] void start_again(stm32::Console& out, stm32::StartFault why) {
  out << "start: " << name(why) << "\r\n";
  for (std::uint32_t n = 0; n < 3'000'000U || !out.idle(); ++n) out.pump();
  stm32::reg(0xE000'ED0CU) = 0x05FA'0004U;  // reset request
  for (;;) asm volatile("dsb");
}
}  // namespace

extern "C" [[noreturn]] void esmc_main() {
  static_assert(!baked::lockstep, "a board has its own time: bake with --realtime");
  static_assert(baked::armed_by_link,
                "a board is armed by a supervisor computer: command.arm = \"link\" in the scene");
  constexpr auto can_clock = stm32::Chip::can_clock_hz(baked::data_bitrate != 0);
  static_assert(hal::fdcan::nominal_timing(can_clock, baked::bitrate, baked::data_bitrate != 0).exact(),
                "the CAN controller of this board has no such bus.bitrate");
  static_assert(baked::data_bitrate == 0 || hal::fdcan::data_timing(can_clock, baked::data_bitrate).exact(),
                "the CAN controller of this board has no such bus.data_bitrate");
  static_assert(baked::period_ns <= 100'000'000, "the watchdog of a board waits for half a second at most");
  static stm32::NucleoBoard board;
  if ((board.reset_cause() & stm32::Chip::watchdog_reset) != 0 && !crash_record.sealed()) {
    crash_record = {};  // it hung, or the core locked up: no exception told
    crash_record.seal();
  }
  print_start(board.console(), board.reset_cause());
  while (!board.console().idle()) board.console().pump();  // before its clock changes
  const stm32::StartFault fault = board.start();
  if (fault != stm32::StartFault::none) start_again(board.console(), fault);

  starts += 1U + stm32::Chip::random();
  static baked::Node node(baked::config(static_cast<std::uint8_t>(1U + starts % 255U)));
  constexpr std::uint32_t period_us = baked::period_ns / 1000U;
  constexpr std::uint32_t watchdog_us = period_us < 1000U ? 5000U : 5U * period_us;  // no longer stall lasts
  if (!board.join(baked::bitrate, baked::data_bitrate, node.filters(), watchdog_us))
    start_again(board.console(), stm32::StartFault::can);
  // An operation of the flash takes four seconds at most; one step of it per tick.
  constexpr auto store_ticks_max = static_cast<std::uint32_t>(8'000'000'000ULL / baked::period_ns);
  static link::ParameterSlots slots(board.slots(), node.link().parameters(), node.link().scene(),
                                    store_ticks_max);
  link::restore(node.link(), slots);
  keep_ticks(node);
  print_store(board.console(), slots.status());
  link::StoreState printed = slots.status().state;
  // After a crash it does not arm until a loss of power clears the record.
  const bool crashed = crash_record.sealed();
  if (!stm32::Chip::watchdog.start(watchdog_us)) start_again(board.console(), stm32::StartFault::watchdog);
  TimedLoop loop(node, board, baked::period_ns);
  std::uint32_t printed_us = board.now_us();
  for (;;) {
    if (crashed) node.command(Command::stop);
    if (loop.turn()) {
      link::serve(node.link(), slots);
      stm32::DamagedFlash::forget_corrected();
    }
    if (slots.status().state != printed) {
      printed = slots.status().state;
      print_store(board.console(), slots.status());
    }
    stm32::Chip::light.set(light_on(node.supervisor().state(), crashed, board.now_us() / 1000U));
    board.console().pump();
    if (board.now_us() - printed_us >= 1'000'000U) {
      printed_us += 1'000'000U;
      print_status(board.console(), node, loop, board);
    }
  }
}
