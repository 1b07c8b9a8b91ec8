#include "host_sim/record/run_page.hpp"

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <string_view>
#include <utility>

#include "host_sim/json_text.hpp"
#include "host_sim/report/workspace.hpp"
#include "host_sim/version.hpp"

namespace esmc::host {

extern const std::string_view report_template;  // report.html.in, embedded by embed.cmake

namespace {

using Json = nlohmann::ordered_json;

#ifdef __clang__
constexpr const char* compiler = "clang " __clang_version__;
#else
constexpr const char* compiler = "gcc " __VERSION__;
#endif

/// With as many digits as a picture needs; null where it is not finite.
Json rounded(double v, int digits) {
  if (std::abs(v) < 1e-300) return 0.0;  // out of the range of stod
  return std::isfinite(v) ? Json(std::stod(fmt::format("{:.{}g}", v, digits))) : Json(nullptr);
}
Json rounded(const std::vector<double>& values, int digits) {
  Json out = Json::array();
  for (const double v : values) out.push_back(rounded(v, digits));
  return out;
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
  const auto joints = s.motor_joints();
  for (std::size_t i = 0; s.closed_loop() && i < joints.size() && i < s.torque_limit.size(); ++i)
    motors.push_back({joints[i], s.torque_limit[i]});
  const WorkspaceMap map = s.type == MechanismType::five_bar
                               ? workspace_map(s.mechanism, s.working_mode, motors, nodes)
                               : workspace_map(s.arm(), s.working_mode[0], motors, nodes);
  return {{"x", {map.x0, map.x1}},          {"y", {map.y0, map.y1}},
          {"columns", map.columns},         {"rows", map.rows},
          {"force", rounded(map.force, 4)}, {"type2_sine", rounded(map.type2_sine, 4)},
          {"type1", paths_json(map.type1)}, {"type2", paths_json(map.type2)}};
}

Json histograms_json(const std::vector<NamedHistogram>& list) {
  Json out = Json::array();
  for (const auto& [title, note, h] : list) {
    if (h.total() == 0) continue;
    std::size_t first = 0, last = Histogram::bins;
    while (first < last && h.counts()[first] == 0) ++first;
    while (last > first && h.counts()[last - 1] == 0) --last;
    Json counts = Json::array(), edges = Json::array();
    for (std::size_t i = first; i < last; ++i) counts.push_back(h.counts()[i]);
    for (std::size_t i = first; i <= last; ++i) edges.push_back(rounded(Histogram::edge(i), 6));
    out.push_back({{"title", title},
                   {"note", note},
                   {"edges_s", std::move(edges)},
                   {"counts", std::move(counts)},
                   {"total", h.total()},
                   {"mean_s", h.mean()},
                   {"p99_s", h.quantile(0.99)},
                   {"max_s", h.largest()}});
  }
  return out;
}

/// Share of the bus time that frames took, in bins of equally many ticks.
Json load_json(const RunEnd& end, double tick, int bitrate) {
  const std::vector<double>& bins = end.load.bins();
  if (bins.empty() || bitrate <= 0) return nullptr;
  Json values = Json::array();
  const auto stride = static_cast<double>(end.load.stride());
  for (std::size_t i = 0; i < bins.size(); ++i) {
    const double ticks = i + 1 == bins.size() ? static_cast<double>(end.load.last_ticks()) : stride;
    values.push_back(rounded(bins[i] / (ticks * tick * bitrate), 4));
  }
  return {{"start_s", -static_cast<double>(end.load_ticks) * tick},
          {"bin_s", stride * tick},
          {"load", std::move(values)}};
}

/// Ten digits show an error of 1e-9 on an angle; all seventeen would double the file.
Json rows_json(const std::vector<SeriesRow>& list) {
  Json rows = Json::array();
  for (const SeriesRow& r : list) {
    Json row = rounded(r.values, 10);
    if (!r.state.empty()) row.push_back(r.state);
    row.push_back(rounded(r.chatter, 4));
    rows.push_back(std::move(row));
  }
  return rows;
}

constexpr std::string_view data_mark = "/*ESMC_DATA*/";

/// JSON text that an HTML parser cannot mistake for markup. In JSON `<` occurs only inside strings, where
/// \u003c means the same; without it there is neither `</script>` nor `<!--`.
std::string json_for_html(const Json& data) {
  const std::string plain = json_text(data);
  std::string safe;
  safe.reserve(plain.size() + 64);
  for (const char c : plain) c == '<' ? safe.append("\\u003c") : safe.append(1, c);
  return safe;
}

}  // namespace

std::string run_page(const RunOptions& o, const Scene& scene, const Json& summary, const RunEnd& end,
                     const Log& log) {
  std::vector<NamedHistogram> histograms = end.histograms;
  histograms.push_back({"Tick time",
                        end.late_ticks ? "wall clock, from one tick to the next"
                                       : "wall clock, a tick with all its simulation and its row of the log",
                        log.tick_time()});
  Json data{{"kind", summary["run"]["command"]},
            {"command", o.command_line},
            {"version", version},
            {"compiler", compiler},
            {"scene_toml", scene.toml},
            {"summary", summary},
            {"torque_limit", scene.closed_loop() ? scene.torque_limit : std::vector<double>{}},
            {"assembly_mode", scene.assembly_mode}};
  for (const Surface& s : end.surfaces)
    data["surfaces"]["s_" + s.channel] = {{"lambda", s.lambda}, {"layer", s.layer}};
  data["mechanism"] = mechanism_json(scene.mechanism, scene.type == MechanismType::five_bar);
  data["working_mode"] = scene.working_mode;
  data["workspace"] = workspace_json(scene);
  data["histograms"] = histograms_json(histograms);
  data["bus_load"] = load_json(end, scene.tick(), scene.bitrate);
  data["columns"] = log.columns();
  data["columns"].push_back("chatter");
  data["rows"] = rows_json(log.thinned());
  data["spectrum"] = {{"step_hz", scene.rate_hz / Spectrum::segment}, {"amplitudes", Json::array()}};
  for (const Spectrum& s : log.spectra())
    data["spectrum"]["amplitudes"].push_back(rounded(s.amplitudes(), 4));
  // report.html.in draws everything itself when it is opened.
  const std::size_t at = report_template.find(data_mark);
  return fmt::format("{}{}{}", report_template.substr(0, at), json_for_html(data),
                     report_template.substr(at + data_mark.size()));
}

}  // namespace esmc::host
