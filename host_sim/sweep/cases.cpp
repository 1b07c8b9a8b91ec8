#include "host_sim/sweep/cases.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <exception>
#include <set>
#include <span>
#include <sstream>
#include <utility>

#include "host_sim/error.hpp"
#include "host_sim/scene/fields.hpp"
#include "host_sim/scene/toml_text.hpp"

namespace esmc::host {
namespace {

constexpr std::string_view plant_prefix = "plant.";
constexpr const char* key_characters = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-.";
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
/// besides. In a scene that is settable() the reader checks their range and what CaseScenes::bind checks
/// again: legs that can move, and the start.
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

std::string override_of(const std::string& key, const SweepValue& v) {
  if (key.find_first_not_of(key_characters) != std::string::npos)
    throw InputError("", fmt::format("there is no '{}'", key));
  toml::table value;
  std::visit([&](const auto& x) { value.insert("v", x); }, v);
  const std::string text = toml_text(value);  // v = VALUE, and the end of the line
  return table_key(key) + "=" + text.substr(4, text.size() - 5);
}

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

/// The node of a part of a key: an effect goes by its type, entries of lists count from 1.
const toml::node* child(const toml::node* of, const std::string& part) {
  if (of == nullptr || of->is_table()) return of != nullptr ? of->as_table()->get(part) : nullptr;
  const toml::array* a = of->as_array();
  if (a == nullptr) return nullptr;
  std::size_t n = 0;
  const auto [end, error] = std::from_chars(part.data(), part.data() + part.size(), n);
  if (error == std::errc() && end == part.data() + part.size() && n > 0)
    return n <= a->size() ? a->get(n - 1) : nullptr;
  for (const toml::node& item : *a) {
    const toml::table* t = item.as_table();
    if (t != nullptr && (*t)["type"].value<std::string>() == part) return &item;
  }
  return nullptr;
}

double nominal_number(const toml::table& root, const Vary& v) {
  const toml::node* node = &root;
  bool both = false;
  std::istringstream key(table_key(v.key));
  for (std::string part; std::getline(key, part, '.');) {
    if (std::exchange(both, false)) continue;  // the number of a leg that is one for both
    const toml::node* next = child(node, part);
    both = next == nullptr && part == "legs";
    node = both ? child(node, "leg") : next;
  }
  if (node == nullptr || !node->is_number())
    throw InputError(v.where, fmt::format("'{}' has a factor, but the scene gives no number there", v.key));
  return *node->value<double>();
}

/// Whether the reader checks no more of the numbers that can be set than bind() does, and derives no more
/// from them.
bool settable(const Scene& s) {
  return !s.believed && !s.uncertainty && !s.command && !has_elbow_rotors(s.mechanism) &&
         !find_effect<EndStops>(s.effects) && s.reference.type != ReferenceType::program && !s.predictor &&
         !(s.disturbance_observer > 0.0) && s.reaching != ReachingChoice::super_twisting;
}

/// Whether all bars of a mechanism can move, also as the factors of the controller's model have them, without
/// the rotors that may be all their inertia.
bool movable(const Scene& s, const FiveBarParams<double>& p) {
  for (std::size_t j = 0; j < p.legs.size(); ++j) {
    LegParams<double> leg = p.legs[j];
    if (s.rotor_inertia[j] > 0.0) leg.J1 = 0.0;
    if (check(leg) != ParamError::none) return false;
    for (const LegKey& k : std::span(leg_keys).last<4>()) leg.*k.value *= s.model.*k.factor;
    if (check(leg) != ParamError::none) return false;
  }
  return true;
}

}  // namespace

struct CaseScenes::Tables {
  toml::table file;
  Scene nominal;
};

CaseScenes::CaseScenes(const SweepSpec& spec) : spec_(&spec) {
  auto tables = std::make_shared<Tables>();
  toml::table whole;
  try {
    whole = parse_scene_file(spec.scene, spec.sets);
    // Parsed anew: a copy of a table has lost the lines that errors name.
    tables->nominal = read_scene_table(parse_scene_file(spec.scene, spec.sets), spec.scene);
  } catch (const InputError& e) {
    if (!std::string_view(e.what()).starts_with("--set ")) throw;
    throw InputError(spec.sets_where, e.what());
  }
  std::vector<std::string> effects;
  if (const toml::array* list = whole["effects"].as_array()) {
    for (const toml::node& e : *list) effects.push_back(e.as_table()->at("type").value_or(std::string()));
  }
  refuse_overlaps(spec.vary, effects);
  tables->file = parse_scene_file(spec.scene, {});
  tables_ = tables;
  const Scene& nominal = tables->nominal;
  assembly_mode_given_ = whole["mechanism"]["assembly_mode"].is_string();
  for (std::size_t a = 0; a < spec.vary.size(); ++a) {
    const Vary& v = spec.vary[a];
    const Axis& axis = spec.design.axes()[a];
    Bound b;
    b.plant = is_plant(v.key);
    any_plant_ = any_plant_ || b.plant;
    assembly_mode_given_ = assembly_mode_given_ || v.key == "mechanism.assembly_mode";
    if (v.factor) b.nominal = nominal_number(whole, v);
    const bool numbers = std::all_of(v.values.begin(), v.values.end(), [](const SweepValue& x) {
      return std::holds_alternative<double>(x) || std::holds_alternative<std::int64_t>(x);
    });
    if (numbers) b.binding = find_binding(v.key, nominal);
    bound_.push_back(b);
    any_mechanism_ = any_mechanism_ || (b.binding.set != nullptr && !v.key.starts_with("control."));
    if (axis.in_order) {
      try_some(a);
    } else if (v.values.empty()) {
      for (const double x : {axis.from, axis.to}) try_value(a, v.factor ? x * b.nominal : x);
    } else {
      for (const SweepValue& x : v.values) try_value(a, x);
    }
  }
}

const Scene& CaseScenes::nominal() const { return tables_->nominal; }

void CaseScenes::read_always() {
  for (Bound& b : bound_) b.binding.set = nullptr;
  read_for_.reset();
}

/// A value on its own, before thousands of cases meet it.
void CaseScenes::try_value(std::size_t axis, const SweepValue& x) const {
  const Vary& v = spec_->vary[axis];
  try {
    (void)read_with({override_of(v.key, x)});
  } catch (const InputError& e) {
    std::string why = e.what();
    try {  // with the lines of the file, which copies of its table have lost
      std::vector<std::string> sets = spec_->sets;
      sets.push_back(override_of(v.key, x));
      (void)read_scene_table(parse_scene_file(spec_->scene, sets), spec_->scene);
    } catch (const InputError& again) {
      why = again.what();
    }
    throw InputError(v.where, fmt::format("{} = {}: {}", v.key, text_of(x), why));
  }
}

/// Of a value per case one that is refused makes its case impossible, wherever it stands. Where all of them
/// are, or the first thousand in their order, the key is wrong.
void CaseScenes::try_some(std::size_t axis) const {
  const std::vector<SweepValue>& values = spec_->vary[axis].values;
  const std::set<SweepValue> different(values.begin(), values.end());
  std::exception_ptr first;
  std::size_t tried = 0;
  for (const SweepValue& x : different) {
    try {
      return try_value(axis, x);
    } catch (const InputError&) {
      if (!first) first = std::current_exception();
    }
    if (++tried == 1000) break;
  }
  if (first) std::rethrow_exception(first);
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

Scene CaseScenes::read_with(const std::vector<std::string>& own) const {
  toml::table table = tables_->file;
  merge_overrides(table, spec_->sets);
  merge_overrides(table, own);
  Scene scene = read_scene_table(std::move(table), spec_->scene);
  refuse_bus_effects(scene, "esmc sweep has no bus");
  return scene;
}

/// The scene of a case as a single run reads it, with all keys or without those that can be set.
Scene CaseScenes::read(std::uint64_t index, bool all) const {
  std::vector<std::string> own;
  const auto add = [&](bool of_plant) {
    const std::size_t before = own.size();
    for (std::size_t a = 0; a < bound_.size(); ++a) {
      if (bound_[a].plant != of_plant || !(all || bound_[a].binding.set == nullptr)) continue;
      own.push_back(override_of(spec_->vary[a].key,
                                spec_->vary[a].factor ? SweepValue(number(index, a)) : value(index, a)));
    }
    return own.size() > before;
  };
  add(false);
  Scene scene = read_with(own);
  if (!add(true)) return scene;
  const FiveBarParams<double> believed = scene.believed.value_or(scene.mechanism);
  scene = read_with(own);
  scene.believed = believed;
  return scene;
}

/// Sets the numbers of a case in its base. False: the reader is to say whether there is such a scene.
bool CaseScenes::bind(std::uint64_t index, Scene& scene) const {
  for (const bool of_plant : {false, true}) {
    if (of_plant && any_plant_) scene.believed = scene.mechanism;
    for (std::size_t a = 0; a < bound_.size(); ++a) {
      const Binding& b = bound_[a].binding;
      if (b.set == nullptr || bound_[a].plant != of_plant) continue;
      const double x = number(index, a);
      if (!(x <= b.high) || (b.low_open ? !(x > b.low) : !(x >= b.low))) return false;
      b.set(scene, x);
    }
  }
  if (!movable(scene, scene.mechanism) || (scene.believed && !movable(scene, *scene.believed))) return false;
  if (!any_mechanism_) return true;
  if (!assembly_mode_given_) scene.assembly_mode = 0;
  set_start(scene, scene.control_where, scene.reference_where);
  return true;
}

/// Makes scene_ of a case from what was read for the last one. False: that is not enough.
bool CaseScenes::set_numbers(std::uint64_t index) {
  std::vector<SweepValue> values;
  bool any = false;
  for (std::size_t a = 0; a < bound_.size(); ++a) {
    if (bound_[a].binding.set == nullptr) values.push_back(value(index, a));
    any = any || bound_[a].binding.set != nullptr;
  }
  if (!read_for_ || values != *read_for_) {
    base_.reset();
    read_for_ = std::move(values);
    try {
      base_ = read(index, false);
    } catch (const InputError&) {  // perhaps not without the others
    }
    if (any && base_ && !settable(*base_)) base_.reset();
  }
  scene_ = base_;
  return base_ && (!any || bind(index, *scene_));
}

const Scene& CaseScenes::at(std::uint64_t index) {
  if (!set_numbers(index)) scene_ = read(index, true);
  scene_->seed = seed(index);
  return *scene_;
}

std::uint64_t CaseScenes::seed(std::uint64_t index) const {
  return random_bits(spec_->seed, noise_stream, index % spec_->design.samples());
}

}  // namespace esmc::host
