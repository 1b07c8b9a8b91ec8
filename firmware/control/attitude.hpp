#pragma once
/// Which way round a body is turned back, and the minimal coordinates that this is compared with.

#include <cmath>

#include "firmware/mechanism/rotation.hpp"

namespace esmc {

/// Chooses between q_e and -q_e, the two ways round to the same attitude, with memory.
///
/// The way in use is kept until the turn that is left is longer than 180 degrees by a margin: until the
/// scalar part of the chosen quaternion is below -hysteresis. With hysteresis = 0 noise at 180 degrees
/// changes the way at every sample and the torque dithers; without the change at all a body may be turned the
/// long way round (it unwinds). Signs that come in do not matter: of each sample the representative next to
/// the last one is taken, so a sensor or a reference that jumps from q to -q gives the same result to the
/// last bit.
template <class S>
class AttitudeChoice {
 public:
  AttitudeChoice() = default;
  /// hysteresis: 0 <= h < 1, cos of half the angle beyond which the way changes: 0.1 is 180 + 11.5 degrees.
  explicit AttitudeChoice(S hysteresis) : hysteresis_(hysteresis) {}

  /// q_e or -q_e. The first one after a reset the short way; at exactly 180 degrees as `shortest` says.
  [[nodiscard]] Quaternion<S> choose(const Quaternion<S>& turn) {
    Quaternion<S> q = shortest(turn);
    if (known_) {
      const S along = dot(last_, turn);  // 0: as far from the one as from the other, so memory says nothing
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

/// Yaw, pitch, roll: three coordinates of orientation, R = Rz(yaw) Ry(pitch) Rx(roll). As rates and
/// accelerations too.
template <class S>
struct EulerAngles {
  S roll, pitch, yaw;  ///< rad
};

/// The chart of Euler angles at one attitude. Its rates have a pole at pitch = +-90 degrees.
template <class S>
struct EulerChart {
  EulerAngles<S> angle;
  SinCos<S> roll, pitch;

  [[nodiscard]] static EulerChart at(const Quaternion<S>& q) {
    const Rotation<S> r = rotation(q);
    EulerChart c;
    // cos pitch from the two entries that carry it: the sine alone loses half its digits next to 90 degrees.
    const S level = square_root(r.x.x() * r.x.x() + r.x.y() * r.x.y());
    c.angle = {arc_tangent2(r.y.z(), r.z.z()), arc_tangent2(S(-r.x.z()), level),
               arc_tangent2(r.x.y(), r.x.x())};
    c.roll = sin_cos(c.angle.roll);
    c.pitch = {-r.x.z(), level};
    return c;
  }

  /// Of an angular velocity in the frame of the body. Pole at pitch = +-90 degrees.
  [[nodiscard]] EulerAngles<S> rates(const Vec3<S>& w) const {
    const S yaw = (w.y() * roll.sin + w.z() * roll.cos) / pitch.cos;
    return {w.x() + yaw * pitch.sin, w.y() * roll.cos - w.z() * roll.sin, yaw};
  }
  /// B: angular velocity of rates, in the frame of the body.
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

}  // namespace esmc
