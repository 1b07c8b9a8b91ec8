#pragma once
/// What a run costs, counted: right-hand sides and ticks, each with its instructions in the ledgers of
/// docs/effects.md and docs/performance.md. Unlike time it is the same on every machine and in every run.

#include "host_sim/scene/scene.hpp"

namespace esmc::host {

/// Instructions of a run of `scene` with its method and step: those of x86-64, gcc 12, -O3. What several
/// effects add is summed; the steps that an instant of a load splits off are not counted.
[[nodiscard]] double counted_cost(const Scene& scene);

/// Whether effects of the scene need a method for set-valued ones, in place of the one that it names.
[[nodiscard]] Method method_in_use(const Scene& scene);

}  // namespace esmc::host
