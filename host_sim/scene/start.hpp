#pragma once
/// Start of a scene: the true joint angles and rates at t = 0.

#include <string>

#include "host_sim/scene/scene.hpp"

namespace esmc::host {

/// Fills start_angle, start_rate and a missing assembly_mode. Throws InputError at `initial` or `reference`
/// (places in the scene file) when the start is out of reach, contradicts a mode or does not close.
void set_start(Scene& scene, const std::string& initial, const std::string& reference);

}  // namespace esmc::host
