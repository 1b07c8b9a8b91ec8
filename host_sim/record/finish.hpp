#pragma once
/// The end of every run command: files into --out, the summary to the terminal, the exit status.

#include <memory>
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

/// The MCAP file of a run, open; null: none is wanted. Throws InputError, also for options of a log that is
/// not written, or a file that the scene was read from.
std::unique_ptr<RunMcap> mcap_of(const RunOptions& o, const Scene& scene);
/// The log of a run, open.
inline LogSink log_of(const RunOptions& o, const OutputDirectory& out, RunMcap* mcap) {
  return {out.open(o.log.npy ? "log.npy" : "log.csv"), o.log, mcap};
}

/// Files of a run on a bus, open from its beginning.
struct BusRunFiles {
  /// `passages`: frames.csv as well, for the replay of one end.
  BusRunFiles(const RunOptions& o, const Scene& scene, const std::string& interface, bool passages = false)
      : out(output_of(o)),
        mcap(mcap_of(o, scene)),
        frames(out.open("frames.log"), interface, static_cast<std::uint32_t>(scene.bitrate), scene.fast_bit(),
               passages ? out.open("frames.csv") : nullptr),
        log(log_of(o, out, mcap.get())) {
    if (mcap) frames.also([to = mcap.get()](std::int64_t t, const hal::CanFrame& f) { to->frame(t, f); });
  }

  OutputDirectory out;
  std::unique_ptr<RunMcap> mcap;
  FrameLog frames;
  LogSink log;  ///< for the recorder, which closes it
};

/// Writes the scene as run, and the files that it names, into `out`; no effect where no file is wanted.
void write_scene(const Scene& scene, const OutputDirectory& out);

/// Writes scene.toml, summary.json and report.html beside log.csv and frames.log, and prints the summary.
/// Throws Diverged where the final state is not finite. Returns the exit status: 1 after a fault. A replay
/// compares the summary, writes nothing and returns 0. `mcap`: completed as well; may be null.
int finish_run(const RunOptions& o, const Scene& scene, const char* kind, const Statistics& statistics,
               const RunEnd& end, Log& log, OutputDirectory& out, RunMcap* mcap);
template <class Recorder>
int finish_run(const RunOptions& o, const Scene& scene, const char* kind, Recorder& recorder,
               const RunEnd& end, BusRunFiles& files) {
  files.frames.close();
  return finish_run(o, scene, kind, recorder.statistics(), end, recorder.log(), files.out, files.mcap.get());
}

/// The last step of every run: writes `summary` to summary.json, moves all files into place, and prints it
/// with --json, else `text`. Returns the exit status: 1 where `fault`.
int publish_summary(const RunOptions& o, const nlohmann::ordered_json& summary, const std::string& text,
                    bool fault, OutputDirectory& out);

}  // namespace esmc::host
