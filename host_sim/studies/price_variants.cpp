/// Variants of a scene, and their outcomes.

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "host_sim/error.hpp"
#include "host_sim/loop/run.hpp"
#include "host_sim/parallel.hpp"
#include "host_sim/problems/work_precision.hpp"
#include "host_sim/scene/reader.hpp"
#include "host_sim/studies/ledger.hpp"
#include "host_sim/studies/price.hpp"

namespace esmc::host {
namespace {

constexpr const char* gear_keys[] = {"stiffness", "damping", "rotor_inertia"};

toml::table* entry_of(toml::array& effects, std::string_view type) {
  for (toml::node& item : effects) {
    if (item.as_table()->get("type")->value_or<std::string_view>("") == type) return item.as_table();
  }
  return nullptr;
}

/// Play beside a spring takes that one's stiffness, damping and rotor; alone it has its own.
void share_gear(toml::array& effects, const std::vector<Candidate>& all) {
  toml::table* play = entry_of(effects, Backlash::type);
  if (play == nullptr) return;
  if (entry_of(effects, JointFlexibility::type) != nullptr) {
    for (const char* key : gear_keys) play->erase(key);
    return;
  }
  for (const Candidate& c : all) {
    if (c.type() != JointFlexibility::type || play->contains("stiffness")) continue;
    for (const char* key : gear_keys) {
      const toml::node* own = c.entry.get(key);
      if (own != nullptr && own->is_array()) own = own->as_array()->get(0);
      if (own != nullptr) play->insert_or_assign(key, *own);
    }
  }
}

}  // namespace

bool Outcome::sound() const {
  return fault.empty() && !q.empty() && std::ranges::all_of(q, [](double v) { return std::isfinite(v); });
}

double end_distance(const Outcome& a, const Outcome& b) {
  if (a.q.empty() || a.q.size() != b.q.size()) return no_distance;
  double out = 0.0;
  for (std::size_t i = 0; i < a.q.size(); ++i) {
    const double d = std::abs(a.q[i] - b.q[i]);
    out = std::isnan(d) ? no_distance : std::max(out, d);
  }
  return out;
}

double Bench::distance(const Outcome& a, const Outcome& b) const {
  if (!a.sound() || !b.sound()) return no_distance;
  if (of_end()) return end_distance(a, b);
  const double d = std::abs(a.value - b.value);
  return std::isnan(d) ? no_distance : d;
}

Outcome Bench::run(const Scene& scene, bool single_precision) {
  Outcome out;
  out.cost = counted_cost(scene);
  const double begin = thread_cpu_s();
  try {
    const Trace t = run_case(scene, true, single_precision);
    out.q = t.end.q;
    out.states = t.end.state_dimension;
    if (!t.end.faults.empty()) out.fault = t.end.faults.front().name;
    const nlohmann::ordered_json tracking = t.statistics.tracking();
    if (tracking.is_object() && tracking.contains(metric_) && tracking[metric_].is_number())
      out.value = tracking[metric_].get<double>();
  } catch (const InputError& e) {
    out.fault = e.what();
  }
  out.cpu_s = thread_cpu_s() - begin;
  const std::lock_guard lock(mutex_);
  if (stop_requested()) throw Interrupted(fmt::format("interrupted after {} runs", runs_));
  progress_.show(std::min(++runs_, expected_));
  return out;
}

Variants::Variants(toml::table table, std::string file, Bench& bench)
    : table_(std::move(table)), file_(std::move(file)), bench_(bench) {
  if (const toml::array* effects = table_["effects"].as_array()) {
    for (const toml::node& item : *effects) candidates_.push_back({*item.as_table(), true});
  }
  named_ = (Subset{1} << candidates_.size()) - 1;
}

void Variants::offer_plausible() {
  for (Candidate& c : plausible_effects(scene(named_))) candidates_.push_back(std::move(c));
}

toml::table Variants::table(Subset effects, const std::optional<Stepping>& stepping) const {
  toml::table out = table_;
  toml::array list;
  for (std::size_t i = 0; i < candidates_.size(); ++i) {
    if ((effects >> i & 1U) == 0) continue;
    toml::table entry = candidates_[i].entry;
    entry.is_inline(false);
    list.push_back(std::move(entry));
  }
  share_gear(list, candidates_);
  out.erase("effects");
  if (!list.empty()) out.insert("effects", std::move(list));
  if (const auto& s = stepping ? stepping : stepping_) {
    toml::table& simulation = *out["simulation"].as_table();
    simulation.erase("accuracy");
    simulation.insert_or_assign("integrator", name(s->method));
    simulation.insert_or_assign("step", s->step);
  }
  return out;
}

Scene Variants::scene(Subset effects, const std::optional<Stepping>& stepping) const {
  return read_scene_table(table(effects, stepping), file_);
}

const Outcome& Variants::run(Subset effects) {
  run_all({effects});
  return done_.at(effects);
}

void Variants::run_all(const std::vector<Subset>& some) {
  std::vector<std::pair<Subset, Outcome>> fresh;
  for (const Subset s : some) {
    if (!done_.contains(s)) fresh.emplace_back(s, Outcome());
  }
  run_each(processors(), fresh.size(), [&](std::uint64_t i) {
    try {
      fresh[i].second = bench_.run(scene(fresh[i].first));
    } catch (const InputError& e) {  // an impossible variant
      fresh[i].second.fault = e.what();
    }
    return true;
  });
  for (auto& [subset, outcome] : fresh) done_.emplace(subset, std::move(outcome));
}

std::optional<Scene> Variants::changed(const std::vector<std::string>& sets,
                                       const std::optional<Effect>& effect) const {
  try {
    Scene s = read_scene_table(parse_scene_text(toml_text(table(named_, {})), file_, sets), file_);
    if (effect) {
      std::erase_if(s.effects, [&](const Effect& e) { return e.index() == effect->index(); });
      s.effects.push_back(*effect);
    }
    return s;
  } catch (const InputError&) {
    return std::nullopt;
  }
}

}  // namespace esmc::host
