#pragma once
/// The matrices of the report, written out for `esmc eval` and tests. A control tick forms none.

#include "firmware/mechanism/five_bar.hpp"
#include "firmware/mechanism/rr.hpp"

namespace esmc {

/// C (channels x 2), p = C p#, p# = (x', y') for the 5R [F13], joint rates for RR [F3].
template <class M, class S = typename M::Scalar>
[[nodiscard]] Mat<S, M::channels, 2> matrix_C(const M& m, const typename M::Pose& p) {
  Mat<S, M::channels, 2> out;
  for (int k = 0; k < 2; ++k) out.col(k) = m.channel_rates(p, m.chain_rates(p, Vec2<S>::Unit(k)));
  return out;
}

/// C_a (channels x 2): velocities of all channels per unit rate of the base joints theta11, theta21 (5R)
/// [F23]; for RR it is matrix_C. Not finite at type 2.
template <class M, class S = typename M::Scalar>
[[nodiscard]] Mat<S, M::channels, 2> matrix_C_base(const M& m, const typename M::Pose& p) {
  Mat<S, M::channels, 2> out;
  for (int k = 0; k < 2; ++k) out.col(k) = m.channel_rates(p, m.base_rates(p, Vec2<S>::Unit(k)));
  return out;
}

/// c = Cdot p# [F5], [F16]: accelerations of all channels while p# is constant.
template <class M>
[[nodiscard]] typename M::Channels bias(const M& m, const typename M::Pose& p, const typename M::Rates& r) {
  return m.channel_accelerations(p, r, m.chain_bias(p, r, r));
}

/// H = C^T M C [F20] of matrix_C (kg for the 5R) or matrix_C_base (kg m2), symmetric.
template <class M, class S = typename M::Scalar>
[[nodiscard]] Mat<S, 2, 2> mass_matrix(const M& m, const Mat<S, M::channels, 2>& C) {
  const typename M::Channels mass = m.mass();
  Mat<S, 2, 2> H = Mat<S, 2, 2>::Zero();
  for (int i = 0; i < M::channels; ++i) {
    H(0, 0) += C(i, 0) * mass[i] * C(i, 0);
    H(0, 1) += C(i, 0) * mass[i] * C(i, 1);
    H(1, 1) += C(i, 1) * mass[i] * C(i, 1);
  }
  H(1, 0) = H(0, 1);
  return H;
}

/// C^T w of matrix_C or matrix_C_base: force on the independent coordinates by forces w on the channels.
template <class M, class S = typename M::Scalar>
[[nodiscard]] Vec2<S> gather(const Mat<S, M::channels, 2>& C, const typename M::Channels& w) {
  Vec2<S> out = Vec2<S>::Zero();
  for (int i = 0; i < M::channels; ++i) out += C.row(i).transpose() * w[i];
  return out;
}

/// A = [J, -1] of a dyad [F1], 6 x 8: A p = 0 for all velocities p.
template <class S>
[[nodiscard]] Mat<S, 6, 8> matrix_A(const Dyad<S>& leg, const typename Dyad<S>::Pose& p) {
  Mat<S, 6, 8> A = Mat<S, 6, 8>::Zero();
  for (int k = 0; k < 2; ++k) A.col(k) = leg.rates(p, Vec2<S>::Unit(k)).template tail<6>();
  A.template rightCols<6>() = -Mat<S, 6, 6>::Identity();
  return A;
}
/// A = [J, -1] of the RR arm [F1], 6 x 8: A p = 0 for all velocities p.
template <class S>
[[nodiscard]] Mat<S, 6, 8> matrix_A(const Rr<S>& m, const typename Rr<S>::Pose& p) {
  return matrix_A(m.arm(), p.arm);
}

/// A of the 5R (16 x 18) [F14]: the legs' own rows, then the rates of the closures x - l0 - X1, y - Y1,
/// x + l0 + X2, y - Y2.
template <class S>
[[nodiscard]] Mat<S, 16, 18> matrix_A(const FiveBar<S>& m, const typename FiveBar<S>::Pose& p) {
  Mat<S, 16, 18> A = Mat<S, 16, 18>::Zero();
  for (int j = 0; j < 2; ++j) {
    const auto& leg = p.leg[j];
    const int column = FiveBar<S>::row_leg(j), row = 12 + 2 * j;
    A.template block<6, 8>(6 * j, column) = matrix_A(m.leg(j), leg);
    A(row, 0) = A(row + 1, 1) = S(1);
    for (int k = 0; k < 2; ++k) {
      A.template block<2, 1>(row, column + k) =
          -m.frame(j).from_leg(m.leg(j).tip_rate(leg, Vec2<S>::Unit(k)));
    }
  }
  return A;
}

/// b = -Adot p of a dyad, so that A pdot = b [F4]. qd: joint rates, rad/s.
template <class S>
[[nodiscard]] Vec<S, 6> vector_b(const Dyad<S>& leg, const typename Dyad<S>::Pose& p, const Vec2<S>& qd) {
  return -leg.bias(p, qd, qd).template tail<6>();
}
/// b = -Adot p of the RR arm, so that A pdot = b [F4]. qd: joint rates, rad/s.
template <class S>
[[nodiscard]] Vec<S, 6> vector_b(const Rr<S>& m, const typename Rr<S>::Pose& p, const Vec2<S>& qd) {
  return vector_b(m.arm(), p.arm, qd);
}
/// b = -Adot p of the 5R, so that A pdot = b [F15]. r: rates of effector and joints.
template <class S>
[[nodiscard]] Vec<S, 16> vector_b(const FiveBar<S>& m, const typename FiveBar<S>::Pose& p,
                                  const typename FiveBar<S>::Rates& r) {
  Vec<S, 16> b;
  for (int j = 0; j < 2; ++j) {
    b.template segment<6>(6 * j) = vector_b(m.leg(j), p.leg[j], r.leg[j]);
    b.template segment<2>(12 + 2 * j) = m.frame(j).from_leg(m.leg(j).tip_bias(p.leg[j], r.leg[j], r.leg[j]));
  }
  return b;
}

/// C^ (6 x 2) of the 5R [F12]: (x', y') to x', y' and the four joint rates.
template <class S>
[[nodiscard]] Mat<S, 6, 2> matrix_Chat(const FiveBar<S>& m, const typename FiveBar<S>::Pose& p) {
  Mat<S, 6, 2> out;
  for (int k = 0; k < 2; ++k) {
    const auto r = m.chain_rates(p, Vec2<S>::Unit(k));
    out.col(k) << r.platform, r.leg[0], r.leg[1];
  }
  return out;
}

/// H^-1 F of a symmetric positive definite H, which is not checked; its lower triangle is not read.
template <class S>
[[nodiscard]] Vec2<S> solve_spd(const Mat<S, 2, 2>& H, const Vec2<S>& F) {
  const S factor = H(0, 1) / H(0, 0);
  const S y = (F[1] - factor * F[0]) / (H(1, 1) - factor * H(0, 1));
  return {(F[0] - H(0, 1) * y) / H(0, 0), y};
}

}  // namespace esmc
