#pragma once
/// The table of scene keys, which the reader enforces and docs/scenes.md prints.

#include <limits>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace esmc::host {

class Section;
struct Scene;

/// An entry of the key table.
struct Key {
  std::string_view path;  ///< "section.key"; variants of a section in brackets: "reference[circle].radius"
  std::string_view kind;  ///< number, integer, string, boolean, numbers, integers, table, ...
  std::string_view fallback;  ///< default as written in TOML; "" = required; "-" = optional, nothing assumed
  std::string_view unit;
  double low = -std::numeric_limits<double>::infinity();  ///< both bounds are finite, or none is
  double high = std::numeric_limits<double>::infinity();
  bool low_open = false;     ///< the lower bound itself is not allowed
  std::string_view choices;  ///< allowed strings, separated by " | "
  std::string_view meaning;
  /// Reads the key into the field that it alone determines; null: the reader of its section reads it.
  void (*read)(Section& section, const std::string& key, Scene& scene) = nullptr;
};

std::span<const Key> scene_keys();  ///< the table; static
/// The key table of the scenes of `esmc spatial`; static.
std::span<const Key> spatial_keys();
/// Returns the entry of a key. Throws std::logic_error where there is none: a reader is wrong.
const Key& find_key(std::string_view path, std::span<const Key> keys = scene_keys());
/// Allowed values of a key for the table: "number > 0, rad".
std::string allowed(const Key& k);
/// Allowed values of a key with an article, for the message "'key' must be ...": "a number > 0, rad".
std::string wanted(const Key& k);
/// The known word nearest to `word`, within an edit distance of 2; empty: none.
std::string nearest(std::string_view word, const std::vector<std::string>& known);
/// The key table as Markdown, as in docs/scenes.md.
std::string keys_markdown(std::span<const Key> keys = scene_keys());

}  // namespace esmc::host
