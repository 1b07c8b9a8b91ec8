#pragma once
#include <string>

#include "host_sim/record/run_options.hpp"
#include "host_sim/scene/scene.hpp"

namespace esmc::host {

/// `esmc check`: what can be said about a scene without running it. Returns 1 when it would not run through.
int run_check(const RunOptions& o);
/// Why a scene would not run through on a bus, in the words of `esmc check`; empty: it would.
std::string refusal_of(const Scene& scene);

}  // namespace esmc::host
