#pragma once
/// The extended sliding-mode law (ESMC), equations (85)-(95) of the report in the corrected form [F29] of
/// docs/model.md section 9, as vector algebra over all channels. The force on (x, y) is then
///
///   F = C^T (M v' + f + g) = m.platform_force(pose, m.force(v', rates))                          (95)
///
/// (mechanism/coupling.hpp), the torque of two base motors m.base_torque(..) of the same argument [F25]. No
/// mass matrix is inverted. A control tick calls fused_law.hpp: the same bits, row by row.

#include "firmware/control/reaching.hpp"
#include "firmware/types.hpp"

namespace esmc {

/// Gains, one entry per channel of p; laws in the independent coordinates use `independent`.
template <class M, class S = typename M::Scalar>
struct Gains {
  using Channels = typename M::Channels;
  Channels lambda = Channels::Zero();  ///< Lambda, 1/s, > 0
  Channels k = Channels::Zero();       ///< K, unit of the channel / s2, >= 0
  Channels layer = Channels::Ones();   ///< epsilon, unit of the channel / s, > 0
  /// Gains for the independent coordinates: (x, y) of the 5R, the joint angles of the RR arm.
  struct Independent {
    S lambda{}, k{}, layer{S(1)};
    S kp{}, kd{};  ///< ctc: 1/s2 and 1/s; pd: N m/rad and N m s/rad
  } independent{};
};

/// State and reference as every law takes them: closed poses and their rates. Not initialised by itself.
template <class M>
struct Tracking {
  typename M::Pose pose, desired_pose;
  typename M::Rates rates, desired_rates;
  typename M::Rates desired_acceleration;
};

/// Output of a law, channel by channel.
template <class M>
struct Demand {
  typename M::Channels acceleration;  ///< v', unit of the channel / s2
  typename M::Channels sliding;       ///< s, unit of the channel / s; zero where the law has none
};

/// Tracking errors of all channels [F29], in the unit of the channel, per s, per s2.
template <class M>
struct ChannelErrors {
  typename M::Channels e;       ///< q_d - q, angles in [-pi, pi]
  typename M::Channels e_rate;  ///< e' = C(q_d) p#_d - C(q) p#
  typename M::Channels qdd_d;   ///< q''_d = C(q_d) a_d + Cdot(q_d) p#_d
};
/// Tracking errors of the state `t` in every channel [F29]; NaN in, NaN out.
template <class M>
[[nodiscard]] ChannelErrors<M> channel_errors(const M& m, const Tracking<M>& t) {
  using S = typename M::Scalar;
  ChannelErrors<M> out;
  m.for_each_error_row(t, [&](auto row, S e, S e_rate, S qdd_d) ESMC_INLINE {
    out.e[row] = e;
    out.e_rate[row] = e_rate;
    out.qdd_d[row] = qdd_d;
  });
  return out;
}

/// v' = q''_d + Lambda e' + K sw(s), s = e' + Lambda e in every channel (90), [F29]. With an exact model
/// C^T M (s' + K sw(s)) = 0 [F31]. NaN in, NaN out.
template <class M>
[[nodiscard]] Demand<M> esmc_acceleration(const M& m, const Gains<M>& gain, Reaching reaching,
                                          const Tracking<M>& t) {
  using Channels = typename M::Channels;
  const auto [e, e_rate, qdd_d] = channel_errors(m, t);
  const Channels s = e_rate + gain.lambda.cwiseProduct(e);
  const Channels sw = switching(reaching, s, gain.layer);
  return {qdd_d + gain.lambda.cwiseProduct(e_rate) + gain.k.cwiseProduct(sw), s};
}

}  // namespace esmc
