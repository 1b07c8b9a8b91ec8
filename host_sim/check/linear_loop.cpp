#include "host_sim/check/linear_loop.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace esmc::host {
namespace {

/// Scales states by powers of two until each one's row is about as long as its column (Parlett and Reinsch),
/// which leaves the eigenvalues. In SI units the speeds of a small mechanism are 1e13 times its torques, and
/// the zeros of a delay line would otherwise appear at a root of what rounding is beside that.
void balance(Eigen::MatrixXcd& m) {
  constexpr int sweeps_most = 100;
  bool scaled = true;
  for (int sweep = 0; scaled && sweep < sweeps_most; ++sweep) {
    scaled = false;
    for (Eigen::Index i = 0; i < m.rows(); ++i) {
      const double own = std::abs(m(i, i)), column = m.col(i).cwiseAbs().sum() - own,
                   row = m.row(i).cwiseAbs().sum() - own;
      if (!(column > 0.0) || !(row > 0.0)) continue;
      const double by = std::exp2(std::round(0.5 * std::log2(row / column)));
      if (!(column * by + row / by < 0.95 * (column + row))) continue;
      m.col(i) *= by;
      m.row(i) /= by;
      scaled = true;
    }
  }
}

}  // namespace

StateSpace series(const StateSpace& a, const StateSpace& b) {
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
StateSpace parallel(const StateSpace& a, const StateSpace& b) {
  const auto both = [](const MatrixXd& p, const MatrixXd& q) {
    MatrixXd m = MatrixXd::Zero(p.rows() + q.rows(), p.cols() + q.cols());
    m.topLeftCorner(p.rows(), p.cols()) = p;
    m.bottomRightCorner(q.rows(), q.cols()) = q;
    return m;
  };
  return {both(a.A, b.A), both(a.B, b.B), both(a.C, b.C), both(a.D, b.D)};
}
StateSpace delay_line(Eigen::Index channels, int ticks) {
  const Eigen::Index m = channels, n = m * ticks;
  StateSpace s{MatrixXd::Zero(n, n), MatrixXd::Zero(n, m), MatrixXd::Zero(m, n), MatrixXd::Zero(m, m)};
  if (ticks == 0) s.D.setIdentity();
  if (ticks == 0) return s;
  s.B.topRows(m).setIdentity();
  s.A.bottomLeftCorner(n - m, n - m).setIdentity();
  s.C.rightCols(m).setIdentity();
  return s;
}

StateSpace sampled(const StateSpace& s, double tick, double delay) {
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

StateSpace reduced(const StateSpace& s) {
  using Flags = Eigen::Array<bool, Eigen::Dynamic, 1>;
  const Eigen::Index n = s.A.rows();
  const auto linked = [n](const auto& edge,
                          Flags in) {  // in, and all that edges lead to from there
    for (bool grows = true; grows;) {
      grows = false;
      for (Eigen::Index to = 0; to < n; ++to) {
        for (Eigen::Index from = 0; from < n && !in[to]; ++from) grows |= in[to] = in[from] && edge(to, from);
      }
    }
    return in;
  };
  Flags driven(n), read(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    driven[i] = !s.B.row(i).isZero(0.0);
    read[i] = !s.C.col(i).isZero(0.0);
  }
  const auto reached =
      linked([&](Eigen::Index to, Eigen::Index from) { return s.A(to, from) != 0.0; }, driven);
  const auto seen = linked([&](Eigen::Index to, Eigen::Index from) { return s.A(from, to) != 0.0; }, read);
  std::vector<Eigen::Index> kept;
  for (Eigen::Index i = 0; i < n; ++i) {
    if (reached[i] && seen[i]) kept.push_back(i);
  }
  return {s.A(kept, kept), s.B(kept, Eigen::all), s.C(Eigen::all, kept), s.D};
}

std::complex<double> leading(const Eigen::MatrixXcd& m) {
  Eigen::MatrixXcd alike = m;
  balance(alike);
  const Eigen::VectorXcd all = alike.eigenvalues();
  Eigen::Index at = 0;
  all.cwiseAbs().maxCoeff(&at);
  return all[at];
}

}  // namespace esmc::host
