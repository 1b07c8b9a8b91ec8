#pragma once
/// A scene as constants of a board's image.

#include <cstdint>
#include <string>

#include "host_sim/controller/controller_config.hpp"

namespace esmc::host {

/// CRC-32 of all values of an image in double precision: equal for scenes with the same controller. A
/// controller with a command interface sends it. Throws InputError where robust gains are refused.
std::uint32_t identity_of(Scene scene, Pacing pacing);

/// The C++ header of an image. Throws InputError where the reference has more pieces than a board holds, a
/// number is beyond its scalar type or robust gains are refused.
std::string baked_header(const Scene& scene, Pacing pacing, bool single_precision);

}  // namespace esmc::host
