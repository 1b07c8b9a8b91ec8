#pragma once
/// Torques of four motors with torque limits and a preload that keeps their gears on one side.
///
/// Problem: least tau^T W tau with R^T tau = F and lower <= tau <= upper. F leaves a plane of torques free,
/// N z with R^T N = 0 [F26]. With N orthonormal in W the solution is the point of a polygon of at most eight
/// sides that is closest to the minimum without bounds. All candidates are tried: no iteration, no tolerance,
/// a fixed number of steps.
///
/// The attainable forces are a polygon in closed form: the sum of the segments [lower_i, upper_i] a_i (a_i:
/// row of R), with sides parallel to the a_i.

#include <limits>

#include "firmware/control/allocation.hpp"

namespace esmc {

/// Bounds of each motor, N m.
template <class S>
struct TorqueBox {
  Vec<S, 4> lower, upper;
};

/// Result of an allocation: torques, and the shares of the wanted force and preload that they give.
template <class S>
struct BoxAllocation {
  Vec<S, 4> torque;  ///< N m, within the limits
  S force{1};        ///< share of F that is met, same direction; < 1: saturated
  S preload{1};      ///< 1: all of the preload; 0: motors may go to their limits on either side
};

namespace box {

template <class S>
[[nodiscard]] constexpr S larger_of(S a, S b) {
  return b > a ? b : a;
}

/// A side of the polygon of forces, parallel to the row of `motor`, which is free; the others are at a bound.
struct Side {
  int motor = -1;      ///< -1: not on a side
  bool upper = false;  ///< of the two sides the one with the larger force across
};

/// Largest share of F, 0 to 1, that motors within +-limit (N m) attain; below 1 it sets the side `reached`.
template <class S>
[[nodiscard]] S attainable(const Mat<S, 4, 2>& rows, const Vec2<S>& F, const Vec<S, 4>& limit,
                           Side& reached) {
  S share(1);
  for (int i = 0; i < 4; ++i) {
    const Vec2<S> side = rows.row(i).transpose();
    S width(0);
    for (int j = 0; j < 4; ++j) width += limit[j] * magnitude(cross(Vec2<S>(rows.row(j).transpose()), side));
    const S across = cross(F, side), asked = magnitude(across);
    if (asked * share > width) {
      share = width / asked;
      reached = {i, across > S(0)};
    }
  }
  return share;
}

/// Least share, 0 to 1, by which the bounds `wanted` must widen towards +-limit (N m) to attain F; above 0 it
/// sets the side `reached`.
template <class S>
[[nodiscard]] S widening(const Mat<S, 4, 2>& rows, const Vec2<S>& F, const TorqueBox<S>& wanted,
                         const Vec<S, 4>& limit, Side& reached) {
  S out(0);
  const auto widen = [&](S much, Side side) {
    if (!(much > out)) return;
    out = much < S(1) ? much : S(1);
    reached = side;
  };
  for (int i = 0; i < 4; ++i) {
    const Vec2<S> side = rows.row(i).transpose();
    const S asked = cross(F, side);
    S highest(0), lowest(0), widest(0);  // forces of the motors across this side
    for (int j = 0; j < 4; ++j) {
      const S c = cross(Vec2<S>(rows.row(j).transpose()), side);
      highest += c * (c > S(0) ? wanted.upper[j] : wanted.lower[j]);
      lowest += c * (c > S(0) ? wanted.lower[j] : wanted.upper[j]);
      widest += magnitude(c) * limit[j];
    }
    if (asked > highest && widest > highest) widen((asked - highest) / (widest - highest), {i, true});
    if (asked < lowest && lowest > -widest) widen((lowest - asked) / (lowest + widest), {i, false});
  }
  return out;
}

/// The only torques that give a force F on the side `at` (motor >= 0): every other motor is at its bound.
template <class S>
[[nodiscard]] Vec<S, 4> on_side(const Mat<S, 4, 2>& rows, const Vec2<S>& F, const TorqueBox<S>& bounds,
                                Side at) {
  const Vec2<S> side = rows.row(at.motor).transpose();
  Vec<S, 4> torque;
  Vec2<S> left = F;
  for (int j = 0; j < 4; ++j) {
    if (j == at.motor) continue;
    const Vec2<S> row = rows.row(j).transpose();
    torque[j] = (cross(row, side) > S(0)) == at.upper ? bounds.upper[j] : bounds.lower[j];
    left -= row * torque[j];
  }
  torque[at.motor] = dot(left, side) / dot(side, side);
  return torque;
}

/// N: two torque vectors without effect on the motion: R^T N = 0, N^T W N = 1. root: W^-1/2, all > 0.
template <class S>
[[nodiscard]] Mat<S, 4, 2> null_space(const Mat<S, 4, 2>& rows, const Vec<S, 4>& root) {
  Mat<S, 4, 4> q;  // orthonormal; the first two span W^-1/2 R
  Vec<S, 4> a = root.cwiseProduct(rows.col(0)), b = root.cwiseProduct(rows.col(1));
  const bool swapped = b.squaredNorm() > a.squaredNorm();
  q.col(0) = swapped ? b : a;
  q.col(1) = swapped ? a : b;
  for (int n = 0; n < 4; ++n) {
    if (n > 1) {  // the axis that is farthest from the columns so far
      int axis = 0;
      S farthest(-1);
      for (int i = 0; i < 4; ++i) {
        S left(1);
        for (int k = 0; k < n; ++k) left -= q(i, k) * q(i, k);
        if (left > farthest) {
          farthest = left;
          axis = i;
        }
      }
      q.col(n).setZero();
      q(axis, n) = S(1);
    }
    for (int twice = 0; twice < 2; ++twice) {  // once loses orthogonality where columns are nearly parallel
      for (int k = 0; k < n; ++k) {
        S along(0);
        for (int i = 0; i < 4; ++i) along += q(i, k) * q(i, n);
        for (int i = 0; i < 4; ++i) q(i, n) -= along * q(i, k);
      }
    }
    S square(0);
    for (int i = 0; i < 4; ++i) square += q(i, n) * q(i, n);
    const S norm = square_root(square);
    for (int i = 0; i < 4; ++i) q(i, n) = q(i, n) / norm;
  }
  Mat<S, 4, 2> out;
  for (int i = 0; i < 4; ++i) {
    out(i, 0) = root[i] * q(i, 2);
    out(i, 1) = root[i] * q(i, 3);
  }
  return out;
}

/// The polygon lower <= from + n z <= upper, and its point closest to z = 0.
template <class S>
class Polygon {
 public:
  /// Keeps references to `from`, `n` and `bounds`, which must outlive it. A torque that exceeds its bound by
  /// at most `slack`, N m, counts as inside.
  Polygon(const Vec<S, 4>& from, const Mat<S, 4, 2>& n, const TorqueBox<S>& bounds, S slack)
      : from_(from), n_(n), bounds_(bounds), slack_(slack), torque_(from) {}

