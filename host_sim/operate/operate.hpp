#pragma once
/// `esmc operate`: a console for a running controller, over its command interface.

#include <string>
#include <vector>

namespace esmc::host {

struct OperateOptions {
  std::string bus;                 ///< as --bus elsewhere, or the name of an interface
  std::vector<std::string> words;  ///< [SCENE] [COMMAND ARGUMENT...]
  std::vector<std::string> sets;   ///< of the scene
  int bit_rate = 1'000'000;        ///< bit/s, for an slcan adapter without a scene
  bool json = false;
  std::string points{};  ///< file of taught points; "": beside the scene
  std::string mcap{};    ///< file; "": none
  bool page = false;     ///< serve the operator's page instead
  int port = 0;          ///< of the page; 0: one that is free
};

/// Names of the commands with their arguments and meanings, one per line.
std::string operate_commands_text();
/// Carries out the command, or with none those of standard input. Returns the exit status; throws InputError,
/// and RunError where the controller refuses or has a fault.
int run_operate(const OperateOptions& o);

}  // namespace esmc::host
