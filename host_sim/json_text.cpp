#include "host_sim/json_text.hpp"

#include <nlohmann/json.hpp>

namespace esmc::host {

namespace {
/// Where brackets are deeper than any document of ours: what reads it calls itself. npos: nowhere.
std::size_t too_deep(std::string_view text) {
  constexpr int deepest = 100;
  int depth = 0;
  bool quoted = false;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    if (quoted && c == '\\') ++i;
    if (c == '"') quoted = !quoted;
    if (quoted) continue;
    if ((c == '{' || c == '[') && ++depth > deepest) return i;
    if (c == '}' || c == ']') --depth;
  }
  return std::string_view::npos;
}
}  // namespace

nlohmann::ordered_json parse_json(std::string_view text, bool exceptions) {
  if (const std::size_t at = too_deep(text); at != std::string_view::npos) {
    if (!exceptions) return nlohmann::ordered_json::value_t::discarded;
    throw nlohmann::ordered_json::parse_error::create(101, at + 1, "brackets more than 100 deep", nullptr);
  }
  return nlohmann::ordered_json::parse(text, nullptr, exceptions);
}

std::string json_text(const nlohmann::ordered_json& j, int indent) {
  return j.dump(indent, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
}

}  // namespace esmc::host
