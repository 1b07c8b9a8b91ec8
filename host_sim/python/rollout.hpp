#pragma once
/// Many runs of one scene, in memory: the cases of `esmc sweep` without its file.

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "host_sim/sweep/spec.hpp"

namespace esmc::host {

/// Torques of driven cases.
struct GivenTorques {
  std::span<const double> torque{};  ///< [case][tick][motor], N m
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

/// Runs the cases of `spec.design`, every case as `esmc sim` would run it, to the same bits whatever the
/// number of threads (0: all processors). Throws InputError, and Interrupted after Ctrl-C.
RolloutResult run_rollout(const SweepSpec& spec, int threads);

/// The mechanisms of the cases under given torques, each held for a tick, without controller: q and qd of
/// final_state, at every `every`th tick from the start on and at the end. To the bits of PythonPlant::step.
RolloutResult run_driven(const SweepSpec& spec, int threads, const GivenTorques& given);

}  // namespace esmc::host
