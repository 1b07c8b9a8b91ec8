#pragma once
/// Vectors in space, and orientation by unit quaternions.
///
/// q maps components in the frame of a body to those in the frame in which q is given: a_N = rotated(q, a_B).
/// q and -q are the same orientation: every function here that does not return a quaternion gives the same
/// bits for both. Sums are written out in one order (see types.hpp).

#include "firmware/numeric/elementary.hpp"
#include "firmware/types.hpp"

namespace esmc::host {

using esmc::cross;  // those of the plane, beside those below
using esmc::dot;

template <class S>
using Vec3 = Vec<S, 3>;

template <class S>
[[nodiscard]] constexpr S dot(const Vec3<S>& a, const Vec3<S>& b) {
  return a.x() * b.x() + a.y() * b.y() + a.z() * b.z();
}
template <class S>
[[nodiscard]] Vec3<S> cross(const Vec3<S>& a, const Vec3<S>& b) {
  return Vec3<S>(a.y() * b.z() - a.z() * b.y(), a.z() * b.x() - a.x() * b.z(), a.x() * b.y() - a.y() * b.x());
}
/// Entry by entry: a diagonal matrix times a vector.
template <class S>
[[nodiscard]] Vec3<S> times(const Vec3<S>& a, const Vec3<S>& b) {
  return Vec3<S>(a.x() * b.x(), a.y() * b.y(), a.z() * b.z());
}

/// w + x i + y j + z k, Hamilton's convention; v = (x, y, z).
template <class S>
struct Quaternion {
  S w{1};
  Vec3<S> v = Vec3<S>::Zero();

  [[nodiscard]] Quaternion conjugate() const { return {w, Vec3<S>(-v)}; }
  [[nodiscard]] Quaternion negative() const { return {-w, Vec3<S>(-v)}; }
  [[nodiscard]] S squared_norm() const { return w * w + dot(v, v); }
};

template <class S>
[[nodiscard]] Quaternion<S> operator*(const Quaternion<S>& a, const Quaternion<S>& b) {
  return {a.w * b.w - dot(a.v, b.v), Vec3<S>(b.v * a.w + a.v * b.w + cross(a.v, b.v))};
}

template <class S>
[[nodiscard]] S dot(const Quaternion<S>& a, const Quaternion<S>& b) {
  return a.w * b.w + dot(a.v, b.v);
}

/// q scaled to norm 1; NaN if q is zero or not finite.
template <class S>
[[nodiscard]] Quaternion<S> normalised(const Quaternion<S>& q) {
  const S f = S(1) / square_root(q.squared_norm());
  return {q.w * f, Vec3<S>(q.v * f)};
}

/// Turn about a unit axis by an angle, rad, within the range of sin_cos.
template <class S>
[[nodiscard]] Quaternion<S> about(const Vec3<S>& axis, S angle) {
  const SinCos<S> t = sin_cos(S(0.5) * angle);
  return {t.cos, Vec3<S>(axis * t.sin)};
}

/// exp of a rotation vector (unit axis times angle, rad).
template <class S>
[[nodiscard]] Quaternion<S> exponential(const Vec3<S>& rotation) {
  const S square = dot(rotation, rotation), angle = square_root(square);
  // Below this the next term of the series is less than half an ulp.
  constexpr S small = sizeof(S) > 4 ? S(1e-8) : S(1e-4);
  if (angle < small) return {S(1) - S(0.125) * square, Vec3<S>(rotation * S(0.5))};
  const SinCos<S> t = sin_cos(S(0.5) * angle);
  return {t.cos, Vec3<S>(rotation * (t.sin / angle))};
}

/// Of q and -q the one with w > 0; at w = 0, a turn by 180 degrees, the one whose first nonzero entry is
/// positive, so that the result does not depend on the sign of the argument.
template <class S>
[[nodiscard]] Quaternion<S> shortest(const Quaternion<S>& q) {
  const S entries[] = {q.w, q.v.x(), q.v.y(), q.v.z()};
  for (const S e : entries) {
    if (e > S(0)) return q;
    if (e < S(0)) return q.negative();
  }
  return q;
}

/// The rotation vector of `shortest`(q), rad, of length at most pi.
template <class S>
[[nodiscard]] Vec3<S> logarithm(const Quaternion<S>& q) {
  const Quaternion<S> p = shortest(q);
  const S sine = square_root(dot(p.v, p.v));
  if (sine == S(0)) return p.v;
  return p.v * (S(2) * arc_tangent2(sine, p.w) / sine);
}

/// Rotation matrix by its columns: the axes of the body in the frame in which q is given. Turns a vector in
/// half the multiplications of `rotated`.
template <class S>
struct Rotation {
  Vec3<S> x = Vec3<S>(S(1), S(0), S(0)), y = Vec3<S>(S(0), S(1), S(0)), z = Vec3<S>(S(0), S(0), S(1));

