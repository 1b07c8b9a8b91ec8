#pragma once
/// Samples of a live bench as rows, under the names that log.csv has for them.

#include <string>
#include <vector>

#include "host_sim/live/session.hpp"

namespace esmc::host {

/// Names of the columns, the state last.
std::vector<std::string> sample_columns(const Scene& scene);
/// Values of all columns but the state; NaN where there is none.
std::vector<double> sample_values(const LiveSample& s, const Scene& scene);

}  // namespace esmc::host
