#pragma once
/// The two ways round to an attitude, and the Euler angles that docs/spatial.md compares quaternions with.

#include <cmath>

#include "host_sim/spatial/rotation.hpp"

namespace esmc::host {

/// Chooses between q_e and -q_e, the two ways round to the same attitude, with memory.
///
/// The chosen way stays until its scalar part falls below -hysteresis: the remaining turn is then longer than
/// 180 degrees by a margin. With hysteresis = 0, noise at 180 degrees changes the way at every sample and the
/// torque dithers; without any change the body may go the long way round (it unwinds). The sign of the input
/// does not matter, to the last bit: of q and -q the one next to the last choice is taken.
template <class S>
class AttitudeChoice {
 public:
  AttitudeChoice() = default;
  /// hysteresis: in [0, 1), cos of half the angle at which the way changes: 0.1 is 180 + 11.5 degrees.
  explicit AttitudeChoice(S hysteresis) : hysteresis_(hysteresis) {}

  /// q_e or -q_e. After a reset the short way; at exactly 180 degrees that of `shortest`.
  [[nodiscard]] Quaternion<S> choose(const Quaternion<S>& turn) {
    Quaternion<S> q = shortest(turn);
    if (known_) {
      const S along = dot(last_, turn);  // 0: both are as far from the last choice
      if (along > S(0)) q = turn;
      if (along < S(0)) q = turn.negative();
      if (q.w < -hysteresis_) q = q.negative();
    }
    last_ = q;
    known_ = true;
    return q;
  }
  void reset() { known_ = false; }

 private:
  S hysteresis_{};
  Quaternion<S> last_{};
  bool known_ = false;
};

/// R = Rz(yaw) Ry(pitch) Rx(roll), rad; also rates (rad/s) and accelerations (rad/s2).
template <class S>
struct EulerAngles {
  S roll, pitch, yaw;
};

/// Euler angles at one attitude and the map between their rates and the angular velocity.
template <class S>
struct EulerChart {
  EulerAngles<S> angle;
  SinCos<S> roll, pitch;

  [[nodiscard]] static EulerChart at(const Quaternion<S>& q) {
    const Rotation<S> r = rotation(q);
    EulerChart c;
    // cos pitch from two entries: from the sine alone it would lose half its digits next to 90 degrees.
    const S level = square_root(r.x.x() * r.x.x() + r.x.y() * r.x.y());
    c.angle = {arc_tangent2(r.y.z(), r.z.z()), arc_tangent2(S(-r.x.z()), level),
               arc_tangent2(r.x.y(), r.x.x())};
    c.roll = sin_cos(c.angle.roll);
    c.pitch = {-r.x.z(), level};
    return c;
  }

  /// B^-1 w: rates of an angular velocity in the frame of the body. Pole at pitch = +-90 degrees.
  [[nodiscard]] EulerAngles<S> rates(const Vec3<S>& w) const {
    const S yaw = (w.y() * roll.sin + w.z() * roll.cos) / pitch.cos;
    return {w.x() + yaw * pitch.sin, w.y() * roll.cos - w.z() * roll.sin, yaw};
  }
  /// B d: angular velocity of rates d, in the frame of the body.
  [[nodiscard]] Vec3<S> turning(const EulerAngles<S>& d) const {
    return Vec3<S>(d.roll - d.yaw * pitch.sin, d.pitch * roll.cos + d.yaw * pitch.cos * roll.sin,
                   d.yaw * pitch.cos * roll.cos - d.pitch * roll.sin);
  }
  /// Bdot d: angular acceleration at constant rates d.
  [[nodiscard]] Vec3<S> drift(const EulerAngles<S>& d) const {
    const S yp = d.yaw * d.pitch, yr = d.yaw * d.roll, pr = d.pitch * d.roll;
    return Vec3<S>(-yp * pitch.cos, yr * pitch.cos * roll.cos - pr * roll.sin - yp * pitch.sin * roll.sin,
                   -pr * roll.cos - yp * pitch.sin * roll.cos - yr * pitch.cos * roll.sin);
  }
};

}  // namespace esmc::host
