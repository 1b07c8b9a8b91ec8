#pragma once
/// What one reading says of the unknowns: a complex equation, its derivatives, and both in units of its own
/// uncertainty.

#include <Eigen/Cholesky>
#include <cmath>

#include "host_sim/calibrate/geometry.hpp"

namespace esmc::host {

/// residual(unknowns, angles) = 0, two rows. J: by the unknowns; its columns of the offsets are those by the
/// angles as well.
struct ResidualRow {
  Eigen::Vector2d residual;
  Eigen::Matrix<double, 2, unknowns> J = Eigen::Matrix<double, 2, unknowns>::Zero();
};
namespace detail {

inline Eigen::Vector2d pair_of(const std::complex<double>& z) { return {z.real(), z.imag()}; }

/// The bars as complex numbers in the base frame; those of leg 2, whose own frame is mirrored, from tip to
/// base.
struct Bars {
  std::complex<double> direction[4], bar[4];
  Bars(const Unknowns& u, const MeasuredAngles& a) {
    const double one = a[0] + u[unknown_o11], two = a[2] + u[unknown_o21];
    direction[0] = std::polar(1.0, one);
    direction[1] = std::polar(1.0, one + a[1] + u[unknown_o12]);
    direction[2] = std::polar(1.0, -two);
    direction[3] = std::polar(1.0, -two - a[3] - u[unknown_o22]);
    for (int i = 0; i < 4; ++i) bar[i] = u[unknown_l11 + i] * direction[i];
  }
};

}  // namespace detail

/// Tip of leg 1 less tip of leg 2: 2 l0 + l11 e^{i phi11} + l12 e^{i phi12} + l21 e^{-i phi21} + l22 e^{-i
/// phi22}.
inline ResidualRow closure_row(const Unknowns& u, bool, const MeasuredAngles& a, const EffectorReading*) {
  const detail::Bars b(u, a);
  const std::complex<double> i(0.0, 1.0);
  ResidualRow r;
  r.residual = detail::pair_of(2.0 * u[unknown_l0] + b.bar[0] + b.bar[1] + b.bar[2] + b.bar[3]);
  r.J.col(unknown_l0) << 2.0, 0.0;
  for (int k = 0; k < 4; ++k) r.J.col(unknown_l11 + k) = detail::pair_of(b.direction[k]);
  r.J.col(unknown_o11) = detail::pair_of(i * (b.bar[0] + b.bar[1]));
  r.J.col(unknown_o12) = detail::pair_of(i * b.bar[1]);
  r.J.col(unknown_o21) = detail::pair_of(-i * (b.bar[2] + b.bar[3]));
  r.J.col(unknown_o22) = detail::pair_of(-i * b.bar[3]);
  return r;
}

/// The reading, brought into the base frame, less the effector: the mean of both tips (RR: its tip).
inline ResidualRow effector_row(const Unknowns& u, bool five_bar, const MeasuredAngles& a,
                                const EffectorReading* reading) {
  const detail::Bars b(u, a);
  const std::complex<double> i(0.0, 1.0);
  const double half = five_bar ? 0.5 : 1.0, other = five_bar ? 0.5 : 0.0;
  const std::complex<double> turned =
      std::polar(1.0, u[unknown_fa]) * std::complex<double>(reading->x, reading->y);
  const std::complex<double> frame(u[unknown_fx], u[unknown_fy]);
  ResidualRow r;
  r.residual = detail::pair_of(frame + turned - half * (b.bar[0] + b.bar[1]) + other * (b.bar[2] + b.bar[3]));
  for (int k = 0; k < 4; ++k)
    r.J.col(unknown_l11 + k) = detail::pair_of((k < 2 ? -half : other) * b.direction[k]);
  r.J.col(unknown_o11) = detail::pair_of(-half * i * (b.bar[0] + b.bar[1]));
  r.J.col(unknown_o12) = detail::pair_of(-half * i * b.bar[1]);
  r.J.col(unknown_o21) = detail::pair_of(-other * i * (b.bar[2] + b.bar[3]));
  r.J.col(unknown_o22) = detail::pair_of(-other * i * b.bar[3]);
  r.J(0, unknown_fx) = r.J(1, unknown_fy) = 1.0;
  r.J.col(unknown_fa) = detail::pair_of(i * turned);
  return r;
}

/// A row in units of its uncertainty: angles with standard deviation `sigma`, and `own` of each coordinate.
/// `correct`: at the angles as corrected to fulfil it, where the derivatives are free of the readings' noise.
template <class RowOf>
ResidualRow whitened(RowOf row_of, const Unknowns& u, bool five_bar, MeasuredAngles angle,
                     const EffectorReading* reading, double sigma, double own, bool correct) {
  using Angles = Eigen::Vector4d;
  Angles by = Angles::Zero();
  ResidualRow r = row_of(u, five_bar, angle, reading);
  Eigen::LLT<Eigen::Matrix2d> root;
  for (int pass = 0;; ++pass) {
    const auto A = r.J.template middleCols<4>(unknown_o11);
    r.residual -= A * by;
    Eigen::Matrix2d S = sigma * sigma * (A * A.transpose());
    S.diagonal().array() += own * own + 1e-300;
    root.compute(S);
    if (!correct || pass == 2) break;
    const Angles next = -sigma * sigma * A.transpose() * root.solve(r.residual);
    if (!(next.cwiseAbs().maxCoeff() < 0.1)) break;  // no small correction: the derivatives as they are
    MeasuredAngles at = angle;
    for (int k = 0; k < 4; ++k) at[static_cast<std::size_t>(k)] += next[k];
    by = next;
    r = row_of(u, five_bar, at, reading);
  }
  root.matrixL().solveInPlace(r.residual);
  root.matrixL().solveInPlace(r.J);
  return r;
}

}  // namespace esmc::host
