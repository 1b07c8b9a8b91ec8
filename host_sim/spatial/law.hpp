#pragma once
/// ESMC in space: from state and reference to the acceleration v' asked of every channel; the force on the
/// platform is then C^T (M v' + v + f + g), as in firmware/control/law.hpp for the plane. M: a
/// SpatialCoupling.

#include "firmware/control/reaching.hpp"
#include "host_sim/scene/names.hpp"
#include "host_sim/spatial/coupling.hpp"

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
  void reset() { known_ = false; }  ///< the next choose() begins without memory

 private:
  S hysteresis_{};
  Quaternion<S> last_{};
  bool known_ = false;
};

/// Euler angles (roll, pitch, yaw) at one attitude, R = Rz(yaw) Ry(pitch) Rx(roll), and the map between their
/// rates and the angular velocity.
template <class S>
struct EulerChart {
  Vec3<S> angle;  ///< rad
  SinCos<S> roll, pitch;

  /// The chart at an attitude q of norm 1, not checked; pitch in [-pi/2, pi/2].
  [[nodiscard]] static EulerChart at(const Quaternion<S>& q) {
    const Rotation<S> r = rotation(q);
    EulerChart c;
    // cos pitch from two entries: from the sine alone it would lose half its digits next to 90 degrees.
    const S level = square_root(r.x.x() * r.x.x() + r.x.y() * r.x.y());
    c.angle = Vec3<S>(arc_tangent2(r.y.z(), r.z.z()), arc_tangent2(S(-r.x.z()), level),
                      arc_tangent2(r.x.y(), r.x.x()));
    c.roll = sin_cos(c.angle.x());
    c.pitch = {-r.x.z(), level};
    return c;
  }

  /// B^-1 w: rates of an angular velocity in the frame of the body. Pole at pitch = +-90 degrees.
  [[nodiscard]] Vec3<S> rates(const Vec3<S>& w) const {
    const S yaw = (w.y() * roll.sin + w.z() * roll.cos) / pitch.cos;
    return Vec3<S>(w.x() + yaw * pitch.sin, w.y() * roll.cos - w.z() * roll.sin, yaw);
  }
  /// B d: angular velocity of rates d, in the frame of the body.
  [[nodiscard]] Vec3<S> turning(const Vec3<S>& d) const {
    return Vec3<S>(d.x() - d.z() * pitch.sin, d.y() * roll.cos + d.z() * pitch.cos * roll.sin,
                   d.z() * pitch.cos * roll.cos - d.y() * roll.sin);
  }
  /// Bdot d: angular acceleration at constant rates d.
  [[nodiscard]] Vec3<S> drift(const Vec3<S>& d) const {
    const S yp = d.z() * d.y(), yr = d.z() * d.x(), pr = d.y() * d.x();
    return Vec3<S>(-yp * pitch.cos, yr * pitch.cos * roll.cos - pr * roll.sin - yp * pitch.sin * roll.sin,
                   -pr * roll.cos - yp * pitch.sin * roll.cos - yr * pitch.cos * roll.sin);
  }
};

/// Gains, one set for velocities of points and one for angular velocities.
template <class S>
struct SpatialGains {
  /// Of one kind of channel.
  struct Kind {
    S lambda{};  ///< 1/s, > 0
    S k{};       ///< m/s2 or rad/s2, >= 0
    S layer{1};  ///< m/s or rad/s, > 0
  };
  Kind point{}, turn{};
  S least_cos_pitch{S(0.01)};  ///< smc_euler: closer to its singularity it has no answer
};

/// State and reference; `turn` is q_e with the sign of AttitudeChoice. Not initialised by itself.
template <class M>
struct SpatialTracking {
  typename M::Pose pose, desired_pose;
  typename M::Rates rates, desired_rates, desired_acceleration;
  Quaternion<typename M::Scalar> turn;
};

/// v' and, for the log, s, channel by channel; 0 in rows without mass.
template <class M>
struct SpatialDemand {
  typename M::Channels acceleration = M::Channels::Zero(), sliding = M::Channels::Zero();
};

/// v' = q''_d + Lambda e' + K sw(s), s = rate + Lambda e in every channel [F29]. In the channels of an
/// attitude e = 2 vec q_e and `rate` = R_e w_d - w, which is not e': see AttitudeError. With an exact model
/// C^T M (s' + K sw s) = 0 [F31].
template <class M, class S = typename M::Scalar>
[[nodiscard]] SpatialDemand<M> esmc_acceleration(const M& m, const SpatialGains<S>& gain, Reaching reaching,
                                                 const SpatialTracking<M>& t) {
  SpatialDemand<M> out;
  m.for_each_error_row(t.desired_pose, t.desired_rates, t.desired_acceleration, t.pose, t.rates, t.turn,
                       [&](int row, const ChannelError<S>& c) {
                         const auto& g = M::is_turn(row) ? gain.turn : gain.point;
                         const S s = c.rate + g.lambda * c.e;
                         out.sliding[row] = s;
                         out.acceleration[row] =
                             c.of_reference + g.lambda * c.e_rate + g.k * switching(reaching, s, g.layer);
                       });
  return out;
}

