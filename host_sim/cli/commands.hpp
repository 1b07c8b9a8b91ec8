#pragma once
/// The subcommands of the program.

#include "host_sim/cli/program.hpp"

namespace esmc::host {

/// Adds every subcommand with its options. Parsing runs the one that is named; `program` must outlive that.
void add_commands(Program& program);

}  // namespace esmc::host
