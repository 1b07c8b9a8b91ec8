#pragma once
#include <string>

#include "host_sim/commands/run.hpp"

namespace esmc::host {

/// `esmc bake`: a scene as constants of a board's image, printed or written to o.out (a file). A scene that `esmc check`
/// refuses, or that a bus cannot run, is refused. `pacing`: what the image's loop waits for.
int run_bake(const RunOptions& o);

}  // namespace esmc::host
