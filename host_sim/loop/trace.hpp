#pragma once
/// A closed loop run for a study: no files, no summary, every effector position kept.

#include <vector>

#include "host_sim/plant/plant.hpp"
#include "host_sim/record/summary.hpp"
#include "host_sim/scene/scene.hpp"

namespace esmc::host {

struct Trace {
  Statistics statistics;
  RunEnd end;
  std::vector<V2> effector;     ///< m, true position at every tick of a closed loop
  bool reference_left = false;  ///< the reference has left the reach of the true mechanism
};

/// Runs a scene as `esmc sim` does. `single_precision`: the controller computes in float.
Trace trace(const Scene& scene, bool single_precision = false);

/// Runs a case of a sweep, without path, digest and, unless wanted, base_errors. Throws InputError where the
/// reference leaves the reach of the true mechanism; a state that is not finite shows in end.q.
Trace run_case(const Scene& scene, bool base_errors);

}  // namespace esmc::host
