#include "host_sim/record/finish.hpp"

#include <fmt/format.h>

#include <filesystem>
#include <nlohmann/json.hpp>

#include "host_sim/error.hpp"
#include "host_sim/record/comparison.hpp"
#include "host_sim/record/recording.hpp"
#include "host_sim/record/run_page.hpp"
#include "host_sim/record/verdict.hpp"
#include "host_sim/scene/edit.hpp"
#include "host_sim/version.hpp"

namespace esmc::host {

using Json = nlohmann::ordered_json;

void write_scene(const Scene& scene, const OutputDirectory& out) {
  out.write("scene.toml", scene.toml);
  for (const Companion& c : scene.companions) {
    out.spare(c.source, c.name);
    out.write(c.name, c.text);
  }
}

std::unique_ptr<RunMcap> mcap_of(const RunOptions& o, const Scene& scene) {
  if (o.out.empty() && o.capture == nullptr && (o.log.npy || (o.log.every != 1 && o.mcap.empty())))
    throw InputError("", "--log and --log-every are of the log that --out DIR leaves, and there is no --out");
  refuse_overwrite("--mcap", o.mcap, files_of(scene));
  if (!o.out.empty() && !o.mcap.empty()) {
    const std::filesystem::path file = std::filesystem::absolute(o.mcap).lexically_normal();
    const auto out = std::filesystem::absolute(o.out) / "";
    if (is_output_name(file.filename().string()) && file.parent_path() / "" == out.lexically_normal())
      throw InputError("",
                       fmt::format("--mcap {}: the run itself leaves a file of that name in --out", o.mcap));
  }
  return o.mcap.empty() ? nullptr : std::make_unique<RunMcap>(o.mcap);
}

int finish_run(const RunOptions& o, const Scene& scene, const char* kind, const Statistics& statistics,
               const RunEnd& end, Log& log, OutputDirectory& out, RunMcap* mcap) {
  log.close();
  const double t = static_cast<double>(statistics.ticks()) * scene.tick();
  require_finite(end.q, t);
  require_finite(end.qd, t);
  Json summary = make_summary(scene, statistics, end);
  if (o.again.comparison != nullptr) {
    o.again.comparison->summary(summary, *o.again.recorded);
    return 0;
  }
  summary["run"] = {{"command", kind},
                    {"realtime", o.realtime},
                    {"scalar", o.single_precision ? "float" : "double"},
                    {"version", version},
                    {"scene_digest", scene_digest(scene)}};
  if (o.log.npy || o.log.every != 1)
    summary["run"]["log"] = {{"format", o.log.npy ? "npy" : "csv"}, {"every", o.log.every}};
  if (mcap != nullptr) mcap->commit();
  std::string text = summary_text(summary);
  if (out.wanted()) {
    write_scene(scene, out);
    text += fmt::format("report: {}/report.html\n", out.directory());
    out.write("report.html", run_page(o, scene, summary, end, log));
  }
  const int status =
      publish_summary(o, summary, text + verdict_line(summary) + "\n", !end.faults.empty(), out);
  return status == 0 && end.interrupted ? exit_interrupted : status;
}

int publish_summary(const RunOptions& o, const Json& summary, const std::string& text, bool fault,
                    OutputDirectory& out) {
  const std::string document = document_text(summary);
  if (o.capture != nullptr) {
    o.capture->document = document;
    return fault ? 1 : 0;
  }
  out.write("summary.json", document);
  out.commit();
  fmt::print("{}", o.json ? document : text);
  return fault ? 1 : 0;
}

}  // namespace esmc::host
