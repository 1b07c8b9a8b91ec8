#pragma once
/// The run commands.

#include "host_sim/record/run_options.hpp"

namespace esmc::host {

// Each returns the exit status: 0, or 1 for a run that ended in a fault.
int run_sim(const RunOptions& o);
int run_hil(const RunOptions& o);
int run_plant(const RunOptions& o);
int run_controller(const RunOptions& o);

}  // namespace esmc::host
