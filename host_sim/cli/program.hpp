#pragma once
/// The running program as its subcommands see it.

#include <string>

namespace CLI {
class App;
}

namespace esmc::host {

struct Program {
  CLI::App& app;
  std::string command_line;  ///< for reports
  int status = 0;            ///< exit status of the command that ran
};

}  // namespace esmc::host
