#pragma once
/// Effects that put torques on joints or a force on the effector, as the right-hand side sees them.

#include <memory>
#include <span>
#include <vector>

#include "host_sim/effects/effects.hpp"
#include "host_sim/plant/plant.hpp"

namespace esmc::host {

class JointLoad {
 public:
  virtual ~JointLoad() = default;
  /// Adds torques, N m, at the joint angles and rates of the model.
  virtual void add(std::span<const double> angle, std::span<const double> rate,
                   std::span<double> torque) const = 0;
};

class EffectorLoad {
 public:
  virtual ~EffectorLoad() = default;
  /// Begins a stretch of time around `middle` in which the load does not jump: at the jump itself, where a
  /// stage of an integrator may lie, the time alone would be ambiguous.
  virtual void begin(double middle) = 0;
  /// Force in N on an effector at p moving with v.
  [[nodiscard]] virtual V2 force(V2 p, V2 v) const = 0;
};

struct Loads {
  std::vector<std::unique_ptr<JointLoad>> joint;
  std::vector<std::unique_ptr<EffectorLoad>> effector;
  std::vector<double> breaks;  ///< instants at which a load jumps: no step may cross one
};

/// The loads of all effects but set-valued ones (plant/moreau_jean.hpp).
Loads make_loads(const std::vector<Effect>& effects);

/// Whether effects need the time-stepping scheme: Coulomb friction not regularised, or rigid end stops.
[[nodiscard]] bool set_valued(const std::vector<Effect>& effects);

}  // namespace esmc::host
