#include "host_sim/commands/finish.hpp"

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "host_sim/report/report.hpp"
#include "host_sim/version.hpp"

namespace esmc::host {

using Json = nlohmann::ordered_json;

namespace {
Json mechanism_json(const Scene& s) {
  Json m;
  const bool five_bar = s.type == MechanismType::five_bar;
  m["type"] = five_bar ? "five_bar" : "rr";
  m["half_base"] = five_bar ? Json(s.mechanism.l0) : Json(nullptr);
  m["legs"] = Json::array();
  for (std::size_t j = 0; j < (five_bar ? 2U : 1U); ++j) {
    m["legs"].push_back({{"l1", s.mechanism.legs[j].l1}, {"l2", s.mechanism.legs[j].l2}});
  }
  return m;
}

/// Ten digits show an error of 1e-9 on an angle; all seventeen would double the file.
Json rows_json(const Log& log) {
  Json rows = Json::array();
  for (const Log::Row& r : log.thinned()) {
    Json row = Json::array();
    for (const double v : r.values)
      row.push_back(std::isfinite(v) ? Json(std::stod(fmt::format("{:.10g}", v))) : Json(nullptr));
    if (!r.state.empty()) row.push_back(r.state);
    rows.push_back(std::move(row));
  }
  return rows;
}
}  // namespace

void write_scene(const Scene& scene, const OutputDirectory& out) {
  out.write("scene.toml", scene.toml);
  if (!scene.reference.csv.empty()) out.write(reference_copy, scene.reference.csv);
}

int finish_run(const RunOptions& o, const Scene& scene, const char* kind, const Statistics& statistics,
               const RunEnd& end, Log& log, OutputDirectory& out) {
  log.close();
  const double t = static_cast<double>(statistics.ticks()) * scene.tick();
  require_finite(end.q, t);
  require_finite(end.qd, t);
  const Json summary = make_summary(scene, statistics, end);
  if (out.wanted()) {
    write_scene(scene, out);
    out.write("summary.json", summary.dump(2) + "\n");
    Json data;
    data["kind"] = kind;
    data["command"] = o.command_line;
    data["version"] = version;
    data["scene_toml"] = scene.toml;
    data["summary"] = summary;
    data["concerns"] = concerns(summary);
    data["torque_limit"] = scene.closed_loop() ? scene.torque_limit : std::vector<double>{};
    data["mechanism"] = mechanism_json(scene);
    data["columns"] = log.columns();
    data["rows"] = rows_json(log);
    out.write("report.html", render_report(data));
    out.commit();
  }
  if (o.json) {
    fmt::print("{}\n", summary.dump(2));
  } else {
    fmt::print("{}", summary_text(summary));
    if (out.wanted()) fmt::print("report: {}/report.html\n", out.directory());
  }
  return summary["supervisor"]["faults"].empty() ? 0 : 1;
}

}  // namespace esmc::host