  /// Torques of the closest point, N m; where rounding leaves no point inside, of the one outside by least.
  [[nodiscard]] Vec<S, 4> closest() {
    consider(Vec2<S>(S(0), S(0)), -1, S(0), -1, S(0));
    for (int i = 0; i < 4; ++i) {
      // The closest point lies on one of the bounds that `from` violates.
      if (!(from_[i] < bounds_.lower[i]) && !(from_[i] > bounds_.upper[i])) continue;
      const S edge = from_[i] < bounds_.lower[i] ? bounds_.lower[i] : bounds_.upper[i];
      const Vec2<S> a = n_.row(i).transpose();
      const S square = a[0] * a[0] + a[1] * a[1], c = edge - from_[i];
      if (square > S(0)) consider(Vec2<S>(a[0] * c / square, a[1] * c / square), i, edge, -1, S(0));
      for (int j = 0; j < 4; ++j) {
        if (j == i) continue;
        meet(i, edge, j, bounds_.lower[j]);
        meet(i, edge, j, bounds_.upper[j]);
      }
    }
    return torque_;
  }

 private:
  void meet(int i, S edge_i, int j, S edge_j) {
    const Vec2<S> a = n_.row(i).transpose(), b = n_.row(j).transpose();
    const S det = cross(a, b), ci = edge_i - from_[i], cj = edge_j - from_[j];
    if (det != S(0))
      consider(Vec2<S>((ci * b[1] - cj * a[1]) / det, (cj * a[0] - ci * b[0]) / det), i, edge_i, j, edge_j);
  }
  /// Takes the candidate z if it is better. `i`, `j`: motors that are at an edge there; -1: none.
  void consider(const Vec2<S>& z, int i, S edge_i, int j, S edge_j) {
    Vec<S, 4> torque;
    S outside(0);
    for (int k = 0; k < 4; ++k) {
      torque[k] = k == i ? edge_i : (k == j ? edge_j : from_[k] + n_(k, 0) * z[0] + n_(k, 1) * z[1]);
      outside = larger_of(outside, larger_of(bounds_.lower[k] - torque[k], torque[k] - bounds_.upper[k]));
    }
    if (!(outside > slack_)) outside = S(0);
    const S distance = z[0] * z[0] + z[1] * z[1];
    if (!(distance <= std::numeric_limits<S>::max())) return;
    if (!none_ && !(outside < outside_) && !(outside == outside_ && distance < distance_)) return;
    none_ = false;
    outside_ = outside;
    distance_ = distance;
    torque_ = torque;
  }

