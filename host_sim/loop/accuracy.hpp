#pragma once
/// simulation.accuracy: passes over a scene, each finer than the one before, until two agree to the stated
/// accuracy.

#include <functional>
#include <vector>

#include "host_sim/plant/inputs.hpp"
#include "host_sim/record/summary.hpp"
#include "host_sim/scene/scene.hpp"

namespace esmc::host {

/// Result of one run of a scene with its `resolution`.
struct Pass {
  std::vector<double> rows;  ///< q at ticks 0, stride, 2 stride, ...; the last row is the final state
  Effort effort;
  bool interrupted = false;

  /// Adds a row.
  template <class Values>
  void add(const Values& q) {
    rows.insert(rows.end(), q.begin(), q.end());
  }
};

/// Ticks between the rows of a pass: 1 for "trajectory", else more; rows guard against agreement by chance.
[[nodiscard]] std::uint32_t row_stride(const Scene& scene, std::uint32_t ticks);

/// Runs a scene. `recorded`: this may be the pass that counts, so it keeps statistics and log; the last such
/// pass is the accepted one. Throws Diverged.
using RunPass = std::function<Pass(const Scene& scene, bool recorded)>;

/// Repeats run() with finer resolution until two passes agree to simulation.accuracy; sets scene.method and
/// scene.resolution to those of the last pass. Throws RunError where the accuracy
/// cannot be met, with the reason. `width`: numbers per row.
AccuracyReport meet_accuracy(Scene& scene, std::size_t width, const RunPass& run);

}  // namespace esmc::host
