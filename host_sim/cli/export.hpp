#pragma once
#include <string>

#include "host_sim/record/run_options.hpp"

namespace esmc::host {

/// `esmc export`: the scene's mechanism as "mjcf" or "urdf", printed or written to o.out (a file).
int run_export(const RunOptions& o, const std::string& format);

}  // namespace esmc::host
