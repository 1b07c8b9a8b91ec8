#pragma once
/// The true mechanisms, in redundant coordinates, written without a line of the controller's model (values of
/// parameters apart), so that an error in one shows against the other.
///
/// Coordinates: the absolute angles psi_jk of the bars in the inertial frame N, all counter-clockwise. The
/// effector mass is split between the two leg tips, which closure makes one point. With A the closure
/// Jacobian (tip 1 minus tip 2) and M the legs' own 2 x 2 mass matrices, always positive definite:
///   M a + A^T lambda = Q,   A a = gamma
/// solved through the 2 x 2 Schur complement A M^-1 A^T, which is regular at both singularities and loses
/// rank only where closure itself does (both legs stretched or folded along one line).

#include <array>
#include <cmath>

#include "firmware/mechanism/params.hpp"
#include "firmware/numeric/elementary.hpp"

namespace esmc::host {

/// A planar vector of plain doubles; the plant uses no matrix library.
struct V2 {
  double x = 0.0, y = 0.0;
  friend V2 operator+(V2 a, V2 b) { return {a.x + b.x, a.y + b.y}; }
  friend V2 operator-(V2 a, V2 b) { return {a.x - b.x, a.y - b.y}; }
  friend V2 operator*(double k, V2 a) { return {k * a.x, k * a.y}; }
  friend double dot(V2 a, V2 b) { return a.x * b.x + a.y * b.y; }
};

/// Directions of N bars. Beyond the range of firmware/numeric (a day of turning) the C library takes over.
template <std::size_t N>
[[nodiscard]] inline SinCosLanes<double, N> directions(const std::array<double, N>& angle) {
  SinCosLanes<double, N> d = sin_cos(angle);
  bool known = true;
  for (std::size_t i = 0; i < N; ++i) known = known & (d.sin[i] == d.sin[i]);
  if (known) return d;
  for (std::size_t i = 0; i < N; ++i) {
    if (d.sin[i] == d.sin[i]) continue;
    d.sin[i] = std::sin(angle[i]);
    d.cos[i] = std::cos(angle[i]);
  }
  return d;
}

/// One leg in N, by Lagrange's equations in absolute bar angles. `side` is +1 for leg 1 (and the RR arm), -1
/// for leg 2, whose model angles are mirrored: psi = pi - theta.
class LegDynamics {
 public:
  LegDynamics() = default;
  LegDynamics(const LegParams<double>& p, double gravity, double tip_mass, double base_x, double side)
      : l1_(p.l1),
        l2_(p.l2),
        base_x_(base_x),
        side_(side),
        i1_(p.J1 + p.m1 * p.lg1 * p.lg1 + (p.m2 + tip_mass) * p.l1 * p.l1),
        i2_(p.J2 + p.m2 * p.lg2 * p.lg2 + tip_mass * p.l2 * p.l2),
        coupling_((p.m2 * p.lg2 + tip_mass * p.l2) * p.l1),
        weight1_(gravity * (p.m1 * p.lg1 + (p.m2 + tip_mass) * p.l1)),
        weight2_(gravity * (p.m2 * p.lg2 + tip_mass * p.l2)) {}

  /// Where both bars point, and the inverse of the leg's mass matrix.
  struct Pose {
    V2 e1, e2;              // along the bars
    double sin_difference;  // of psi1 - psi2
    double m11, m12, m22;   // M^-1
  };
  [[nodiscard]] Pose pose(double c1, double s1, double c2, double s2) const {
    const double m12 = coupling_ * (c1 * c2 + s1 * s2);
    const double inverse = 1.0 / (i1_ * i2_ - m12 * m12);
    return {{c1, s1}, {c2, s2}, s1 * c2 - c1 * s2, i2_ * inverse, -m12 * inverse, i1_ * inverse};
  }

