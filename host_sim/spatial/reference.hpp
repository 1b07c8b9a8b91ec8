#pragma once
/// Reference motions of a body in space as functions of the tick number; time is counted as in
/// firmware/control/reference.hpp.

#include <cstdint>

#include "firmware/control/reference.hpp"
#include "host_sim/scene/names.hpp"
#include "host_sim/spatial/rotation.hpp"

namespace esmc::host {

/// Desired motion of a body, SI units; angular quantities in its own (desired) frame.
template <class S>
struct SpatialMotion {
  Vec3<S> position = Vec3<S>::Zero(), velocity = Vec3<S>::Zero(), acceleration = Vec3<S>::Zero();
  Quaternion<S> attitude{};
  Vec3<S> turning = Vec3<S>::Zero(), turning_rate = Vec3<S>::Zero();  ///< rad/s, rad/s2
};

/// A reference in space. Fields that a kind does not use are ignored. Axes have length 1, in the frame of the
/// body.
template <class S>
struct SpatialReference {
  SpatialReferenceKind kind = SpatialReferenceKind::hold;
  Vec3<S> position = Vec3<S>::Zero();  ///< start, m
  Quaternion<S> attitude{};            ///< start
  Vec3<S> axis = Vec3<S>(S(0), S(0), S(1)), second_axis = Vec3<S>(S(1), S(0), S(0));
  S angle{};                           ///< rad, of any size
  Vec3<S> shift = Vec3<S>::Zero();     ///< m
  S duration{1};                       ///< of turn, s, > 0
  S rate{}, second_rate{};             ///< rad/s; of sway that of the phase
  PhaseClock phase{}, second_phase{};  ///< the same per tick

  /// sample_time: s, > 0.
  [[nodiscard]] SpatialMotion<S> at(std::uint64_t tick, S sample_time) const {
    SpatialMotion<S> m;
    m.position = position;
    m.attitude = attitude;
    switch (kind) {
      case SpatialReferenceKind::hold:
        break;
      case SpatialReferenceKind::turn: {
        const S t = S(tick) * sample_time, u = t < duration ? t / duration : S(1), f = S(1) / duration;
        move(m, {u * u * u * (S(10) - u * (S(15) - S(6) * u)), S(30) * u * u * (S(1) - u) * (S(1) - u) * f,
                 S(60) * u * (S(1) - u) * (S(1) - S(2) * u) * f * f});
        break;
      }
      case SpatialReferenceKind::sway: {
        const SinCos<S> p = sin_cos(phase.template angle<S>(tick));
        move(m, {S(0.5) * (S(1) - p.cos), S(0.5) * rate * p.sin, S(0.5) * rate * rate * p.cos});
        break;
      }
      case SpatialReferenceKind::spin:
        rotate(m, axis, {phase.template angle<S>(tick), rate, S(0)});
        break;
      case SpatialReferenceKind::tumble:
        rotate(m, axis, {phase.template angle<S>(tick), rate, S(0)});
        rotate(m, second_axis, {second_phase.template angle<S>(tick), second_rate, S(0)});
        break;
    }
    return m;
  }

 private:
  struct Path {
    S value, rate, acceleration;
  };
  void move(SpatialMotion<S>& m, const Path& s) const {
    m.position += shift * s.value;
    m.velocity = shift * s.rate;
    m.acceleration = shift * s.acceleration;
    rotate(m, axis, {angle * s.value, angle * s.rate, angle * s.acceleration});
  }
  /// Turns further about an axis of the body, which carries the motion so far into the new frame.
  static void rotate(SpatialMotion<S>& m, const Vec3<S>& about_axis, const Path& p) {
    const Quaternion<S> q = about(about_axis, p.value), back = q.conjugate();
    const Vec3<S> so_far = rotated(back, m.turning), own = about_axis * p.rate;
    m.attitude = m.attitude * q;
    m.turning = so_far + own;
    m.turning_rate = rotated(back, m.turning_rate) + about_axis * p.acceleration - cross(own, so_far);
  }
};

}  // namespace esmc::host
