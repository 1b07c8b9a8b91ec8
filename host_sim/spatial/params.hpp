#pragma once
/// Parameters of the mechanisms in space, shared by controller and plant. SI units; z up, gravity along -z.

#include "firmware/types.hpp"

namespace esmc::host {

/// A rigid body; its frame lies in the mass centre, along the principal axes.
template <class S>
struct RigidBodyParams {
  S mass{};                               ///< kg, > 0
  Vec<S, 3> inertia = Vec<S, 3>::Zero();  ///< principal, about the mass centre, kg m2, > 0
};

/// One half of a leg: a body whose mass centre lies on the axis of the leg.
template <class S>
struct StrutParams {
  S centre{};  ///< cylinder: from the base joint up the leg; rod: from the platform's joint down the leg, m
  S mass{};    ///< kg
  S transverse{};  ///< inertia across the leg, about the mass centre, kg m2
  S axial{};       ///< about the axis of the leg, kg m2
  S viscous{};     ///< rod alone: friction of the slide, N s/m
};

/// 6-UPS, the Gough-Stewart platform: each leg a universal joint on the base, a slide that a motor drives, a
/// spherical joint at the platform. The cross of the universal joint has no mass.
template <class S>
struct HexapodParams {
  static constexpr int legs = 6;
  RigidBodyParams<S> platform{};
  List<Vec<S, 3>, legs> base{};   ///< universal joints, in N, m
  List<Vec<S, 3>, legs> joint{};  ///< spherical joints, from the mass centre of the platform in its frame, m
  Vec<S, 3> home = Vec<S, 3>::Zero();  ///< mass centre in the middle of the workspace, m; see home_direction
  StrutParams<S> cylinder{}, rod{};
  S gravity{};  ///< m/s2, >= 0

  /// Vector from base joint to platform joint of leg j at home, the platform level, in N, m. The shortest
  /// rotation that turns the z axis of N onto it turns the x axis onto the first axis of the universal joint.
  [[nodiscard]] Vec<S, 3> home_direction(int j) const { return home + joint[j] - base[j]; }
};

}  // namespace esmc::host
