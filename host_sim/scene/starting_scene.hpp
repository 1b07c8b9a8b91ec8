#pragma once
#include <string>
#include <string_view>

namespace esmc::host {

/// The commented scene that `esmc init` prints: "five_bar" or "rr".
std::string_view starting_scene(const std::string& kind);

}  // namespace esmc::host
