#pragma once
#include <optional>
#include <string>

namespace esmc::host {

struct CalibrateOptions {
  std::string log;       ///< a run's directory, or a log.csv
  std::string scene;     ///< empty: scene.toml beside the log
  std::string effector;  ///< CSV t,x,y; empty: none
  std::string write;     ///< scene file to write; empty: none
  std::string out, command_line;
  std::optional<double> half_base;     ///< m, exact
  bool trust_half_base = false;        ///< the scene's is exact
  bool free_frame = false;             ///< effector readings in a frame of their own
  double effector_sigma = 1e-4;        ///< m
  double observer_bandwidth = 1000.0;  ///< rad/s; 0: angles are not late
  double within = 0.2;        ///< relative distance from a nominal length that is still the same mechanism
  bool keep_nominal = false;  ///< of what the log does not determine, instead of refusing
  bool json = false;
};

/// `esmc calibrate`: lengths and encoder offsets of the mechanism that a log is of, with their uncertainty.
/// Throws InputError for logs that do not determine them. Returns 0.
int run_calibrate(const CalibrateOptions& o);

}  // namespace esmc::host
