#pragma once
/// The true mechanism in space: a free rigid body, or a platform on six legs (universal joint, slide,
/// spherical joint). It shares nothing with the controller's model. The unknowns are the accelerations of the
/// mass centre of every body and the angular ones, both in N, and one multiplier per joint equation, nine in
/// a leg and three at the platform; the equations are Newton's and Euler's. Positions and velocities of legs
/// follow from the platform, so that closure does not drift; the quaternion is normalised after every step.

#include <array>

#include "host_sim/spatial/params.hpp"

namespace esmc::host {

using V3d = Vec<double, 3>;

/// State of the plant.
struct SpatialState {
  V3d position = V3d::Zero();           ///< mass centre, m
  Vec<double, 4> attitude{1, 0, 0, 0};  ///< w, x, y, z; from the frame of the body to N
  V3d velocity = V3d::Zero();           ///< in N, m/s
  V3d turning = V3d::Zero();            ///< angular velocity in N, rad/s
};

struct SpatialEnergy {
  double kinetic = 0.0, potential = 0.0;  ///< J
};

class SpatialPlant {
 public:
  using Input = std::array<double, 6>;
  struct Acceleration {
    V3d point, turning;  ///< of the mass centre and angular, both in N
  };

  /// A free body. Input: force in N, moment in the frame of the body (N, N m). Masses and inertias > 0.
  SpatialPlant(const RigidBodyParams<double>& body, double gravity);
  /// A platform on legs. Input: the force of each motor, that drives its slide outwards (N). Every part has
  /// mass.
  explicit SpatialPlant(const HexapodParams<double>& p);

  [[nodiscard]] Acceleration acceleration(const SpatialState& s, const Input& u) const;  ///< m/s2, rad/s2
  [[nodiscard]] SpatialEnergy energy(const SpatialState& s) const;                       ///< of all bodies
  /// Power of the input less that of friction, W.
  [[nodiscard]] double power(const SpatialState& s, const Input& u) const;
  /// Angular momentum about the mass centre, of a free body, in N.
  [[nodiscard]] V3d angular_momentum(const SpatialState& s) const;

  /// RK4 over one step of h seconds with the input held; `work`, J, grows by the integral of power(): work of
  /// the input less that of friction. Returns how far the quaternion's norm was from 1 before it was
  /// normalised.
  double step(SpatialState& s, const Input& u, double h, double& work) const;

 private:
  struct Leg;  ///< of one moment
  [[nodiscard]] Leg leg(const SpatialState& s, int j) const;
  [[nodiscard]] Mat<double, 3, 4> end_acceleration(const Leg& l, double force) const;
  [[nodiscard]] V3d slide_axis_of_home(int j) const;

  RigidBodyParams<double> body_;
  HexapodParams<double> p_;
  double gravity_ = 0.0;
  bool legs_ = false;
};

}  // namespace esmc::host
