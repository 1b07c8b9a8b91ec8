#pragma once
/// `esmc live`: the loop against the clock in this thread, its pages served in another.

#include <optional>

#include "host_sim/record/run_options.hpp"

namespace esmc::host {

struct LiveOptions {
  RunOptions run;
  int port = 0;                    ///< 0: one that is free
  std::optional<double> duration;  ///< s; none: until Ctrl-C
};

/// Prints the pages' address, runs until `duration` or Ctrl-C, prints a summary. Returns the exit status 0,
/// with faults too. Throws InputError or RunError.
int run_live(const LiveOptions& o);

}  // namespace esmc::host
