#pragma once
/// Benchmark problems as systems. The equations are those of closed_chains.hpp.

#include "host_sim/integrate/system.hpp"
#include "host_sim/problems/closed_chains.hpp"

namespace esmc::host {

/// A System of closed chains; Derived adds mounting and loads.
template <class Derived, class Mechanism>
class ChainSystem {
 public:
  static constexpr std::size_t positions = Mechanism::coordinates;
  static constexpr std::size_t capacity = 2 * positions;
  using State = std::array<double, capacity>;
  using Coordinates = typename Mechanism::Coordinates;

  explicit ChainSystem(const Mechanism& m) : mechanism_(m) {}

  [[nodiscard]] static constexpr std::size_t size() { return capacity; }
  void slope(double, const State& y, State& dy) const {
    const Coordinates q = position(y), v = rate(y);
    put(v, mechanism_.acceleration(q, v, static_cast<const Derived&>(*this)), dy);
  }
  void project(State& y) const {
    Coordinates q = position(y), v = rate(y);
    mechanism_.project(q, v);
    put(q, v, y);
  }
  [[nodiscard]] const Mechanism& mechanism() const { return mechanism_; }

  static Coordinates position(const State& y) { return Eigen::Map<const Coordinates>(y.data()); }
  static Coordinates rate(const State& y) { return Eigen::Map<const Coordinates>(y.data() + positions); }
  static void put(const Coordinates& first, const Coordinates& second, State& y) {
    Eigen::Map<Coordinates>(y.data()) = first;
    Eigen::Map<Coordinates>(y.data() + positions) = second;
  }

 private:
  Mechanism mechanism_;
};

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
  [[nodiscard]] State start() const;  ///< at rest, closed, as the literature gives it

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

  template <class Poses>
  void operator()(const Poses&, Coordinates&) const {}  ///< no load besides weight
};

/// A pendulum in Cartesian coordinates (IFToMM benchmark A01): 1 kg, 1 m from the origin, at rest in (-1, 0).
class Pendulum {
 public:
  static constexpr std::size_t positions = 2, capacity = 4;
  using State = std::array<double, capacity>;

  [[nodiscard]] static constexpr std::size_t size() { return capacity; }
  [[nodiscard]] static State start() { return {-1.0, 0.0, 0.0, 0.0}; }
  static void slope(double t, const State& y, State& dy);
  static void project(State& y);
};

}  // namespace esmc::host
