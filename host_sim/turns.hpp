#pragma once
/// Angles that count turns.

#include <cmath>
#include <numbers>

namespace esmc::host {

/// The angle that differs from `angle` by whole turns and is nearest to `to`, rad; both finite.
inline double nearest_turn(double angle, double to) {
  constexpr double turn = 2.0 * std::numbers::pi;
  return angle + turn * std::round((to - angle) / turn);
}

}  // namespace esmc::host
