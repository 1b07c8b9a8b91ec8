#pragma once

namespace esmc::host {

struct Program;

/// Adds every subcommand with its options. Parsing runs the one that is named; `program` must outlive that.
void add_commands(Program& program);

}  // namespace esmc::host
