#include "host_sim/studies/studies.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cstdio>
#include <map>
#include <nlohmann/json.hpp>

#include "host_sim/error.hpp"
#include "host_sim/loop/progress.hpp"
#include "host_sim/record/output.hpp"
#include "host_sim/report/study_page.hpp"

namespace esmc::host {
namespace {

using Json = nlohmann::ordered_json;

std::string text(double v) { return std::isfinite(v) ? fmt::format("{:.3g}", v) : ""; }

struct Study {
  WorkPrecision work;
  Json tracking, effects;
  double seconds = 0.0;
};

TextTable work_rows(const Study& s) {
  TextTable rows{{"problem", "method", "control", "setting", "error", "cpu_ms"}};
  for (const WorkPoint& p : s.work.points) {
    rows.push_back({p.problem, p.method, p.adaptive ? "tolerance" : "step", text(p.setting), text(p.error),
                    text(p.cpu_ms)});
  }
  return rows;
}
TextTable order_rows(const Study& s) {
  TextTable rows{{"problem", "method", "order", "measured", "verdict"}};
  for (const OrderFound& o : s.work.orders) {
    rows.push_back({o.problem, o.method, std::to_string(o.order),
                    o.judged() ? fmt::format("{:.2f}", o.found) : "",
                    !o.judged() ? "none: not settled, or not smooth" : (o.holds() ? "holds" : "MISSED")});
  }
  return rows;
}
/// The runs of a method on a problem.
struct Curve {
  std::string problem, method;
  bool adaptive = false;
  std::vector<std::pair<double, double>> points;  ///< CPU time in ms, error
};
std::vector<Curve> curves(const Study& s) {
  std::vector<Curve> out;
  for (const WorkPoint& p : s.work.points) {
    const auto is_of = [&](const Curve& c) {
      return c.problem == p.problem && c.method == p.method && c.adaptive == p.adaptive;
    };
    auto at = std::ranges::find_if(out, is_of);
    if (at == out.end()) at = out.insert(at, {p.problem, p.method, p.adaptive, {}});
    at->points.emplace_back(p.cpu_ms, p.error);
  }
  return out;
}
/// CPU time to an error: the cheapest run of each method that met it.
TextTable cost_rows(const Study& s) {
  TextTable rows{{"problem", "method", "1e-3", "1e-6", "1e-9", "1e-12"}};
  for (const Curve& c : curves(s)) {
    rows.push_back({c.problem, c.method + (c.adaptive ? " (adaptive)" : "")});
    for (const double wanted : {1e-3, 1e-6, 1e-9, 1e-12}) {
      double best = std::numeric_limits<double>::infinity();
      for (const auto& [cpu_ms, error] : c.points) {
        if (error <= wanted) best = std::min(best, cpu_ms);
      }
      rows.back().push_back(text(best));
    }
  }
  return rows;
}
/// One figure per problem: name of the problem, drawing.
std::vector<std::pair<std::string, std::string>> figures(const Study& s) {
  std::vector<std::pair<std::string, std::vector<Series>>> problems;
  for (Curve& c : curves(s)) {
    if (problems.empty() || problems.back().first != c.problem) problems.push_back({c.problem, {}});
    problems.back().second.push_back({c.method + (c.adaptive ? " adaptive" : ""), std::move(c.points)});
  }
  std::vector<std::pair<std::string, std::string>> out;
  out.reserve(problems.size());
  for (const auto& [problem, series] : problems)
    out.emplace_back(problem, chart_svg(problem, "CPU time, ms", "error at the end", series));
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
  j["tracking"] = s.tracking;
  j["effects"] = s.effects;
  j["seconds"] = s.seconds;
  return j;
}

/// The sections of every form the study is given in.
std::vector<std::pair<std::string, TextTable>> sections(const Study& s) {
  return {{"CPU time in ms to an error, per method", cost_rows(s)},
          {"Measured orders", order_rows(s)},
          {"Tracking of the comparison scenario", rows_of(s.tracking)},
          {"Effects on the comparison scenario", rows_of(s.effects)}};
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

/// The sections as Markdown, `mark` before each title.
std::string accuracy_text(const Study& s, const char* mark) {
  std::string out;
  for (const auto& [title, rows] : sections(s)) out += mark + title + "\n\n" + markdown_table(rows) + "\n";
  return out;
}

void write_tables(const Study& s, const OutputDirectory& out) {
  if (!out.wanted()) return;
  out.write("work_precision.csv", csv_table(work_rows(s)));
  out.write("orders.csv", csv_table(order_rows(s)));
  out.write("tracking.csv", csv_table(rows_of(s.tracking)));
  out.write("effects.csv", csv_table(rows_of(s.effects)));
  for (const auto& [problem, drawing] : figures(s))
    out.write("work_" + file_name(problem) + ".svg", standalone(drawing));
  out.write("accuracy.md", accuracy_text(s, "### "));
}

std::string accuracy_page(const Study& s, const std::string& command) {
  std::string tables;
  std::vector<std::string> drawings;
  for (const auto& [problem, drawing] : figures(s)) drawings.push_back(drawing);
  for (const auto& [title, rows] : sections(s)) tables += table_html(title, rows);
  return study_page("What accuracy costs in time", command, figures_html(drawings) + tables, verdict(s));
}

}  // namespace

int run_accuracy(const AccuracyOptions& o) {
  if (!o.scene.empty() && o.quick) throw InputError("", "--quick is for the study without SCENE");
  if (!o.scene.empty()) return run_price_list(o);
  if (o.all_effects || !o.sets.empty() || !(o.tolerance + o.metric + o.write).empty())
    throw InputError("", "--set, --tolerance, --of, --effects and --write need a SCENE");
  OutputDirectory out(o.out);
  Study s;
  const double begin = thread_cpu_s();
  constexpr std::uint64_t runs = 1000;  // about; those of an integrator depend on what it reaches
  std::uint64_t done = 0;
  Progress progress(runs);
  const auto after_run = [&] {
    if (stop_requested()) throw Interrupted(fmt::format("interrupted after {} runs", done));
    progress.show(std::min(++done, runs));
  };
  s.work = integrator_study(o.quick ? 1.0 : 40.0, after_run);
  s.tracking = tracking_study(o.quick, after_run);
  s.effects = effect_study(after_run);
  s.seconds = thread_cpu_s() - begin;
  write_tables(s, out);
  publish({"accuracy", document(s), accuracy_text(s, "") + fmt::format("{:.1f} s of CPU time\n", s.seconds),
           [&] { return accuracy_page(s, o.command_line); }},
          o.json, out);
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
