#pragma once

#include "host_sim/record/run_options.hpp"

namespace esmc::host {

struct BakeOptions {
  RunOptions run;
  std::string board;  ///< name in board_costs.hpp; empty: no budget is checked
};

/// `esmc bake`: a scene as constants of a board's image, printed or written to run.out (a file). Throws
/// InputError for a scene that `esmc check` refuses, that a bus cannot run, or that exceeds the budget of the
/// board.
int run_bake(const BakeOptions& o);

}  // namespace esmc::host
