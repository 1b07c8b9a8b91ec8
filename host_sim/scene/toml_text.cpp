#include "host_sim/scene/toml_text.hpp"

#include <fmt/format.h>

#include <cmath>
#include <sstream>

namespace esmc::host {
namespace {

template <class Value>
std::string as_library_prints(const Value& value) {
  std::ostringstream out;
  out << value;
  return out.str();
}

std::string key_text(const toml::key& key) {
  const std::string text(key.str());
  const bool bare = !text.empty() && text.find_first_not_of(
                                         "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ"
                                         "0123456789_-") == std::string::npos;
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
    for (auto&& [key, value] : *table) {
      out += (out.empty() ? " " : ", ") + key_text(key) + " = " + inline_text(value);
    }
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

}  // namespace

std::string toml_text(const toml::table& root) {
  std::string out;
  write(out, root, "");
  return out;
}

}  // namespace esmc::host
