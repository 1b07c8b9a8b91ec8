#include "host_sim/scene/reader.hpp"

#include <fmt/format.h>

#include <cmath>
#include <filesystem>

namespace esmc::host {
namespace {

std::string one_line(std::string_view text) {
  std::string out;
  for (const char c : text) out += c == '\n' || c == '\r' ? ' ' : c;
  return out;
}

void merge(toml::table& into, toml::table&& from) {
  for (auto&& [k, node] : from) {
    const std::string key(k.str());
    toml::table* existing = into.contains(key) ? into[key].as_table() : nullptr;
    if (existing != nullptr && node.is_table()) {
      merge(*existing, std::move(*node.as_table()));
    } else {
      node.visit([&](auto& value) { into.insert_or_assign(key, std::move(value)); });
    }
  }
}

toml::table parse_override(const std::string& set) {
  const std::size_t equals = set.find('=');
  const std::string label = "--set " + one_line(set);
  if (equals == std::string::npos || equals == 0)
    throw InputError("", label + ": section.key=value is needed");
  try {
    return toml::parse(set, label);
  } catch (const toml::parse_error&) {
    // A bare word is taken for a string: --set control.law=smc
    const std::string word = set.substr(equals + 1);
    if (word.empty() ||
        word.find_first_not_of("abcdefghijklmnopqrstuvwxyz_0123456789.-+") != std::string::npos) {
      throw InputError("", label + ": not a TOML value");
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

}  // namespace

namespace {
template <class Parse>
toml::table parsed(const std::string& file, const Parse& parse, const std::vector<std::string>& sets) {
  try {
    toml::table root = parse();
    for (const std::string& set : sets) merge(root, parse_override(set));
    return root;
  } catch (const toml::parse_error& e) {
    throw InputError(fmt::format("{}:{}", file, e.source().begin.line),
                     "not valid TOML: " + one_line(e.description()));
  }
}
}  // namespace

toml::table parse_scene_file(const std::string& file, const std::vector<std::string>& sets) {
  if (!std::filesystem::is_regular_file(file)) throw InputError("", file + ": no such scene file");
  return parsed(
      file, [&] { return toml::parse_file(file); }, sets);
}

toml::table parse_scene_text(const std::string& text, const std::string& name,
                             const std::vector<std::string>& sets) {
  return parsed(
      name, [&] { return toml::parse(text, name); }, sets);
}

std::string place(const toml::node& node, const std::string& file) {
  const auto& source = node.source();
  if (source.path && source.path->starts_with("--set ")) return *source.path;
  return fmt::format("{}:{}", file, source.begin.line > 0 ? source.begin.line : 1);
}

std::string Section::where(const std::string& key) const {
  const toml::node* node = table_->get(key);
  return node != nullptr ? place(*node, file_) : where();
}

const toml::node* Section::find(const std::string& key, bool required) {
  asked_.insert(key);
  const toml::node* node = table_->get(key);
  if (node == nullptr && required) {
    throw InputError(where(), fmt::format("missing key '{}' ({})", full(key), allowed(spec(key))));
  }
  return node;
}

void Section::wrong(const toml::node& node, const std::string& key, const std::string& instead) const {
  throw InputError(place(node, file_),
                   fmt::format("'{}' must be {}", full(key), instead.empty() ? allowed(spec(key)) : instead));
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
  const std::string padded = fmt::format(" | {} | ", k.choices);
  if (!k.choices.empty() && (value->empty() || padded.find(" | " + *value + " | ") == std::string::npos)) {
    wrong(*node, key);
  }
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
  const std::string want = fmt::format("{} strings, each {}", size, allowed(spec(key)));
  if (list == nullptr || list->size() != size) wrong(*node, key, want);
  std::vector<std::string> out;
  for (const toml::node& item : *list) {
    const auto value = item.is_string() ? item.value<std::string>() : std::nullopt;
    const std::string padded = fmt::format(" | {} | ", spec(key).choices);
    if (!value || value->empty() || padded.find(" | " + *value + " | ") == std::string::npos)
      wrong(item, key, want);
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

std::vector<double> Section::each(const std::string& key, std::size_t count) {
  const toml::node* node = find(key, true);
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
                 schema.empty() ? (schema_.empty() ? key : schema_ + "." + key) : schema);
}

Section Section::required_section(const std::string& key) {
  auto s = section(key);
  if (!s) throw InputError(where(), fmt::format("missing table [{}]", full(key)));
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
                     schema.empty() ? (schema_.empty() ? key : schema_ + "." + key) : schema);
  }
  return out;
}

void Section::finish() const {
  for (auto&& [key, node] : *table_) {
    const std::string name(key.str());
    if (asked_.contains(name)) continue;
    std::string known;
    for (const std::string& a : asked_) known += (known.empty() ? "" : ", ") + a;
    throw InputError(place(node, file_),
                     fmt::format("unknown key '{}'; allowed here: {}", full(name), known));
  }
}

}  // namespace esmc::host
