#include "host_sim/cli/export.hpp"

#include "host_sim/export/export.hpp"
#include "host_sim/record/output.hpp"

namespace esmc::host {

int run_export(const RunOptions& o, const std::string& format) {
  const Scene scene = read_scene(o.scene, o.sets);
  print_or_write(format == "urdf" ? urdf(scene) : mjcf(scene), o.out);
  return 0;
}

}  // namespace esmc::host
