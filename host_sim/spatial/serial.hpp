#pragma once
/// The serial algorithm of the report, eqs. (1)-(7), for a chain of bodies in space, each joined to the one
/// before by a revolute or a prismatic joint about or along any axis; firmware/mechanism/serial.hpp is the
/// planar case.
///
/// p = [p#; p°]: p# the joint rates, p° = [omega of every body, in its own frame; velocity of every mass
/// centre, in N]. Frames of bodies are parallel to their principal axes, so M (6) is diagonal and constant,
/// and (7) leaves
///   v = [0; omega x I omega; 0]
/// C, A, M are never formed: `rates` is C p#, `bias` is Cdot(a) b, `joint_torques` is C^T w. omega is a
/// quasi-velocity, so Cdot(a) b is not symmetric in a and b; c of [F1] is bias(p#, p#).

#include <type_traits>

#include "firmware/mechanism/serial.hpp"
#include "host_sim/spatial/rotation.hpp"

namespace esmc::host {

/// Constants of one body in space, SI units. The frame of the body: origin at its joint, axes parallel to the
/// principal ones.
template <class S>
struct SpatialBody {
  Vec3<S> offset = Vec3<S>::Zero();  ///< of this joint from the one before, in that body's frame or N, m
  Quaternion<S> mount{};  ///< from the frame of this body to that of the body before, joint at zero
  Vec3<S> axis = Vec3<S>(S(0), S(0), S(1));  ///< of the joint, in the frame of this body; length 1
  Vec3<S> centre = Vec3<S>::Zero();          ///< mass centre, m
  S mass{};                                  ///< kg
  Vec3<S> inertia = Vec3<S>::Zero();         ///< principal, about the mass centre, kg m2
  S viscous{};                               ///< of its joint, N m s/rad or N s/m
};

/// Channel rows of one body without its joint.
template <class S>
struct BodyRows {
  Vec3<S> turn;    ///< of omega, in the frame of the body
  Vec3<S> centre;  ///< of the mass centre, in N
};

/// M v' + v + g of one body (6), (7): moment in its frame (N m), force in N (N).
template <class S>
[[nodiscard]] BodyRows<S> body_force(S mass, const Vec3<S>& inertia, S gravity,
                                     const BodyRows<S>& acceleration, const Vec3<S>& omega) {
  const Vec3<S> a = acceleration.centre;
  return {times(inertia, acceleration.turn) + cross(omega, times(inertia, omega)),
          Vec3<S>(mass * a.x(), mass * a.y(), mass * (a.z() + gravity))};
}

/// A chain of bodies in space; see the top of the file. Kinds: of its joints, from the base on.
template <class S, Joint... Kinds>
class SpatialSerial {
 public:
  using Scalar = S;
  static constexpr int joints = sizeof...(Kinds);
  /// Rows of p: joint rates, omega of all bodies, velocities of all mass centres.
  static constexpr int channels = 7 * joints;
  using Joints = Vec<S, joints>;
  using Channels = Vec<S, channels>;

  static constexpr int row_turn(int i) { return joints + 3 * i; }        ///< x of omega of body i; then y, z
  static constexpr int row_centre(int i) { return 4 * joints + 3 * i; }  ///< x of body i; then y, z
  static constexpr bool is_turn(int row) { return row >= joints && row < 4 * joints; }

  /// Configuration in N. Not initialised by itself.
  struct Pose {
    List<Quaternion<S>, joints> attitude;
    List<Rotation<S>, joints> frame;  ///< the same as a matrix
    List<Vec3<S>, joints> origin;     ///< of the frames, m
    List<Vec3<S>, joints> axis;       ///< of the joints
    List<Vec3<S>, joints> arm;        ///< from the origin of a body to its mass centre, m
    Vec3<S> tip;                      ///< m
    Joints joint;                     ///< rad, m
  };

  SpatialSerial() = default;
  /// tip: the point of the last body that holds the platform, in its frame, m; gravity: along -z, m/s2, >= 0.
  SpatialSerial(const List<SpatialBody<S>, joints>& bodies, const Vec3<S>& tip, S gravity)
      : bodies_(bodies), tip_(tip), gravity_(gravity) {}

  [[nodiscard]] const SpatialBody<S>& body(int i) const { return bodies_[i]; }

