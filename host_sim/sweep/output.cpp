#include "host_sim/sweep/output.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>

#include "host_sim/error.hpp"
#include "host_sim/report/study_page.hpp"
#include "host_sim/sweep/runner.hpp"
#include "host_sim/version.hpp"

namespace esmc::host {

using Json = nlohmann::ordered_json;

namespace {

std::string_view name_of(Objective o) { return objectives[static_cast<std::size_t>(o)].name; }

/// Columns that are the same in every run.
std::vector<std::size_t> repeatable(const SweepSpec& spec) {
  std::vector<std::size_t> out;
  for (std::size_t c = 0; c < spec.wanted.size(); ++c) {
    if (spec.wanted[c] != Objective::tick_ns) out.push_back(c);
  }
  return out;
}

/// Finite values of a column, ascending.
std::vector<double> sorted_column(const SweepTable& t, std::size_t column) {
  std::vector<double> out;
  for (std::size_t i = 0; i < t.outcome.size(); ++i) {
    if (t.outcome[i] == outcome_ok && std::isfinite(t.at(i, column))) out.push_back(t.at(i, column));
  }
  std::sort(out.begin(), out.end());
  return out;
}

/// A field that a comma or a quote would break.
std::string field(const std::string& text) {
  if (text.find_first_of(",\"\n\r") == std::string::npos) return text;
  std::string out = "\"";
  for (const char c : text) out.append(c == '"' ? 2 : 1, c);
  return out + "\"";
}

std::string number(double v) { return std::isfinite(v) ? fmt::format("{}", v) : std::string(); }

/// Number and values of the axes of a case.
std::string axes_of(const SweepSpec& spec, const CaseScenes& scenes, std::uint64_t index) {
  std::string out = std::to_string(index);
  for (std::size_t a = 0; a < spec.vary.size(); ++a)
    out.append(1, ',').append(field(text_of(scenes.value(index, a))));
  return out;
}

/// A header, and row(case) for every case.
template <class Row>
void write_table(const std::string& file, const std::string& head, const SweepTable& table, const Row& row) {
  std::ofstream out(file, std::ios::binary);
  out << head << '\n';
  for (std::uint64_t i = 0; i < table.outcome.size(); ++i) out << row(i) << '\n';
  out.close();
  if (!out) throw RunError(file + " could not be written completely (disk full?)");
}

/// Cases of each front of the specification; those alone that ended well.
std::vector<std::vector<std::uint64_t>> fronts_of(const SweepSpec& spec, const SweepTable& table) {
  std::vector<std::vector<std::uint64_t>> out;
  for (const auto& columns : spec.pareto) {
    std::vector<std::vector<double>> points;
    std::vector<std::uint64_t> index;
    for (std::uint64_t i = 0; i < table.outcome.size(); ++i) {
      if (table.outcome[i] != outcome_ok) continue;
      std::vector<double> p(columns.size());
      std::ranges::transform(columns, p.begin(), [&](std::size_t c) { return table.at(i, c); });
      points.push_back(std::move(p));
      index.push_back(i);
    }
    std::vector<std::uint64_t> front;
    for (const std::size_t i : pareto_front(points)) front.push_back(index[i]);
    out.push_back(std::move(front));
  }
  return out;
}

StudyVerdict sweep_verdict(const SweepTable& table) {
  const auto good = static_cast<std::size_t>(std::ranges::count(table.outcome, outcome_ok));
  return {good == table.outcome.size() ? StudyVerdict::Level::ok : StudyVerdict::Level::warn,
          fmt::format("{} of {} cases ran to their end", good, table.outcome.size()),
          "",
          {}};
}

}  // namespace

std::vector<std::size_t> pareto_front(const std::vector<std::vector<double>>& points) {
  std::vector<std::size_t> order;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (std::all_of(points[i].begin(), points[i].end(), [](double v) { return std::isfinite(v); }))
      order.push_back(i);
  }
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return points[a] != points[b] ? points[a] < points[b] : a < b;
  });
  // In this order nothing that comes later dominates what came before.
  std::vector<std::size_t> front;
  for (const std::size_t i : order) {
    const auto no_better = [&](std::size_t f) {
      return std::equal(points[f].begin(), points[f].end(), points[i].begin(),
                        [](double a, double b) { return a <= b; });
    };
    // The last one of a front of two objectives has the smallest second.
    if (std::none_of(front.rbegin(), front.rend(), no_better)) front.push_back(i);
  }
  return front;
}

