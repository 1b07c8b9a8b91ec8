#pragma once
#include <string>

#include "host_sim/record/run_options.hpp"
#include "host_sim/scene/scene.hpp"

namespace esmc::host {

/// `esmc check`: findings about a scene without running it. Exit status 1: it would not run to its end.
int run_check(const RunOptions& o);
/// The first error of `esmc check`, or why a bus cannot run the scene; empty: neither.
std::string refusal_of(const Scene& scene);

}  // namespace esmc::host