  /// Pose at q: joint angles (rad; NaN beyond the range of sin_cos) and displacements (m).
  [[nodiscard]] Pose pose(const Joints& q) const {
    Pose p;
    p.joint = q;
    Quaternion<S> attitude;
    Vec3<S> origin = Vec3<S>::Zero();
    Rotation<S> before;
    unroll<joints>([&](auto i) ESMC_INLINE {
      const SpatialBody<S>& b = bodies_[i];
      origin += before.out(b.offset);
      attitude = attitude * b.mount;
      if constexpr (kind(i) == Joint::revolute) attitude = attitude * about(b.axis, S(q[i]));
      const Rotation<S> frame = rotation(attitude);
      p.axis[i] = frame.out(b.axis);
      if constexpr (kind(i) == Joint::prismatic) origin += p.axis[i] * q[i];
      p.attitude[i] = attitude;
      p.frame[i] = frame;
      p.origin[i] = origin;
      p.arm[i] = frame.out(b.centre);
      before = frame;
    });
    p.tip = origin + before.out(tip_);
    return p;
  }

  /// p = C p#. Also the part C a of all accelerations.
  [[nodiscard]] Channels rates(const Pose& p, const Joints& qd) const {
    Channels out;
    Walk w;
    unroll<joints>([&](auto i) ESMC_INLINE {
      step(w, i, p, qd);
      put(out, i, S(qd[i]), {p.frame[i].in(w.omega), w.origin + cross(w.omega, p.arm[i])});
    });
    return out;
  }

  /// d/dt (C b) when the chain moves with joint rates a and b is held: Cdot(a) b. With a = b the c of [F1].
  [[nodiscard]] Channels bias(const Pose& p, const Joints& a, const Joints& b) const {
    Channels out;
    Walk wa, wb;
    Drift d;
    unroll<joints>([&](auto i) ESMC_INLINE {
      step(wa, wb, d, i, p, a, b);
      // In the frame of the body, which turns with a: the quasi-velocity's own term.
      put(out, i, S(0),
          {p.frame[i].in(d.omega - cross(wa.omega, wb.omega)),
           d.origin + cross(d.omega, p.arm[i]) + cross(wb.omega, cross(wa.omega, p.arm[i]))});
    });
    return out;
  }

  /// Jdot(a) b of the tip.
  [[nodiscard]] Vec3<S> tip_bias(const Pose& p, const Joints& a, const Joints& b) const {
    Walk wa, wb;
    Drift d;
    unroll<joints>([&](auto i) ESMC_INLINE { step(wa, wb, d, i, p, a, b); });
    const Vec3<S> r = p.tip - p.origin[joints - 1];
    return d.origin + cross(d.omega, r) + cross(wb.omega, cross(wa.omega, r));
  }
  /// Column i of the Jacobian of the tip.
  template <int I>
  [[nodiscard]] Vec3<S> tip_column(const Pose& p, std::integral_constant<int, I>) const {
    if constexpr (kind(I) == Joint::revolute) return cross(p.axis[I], Vec3<S>(p.tip - p.origin[I]));
    return p.axis[I];
  }

  /// C^T w: joint torques of moments (in the frames of the bodies) and forces (in N) on the bodies.
  [[nodiscard]] Joints joint_torques(const Pose& p, const Channels& w) const {
    Joints out;
    Vec3<S> moment = Vec3<S>::Zero(),
            force = Vec3<S>::Zero();  // of the bodies further out, about the joint in hand
    unroll<joints>([&](auto k) ESMC_INLINE {
      constexpr int i = joints - 1 - k;
      if constexpr (i + 1 < joints) moment += cross(Vec3<S>(p.origin[i + 1] - p.origin[i]), force);
      const Vec3<S> f = rows_at(w, row_centre(i));
      moment += p.frame[i].out(rows_at(w, row_turn(i))) + cross(p.arm[i], f);
      force += f;
      out[i] = w[i] + dot(p.axis[i], kind(i) == Joint::revolute ? moment : force);
    });
    return out;
  }

  /// M v' + v + f + g of (1) from accelerations v' and rates of the channels.
  [[nodiscard]] Channels force(const Channels& v, const Channels& rates) const {
    Channels out;
    unroll<joints>([&](auto i) ESMC_INLINE {
      const SpatialBody<S>& b = bodies_[i];
      put(out, i, S(b.viscous * rates[i]),
          body_force(b.mass, b.inertia, gravity_, rows_of(v, i), rows_at(rates, row_turn(i))));
    });
    return out;
  }

