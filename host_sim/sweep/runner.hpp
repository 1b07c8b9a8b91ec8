#pragma once
/// Runs cases of a sweep, one thread each.

#include <cstdint>
#include <string>
#include <vector>

#include "host_sim/sweep/cases.hpp"
#include "host_sim/sweep/journal.hpp"
#include "host_sim/sweep/lanes/cases.hpp"

namespace esmc::host {

/// How a case ended: these, or `outcome_fault` + the number of the fault.
inline constexpr std::uint32_t outcome_ok = 0, outcome_diverged = 1, outcome_impossible = 2,
                               outcome_inaccurate = 3, outcome_not_run = 4, outcome_fault = 16;
[[nodiscard]] std::string outcome_name(
    std::uint32_t
        outcome);  ///< "ok", "diverged", "impossible", "inaccurate", "not_run", or the name of the fault

/// Cases of a sweep that are done together.
using Package = std::vector<std::uint64_t>;

class CaseRunner {
 public:
  /// `spec`, the specification of `scenes` and `kernel` must outlive this; `scenes` is copied. `kernel`:
  /// several cases at once where it covers them, to the same bits; null: each alone.
  CaseRunner(const SweepSpec& spec, const CaseScenes& scenes, const LaneKernel* kernel);

  /// Runs the cases and appends them to `out`. False: Ctrl-C came in between, `out` is not complete.
  [[nodiscard]] bool run(const Package& package, std::vector<Finished>& out);

 private:
  [[nodiscard]] Finished finished(std::uint64_t index, std::uint32_t outcome, const Score& score) const;
  [[nodiscard]] bool run_alone(std::uint64_t index, std::vector<Finished>& out);
  /// The cases of a package that go together, until a kernel is full.
  void run_together(std::vector<LaneJob>& jobs, std::vector<Finished>& out);

  const SweepSpec* spec_;
  CaseScenes scenes_;
  const LaneKernel* kernel_;
  std::vector<std::vector<LaneJob>> groups_;  ///< of equal settings
  std::vector<LaneScore> scores_;
  std::shared_ptr<const ReferenceBundle<double>> bundle_;  ///< of the last case in a lane
  SharedTrack track_;
};

}  // namespace esmc::host