/// v' = C v_r' + Cdot v_r + K sw(C sigma), sigma = v_r - p0#, v_r = [x'_d + lambda e_x; R_e w_d + lambda e]
/// [F33]. With an exact model V = 1/2 sigma^T H sigma has V' = -sum M_i K_i |(C sigma)_i| at every error.
template <class M, class S = typename M::Scalar>
[[nodiscard]] SpatialDemand<M> projected_acceleration(const M& m, const SpatialGains<S>& gain,
                                                      Reaching reaching, const SpatialTracking<M>& t) {
  using Independent = typename M::Independent;
  const Independent &vd = t.desired_rates.platform, &ad = t.desired_acceleration.platform,
                    &v = t.rates.platform;
  const AttitudeError<S> a = attitude_error(t.turn, M::turn_of(vd), M::turn_of(ad), M::turn_of(v));
  const Vec3<S> e = t.desired_pose.position - t.pose.position, ed = M::point_of(vd) - M::point_of(v);
  const Vec3<S> point = ed + e * gain.point.lambda, turn = a.rate + a.e * gain.turn.lambda;
  const Independent sigma = M::joined(point, turn), reference = v + sigma;
  const Independent push = M::joined(Vec3<S>(M::point_of(ad) + ed * gain.point.lambda),
                                     Vec3<S>(a.of_reference + a.e_rate * gain.turn.lambda));
  const typename M::Rates of_reference = m.chain_rates(t.pose, reference),
                          straight = m.chain_rates(t.pose, push);
  typename M::Rates whole = m.chain_bias(t.pose, t.rates, of_reference);
  whole.platform = push;
  for (int j = 0; j < M::legs; ++j) whole.leg[j] += straight.leg[j];
  SpatialDemand<M> out;
  out.sliding = m.channel_rates(t.pose, m.chain_rates(t.pose, sigma));
  out.acceleration = m.channel_accelerations(t.pose, t.rates, of_reference, whole);
  for (int row = 0; row < M::channels; ++row) {
    const auto& g = M::is_turn(row) ? gain.turn : gain.point;
    out.acceleration[row] += g.k * switching(reaching, S(out.sliding[row]), g.layer);
  }
  return out;
}

/// Sliding mode in six minimal coordinates: x and Euler angles phi, u = phi''_d + lambda e' + k sw(e' +
/// lambda e), asked of the body as B u + Bdot phi'. False where the angles of state or reference are next to
/// their singularity.
template <class M, class S = typename M::Scalar>
[[nodiscard]] bool euler_acceleration(const M& m, const SpatialGains<S>& gain, Reaching reaching,
                                      const SpatialTracking<M>& t, SpatialDemand<M>& out) {
  const typename M::Independent &vd = t.desired_rates.platform, &ad = t.desired_acceleration.platform,
                                &v = t.rates.platform;
  const EulerChart<S> here = EulerChart<S>::at(t.pose.attitude),
                      there = EulerChart<S>::at(t.desired_pose.attitude);
  if (!(here.pitch.cos > gain.least_cos_pitch) || !(there.pitch.cos > gain.least_cos_pitch)) return false;
  const Vec3<S> rate = here.rates(M::turn_of(v)), rate_d = there.rates(M::turn_of(vd)),
                push_d = there.rates(Vec3<S>(M::turn_of(ad) - there.drift(rate_d)));
  out = {};
  const auto channel = [&](int row, const typename SpatialGains<S>::Kind& g, S e, S ed, S of_reference) {
    const S s = ed + g.lambda * e;
    out.sliding[row] = s;
    return S(of_reference + g.lambda * ed + g.k * switching(reaching, s, g.layer));
  };
  Vec3<S> point, u;
  for (int i = 0; i < 3; ++i) {
    point[i] =
        channel(i, gain.point, S(t.desired_pose.position[i] - t.pose.position[i]), S(vd[i] - v[i]), S(ad[i]));
    u[i] = channel(3 + i, gain.turn, wrap_to_pi(S(there.angle[i] - here.angle[i])), S(rate_d[i] - rate[i]),
                   push_d[i]);
  }
  const Vec3<S> turn = here.turning(u) + here.drift(rate);
  out.acceleration = m.channel_accelerations(t.pose, t.rates, t.rates,
                                             m.chain_accelerations(t.pose, t.rates, M::joined(point, turn)));
  return true;
}

}  // namespace esmc::host
