#pragma once
/// The coupling algorithm of the report, eqs. (37)-(47), in space: a rigid platform, oriented by a unit
/// quaternion, on any number of serial legs with spherical joints at the platform; without legs a free body.
/// firmware/mechanism/coupling.hpp is the planar case.
///
///   q0 = [x; q], seven coordinates; p0# = [velocity of the mass centre, in N; omega, in the frame of the
///   platform], six q0' = D+ p0#:   x' = v,   q' = 1/2 q (0, omega)
/// Rows of p: p0#, then every leg as SpatialSerial has it. M is diagonal; v = omega x I omega for the
/// platform as well.

#include <cmath>
#include <utility>

#include "host_sim/spatial/params.hpp"
#include "host_sim/spatial/serial.hpp"

namespace esmc::host {

/// Solves A x = b by elimination with row pivoting; x replaces b. Returns the smallest pivot, or 0 where one
/// vanishes or is NaN: b is then undefined.
template <class S, int N>
[[nodiscard]] S solve(Mat<S, N, N> A, Vec<S, N>& b) {
  S smallest = S(0);
  for (int k = 0; k < N; ++k) {
    int best = k;
    for (int i = k + 1; i < N; ++i) {
      if (std::fabs(A(i, k)) > std::fabs(A(best, k))) best = i;
    }
    const S pivot = std::fabs(A(best, k));
    if (!(pivot > S(0))) return S(0);
    if (k == 0 || pivot < smallest) smallest = pivot;
    for (int j = k; j < N; ++j) std::swap(A(k, j), A(best, j));
    std::swap(b[k], b[best]);
    for (int i = k + 1; i < N; ++i) {
      const S f = A(i, k) / A(k, k);
      for (int j = k + 1; j < N; ++j) A(i, j) -= f * A(k, j);
      b[i] -= f * b[k];
    }
  }
  for (int k = N - 1; k >= 0; --k) {
    for (int j = k + 1; j < N; ++j) b[k] -= A(k, j) * b[j];
    b[k] /= A(k, k);
  }
  return smallest;
}

/// Tracking error of one channel of p.
template <class S>
struct ChannelError {
  S e;             ///< of the coordinate; of an attitude 2 vec q_e: m, rad
  S e_rate;        ///< e'
  S rate;          ///< desired less actual rate; not e' for an attitude
  S of_reference;  ///< acceleration that keeps `rate` constant
};

/// Leg: a SpatialSerial with inverse kinematics `reach(tip, pose)`. See the top of the file.
template <class S, class Leg, int Legs>
class SpatialCoupling {
 public:
  using Scalar = S;
  static constexpr int legs = Legs;
  static constexpr int dof = 6;
  static constexpr int leg_channels = Leg::channels;
  static constexpr int channels = dof + Legs * leg_channels;
  using Independent = Vec<S, dof>;
  using Channels = Vec<S, channels>;

  /// [p0#; joint rates] = C^ p#. Not initialised by itself.
  struct Rates {
    Independent platform;
    List<typename Leg::Joints, Legs> leg;
  };
  /// Configuration in N. Not initialised by itself; see `pose`.
  struct Pose {
    Vec3<S> position;
    Quaternion<S> attitude;
    Rotation<S> frame;
    List<Vec3<S>, Legs> arm;  ///< from the mass centre to the spherical joints, in N, m
    List<typename Leg::Pose, Legs> leg;
  };

  SpatialCoupling() = default;
  /// `joint`: spherical joint of each leg, from the mass centre of the platform, in its frame, m.
  SpatialCoupling(const RigidBodyParams<S>& platform, const List<Vec3<S>, Legs>& joint,
                  const List<Leg, Legs>& leg, S gravity)
      : platform_(platform), joint_(joint), leg_(leg), gravity_(gravity) {}

  static constexpr int row_leg(int j) { return dof + j * leg_channels; }  ///< row of p where leg j begins
  /// Whether the row is an angular velocity, not the velocity of a point or the rate of a joint.
  static constexpr bool is_turn(int row) {
    return row < dof ? row >= 3 : Leg::is_turn((row - dof) % leg_channels);
  }

