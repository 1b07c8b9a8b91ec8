#pragma once
/// From the generalised force of a law to motor torques (model.md section 7).

#include "firmware/mechanism/five_bar.hpp"

namespace esmc {

/// Joint torques tau (N m) with R^T tau = F and least tau^T W tau, W diagonal > 0 [F26]: weighted minimum
/// norm by Gram-Schmidt QR of W^-1/2 R, which does not square the condition number as the normal equations
/// do. rows: R, independent rates to joint rates; F: force on the independent coordinates. Only the ratios of
/// the weights count. Nearly parallel columns of R give torques that are huge or not finite.
template <class S>
[[nodiscard]] Vec<S, 4> minimum_norm(const Mat<S, 4, 2>& rows, const Vec2<S>& F, const Vec<S, 4>& weight) {
  Vec<S, 4> root;  // W^-1/2
  unroll<4>([&](auto i) { root[i] = S(1) / square_root(weight[i]); });
  List<S, 4> a{}, b{};
  S aa(0), ab(0), bb(0);
  unroll<4>([&](auto i) {
    a[i] = rows(int(i), 0) * root[i];
    b[i] = rows(int(i), 1) * root[i];
    aa += a[i] * a[i];
    bb += b[i] * b[i];
  });
  // The longer column first: one term then meets its force, not the difference of two. Of equal ones the
  // first.
  const bool swapped = bb > aa;
  const List<S, 4>&first = swapped ? b : a, &second = swapped ? a : b;
  const S norm1 = square_root(swapped ? bb : aa);
  List<S, 4> q1{}, q2{};
  unroll<4>([&](auto i) { q1[i] = first[i] / norm1; });
  unroll<4>([&](auto i) { ab += q1[i] * second[i]; });
  unroll<4>([&](auto i) { q2[i] = second[i] - ab * q1[i]; });
  S again(0);  // once more: Gram-Schmidt loses orthogonality when the columns are nearly parallel
  unroll<4>([&](auto i) { again += q1[i] * q2[i]; });
  S square(0);
  unroll<4>([&](auto i) {
    q2[i] -= again * q1[i];
    square += q2[i] * q2[i];
  });
  const S norm2 = square_root(square);
  const S y1 = F[swapped ? 1 : 0] / norm1;
  const S y2 = (F[swapped ? 0 : 1] - ab * y1) / norm2;
  Vec<S, 4> tau;
  unroll<4>([&](auto i) { tau[i] = root[i] * (q1[i] * y1 + q2[i] * (y2 / norm2)); });
  return tau;
}

/// The task of the four motors of a 5R: R^T tau = F.
template <class S>
struct FourMotors {
  Mat<S, 4, 2> rows;  ///< R: independent rates to (theta11', theta12', theta21', theta22')
  Vec2<S> F;          ///< on the independent coordinates: N m (base joints) or N (x, y)
};

/// R and F that motor torques must meet to replace forces w (N, N m) on the channels, in the better
/// conditioned coordinates: base joints near type 1 and at a tie, (x, y) near type 2.
template <class S>
[[nodiscard]] FourMotors<S> four_motors(const FiveBar<S>& m, const typename FiveBar<S>::Pose& p,
                                        const typename FiveBar<S>::Channels& w) {
  FourMotors<S> out;
  const bool by_base = FiveBar<S>::abs_sin_type2(p) >= FiveBar<S>::min_abs_sin_type1(p);
  out.F = by_base ? m.base_torque(p, w) : m.platform_force(p, w);
  unroll<2>([&](auto k) {
    const Vec2<S> unit = Vec2<S>::Unit(k);
    const auto r = by_base ? m.base_rates(p, unit) : m.chain_rates(p, unit);
    out.rows.col(int(k)) << r.leg[0], r.leg[1];
  });
  return out;
}

/// Torques of all four motors of a 5R (N m) for forces w on its channels, least tau^T W tau [F26].
template <class S>
[[nodiscard]] Vec<S, 4> allocate_all(const FiveBar<S>& m, const typename FiveBar<S>::Pose& p,
                                     const typename FiveBar<S>::Channels& w, const Vec<S, 4>& weight) {
  const FourMotors<S> four = four_motors(m, p, w);
  return minimum_norm(four.rows, four.F, weight);
}

}  // namespace esmc
