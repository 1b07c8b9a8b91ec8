#include "host_sim/scene/starting_scene.hpp"

namespace esmc::host {

// Embedded at build time from host_sim/scenes, so that what is printed is what the tests run.
extern const std::string_view five_bar_scene;
extern const std::string_view rr_scene;

std::string_view starting_scene(const std::string& kind) { return kind == "rr" ? rr_scene : five_bar_scene; }

}  // namespace esmc::host