  struct Pair {
    double first, second;  // of the two bars
  };
  /// Q: weight, inertia forces of the rates, joint torques (model convention: relative joints, mirrored for
  /// leg 2).
  [[nodiscard]] Pair force(const Pose& p, double w1, double w2, double tau1, double tau2) const {
    const double k = coupling_ * p.sin_difference;
    return {side_ * (tau1 - tau2) - k * w2 * w2 - weight1_ * p.e1.x,
            side_ * tau2 + k * w1 * w1 - weight2_ * p.e2.x};
  }
  /// M^-1 f.
  [[nodiscard]] static Pair solve(const Pose& p, Pair f) {
    return {p.m11 * f.first + p.m12 * f.second, p.m12 * f.first + p.m22 * f.second};
  }
  /// J a: what angular rates (or accelerations) of the bars give the tip.
  [[nodiscard]] V2 tip_rate(const Pose& p, Pair w) const {
    const double a = l1_ * w.first, b = l2_ * w.second;
    return {-a * p.e1.y - b * p.e2.y, a * p.e1.x + b * p.e2.x};
  }
  /// J^T f: what a force on the tip does to the bars.
  [[nodiscard]] Pair tip_force(const Pose& p, V2 f) const {
    return {l1_ * (p.e1.x * f.y - p.e1.y * f.x), l2_ * (p.e2.x * f.y - p.e2.y * f.x)};
  }
  /// The tip's acceleration at constant rates.
  [[nodiscard]] V2 tip_bias(const Pose& p, double w1, double w2) const {
    const double a = l1_ * w1 * w1, b = l2_ * w2 * w2;
    return {-a * p.e1.x - b * p.e2.x, -a * p.e1.y - b * p.e2.y};
  }
  /// A symmetric 2 x 2 matrix.
  struct Symmetric {
    double xx, xy, yy;
    friend Symmetric operator+(Symmetric a, Symmetric b) { return {a.xx + b.xx, a.xy + b.xy, a.yy + b.yy}; }
  };
  /// J M^-1 J^T: how the tip yields to a force.
  [[nodiscard]] Symmetric tip_mobility(const Pose& p) const {
    const double a = l1_ * l1_ * p.m11, b = l2_ * l2_ * p.m22, c = l1_ * l2_ * p.m12;
    const double ax = a * p.e1.x + c * p.e2.x, ay = a * p.e1.y + c * p.e2.y;
    const double bx = b * p.e2.x + c * p.e1.x, by = b * p.e2.y + c * p.e1.y;
    return {ay * p.e1.y + by * p.e2.y, -(ax * p.e1.y + bx * p.e2.y), ax * p.e1.x + bx * p.e2.x};
  }
  [[nodiscard]] V2 tip(V2 e1, V2 e2) const {
    return {base_x_ + l1_ * e1.x + l2_ * e2.x, l1_ * e1.y + l2_ * e2.y};
  }
  /// What a unit force on the tip, in x and in y, does as torques of the two joints (model convention).
  [[nodiscard]] std::array<V2, 2> torque_per_force(const Pose& p) const {
    const V2 bar1{-side_ * l1_ * p.e1.y, side_ * l1_ * p.e1.x},
        bar2{-side_ * l2_ * p.e2.y, side_ * l2_ * p.e2.x};
    return {bar1 + bar2, bar2};
  }
  [[nodiscard]] double kinetic(V2 e1, V2 e2, double w1, double w2) const {
    return 0.5 * (i1_ * w1 * w1 + i2_ * w2 * w2) + coupling_ * dot(e1, e2) * w1 * w2;
  }
  [[nodiscard]] double potential(V2 e1, V2 e2) const { return weight1_ * e1.y + weight2_ * e2.y; }

 private:
  double l1_{}, l2_{}, base_x_{}, side_{1.0};
  double i1_{}, i2_{}, coupling_{}, weight1_{}, weight2_{};
};

/// The effector as a load sees it. Closure makes the tip of leg 1 stand for both.
struct EffectorPoint {
  V2 position, rate;
  std::array<V2, 2> torque_per_force;  ///< torque of joint i of leg 1 (or the arm) = dot(this[i], force)
};

class FiveBarPlant {
 public:
  static constexpr int coordinates = 4;  ///< psi11, psi12, psi21, psi22
  static constexpr int joints = 4;       ///< theta11, theta12, theta21, theta22
  static constexpr int outputs = 6;      ///< x, y and the joints: final_state.q
  using Angles = std::array<double, 4>;
  using Joints = std::array<double, 4>;
  struct State {
    Angles angle{}, rate{};
  };
  struct Output {
    std::array<double, 6> q{}, qd{};
    V2 effector, effector_rate;
    double closure = 0.0;  ///< |tip 1 - tip 2|, m
  };

