#include "host_sim/report/run_page.hpp"

#include <fmt/format.h>

#include <cmath>
#include <string_view>
#include <utility>

#include "host_sim/json_text.hpp"

namespace esmc::host {

extern const std::string_view report_template;  // report.html.in, embedded by embed.cmake

namespace {

using Json = nlohmann::ordered_json;

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

Json workspace_json(const PageMechanism& m) {
  constexpr int nodes = 81;
  const WorkspaceMap map =
      m.five_bar ? workspace_map(m.params, m.working_mode, m.motors, nodes)
                 : workspace_map({m.params.legs[0], m.params.g}, m.working_mode[0], m.motors, nodes);
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
Json load_json(const PageLoad& l) {
  const std::vector<double>& bins = l.bits.bins();
  if (bins.empty() || l.bitrate <= 0) return nullptr;
  Json values = Json::array();
  const auto stride = static_cast<double>(l.bits.stride());
  for (std::size_t i = 0; i < bins.size(); ++i) {
    const double ticks = i + 1 == bins.size() ? static_cast<double>(l.bits.last_ticks()) : stride;
    values.push_back(rounded(bins[i] / (ticks * l.tick * l.bitrate), 4));
  }
  return {{"start_s", -static_cast<double>(l.before) * l.tick},
          {"bin_s", stride * l.tick},
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

/// Puts the data into the page `report.html.in`, which draws everything itself when it is opened.
std::string render_report(const Json& data) {
  const std::size_t at = report_template.find(data_mark);
  std::string page(report_template.substr(0, at));
  page += json_for_html(data);
  page += report_template.substr(at + data_mark.size());
  return page;
}

}  // namespace

Json mechanism_json(const FiveBarParams<double>& m, bool five_bar) {
  Json legs = Json::array();
  for (std::size_t j = 0; j < (five_bar ? 2U : 1U); ++j)
    legs.push_back({{"l1", m.legs[j].l1}, {"l2", m.legs[j].l2}});
  return {{"type", five_bar ? "five_bar" : "rr"},
          {"half_base", five_bar ? Json(m.l0) : Json(nullptr)},
          {"legs", std::move(legs)}};
}

std::string run_page(RunPage page) {
  Json& data = page.data;
  data["mechanism"] = mechanism_json(page.mechanism.params, page.mechanism.five_bar);
  data["working_mode"] = page.mechanism.working_mode;
  data["workspace"] = workspace_json(page.mechanism);
  data["histograms"] = histograms_json(page.histograms);
  data["bus_load"] = load_json(page.load);
  data["columns"] = page.columns;
  data["rows"] = rows_json(page.rows);
  data["spectrum"] = {{"step_hz", page.rate_hz / Spectrum::segment}, {"amplitudes", Json::array()}};
  for (const Spectrum& s : page.torques) data["spectrum"]["amplitudes"].push_back(rounded(s.amplitudes(), 4));
  return render_report(data);
}

}  // namespace esmc::host
