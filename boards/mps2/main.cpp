/// The image of the emulated boards, in lockstep with `esmc plant`. It arms by itself at power-up, except
/// after a crash and where the scene leaves that to a supervisor computer.

#include "boards/capture.hpp"
#include "boards/cortex_m/crash.hpp"
#include "boards/mps2/board.hpp"
#include "scene.hpp"

extern "C" [[noreturn]] void esmc_main() {
  using namespace esmc;
  static_assert(baked::lockstep, "an emulator has no time of its own: bake without --realtime");
  static_assert(baked::data_bitrate == 0, "slcan carries no CAN FD");
  static Mps2Board board;
  static baked::Node node(baked::config(1));
  keep_ticks(node);
  // After a crash it stays disabled; the record remains in memory for a debugger.
  if (!baked::armed_by_link && !crash_record.sealed()) node.command(Command::enable);
  LockstepLoop loop(node, board);
  for (;;) loop.turn();
}
