#pragma once
/// The integration methods that a scene can name.

#include <array>

#include "host_sim/names.hpp"

namespace esmc::host {

/// `moreau_jean` is what set-valued effects need; a scene with such effects gets it in any case.
enum class Method { semi_implicit_euler, rk4, dopri5, dopri8, radau5, moreau_jean };
template <>
inline constexpr auto names_of<Method> =
    std::array{"semi_implicit_euler", "rk4", "dopri5", "dopri8", "radau5", "moreau_jean"};

}  // namespace esmc::host
