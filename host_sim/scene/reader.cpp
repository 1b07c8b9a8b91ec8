#include "host_sim/scene/reader.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <numeric>

namespace esmc::host {
namespace {

/// The words of "a | b | c".
std::vector<std::string> words_of(std::string_view choices) {
  std::vector<std::string> out;
  while (!choices.empty()) {
    const std::size_t bar = choices.find(" | ");
    out.emplace_back(choices.substr(0, bar));
    choices.remove_prefix(bar == std::string_view::npos ? choices.size() : bar + 3);
  }
  return out;
}

bool is_choice(const Key& k, const std::string& value) {
  const std::vector<std::string> words = words_of(k.choices);
  return std::ranges::find(words, value) != words.end();
}

/// First component of a path of the key table behind `schema`; empty: there is none.
std::string_view child(std::string_view path, const std::string& schema) {
  if (!schema.empty()) {
    if (!path.starts_with(schema) || path.size() <= schema.size() || path[schema.size()] != '.') return {};
    path.remove_prefix(schema.size() + 1);
  }
  return path.substr(0, path.find_first_of(".["));
}

/// What the key table allows, to read on with after an error.
double stand_in(const Key& k) {
  return !std::isfinite(k.low) || (k.low < 1.0 && k.high >= 1.0) ? 1.0 : k.low;
}
std::string first_choice(const Key& k) {
  return k.choices.empty() ? std::string() : words_of(k.choices).front();
}

double default_of(const Key& k) {
  return k.fallback.empty() || k.fallback == "-" ? stand_in(k) : std::stod(std::string(k.fallback));
}

}  // namespace

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
  if (node == nullptr && required && !unsure_ && !reject_misspelt()) {
    const std::size_t type = schema_.find('[');  // effects[encoder]
    const std::string of =
        type == std::string::npos
            ? ""
            : fmt::format(" of type = \"{}\"", schema_.substr(type + 1, schema_.find(']') - type - 1));
    note(where(), fmt::format("missing key '{}'{} ({})", full(key), of, allowed(spec(key))));
  }
  return node;
}

void Section::wrong(const toml::node& node, const std::string& key, const std::string& instead) const {
  std::string text = fmt::format("'{}' must be {}", full(key), instead.empty() ? wanted(spec(key)) : instead);
  const auto known = std::ranges::find(keys_, path(key), [](const Key& k) { return std::string(k.path); });
  if (known != keys_.end() && !known->choices.empty()) {  // a table has no entry
    unsure_ = true;
    const auto given = node.value_or(std::string());
    const std::string close = nearest(given, words_of(known->choices));
    if (!close.empty() && close != given) text += fmt::format("; did you mean {}?", close);
  }
  note(place(node, file_), text);
}

double Section::checked(const toml::node& node, const std::string& key) const {
  const Key& k = spec(key);
  const auto value = node.value<double>();
  if (!value || node.is_boolean() || !std::isfinite(*value) || *value > k.high ||
      (k.low_open ? !(*value > k.low) : !(*value >= k.low))) {
    wrong(node, key);
    return stand_in(k);
  }
  return *value;
}

void Section::read_fields(Scene& scene) {
  const std::string above = path("");
  for (const Key& k : keys_) {
    if (k.read == nullptr || !k.path.starts_with(above)) continue;
    const std::string key(k.path.substr(above.size()));
    if (key.find('.') == std::string::npos) k.read(*this, key, scene);
  }
}

double Section::number(const std::string& key) {
  const toml::node* node = find(key);
  return node != nullptr ? checked(*node, key) : default_of(spec(key));
}

std::optional<double> Section::optional_number(const std::string& key) {
  const toml::node* node = find(key, false);
  return node != nullptr ? std::optional(checked(*node, key)) : std::nullopt;
}

int Section::integer(const std::string& key) {
  const toml::node* node = find(key);
  if (node == nullptr) return static_cast<int>(default_of(spec(key)));
  if (!node->is_integer()) {
    wrong(*node, key);
    return static_cast<int>(stand_in(spec(key)));
  }
  return static_cast<int>(checked(*node, key));
}

bool Section::boolean(const std::string& key) {
  const toml::node* node = find(key);
  if (node == nullptr) return spec(key).fallback == "true";
  if (!node->is_boolean()) wrong(*node, key, "true or false");
  return node->is_boolean() && *node->value<bool>();
}

std::optional<std::string> Section::optional_text(const std::string& key) {
  const toml::node* node = find(key, false);
  if (node == nullptr) return std::nullopt;
  auto value = node->value_exact<std::string>();
  if (value && (spec(key).choices.empty() || is_choice(spec(key), *value))) return value;
  wrong(*node, key);
  return first_choice(spec(key));
}

