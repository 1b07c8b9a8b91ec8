#pragma once
#include <string>

namespace esmc::host {

struct IdentifyOptions {
  std::string log;    ///< a run's directory, or a log.csv
  std::string scene;  ///< empty: scene.toml beside the log
  std::string write;  ///< scene file to write; empty: none
  std::string out, command_line;
  double window = 0.1;                 ///< s
  double observer_bandwidth = 1000.0;  ///< rad/s; 0: angles are not late
  double coverage = 3.0;               ///< half width of the intervals in standard uncertainties
  bool json = false;
};

/// `esmc identify`: base inertial parameters, friction and torque delay of the mechanism that a log is of,
/// with intervals. Throws InputError for logs that do not determine them. Returns 0.
int run_identify(const IdentifyOptions& o);

}  // namespace esmc::host
