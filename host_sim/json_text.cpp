#include "host_sim/json_text.hpp"

#include <nlohmann/json.hpp>

namespace esmc::host {

nlohmann::ordered_json parse_json(std::string_view text, bool exceptions) {
  return nlohmann::ordered_json::parse(text, nullptr, exceptions);
}

std::string json_text(const nlohmann::ordered_json& j, int indent) {
  return j.dump(indent, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
}

}  // namespace esmc::host
