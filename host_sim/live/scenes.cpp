/// Scenes of a live bench: reading, checks, what a change restarts, effects as text, faults to inject.

#include <algorithm>
#include <cmath>
#include <set>

#include "host_sim/controller/axes_config.hpp"
#include "host_sim/drives/placed_axes.hpp"
#include "host_sim/effects/shaft_sensor.hpp"
#include "host_sim/error.hpp"
#include "host_sim/live/live_api.hpp"
#include "host_sim/live/session.hpp"
#include "host_sim/loop/run.hpp"
#include "host_sim/record/recorder.hpp"
#include "host_sim/scene/toml_text.hpp"

namespace esmc::host {
namespace {

/// First names of what differs between two scenes as run: tables, keys above all tables, files.
std::set<std::string> changed_tables(const Scene& from, const Scene& to) {
  std::set<std::string> out;
  const auto differing = [&](const Scene& x, const Scene& y) {
    const toml::table a = toml::parse(x.toml), b = toml::parse(y.toml);
    for (auto&& [key, value] : a) {
      const toml::node* other = b.get(key);
      if (other == nullptr || toml_text(toml::table{{key, value}}) != toml_text(toml::table{{key, *other}}))
        out.emplace(key.str());
    }
    for (const Companion& c : x.companions) {  // in the text they have the same names
      if (std::ranges::none_of(y.companions,
                               [&](const Companion& o) { return o.name == c.name && o.text == c.text; }))
        out.insert(c.key().substr(0, c.key().find('.')));
    }
  };
  differing(from, to);
  differing(to, from);
  return out;
}

bool same_sensors(const Scene& from, const Scene& to) {
  const SensorEffects a(from.effects), b(to.effects);
  return a.encoder == b.encoder && a.noise == b.noise && a.bias == b.bias && a.delay == b.delay;
}

/// Time to join a reference, s, at most 1. On the way onto a reference that turns, the mechanism has to catch
/// up with it; where that takes longer than half a turn, it goes far off the reference.
double usual_join(const ReferenceScene& r) {
  constexpr double turn = 3.0;  // rad
  double fastest = r.type == ReferenceType::circle ? std::abs(r.speed) : 0.0;
  if (r.type == ReferenceType::joint_sine) fastest = std::max(std::abs(r.omega[0]), std::abs(r.omega[1]));
  return fastest > turn ? turn / fastest : 1.0;
}

}  // namespace

void prepare_live_scene(Scene& scene, bool controller_elsewhere) {
  if (std::ranges::any_of(scene.effects, acts_on_bus)) {
    refuse_bus_effects(scene, "a live bench disturbs its bus by faults that are injected");
  }
  if (controller_elsewhere) return;
  if (armed_by_link(scene)) {
    throw InputError(
        scene.control_where,
        "'command.arm': a live bench has no supervisor computer that could arm it; set it to \"start\"");
  }
  if (!scene.reference.join) scene.reference.join = usual_join(scene.reference);
}

RestartLevel restart_level(const Scene& from, const Scene& to) {
  if (from.type != to.type) throw InputError("", "'mechanism.type': another mechanism needs another bench");
  if (from.motors() != to.motors())
    throw InputError("", "'control.motors': other motors need another bench, whose log has their columns");
  const auto changed = changed_tables(from, to);
  if (changed.contains("mechanism") || changed.contains("initial")) return RestartLevel::home;
  static const std::set<std::string> of_the_plant{"effects", "simulation", "name"};
  const bool plant =
      std::ranges::all_of(changed, [](const std::string& t) { return of_the_plant.contains(t); });
  if (!plant || !same_sensors(from, to) || (to.model.exact_friction && changed.contains("effects")))
    return RestartLevel::restart;
  return RestartLevel::nothing;
}

Injection usual_injection(const InjectionRow& row, std::size_t drive) {
  constexpr std::pair<Injected, double> amounts[] = {
      {Injected::scattered_loss, 0.4}, {Injected::delay, 2.0},        {Injected::denormal, 1e-40},
      {Injected::huge, 1e6},           {Injected::sensor_step, 0.02}, {Injected::flood, 2000.0}};
  const auto* known = std::ranges::find(amounts, row.kind, &std::pair<Injected, double>::first);
  const double amount = known != std::end(amounts) ? known->second : 0.5;
  return {.row = &row, .length = row.longest == 0 ? for_ever : row.longest, .drive = drive, .amount = amount};
}

bool can_inject(const InjectionRow& row, Protocol protocol) {
  const bool begins_later = (row.phases & (1U << static_cast<unsigned>(Phase::running))) != 0;
  return row.kind != Injected::nothing && begins_later && possible(row, protocol_traits(protocol), {});
}

bool can_inject_from_outside(const InjectionRow& row) {
  // A flood is one of a real interface, not of one of its nodes.
  constexpr Injected of_the_controller[] = {Injected::controller_death,   Injected::controller_late,
                                            Injected::controller_bus_off, Injected::queue_full,
                                            Injected::enable_open,        Injected::flood};
  return std::ranges::find(of_the_controller, row.kind) == std::end(of_the_controller);
}

std::vector<EffectText> effect_texts(const std::string& toml) {
  const toml::table scene = toml::parse(toml);
  std::vector<EffectText> out;
  const toml::array* effects = scene["effects"].as_array();
  if (effects == nullptr) return out;
  for (const toml::node& effect : *effects) {
    EffectText text;
    for (auto&& [key, value] : *effect.as_table()) {
      if (key == "type") {
        text.type = value.value_or(std::string());
        continue;
      }
      const std::string line = toml_text(toml::table{{key, value}});
      text.parameters += (text.parameters.empty() ? "" : ", ") + line.substr(0, line.find('\n'));
    }
    out.push_back(std::move(text));
  }
  return out;
}

std::vector<std::string> with_set(std::vector<std::string> sets, const std::string& set) {
  const std::string key = set.substr(0, std::min(set.find('='), set.size()));
  std::erase_if(sets, [&](const std::string& s) { return s.substr(0, s.find('=')) == key; });
  sets.push_back(set);
  return sets;
}

Hand usual_hand(const Scene& scene) {
  const LegParams<double>& leg = scene.mechanism.legs[0];
  const double reach = leg.l1 + leg.l2;
  constexpr double share = 0.5, stretch = 0.15, damped = 0.02;  // of the torque; of the reach; s
  Hand h;
  h.most = share * *std::ranges::min_element(scene.torque_limit) / reach;
  h.stiffness = h.most / (stretch * reach);
  h.damping = damped * h.stiffness;
  return h;
}

std::shared_ptr<const Scene> read_live_scene(const RunOptions& o) {
  RunOptions paced = o;
  paced.realtime = o.bus != "virtual";  // as the controller on the other end is made
  auto scene = std::make_shared<Scene>(read_loop_scene(paced));
  prepare_live_scene(*scene, paced.realtime);
  require_confirmed(*scene);
  with_world(*scene, [&]<class World>(World) {
    require_reachable<World>(*scene, Pacing::lockstep);
    if (paced.realtime) return;
    // What no controller takes is refused here; designed gains are then known to the loop, which does not
    // wait.
    const auto reference = make_reference(*scene, Pacing::lockstep);
    (void)make_cycle_config<typename World::Mechanism>(*scene, Pacing::lockstep, reference);
  });
  return scene;
}

}  // namespace esmc::host
