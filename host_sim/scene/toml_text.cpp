#include "host_sim/scene/toml_text.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <sstream>

#include "host_sim/error.hpp"
#include "host_sim/scene/key.hpp"

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

/// Removes keys of the file from a table. Keys from another --set stay, and are refused later.
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

/// Depth of recursion of a parser: open brackets, and parts of a dotted key.
struct Depth {
  int brackets = 0, parts = 0;
};

/// Refuses a text that is longer or nested deeper than any scene: the parser would run out of stack.
void require_shallow(const std::string& text, const std::string& name) {
  if (text.size() > text_max) refuse("{}: {} bytes, at most {} are taken", name, text.size(), text_max);
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
      refuse_at(name.starts_with(set_mark) ? name : fmt::format("{}:{}", name, line),
                "keys or brackets nested more than {} deep", depth_max);
    }
  }
}

/// Removes what an override replaces: keys of the former `type`, other starts, the other choice of a step.
/// Returns whether the override replaces the whole table.
bool make_room(const std::string& name, toml::table& into, const toml::table& from) {
  const auto type = from["type"].value<std::string>(), former = into["type"].value<std::string>();
  if (type && former && *type != *former) {
    if (from.is_inline()) return true;
    drop(into, [&](const std::string& key) { return !is_key(name + "." + key); });
  }
  if (name == "simulation") {
    const bool fixed = from.contains("integrator") || from.contains("step");
    if (fixed) drop(into, [](const std::string& key) { return key == "accuracy" || key == "accuracy_of"; });
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

bool is_number(std::string_view key) { return key.find_first_not_of("0123456789") == std::string_view::npos; }

/// Whether all keys of a table are numbers, as in legs.1.l1: they are entries of an array.
bool numbered(const toml::node& node) {
  const toml::table* table = node.as_table();
  return table != nullptr && !table->empty() &&
         std::all_of(table->begin(), table->end(), [](const auto& e) { return is_number(e.first.str()); });
}
/// Whether they may be types of entries, as in effects.encoder.bits.
bool typed(const toml::node& node) {
  const toml::table* table = node.as_table();
  return table != nullptr && !table->empty() &&
         std::all_of(table->begin(), table->end(), [](const auto& e) { return e.second.is_table(); });
}

/// The entry of an array that a key of an override means: counted from 1, or by its type.
std::size_t entry_of(const toml::array& list, const std::string& key, const std::string& name,
                     const toml::node& node) {
  const auto refuse_key = [&](const std::string& what) {
    refuse("{}: '{}' has {}", *node.source().path, name, what);
  };
  if (is_number(key)) {
    const std::size_t i = key.size() < 6 ? std::stoul(key) : 0;
    if (i < 1 || i > list.size()) refuse_key(fmt::format("entries 1 to {}", list.size()));
    return i - 1;
  }
  for (std::size_t i = 0; i < list.size(); ++i) {
    const toml::table* entry = list[i].as_table();
    if (entry != nullptr && (*entry)["type"].value<std::string>() == key) return i;
  }
  refuse_key(fmt::format("no entry of type '{}'", key));
  return 0;
}

void merge_entries(toml::array& into, toml::table&& from, const std::string& name);

/// Makes two legs of the `leg` of a five-bar where only one of them is overridden.
void split_legs(toml::table& mechanism, const std::string& key, const toml::node& node) {
  const toml::table* leg = mechanism["leg"].as_table();
  if (key != "legs" || !numbered(node) || leg == nullptr ||
      mechanism["type"].value<std::string>() != "five_bar")
    return;
  mechanism.insert_or_assign("legs", toml::array{*leg, *leg});
  mechanism.erase("leg");
}

void merge(toml::table& into, toml::table&& from, const std::string& above = "") {
  for (auto&& [k, node] : from) {
    const std::string key(k.str()), name = above.empty() ? key : above + "." + key;
    if (name == "effects" && !into.contains(key) && typed(node))
      refuse("{}: the scene has no effects; --set 'effects=[{{type=\"{}\"}}]' names one", *node.source().path,
             node.as_table()->begin()->first.str());
    if (above == "mechanism") split_legs(into, key, node);
    if (toml::array* list = into.contains(key) ? into[key].as_array() : nullptr;
        list != nullptr && (numbered(node) || typed(node))) {
      merge_entries(*list, std::move(*node.as_table()), name);
      continue;
    }
    toml::table* existing = into.contains(key) ? into[key].as_table() : nullptr;
    if (existing != nullptr && node.is_table() && !make_room(name, *existing, *node.as_table())) {
      merge(*existing, std::move(*node.as_table()), name);
    } else {
      node.visit([&](auto& value) { into.insert_or_assign(key, std::move(value)); });
    }
  }
}

void merge_entries(toml::array& into, toml::table&& from, const std::string& name) {
  for (auto&& [k, node] : from) {
    const std::size_t i = entry_of(into, std::string(k.str()), name, node);
    if (toml::table* existing = into[i].as_table(); existing != nullptr && node.is_table()) {
      merge(*existing, std::move(*node.as_table()), name);
    } else if (toml::array* list = into[i].as_array(); list != nullptr && numbered(node)) {
      merge_entries(*list, std::move(*node.as_table()), name);  // points.2.1
    } else {
      node.visit([&](auto& value) {
        into.replace(into.cbegin() + static_cast<std::ptrdiff_t>(i), std::move(value));
      });
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
  if (equals == std::string::npos || equals == 0) refuse("{}: section.key=value is needed", label);
  require_shallow(set, label);
  try {
    return toml::parse(set, label);
  } catch (const toml::parse_error&) {
    if (set.find('[') < equals)
      refuse(
          "{}: an entry is named by its number from 1 or by its type: effects.1.bits, effects.encoder.bits",
          label);
    // A bare word is taken for a string: --set control.law=smc
    constexpr const char* bare = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789._/+-";
    const std::string word = set.substr(equals + 1);
    if (word.empty() || word.find_first_not_of(bare) != std::string::npos)
      refuse(
          "{}: neither a TOML value nor a bare word (letters, digits, . _ / + -); quote it: --set "
          "'{}\"...\"'",
          label, set.substr(0, equals + 1));
    try {
      return toml::parse(set.substr(0, equals + 1) + "\"" + word + "\"", label);
    } catch (const toml::parse_error&) {
      refuse("{}: section.key=value is needed", label);
    }
  }
}

template <class Value>
std::string as_library_prints(const Value& value) {
  std::ostringstream out;
  out << value;
  return out.str();
}

std::string key_text(const toml::key& key) {
  const std::string text(key.str());
  const bool bare =
      !text.empty() &&
      text.find_first_not_of("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-") ==
          std::string::npos;
  return bare ? text : as_library_prints(toml::value<std::string>(text));
}

std::string number_text(double v) {
  if (!std::isfinite(v)) return std::isnan(v) ? "nan" : (v < 0.0 ? "-inf" : "inf");
  std::string text = fmt::format("{}", v);
  if (text.find_first_of(".e") == std::string::npos) text += ".0";
  return text;
}

std::string inline_text(const toml::node& node) {
  std::string out;
  if (const toml::table* table = node.as_table()) {
    for (auto&& [key, value] : *table)
      out += (out.empty() ? " " : ", ") + key_text(key) + " = " + inline_text(value);
    return "{" + out + " }";
  }
  if (const toml::array* array = node.as_array()) {
    for (const toml::node& value : *array) out += (out.empty() ? "" : ", ") + inline_text(value);
    return "[" + out + "]";
  }
  if (const auto* number = node.as_floating_point()) return number_text(number->get());
  node.visit([&](const auto& value) { out = as_library_prints(value); });
  return out;
}

/// A table with a heading of its own, or one that stays on its line?
bool has_heading(const toml::node& node) {
  if (const toml::table* table = node.as_table()) return !table->is_inline();
  const toml::array* array = node.as_array();
  if (array == nullptr || array->empty()) return false;
  for (const toml::node& item : *array) {
    if (!item.is_table() || item.as_table()->is_inline()) return false;
  }
  return true;
}

void write(std::string& out, const toml::table& table, const std::string& path) {
  for (auto&& [key, value] : table) {
    if (!has_heading(value)) out += key_text(key) + " = " + inline_text(value) + "\n";
  }
  for (auto&& [key, value] : table) {
    if (!has_heading(value)) continue;
    const std::string name = path.empty() ? key_text(key) : path + "." + key_text(key);
    if (const toml::table* below = value.as_table()) {
      out += "\n[" + name + "]\n";
      write(out, *below, name);
      continue;
    }
    for (const toml::node& item : *value.as_array()) {
      out += "\n[[" + name + "]]\n";
      write(out, *item.as_table(), name);
    }
  }
}

thread_local const std::string *read_file = nullptr, *read_text = nullptr;  // of ReadBefore

/// All of a stream that is not too long for a scene.
std::string read_stream(std::istream& in, const std::string& file) {
  std::string text(text_max + 1, '\0');
  in.read(text.data(), static_cast<std::streamsize>(text.size()));
  if (in.bad()) refuse("{}: cannot be read", file);
  if (in.gcount() > static_cast<std::streamsize>(text_max))
    refuse("{}: more than {} bytes, no scene is that long", file, text_max);
  text.resize(static_cast<std::size_t>(in.gcount()));
  return text;
}

}  // namespace

std::string read_text_file(const std::string& file, const std::string& what) {
  std::error_code error;
  const auto type = std::filesystem::status(file, error).type();
  if (type == std::filesystem::file_type::directory) refuse("{}: is a directory, a {} is needed", file, what);
  if (type == std::filesystem::file_type::not_found) refuse("{}: no such {}", file, what);
  if (type == std::filesystem::file_type::none)  // a loop of links, no access
    refuse("{}: cannot be read: {}", file, error.message());
  if (type != std::filesystem::file_type::regular) refuse("{}: is not a regular file", file);
  std::ifstream in(file, std::ios::binary);
  if (!in.is_open()) refuse("{}: cannot be read", file);
  return read_stream(in, file);
}

ReadBefore::ReadBefore(const std::string& file, const std::string& text) {
  read_file = &file;
  read_text = &text;
}
ReadBefore::~ReadBefore() { read_file = nullptr; }

toml::table parse_scene_file(const std::string& file, const std::vector<std::string>& sets) {
  if (read_file != nullptr && *read_file == file) return parse_scene_text(*read_text, file, sets);
  if (file != "-") return parse_scene_text(read_text_file(file, "scene file"), file, sets);
  static const std::string input = read_stream(std::cin, "stdin");  // a command may ask again
  return parse_scene_text(input, "stdin", sets);
}

toml::table parse_scene_text(const std::string& text, const std::string& name,
                             const std::vector<std::string>& sets) {
  require_shallow(text, name);
  try {
    toml::table root = toml::parse(text, name);
    merge_overrides(root, sets);
    return root;
  } catch (const toml::parse_error& e) {
    refuse_at(fmt::format("{}:{}", name, e.source().begin.line), "not valid TOML: {}",
              one_line(e.description()));
  }
}

void merge_overrides(toml::table& scene, const std::vector<std::string>& sets) {
  for (const std::string& set : sets) {
    toml::table given = parse_override(set);
    toml::table* const mechanism = given["mechanism"].as_table();
    if (toml::array* const legs = scene["mechanism"]["legs"].as_array();
        legs != nullptr && mechanism != nullptr && (*mechanism)["leg"].is_table()) {
      for (toml::node& leg : *legs) {  // each has nodes of its own: a copy would not know its --set
        toml::table again = parse_override(set);
        if (leg.is_table())
          merge(*leg.as_table(), std::move(*again["mechanism"]["leg"].as_table()), "mechanism.leg");
      }
      mechanism->erase("leg");
    }
    merge(scene, std::move(given));
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

std::string toml_text(const toml::table& root) {
  std::string out;
  write(out, root, "");
  return out;
}

}  // namespace esmc::host
