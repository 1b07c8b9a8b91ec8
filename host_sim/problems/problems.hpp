#pragma once
/// Benchmark problems as systems. The equations are those of closed_chains.hpp and of the five-bar's plant.

#include "host_sim/plant/plant.hpp"
#include "host_sim/problems/chain_system.hpp"

namespace esmc::host {

using Bar = Link<Joint::revolute>;
using Plate = Link<Joint::revolute, Shape::plate>;

/// Andrews' squeezing mechanism (Hairer, Wanner, Solving ODEs II, VII.7): crank and rod, whose tip carries
/// the tips of three more chains: K3; K5 and K4; K7 and K6. Positions beta, Theta, gamma, delta, Phi,
/// epsilon, Omega, rad: those of the literature, in the order of the chains.
using AndrewsChains =
    ClosedChains<Closures<TipOnTip<0, 1>, TipOnTip<0, 2>, TipOnTip<0, 3>>, Serial<double, Bar, Bar>,
                 Serial<double, Plate>, Serial<double, Plate, Bar>, Serial<double, Plate, Bar>>;
class Andrews : public ChainSystem<Andrews, AndrewsChains> {
 public:
  enum Angle : unsigned { beta, theta, gamma, delta, phi, epsilon, omega };

  Andrews();
  [[nodiscard]] State start() const;

  /// Drive torque on the crank, and the spring on K3.
  template <class Poses>
  void operator()(const Poses& poses, Coordinates& force) const {
    constexpr double torque = 0.033, stiffness = 4530.0, free_length = 0.07785;
    constexpr double sc = 0.018, sd = 0.02;  // where the spring holds K3, along and across its axis
    force[beta] += torque;
    const Vec2<double>& axis = poses(std::integral_constant<int, 1>{}).axis[0];
    const Vec2<double> arm = axis * sc + perp(axis) * sd;
    const Vec2<double> spring = arm - spring_from_k3_;
    const double length = std::sqrt(dot(spring, spring));
    force[gamma] += cross(arm, spring) * (-stiffness * (length - free_length) / length);
  }

 private:
  static AndrewsChains build();
  Vec2<double> spring_from_k3_{0.014 - -0.03635,
                               0.072 - 0.03273};  // its end on the ground, from the joint of K3
};

/// Two four-bars side by side (IFToMM benchmark A02, N = 2): rods A0 B0, A1 B1, A2 B2 on the ground, couplers
/// B0 B1 and B1 B2, all 1 m and 1 kg. B1 is where three chains meet: rod 0 with the first coupler, rod 1, rod
/// 2 with the second. Positions: rod 0, coupler 1 relative to it, rod 1, rod 2, coupler 2 relative to it,
/// rad. Lying flat, all closures in a line, it loses rank, and passes.
using FourBarChain = ClosedChains<Closures<TipOnTip<0, 1>, TipOnTip<2, 1>>, Serial<double, Bar, Bar>,
                                  Serial<double, Bar>, Serial<double, Bar, Bar>>;
class TwoFourBars : public ChainSystem<TwoFourBars, FourBarChain> {
 public:
  TwoFourBars();
  /// Start of the benchmark: rods upright, B0 moving at 1 m/s to the right.
  [[nodiscard]] State start() const;
  /// State of the parallelogram with its rods at an angle (rad) and a rate (rad/s).
  [[nodiscard]] static State parallelogram(double angle, double rate);
  /// Position of B0, m.
  [[nodiscard]] static Vec2<double> b0(const State& y) { return {std::cos(y[0]), std::sin(y[0])}; }
  [[nodiscard]] int rank(const State& y) const { return mechanism().rank(position(y)); }  ///< of closure

  template <class Poses>
  void operator()(const Poses&, Coordinates&) const {}
};

/// A simple pendulum in Cartesian coordinates (IFToMM benchmark A01): a point mass of 1 kg, 1 m from the
/// origin, from (-1, 0) at rest.
class Pendulum {
 public:
  static constexpr std::size_t positions = 2, capacity = 4;
  using State = std::array<double, capacity>;

  [[nodiscard]] static constexpr std::size_t size() { return capacity; }
  [[nodiscard]] static State start() { return {-1.0, 0.0, 0.0, 0.0}; }
  static void slope(double t, const State& y, State& dy);
  static void project(State& y);
};

/// 5R-FALL: a five-bar that falls from rest through both kinds of singularity. Positions: the four absolute
/// bar angles of FiveBarPlant.
class FallingFiveBar {
 public:
  static constexpr std::size_t positions = 4, capacity = 8;
  using State = std::array<double, capacity>;

  FallingFiveBar();
  explicit FallingFiveBar(const FiveBarParams<double>& p) : plant_(p) {}
  [[nodiscard]] static constexpr std::size_t size() { return capacity; }
  [[nodiscard]] State start() const;
  void slope(double t, const State& y, State& dy) const;
  void project(State& y) const;
  /// Effector x, y, m, and joint angles theta11, theta12, theta21, theta22, rad; and their rates.
  [[nodiscard]] FiveBarPlant::Output output(const State& y) const { return plant_.output(unpack(y)); }

 private:
  static FiveBarPlant::State unpack(const State& y);
  FiveBarPlant plant_;
};

}  // namespace esmc::host
