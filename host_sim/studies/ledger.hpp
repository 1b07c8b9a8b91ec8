#pragma once
/// What a run costs, counted: right-hand sides and ticks, each with its instructions in the ledgers of
/// docs/effects.md and docs/performance.md. Unlike time it is the same on every machine and in every run.

#include "host_sim/scene/scene.hpp"

namespace esmc::host {

/// Instructions of a run of `scene` with its method and step, those of docs/accuracy.md: x86-64, gcc 12, -O3.
/// What several effects add is summed; the steps that the jump of a load splits off are not counted.
[[nodiscard]] double counted_cost(const Scene& scene);

/// The method that steps the scene: its own, or moreau_jean where set-valued effects need it.
[[nodiscard]] Method method_in_use(const Scene& scene);

}  // namespace esmc::host
