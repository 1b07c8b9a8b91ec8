#include "host_sim/sweep/spec.hpp"

#include <fmt/format.h>

#include <toml++/toml.h>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <optional>
#include <set>
#include <sstream>

#include "host_sim/error.hpp"
#include "host_sim/scene/key.hpp"
#include "host_sim/scene/reader.hpp"

namespace esmc::host {
namespace {

/// A table of the specification. finish() refuses keys that were not read.
class Table {
 public:
  Table(const toml::table& table, std::string file, std::string name)
      : table_(&table), file_(std::move(file)), name_(std::move(name)) {}

  [[nodiscard]] const toml::node* get(const std::string& key) {
    asked_.push_back(key);
    return table_->get(key);
  }
  [[nodiscard]] std::string where(const toml::node* node = nullptr) const {
    return place(node != nullptr ? *node : *table_, file_);
  }
  [[noreturn]] void wrong(const std::string& key, const std::string& allowed) const {
    const toml::node* node = table_->get(key);
    const std::string full = name_.empty() ? key : name_ + "." + key;
    throw InputError(where(node),
                     fmt::format("{} '{}' ({})", node != nullptr ? "wrong" : "missing", full, allowed));
  }
  [[noreturn]] void fail(const std::string& what) const { throw InputError(where(), what); }

  std::optional<double> number(const std::string& key) {
    const auto v = read<double>(key, &toml::node::is_number, "a finite number");
    if (v && !std::isfinite(*v)) wrong(key, "a finite number");
    return v;
  }
  std::optional<std::uint64_t> count(const std::string& key, std::uint64_t low, std::uint64_t high) {
    const std::string allowed = fmt::format("an integer from {} to {}", low, high);
    const auto v = read<std::int64_t>(key, &toml::node::is_integer, allowed);
    if (!v) return std::nullopt;
    const auto n = static_cast<std::uint64_t>(*v);
    if (*v < 0 || n < low || n > high) wrong(key, allowed);
    return n;
  }
  bool flag(const std::string& key) {
    return read<bool>(key, &toml::node::is_boolean, "true or false").value_or(false);
  }
  std::optional<std::string> text(const std::string& key) {
    return read<std::string>(key, &toml::node::is_string, "a string");
  }
  std::vector<std::string> texts(const std::string& key, const toml::array* list,
                                 const std::string& allowed) const {
    std::vector<std::string> out;
    if (list == nullptr) wrong(key, allowed);
    for (const toml::node& item : *list) {
      if (!item.is_string()) wrong(key, allowed);
      out.push_back(*item.value<std::string>());
    }
    return out;
  }
  void finish() const {
    for (auto&& [k, node] : *table_) {
      const std::string key(k.str());
      if (std::ranges::count(asked_, key) > 0) continue;
      const std::string close = nearest(key, asked_);
      throw InputError(where(&node),
                       fmt::format("unknown key '{}'; {}", name_.empty() ? key : name_ + "." + key,
                                   close.empty() ? fmt::format("allowed: {}", fmt::join(asked_, ", "))
                                                 : "did you mean " + close + "?"));
    }
  }

 private:
  template <class T>
  std::optional<T> read(const std::string& key, bool (toml::node::*is)() const noexcept,
                        const std::string& allowed) {
    const toml::node* node = get(key);
    if (node == nullptr) return std::nullopt;
    if (!(node->*is)()) wrong(key, allowed);
    return node->value<T>();
  }

