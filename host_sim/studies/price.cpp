/// `esmc accuracy SCENE`: runs the price list of a scene and shows it.

#include "host_sim/studies/price.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>

#include "host_sim/check/check.hpp"
#include "host_sim/error.hpp"
#include "host_sim/record/output.hpp"
#include "host_sim/report/study_page.hpp"
#include "host_sim/scene/edit.hpp"
#include "host_sim/scene/toml_text.hpp"
#include "host_sim/studies/studies.hpp"

namespace esmc::host {
namespace {

using Json = nlohmann::ordered_json;

constexpr double digits[] = {1e-3, 1e-6, 1e-9};
constexpr double default_share = 0.01;  ///< of the metric of the fullest scene: the tolerance

Json finite_or_null(double v) { return std::isfinite(v) ? Json(v) : Json(nullptr); }
/// The metric as its key has it: q itself for `end`.
Json value_of(const Outcome& o, const Bench& bench) {
  if (!o.sound()) return nullptr;
  return bench.of_end() ? Json(o.q) : finite_or_null(o.value);
}
/// Its size, which a share is taken of.
double size_of(const Outcome& o, const Bench& bench) {
  if (!bench.of_end()) return std::abs(o.value);
  double out = 0.0;
  for (const double q : o.q) out = std::max(out, std::abs(q));
  return out;
}

/// "0.01" in the unit of the metric, or "2%" of `whole`.
double tolerance_of(const std::string& text, double whole) {
  if (text.empty()) return default_share * whole;
  char* end = nullptr;
  const double v = std::strtod(text.c_str(), &end);
  const std::string unit(end);
  if (end == text.c_str() || !(v >= 0.0) || !std::isfinite(v) || !(unit.empty() || unit == "%"))
    throw InputError("", "--tolerance " + text + ": a number >= 0, or a share like 2%, is needed");
  return unit.empty() ? v : 0.01 * v * whole;
}

struct PriceList {
  std::string scene;
  Bench& bench;
  Variants& variants;
  Subset fullest = 0;
  double tolerance = 0.0;
  IntegratorStudy integrators{};
  Json effects = Json::array(), loop = Json::array();
  std::vector<std::string> left_out{};  ///< effects that the fullest scene cannot have, and why
  Minimal minimal{};
  Outcome whole{};  ///< of the fullest scene
};

/// Throws where the scene as given cannot be compared with anything.
void require_sound(const Outcome& o, const Bench& bench, const Scene& scene) {
  if (!o.fault.empty())
    throw RunError("the scene ends in " + o.fault + ": a price list needs a run without a fault");
  if (!o.sound()) throw Diverged("the state is no longer finite: a smaller simulation.step is needed");
  if (bench.of_end() || std::isfinite(o.value)) return;
  throw InputError(scene.reference_where,
                   fmt::format("--of {}: this scene has no such error ({}); --of end compares final_state.q",
                               bench.metric(),
                               scene.reference.type == ReferenceType::none ? "no reference" : "too short"));
}

void price_effects(PriceList& p) {
  const Subset own = p.variants.named();
  const auto& all = p.variants.candidates();
  std::vector<Subset> others;
  for (std::size_t i = 0; i < all.size(); ++i) others.push_back(own ^ Subset{1} << i);
  p.variants.run_all(others);
  for (std::size_t i = 0; i < all.size(); ++i) {
    const Outcome& other = p.variants.run(others[i]);
    const Outcome& with = all[i].named ? p.variants.run(own) : other;
    const Outcome& without = all[i].named ? other : p.variants.run(own);
    const double moved = p.bench.distance(with, without);
    const bool known = std::isfinite(moved);
    const double change = p.bench.of_end() || !known ? moved : with.value - without.value;
    p.effects.push_back({{"name", all[i].type()},
                         {"named", all[i].named},
                         {"parameters", all[i].parameters()},
                         {"changes", {{p.bench.metric(), finite_or_null(change)}}},
                         {"cost_ratio", finite_or_null(with.cost / without.cost)},
                         {"states", without.q.empty() || with.q.empty() ? 0 : with.states - without.states},
                         {"matters", !(moved <= p.tolerance)}});
  }
}

/// All effects of the list with which the scene still runs, taken in one after another.
void find_fullest(PriceList& p) {
  p.fullest = p.variants.named();
  const auto& all = p.variants.candidates();
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (all[i].named) continue;
    const Subset more = p.fullest | Subset{1} << i;
    const Outcome& o = p.variants.run(more);
    if (o.sound()) {
      p.fullest = more;
    } else {
      p.left_out.push_back(all[i].type() + ": " + (o.fault.empty() ? "diverges" : o.fault));
    }
  }
  p.whole = p.variants.run(p.fullest);
}

void price_loop(PriceList& p, const Scene& scene) {
  if (!scene.closed_loop()) return;
  const double base = p.variants.run(p.variants.named()).cost;
  const auto add = [&](const char* knob, const Json& value, const std::optional<Scene>& changed,
                       bool single_precision = false) {
    if (!changed) return;
    const Outcome o = p.bench.run(*changed, single_precision);
    p.loop.push_back({{"knob", knob},
                      {"value", value},
                      {p.bench.metric(), value_of(o, p.bench)},
                      {"cost_ratio", finite_or_null(o.cost / base)}});
  };
  for (const double factor : {0.5, 2.0}) {
    const double rate = factor * scene.rate_hz;
    add("tick rate", rate, p.variants.changed({fmt::format("control.rate_hz={}", rate)}));
  }
  add("scalar", "float", p.variants.changed({}), true);
  for (const int bits : {12, 14, 16, 18, 20}) {
    Encoder e = find_effect<Encoder>(scene.effects).value_or(Encoder{});
    e.bits = bits;
    add("encoder bits", bits, p.variants.changed({}, e));
  }
  for (const double ticks : {0.5, 1.0, 2.0})
    add("delay", ticks * scene.tick(), p.variants.changed({}, ComputeDelay{ticks * scene.tick()}));
}

std::vector<std::string> kept(const PriceList& p) {
  std::vector<std::string> out;
  const auto& all = p.variants.candidates();
  for (std::size_t i = 0; i < all.size(); ++i) {
    if ((p.minimal.effects >> i & 1U) != 0) out.push_back(all[i].type());
  }
  return out;
}

Json price_document(const PriceList& p) {
  Json j;
  j["integrators"] = Json::array();
  for (const IntegratorPrice& r : p.integrators.rows) {
    Json recommended = Json::array();
    for (const double digit : digits) {
      if (p.integrators.cheapest(digit) == &r) recommended.push_back(digit);
    }
    j["integrators"].push_back({{"method", name(r.stepping.method)},
                                {"step", r.stepping.step},
                                {"error", finite_or_null(r.error)},
                                {"cpu_s", r.cpu_s},
                                {"recommended_for", recommended}});
  }
  j["effects"] = p.effects;
  j["loop"] = p.loop;
  j["minimal"] = {{"effects", kept(p)},
                  {"integrator", name(p.minimal.stepping.method)},
                  {"step", p.minimal.stepping.step},
                  {p.bench.metric(), value_of(p.minimal.outcome, p.bench)},
                  {"difference", p.minimal.difference},
                  {"cost_ratio", p.minimal.outcome.cost / p.whole.cost}};
  return j;
}

std::string unit_of(const std::string& metric) {
  return metric == "end" ? "m or rad" : (metric.ends_with("_m") ? "m" : "rad");
}

std::string verdict_text(const PriceList& p) {
  const std::vector<std::string> effects = kept(p);
  return fmt::format(
      "{} with {} at {:.3g} s stays within {:.3g} {} of the fullest scene ({:.2g} off) at {:.0f} % of its "
      "cost",
      effects.empty() ? "no effects" : fmt::format("{}", fmt::join(effects, ", ")),
      name(p.minimal.stepping.method), p.minimal.stepping.step, p.tolerance, unit_of(p.bench.metric()),
      p.minimal.difference, 100.0 * p.minimal.outcome.cost / p.whole.cost);
}

std::vector<std::pair<std::string, TextTable>> price_sections(const Json& j) {
  return {{"Integrators: error of final_state.q", rows_of(j["integrators"])},
          {"Effects: what each changes", rows_of(j["effects"])},
          {"The loop: what each knob changes", rows_of(j["loop"])}};
}

std::string price_page(const PriceList& p, const Json& j, const std::string& command) {
  std::vector<Series> curves;
  for (const IntegratorPrice& r : p.integrators.rows) {
    const std::string method = name(r.stepping.method);
    if (curves.empty() || curves.back().name != method) curves.push_back({method, {}});
    curves.back().points.emplace_back(r.cost, r.error);
  }
  std::vector<Series> effects;
  for (const Json& e : p.effects) {
    const Json& change = e["changes"][p.bench.metric()];
    if (change.is_null() || change == 0.0 || e["cost_ratio"].is_null()) continue;
    effects.push_back({e["name"], {{e["cost_ratio"], std::abs(change.get<double>())}}, false});
  }
  std::string body =
      figures_html({chart_svg("What a digit costs", "instructions of the run", "error at the end", curves),
                    chart_svg("What effects change: the largest", "cost with it, without it = 1",
                              p.bench.metric() + " changes by, " + unit_of(p.bench.metric()), effects)});
  for (const auto& [title, rows] : price_sections(j)) {
    if (!rows.empty()) body += table_html(title, rows);
  }
  std::string detail = fmt::format("Tolerance {:.3g} {}.", p.tolerance, unit_of(p.bench.metric()));
  if (!p.left_out.empty())
    detail += fmt::format(" The fullest scene does without {}.", fmt::join(p.left_out, "; "));
  const auto tile = [&](double digit) {
    const IntegratorPrice* r = p.integrators.cheapest(digit);
    return std::array<std::string, 3>{
        fmt::format("Cheapest for {:g}", digit), r != nullptr ? name(r->stepping.method) : "none",
        r != nullptr ? fmt::format("{:.3g} s, {:.2g} s of CPU time", r->stepping.step, r->cpu_s) : ""};
  };
  return study_page("What accuracy costs in " + p.scene, command, body,
                    {StudyVerdict::Level::ok, verdict_text(p), detail, {tile(1e-3), tile(1e-6), tile(1e-9)}});
}

/// The minimal scene as a file. Files that it names are found from where it will lie.
std::string minimal_text(const PriceList& p, const AccuracyOptions& o) {
  toml::table t = p.variants.table(p.minimal.effects, p.minimal.stepping);
  for (const Companion& c : p.variants.scene(p.minimal.effects).companions) {
    const std::string key = c.key();
    const std::size_t dot = key.rfind('.');
    const auto from = std::filesystem::absolute(o.write).parent_path();
    t.at_path(key.substr(0, dot))
        .as_table()
        ->insert_or_assign(key.substr(dot + 1), std::filesystem::proximate(c.source, from).string());
  }
  std::string out = "# " + p.scene + ", the cheapest scene by esmc accuracy: " + verdict_text(p) + ".\n";
  out += fmt::format("# {}: {} here, {} in the fullest scene. Left out:\n", p.bench.metric(),
                     value_of(p.minimal.outcome, p.bench).dump(), value_of(p.whole, p.bench).dump());
  const auto& all = p.variants.candidates();
  for (std::size_t i = 0; i < all.size(); ++i) {
    if ((p.minimal.effects >> i & 1U) != 0 || (p.fullest >> i & 1U) == 0) continue;
    const Json& change = p.effects[i]["changes"][p.bench.metric()];
    const std::string by =
        change.is_null() ? "more than can be compared" : fmt::format("{:.3g}", change.get<double>());
    out += fmt::format("#   {} ({}), which alone changes {} by {}\n", all[i].type(), all[i].parameters(),
                       p.bench.metric(), by);
  }
  return out + toml_text(t);
}

void show_prices(const PriceList& p, const AccuracyOptions& o, OutputDirectory& out) {
  const Json j = price_document(p);
  std::string text;
  for (const auto& [title, rows] : price_sections(j)) {
    if (!rows.empty()) text += title + "\n\n" + markdown_table(rows) + "\n";
  }
  for (const std::string& why : p.left_out) text += "not in the fullest scene: " + why + "\n";
  text += verdict_text(p) + "\n";
  if (!o.write.empty()) print_or_write(minimal_text(p, o), o.write);
  publish({"accuracy", j, text, [&] { return price_page(p, j, o.command_line); }}, o.json, out);
  if (std::fflush(stdout) != 0) throw RunError("standard output could not be written");
}

}  // namespace

