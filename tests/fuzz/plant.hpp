#pragma once
/// The two machines as they would move under the torques of a tick, for cycles that are to get somewhere.
/// Compiled apart, in a namespace of its own, so that what it runs does not count as reached.

#include <array>

/// Angles (rad) and rates (rad/s) of all joints, 1 ms later; `torque` at the joints, N m. Stays where the
/// legs would not close.
extern "C" void move_five_bar(std::array<double, 4>& angle, std::array<double, 4>& rate,
                              const std::array<double, 4>& torque);
extern "C" void move_rr(std::array<double, 2>& angle, std::array<double, 2>& rate,
                        const std::array<double, 2>& torque);
