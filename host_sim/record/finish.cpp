#include "host_sim/record/finish.hpp"

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "host_sim/record/comparison.hpp"
#include "host_sim/record/recording.hpp"
#include "host_sim/report/report.hpp"
#include "host_sim/report/workspace.hpp"
#include "host_sim/version.hpp"

namespace esmc::host {

using Json = nlohmann::ordered_json;

namespace {
#ifdef __clang__
constexpr const char* compiler = "clang " __clang_version__;
#else
constexpr const char* compiler = "gcc " __VERSION__;
#endif

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

/// A number with so many digits as a picture needs; a gap where there is none.
Json rounded(double v, int digits) {
  if (std::abs(v) < 1e-300) return 0.0;  // what stod refuses
  return std::isfinite(v) ? Json(std::stod(fmt::format("{:.{}g}", v, digits))) : Json(nullptr);
}

Json paths_json(const std::vector<WorkspaceMap::Path>& paths) {
  Json out = Json::array();
  for (const WorkspaceMap::Path& path : paths) {
    Json points = Json::array();
    for (const V2 p : path) points.push_back({rounded(p.x, 5), rounded(p.y, 5)});
    out.push_back(std::move(points));
  }
  return out;
}

/// Of the true mechanism, in the working mode of the scene.
Json workspace_json(const Scene& s) {
  constexpr int nodes = 81;
  std::vector<MotorLimit> motors;
  if (s.closed_loop()) {
    const auto joints = s.motor_joints();
    for (std::size_t i = 0; i < joints.size() && i < s.torque_limit.size(); ++i)
      motors.push_back({joints[i], s.torque_limit[i]});
  }
  const WorkspaceMap map = s.type == MechanismType::five_bar
                               ? workspace_map(s.mechanism, s.working_mode, motors, nodes)
                               : workspace_map(s.arm(), s.working_mode[0], motors, nodes);
  const auto field = [](const std::vector<double>& values) {
    Json out = Json::array();
    for (const double v : values) out.push_back(rounded(v, 4));
    return out;
  };
  return {{"x", {map.x0, map.x1}},          {"y", {map.y0, map.y1}},
          {"columns", map.columns},         {"rows", map.rows},
          {"force", field(map.force)},      {"type2_sine", field(map.type2_sine)},
          {"type1", paths_json(map.type1)}, {"type2", paths_json(map.type2)}};
}

Json histogram_json(const NamedHistogram& named) {
  const Histogram& h = named.histogram;
  std::size_t first = 0, last = Histogram::bins;
  while (first < last && h.counts()[first] == 0) ++first;
  while (last > first && h.counts()[last - 1] == 0) --last;
  Json counts = Json::array(), edges = Json::array();
  for (std::size_t i = first; i < last; ++i) counts.push_back(h.counts()[i]);
  for (std::size_t i = first; i <= last; ++i) edges.push_back(rounded(Histogram::edge(i), 6));
  return {{"title", named.title},        {"note", named.note},  {"edges_s", std::move(edges)},
          {"counts", std::move(counts)}, {"total", h.total()},  {"mean_s", h.mean()},
          {"p99_s", h.quantile(0.99)},   {"max_s", h.largest()}};
}

Json histograms_json(const RunEnd& end, const Log& log) {
  Json out = Json::array();
  for (const NamedHistogram& h : end.histograms)
    if (h.histogram.total() > 0) out.push_back(histogram_json(h));
  if (log.tick_time().total() > 0) {
    const char* what = end.late_ticks ? "wall clock, from one tick to the next"
                                      : "wall clock, a tick with all its simulation and its row of the log";
    out.push_back(histogram_json({"Tick time", what, log.tick_time()}));
  }
  return out;
}

/// Share of the bus time that frames took, in bins of equally many ticks.
Json load_json(const Scene& s, const RunEnd& end) {
  if (end.load.bins().empty() || s.bitrate <= 0) return nullptr;
  Json values = Json::array();
  const auto stride = static_cast<double>(end.load.stride());
  for (std::size_t i = 0; i < end.load.bins().size(); ++i) {
    const bool last = i + 1 == end.load.bins().size();
    const double ticks = last ? static_cast<double>(end.load.last_ticks()) : stride;
    values.push_back(rounded(end.load.bins()[i] / (ticks * s.tick() * s.bitrate), 4));
  }
  return {{"start_s", -static_cast<double>(end.load_ticks) * s.tick()},
          {"bin_s", stride * s.tick()},
          {"load", std::move(values)}};
}

/// Ten digits show an error of 1e-9 on an angle; all seventeen would double the file.
Json rows_json(const Log& log) {
  Json rows = Json::array();
  for (const Log::Row& r : log.thinned()) {
    Json row = Json::array();
    for (const double v : r.values) row.push_back(rounded(v, 10));
    if (!r.state.empty()) row.push_back(r.state);
    row.push_back(rounded(r.chatter, 4));
    rows.push_back(std::move(row));
  }
  return rows;
}
}  // namespace

void write_scene(const Scene& scene, const OutputDirectory& out) {
  out.write("scene.toml", scene.toml);
  for (const Companion& c : scene.companions) {
    out.spare(c.source, c.name);
    out.write(c.name, c.text);
  }
}

int finish_run(const RunOptions& o, const Scene& scene, const char* kind, const Statistics& statistics,
               const RunEnd& end, Log& log, OutputDirectory& out) {
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
  if (out.wanted()) {
    write_scene(scene, out);
    out.write("summary.json", summary.dump(2) + "\n");
    Json data;
    data["kind"] = kind;
    data["command"] = o.command_line;
    data["version"] = version;
    data["compiler"] = compiler;
    data["scene_toml"] = scene.toml;
    data["summary"] = summary;
    data["concerns"] = concerns(summary);
    data["torque_limit"] = scene.closed_loop() ? scene.torque_limit : std::vector<double>{};
    data["mechanism"] = mechanism_json(scene);
    data["working_mode"] = scene.working_mode;
    data["assembly_mode"] = scene.assembly_mode;
    data["workspace"] = workspace_json(scene);
    data["histograms"] = histograms_json(end, log);
    data["bus_load"] = load_json(scene, end);
    data["columns"] = log.columns();
    data["columns"].push_back("chatter");
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
