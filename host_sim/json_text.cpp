#include "host_sim/json_text.hpp"

#include <nlohmann/json.hpp>

namespace esmc::host {

nlohmann::ordered_json parse_json(std::string_view text, bool exceptions) {
  return nlohmann::ordered_json::parse(text, nullptr, exceptions);
}

}  // namespace esmc::host