  const Vec<S, 4>& from_;
  const Mat<S, 4, 2>& n_;
  const TorqueBox<S>& bounds_;
  S slack_;
  Vec<S, 4> torque_;
  S outside_{}, distance_{};
  bool none_ = true;
};

/// Clamps the torques to +-limit, N m: removes rounding errors.
template <class S>
[[nodiscard]] BoxAllocation<S> clamped(BoxAllocation<S> a, const Vec<S, 4>& limit) {
  for (int i = 0; i < 4; ++i) {
    if (a.torque[i] > limit[i]) a.torque[i] = limit[i];
    if (a.torque[i] < -limit[i]) a.torque[i] = -limit[i];
  }
  return a;
}

}  // namespace box

/// Torques tau (N m) of least tau^T W tau, W > 0, with R^T tau = F and every |tau_i| <= limit_i. rows: R, as
/// in FourMotors; weight: diagonal of W. The bits of minimum_norm where no bound is met.
/// preload: motor i stays at or above preload_i where that is > 0, at or below where it is < 0, free at 0;
/// |preload_i| <= limit_i. If F needs more, the preload of all motors gives way by the same share, towards
/// the opposite limit; if that does not suffice, F is shortened. F not finite: nor are the torques.
template <class S>
[[nodiscard]] BoxAllocation<S> allocate_within(const Mat<S, 4, 2>& rows, const Vec2<S>& F,
                                               const Vec<S, 4>& weight, const Vec<S, 4>& limit,
                                               const Vec<S, 4>& preload) {
  constexpr S epsilon = std::numeric_limits<S>::epsilon();
  BoxAllocation<S> out{minimum_norm(rows, F, weight)};
  TorqueBox<S> bounds{-limit, limit};
  for (int i = 0; i < 4; ++i) {
    if (preload[i] > S(0)) bounds.lower[i] = preload[i];
    if (preload[i] < S(0)) bounds.upper[i] = preload[i];
  }
  bool inside = true, beyond = false, known = true;
  S largest(0);
  for (int i = 0; i < 4; ++i) {
    known = known && magnitude(out.torque[i]) <= std::numeric_limits<S>::max();
    inside = inside && out.torque[i] >= bounds.lower[i] && out.torque[i] <= bounds.upper[i];
    beyond = beyond || magnitude(out.torque[i]) > limit[i];
    largest = box::larger_of(largest, limit[i]);
  }
  if (inside || !known) return out;
  const S slack = S(64) * epsilon * largest;
  Vec2<S> force = F;
  box::Side side;
  if (beyond) {
    out.force = box::attainable(rows, F, limit, side);
    force *= out.force;
    out.torque *= out.force;
  }
  const S wide = box::widening(rows, force, bounds, limit, side);
  if (wide > S(0)) {
    out.preload = S(1) - wide;
    for (int i = 0; i < 4; ++i) {
      bounds.lower[i] -= wide * (bounds.lower[i] + limit[i]);
      bounds.upper[i] += wide * (limit[i] - bounds.upper[i]);
    }
  }
  if (side.motor >= 0) {  // nothing is left to choose, unless rows are parallel
    const Vec<S, 4> only = box::on_side(rows, force, bounds, side);
    const int i = side.motor;
    if (only[i] >= bounds.lower[i] - slack && only[i] <= bounds.upper[i] + slack) {
      out.torque = only;
      return box::clamped(out, limit);
    }
  }
  Vec<S, 4> root;
  for (int i = 0; i < 4; ++i) root[i] = S(1) / square_root(weight[i]);
  const Mat<S, 4, 2> n = box::null_space(rows, root);
  out.torque = box::Polygon<S>(Vec<S, 4>(out.torque), n, bounds, slack).closest();
  return box::clamped(out, limit);
}

/// allocate_within for forces w (N or N m) on the channels of a 5R, with its R and F from four_motors.
template <class S>
[[nodiscard]] BoxAllocation<S> allocate_all_within(const FiveBar<S>& m, const typename FiveBar<S>::Pose& p,
                                                   const typename FiveBar<S>::Channels& w,
                                                   const Vec<S, 4>& weight, const Vec<S, 4>& limit,
                                                   const Vec<S, 4>& preload) {
  const FourMotors<S> four = four_motors(m, p, w);
  return allocate_within(four.rows, four.F, weight, limit, preload);
}

}  // namespace esmc