std::string Section::text(const std::string& key) {
  find(key);
  const std::string_view quoted = spec(key).fallback;
  if (const auto value = optional_text(key)) return *value;
  return quoted.size() > 2 ? std::string(quoted.substr(1, quoted.size() - 2)) : first_choice(spec(key));
}

const toml::array* Section::list(const std::string& key, const toml::node* node,
                                 const std::vector<std::size_t>& sizes, const char* of) const {
  if (node == nullptr) return nullptr;
  const toml::array* list = node->as_array();
  if (list != nullptr && std::ranges::find(sizes, list->size()) != sizes.end()) return list;
  wrong(*node, key, fmt::format("{} {} ({})", fmt::join(sizes, " or "), of, allowed(spec(key))));
  return nullptr;
}

std::optional<std::vector<double>> Section::optional_numbers(const std::string& key,
                                                             const std::vector<std::size_t>& sizes) {
  const toml::node* node = find(key, false);
  if (node != nullptr && node->is_number() && spec(key).kind == "number or numbers")
    return std::vector<double>(sizes.front(), checked(*node, key));
  const toml::array* items = list(key, node, sizes, "numbers");
  if (items == nullptr) return std::nullopt;
  std::vector<double> out;
  for (const toml::node& item : *items) out.push_back(checked(item, key));
  return out;
}

std::vector<double> Section::numbers(const std::string& key, const std::vector<std::size_t>& sizes) {
  find(key);
  return optional_numbers(key, sizes)
      .value_or(std::vector<double>(sizes.front(), 0.0));  // every default is zeros
}

std::optional<std::vector<int>> Section::optional_integers(const std::string& key,
                                                           const std::vector<std::size_t>& sizes) {
  const toml::array* items = list(key, find(key, false), sizes, "integers");
  if (items == nullptr) return std::nullopt;
  std::vector<int> out;
  for (const toml::node& item : *items) {
    if (!item.is_integer()) wrong(item, key);
    out.push_back(static_cast<int>(item.is_integer() ? checked(item, key) : stand_in(spec(key))));
  }
  return out;
}

std::vector<int> Section::integers(const std::string& key, std::size_t size) {
  find(key, true);
  std::vector<int> stand_ins(size);
  std::iota(stand_ins.begin(), stand_ins.end(), 1);
  return optional_integers(key, {size}).value_or(stand_ins);
}

std::array<double, 2> Section::pair(const std::string& key) {
  const std::vector<double> v = numbers(key, {2});
  return {v[0], v[1]};
}

std::vector<std::array<double, 2>> Section::pairs(const std::string& key, std::size_t least) {
  const toml::node* node = find(key);
  std::vector<std::array<double, 2>> out;
  if (node == nullptr) return out;
  const toml::array* list = node->as_array();
  const std::string want = fmt::format("{} or more pairs [a, b] ({})", least, allowed(spec(key)));
  const std::vector<std::array<double, 2>> instead{{0.0, 1.0}, {0.0, 1.0}};
  if (list == nullptr || list->size() < least) {
    wrong(*node, key, want);
    return instead;
  }
  for (const toml::node& item : *list) {
    const toml::array* two = item.as_array();
    if (two == nullptr || two->size() != 2) {
      wrong(item, key, want);
      return instead;
    }
    out.push_back({checked(*two->get(0), key), checked(*two->get(1), key)});
  }
  return out;
}

std::vector<int> Section::signs(const std::string& key, std::size_t size) {
  const toml::node* node = find(key);
  const toml::array* list = node != nullptr ? node->as_array() : nullptr;
  const std::string want =
      size == 1 ? "[\"+\"] or [\"-\"]"
                : fmt::format("an array of {}, each one of: + | -; as in [\"+\", \"+\"]", size);
  std::vector<int> out(size, 1);
  if (list == nullptr || list->size() != size) {
    if (node != nullptr) wrong(*node, key, want);
    return out;
  }
  for (std::size_t i = 0; i < size; ++i) {
    const auto sign = list->get(i)->value_exact<std::string>();
    if (sign == "-") out[i] = -1;
    if (sign != "-" && sign != "+") wrong(*list->get(i), key, want);
  }
  return out;
}

std::array<double, 2> Section::per_kind(const std::string& key) {
  const toml::node* node = find(key);
  const toml::table* table = node != nullptr ? node->as_table() : nullptr;
  if (table == nullptr) {
    const double v = number(key);
    return {v, v};
  }
  if (table->size() != 2 || !table->contains("position") || !table->contains("angle")) {
    wrong(*node, key);
    return {1.0, 1.0};
  }
  return {checked(*table->get("position"), key), checked(*table->get("angle"), key)};
}

bool Section::is_word(const std::string& key, const std::string& word) {
  const toml::node* node = find(key, false);
  return node != nullptr && node->is_string() && node->value<std::string>() == word;
}

