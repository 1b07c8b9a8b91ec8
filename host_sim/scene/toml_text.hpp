#pragma once
/// Scenes as TOML text: parsing with overrides, and writing.

#include <toml++/toml.h>
#include <string>
#include <vector>

namespace esmc::host {

/// The bytes of a file no longer than any scene; `what` names its kind in errors. Throws InputError.
std::string read_text_file(const std::string& file, const std::string& what);

/// Parses a scene and merges the "section.key=value" overrides of `sets` into it. An override of a `type`
/// drops the file's keys of the former type, a start drops the file's other starts, and accuracy and
/// integrator or step drop each other. Throws InputError.
toml::table parse_scene_file(const std::string& file, const std::vector<std::string>& sets);
/// Same from a text; `name` stands for the file in errors.
toml::table parse_scene_text(const std::string& text, const std::string& name,
                             const std::vector<std::string>& sets);

/// Where a node was written: "FILE:LINE", or "--set key=value".
std::string place(const toml::node& node, const std::string& file);
/// `where`, followed by every other --set below `nodes`, which may be null.
std::string with_sets(const std::string& where, const std::vector<const toml::node*>& nodes);

/// A table as text that reads back to the same values, with the shortest numbers that do.
std::string toml_text(const toml::table& root);

}  // namespace esmc::host