  /// Inverse kinematics: pose of all bodies from position (m, in N) and attitude (norm 1) of the platform.
  /// False where a leg does not reach or has no joint angles (type 1): `out` is then undefined.
  [[nodiscard]] bool pose(const Vec3<S>& position, const Quaternion<S>& attitude, Pose& out) const {
    out.position = position;
    out.attitude = attitude;
    out.frame = rotation(attitude);
    for (int j = 0; j < Legs; ++j) {
      out.arm[j] = out.frame.out(joint_[j]);
      if (!leg_[j].reach(Vec3<S>(position + out.arm[j]), out.leg[j])) return false;
    }
    return true;
  }

  /// C^ p# (39). Pole at type 1 of any leg.
  [[nodiscard]] Rates chain_rates(const Pose& p, const Independent& v) const {
    Rates out;
    out.platform = v;
    const Vec3<S> omega = p.frame.out(turn_of(v));
    for (int j = 0; j < Legs; ++j)
      out.leg[j] = leg_[j].tip_inverse(p.leg[j], Vec3<S>(point_of(v) + cross(omega, p.arm[j])));
    return out;
  }

  /// d/dt of C^ along motion a, applied to b. The platform part is zero: p0# are independent velocities.
  [[nodiscard]] Rates chain_bias(const Pose& p, const Rates& a, const Rates& b) const {
    Rates out;
    out.platform.setZero();
    const Vec3<S> wa = p.frame.out(turn_of(a.platform)), wb = p.frame.out(turn_of(b.platform));
    for (int j = 0; j < Legs; ++j) {
      // b is held in the frame of the platform, which turns with a.
      const Vec3<S> drift = cross(cross(wa, wb), p.arm[j]) + cross(wb, cross(wa, p.arm[j]));
      out.leg[j] =
          leg_[j].tip_inverse(p.leg[j], Vec3<S>(drift - leg_[j].tip_bias(p.leg[j], a.leg[j], b.leg[j])));
    }
    return out;
  }

  /// d/dt (C^ p#): joint accelerations of a platform acceleration.
  [[nodiscard]] Rates chain_accelerations(const Pose& p, const Rates& rates,
                                          const Independent& acceleration) const {
    Rates out = chain_bias(p, rates, rates), straight = chain_rates(p, acceleration);
    out.platform = acceleration;
    for (int j = 0; j < Legs; ++j) out.leg[j] += straight.leg[j];
    return out;
  }

  /// blkdiag(C_j): all channels from platform and joint rates (40).
  [[nodiscard]] Channels channel_rates(const Pose& p, const Rates& r) const {
    Channels out;
    out.template head<dof>() = r.platform;
    for (int j = 0; j < Legs; ++j) part(out, j) = leg_[j].rates(p.leg[j], r.leg[j]);
    return out;
  }

  /// blkdiag(C_j) times `acceleration` plus Cdot_j(a) b: all channel accelerations.
  [[nodiscard]] Channels channel_accelerations(const Pose& p, const Rates& a, const Rates& b,
                                               const Rates& acceleration) const {
    Channels out;
    out.template head<dof>() = acceleration.platform;
    for (int j = 0; j < Legs; ++j)
      part(out, j) =
          leg_[j].rates(p.leg[j], acceleration.leg[j]) + leg_[j].bias(p.leg[j], a.leg[j], b.leg[j]);
    return out;
  }

  /// M p' + v + f + g of (37) on every channel, N or N m, from the accelerations p' (argument `v`) and the
  /// rates of the channels. v: omega x I omega; f: friction of the joints; g: weight.
  [[nodiscard]] Channels force(const Channels& v, const Channels& rates) const {
    Channels out;
    const BodyRows<S> w = body_force(platform_.mass, platform_.inertia, gravity_,
                                     BodyRows<S>{Vec3<S>(v[3], v[4], v[5]), Vec3<S>(v[0], v[1], v[2])},
                                     Vec3<S>(rates[3], rates[4], rates[5]));
    out.template head<dof>() = joined(w.centre, w.turn);
    for (int j = 0; j < Legs; ++j) part(out, j) = leg_[j].force(part(v, j), part(rates, j));
    return out;
  }

  /// C^T w of (37): [force in N; moment in the frame of the platform]. Pole at type 1.
  [[nodiscard]] Independent gather(const Pose& p, const Channels& w) const {
    Independent out = w.template head<dof>();
    for (int j = 0; j < Legs; ++j)
      out += at_joint(p, j, leg_[j].tip_force(p.leg[j], leg_[j].joint_torques(p.leg[j], part(w, j))));
    return out;
  }

