#pragma once
/// The true mechanisms in redundant coordinates. They share no equation with the controller's model, so that
/// an error in one shows against the other.
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
#include "host_sim/plant/simd_pair.hpp"

namespace esmc::host {

/// A planar vector without a matrix library. T: double, or both legs at once.
template <class T>
struct Planar {
  T x{}, y{};
  friend Planar operator+(Planar a, Planar b) { return {a.x + b.x, a.y + b.y}; }
  friend Planar operator-(Planar a, Planar b) { return {a.x - b.x, a.y - b.y}; }
  friend Planar operator*(T k, Planar a) { return {k * a.x, k * a.y}; }
  friend T dot(Planar a, Planar b) { return a.x * b.x + a.y * b.y; }
};
using V2 = Planar<double>;

/// One leg in N (T = double), or the two legs of one or several 5R side by side, by Lagrange's equations in
/// absolute bar angles. `side` is +1 for leg 1 (and the RR arm), -1 for leg 2, whose model angles are
/// mirrored: psi = pi - theta.
template <class T>
class LegDynamics {
 public:
  using Vector = Planar<T>;

  LegDynamics() = default;
  /// `gravity` in m/s2; `tip_mass`: kg at the tip; base at (base_x, 0) in N, m.
  template <class Number>
  LegDynamics(const LegParams<T>& p, const Number& gravity, const Number& tip_mass, T base_x, T side)
      : l1_(p.l1),
        l2_(p.l2),
        base_x_(base_x),
        side_(side),
        i1_(p.J1 + p.m1 * p.lg1 * p.lg1 + (p.m2 + tip_mass) * p.l1 * p.l1 + p.rotor2),
        i2_(p.J2 + p.m2 * p.lg2 * p.lg2 + tip_mass * p.l2 * p.l2 + p.rotor2),
        coupling_((p.m2 * p.lg2 + tip_mass * p.l2) * p.l1),
        rotor_(p.rotor2),
        weight1_(gravity * (p.m1 * p.lg1 + (p.m2 + tip_mass) * p.l1)),
        weight2_(gravity * (p.m2 * p.lg2 + tip_mass * p.l2)),
        l11_(l1_ * l1_),
        l12_(l1_ * l2_),
        l22_(l2_ * l2_),
        i12_(i1_ * i2_) {}

  /// Where both bars point, and the inverse of the leg's mass matrix.
  struct Pose {
    Vector e1, e2;     // along the bars
    T sin_difference;  // of psi1 - psi2
    T m11, m12, m22;   // M^-1
  };
  [[nodiscard]] Pose pose(const SinCos<T>& bar1, const SinCos<T>& bar2) const {
    const T c1 = bar1.cos, s1 = bar1.sin, c2 = bar2.cos, s2 = bar2.sin;
    const T against = rotor_ - coupling_ * (c1 * c2 + s1 * s2);  // -M12
    const T inverse = 1.0 / (i12_ - against * against);
    return {{c1, s1}, {c2, s2}, s1 * c2 - c1 * s2, i2_ * inverse, against * inverse, i1_ * inverse};
  }

