#pragma once
/// `esmc design`: robust gains from stated uncertainty, and their guarantees.

#include <cstdint>

#include "host_sim/record/run_options.hpp"

namespace esmc::host {

struct DesignOptions {
  RunOptions run;
  bool workspace = false;      ///< as uncertainty.over = "workspace"
  std::uint64_t simulate = 0;  ///< number of plants from the intervals to simulate
};

/// Runs `esmc design`. Returns 0: gains are printed and every simulated plant stayed in the band; 1: refused,
/// or a plant did not.
int run_design(const DesignOptions& o);

}  // namespace esmc::host