  /// `payload`: a further point mass at the effector, kg.
  explicit FiveBarPlant(const FiveBarParams<double>& p, double payload = 0.0)
      : leg_{LegDynamics(p.legs[0], p.g, 0.5 * (p.m0 + payload), p.l0, 1.0),
             LegDynamics(p.legs[1], p.g, 0.5 * (p.m0 + payload), -p.l0, -1.0)} {}

  /// State from the model's joint angles and rates (leg 2 mirrored).
  [[nodiscard]] static State from_joints(const Joints& theta, const Joints& rate) {
    constexpr double pi = 3.14159265358979323846;
    return {{theta[0], theta[0] + theta[1], pi - theta[2], pi - theta[2] - theta[3]},
            {rate[0], rate[0] + rate[1], -rate[2], -rate[2] - rate[3]}};
  }
  [[nodiscard]] static Joints joint_angles(const Angles& psi) {
    constexpr double pi = 3.14159265358979323846;
    return {psi[0], psi[1] - psi[0], pi - psi[2], psi[2] - psi[3]};
  }
  [[nodiscard]] static Joints joint_rates(const Angles& w) { return {w[0], w[1] - w[0], -w[2], w[2] - w[3]}; }

  /// Angular accelerations of the bars under joint torques (model convention, N m).
  [[nodiscard]] Angles acceleration(const Angles& angle, const Angles& rate, const Joints& torque) const;
  /// What joint torques (impulses) alone do to the rates of the bars: M^-1 with closure kept, times the
  /// torques.
  [[nodiscard]] Angles response(const Angles& angle, const Joints& torque) const;
  /// Moves angles and rates onto the closure, along the shortest way in the mass metric.
  void project(Angles& angle, Angles& rate) const;
  [[nodiscard]] EffectorPoint effector_point(const Angles& angle, const Angles& rate) const;
  [[nodiscard]] Output output(const State& s) const;
  [[nodiscard]] V2 effector(const Angles& angle) const;
  [[nodiscard]] V2 effector_rate(const Angles& angle, const Angles& rate) const;
  [[nodiscard]] double kinetic_energy(const State& s) const;
  [[nodiscard]] double potential_energy(const State& s) const;

 private:
  struct Poses;
  [[nodiscard]] Poses poses(const Angles& angle) const;
  std::array<LegDynamics, 2> leg_;
};

/// The true RR arm: one leg, nothing to close.
class RrPlant {
 public:
  static constexpr int coordinates = 2;
  static constexpr int joints = 2;
  static constexpr int outputs = 2;
  using Angles = std::array<double, 2>;
  using Joints = std::array<double, 2>;
  struct State {
    Angles angle{}, rate{};
  };
  struct Output {
    std::array<double, 2> q{}, qd{};
    V2 effector, effector_rate;
    double closure = 0.0;
  };

  explicit RrPlant(const RrParams<double>& p, double payload = 0.0) : leg_(p.arm, p.g, payload, 0.0, 1.0) {}

  [[nodiscard]] static State from_joints(const Joints& theta, const Joints& rate) {
    return {{theta[0], theta[0] + theta[1]}, {rate[0], rate[0] + rate[1]}};
  }
  [[nodiscard]] static Joints joint_angles(const Angles& psi) { return {psi[0], psi[1] - psi[0]}; }
  [[nodiscard]] static Joints joint_rates(const Angles& w) { return {w[0], w[1] - w[0]}; }

  [[nodiscard]] Angles acceleration(const Angles& angle, const Angles& rate, const Joints& torque) const;
  [[nodiscard]] Angles response(const Angles& angle, const Joints& torque) const;
  void project(Angles&, Angles&) const {}
  [[nodiscard]] EffectorPoint effector_point(const Angles& angle, const Angles& rate) const;
  [[nodiscard]] Output output(const State& s) const;
  [[nodiscard]] V2 effector(const Angles& angle) const;
  [[nodiscard]] V2 effector_rate(const Angles& angle, const Angles& rate) const;
  [[nodiscard]] double kinetic_energy(const State& s) const;
  [[nodiscard]] double potential_energy(const State& s) const;

 private:
  [[nodiscard]] LegDynamics::Pose pose(const Angles& angle) const;
  LegDynamics leg_;
};

}  // namespace esmc::host
