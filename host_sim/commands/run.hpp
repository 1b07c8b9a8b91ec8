#pragma once
/// The run commands: sim, hil, plant, controller.

#include <atomic>
#include <cstdint>
#include <string>
#include <vector>

namespace esmc::host {

struct RunOptions {
  std::string scene;
  std::vector<std::string> sets;
  std::string out;
  std::string bus = "virtual";
  std::string command_line;
  std::uint64_t seed = 1;
  bool json = false;
  bool realtime = false;
  bool observe = false;  ///< controller only: listen, arm nothing, send nothing
  bool single_precision = false;  ///< of the controller, as on a board without double; hil only
};

/// Set by SIGINT and SIGTERM: loops end with zero torque and a summary.
std::atomic<bool>& stop_requested();

// Each returns the exit status: 0, or 1 for a run that ended in a fault.
int run_sim(const RunOptions& o);
int run_hil(const RunOptions& o);
int run_plant(const RunOptions& o);
int run_controller(const RunOptions& o);

}  // namespace esmc::host
