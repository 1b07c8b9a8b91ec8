#pragma once
/// Many runs of one scene, in memory: the cases of `esmc sweep` without its file.

#include <cstdint>
#include <span>
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
  // Of run_driven alone:
  std::span<const double> torque;  ///< [case][tick][motor], N m
  std::uint32_t ticks = 0, every = 0;
};
struct RolloutResult {
  std::vector<std::vector<SweepValue>> parameters;  ///< [parameter][case]
  std::vector<std::uint64_t> seeds;                 ///< with which `esmc sim` repeats a case
  std::vector<double> objectives;                   ///< case by case, NaN where it did not run
  std::vector<std::string> outcomes;                ///< per case: "ok", the fault, or why it has no figures
  std::size_t rows = 0, coordinates = 0;            ///< of run_driven
  std::vector<double> states;                       ///< [case][row][q, then qd]
};

/// Runs them: ranges by latin hypercube, every case as `esmc sim` would run it, to the same bits whatever the
/// number of threads. Throws InputError, and Interrupted after Ctrl-C.
RolloutResult run_rollout(const RolloutRequest& r);

/// The mechanisms of the cases under given torques, each held for a tick, without controller: q and qd of
/// final_state, at every `every`th tick from the start on and at the end. To the bits of PythonPlant::step.
RolloutResult run_driven(const RolloutRequest& r);

}  // namespace esmc::host
