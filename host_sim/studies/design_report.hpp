#pragma once
/// esmc design SCENE: robust gains from stated uncertainty, and what they promise.

#include <cstdint>

#include "host_sim/record/run_options.hpp"

namespace esmc::host {

struct DesignOptions {
  RunOptions run;
  bool workspace = false;      ///< as uncertainty.over = "workspace"
  std::uint64_t simulate = 0;  ///< plants out of the intervals that are simulated
};

/// 0: gains are given (and every simulated plant stayed in the band); 1: refused, or one did not.
int run_design(const DesignOptions& o);

}  // namespace esmc::host
