#pragma once
/// Effects that put torques on joints or a force on the effector, as the right-hand side sees them.

#include <functional>
#include <limits>
#include <span>
#include <vector>

#include "host_sim/effects/effects.hpp"
#include "host_sim/plant/plant.hpp"

namespace esmc::host {

/// Adds torques, N m, at the joint angles and rates of the model.
using JointLoad = std::function<void(std::span<const double> angle, std::span<const double> rate,
                                     std::span<double> torque)>;

struct EffectorLoad {
  /// Force in N on an effector at p moving with v.
  std::function<V2(V2 p, V2 v)> force;
  double from = -std::numeric_limits<double>::infinity(), to = -from;  ///< s
  /// Whether it acts in the stretch of time in hand: at the jump itself, where a stage of an integrator may
  /// lie, the time alone would be ambiguous.
  bool acting = true;
};

struct Loads {
  std::vector<JointLoad> joint;
  std::vector<EffectorLoad> effector;
  std::vector<double> breaks;  ///< instants at which a load jumps: no step may cross one

  /// Begins a stretch of time around `middle` in which no load jumps.
  void begin(double middle) {
    for (EffectorLoad& load : effector) load.acting = middle > load.from && middle < load.to;
  }
};

/// The loads of all effects but set-valued ones (plant/moreau_jean.hpp).
Loads make_loads(const std::vector<Effect>& effects);

/// Whether effects need the time-stepping scheme: Coulomb friction not regularised, or rigid end stops.
[[nodiscard]] bool set_valued(const std::vector<Effect>& effects);

}  // namespace esmc::host
