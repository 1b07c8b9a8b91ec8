#pragma once
#include "host_sim/commands/run.hpp"

namespace esmc::host {

/// `esmc check`: what can be said about a scene without running it. Returns 1 when it would not run through.
int run_check(const RunOptions& o);

}  // namespace esmc::host
