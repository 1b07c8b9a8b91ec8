#pragma once
/// JSON from text: compiled once, for the library's parser is half a second of every file that names it.

#include <nlohmann/json_fwd.hpp>
#include <string_view>

namespace esmc::host {

/// A JSON document, keys in their order. What is no JSON: throws nlohmann::json::exception, or without
/// `exceptions` returns a value that is_discarded() and no object.
[[nodiscard]] nlohmann::ordered_json parse_json(std::string_view text, bool exceptions);

}  // namespace esmc::host
