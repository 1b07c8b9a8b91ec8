#pragma once
/// Linear sampled systems, and how much gain, phase or delay the loop of two of them bears. State space
/// throughout, so that stability is an eigenvalue and nothing has to be counted along a curve.

#include <Eigen/Dense>
#include <cmath>
#include <complex>
#include <cstdint>
#include <functional>
#include <optional>

namespace esmc::host {

using Eigen::MatrixXd;
using Eigen::VectorXd;
struct Moment;
struct Scene;

/// x' = A x + B u, y = C x + D u; x' is the next state, or with continuous time its slope.
struct StateSpace {
  MatrixXd A, B, C, D;
};

/// Central differences of f at x, each number moved by `by` either way.
template <class F>
[[nodiscard]] MatrixXd jacobian(const F& f, const VectorXd& x, double by) {
  MatrixXd out(f(x).size(), x.size());
  for (Eigen::Index i = 0; i < x.size(); ++i) {
    VectorXd up = x, down = x;
    up[i] += by;
    down[i] -= by;
    out.col(i) = (f(up) - f(down)) / (up[i] - down[i]);
  }
  return out;
}
/// The system whose next state and output, one after the other, f gives of state and input: linearised at x.
template <class F>
[[nodiscard]] StateSpace linearised(const F& f, const VectorXd& x, Eigen::Index states, double by) {
  const MatrixXd j = jacobian(f, x, by);
  const Eigen::Index in = j.cols() - states, out = j.rows() - states;
  return {j.topLeftCorner(states, states), j.topRightCorner(states, in), j.bottomLeftCorner(out, states),
          j.bottomRightCorner(out, in)};
}

/// `a`, whose output is the input of `b`.
[[nodiscard]] StateSpace series(const StateSpace& a, const StateSpace& b);
/// `a` and `b` side by side.
[[nodiscard]] StateSpace parallel(const StateSpace& a, const StateSpace& b);
/// `channels` signals, each late by `ticks` >= 0.
[[nodiscard]] StateSpace delay_line(Eigen::Index channels, int ticks);
/// The continuous system over `tick`, s, with a held input that acts `delay`, s, >= 0 late.
[[nodiscard]] StateSpace sampled(const StateSpace& s, double tick, double delay);
/// The system without states that its input does not reach, or that its output does not depend on.
[[nodiscard]] StateSpace reduced(const StateSpace& s);
/// The eigenvalue of largest modulus of a square, finite matrix.
[[nodiscard]] std::complex<double> leading(const Eigen::MatrixXcd& m);

/// Where a property ends that holds at `from`, going by `factor` as far as `to`; empty: it holds all the way.
template <class F>
[[nodiscard]] std::optional<double> end_of(const F& holds, double from, double to, double factor) {
  if (!holds(from)) return from;
  double at = from;
  while (holds(at * factor)) {
    at *= factor;
    if (factor > 1.0 ? at >= to : at <= to) return std::nullopt;
  }
  double beyond = at * factor;
  while (std::abs(beyond / at - 1.0) > 1e-4) {
    const double middle = std::sqrt(at * beyond);
    (holds(middle) ? at : beyond) = middle;
  }
  return at;
}

/// Calls f(moment, plant, feedback) for at most `poses` poses at rest along the reference after its join: the
/// plant in continuous time, and from its outputs to the torques of the motors, tick by tick. Throws
/// InputError where the reference leaves the reach, RunError where the controller does not run there.
void for_each_pose(const Scene& scene, std::uint32_t poses,
                   const std::function<void(const Moment&, const StateSpace&, const StateSpace&)>& f);
/// Delay of the torque, s, with the delay of the readings: once around the loop they are the same. Throws
/// InputError beyond 50 ticks.
[[nodiscard]] double loop_delay(const Scene& scene);

}  // namespace esmc::host
