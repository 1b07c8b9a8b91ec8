#pragma once
/// A scene as constants of a board's image.

#include <cstdint>
#include <string>

#include "host_sim/controller/controller_config.hpp"

namespace esmc::host {

/// CRC-32 of all values that an image in double precision holds: scenes that differ in nothing that a
/// controller is made of have the same. A controller with a command interface announces it.
std::uint32_t identity_of(Scene scene, Pacing pacing);

/// The C++ header that an image of the scene is compiled with. Throws InputError where a board has no room
/// for the reference.
std::string baked_header(const Scene& scene, Pacing pacing, bool single_precision);

}  // namespace esmc::host
