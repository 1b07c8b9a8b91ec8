#pragma once
/// The free rigid body and the Gough-Stewart platform (6-UPS), both from coupling.hpp.

#include "host_sim/spatial/coupling.hpp"

namespace esmc::host {

/// Leg of universal joint, slide, spherical joint, with the bodies cross (without mass), cylinder, rod. In
/// the frame of the base joint, whose z axis is the direction of the leg at home, the leg points along (sin
/// b, -sin a cos b, cos a cos b).
template <class S>
class UpsLeg : public SpatialSerial<S, Joint::revolute, Joint::revolute, Joint::prismatic> {
 public:
  using Chain = SpatialSerial<S, Joint::revolute, Joint::revolute, Joint::prismatic>;
  using typename Chain::Joints;
  using typename Chain::Pose;
  static constexpr int slide = 2;

  UpsLeg() = default;
  /// base: m, in N; home: direction of the leg at home, any length, not straight down.
  UpsLeg(const Vec3<S>& base, const Vec3<S>& home, const StrutParams<S>& cylinder, const StrutParams<S>& rod,
         S gravity)
      : Chain(bodies(base, home, cylinder, rod), Vec3<S>::Zero(), gravity) {}

  /// Inverse kinematics: pose with the tip at `tip`, m, in N. False on the first axis of the universal joint,
  /// within rounding, and for a NaN: `out` is then unchanged.
  [[nodiscard]] bool reach(const Vec3<S>& tip, Pose& out) const {
    const SpatialBody<S>& first = this->body(0);
    const Vec3<S> r = rotated(first.mount.conjugate(), Vec3<S>(tip - first.offset));
    const S off_axis = square_root(r.y() * r.y() + r.z() * r.z()), length = square_root(dot(r, r));
    constexpr S least = sizeof(S) > 4 ? S(1e-12) : S(1e-5);
    if (!(off_axis > least * length)) return false;
    out = this->pose(Joints(arc_tangent2(S(-r.y()), r.z()), arc_tangent2(r.x(), off_axis), length));
    return true;
  }

 private:
  [[nodiscard]] static List<SpatialBody<S>, 3> bodies(const Vec3<S>& base, const Vec3<S>& home,
                                                      const StrutParams<S>& cylinder,
                                                      const StrutParams<S>& rod) {
    List<SpatialBody<S>, 3> b;
    const Vec3<S> z = home / square_root(dot(home, home));
    b[0].offset = base;
    b[0].mount =
        normalised(Quaternion<S>{S(1) + z.z(), Vec3<S>(-z.y(), z.x(), S(0))});  // the shortest turn of z
    b[0].axis = Vec3<S>::UnitX();
    b[1].axis = Vec3<S>::UnitY();
    b[1].centre = Vec3<S>(S(0), S(0), cylinder.centre);
    b[1].mass = cylinder.mass;
    b[1].inertia = Vec3<S>(cylinder.transverse, cylinder.transverse, cylinder.axial);
    b[2].axis = Vec3<S>::UnitZ();
    b[2].centre = Vec3<S>(S(0), S(0), -rod.centre);
    b[2].mass = rod.mass;
    b[2].inertia = Vec3<S>(rod.transverse, rod.transverse, rod.axial);
    b[2].viscous = rod.viscous;
    return b;
  }
};

template <class S>
using FreeBody = SpatialCoupling<S, UpsLeg<S>, 0>;
template <class S>
using Hexapod = SpatialCoupling<S, UpsLeg<S>, 6>;

/// The controller's model of a free body, not checked; gravity: m/s2, along -z.
template <class S>
[[nodiscard]] FreeBody<S> make_free_body(const RigidBodyParams<S>& body, S gravity) {
  return FreeBody<S>(body, {}, {}, gravity);
}

/// The controller's model of a platform on six legs. Nothing in p is checked.
template <class S>
[[nodiscard]] Hexapod<S> make_hexapod(const HexapodParams<S>& p) {
  List<UpsLeg<S>, 6> leg;
  for (int j = 0; j < 6; ++j)
    leg[j] = UpsLeg<S>(p.base[j], p.home_direction(j), p.cylinder, p.rod, p.gravity);
  return Hexapod<S>(p.platform, p.joint, leg, p.gravity);
}

}  // namespace esmc::host
