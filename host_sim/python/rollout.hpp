#pragma once
/// Many runs of one scene, in memory: the cases of `esmc sweep` without its file.

#include <cstdint>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "host_sim/sweep/spec.hpp"

namespace esmc::host {

/// What a key goes through: a range that is sampled, or a value per case.
struct RolloutParameter {
  std::string key;  ///< as in [[vary]]
  std::variant<std::pair<double, double>, std::vector<SweepValue>> values;
};
struct RolloutRequest {
  std::string scene;
  std::vector<std::string> sets;
  std::vector<RolloutParameter> parameters;
  std::uint64_t cases = 1, seed = 1;
  int threads = 0;  ///< 0: all processors
  std::vector<Objective> objectives;
};
struct RolloutResult {
  std::vector<std::vector<SweepValue>> parameters;  ///< [parameter][case]
  std::vector<double> objectives;                   ///< case by case, NaN where it did not run
  std::vector<std::string> outcomes;                ///< per case: "ok", the fault, or why it has no figures
};

/// Runs them: ranges by latin hypercube, every case as `esmc sim` would run it, to the same bits whatever the
/// number of threads. Throws InputError, and Interrupted after Ctrl-C.
RolloutResult run_rollout(const RolloutRequest& r);

}  // namespace esmc::host
