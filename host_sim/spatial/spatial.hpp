#pragma once
/// `esmc spatial`: controller and plant in space.

#include "host_sim/record/run_options.hpp"

namespace esmc::host {

/// Runs `esmc spatial`. Returns the exit status: 0, or 1 after a fault. Throws InputError for wrong options.
int run_spatial(const RunOptions& o);

}  // namespace esmc::host