  struct Pair {
    T first, second;  // of the two bars
    friend Pair operator-(const Pair& a, const Pair& b) { return {a.first - b.first, a.second - b.second}; }
  };
  /// Joint torques (model convention: relative joints, mirrored for leg 2) as moments on the bars.
  [[nodiscard]] Pair on_bars(T tau1, T tau2) const { return {side_ * (tau1 - tau2), side_ * tau2}; }
  /// Q on the two bars, N m: weight, inertia forces of the bar rates w1, w2 (rad/s), joint torques tau1,
  /// tau2.
  [[nodiscard]] Pair force(const Pose& p, T w1, T w2, T tau1, T tau2) const {
    const T k = coupling_ * p.sin_difference;
    const Pair motors = on_bars(tau1, tau2);
    return {motors.first - k * w2 * w2 - weight1_ * p.e1.x, motors.second + k * w1 * w1 - weight2_ * p.e2.x};
  }
  /// M^-1 f: accelerations of the bars, rad/s2, under moments f, N m.
  [[nodiscard]] static Pair solve(const Pose& p, Pair f) {
    return {p.m11 * f.first + p.m12 * f.second, p.m12 * f.first + p.m22 * f.second};
  }
  /// J a: velocity of the tip, m/s, from bar rates, rad/s; or its acceleration at rest, from bar
  /// accelerations.
  [[nodiscard]] Vector tip_rate(const Pose& p, Pair w) const {
    const T a = l1_ * w.first, b = l2_ * w.second;
    return {-a * p.e1.y - b * p.e2.y, a * p.e1.x + b * p.e2.x};
  }
  /// J^T f: moments on the bars, N m, of a force on the tip, N.
  [[nodiscard]] Pair tip_force(const Pose& p, Vector f) const {
    return {l1_ * (p.e1.x * f.y - p.e1.y * f.x), l2_ * (p.e2.x * f.y - p.e2.y * f.x)};
  }
  /// The tip's acceleration, m/s2, at constant bar rates, rad/s.
  [[nodiscard]] Vector tip_bias(const Pose& p, T w1, T w2) const {
    const T a = l1_ * w1 * w1, b = l2_ * w2 * w2;
    return {-a * p.e1.x - b * p.e2.x, -a * p.e1.y - b * p.e2.y};
  }
  /// A symmetric 2 x 2 matrix.
  struct Symmetric {
    T xx, xy, yy;
    friend Symmetric operator+(Symmetric a, Symmetric b) { return {a.xx + b.xx, a.xy + b.xy, a.yy + b.yy}; }
  };
  /// J M^-1 J^T: acceleration of the tip per force on it, 1/kg, both in N.
  [[nodiscard]] Symmetric tip_mobility(const Pose& p) const {
    const T a = l11_ * p.m11, b = l22_ * p.m22, c = l12_ * p.m12;
    const T ax = a * p.e1.x + c * p.e2.x, ay = a * p.e1.y + c * p.e2.y;
    const T bx = b * p.e2.x + c * p.e1.x, by = b * p.e2.y + c * p.e1.y;
    return {ay * p.e1.y + by * p.e2.y, -(ax * p.e1.y + bx * p.e2.y), ax * p.e1.x + bx * p.e2.x};
  }
  /// Tip in N, m; e1, e2: unit vectors along the bars.
  [[nodiscard]] Vector tip(Vector e1, Vector e2) const {
    return {base_x_ + l1_ * e1.x + l2_ * e2.x, l1_ * e1.y + l2_ * e2.y};
  }
  /// Torques of the two joints (model convention) per force on the tip, N m per N: [joint](x, y).
  [[nodiscard]] std::array<Vector, 2> torque_per_force(const Pose& p) const {
    const Vector bar1{-side_ * l1_ * p.e1.y, side_ * l1_ * p.e1.x},
        bar2{-side_ * l2_ * p.e2.y, side_ * l2_ * p.e2.x};
    return {bar1 + bar2, bar2};
  }
  /// Kinetic and potential energy, J, the latter above the base; w1, w2: bar rates, rad/s.
  [[nodiscard]] T kinetic(Vector e1, Vector e2, T w1, T w2) const {
    return 0.5 * (i1_ * w1 * w1 + i2_ * w2 * w2) + (coupling_ * dot(e1, e2) - rotor_) * w1 * w2;
  }
  [[nodiscard]] T potential(Vector e1, Vector e2) const { return weight1_ * e1.y + weight2_ * e2.y; }  ///< J

 private:
  T l1_{}, l2_{}, base_x_{}, side_{};
  T i1_{}, i2_{}, coupling_{}, rotor_{}, weight1_{}, weight2_{};
  T l11_{}, l12_{}, l22_{}, i12_{};  // products of the above
};

/// The effector as a load sees it. Closure makes the tip of leg 1 stand for both.
template <class S>
struct EffectorPointOf {
  Planar<S> position, rate;
  std::array<Planar<S>, 2>
      torque_per_force;  ///< torque of joint i of leg 1 (or the arm) = dot(this[i], force)
};
using EffectorPoint = EffectorPointOf<double>;

/// The types of a plant. `angles`: of the bars; `joints` as in the model; `outputs`: of final_state.q.
template <class S, std::size_t angles, std::size_t joints_, std::size_t outputs_>
struct PlantTypes {
  using Scalar = S;
  static constexpr int coordinates = int{angles}, joints = int{joints_}, outputs = int{outputs_};
  using Angles = std::array<S, angles>;
  using Joints = std::array<S, joints_>;
  struct State {
    Angles angle{}, rate{};
  };
  struct Output {
    std::array<S, outputs_> q{}, qd{};
    Planar<S> effector, effector_rate;
    S closure{};  ///< |tip 1 - tip 2|, m
  };
};

/// Both: the two legs side by side, [0] and [1] being numbers of type S.
template <class Both, class S>
class FiveBarPlantOf : public PlantTypes<S, 4, 4, 6> {
  using Types = PlantTypes<S, 4, 4, 6>;

 public:
  // Coordinates psi11, psi12, psi21, psi22; joints theta11, theta12, theta21, theta22; outputs x, y and the
  // joints.
  using typename Types::Angles, typename Types::Joints, typename Types::State, typename Types::Output;

  /// `payload`: a further point mass at the effector, kg.
  explicit FiveBarPlantOf(const FiveBarParams<S>& p, S payload = 0.0)
      : legs_(side_by_side<Both>(p.legs[0], p.legs[1]), p.g, S(0.5 * (p.m0 + payload)), Both{p.l0, -p.l0},
              Both{1.0, -1.0}) {}

