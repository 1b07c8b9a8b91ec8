#include "host_sim/studies/accuracy.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cstdio>
#include <map>
#include <nlohmann/json.hpp>

#include "host_sim/error.hpp"
#include "host_sim/record/output.hpp"
#include "host_sim/report/study_page.hpp"

namespace esmc::host {
namespace {

using Json = nlohmann::ordered_json;
using Rows = std::vector<std::vector<std::string>>;

std::string text(double v) { return std::isfinite(v) ? fmt::format("{:.3g}", v) : ""; }

struct Study {
  WorkPrecision work;
  std::vector<TrackingPoint> tracking;
  std::vector<EffectPoint> effects;
  double seconds = 0.0;
};

Rows work_rows(const Study& s) {
  Rows rows{{"problem", "method", "control", "setting", "error", "cpu_ms"}};
  for (const WorkPoint& p : s.work.points) {
    rows.push_back({p.problem, p.method, p.adaptive ? "tolerance" : "step", text(p.setting), text(p.error),
                    text(p.cpu_ms)});
  }
  return rows;
}
Rows order_rows(const Study& s) {
  Rows rows{{"problem", "method", "order", "measured", "verdict"}};
  for (const OrderFound& o : s.work.orders) {
    rows.push_back({o.problem, o.method, std::to_string(o.order),
                    o.judged() ? fmt::format("{:.2f}", o.found) : "",
                    !o.judged() ? "none: not settled, or not smooth" : (o.holds() ? "holds" : "MISSED")});
  }
  return rows;
}
/// CPU time to an error: the cheapest run of each method that met it.
Rows cost_rows(const Study& s) {
  constexpr double wanted[] = {1e-3, 1e-6, 1e-9, 1e-12};
  Rows rows{{"problem", "method", "1e-3", "1e-6", "1e-9", "1e-12"}};
  std::map<std::pair<std::string, std::string>, std::array<double, 4>> best;
  std::vector<std::pair<std::string, std::string>> order;
  for (const WorkPoint& p : s.work.points) {
    const auto key = std::make_pair(p.problem, p.method + (p.adaptive ? " (adaptive)" : ""));
    auto [at, fresh] = best.try_emplace(key);
    if (fresh) {
      at->second.fill(std::numeric_limits<double>::infinity());
      order.push_back(key);
    }
    for (std::size_t i = 0; i < 4; ++i) {
      if (p.error <= wanted[i]) at->second[i] = std::min(at->second[i], p.cpu_ms);
    }
  }
  for (const auto& key : order) {
    std::vector<std::string> row{key.first, key.second};
    for (const double v : best[key]) row.push_back(text(v));
    rows.push_back(row);
  }
  return rows;
}
Json tracking_json(const Study& s) {
  Json out = Json::array();
  for (const TrackingPoint& p : s.tracking) {
    out.push_back({{"study", p.study},
                   {"setting", p.setting},
                   {"settled_max_rad", p.settled_max_rad},
                   {"settled_rms_m", p.settled_rms_m},
                   {"mean_abs_delta_nm", p.chatter_nm},
                   {"us_per_tick", p.us_per_tick},
                   {"fault", p.fault.empty() ? Json(nullptr) : Json(p.fault)}});
  }
  return out;
}
Json effects_json(const Study& s) {
  Json out = Json::array();
  for (const EffectPoint& p : s.effects) {
    out.push_back({{"effect", p.effect},
                   {"parameters", p.parameters},
                   {"integrator", p.integrator},
                   {"deviation_m", p.deviation_m},
                   {"settled_max_rad", p.settled_max_rad},
                   {"without_rad", p.without_rad},
                   {"states_added", p.states},
                   {"ns_per_step", p.ns_per_step},
                   {"ns_without", p.ns_without},
                   {"fault", p.fault.empty() ? Json(nullptr) : Json(p.fault)}});
  }
  return out;
}
/// A list of flat objects with the same keys as a table.
Rows rows_of(const Json& list) {
  Rows rows;
  for (const Json& object : list) {
    if (rows.empty()) rows.emplace_back();
    const bool first = rows.size() == 1;
    std::vector<std::string> row;
    for (const auto& [key, value] : object.items()) {
      if (first) rows.front().push_back(key);
      std::string cell = value.is_string()           ? value.get<std::string>()
                         : value.is_number_integer() ? value.dump()
                         : value.is_number()         ? text(value.get<double>())
                                                     : "";
      if (key == "parameters") std::ranges::replace(cell, ',', ';');  // a comma would split the cell of a CSV
      row.push_back(std::move(cell));
    }
    rows.push_back(std::move(row));
  }
  return rows;
}

/// One figure per problem: name of the problem, drawing.
std::vector<std::pair<std::string, std::string>> figures(const Study& s) {
  std::map<std::string, std::vector<Series>> by_problem;
  std::vector<std::string> problems;
  for (const WorkPoint& p : s.work.points) {
    auto [at, fresh] = by_problem.try_emplace(p.problem);
    if (fresh) problems.push_back(p.problem);
    const std::string label = p.method + (p.adaptive ? " adaptive" : "");
    if (at->second.empty() || at->second.back().name != label) at->second.push_back({label, {}});
    at->second.back().points.emplace_back(p.cpu_ms, p.error);
  }
  std::vector<std::pair<std::string, std::string>> out;
  for (const std::string& p : problems) {
    out.emplace_back(p, log_log_svg(p, "CPU time, ms", "error at the end", by_problem[p]));
  }
  return out;
}

/// "B1 Andrews, 0.03 s" -> "b1_andrews"
std::string file_name(const std::string& problem) {
  std::string out;
  for (const char c : problem.substr(0, problem.find(','))) {
    out += std::isalnum(static_cast<unsigned char>(c)) != 0
               ? static_cast<char>(std::tolower(static_cast<unsigned char>(c)))
               : '_';
  }
  return out;
}

Json document(const Study& s) {
  Json j;
  j["work_precision"] = Json::array();
  for (const WorkPoint& p : s.work.points) {
    j["work_precision"].push_back({{"problem", p.problem},
                                   {"method", p.method},
                                   {"adaptive", p.adaptive},
                                   {"setting", p.setting},
                                   {"error", p.error},
                                   {"cpu_ms", p.cpu_ms}});
  }
  j["orders"] = Json::array();
  for (const OrderFound& o : s.work.orders) {
    j["orders"].push_back({{"problem", o.problem},
                           {"method", o.method},
                           {"order", o.order},
                           {"measured", o.found},
                           {"holds", o.holds()}});
  }
  j["tracking"] = tracking_json(s);
  j["effects"] = effects_json(s);
  j["seconds"] = s.seconds;
  return j;
}

/// The sections of every form the study is given in.
std::vector<std::pair<std::string, Rows>> sections(const Study& s) {
  return {{"CPU time in ms to an error, per method", cost_rows(s)},
          {"Measured orders", order_rows(s)},
          {"Tracking of the comparison scenario", rows_of(tracking_json(s))},
          {"Effects on the comparison scenario", rows_of(effects_json(s))}};
}

StudyVerdict verdict(const Study& s) {
  std::size_t hold = 0, judged = 0;
  for (const OrderFound& found : s.work.orders) {
    judged += found.judged() ? 1U : 0U;
    hold += found.judged() && found.holds() ? 1U : 0U;
  }
  const bool good = judged > 0 && hold == judged;
  return {good ? StudyVerdict::Level::ok : StudyVerdict::Level::bad,
          good ? "Every integrator shows its order, within 0.2"
               : fmt::format("{} of {} measured orders are not within 0.2", judged - hold, judged),
          "",
          {{{"Orders measured", fmt::format("{}", judged), fmt::format("{} hold", hold)},
            {"Runs of integrators", fmt::format("{}", s.work.points.size()), "each a point of the curves"},
            {"Runs of the comparison scenario", fmt::format("{}", s.tracking.size() + s.effects.size()),
             "tracking and effects"},
            {"CPU time", fmt::format("{:.1f} s", s.seconds), ""}}}};
}

void write_files(const Study& s, const AccuracyOptions& o, OutputDirectory& out) {
  if (!out.wanted()) return;
  out.write("work_precision.csv", csv_table(work_rows(s)));
  out.write("orders.csv", csv_table(order_rows(s)));
  out.write("tracking.csv", csv_table(rows_of(tracking_json(s))));
  out.write("effects.csv", csv_table(rows_of(effects_json(s))));
  out.write("accuracy.json", document(s).dump(2) + "\n");
  std::string tables, markdown;
  std::vector<std::string> drawings;
  for (const auto& [problem, drawing] : figures(s)) {
    drawings.push_back(drawing);
    out.write("work_" + file_name(problem) + ".svg", standalone(drawing));
  }
  for (const auto& [title, rows] : sections(s)) {
    tables += table_html(title, rows);
    markdown += "### " + title + "\n\n" + markdown_table(rows) + "\n";
  }
  out.write("accuracy.md", markdown);
  out.write("report.html", study_page("What accuracy costs in time", o.command_line,
                                      figures_html(drawings) + tables, verdict(s)));
  out.commit();
}

}  // namespace

int run_accuracy(const AccuracyOptions& o) {
  OutputDirectory out(o.out);
  Study s;
  const double begin = thread_cpu_s();
  s.work = integrator_study(o.quick ? 1.0 : 40.0);
  s.tracking = tracking_study(o.quick);
  s.effects = effect_study();
  s.seconds = thread_cpu_s() - begin;
  write_files(s, o, out);
  if (o.json) {
    fmt::print("{}\n", document(s).dump(2));
  } else {
    for (const auto& [title, rows] : sections(s)) fmt::print("{}\n\n{}\n", title, markdown_table(rows));
    fmt::print("{:.1f} s of CPU time\n", s.seconds);
    if (out.wanted()) fmt::print("report: {}/report.html\n", out.directory());
  }
  if (std::fflush(stdout) != 0) throw RunError("standard output could not be written");
  std::map<std::string, int> judged;
  bool all_hold = true;
  for (const OrderFound& f : s.work.orders) {
    judged[f.method] += f.judged() ? 1 : 0;
    all_hold = all_hold && f.holds();
  }
  for (const auto& [method, times] : judged) all_hold = all_hold && times > 0;
  if (!all_hold) throw RunError("an integrator did not show its order within 0.2: see the table of orders");
  return 0;
}

}  // namespace esmc::host
