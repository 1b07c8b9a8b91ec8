#include "host_sim/scene/reader.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <sstream>

namespace esmc::host {
namespace {

std::string one_line(std::string_view text) {
  std::string out;
  for (const char c : text) out += c == '\n' || c == '\r' ? ' ' : c;
  return out;
}

constexpr std::string_view set_mark = "--set ";

bool from_set(const toml::node& node) {
  const auto& path = node.source().path;
  return path && path->starts_with(set_mark);
}

/// Takes keys out of a table that the file has put there; what another --set says stays, to be complained
/// about.
template <class Wanted>
void drop(toml::table& table, const Wanted& wanted) {
  std::vector<std::string> gone;
  for (auto&& [k, node] : table) {
    if (!from_set(node) && wanted(std::string(k.str()))) gone.emplace_back(k.str());
  }
  for (const std::string& key : gone) table.erase(key);
}

bool is_key(const std::string& path) {
  const auto is = [&](const Key& k) { return k.path == path; };
  return std::ranges::any_of(scene_keys(), is) || std::ranges::any_of(spatial_keys(), is);
}

constexpr std::size_t text_max = 1U << 20U;  // bytes of a scene; its largest table is a polyline
constexpr int depth_max = 32;                // the deepest key of a scene has four parts

/// Depth of what a parser that calls itself would go into: brackets that are open, and parts of one dotted
/// key.
struct Depth {
  int brackets = 0, parts = 0;
};

/// Refuses a text that is longer or nested deeper than any scene, before the parser sees it: it would run out
/// of stack. Strings and comments are skipped, everything else is left to the parser.
void require_shallow(const std::string& text, const std::string& name) {
  if (text.size() > text_max) {
    throw InputError("", fmt::format("{}: {} bytes, at most {} are taken", name, text.size(), text_max));
  }
  Depth depth;
  int line = 1;
  for (std::size_t at = 0; at < text.size(); ++at) {
    const char c = text[at];
    if (c == '"' || c == '\'') {
      const std::string three(3, c);
      const bool long_one = text.compare(at, 3, three) == 0;
      const std::string end = long_one ? three : std::string(1, c);
      for (at += end.size(); at < text.size() && text.compare(at, end.size(), end) != 0; ++at) {
        if (c == '"' && text[at] == '\\') ++at;
        if (at < text.size() && text[at] == '\n') {
          ++line;
          if (!long_one) break;
        }
      }
      at += end.size() - 1;
      continue;
    }
    if (c == '#') {
      at = std::min(text.find('\n', at), text.size()) - 1;
      continue;
    }
    if (c == '\n') ++line;
    if (c == '[' || c == '{') ++depth.brackets;
    if ((c == ']' || c == '}') && depth.brackets > 0) --depth.brackets;
    if (c == '.') {
      ++depth.parts;
    } else if (std::string_view("[]{},=\n").find(c) != std::string_view::npos) {
      depth.parts = 0;
    }
    if (depth.brackets > depth_max || depth.parts > depth_max) {
      throw InputError(name.starts_with(set_mark) ? name : fmt::format("{}:{}", name, line),
                       fmt::format("keys or brackets nested more than {} deep", depth_max));
    }
  }
}

/// What an override makes meaningless goes: the keys of the former `type`, the other ways to give a start,
/// the other way to choose a step. Returns true when the override stands for the whole table.
bool make_room(const std::string& name, toml::table& into, const toml::table& from) {
  const auto type = from["type"].value<std::string>(), former = into["type"].value<std::string>();
  if (type && former && *type != *former) {
    if (from.is_inline()) return true;
    drop(into, [&](const std::string& key) { return !is_key(name + "." + key); });
  }
  if (name == "simulation") {
    const bool fixed = from.contains("integrator") || from.contains("step");
    if (fixed) drop(into, [](const std::string& key) { return key == "accuracy"; });
    if (from.contains("accuracy"))
      drop(into, [](const std::string& key) { return key == "integrator" || key == "step"; });
  }
  if (name != "initial") return false;
  constexpr std::pair<std::string_view, std::string_view> ways[] = {
      {"at", ""}, {"position", "velocity"}, {"joints", "joint_rates"}};
  for (const auto& given : ways) {
    if (!from.contains(given.first)) continue;
    drop(into, [&](const std::string& key) {
      return std::ranges::any_of(
          ways, [&](const auto& w) { return w.first != given.first && (key == w.first || key == w.second); });
    });
  }
  return false;
}

void merge(toml::table& into, toml::table&& from, const std::string& above = "") {
  for (auto&& [k, node] : from) {
    const std::string key(k.str()), name = above.empty() ? key : above + "." + key;
    toml::table* existing = into.contains(key) ? into[key].as_table() : nullptr;
    if (existing != nullptr && node.is_table() && !make_room(name, *existing, *node.as_table())) {
      merge(*existing, std::move(*node.as_table()), name);
    } else {
      node.visit([&](auto& value) { into.insert_or_assign(key, std::move(value)); });
    }
  }
}

/// Every --set below a node, once each.
void collect_sets(const toml::node& node, std::vector<std::string>& out) {
  if (from_set(node)) {
    if (std::ranges::find(out, *node.source().path) == out.end()) out.push_back(*node.source().path);
    return;
  }
  if (const toml::table* t = node.as_table()) {
    for (auto&& [key, child] : *t) collect_sets(child, out);
  } else if (const toml::array* a = node.as_array()) {
    for (const toml::node& child : *a) collect_sets(child, out);
  }
}

toml::table parse_override(const std::string& set) {
  const std::size_t equals = set.find('=');
  const std::string label = std::string(set_mark) + one_line(set);
  if (equals == std::string::npos || equals == 0)
    throw InputError("", label + ": section.key=value is needed");
  require_shallow(set, label);
  try {
    return toml::parse(set, label);
  } catch (const toml::parse_error&) {
    // A bare word is taken for a string: --set control.law=smc
    constexpr const char* bare = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789._/+-";
    const std::string word = set.substr(equals + 1);
    if (word.empty() || word.find_first_not_of(bare) != std::string::npos) {
      throw InputError("", label + ": neither a TOML value nor a bare word (letters, digits, . _ / + -)");
    }
    try {
      return toml::parse(set.substr(0, equals + 1) + "\"" + word + "\"", label);
    } catch (const toml::parse_error&) {
      throw InputError("", label + ": section.key=value is needed");
    }
  }
}

std::string counts(const std::vector<std::size_t>& sizes) {
  std::string out;
  for (const std::size_t n : sizes) out += (out.empty() ? "" : " or ") + std::to_string(n);
  return out;
}

bool is_choice(const Key& k, const std::string& value) {
  std::string_view rest = k.choices;
  constexpr std::string_view between = " | ";
  while (true) {
    const std::size_t end = rest.find(between);
    if (rest.substr(0, end) == value) return !value.empty();
    if (end == std::string_view::npos) return false;
    rest.remove_prefix(end + between.size());
  }
}

/// First component of what stands behind `schema` in a path of the key table; empty when nothing does.
std::string_view child(std::string_view path, const std::string& schema) {
  if (!schema.empty()) {
    if (!path.starts_with(schema) || path.size() <= schema.size() || path[schema.size()] != '.') return {};
    path.remove_prefix(schema.size() + 1);
  }
  return path.substr(0, path.find_first_of(".["));
}

}  // namespace

std::string read_text_file(const std::string& file, const std::string& what) {
  if (std::filesystem::is_directory(file))
    throw InputError("", fmt::format("{}: is a directory, a {} is needed", file, what));
  if (!std::filesystem::is_regular_file(file))
    throw InputError("", fmt::format("{}: no such {}", file, what));
  std::ifstream in(file, std::ios::binary);
  std::string text(text_max + 1, '\0');
  in.read(text.data(), static_cast<std::streamsize>(text.size()));
  if (in.bad() || !in.is_open()) throw InputError("", file + ": cannot be read");
  if (in.gcount() > static_cast<std::streamsize>(text_max))
    throw InputError("", fmt::format("{}: more than {} bytes, no scene is that long", file, text_max));
  text.resize(static_cast<std::size_t>(in.gcount()));
  return text;
}

toml::table parse_scene_file(const std::string& file, const std::vector<std::string>& sets) {
  return parse_scene_text(read_text_file(file, "scene file"), file, sets);
}

toml::table parse_scene_text(const std::string& text, const std::string& name,
                             const std::vector<std::string>& sets) {
  require_shallow(text, name);
  try {
    toml::table root = toml::parse(text, name);
    for (const std::string& set : sets) merge(root, parse_override(set));
    return root;
  } catch (const toml::parse_error& e) {
    throw InputError(fmt::format("{}:{}", name, e.source().begin.line),
                     "not valid TOML: " + one_line(e.description()));
  }
}

std::string place(const toml::node& node, const std::string& file) {
  const auto& source = node.source();
  if (from_set(node)) return *source.path;
  return fmt::format("{}:{}", file, source.begin.line > 0 ? source.begin.line : 1);
}

std::string with_sets(const std::string& where, const std::vector<const toml::node*>& nodes) {
  std::vector<std::string> sets;
  for (const toml::node* node : nodes) {
    if (node != nullptr) collect_sets(*node, sets);
  }
  std::erase(sets, where);
  return sets.empty() ? where : where + " with " + fmt::format("{}", fmt::join(sets, ", "));
}

std::string Section::where() const { return with_sets(place(*table_, file_), {table_}); }

std::string Section::where(const std::string& key) const {
  const toml::node* node = table_->get(key);
  return node != nullptr ? with_sets(place(*node, file_), {node}) : where();
}

std::string Section::where(const std::string& key, const std::vector<std::string>& others) const {
  const toml::node* node = table_->get(key);
  std::vector<const toml::node*> nodes{node};
  for (const std::string& other : others) nodes.push_back(table_->get(other));
  return with_sets(place(node != nullptr ? *node : *table_, file_), nodes);
}

const toml::node* Section::find(const std::string& key, bool required) {
  asked_.insert(key);
  const toml::node* node = table_->get(key);
  if (node == nullptr && required) {
    reject_misspelt();
    throw InputError(where(), fmt::format("missing key '{}' ({})", full(key), allowed(spec(key))));
  }
  return node;
}

void Section::wrong(const toml::node& node, const std::string& key, const std::string& instead) const {
  throw InputError(place(node, file_),
                   fmt::format("'{}' must be {}", full(key), instead.empty() ? wanted(spec(key)) : instead));
}

void Section::fail(const std::string& key, const std::string& what) const {
  throw InputError(where(key), key.empty() ? what : fmt::format("'{}' {}", full(key), what));
}

double Section::checked(const toml::node& node, const std::string& key) const {
  const Key& k = spec(key);
  const auto value = node.value<double>();
  if (!value || node.is_boolean() || !std::isfinite(*value) || *value > k.high ||
      (k.low_open ? !(*value > k.low) : !(*value >= k.low))) {
    wrong(node, key);
  }
  return *value;
}

double Section::number(const std::string& key) {
  const Key& k = spec(key);
  const toml::node* node = find(key, k.fallback.empty());
  return node != nullptr ? checked(*node, key) : std::stod(std::string(k.fallback));
}

std::optional<double> Section::optional_number(const std::string& key) {
  const toml::node* node = find(key, false);
  if (node == nullptr) return std::nullopt;
  return checked(*node, key);
}

int Section::integer(const std::string& key) {
  const Key& k = spec(key);
  const toml::node* node = find(key, k.fallback.empty());
  if (node == nullptr) return std::stoi(std::string(k.fallback));
  if (!node->is_integer()) wrong(*node, key);
  return static_cast<int>(checked(*node, key));
}

bool Section::boolean(const std::string& key) {
  const toml::node* node = find(key, spec(key).fallback.empty());
  if (node == nullptr) return spec(key).fallback == "true";
  if (!node->is_boolean()) wrong(*node, key, "true or false");
  return *node->value<bool>();
}

std::optional<std::string> Section::optional_text(const std::string& key) {
  const toml::node* node = find(key, false);
  if (node == nullptr) return std::nullopt;
  const Key& k = spec(key);
  auto value = node->is_string() ? node->value<std::string>() : std::nullopt;
  if (!value) wrong(*node, key);
  if (!k.choices.empty() && !is_choice(k, *value)) wrong(*node, key);
  return value;
}

std::string Section::text(const std::string& key) {
  const Key& k = spec(key);
  find(key, k.fallback.empty());
  const auto value = optional_text(key);
  return value ? *value : std::string(k.fallback.substr(1, k.fallback.size() - 2));  // without its quotes
}

std::optional<std::vector<double>> Section::optional_numbers(const std::string& key,
                                                             const std::vector<std::size_t>& sizes) {
  const toml::node* node = find(key, false);
  if (node == nullptr) return std::nullopt;
  const toml::array* list = node->as_array();
  bool fits = false;
  for (const std::size_t n : sizes) fits = fits || (list != nullptr && list->size() == n);
  if (!fits) wrong(*node, key, fmt::format("{} numbers ({})", counts(sizes), allowed(spec(key))));
  std::vector<double> out;
  for (const toml::node& item : *list) out.push_back(checked(item, key));
  return out;
}

std::vector<double> Section::numbers(const std::string& key, const std::vector<std::size_t>& sizes) {
  const Key& k = spec(key);
  find(key, k.fallback.empty());
  const auto value = optional_numbers(key, sizes);
  return value ? *value : std::vector<double>(sizes.front(), 0.0);  // every default of a list is zeros
}

std::optional<std::vector<int>> Section::optional_integers(const std::string& key,
                                                           const std::vector<std::size_t>& sizes) {
  const toml::node* node = find(key, spec(key).fallback.empty());
  if (node == nullptr) return std::nullopt;
  const toml::array* list = node->as_array();
  bool fits = false;
  for (const std::size_t n : sizes) fits = fits || (list != nullptr && list->size() == n);
  if (!fits) wrong(*node, key, fmt::format("{} integers ({})", counts(sizes), allowed(spec(key))));
  std::vector<int> out;
  for (const toml::node& item : *list) {
    if (!item.is_integer()) wrong(item, key);
    out.push_back(static_cast<int>(checked(item, key)));
  }
  return out;
}

std::array<double, 2> Section::pair(const std::string& key) {
  const std::vector<double> v = numbers(key, {2});
  return {v[0], v[1]};
}

std::vector<std::array<double, 2>> Section::pairs(const std::string& key, std::size_t at_least) {
  const toml::node* node = find(key, spec(key).fallback.empty());
  std::vector<std::array<double, 2>> out;
  if (node == nullptr) return out;
  const toml::array* list = node->as_array();
  const std::string want = fmt::format("{} or more pairs [a, b] ({})", at_least, allowed(spec(key)));
  if (list == nullptr || list->size() < at_least) wrong(*node, key, want);
  for (const toml::node& item : *list) {
    const toml::array* two = item.as_array();
    if (two == nullptr || two->size() != 2) wrong(item, key, want);
    out.push_back({checked(*two->get(0), key), checked(*two->get(1), key)});
  }
  return out;
}

std::vector<std::string> Section::texts(const std::string& key, std::size_t size) {
  const toml::node* node = find(key, spec(key).fallback.empty());
  const toml::array* list = node != nullptr ? node->as_array() : nullptr;
  const std::string_view choices = spec(key).choices;
  const std::string first(choices.substr(0, choices.find(' ')));
  std::string one = "[\"" + std::string(choices) + "\"]";  // + | -  ->  ["+"] or ["-"]
  for (std::size_t at = 0; (at = one.find(" | ", at)) != std::string::npos;) one.replace(at, 3, "\"] or [\"");
  const std::string want = size == 1 ? one
                                     : fmt::format("an array of {}, each one of: {}; as in [\"{}\", \"{}\"]",
                                                   size, choices, first, first);
  if (list == nullptr || list->size() != size) wrong(*node, key, want);
  std::vector<std::string> out;
  for (const toml::node& item : *list) {
    const auto value = item.is_string() ? item.value<std::string>() : std::nullopt;
    if (!value || !is_choice(spec(key), *value)) wrong(item, key, want);
    out.push_back(*value);
  }
  return out;
}

std::array<double, 2> Section::per_kind(const std::string& key) {
  const Key& k = spec(key);
  const toml::node* node = find(key, k.fallback.empty());
  if (node == nullptr) {
    const double v = std::stod(std::string(k.fallback));
    return {v, v};
  }
  const toml::table* table = node->as_table();
  if (table == nullptr) {
    const double v = checked(*node, key);
    return {v, v};
  }
  if (table->size() != 2 || !table->contains("position") || !table->contains("angle")) wrong(*node, key);
  return {checked(*table->get("position"), key), checked(*table->get("angle"), key)};
}

bool Section::is_word(const std::string& key, const std::string& word) {
  const toml::node* node = find(key, false);
  return node != nullptr && node->is_string() && node->value<std::string>() == word;
}

std::optional<std::vector<double>> Section::number_or_pair(const std::string& key) {
  const toml::node* node = find(key, false);
  if (node == nullptr) return std::nullopt;
  if (node->is_array()) return optional_numbers(key, {2});
  return std::vector<double>{checked(*node, key)};
}

std::vector<double> Section::each(const std::string& key, std::size_t count) {
  const Key& k = spec(key);
  const toml::node* node = find(key, k.fallback.empty());
  if (node == nullptr) return std::vector<double>(count, std::stod(std::string(k.fallback)));
  if (!node->is_array()) return std::vector<double>(count, checked(*node, key));
  return *optional_numbers(key, {count});
}

std::optional<Section> Section::section(const std::string& key, const std::string& schema) {
  const toml::node* node = find(key, false);
  if (node == nullptr) return std::nullopt;
  if (!node->is_table()) {
    throw InputError(place(*node, file_), fmt::format("'{}' must be a table", full(key)));
  }
  return Section(*node->as_table(), file_, full(key),
                 schema.empty() ? (schema_.empty() ? key : schema_ + "." + key) : schema, keys_);
}

Section Section::required_section(const std::string& key) {
  auto s = section(key);
  if (!s) {
    reject_misspelt();
    throw InputError(place(*table_, file_), fmt::format("missing table [{}]", full(key)));
  }
  return *s;
}

std::vector<Section> Section::sections(const std::string& key, const std::string& schema) {
  std::vector<Section> out;
  const toml::node* node = find(key, false);
  if (node == nullptr) return out;
  const toml::array* list = node->as_array();
  if (list == nullptr)
    throw InputError(place(*node, file_), fmt::format("'{}' must be an array of tables", full(key)));
  for (std::size_t i = 0; i < list->size(); ++i) {
    const toml::table* table = list->get(i)->as_table();
    if (table == nullptr) {
      throw InputError(place(*list->get(i), file_),
                       fmt::format("'{}' must be an array of tables", full(key)));
    }
    out.emplace_back(*table, file_, fmt::format("{}[{}]", full(key), i),
                     schema.empty() ? (schema_.empty() ? key : schema_ + "." + key) : schema, keys_);
  }
  return out;
}

void Section::reject(const std::string& key, const std::vector<std::string>& known) const {
  std::string text = fmt::format("unknown key '{}'", full(key));
  const std::string close = nearest(key, known);
  // reference[circle].center, where the type is another one
  std::string_view owner;
  const std::string common = schema_.substr(0, schema_.find('['));
  for (const Key& k : keys_) {
    if (common != schema_ && k.path.starts_with(common + "[") && k.path.ends_with("]." + key)) owner = k.path;
  }
  if (!close.empty()) {
    text += fmt::format("; did you mean '{}'?", close);
  } else if (!owner.empty()) {
    owner = owner.substr(common.size() + 1);
    text += fmt::format("; it belongs to type = \"{}\"", owner.substr(0, owner.find(']')));
  }
  throw InputError(
      place(*table_->get(key), file_),
      text + (close.empty() ? "; " : " ") + fmt::format("allowed here: {}", fmt::join(known, ", ")));
}

void Section::reject_misspelt() const {
  std::set<std::string> known;
  for (const std::string& schema : schemas_) {
    for (const Key& k : keys_) {
      if (const std::string_view name = child(k.path, schema); !name.empty()) known.emplace(name);
    }
  }
  for (auto&& [key, node] : *table_) {
    const std::string name(key.str());
    if (!known.contains(name)) reject(name, {known.begin(), known.end()});
  }
}

void Section::finish() const {
  for (auto&& [key, node] : *table_) {
    const std::string name(key.str());
    if (!asked_.contains(name)) reject(name, {asked_.begin(), asked_.end()});
  }
}

}  // namespace esmc::host
