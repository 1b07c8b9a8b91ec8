#include "host_sim/commands/finish.hpp"

#include <fmt/format.h>

#include <cstdio>

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
}  // namespace

int finish_run(const RunOptions& o, const Scene& scene, const char* kind, const Json& summary, Log& log,
               OutputDirectory& out) {
  log.close();
  if (out.wanted()) {
    out.write("scene.toml", scene.toml);
    out.write("summary.json", summary.dump(2) + "\n");
    Json data;
    data["kind"] = kind;
    data["command"] = o.command_line;
    data["version"] = version;
    data["scene_toml"] = scene.toml;
    data["summary"] = summary;
    data["mechanism"] = mechanism_json(scene);
    data["columns"] = log.columns();
    data["rows"] = log.thinned();
    out.write("report.html", render_report(data));
    out.commit();
  }
  if (o.json) {
    fmt::print("{}\n", summary.dump(2));
  } else {
    fmt::print("{}", summary_text(summary));
    if (out.wanted()) fmt::print("report: {}/report.html\n", out.directory());
  }
  std::fflush(stdout);
  return summary["supervisor"]["faults"].empty() ? 0 : 1;
}

}  // namespace esmc::host
