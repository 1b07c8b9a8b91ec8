#pragma once
/// The end of every run command: files into --out, the summary to the terminal, the exit status.

#include "host_sim/record/log.hpp"
#include "host_sim/record/output.hpp"
#include "host_sim/record/run_options.hpp"
#include "host_sim/record/summary.hpp"

namespace esmc::host {

/// Where a run writes, or is compared.
inline OutputDirectory output_of(const RunOptions& o) {
  return o.again.comparison != nullptr ? OutputDirectory(*o.again.comparison) : OutputDirectory(o.out);
}

/// The scene as run, and the file of its reference if it has one.
void write_scene(const Scene& scene, const OutputDirectory& out);

/// Writes scene.toml, summary.json, report.html (log.csv and frames.log are already there), prints the
/// summary. Returns 1 when the run ended in a fault.
int finish_run(const RunOptions& o, const Scene& scene, const char* kind, const Statistics& statistics,
               const RunEnd& end, Log& log, OutputDirectory& out);

}  // namespace esmc::host
