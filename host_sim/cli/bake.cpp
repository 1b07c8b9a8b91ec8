#include "host_sim/cli/bake.hpp"

#include "host_sim/check/check.hpp"
#include "host_sim/controller/bake.hpp"
#include "host_sim/loop/halves.hpp"
#include "host_sim/record/output.hpp"

namespace esmc::host {

int run_bake(const RunOptions& o) {
  Scene scene = read_loop_scene(o);
  const Pacing pacing = o.realtime ? Pacing::realtime : Pacing::lockstep;
  scene.hardware = o.realtime;
  require_confirmed(scene);
  if (armed_by_link(scene) && !o.realtime) {
    throw InputError(scene.control_where,
                     "command.arm = \"link\" needs --realtime: in lockstep nobody would arm the image");
  }
  if (const std::string why = refusal_of(scene); !why.empty()) {
    throw InputError("", o.scene + ": esmc check refuses it: " + why);
  }
  print_or_write(baked_header(scene, pacing, o.single_precision), o.out);
  return 0;
}

}  // namespace esmc::host
