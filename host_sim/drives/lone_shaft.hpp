#pragma once
/// A shaft with inertia and viscous friction under a load, for a drive that has no mechanism.

#include <cmath>

namespace esmc::host {

struct LoneShaft {
  double inertia = 1e-3;   ///< kg m2, > 0
  double friction = 1e-3;  ///< N m s/rad, >= 0
  double load = 0.0;       ///< N m, against the positive direction, at any speed
  double angle = 0.0;      ///< rad
  double rate = 0.0;       ///< rad/s

  /// Moves the shaft exactly, under a constant torque, N m: inertia dw/dt = torque - load - friction w.
  void advance(double torque, double seconds) {
    const double net = torque - load, x = friction * seconds / inertia;
    if (x < 1e-9) {  // the terms left out are below rounding
      const double acceleration = (net - friction * rate) / inertia;
      angle += seconds * (rate + 0.5 * seconds * acceleration);
      rate += seconds * acceleration;
      return;
    }
    const double last = net / friction, share = -std::expm1(-x);
    angle += last * seconds + (rate - last) * share * inertia / friction;
    rate += (last - rate) * share;
  }
};

}  // namespace esmc::host
