#pragma once
/// Scenes as TOML text: parsing with overrides, and writing.

#include <toml++/toml.h>
#include <string>
#include <vector>

namespace esmc::host {

/// Returns the bytes of a regular file of at most 1 MiB; `what` names its kind in errors. Throws InputError
/// for a longer file and for one that is missing, a directory or not readable.
std::string read_text_file(const std::string& file, const std::string& what);

/// Parses a scene and merges the "section.key=value" overrides of `sets` into it. An override of a `type`
/// drops the file's keys of the former type, a start drops the file's other starts, and accuracy and
/// integrator or step drop each other. Throws InputError.
toml::table parse_scene_file(const std::string& file, const std::vector<std::string>& sets);
/// Parses a scene from TOML text, otherwise like parse_scene_file; `name` stands for the file in errors.
toml::table parse_scene_text(const std::string& text, const std::string& name,
                             const std::vector<std::string>& sets);

/// Merges overrides into a parsed scene, as parse_scene_text does.
void merge_overrides(toml::table& scene, const std::vector<std::string>& sets);

/// While it exists, this thread reads `text` in place of the file `file`. Both outlive it; one at a time.
class ReadBefore {
 public:
  ReadBefore(const std::string& file, const std::string& text);
  ReadBefore(const ReadBefore&) = delete;
  ReadBefore& operator=(const ReadBefore&) = delete;
  ~ReadBefore();
};

/// Place of a node, for messages: "FILE:LINE", or "--set key=value".
std::string place(const toml::node& node, const std::string& file);
/// Returns `where`, followed by " with" and every other --set at or below `nodes`; null nodes are skipped.
std::string with_sets(const std::string& where, const std::vector<const toml::node*>& nodes);

/// A table as text that reads back to the same values, with the shortest numbers that do.
std::string toml_text(const toml::table& root);

}  // namespace esmc::host
