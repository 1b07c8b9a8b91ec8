#pragma once

#include "host_sim/record/run_options.hpp"

namespace esmc::host {

/// `esmc bake`: a scene as constants of a board's image, printed or written to o.out (a file). A scene that
/// `esmc check` refuses, or that a bus cannot run, is refused.
int run_bake(const RunOptions& o);

}  // namespace esmc::host
