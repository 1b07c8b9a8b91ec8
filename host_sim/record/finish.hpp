#pragma once
/// The end of every run command: files into --out, the summary to the terminal, the exit status.

#include <cstdio>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "host_sim/bus/frame_log.hpp"
#include "host_sim/record/log.hpp"
#include "host_sim/record/output.hpp"
#include "host_sim/record/run_options.hpp"
#include "host_sim/record/summary.hpp"

namespace esmc::host {

/// The directory that a run writes to, or the recording that it is compared with.
inline OutputDirectory output_of(const RunOptions& o) {
  return o.again.comparison != nullptr ? OutputDirectory(*o.again.comparison) : OutputDirectory(o.out);
}

/// Files of a run on a bus, open from its beginning.
struct BusRunFiles {
  /// `passages`: frames.csv as well, for the replay of one end.
  BusRunFiles(const RunOptions& o, const Scene& scene, const std::string& interface, bool passages = false)
      : out(output_of(o)),
        frames(out.open("frames.log"), interface, static_cast<std::uint32_t>(scene.bitrate),
               passages ? out.open("frames.csv") : nullptr),
        log(out.open("log.csv")) {}

  OutputDirectory out;
  FrameLog frames;
  std::FILE* log;  ///< for the recorder, which closes it
};

/// Writes the scene as run, and the files that it names, into `out`; no effect where no file is wanted.
void write_scene(const Scene& scene, const OutputDirectory& out);

/// Writes scene.toml, summary.json and report.html beside log.csv and frames.log, and prints the summary.
/// Throws Diverged where the final state is not finite. Returns the exit status: 1 after a fault. A replay
/// compares the summary, writes nothing and returns 0.
int finish_run(const RunOptions& o, const Scene& scene, const char* kind, const Statistics& statistics,
               const RunEnd& end, Log& log, OutputDirectory& out);
template <class Recorder>
int finish_run(const RunOptions& o, const Scene& scene, const char* kind, Recorder& recorder,
               const RunEnd& end, BusRunFiles& files) {
  files.frames.close();
  return finish_run(o, scene, kind, recorder.statistics(), end, recorder.log(), files.out);
}

/// The last step of every run: writes `summary` to summary.json, moves all files into place, and prints it
/// with --json, else `text`. Returns the exit status: 1 where `fault`.
int publish_summary(const RunOptions& o, const nlohmann::ordered_json& summary, const std::string& text,
                    bool fault, OutputDirectory& out);

}  // namespace esmc::host
