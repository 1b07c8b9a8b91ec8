#pragma once
/// esmc sweep SPEC: parameter, gain and uncertainty studies.

#include <string>

namespace esmc::host {

struct Capture;

struct SweepOptions {
  std::string spec, out, command_line;
  int jobs = 0;  ///< threads of this process; 0: all processors, under mpirun one
  bool json = false;
  bool restart = false;        ///< discards an unfinished sweep in --out
  bool scalar = false;         ///< no SIMD lanes: every case alone, with the same result
  Capture* capture = nullptr;  ///< takes the document, and nothing is printed
};

/// Runs `esmc sweep`. Returns the exit status: 0, or 1 for a sweep that was interrupted.
int run_sweep(const SweepOptions& o);

}  // namespace esmc::host