  static void put(Channels& out, int i, S joint, const BodyRows<S>& r) {
    out[i] = joint;
    out.template segment<3>(row_turn(i)) = r.turn;
    out.template segment<3>(row_centre(i)) = r.centre;
  }
  [[nodiscard]] static BodyRows<S> rows_of(const Channels& c, int i) {
    return {rows_at(c, row_turn(i)), rows_at(c, row_centre(i))};
  }

  /// Joint rates of a tip velocity, for a chain of three joints, by cofactors. Pole at type 1, where the
  /// three columns of the Jacobian lie in a plane.
  [[nodiscard]] Joints tip_inverse(const Pose& p, const Vec3<S>& v) const requires(joints == 3) {
    const Cofactors c = cofactors(p);
    return Joints(dot(c.a, v), dot(c.b, v), dot(c.c, v)) / c.volume;
  }
  /// Transpose of tip_inverse: the tip force that balances joint torques tau. Pole at type 1.
  [[nodiscard]] Vec3<S> tip_force(const Pose& p, const Joints& tau) const requires(joints == 3) {
    const Cofactors c = cofactors(p);
    return (c.a * tau[0] + c.b * tau[1] + c.c * tau[2]) / c.volume;
  }

 private:
  static constexpr List<Joint, joints> kinds_{{Kinds...}};
  static constexpr Joint kind(int i) { return kinds_[i]; }

  [[nodiscard]] static Vec3<S> rows_at(const Channels& c, int at) { return c.template segment<3>(at); }

  struct Cofactors {
    Vec3<S> a, b, c;
    S volume;
  };
  [[nodiscard]] Cofactors cofactors(const Pose& p) const {
    const Vec3<S> x = tip_column(p, std::integral_constant<int, 0>{}),
                  y = tip_column(p, std::integral_constant<int, 1>{}),
                  z = tip_column(p, std::integral_constant<int, 2>{});
    Cofactors out{cross(y, z), cross(z, x), cross(x, y), S(0)};
    out.volume = dot(x, out.a);
    return out;
  }

  /// Angular velocity of the body in hand and velocity of its origin, in N, from the base outwards.
  struct Walk {
    Vec3<S> omega = Vec3<S>::Zero(), origin = Vec3<S>::Zero();
  };
  template <int I>
  [[nodiscard]] static Vec3<S> reach(const Pose& p, std::integral_constant<int, I>) {
    if constexpr (I == 0) return p.origin[0];  // not used: the ground does not turn
    return p.origin[I] - p.origin[I > 0 ? I - 1 : 0];
  }
  template <int I>
  void step(Walk& w, std::integral_constant<int, I> i, const Pose& p, const Joints& qd) const {
    if constexpr (I > 0) w.origin += cross(w.omega, reach(p, i));
    if constexpr (kind(I) == Joint::revolute) {
      w.omega += p.axis[I] * qd[I];
    } else {
      w.origin += p.axis[I] * qd[I];
    }
  }
  /// Rates of change of a Walk of b while the chain moves with a.
  using Drift = Walk;
  template <int I>
  void step(Walk& wa, Walk& wb, Drift& d, std::integral_constant<int, I> i, const Pose& p, const Joints& a,
            const Joints& b) const {
    if constexpr (I > 0) {
      const Vec3<S> r = reach(p, i);
      // The origin of body I as a point of body I - 1; a slide adds its own rate to r.
      Vec3<S> moves = cross(wa.omega, r);
      if constexpr (kind(I) == Joint::prismatic) moves += p.axis[I] * a[I];
      d.origin += cross(d.omega, r) + cross(wb.omega, moves);
    }
    const Vec3<S> axis_turns = cross(wa.omega, p.axis[I]) * b[I];
    (kind(I) == Joint::revolute ? d.omega : d.origin) += axis_turns;
    step(wa, i, p, a);
    step(wb, i, p, b);
  }

  List<SpatialBody<S>, joints> bodies_{};
  Vec3<S> tip_ = Vec3<S>::Zero();
  S gravity_{};
};

}  // namespace esmc::host