  /// Motor forces u, one at joint `Actuated` of each of six legs, with C^^T u = F. Returns the smallest pivot
  /// of that system, moments divided by `length` (m): near 0 at type 2, where u is undefined.
  template <int Actuated>
  [[nodiscard]] S motor_forces(const Pose& p, Independent F, S length, Vec<S, Legs>& u) const
      requires(Legs == dof) {
    Mat<S, dof, dof> B;
    for (int j = 0; j < Legs; ++j) {
      const Independent column = at_joint(p, j, leg_[j].tip_force(p.leg[j], Leg::Joints::Unit(Actuated)));
      for (int i = 0; i < dof; ++i) B(i, j) = i < 3 ? column[i] : column[i] / length;
    }
    for (int i = 3; i < dof; ++i) F[i] /= length;
    u = F;
    return solve(B, u);
  }

  /// Calls f(row, ChannelError) for every row with mass: errors of position, attitude, mass centres and
  /// attitudes of the legs' bodies. turn: q_e of the platform with its sign chosen; the bodies of legs take
  /// the short way (they cannot turn over).
  template <class F>
  void for_each_error_row(const Pose& desired, const Rates& desired_rates, const Rates& desired_acceleration,
                          const Pose& actual, const Rates& rates, const Quaternion<S>& turn, F&& f) const {
    const Independent &vd = desired_rates.platform, &ad = desired_acceleration.platform, &v = rates.platform;
    const Vec3<S> e = desired.position - actual.position;
    for (int i = 0; i < 3; ++i) f(i, ChannelError<S>{e[i], vd[i] - v[i], vd[i] - v[i], ad[i]});
    of_turn(3, attitude_error(turn, turn_of(vd), turn_of(ad), turn_of(v)), f);
    for (int j = 0; j < Legs; ++j) {
      const Leg& leg = leg_[j];
      const auto &there = desired.leg[j], &here = actual.leg[j];
      const typename Leg::Channels fast = leg.rates(there, desired_rates.leg[j]),
                                   slow = leg.rates(here, rates.leg[j]);
      const typename Leg::Channels push = leg.rates(there, desired_acceleration.leg[j]) +
                                          leg.bias(there, desired_rates.leg[j], desired_rates.leg[j]);
      for (int i = 0; i < Leg::joints; ++i) {
        const BodyRows<S> rd = Leg::rows_of(fast, i), r = Leg::rows_of(slow, i), a = Leg::rows_of(push, i);
        const Vec3<S> off = there.origin[i] + there.arm[i] - here.origin[i] - here.arm[i];
        for (int k = 0; k < 3; ++k) {
          const S rate = rd.centre[k] - r.centre[k];
          f(row_leg(j) + Leg::row_centre(i) + k, ChannelError<S>{off[k], rate, rate, a.centre[k]});
        }
        const Quaternion<S> left = shortest(here.attitude[i].conjugate() * there.attitude[i]);
        of_turn(row_leg(j) + Leg::row_turn(i), attitude_error(left, rd.turn, a.turn, r.turn), f);
      }
    }
  }

  /// The halves of p0# or of a force on it: of the mass centre, in N; of the turn, in the platform's frame.
  [[nodiscard]] static Vec3<S> point_of(const Independent& v) { return Vec3<S>(v[0], v[1], v[2]); }
  [[nodiscard]] static Vec3<S> turn_of(const Independent& v) { return Vec3<S>(v[3], v[4], v[5]); }
  [[nodiscard]] static Independent joined(const Vec3<S>& point, const Vec3<S>& turn) {
    Independent out;
    out << point, turn;
    return out;
  }

 private:
  /// The rows of leg j, of any vector of channels.
  template <class V>
  [[nodiscard]] static auto part(V& v, int j) {
    return v.template segment<leg_channels>(row_leg(j));
  }
  /// Force on p0# by a force (N) on joint j of the platform.
  [[nodiscard]] static Independent at_joint(const Pose& p, int j, const Vec3<S>& force) {
    return joined(force, p.frame.in(cross(p.arm[j], force)));
  }
  template <class F>
  static void of_turn(int row, const AttitudeError<S>& a, F&& f) {
    for (int k = 0; k < 3; ++k)
      f(row + k, ChannelError<S>{a.e[k], a.e_rate[k], a.rate[k], a.of_reference[k]});
  }

  RigidBodyParams<S> platform_{};
  List<Vec3<S>, Legs> joint_{};
  List<Leg, Legs> leg_{};
  S gravity_{};
};

}  // namespace esmc::host
