#pragma once
/// Linear sampled systems, and how much gain, phase or delay the loop of two of them bears. State space
/// throughout, so that stability is an eigenvalue and nothing has to be counted along a curve.

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <complex>
#include <cstdint>
#include <functional>
#include <numbers>
#include <optional>
#include <vector>

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
[[nodiscard]] inline StateSpace series(const StateSpace& a, const StateSpace& b) {
  const Eigen::Index n = a.A.rows(), m = b.A.rows();
  StateSpace s{MatrixXd::Zero(n + m, n + m), MatrixXd(n + m, a.B.cols()), MatrixXd(b.C.rows(), n + m),
               b.D * a.D};
  s.A.topLeftCorner(n, n) = a.A;
  s.A.bottomLeftCorner(m, n) = b.B * a.C;
  s.A.bottomRightCorner(m, m) = b.A;
  s.B << a.B, b.B * a.D;
  s.C << b.D * a.C, b.C;
  return s;
}
/// `a` and `b` side by side.
[[nodiscard]] inline StateSpace parallel(const StateSpace& a, const StateSpace& b) {
  const auto both = [](const MatrixXd& p, const MatrixXd& q) {
    MatrixXd m = MatrixXd::Zero(p.rows() + q.rows(), p.cols() + q.cols());
    m.topLeftCorner(p.rows(), p.cols()) = p;
    m.bottomRightCorner(q.rows(), q.cols()) = q;
    return m;
  };
  return {both(a.A, b.A), both(a.B, b.B), both(a.C, b.C), both(a.D, b.D)};
}
/// `channels` signals, each late by `ticks` >= 0.
[[nodiscard]] inline StateSpace delay_line(Eigen::Index channels, int ticks) {
  const Eigen::Index m = channels, n = m * ticks;
  StateSpace s{MatrixXd::Zero(n, n), MatrixXd::Zero(n, m), MatrixXd::Zero(m, n), MatrixXd::Zero(m, m)};
  if (ticks == 0) s.D.setIdentity();
  if (ticks == 0) return s;
  s.B.topRows(m).setIdentity();
  s.A.bottomLeftCorner(n - m, n - m).setIdentity();
  s.C.rightCols(m).setIdentity();
  return s;
}

/// The continuous system over `tick`, s, with a held input that acts `delay`, s, >= 0 late.
[[nodiscard]] inline StateSpace sampled(const StateSpace& s, double tick, double delay) {
  const Eigen::Index n = s.A.rows(), m = s.B.cols();
  const auto held = [&](double time) {  // e^(M time), M = [A B; 0 0]: transition, and effect of the input
    MatrixXd a = MatrixXd::Zero(n + m, n + m);
    a.topRows(n) << s.A * time, s.B * time;
    const int halvings = std::max(0, static_cast<int>(std::ceil(std::log2(a.norm() + 1e-300))) + 3);
    a *= std::ldexp(1.0, -halvings);
    MatrixXd sum = MatrixXd::Identity(n + m, n + m), term = sum;
    for (int k = 1; k <= 14; ++k) sum += term = (term * a / k).eval();
    for (int k = 0; k < halvings; ++k) sum = (sum * sum).eval();
    return sum;
  };
  const double late = delay / tick;
  const int whole = static_cast<int>(late + 1e-9);
  const double part = std::max(0.0, late - whole) * tick;  // of the tick, in which the input before acts
  const MatrixXd before = held(part), after = held(tick - part), phi = after.topLeftCorner(n, n);
  StateSpace out{MatrixXd::Zero(n + m, n + m), MatrixXd(n + m, m), MatrixXd::Zero(s.C.rows(), n + m),
                 MatrixXd::Zero(s.C.rows(), m)};
  out.A.topRows(n) << phi * before.topLeftCorner(n, n), phi * before.topRightCorner(n, m);
  out.B << after.topRightCorner(n, m), MatrixXd::Identity(m, m);
  out.C.leftCols(n) = s.C;
  return series(delay_line(m, whole), out);
}

/// The system without states that its input does not reach, or that its output does not depend on.
[[nodiscard]] inline StateSpace reduced(const StateSpace& s) {
  const auto linked = [&](const MatrixXd& along, Eigen::Array<bool, Eigen::Dynamic, 1> in) {
    for (Eigen::Index k = 0; k < in.size(); ++k)
      in = in || (along.array() != 0.0).matrix().cast<int>().operator*(in.matrix().cast<int>()).array() > 0;
    return in;
  };
  const auto reached = linked(s.A, (s.B.array() != 0.0).rowwise().any());
  const auto seen = linked(s.A.transpose(), (s.C.array() != 0.0).colwise().any().transpose());
  std::vector<Eigen::Index> kept;
  for (Eigen::Index i = 0; i < s.A.rows(); ++i) {
    if (reached[i] && seen[i]) kept.push_back(i);
  }
  return {s.A(kept, kept), s.B(kept, Eigen::all), s.C(Eigen::all, kept), s.D};
}

/// The eigenvalue of largest modulus of a square matrix.
template <class Matrix>
[[nodiscard]] std::complex<double> leading(const Matrix& m) {
  const Eigen::VectorXcd all = m.eigenvalues();
  Eigen::Index at = 0;
  all.cwiseAbs().maxCoeff(&at);
  return all[at];
}

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
