#include "host_sim/cli/bake.hpp"

#include <algorithm>
#include <string_view>

#include "host_sim/check/check.hpp"
#include "host_sim/controller/axes_config.hpp"
#include "host_sim/controller/bake.hpp"
#include "host_sim/controller/board_costs.hpp"
#include "host_sim/error.hpp"
#include "host_sim/loop/loop_scene.hpp"
#include "host_sim/record/output.hpp"

namespace esmc::host {
namespace {

void require_budget(const Scene& scene, const BakeOptions& o) {
  const Board* board = std::ranges::find(boards, o.board, [](const Board& b) { return std::string(b.name); });
  if (board->single_precision != o.run.single_precision) {
    throw InputError("", o.board + " needs --scalar " + (board->single_precision ? "float" : "double"));
  }
  if (const std::string excess = budget_excess(scene, *board); !excess.empty())
    throw InputError(scene.control_where, excess);
}

}  // namespace

int run_bake(const BakeOptions& o) {
  Scene scene = read_loop_scene(o.run);
  const Pacing pacing = o.run.realtime ? Pacing::realtime : Pacing::lockstep;
  scene.hardware = o.run.realtime;
  require_confirmed(scene);
  if (armed_by_link(scene) && !o.run.realtime) {
    throw InputError(scene.control_where,
                     "command.arm = \"link\" needs --realtime: in lockstep no console arms the image");
  }
  if (!o.board.empty()) require_budget(scene, o);
  if (const std::string why = refusal_of(scene); !why.empty()) {
    throw InputError("", o.run.scene + ": esmc check refuses it: " + why);
  }
  print_or_write(baked_header(scene, pacing, o.run.single_precision), o.run.out);
  return 0;
}

}  // namespace esmc::host
