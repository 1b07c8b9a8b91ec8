#pragma once
/// A hand at the effector, moved while the simulation runs.

#include <cmath>

#include "host_sim/plant/plant.hpp"

namespace esmc::host {

struct Hand {
  bool holding = false;                   ///< spring and damper towards `anchor`
  V2 anchor{};                            ///< m
  double stiffness = 0.0, damping = 0.0;  ///< N/m, N s/m, >= 0
  V2 push{};                              ///< N, besides
  double most = 0.0;                      ///< N, > 0: no hand pulls harder

  /// Force, N, on an effector at p, m, moving with v, m/s: push and pull, their sum cut to `most`.
  [[nodiscard]] V2 force(V2 p, V2 v) const {
    V2 f = push;
    if (holding) f = f + stiffness * (anchor - p) - damping * v;
    const double size = std::sqrt(dot(f, f));
    return size > most ? (most / size) * f : f;
  }
};

}  // namespace esmc::host