  /// Vector `a`, given in the body's frame, in the frame in which q is given.
  [[nodiscard]] Vec3<S> out(const Vec3<S>& a) const { return x * a.x() + y * a.y() + z * a.z(); }
  /// Inverse of `out`: a vector in the body's frame.
  [[nodiscard]] Vec3<S> in(const Vec3<S>& a) const { return Vec3<S>(dot(x, a), dot(y, a), dot(z, a)); }
};

/// The matrix of q, whose norm must be 1.
template <class S>
[[nodiscard]] Rotation<S> rotation(const Quaternion<S>& q) {
  const S w = q.w, x = q.v.x(), y = q.v.y(), z = q.v.z(), two(2), one(1);
  return {Vec3<S>(one - two * (y * y + z * z), two * (x * y + w * z), two * (x * z - w * y)),
          Vec3<S>(two * (x * y - w * z), one - two * (x * x + z * z), two * (y * z + w * x)),
          Vec3<S>(two * (x * z + w * y), two * (y * z - w * x), one - two * (x * x + y * y))};
}

/// a_N of a_B: from the frame of the body to that in which q, of norm 1, is given.
template <class S>
[[nodiscard]] Vec3<S> rotated(const Quaternion<S>& q, const Vec3<S>& a) {
  const Vec3<S> t = cross(q.v, a) * S(2);
  return a + t * q.w + cross(q.v, t);
}

/// Attitude error of a body at q with angular velocity w, desired q_d and w_d, each velocity in its own
/// frame. All members are in the frame of the body at q.
///
///   q_e = q* q_d,   e = 2 vec q_e,   w~ = R_e w_d - w,   e' = q_e0 w~ + w~ x vec q_e
///
/// e is 2 sin(angle / 2) about the axis of the remaining turn: the rotation vector to first order, of length
/// 2 at 180 degrees and smooth there, of opposite sign for q_e and -q_e (AttitudeChoice of law.hpp chooses).
template <class S>
struct AttitudeError {
  Vec3<S> e;             ///< rad, to first order
  Vec3<S> e_rate;        ///< e', exact
  Vec3<S> rate;          ///< w~, rad/s
  Vec3<S> of_reference;  ///< d/dt (R_e w_d): the angular acceleration that keeps w~ constant, rad/s2
};

/// turn: q_e or -q_e, the caller's choice; rates in rad/s, desired_acceleration in rad/s2. See AttitudeError.
template <class S>
[[nodiscard]] AttitudeError<S> attitude_error(const Quaternion<S>& turn, const Vec3<S>& desired_rate,
                                              const Vec3<S>& desired_acceleration, const Vec3<S>& rate) {
  AttitudeError<S> a;
  a.e = turn.v * S(2);
  const Vec3<S> wd = rotated(turn, desired_rate);
  a.rate = wd - rate;
  a.e_rate = a.rate * turn.w + cross(a.rate, turn.v);
  a.of_reference = rotated(turn, desired_acceleration) - cross(rate, wd);
  return a;
}

}  // namespace esmc::host