int run_price_list(const AccuracyOptions& o) {
  OutputDirectory out(o.out);
  out.spare(o.scene);
  toml::table table = parse_scene_file(o.scene, o.sets);
  const Scene scene = read_scene(o.scene, o.sets);
  refuse_overwrite("--write", o.write, files_of(scene));
  refuse_bus_effects(scene, "esmc accuracy has no bus");
  if (const std::string why = refusal_of(scene, false); !why.empty())
    throw InputError("", o.scene + ": esmc check refuses it: " + why);
  const std::string metric = !o.metric.empty()                             ? o.metric
                             : scene.reference.type == ReferenceType::none ? "end"
                                                                           : "rms_m";
  Bench bench(metric, 60 + (o.all_effects ? 300 : 12 * scene.effects.size()));
  Variants variants(std::move(table), o.scene, bench);
  PriceList p{printable(scene.name), bench, variants};
  (void)tolerance_of(o.tolerance, 0.0);  // refused before anything runs
  if (!scene.accuracy) require_sound(variants.run(variants.named()), bench, scene);
  p.integrators = price_integrators(scene, bench);
  if (scene.accuracy) {
    const IntegratorPrice* met = p.integrators.cheapest(*scene.accuracy);
    if (met == nullptr)
      throw RunError(fmt::format("simulation.accuracy = {} is met by no fixed step here", *scene.accuracy));
    variants.use(met->stepping);
    require_sound(variants.run(variants.named()), bench, scene);
  }
  if (o.all_effects) variants.offer_plausible();
  find_fullest(p);
  p.tolerance = tolerance_of(o.tolerance, size_of(p.whole, bench));
  price_effects(p);
  price_loop(p, scene);
  p.minimal = find_minimal(variants, p.fullest, p.tolerance);
  show_prices(p, o, out);
  return 0;
}

}  // namespace esmc::host
