#pragma once
/// JSON from text: compiled once, for the library's parser is half a second of every file that names it.

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>

namespace esmc::host {

/// A JSON document, keys in their order. What is no JSON: throws nlohmann::json::exception, or without
/// `exceptions` returns a value that is_discarded() and no object.
[[nodiscard]] nlohmann::ordered_json parse_json(std::string_view text, bool exceptions);

/// Its text, lines indented by `indent`; below 0: one line. What is no UTF-8 is replaced.
[[nodiscard]] std::string json_text(const nlohmann::ordered_json& j, int indent = -1);

}  // namespace esmc::host
