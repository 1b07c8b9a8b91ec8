#pragma once
/// Friction of the joints: of the effects of a scene, and among the parameters of a mechanism.

#include <optional>
#include <vector>

#include "firmware/mechanism/params.hpp"
#include "host_sim/effects/effects.hpp"

namespace esmc::host {

struct JointFriction {
  PerJoint viscous{}, dry{}, asymmetry{};  ///< N m s/rad, N m, N m
};

/// Of the effects; none: they have no friction.
[[nodiscard]] inline std::optional<JointFriction> friction_of(const std::vector<Effect>& effects) {
  const auto viscous = find_effect<ViscousFriction>(effects);
  const auto dry = find_effect<CoulombFriction>(effects);
  if (!viscous && !dry) return std::nullopt;
  const CoulombFriction d = dry.value_or(CoulombFriction{});
  return JointFriction{viscous.value_or(ViscousFriction{}).coefficient, d.torque, d.asymmetry};
}
[[nodiscard]] inline JointFriction friction_of(const FiveBarParams<double>& p) {
  const auto& [a, b] = p.legs;
  return {{a.d1, a.d2, b.d1, b.d2},
          {a.gamma1, a.gamma2, b.gamma1, b.gamma2},
          {a.asymmetry1, a.asymmetry2, b.asymmetry1, b.asymmetry2}};
}
inline void set_friction(FiveBarParams<double>& p, const JointFriction& f) {
  for (std::size_t j = 0; j < 2; ++j) {
    LegParams<double>& leg = p.legs[j];
    leg.d1 = f.viscous[2 * j];
    leg.d2 = f.viscous[2 * j + 1];
    leg.gamma1 = f.dry[2 * j];
    leg.gamma2 = f.dry[2 * j + 1];
    leg.asymmetry1 = f.asymmetry[2 * j];
    leg.asymmetry2 = f.asymmetry[2 * j + 1];
  }
}

}  // namespace esmc::host
