#pragma once
/// The table of scene keys: what the reader enforces and docs/scenes.md prints are the same lines.

#include <limits>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace esmc::host {

struct Key {
  std::string_view path;  ///< "section.key"; variants of a section in brackets: "reference[circle].radius"
  std::string_view kind;  ///< number, integer, string, boolean, numbers, integers, table, ...
  std::string_view fallback;  ///< default as written in TOML; "" = required; "-" = optional, nothing assumed
  std::string_view unit;
  double low = -std::numeric_limits<double>::infinity();
  double high = std::numeric_limits<double>::infinity();
  bool low_open = false;     ///< the lower bound itself is not allowed
  std::string_view choices;  ///< allowed strings, separated by " | "
  std::string_view meaning;
};

std::span<const Key> scene_keys();
/// Of the scenes of `esmc spatial`.
std::span<const Key> spatial_keys();
/// The entry of a key; ends the program's logic with std::logic_error when a reader asks for one that is
/// missing.
const Key& find_key(std::string_view path, std::span<const Key> keys = scene_keys());
/// "number > 0, rad", for the table.
std::string allowed(const Key& k);
/// "a number > 0, rad", for a message: "'key' must be ..."
std::string wanted(const Key& k);
/// The known word that `word` is a slip of the pen away from (edit distance at most 2); empty: none.
std::string nearest(std::string_view word, const std::vector<std::string>& known);
/// The table as Markdown.
std::string keys_markdown(std::span<const Key> keys = scene_keys());

}  // namespace esmc::host