Json sweep_summary(const SweepSpec& spec, const CaseScenes& scenes, const SweepTable& table) {
  Json j;
  j["scene"] = scenes.nominal().name;
  j["version"] = version;
  j["seed"] = spec.seed;
  j["cases"] = table.outcome.size();
  j["simulated_s"] = static_cast<double>(table.outcome.size()) * scenes.mean_duration();
  j["axes"] = Json::array();
  for (std::size_t a = 0; a < spec.vary.size(); ++a) {
    const Axis& axis = spec.design.axes()[a];
    Json d{{"key", spec.vary[a].key}, {"crossed", axis.crossed}};
    if (axis.listed > 0) {
      d["values"] = Json::array();
      for (const SweepValue& v : spec.vary[a].values)
        std::visit([&](const auto& x) { d["values"].push_back(x); }, v);
    } else {
      d[spec.vary[a].factor ? "factor" : "range"] = {axis.from, axis.to};
      d["log"] = axis.logarithmic;
      if (axis.crossed) d["steps"] = axis.steps;
    }
    j["axes"].push_back(std::move(d));
  }
  std::map<std::uint32_t, std::uint64_t> counts;
  for (const std::uint32_t o : table.outcome) ++counts[o];
  j["outcomes"] = Json::object();
  for (const auto& [outcome, n] : counts) j["outcomes"][outcome_name(outcome)] = n;
  j["objectives"] = Json::object();
  for (const std::size_t c : repeatable(spec)) {
    const auto v = sorted_column(table, c);
    Json& o = j["objectives"][std::string(name_of(spec.wanted[c]))];
    if (v.empty()) continue;
    double sum = 0.0;
    for (const double x : v) sum += x;
    const auto quantile = [&](double p) {
      const double at = p * static_cast<double>(v.size() - 1);
      const auto i = static_cast<std::size_t>(at);
      return std::lerp(v[i], v[std::min(i + 1, v.size() - 1)], at - static_cast<double>(i));
    };
    o = {{"min", v.front()},      {"p05", quantile(0.05)}, {"median", quantile(0.5)},
         {"p95", quantile(0.95)}, {"max", v.back()},       {"mean", sum / static_cast<double>(v.size())}};
  }
  j["fronts"] = Json::array();
  const auto fronts = fronts_of(spec, table);
  for (std::size_t f = 0; f < fronts.size(); ++f) {
    Json front;
    front["objectives"] = Json::array();
    for (const std::size_t c : spec.pareto[f]) front["objectives"].push_back(name_of(spec.wanted[c]));
    front["cases"] = fronts[f];
    j["fronts"].push_back(std::move(front));
  }
  return j;
}

std::string sweep_text(const Json& s) {
  std::string out = fmt::format("{}: {} cases, {:g} s simulated\n", printable(s["scene"].get<std::string>()),
                                s["cases"].get<std::uint64_t>(), s["simulated_s"].get<double>());
  std::string outcomes;
  for (const auto& [name, n] : s["outcomes"].items())
    outcomes += fmt::format("{}{} {}", outcomes.empty() ? "" : ", ", n.get<std::uint64_t>(), name);
  out += "outcomes: " + outcomes + "\n";
  out += fmt::format("{:<20}{:>12}{:>12}{:>12}{:>12}{:>12}\n", "", "min", "p05", "median", "p95", "max");
  for (const auto& [name, o] : s["objectives"].items()) {
    if (o.is_null()) continue;
    out += fmt::format("{:<20}", name);
    for (const char* q : {"min", "p05", "median", "p95", "max"})
      out += fmt::format("{:>12.4g}", o[q].get<double>());
    out += "\n";
  }
  for (const Json& f : s["fronts"]) {
    std::string names;
    for (const Json& n : f["objectives"])
      names.append(names.empty() ? "" : " / ").append(n.get<std::string>());
    out += fmt::format("Pareto front of {}: {} cases\n", names, f["cases"].size());
  }
  return out;
}

