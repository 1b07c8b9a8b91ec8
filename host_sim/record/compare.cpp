#include "host_sim/record/compare.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <sstream>
#include <vector>

#include "host_sim/error.hpp"
#include "host_sim/json_text.hpp"
#include "host_sim/record/digest.hpp"
#include "host_sim/record/output.hpp"
#include "host_sim/record/recording.hpp"
#include "host_sim/record/run_options.hpp"
#include "host_sim/record/verdict.hpp"
#include "host_sim/report/study_page.hpp"
#include "host_sim/scene/scene.hpp"
#include "host_sim/scene/toml_text.hpp"

namespace esmc::host {
namespace {

using Json = nlohmann::ordered_json;
using Flat = std::map<std::string, std::string>;

/// Keys of a run's scene and their values as text, with the digests of the files that it names; entries of
/// arrays of tables count from 1.
Flat keys_of(const std::string& directory) {
  const std::string file = directory + "/scene.toml";
  Flat out;
  std::map<std::string, int> seen;
  std::string above;
  std::istringstream text(toml_text(parse_scene_file(file, {})));
  for (std::string line; std::getline(text, line);) {
    if (line.starts_with("[[")) {
      const std::string name = line.substr(2, line.size() - 4);
      above = fmt::format("{}.{}.", name, ++seen[name]);
    } else if (line.starts_with("[")) {
      above = line.substr(1, line.size() - 2) + ".";
    } else if (const std::size_t equals = line.find(" = "); equals != std::string::npos) {
      out[above + line.substr(0, equals)] = line.substr(equals + 3);
    }
  }
  for (const char* name : companion_names) {
    const std::string named = directory + "/" + name;
    if (!std::filesystem::is_regular_file(named)) continue;
    std::string& value = out[Companion{name, "", ""}.key()];  // absent where its table is inline
    value +=
        fmt::format("{}digest {}", value.empty() ? "" : ", ", digest_text(fnv(fnv_start, bytes_of(named))));
  }
  return out;
}

Json read_summary(const std::string& directory) {
  const std::string file = directory + "/summary.json";
  Json j = parse_json(bytes_of(file), false);
  if (!j.is_object() || !j.contains("torque") || !j.contains("ticks"))
    refuse("{}: not the summary of a run", file);
  return j;
}

/// Numbers of a summary by their path, without those of the wall clock and the state, which the log has.
void metrics_of(const Json& j, const std::string& name, std::map<std::string, double>& out) {
  static const std::set<std::string> left_out{
      "wall_s", "real_time_factor", "cpu_s", "late_ticks", "final_state", "seed", "schema"};
  for (const auto& [key, value] : j.items()) {
    if (left_out.contains(key)) continue;
    const std::string path = name.empty() ? key : name + "." + key;
    if (value.is_number()) out[path] = value.get<double>();
    if (value.is_null()) out[path] = std::nan("");
    if (value.is_object()) metrics_of(value, path, out);
  }
}

struct Run {
  std::string directory;
  Flat scene;
  Json summary;
  std::map<std::string, double> metrics;
  std::vector<std::string> columns;
  std::vector<std::vector<std::string>> rows;  ///< fields as written

