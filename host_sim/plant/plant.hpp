#pragma once
/// The true five-bar: two legs in redundant coordinates, held together by Lagrange multipliers. Regular at both
/// singularities, and written without a line of firmware/ (values of parameters apart), so that an error in one
/// shows against the other.
///
/// Coordinates: the absolute angles psi_jk of the four bars in the inertial frame N, all counter-clockwise.
/// The effector mass is split between the two leg tips, which closure makes one point. With A the closure
/// Jacobian (tip 1 minus tip 2) and M the legs' own 2 x 2 mass matrices, always positive definite:
///   M a + A^T lambda = Q,   A a = gamma
/// solved through the 2 x 2 Schur complement A M^-1 A^T, singular only where closure itself loses rank (both
/// legs stretched or folded along one line).

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
};

/// One leg in N, by Lagrange's equations in absolute bar angles. `side` is +1 for leg 1 (and the RR arm), -1
/// for leg 2, whose model angles are mirrored: psi = pi - theta.
class LegDynamics {
 public:
  LegDynamics() = default;
  LegDynamics(const LegParams<double>& p, double gravity, double tip_mass, double base_x, double side)
      : l1_(p.l1), l2_(p.l2), base_x_(base_x), side_(side),
        i1_(p.J1 + p.m1 * p.lg1 * p.lg1 + (p.m2 + tip_mass) * p.l1 * p.l1),
        i2_(p.J2 + p.m2 * p.lg2 * p.lg2 + tip_mass * p.l2 * p.l2),
        coupling_((p.m2 * p.lg2 + tip_mass * p.l2) * p.l1),
        weight1_(gravity * (p.m1 * p.lg1 + (p.m2 + tip_mass) * p.l1)),
        weight2_(gravity * (p.m2 * p.lg2 + tip_mass * p.l2)) {}

  /// Directions of both bars and everything that follows from them and the rates.
  struct Terms {
    double c1, s1, c2, s2;
    double m12;           // coupling of the mass matrix
    double q1, q2;        // right-hand side without joint torques
    V2 along;             // tip acceleration at constant rates
  };

  [[nodiscard]] Terms terms(double psi1, double psi2, double w1, double w2) const {
    Terms t{};
    const SinCos<double> a = sin_cos(psi1), b = sin_cos(psi2);
    t.c1 = a.cos;
    t.s1 = a.sin;
    t.c2 = b.cos;
    t.s2 = b.sin;
    const double cos_difference = t.c1 * t.c2 + t.s1 * t.s2, sin_difference = t.s1 * t.c2 - t.c1 * t.s2;
    t.m12 = coupling_ * cos_difference;
    t.q1 = -coupling_ * sin_difference * w2 * w2 - weight1_ * t.c1;
    t.q2 = coupling_ * sin_difference * w1 * w1 - weight2_ * t.c2;
    t.along = {-l1_ * w1 * w1 * t.c1 - l2_ * w2 * w2 * t.c2, -l1_ * w1 * w1 * t.s1 - l2_ * w2 * w2 * t.s2};
    return t;
  }
  /// Joint torques of the model (relative joints, mirrored for leg 2) as forces on psi1, psi2.
  void add_torque(Terms& t, double tau1, double tau2) const {
    t.q1 += side_ * (tau1 - tau2);
    t.q2 += side_ * tau2;
  }
  /// M^-1 (f1, f2).
  [[nodiscard]] V2 solve(const Terms& t, double f1, double f2) const {
    const double inverse = 1.0 / (i1_ * i2_ - t.m12 * t.m12);
    return {(i2_ * f1 - t.m12 * f2) * inverse, (i1_ * f2 - t.m12 * f1) * inverse};
  }
  [[nodiscard]] V2 column1(const Terms& t) const { return {-l1_ * t.s1, l1_ * t.c1}; }  // d tip / d psi1
  [[nodiscard]] V2 column2(const Terms& t) const { return {-l2_ * t.s2, l2_ * t.c2}; }
  [[nodiscard]] V2 tip(const Terms& t) const {
    return {base_x_ + l1_ * t.c1 + l2_ * t.c2, l1_ * t.s1 + l2_ * t.s2};
  }
  [[nodiscard]] double kinetic(const Terms& t, double w1, double w2) const {
    return 0.5 * (i1_ * w1 * w1 + i2_ * w2 * w2) + t.m12 * w1 * w2;
  }
  [[nodiscard]] double potential(const Terms& t) const { return weight1_ * t.s1 + weight2_ * t.s2; }

 private:
  double l1_{}, l2_{}, base_x_{}, side_{1.0};
  double i1_{}, i2_{}, coupling_{}, weight1_{}, weight2_{};
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
  };

  explicit FiveBarPlant(const FiveBarParams<double>& p)
      : leg_{LegDynamics(p.legs[0], p.g, 0.5 * p.m0, p.l0, 1.0), LegDynamics(p.legs[1], p.g, 0.5 * p.m0, -p.l0, -1.0)} {}

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
  [[nodiscard]] Angles acceleration(const State& s, const Joints& torque) const;
  /// Moves the state onto the closure, position and velocity, along the shortest way in the mass metric.
  void project(State& s) const;
  /// |tip 1 - tip 2|, m.
  [[nodiscard]] double closure(const State& s) const;
  [[nodiscard]] Output output(const State& s) const;
  [[nodiscard]] double kinetic_energy(const State& s) const;
  [[nodiscard]] double potential_energy(const State& s) const;

 private:
  struct Frame;  // both legs' terms and the factored closure
  [[nodiscard]] Frame frame(const State& s) const;
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
  };

  explicit RrPlant(const RrParams<double>& p) : leg_(p.arm, p.g, 0.0, 0.0, 1.0) {}

  [[nodiscard]] static State from_joints(const Joints& theta, const Joints& rate) {
    return {{theta[0], theta[0] + theta[1]}, {rate[0], rate[0] + rate[1]}};
  }
  [[nodiscard]] static Joints joint_angles(const Angles& psi) { return {psi[0], psi[1] - psi[0]}; }
  [[nodiscard]] static Joints joint_rates(const Angles& w) { return {w[0], w[1] - w[0]}; }

  [[nodiscard]] Angles acceleration(const State& s, const Joints& torque) const {
    LegDynamics::Terms t = leg_.terms(s.angle[0], s.angle[1], s.rate[0], s.rate[1]);
    leg_.add_torque(t, torque[0], torque[1]);
    const V2 a = leg_.solve(t, t.q1, t.q2);
    return {a.x, a.y};
  }
  void project(State&) const {}
  [[nodiscard]] double closure(const State&) const { return 0.0; }
  [[nodiscard]] Output output(const State& s) const { return {joint_angles(s.angle), joint_rates(s.rate)}; }
  [[nodiscard]] V2 effector(const State& s) const { return leg_.tip(leg_.terms(s.angle[0], s.angle[1], 0, 0)); }
  [[nodiscard]] V2 effector_rate(const State& s) const {
    const auto t = leg_.terms(s.angle[0], s.angle[1], 0, 0);
    return s.rate[0] * leg_.column1(t) + s.rate[1] * leg_.column2(t);
  }
  [[nodiscard]] double kinetic_energy(const State& s) const {
    return leg_.kinetic(leg_.terms(s.angle[0], s.angle[1], 0, 0), s.rate[0], s.rate[1]);
  }
  [[nodiscard]] double potential_energy(const State& s) const {
    return leg_.potential(leg_.terms(s.angle[0], s.angle[1], 0, 0));
  }

 private:
  LegDynamics leg_;
};

}  // namespace esmc::host
