/// The image of the emulated Cortex-R5F, in lockstep with `esmc plant`. It arms by itself at power-up, except
/// after a crash or where it could not join the bus.

#include "boards/cortex_m/crash.hpp"
#include "boards/zcu102_rpu/board.hpp"
#include "scene.hpp"

extern "C" [[noreturn]] void esmc_main() {
  using namespace esmc;
  static_assert(baked::lockstep, "an emulator has no time of its own: bake without --realtime");
  static_assert(!baked::armed_by_link, "this image arms by itself");  // as bake refuses without --lockstep
  static_assert(baked::data_bitrate == 0, "its CAN controller knows no CAN FD");
  static Zcu102Board board;
  static baked::Node node(baked::config(1));
  const bool on_bus = board.start(baked::bitrate);
  // After a crash it stays disabled; the record remains in memory for a debugger.
  if (on_bus && !crash_record.sealed()) node.command(Command::enable);
  LockstepLoop loop(node, board);
  for (;;) loop.turn();
}
