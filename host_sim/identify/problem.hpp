#pragma once
/// A log as `esmc identify` takes it, and the parameters that it looks for.

#include <array>
#include <string>
#include <vector>

#include "host_sim/least_squares.hpp"

namespace esmc::host {

/// Lengths are known: calibrate them first. Angles and torques in the order of the model.
struct IdentifyProblem {
  bool five_bar = true;
  double l0 = 0.0;                   ///< m
  std::array<double, 2> l1{}, l2{};  ///< m, per leg
  int assembly = -1;                 ///< sign of D2
  double gravity = 0.0;              ///< m/s2
  double tick = 1e-3;                ///< s
  double window = 0.1;               ///< s, of one equation
  /// rad/s: the angles may be late as after an observer of that bandwidth, or not; 0: are not
  double observer_bandwidth = 1000.0;
  std::array<std::vector<double>, 2> angle;   ///< rad, of the base joints (RR: both), per tick
  std::vector<std::array<double, 4>> torque;  ///< N m asked of each joint at that tick; 0 without a motor
  Vector
      nominal;  ///< of the standard parameters, see standard_parameters(); frictions 0 where nothing is known
};

/// Parameters in which the equations are linear: per leg a = J1 + m1 lg1^2 + m2 l1^2, c = J2 + m2 lg2^2, h =
/// m2 lg2, s = m1 lg1 + m2 l1; the mass at the effector; then viscous and Coulomb friction of each joint.
struct StandardParameter {
  std::string name, unit;
  bool inertial = true;
};
[[nodiscard]] std::vector<StandardParameter> standard_parameters(bool five_bar);

}  // namespace esmc::host