std::optional<std::vector<double>> Section::number_or_pair(const std::string& key) {
  const toml::node* node = find(key, false);
  if (node == nullptr) return std::nullopt;
  if (node->is_array()) return optional_numbers(key, {2}).value_or(std::vector<double>{0.0, 1.0});
  return std::vector<double>{checked(*node, key)};
}

std::vector<double> Section::each(const std::string& key, std::size_t count) {
  const toml::node* node = find(key);
  if (node == nullptr || !node->is_array()) return std::vector<double>(count, number(key));
  return optional_numbers(key, {count}).value_or(std::vector<double>(count, stand_in(spec(key))));
}

std::optional<Section> Section::section(const std::string& key) {
  const toml::node* node = find(key, false);
  if (node == nullptr) return std::nullopt;
  if (!node->is_table()) {
    wrong(*node, key, "a table");
    return std::nullopt;
  }
  return Section(*node->as_table(), file_, full(key), path(key), keys_, errors_);
}

Section Section::section_or_empty(const std::string& key) {
  static const toml::table empty;
  return section(key).value_or(Section(empty, file_, full(key), path(key), keys_, errors_));
}

Section Section::required_section(const std::string& key) {
  auto s = section(key);
  if (!s) {
    if (!has(key) && !reject_misspelt())
      note(place(*table_, file_), fmt::format("missing table [{}]", full(key)));
    throw_errors();
  }
  return *s;
}

std::vector<Section> Section::sections(const std::string& key, const std::string& schema) {
  std::vector<Section> out;
  const toml::node* node = find(key, false);
  if (node == nullptr) return out;
  const toml::array* list = node->as_array();
  if (list == nullptr) {
    wrong(*node, key, "an array of tables");
    return out;
  }
  for (std::size_t i = 0; i < list->size(); ++i) {
    const toml::table* table = list->get(i)->as_table();
    if (table == nullptr) {
      wrong(*list->get(i), key, "an array of tables");
      return out;
    }
    out.emplace_back(*table, file_, fmt::format("{}[{}]", full(key), i + 1),
                     schema.empty() ? path(key) : schema, keys_, errors_);
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
  std::string elsewhere;  // a key of a section, given without it
  for (const Key& k : keys_) {
    if (name_.empty() && k.path.ends_with("." + key) && k.path.find('[') == std::string_view::npos &&
        elsewhere.empty())
      elsewhere = k.path;
  }
  if (!elsewhere.empty()) {
    text += fmt::format("; did you mean '{}'?", elsewhere);
  } else if (!close.empty()) {
    text += fmt::format("; did you mean '{}'?", close);
  } else if (!owner.empty()) {
    owner = owner.substr(common.size() + 1);
    text += fmt::format("; it belongs to type = \"{}\"", owner.substr(0, owner.find(']')));
  }
  note(place(*table_->get(key), file_),
       text + (text.ends_with('?') ? " " : "; ") + fmt::format("allowed here: {}", fmt::join(known, ", ")));
}

bool Section::reject_misspelt() const {
  bool any = false;
  std::set<std::string> known;
  for (const std::string& schema : schemas_) {
    for (const Key& k : keys_) {
      if (const std::string_view name = child(k.path, schema); !name.empty()) known.emplace(name);
      const std::size_t end = k.path.find("].");  // reference[circle].center
      if (unsure_ && end != std::string_view::npos &&
          k.path.starts_with(schema.substr(0, schema.find('[')) + "["))
        known.emplace(k.path.substr(end + 2));
    }
  }
  for (auto&& [key, node] : *table_) {
    const std::string name(key.str());
    if (known.contains(name)) continue;
    any = true;
    reject(name, {known.begin(), known.end()});
  }
  return any;
}

void Section::finish() const {
  if (unsure_) {
    (void)reject_misspelt();
    return;
  }
  for (auto&& [key, node] : *table_) {
    const std::string name(key.str());
    if (!asked_.contains(name)) reject(name, {asked_.begin(), asked_.end()});
  }
}

void Section::note(const std::string& where, const std::string& what) const {
  std::string line = where.empty() ? what : where + ": " + what;
  const std::string head = line.substr(0, line.find("; "));  // without what is allowed instead
  if (std::ranges::none_of(*errors_, [&](const std::string& other) { return other.starts_with(head); }))
    errors_->push_back(std::move(line));
}

void Section::throw_errors() const {
  if (errors_->empty()) return;
  std::vector<std::string> lines = *errors_;
  constexpr std::size_t most = 20;
  if (lines.size() > most) {
    const std::size_t more = lines.size() - most + 1;
    lines.resize(most - 1);
    lines.push_back(fmt::format("and {} more errors", more));
  }
  throw InputErrors(std::move(lines));
}

}  // namespace esmc::host