  explicit Run(const std::string& d) : directory(d), scene(keys_of(d)), summary(read_summary(d)) {
    metrics_of(summary, "", metrics);
    require_csv(d);
    const std::string file = d + "/log.csv";
    require_regular_file(file);
    std::ifstream in(file, std::ios::binary);
    for (std::string line; std::getline(in, line);) {
      const auto fields = fields_of(line);
      std::vector<std::string> row(fields.begin(), fields.end());
      if (columns.empty())
        columns = std::move(row);
      else if (row.size() == columns.size())
        rows.push_back(std::move(row));
      else
        refuse("{}:{}: {} fields, and the header has {}", file, rows.size() + 2, row.size(), columns.size());
    }
    if (columns.empty()) refuse("{}: empty", file);
  }
  /// --log-every of the run.
  [[nodiscard]] int every() const {
    static const Json::json_pointer at("/run/log/every");
    return summary.contains(at) && summary[at].is_number_integer() ? summary[at].get<int>() : 1;
  }
  [[nodiscard]] std::size_t column(const std::string& name) const {
    return static_cast<std::size_t>(std::ranges::find(columns, name) - columns.begin());
  }
};

std::optional<double> number(const std::string& text) {
  char* end = nullptr;
  const double v = std::strtod(text.c_str(), &end);
  return !text.empty() && *end == '\0' ? std::optional(v) : std::nullopt;
}

bool alike(double a, double b, double tolerance) {
  if (std::isnan(a) || std::isnan(b)) return std::isnan(a) && std::isnan(b);
  if (!std::isfinite(a) || !std::isfinite(b)) return a == b;
  return std::abs(a - b) <= tolerance * std::max({1.0, std::abs(a), std::abs(b)});
}

/// Keys of one or the other whose values differ.
Json scene_differences(const Flat& a, const Flat& b) {
  Json out = Json::array();
  std::set<std::string> all;
  for (const Flat* of : {&a, &b}) {
    for (const auto& [key, value] : *of) all.insert(key);
  }
  const auto value = [](const Flat& of, const std::string& key) {
    const auto at = of.find(key);
    return at == of.end() ? Json(nullptr) : Json(at->second);
  };
  for (const std::string& key : all) {
    const Json x = value(a, key), y = value(b, key);
    if (x != y) out.push_back({{"key", key}, {"a", x}, {"b", y}});
  }
  return out;
}

Json compare_metrics(const Run& a, const Run& b, double tolerance, bool& beyond) {
  Json out = Json::array();
  for (const auto& [key, x] : a.metrics) {
    const auto at = b.metrics.find(key);
    if (at == b.metrics.end() || (std::isnan(x) && std::isnan(at->second))) continue;
    const bool same = alike(x, at->second, tolerance);
    beyond = beyond || !same;
    out.push_back(
        {{"key", key}, {"a", x}, {"b", at->second}, {"difference", at->second - x}, {"within", same}});
  }
  return out;
}

Json compare_logs(const Run& a, const Run& b, double tolerance, bool& beyond) {
  std::vector<std::pair<std::size_t, std::size_t>> both;
  Json only_a = Json::array(), only_b = Json::array(), first = nullptr, largest = nullptr;
  for (std::size_t i = 0; i < a.columns.size(); ++i) {
    const std::size_t k = b.column(a.columns[i]);
    if (a.columns[i] == "delay") continue;  // of the wall clock
    if (k < b.columns.size())
      both.emplace_back(i, k);
    else
      only_a.push_back(a.columns[i]);
  }
  for (const std::string& c : b.columns) {
    if (a.column(c) == a.columns.size()) only_b.push_back(c);
  }
  double most = 0.0;
  for (std::size_t n = 0; n < std::min(a.rows.size(), b.rows.size()); ++n) {
    for (const auto& [i, k] : both) {
      const std::string &x = a.rows[n][i], &y = b.rows[n][k];
      if (x == y) continue;
      const auto v = number(x), w = number(y);
      const double off = v && w ? std::abs(*v - *w) : std::numeric_limits<double>::infinity();
      const auto value = [](const std::optional<double>& u, const std::string& word) {
        return u && std::isfinite(*u) ? Json(*u) : Json(word);
      };
      const Json here = {{"row", n + 1},
                         {"t", value(number(a.rows[n].front()), a.rows[n].front())},
                         {"column", a.columns[i]},
                         {"a", value(v, x)},
                         {"b", value(w, y)}};
      if (first.is_null() && !(v && w && alike(*v, *w, tolerance))) first = here;
      if (off > most && std::isfinite(off)) {
        most = off;
        largest = here;
      }
    }
  }
  beyond = beyond || !first.is_null() || a.rows.size() != b.rows.size() || !only_a.empty() || !only_b.empty();
  return {{"rows_a", a.rows.size()}, {"rows_b", b.rows.size()},   {"only_in_a", only_a},
          {"only_in_b", only_b},     {"first_difference", first}, {"largest_difference", largest}};
}

/// Names of the faults that a run ended in.
Json faults_of(const Run& r) {
  Json out = Json::array();
  const auto supervisor = r.summary.find("supervisor");
  if (supervisor == r.summary.end() || !supervisor->is_object()) return out;
  for (const Json& fault : supervisor->value("faults", Json::array()))
    if (fault.is_object()) out.push_back(fault.value("name", Json(nullptr)));
  return out;
}

std::string text_of(const Json& v) {
  return v.is_string() ? printable(v.get<std::string>()) : v.is_null() ? "-" : v.dump();
}

std::string difference_text(const Json& d) {
  return fmt::format("t = {} s, {}: {} and {}", text_of(d["t"]), text_of(d["column"]), text_of(d["a"]),
                     text_of(d["b"]));
}

/// The effector's distance from its reference over time, mm.
Series error_of(const Run& r, const std::string& name) {
  Series out{name, {}};
  const std::size_t at[] = {r.column("t"), r.column("x"), r.column("y"), r.column("x_ref"),
                            r.column("y_ref")};
  if (std::ranges::any_of(at, [&](std::size_t i) { return i >= r.columns.size(); })) return out;
  const std::size_t stride = std::max<std::size_t>(1, r.rows.size() / 1000);
  for (std::size_t n = 0; n < r.rows.size(); n += stride) {
    double v[5];
    for (std::size_t i = 0; i < 5; ++i) v[i] = number(r.rows[n][at[i]]).value_or(std::nan(""));
    const double error = 1e3 * std::hypot(v[1] - v[3], v[2] - v[4]);
    if (error > 0.0) out.points.emplace_back(v[0], error);
  }
  return out;
}

std::string page(const CompareOptions& o, const Json& j, const Run& a, const Run& b) {
  const bool within = j["within"].get<bool>();
  const std::string error = chart_svg("Effector error", "t in s", "mm from the reference",
                                      {error_of(a, "A"), error_of(b, "B")}, Scale::linear);
  const StudyVerdict verdict{
      within ? StudyVerdict::Level::ok : StudyVerdict::Level::warn,
      within ? fmt::format("within {:g}", o.tolerance) : fmt::format("beyond {:g}", o.tolerance),
      "A: " + o.a + " - " + verdict_line(a.summary) + "; B: " + o.b + " - " + verdict_line(b.summary),
      {}};
  return study_page("Two runs", o.command_line,
                    figures_html({error}) + table_html("Keys of the scene that differ", rows_of(j["scene"])) +
                        table_html("Metrics", rows_of(j["metrics"])),
                    verdict);
}

std::string text(const Json& j) {
  std::string out;
  for (const Json& d : j["scene"])
    out += fmt::format("scene {}: {} and {}\n", text_of(d["key"]), text_of(d["a"]), text_of(d["b"]));
  for (const Json& m : j["metrics"]) {
    if (m["a"] == m["b"]) continue;
    out +=
        fmt::format("{}: {:.6g} and {:.6g}\n", text_of(m["key"]), m["a"].get<double>(), m["b"].get<double>());
  }
  if (j["faults"]["a"] != j["faults"]["b"])
    out += fmt::format("faults: {} and {}\n", printable(j["faults"]["a"].dump()),
                       printable(j["faults"]["b"].dump()));
  const Json& log = j["log"];
  if (log["rows_a"] != log["rows_b"])
    out += fmt::format("log: {} and {} rows\n", text_of(log["rows_a"]), text_of(log["rows_b"]));
  for (const char* side : {"only_in_a", "only_in_b"}) {
    for (const Json& c : log[side])
      out += fmt::format("column {} is {}\n", text_of(c),
                         side == std::string("only_in_a") ? "in A only" : "in B only");
  }
  if (!log["first_difference"].is_null())
    out += "first difference: " + difference_text(log["first_difference"]) + "\n";
  if (!log["largest_difference"].is_null())
    out += "largest difference: " + difference_text(log["largest_difference"]) + "\n";
  return out + fmt::format("{} {:g}\n", j["within"].get<bool>() ? "within" : "beyond",
                           j["tolerance"].get<double>());
}

}  // namespace

int run_compare(const CompareOptions& o) {
  const Run a(o.a), b(o.b);
  if (a.every() != b.every()) {
    refuse(
        "{} and {}: their logs are of --log-every {} and {}, and only logs of the same ticks can be compared",
        o.a, o.b, a.every(), b.every());
  }
  OutputDirectory out(o.out);
  for (const std::string& run : {o.a, o.b}) out.spare(run + "/scene.toml");
  bool beyond = false;
  Json j = {{"a", o.a}, {"b", o.b}, {"tolerance", o.tolerance}, {"within", true}};
  j["scene"] = scene_differences(a.scene, b.scene);
  j["metrics"] = compare_metrics(a, b, o.tolerance, beyond);
  j["faults"] = {{"a", faults_of(a)}, {"b", faults_of(b)}};
  beyond = beyond || j["faults"]["a"] != j["faults"]["b"];
  j["log"] = compare_logs(a, b, o.tolerance, beyond);
  j["within"] = !beyond;
  if (o.capture != nullptr) {
    o.capture->document = document_text(j);
    return beyond ? 1 : 0;
  }
  publish({"comparison", j, text(j), [&] { return page(o, j, a, b); }}, o.json, out);
  return beyond ? 1 : 0;
}

}  // namespace esmc::host
