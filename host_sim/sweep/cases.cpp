#include "host_sim/sweep/cases.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <utility>

#include "host_sim/error.hpp"
#include "host_sim/scene/fields.hpp"

namespace esmc::host {
namespace {

constexpr std::string_view plant_prefix = "plant.";
bool is_plant(const std::string& key) { return key.starts_with(plant_prefix); }
std::string table_key(const std::string& key) {
  return is_plant(key) ? "mechanism." + key.substr(plant_prefix.size()) : key;
}

template <auto field>
void set(Scene& s, double v) {
  auto& to = field_of(s, field);
  if constexpr (std::is_same_v<decltype(to), PerKind&>) {
    to = {v, v};
  } else {
    to = v;
  }
}

/// Numbers of a Scene that a sweep sets without reading the scene again, by their keys; those of legs
/// besides. The reader checks their range and what CaseScenes::bind checks again: legs that can move, and the
/// start.
constexpr std::pair<std::string_view, void (*)(Scene&, double)> bindings[] = {
    {"mechanism.half_base", set<&FiveBarParams<double>::l0>},
    {"mechanism.effector_mass", set<&FiveBarParams<double>::m0>},
    {"control.model.half_base", set<&ModelFactors::half_base>},
    {"control.model.effector_mass", set<&ModelFactors::effector_mass>},
    {"control.model.gravity", set<&ModelFactors::gravity>},
    {"control.lambda", set<&Scene::lambda>},
    {"control.gain",
     [](Scene& s, double v) {
       set<&Scene::gain>(s, v);
       s.robust_gain = false;
     }},
    {"control.layer", set<&Scene::layer>},
    {"control.kp", set<&Scene::kp>},
    {"control.kd", set<&Scene::kd>},
    {"control.delay_ticks", set<&Scene::delay_ticks>},
    {"reference.radius", set<&ReferenceScene::radius>},
    {"reference.speed", set<&ReferenceScene::speed>},
    {"reference.phase", set<&ReferenceScene::phase>},
};

Binding::Set setter_of(const std::string& name) {
  for (const auto& [key, set] : bindings) {
    if (key == name) return set;
  }
  for (const auto& [part, value, factor] : leg_keys) {
    if (name == std::string("control.model.") + part)
      return [f = factor](Scene& s, double v) { s.model.*f = v; };
    for (const auto& [legs, first, end] : {std::tuple("mechanism.leg.", 0U, 2U),
                                           {"mechanism.legs.1.", 0U, 1U},
                                           {"mechanism.legs.2.", 1U, 2U}}) {
      if (name != std::string(legs) + part) continue;
      return [m = value, leg = first, last = end](Scene& s, double v) {
        const bool turns_rotor = m == &LegParams<double>::J1;
        for (unsigned i = leg; i < last; ++i)
          s.mechanism.legs[i].*m = turns_rotor ? v + s.rotor_inertia[i] : v;
      };
    }
  }
  return nullptr;
}

/// Null where the key has to be read.
Binding find_binding(const std::string& key, const Scene& nominal) {
  const std::string name = table_key(key);
  const Binding::Set set = setter_of(name);
  if (set == nullptr) return {};
  if (name.starts_with("reference.") && nominal.reference.type != ReferenceType::circle) return {};
  if (nominal.type != MechanismType::five_bar &&
      (name.starts_with("mechanism.legs") || name == "mechanism.half_base" ||
       name == "mechanism.effector_mass"))
    return {};
  std::string path = name;  // in the table of keys
  if (name.starts_with("mechanism.legs.")) path = "mechanism.leg." + name.substr(name.rfind('.') + 1);
  if (name.starts_with("reference.")) path = "reference[circle]" + name.substr(name.find('.'));
  const Key& k = find_key(path);
  return {set, k.low, k.high, k.low_open};
}

std::vector<std::string> parts_of(const std::string& key) {
  std::vector<std::string> out(1);
  for (const char c : key) {
    if (c == '.') {
      out.emplace_back();
    } else {
      out.back() += c;
    }
  }
  return out;
}

/// Counted from 1.
std::optional<std::size_t> entry(const std::string& part) {
  std::size_t n = 0;
  const auto [end, error] = std::from_chars(part.data(), part.data() + part.size(), n);
  if (error != std::errc() || end != part.data() + part.size() || n == 0) return std::nullopt;
  return n - 1;
}

/// leg = {...} for both legs, as two equal ones.
void spell_out_legs(toml::table& mechanism) {
  if (mechanism.get("leg") == nullptr || mechanism["leg"].as_table() == nullptr) return;
  const toml::table leg = *mechanism["leg"].as_table();
  mechanism.erase("leg");
  mechanism.insert_or_assign("legs", toml::array{leg, leg});
}

toml::node* child(toml::node& of, const std::string& part) {
  if (toml::table* t = of.as_table()) return t->get(part);
  toml::array* a = of.as_array();
  if (a == nullptr) return nullptr;
  if (const auto n = entry(part)) return *n < a->size() ? a->get(*n) : nullptr;
  for (toml::node& item : *a) {  // effects.TYPE
    const toml::table* t = item.as_table();
    if (t != nullptr && (*t)["type"].value<std::string>() == part) return &item;
  }
  return nullptr;
}

/// The node that holds the last part of a key; tables on the way are made.
toml::node& holder(toml::table& root, const std::vector<std::string>& parts, const std::string& key) {
  if (parts.size() > 2 && parts[0] == "mechanism" && parts[1] == "legs" &&
      root["mechanism"].as_table() != nullptr)
    spell_out_legs(*root["mechanism"].as_table());
  toml::node* at = &root;
  for (std::size_t i = 0; i + 1 < parts.size(); ++i) {
    toml::node* next = child(*at, parts[i]);
    if (next == nullptr && at->as_table() != nullptr) {
      at->as_table()->insert_or_assign(parts[i], toml::table{});
      next = at->as_table()->get(parts[i]);
    }
    if (next == nullptr)
      throw InputError("", fmt::format("the scene has no {} to go into for '{}'", parts[i], key));
    at = next;
  }
  return *at;
}

void put(toml::table& root, const std::string& key, const SweepValue& v) {
  const auto parts = parts_of(table_key(key));
  toml::node& at = holder(root, parts, key);
  if (toml::table* t = at.as_table()) {
    std::visit([&](const auto& x) { t->insert_or_assign(parts.back(), x); }, v);
  } else if (toml::array* a = at.as_array();
             a != nullptr && entry(parts.back()) && *entry(parts.back()) < a->size()) {
    std::visit(
        [&](const auto& x) {
          a->replace(a->cbegin() + static_cast<std::ptrdiff_t>(*entry(parts.back())), x);
        },
        v);
  } else {
    throw InputError("", fmt::format("the scene has no '{}'", key));
  }
}

double nominal_number(toml::table root, const Vary& v) {
  const auto parts = parts_of(table_key(v.key));
  toml::node* node = child(holder(root, parts, v.key), parts.back());
  if (node == nullptr || !node->is_number())
    throw InputError(v.where, fmt::format("'{}' has a factor, but the scene gives no number there", v.key));
  return *node->value<double>();
}

}  // namespace

struct CaseScenes::Tables {
  toml::table scene;
  Scene nominal;
  bool assembly_mode_given = false;
};

CaseScenes::CaseScenes(const SweepSpec& spec) : spec_(&spec) {
  auto tables = std::make_shared<Tables>();
  tables->scene = parse_scene_file(spec.scene, spec.sets);
  tables->nominal = read_scene_table(tables->scene, spec.scene);
  tables->assembly_mode_given = tables->scene["mechanism"]["assembly_mode"].is_string();
  tables_ = tables;
  const Scene& nominal = tables->nominal;
  for (std::size_t a = 0; a < spec.vary.size(); ++a) {
    const Vary& v = spec.vary[a];
    const Axis& axis = spec.design.axes()[a];
    Bound b;
    b.plant = is_plant(v.key);
    any_plant_ = any_plant_ || b.plant;
    if (v.factor) b.nominal = nominal_number(tables->scene, v);
    const bool numbers = std::all_of(v.values.begin(), v.values.end(), [](const SweepValue& x) {
      return std::holds_alternative<double>(x) || std::holds_alternative<std::int64_t>(x);
    });
    if (numbers) b.binding = find_binding(v.key, nominal);
    bound_.push_back(b);
    any_mechanism_ = any_mechanism_ || (b.binding.set != nullptr && !v.key.starts_with("control."));
    // Of a value per case bind() checks the range; a case that it refuses is impossible, not the axis.
    const std::size_t tried = axis.in_order && b.binding.set != nullptr ? 1 : v.values.size();
    for (std::size_t i = 0; i < tried; ++i) try_value(a, v.values[i]);
    if (v.values.empty()) {
      for (const double x : {axis.from, axis.to}) try_value(a, v.factor ? x * b.nominal : x);
    }
  }
}

const Scene& CaseScenes::nominal() const { return tables_->nominal; }

void CaseScenes::read_always() {
  for (Bound& b : bound_) b.binding.set = nullptr;
  any_mechanism_ = false;
  base_.reset();
}

/// A value on its own, before thousands of cases meet it.
void CaseScenes::try_value(std::size_t axis, const SweepValue& x) const {
  const Vary& v = spec_->vary[axis];
  try {
    toml::table table = tables_->scene;
    put(table, v.key, x);
    const Scene s = read_scene_table(std::move(table), spec_->scene);
    refuse_bus_effects(s, "esmc sweep has no bus");
  } catch (const InputError& e) {
    throw InputError(v.where, fmt::format("{} = {}: {}", v.key, text_of(x), e.what()));
  }
}

SweepValue CaseScenes::value(std::uint64_t index, std::size_t axis) const {
  const Vary& v = spec_->vary[axis];
  if (!v.values.empty()) return v.values[spec_->design.chosen(index, axis)];
  return spec_->design.value(index, axis);
}

double CaseScenes::mean_duration() const {
  for (std::size_t a = 0; a < spec_->vary.size(); ++a) {
    if (spec_->vary[a].key != "simulation.duration") continue;
    const std::uint64_t cases = spec_->design.cases();
    double sum = 0.0;
    for (std::uint64_t i = 0; i < cases; ++i) sum += number(i, a);
    return sum / static_cast<double>(cases);
  }
  return nominal().duration;
}

double CaseScenes::number(std::uint64_t index, std::size_t axis) const {
  const SweepValue v = value(index, axis);
  const double x = std::holds_alternative<double>(v) ? std::get<double>(v)
                                                     : static_cast<double>(std::get<std::int64_t>(v));
  return spec_->vary[axis].factor ? x * bound_[axis].nominal : x;
}

/// base_: the scene with everything that is not bound.
void CaseScenes::read(std::uint64_t index) {
  std::vector<SweepValue> values;
  for (std::size_t a = 0; a < bound_.size(); ++a) {
    if (bound_[a].binding.set != nullptr) continue;
    values.push_back(spec_->vary[a].factor ? SweepValue(number(index, a)) : value(index, a));
  }
  if (base_ && values == read_for_) return;
  base_.reset();
  toml::table table = tables_->scene;
  bool plant = false;
  const auto fill = [&](bool of_plant) {
    std::size_t next = 0;
    for (std::size_t a = 0; a < bound_.size(); ++a) {
      if (bound_[a].binding.set != nullptr) continue;
      const SweepValue& v = values[next++];
      plant = plant || bound_[a].plant;
      if (bound_[a].plant == of_plant) put(table, spec_->vary[a].key, v);
    }
  };
  fill(false);
  Scene scene = read_scene_table(table, spec_->scene);
  if (plant) {
    const FiveBarParams<double> believed = scene.believed.value_or(scene.mechanism);
    fill(true);
    scene = read_scene_table(std::move(table), spec_->scene);
    scene.believed = believed;
  }
  base_ = std::move(scene);
  read_for_ = std::move(values);
}

void CaseScenes::bind(std::uint64_t index, Scene& scene) const {
  const auto set = [&](std::size_t a) {
    const Binding& b = bound_[a].binding;
    const double x = number(index, a);
    if (!(x <= b.high) || (b.low_open ? !(x > b.low) : !(x >= b.low)))
      throw InputError(spec_->vary[a].where, spec_->vary[a].key + " is out of range");
    b.set(scene, x);
    if (scene.believed && !bound_[a].plant) {
      std::swap(scene.mechanism, *scene.believed);
      b.set(scene, x);
      std::swap(scene.mechanism, *scene.believed);
    }
  };
  for (const bool of_plant : {false, true}) {
    if (of_plant && any_plant_ && !scene.believed) scene.believed = scene.mechanism;
    for (std::size_t a = 0; a < bound_.size(); ++a) {
      if (bound_[a].binding.set != nullptr && bound_[a].plant == of_plant) set(a);
    }
  }
  if (!any_mechanism_) return;
  for (const LegParams<double>& leg : scene.mechanism.legs) {
    if (check(leg) == ParamError::no_inertia)
      throw InputError(spec_->scene, "a bar without mass and inertia cannot move");
  }
  if (!tables_->assembly_mode_given) scene.assembly_mode = 0;
  set_start(scene, scene.control_where, scene.reference_where);
}

const Scene& CaseScenes::at(std::uint64_t index) {
  read(index);
  scene_ = base_;
  bind(index, *scene_);
  scene_->seed = seed(index);
  return *scene_;
}

std::uint64_t CaseScenes::seed(std::uint64_t index) const {
  return random_bits(spec_->seed, noise_stream, index % spec_->design.samples());
}

}  // namespace esmc::host