  const toml::table* table_;
  std::string file_, name_;
  std::vector<std::string> asked_;
};

SweepValue value_of(const toml::node& node, const Table& t) {
  if (const auto b = node.is_boolean() ? node.value<bool>() : std::nullopt) return *b;
  if (const auto i = node.is_integer() ? node.value<std::int64_t>() : std::nullopt) return *i;
  if (const auto s = node.is_string() ? node.value<std::string>() : std::nullopt) return *s;
  const auto d = node.is_floating_point() ? node.value<double>() : std::nullopt;
  if (!d || !std::isfinite(*d))
    t.wrong("values", "an array of finite numbers, strings or booleans, none twice");
  return *d;
}

constexpr std::size_t most_values = 100'000, most_axes = 64;

/// values = [...], or from and to, or factor = [from, to] or a list of factors with `steps`.
void read_axis(Table& t, Sampling method, Vary& v, Axis& axis) {
  const auto from = t.number("from"), to = t.number("to");
  const toml::node *values = t.get("values"), *factor = t.get("factor");
  axis.logarithmic = t.flag("log");
  const auto steps = t.count("steps", 1, most_values);
  const bool cross = t.flag("cross");
  t.finish();
  if ((values != nullptr) + (factor != nullptr) + (from || to) != 1) {
    t.fail(fmt::format("'{}' varies by one of values = [...], from and to, factor = [from, to]", v.key));
  }
  axis.crossed = method == Sampling::grid || cross;
  if (values != nullptr) {
    const toml::array* list = values->as_array();
    if (list == nullptr || list->empty() || list->size() > most_values)
      t.wrong("values", fmt::format("an array of 1 to {} values", most_values));
    for (const toml::node& item : *list) {
      v.values.push_back(value_of(item, t));
      if (list->size() <= 1000 && std::ranges::count(v.values, v.values.back()) > 1)
        t.wrong("values", "none twice");
    }
    if (steps || axis.logarithmic) t.fail("steps and log go with a range, not with values");
    axis.listed = v.values.size();
    return;
  }
  if (factor != nullptr) {
    const toml::array* pair = factor->as_array();
    const bool two = pair != nullptr && pair->size() == 2 && (*pair)[0].is_number() && (*pair)[1].is_number();
    if (!two) t.wrong("factor", "[from, to], two numbers with from < to");
    v.factor = true;
    axis.from = *(*pair)[0].value<double>();
    axis.to = *(*pair)[1].value<double>();
  } else {
    if (!from || !to) t.fail(fmt::format("'{}' needs both from and to", v.key));
    axis.from = *from;
    axis.to = *to;
  }
  if (!std::isfinite(axis.from) || !std::isfinite(axis.to) || !(axis.from < axis.to))
    t.fail(fmt::format("'{}': the range must have finite ends, from < to", v.key));
  if (axis.logarithmic && !(axis.from > 0.0)) t.fail(fmt::format("'{}': log needs from > 0", v.key));
  if (axis.crossed && !steps) t.fail(fmt::format("'{}' is crossed: steps says in how many points", v.key));
  if (!axis.crossed && steps)
    t.fail(fmt::format("'{}' is sampled: steps goes with a grid or with cross = true", v.key));
  axis.steps = steps.value_or(0);
}

Objective find_objective(const std::string& where, const std::string& name) {
  std::vector<std::string> known(objective_count);
  std::ranges::transform(objectives, known.begin(),
                         [](const ObjectiveText& o) { return std::string(o.name); });
  const auto found = std::ranges::find(known, name);
  if (found != known.end()) return static_cast<Objective>(found - known.begin());
  const std::string close = nearest(name, known);
  refuse_at(where, "unknown objective '{}'; {}", name,
            close.empty() ? fmt::format("known: {}", fmt::join(known, ", ")) : "did you mean " + close + "?");
}

void read_objectives(Table& root, SweepSpec& spec) {
  const std::string allowed = "an array of names of objectives";
  const toml::node* list = root.get("objectives");
  if (list == nullptr) {
    spec.wanted = {Objective::settled_rms_m, Objective::settled_max_m, Objective::torque_activity_nm,
                   Objective::torque_max_nm, Objective::energy_j,      Objective::faulted};
  } else {
    for (const std::string& name : root.texts("objectives", list->as_array(), allowed)) {
      const Objective o = find_objective(root.where(list), name);
      if (std::ranges::count(spec.wanted, o) > 0) root.wrong("objectives", "none twice");
      spec.wanted.push_back(o);
    }
    if (spec.wanted.empty()) root.wrong("objectives", "one or more");
  }
  const toml::node* fronts = root.get("pareto");
  if (fronts == nullptr) return;
  const std::string want =
      "an array of arrays, each of two or more of the objectives, tick_ns not among them";
  if (fronts->as_array() == nullptr) root.wrong("pareto", want);
  for (const toml::node& item : *fronts->as_array()) {
    std::vector<std::size_t> front;
    for (const std::string& name : root.texts("pareto", item.as_array(), want)) {
      const Objective o = find_objective(root.where(fronts), name);
      const auto at = std::find(spec.wanted.begin(), spec.wanted.end(), o);
      if (at == spec.wanted.end() || o == Objective::tick_ns) root.wrong("pareto", want);
      front.push_back(static_cast<std::size_t>(at - spec.wanted.begin()));
    }
    if (std::set<std::size_t>(front.begin(), front.end()).size() != front.size() || front.size() < 2)
      root.wrong("pareto", want);
    spec.pareto.push_back(std::move(front));
  }
}

std::vector<Axis> read_axes(Table& root, SweepSpec& spec, Sampling method) {
  const toml::node* list = root.get("vary");
  const toml::array* tables = list != nullptr ? list->as_array() : nullptr;
  if (tables == nullptr || tables->empty() || tables->size() > most_axes)
    root.wrong("vary", fmt::format("1 to {} tables [[vary]]", most_axes));
  std::vector<Axis> axes;
  for (const toml::node& node : *tables) {
    if (node.as_table() == nullptr) root.wrong("vary", "tables [[vary]]");
    Table t(*node.as_table(), spec.file, "vary");
    Vary v;
    v.key = t.text("key").value_or("");
    v.where = t.where();
    if (v.key.empty())
      t.wrong("key",
              "a key of the scene, \"control.gain\", or of the true mechanism alone, \"plant.leg.m1\"");
    Axis axis;
    read_axis(t, method, v, axis);
    spec.vary.push_back(std::move(v));
    axes.push_back(axis);
  }
  return axes;
}

/// The entries that a key sets: `leg` stands for both legs, an effect's type for its number.
std::vector<std::string> places_of(const std::string& key, const std::vector<std::string>& effects) {
  for (std::size_t i = 0; i < effects.size(); ++i) {
    const std::string named = "effects." + effects[i];
    if (key == named || key.starts_with(named + "."))
      return {fmt::format("effects.{}{}", i + 1, key.substr(named.size()))};
  }
  for (const char* side : {"mechanism.", "plant."}) {
    const std::string leg = std::string(side) + "leg";
    if (key != leg && !key.starts_with(leg + ".")) continue;
    const std::string rest = key.substr(leg.size());
    return {std::string(side) + "legs.1" + rest, std::string(side) + "legs.2" + rest};
  }
  return {key};
}

/// Whether one of two keys sets what the other one sets, too.
bool overlap(const std::string& a, const std::string& b, const std::vector<std::string>& effects) {
  const auto in = [](const std::string& inner, const std::string& outer) {
    return inner == outer || inner.starts_with(outer + ".");
  };
  for (const std::string& x : places_of(a, effects)) {
    const auto sets_same = [&](const std::string& y) { return in(x, y) || in(y, x); };
    if (std::ranges::any_of(places_of(b, effects), sets_same)) return true;
  }
  return false;
}

}  // namespace

void refuse_overlaps(const std::vector<Vary>& vary, const std::vector<std::string>& effects) {
  for (auto v = vary.begin(); v != vary.end(); ++v) {
    for (auto other = vary.begin(); other != v; ++other) {
      if (other->key == v->key)
        throw InputError(v->where, fmt::format("'{}' varies twice, first at {}", v->key, other->where));
      if (overlap(v->key, other->key, effects))
        throw InputError(
            v->where, fmt::format("'{}' sets what '{}' at {} sets, too", v->key, other->key, other->where));
    }
  }
}

std::string text_of(const SweepValue& v) {
  return std::visit([](const auto& x) { return fmt::format("{}", x); }, v);
}

/// `text` for the folder of its results, whose scene.toml has what is set.
static std::string text_of_run(const std::string& text, const toml::node& scene, const toml::node* sets) {
  std::string out, line;
  std::istringstream lines(text);
  const auto within = [](const toml::node& node, toml::source_index n) {
    return n >= node.source().begin.line && n <= node.source().end.line;
  };
  for (toml::source_index n = 1; std::getline(lines, line); ++n) {
    if (n == scene.source().begin.line) out += "scene = \"scene.toml\"\n";
    if (!within(scene, n) && !(sets != nullptr && within(*sets, n))) out += line + "\n";
  }
  return out;
}

SweepSpec read_sweep(const std::string& file) {
  SweepSpec spec;
  spec.file = file;
  spec.text = read_text_file(file, "sweep specification");
  const toml::table table = parse_scene_text(spec.text, file, {});
  Table root(table, file, "");
  const auto scene = root.text("scene");
  if (!scene) root.wrong("scene", "the scene file, relative to this one");
  spec.scene = (std::filesystem::path(file).parent_path() / *scene).string();
  spec.text_of_run = text_of_run(spec.text, *root.get("scene"), root.get("set"));
  if (const toml::node* sets = root.get("set")) {
    spec.sets = root.texts("set", sets->as_array(),
                           "an array of \"section.key=value\", as --set of esmc sim takes them");
    spec.sets_where = place(*sets, file);
  }
  const toml::node* node = root.get("sample");
  if (node == nullptr || node->as_table() == nullptr)
    root.wrong("sample", "a table: method, and count unless that is grid");
  Table sample(*node->as_table(), file, "sample");
  const auto method = from_name<Sampling>(sample.text("method").value_or(""));
  if (!method) sample.wrong("method", std::string(choices<Sampling>));
  const bool grid = method == Sampling::grid;
  const auto count = sample.count("count", 1, Design::most_cases);
  if (grid && count) sample.fail("a grid has as many cases as it has points: leave out count");
  if (!grid && !count) sample.wrong("count", fmt::format("an integer from 1 to {}", Design::most_cases));
  spec.seed = sample.count("seed", 0, std::uint64_t{1} << 62U).value_or(1);
  sample.finish();
  read_objectives(root, spec);
  auto axes = read_axes(root, spec, *method);
  root.finish();
  spec.design = Design(*method, count.value_or(1), spec.seed, std::move(axes));
  if (spec.design.cases() == 0) sample.fail(fmt::format("more than {} cases", Design::most_cases));
  return spec;
}

}  // namespace esmc::host