  /// State from the model's joint angles and rates (leg 2 mirrored).
  [[nodiscard]] static State from_joints(const Joints& theta, const Joints& rate) {
    constexpr double pi = 3.14159265358979323846;
    return {{theta[0], theta[0] + theta[1], pi - theta[2], pi - theta[2] - theta[3]},
            {rate[0], rate[0] + rate[1], -rate[2], -rate[2] - rate[3]}};
  }
  /// The model's joint angles (rates) from those of the bars: the inverse of from_joints.
  [[nodiscard]] static Joints joint_angles(const Angles& psi) {
    constexpr double pi = 3.14159265358979323846;
    return {psi[0], psi[1] - psi[0], pi - psi[2], psi[2] - psi[3]};
  }
  [[nodiscard]] static Joints joint_rates(const Angles& w) { return {w[0], w[1] - w[0], -w[2], w[2] - w[3]}; }

  /// Angular accelerations of the bars, rad/s2, under joint torques (model convention, N m). Not finite where
  /// closure loses its rank.
  [[nodiscard]] Angles acceleration(const Angles& angle, const Angles& rate, const Joints& torque) const;
  /// Change of the bars' rates, rad/s, by joint impulses `torque` alone, N m s, with closure kept.
  [[nodiscard]] Angles response(const Angles& angle, const Joints& torque) const;
  /// Moves angles and rates onto the closure, along the shortest way in the mass metric.
  void project(Angles& angle, Angles& rate) const;
  /// Where a load acts: the tip of leg 1, at angles and rates of the bars. Position (m) and rate (m/s) in
  /// frame N, and the torque (N m) of each joint of leg 1 per force (N) on the tip.
  [[nodiscard]] EffectorPointOf<S> effector_point(const Angles& angle, const Angles& rate) const;
  [[nodiscard]] Output output(const State& s) const;
  [[nodiscard]] S kinetic_energy(const State& s) const;
  [[nodiscard]] S potential_energy(const State& s) const;

 private:
  using Legs = LegDynamics<Both>;
  [[nodiscard]] typename Legs::Pose pose(const Angles& angle) const;
  /// The bars' motion that the tips' `gap` is made of: the smallest in the mass metric.
  [[nodiscard]] typename Legs::Pair closing(const typename Legs::Pose& p, Planar<S> gap) const;
  Legs legs_;
};
using FiveBarPlant = FiveBarPlantOf<Double2, double>;
extern template class FiveBarPlantOf<Double2, double>;

/// The true RR arm: one leg, nothing to close.
class RrPlant : public PlantTypes<double, 2, 2, 2> {
 public:
  explicit RrPlant(const RrParams<double>& p, double payload = 0.0) : leg_(p.arm, p.g, payload, 0.0, 1.0) {}

  [[nodiscard]] static State from_joints(const Joints& theta, const Joints& rate) {
    return {{theta[0], theta[0] + theta[1]}, {rate[0], rate[0] + rate[1]}};
  }
  [[nodiscard]] static Joints joint_angles(const Angles& psi) { return {psi[0], psi[1] - psi[0]}; }
  [[nodiscard]] static Joints joint_rates(const Angles& w) { return {w[0], w[1] - w[0]}; }

  [[nodiscard]] Angles acceleration(const Angles& angle, const Angles& rate, const Joints& torque) const {
    const Leg::Pose p = pose(angle);
    const Leg::Pair a = Leg::solve(p, leg_.force(p, rate[0], rate[1], torque[0], torque[1]));
    return {a.first, a.second};
  }
  [[nodiscard]] Angles response(const Angles& angle, const Joints& torque) const {
    const Leg::Pair a = Leg::solve(pose(angle), leg_.on_bars(torque[0], torque[1]));
    return {a.first, a.second};
  }
  void project(Angles&, Angles&) const {}
  [[nodiscard]] EffectorPoint effector_point(const Angles& angle, const Angles& rate) const {
    const Leg::Pose p = pose(angle);
    return {leg_.tip(p.e1, p.e2), leg_.tip_rate(p, {rate[0], rate[1]}), leg_.torque_per_force(p)};
  }
  [[nodiscard]] Output output(const State& s) const {
    const Leg::Pose p = pose(s.angle);
    return {joint_angles(s.angle), joint_rates(s.rate), leg_.tip(p.e1, p.e2),
            leg_.tip_rate(p, {s.rate[0], s.rate[1]}), 0.0};
  }
  [[nodiscard]] double kinetic_energy(const State& s) const {
    const Leg::Pose p = pose(s.angle);
    return leg_.kinetic(p.e1, p.e2, s.rate[0], s.rate[1]);
  }
  [[nodiscard]] double potential_energy(const State& s) const {
    const Leg::Pose p = pose(s.angle);
    return leg_.potential(p.e1, p.e2);
  }

 private:
  using Leg = LegDynamics<double>;
  [[nodiscard]] Leg::Pose pose(const Angles& angle) const {
    return leg_.pose(direction(angle[0]), direction(angle[1]));
  }
  Leg leg_;
};

}  // namespace esmc::host
