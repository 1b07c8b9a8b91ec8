#pragma once
/// Vectors of space and orientation by unit quaternions.
///
/// q turns components in a body's frame into components in the frame it is given in: a_N = rotated(q, a_B). q
/// and -q are the same orientation, and every function here that returns something other than a quaternion
/// gives the same bits for both. Sums are written out in one order (see types.hpp).

#include "firmware/numeric/elementary.hpp"
#include "firmware/types.hpp"

namespace esmc {

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
  /// Of a unit quaternion 1.
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

/// Scaled to norm 1, whatever its norm was; NaN for a zero quaternion and for one that is not finite.
template <class S>
[[nodiscard]] Quaternion<S> normalised(const Quaternion<S>& q) {
  const S f = S(1) / square_root(q.squared_norm());
  return {q.w * f, Vec3<S>(q.v * f)};
}

/// About a unit axis by an angle, rad; the pole of no chart: any angle within the range of sin_cos.
template <class S>
[[nodiscard]] Quaternion<S> about(const Vec3<S>& axis, S angle) {
  const SinCos<S> t = sin_cos(S(0.5) * angle);
  return {t.cos, Vec3<S>(axis * t.sin)};
}

/// exp of a rotation vector (unit axis times angle, rad): where constant angular velocity over a step leads.
template <class S>
[[nodiscard]] Quaternion<S> exponential(const Vec3<S>& rotation) {
  const S square = dot(rotation, rotation), angle = square_root(square);
  // Below this the next term of the series is less than half an ulp.
  constexpr S small = sizeof(S) > 4 ? S(1e-8) : S(1e-4);
  if (angle < small) return {S(1) - S(0.125) * square, Vec3<S>(rotation * S(0.5))};
  const SinCos<S> t = sin_cos(S(0.5) * angle);
  return {t.cos, Vec3<S>(rotation * (t.sin / angle))};
}

/// The rotation vector of q, the short way: of length at most pi. At 180 degrees, where both signs are as
/// short, the one `shortest` takes.
template <class S>
[[nodiscard]] Vec3<S> logarithm(const Quaternion<S>& q);

/// The orientation that constant angular velocity (rad/s, components in the body's frame) leads to in h
/// seconds. Kept on the unit sphere by the first term of 1 / sqrt: its error is the square of what one
/// product rounds off.
template <class S>
[[nodiscard]] Quaternion<S> advanced(const Quaternion<S>& q, const Vec3<S>& rate, S h) {
  const Quaternion<S> next = q * exponential(Vec3<S>(rate * h));
  const S f = S(1.5) - S(0.5) * next.squared_norm();
  return {next.w * f, Vec3<S>(next.v * f)};
}

/// Of q and -q the one with w > 0. At w = 0, a turn by 180 degrees, the one whose first entry that is not
/// zero is positive, so that the choice is defined and does not depend on the sign that came in.
template <class S>
[[nodiscard]] Quaternion<S> shortest(const Quaternion<S>& q) {
  const S entries[] = {q.w, q.v.x(), q.v.y(), q.v.z()};
  for (const S e : entries) {
    if (e > S(0)) return q;
    if (e < S(0)) return q.negative();
  }
  return q;
}

template <class S>
[[nodiscard]] Vec3<S> logarithm(const Quaternion<S>& q) {
  const Quaternion<S> p = shortest(q);
  const S sine = square_root(dot(p.v, p.v));
  if (sine == S(0)) return p.v;
  return p.v * (S(2) * arc_tangent2(sine, p.w) / sine);
}

/// Columns: the axes of the body in the frame q is given in. Nine multiplications to turn a vector, where
/// `rotated` takes 18.
template <class S>
struct Rotation {
  Vec3<S> x = Vec3<S>(S(1), S(0), S(0)), y = Vec3<S>(S(0), S(1), S(0)), z = Vec3<S>(S(0), S(0), S(1));

  /// From the body's frame.
  [[nodiscard]] Vec3<S> out(const Vec3<S>& a) const { return x * a.x() + y * a.y() + z * a.z(); }
  /// Into the body's frame.
  [[nodiscard]] Vec3<S> in(const Vec3<S>& a) const { return Vec3<S>(dot(x, a), dot(y, a), dot(z, a)); }
};

template <class S>
[[nodiscard]] Rotation<S> rotation(const Quaternion<S>& q) {
  const S w = q.w, x = q.v.x(), y = q.v.y(), z = q.v.z(), two(2), one(1);
  return {Vec3<S>(one - two * (y * y + z * z), two * (x * y + w * z), two * (x * z - w * y)),
          Vec3<S>(two * (x * y - w * z), one - two * (x * x + z * z), two * (y * z + w * x)),
          Vec3<S>(two * (x * z + w * y), two * (y * z - w * x), one - two * (x * x + y * y))};
}

/// a_N of a_B.
template <class S>
[[nodiscard]] Vec3<S> rotated(const Quaternion<S>& q, const Vec3<S>& a) {
  const Vec3<S> t = cross(q.v, a) * S(2);
  return a + t * q.w + cross(q.v, t);
}

/// The attitude error of a body that is at q with angular velocity w and should be at q_d with w_d. Angular
/// velocities are in the own frame of each; everything here is in the frame of the body as it is.
///
///   q_e = q* q_d,   e = 2 vec q_e,   w~ = R_e w_d - w,   e' = q_e0 w~ + w~ x vec q_e
///
/// e is 2 sin(angle / 2) about the axis of the turn that is left: the rotation vector to first order, of
/// length 2 at 180 degrees, and smooth there, but q_e and -q_e pull opposite ways (see control/attitude.hpp
/// for the choice).
template <class S>
struct AttitudeError {
  Quaternion<S> turn;    ///< q_e
  Vec3<S> e;             ///< rad, to first order
  Vec3<S> e_rate;        ///< e', exact, not only to first order
  Vec3<S> rate;          ///< w~, rad/s
  Vec3<S> of_reference;  ///< d/dt (R_e w_d): the angular acceleration that keeps w~ as it is, rad/s2
};

/// `turn` is q_e or -q_e, as the caller chooses; see AttitudeError.
template <class S>
[[nodiscard]] AttitudeError<S> attitude_error(const Quaternion<S>& turn, const Vec3<S>& desired_rate,
                                              const Vec3<S>& desired_acceleration, const Vec3<S>& rate) {
  AttitudeError<S> a;
  a.turn = turn;
  a.e = turn.v * S(2);
  const Vec3<S> wd = rotated(turn, desired_rate);
  a.rate = wd - rate;
  a.e_rate = a.rate * turn.w + cross(a.rate, turn.v);
  a.of_reference = rotated(turn, desired_acceleration) - cross(rate, wd);
  return a;
}

}  // namespace esmc
