#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "host_sim/drives/placed_axes.hpp"
#include "host_sim/effects/shaft_sensor.hpp"
#include "host_sim/live/session.hpp"
#include "host_sim/loop/halves.hpp"

namespace esmc::host {
namespace {

/// The text of each table of a scene as run, by its first name; keys above all tables stand for themselves.
std::map<std::string, std::string> tables(const std::string& toml) {
  std::map<std::string, std::string> out;
  std::string table;
  for (std::size_t at = 0; at < toml.size();) {
    const std::size_t end = std::min(toml.find('\n', at), toml.size());
    const std::string line = toml.substr(at, end - at);
    at = end + 1;
    if (line.empty()) continue;
    const std::size_t name = line.find_first_not_of('[');
    if (name > 0) table = line.substr(name, line.find_first_of(".]", name) - name);
    out[table.empty() ? line.substr(0, line.find(' ')) : table] += line + "\n";
  }
  return out;
}

std::set<std::string> changed_tables(const Scene& from, const Scene& to) {
  std::set<std::string> out;
  const auto a = tables(from.toml), b = tables(to.toml);
  const auto compare = [&](const auto& x, const auto& y) {
    for (const auto& [name, text] : x) {
      const auto other = y.find(name);
      if (other == y.end() || other->second != text) out.insert(name);
    }
  };
  compare(a, b);
  compare(b, a);
  const auto files = [&](const Scene& x, const Scene& y) {  // in the text they have the same names
    for (const Companion& c : x.companions) {
      if (std::ranges::none_of(y.companions,
                               [&](const Companion& o) { return o.name == c.name && o.text == c.text; }))
        out.insert(c.key().substr(0, c.key().find('.')));
    }
  };
  files(from, to);
  files(to, from);
  return out;
}

bool same_sensors(const Scene& from, const Scene& to) {
  const SensorEffects a(from.effects), b(to.effects);
  return a.encoder == b.encoder && a.noise == b.noise && a.bias == b.bias && a.delay == b.delay;
}

/// s, at most 1. On the way onto a reference that turns, the speed that is missing at first is made up for;
/// where that takes longer than half a turn, the way leads far off.
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
        "'command.arm_by_link': a live bench has no supervisor computer that could arm it; set it to false");
  }
  if (!scene.reference.join) scene.reference.join = usual_join(scene.reference);
}

RestartLevel what_it_takes(const Scene& from, const Scene& to) {
  if (from.type != to.type) throw InputError("", "'mechanism.type': another mechanism needs another bench");
  const auto changed = changed_tables(from, to);
  if (changed.contains("mechanism") || changed.contains("initial")) return RestartLevel::home;
  static const std::set<std::string> of_the_plant{"effects", "simulation", "name"};
  const bool plant =
      std::ranges::all_of(changed, [](const std::string& t) { return of_the_plant.contains(t); });
  if (!plant || !same_sensors(from, to) || (to.model.exact_friction && changed.contains("effects")))
    return RestartLevel::restart;
  return RestartLevel::nothing;
}

InjectOrder usual_injection(const InjectionRow& row, std::size_t drive) {
  constexpr int for_ever = 1'000'000;
  InjectOrder o{&row, drive, row.longest == 0 ? for_ever : row.longest, 0.5, 0};
  switch (row.kind) {
    case Injected::scattered_loss:
      o.amount = 0.4;
      break;
    case Injected::delay:
      o.amount = 2.0;
      break;
    case Injected::denormal:
      o.amount = 1e-40;
      break;
    case Injected::huge:
      o.amount = 1e6;
      break;
    case Injected::sensor_jump:
      o.amount = 0.5;
      break;
    case Injected::sensor_step:
      o.amount = 0.02;
      break;
    case Injected::flood:
      o.amount = 2000.0;
      break;
    default:
      break;
  }
  return o;
}

bool can_inject(const InjectionRow& row, Protocol protocol) {
  const bool begins_later = (row.phases & (1U << static_cast<unsigned>(Phase::running))) != 0;
  return row.kind != Injected::nothing && begins_later && possible(row, dialect(protocol), {});
}

bool can_inject_from_outside(const InjectionRow& row) {
  switch (row.kind) {
    case Injected::controller_death:
    case Injected::controller_late:
    case Injected::controller_bus_off:
    case Injected::queue_full:
    case Injected::enable_open:
    case Injected::flood:  // of a real interface: not through one of its nodes
      return false;
    default:
      return true;
  }
}

}  // namespace esmc::host