void write_cases(const std::string& file, const SweepSpec& spec, const CaseScenes& scenes,
                 const SweepTable& table) {
  std::string head = "case";
  for (const Vary& v : spec.vary) head.append(1, ',').append(field(v.key));
  head += ",outcome";
  const auto columns = repeatable(spec);
  for (const std::size_t c : columns) head += fmt::format(",{}", name_of(spec.wanted[c]));
  write_table(file, head, table, [&](std::uint64_t i) {
    std::string row = axes_of(spec, scenes, i);
    row.append(1, ',').append(outcome_name(table.outcome[i]));
    for (const std::size_t c : columns) row.append(1, ',').append(number(table.at(i, c)));
    return row;
  });
}

void write_timing(const std::string& file, const SweepSpec& spec, const SweepTable& table) {
  const auto c = static_cast<std::size_t>(
      std::find(spec.wanted.begin(), spec.wanted.end(), Objective::tick_ns) - spec.wanted.begin());
  write_table(file, "case,tick_ns", table,
              [&](std::uint64_t i) { return fmt::format("{},{}", i, number(table.at(i, c))); });
}

std::string sweep_page(const SweepSpec& spec, const CaseScenes& scenes, const SweepTable& table,
                       const Json& summary) {
  constexpr std::size_t most_points = 4000, most_rows = 50;
  std::string body;
  TextTable rows{{"objective", "min", "p05", "median", "p95", "max", "mean"}};
  for (const auto& [name, o] : summary["objectives"].items()) {
    if (o.is_null()) continue;
    rows.push_back({name});
    for (const Json& value : o) rows.back().push_back(fmt::format("{:.4g}", value.get<double>()));
  }
  TextTable ends{{"outcome", "cases"}};
  for (const auto& [name, n] : summary["outcomes"].items())
    ends.push_back({name, std::to_string(n.get<std::uint64_t>())});
  body += table_html("Outcomes", ends) + table_html("Objectives", rows);
  const auto fronts = fronts_of(spec, table);
  for (std::size_t f = 0; f < fronts.size(); ++f) {
    const auto& columns = spec.pareto[f];
    const std::string x(name_of(spec.wanted[columns[0]])), y(name_of(spec.wanted[columns[1]]));
    Series all{"cases", {}, false}, front{"Pareto front", {}, columns.size() == 2};
    const std::size_t every = table.outcome.size() / most_points + 1;
    for (std::uint64_t i = 0; i < table.outcome.size(); i += every) {
      if (table.outcome[i] == outcome_ok)
        all.points.emplace_back(table.at(i, columns[0]), table.at(i, columns[1]));
    }
    for (const std::uint64_t i : fronts[f])
      front.points.emplace_back(table.at(i, columns[0]), table.at(i, columns[1]));
    body += figures_html({chart_svg(y + " against " + x, x, y, {all, front})});
    if (every > 1)
      body += fmt::format("<p class='note'>One case in {} is drawn; the front is of all.</p>", every);
    TextTable best{{"case"}};
    for (const Vary& v : spec.vary) best[0].push_back(v.key);
    for (const std::size_t c : columns) best[0].emplace_back(name_of(spec.wanted[c]));
    const std::size_t size = fronts[f].size(), shown = std::min(size, most_rows);
    for (std::size_t k = 0; k < shown; ++k) {  // both ends are among them
      const std::uint64_t i = fronts[f][shown > 1 ? k * (size - 1) / (shown - 1) : 0];
      best.push_back({std::to_string(i)});
      for (std::size_t a = 0; a < spec.vary.size(); ++a) {
        const SweepValue v = scenes.value(i, a);
        const auto* d = std::get_if<double>(&v);
        best.back().push_back(d != nullptr ? fmt::format("{:.5g}", *d) : text_of(v));
      }
      for (const std::size_t c : columns) best.back().push_back(fmt::format("{:.4g}", table.at(i, c)));
    }
    body += table_html("Pareto front", best);
    if (shown < size)
      body += fmt::format("<p class='note'>{} of its {} cases are listed; summary.json has all.</p>", shown,
                          size);
  }
  std::vector<std::string> histograms;
  for (const std::size_t c : repeatable(spec)) {
    const auto v = sorted_column(table, c);
    if (v.size() > 1 && v.front() < v.back())
      histograms.push_back(
          histogram_svg(std::string(name_of(spec.wanted[c])),
                        std::string(objectives[static_cast<std::size_t>(spec.wanted[c])].meaning), v));
  }
  if (!histograms.empty()) body += figures_html(histograms);
  return study_page("Sweep: " + scenes.nominal().name, "esmc sweep " + spec.file + " --out DIR", body,
                    sweep_verdict(table));
}

}  // namespace esmc::host
