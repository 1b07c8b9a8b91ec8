#pragma once
/// The control laws as one kind of object: from state and reference to the acceleration v' asked of every
/// channel; the torque is then C^T (M v' + f + g) for all of them. No mass matrix is inverted.

#include <cstdint>

#include "firmware/control/reaching.hpp"
#include "firmware/types.hpp"

namespace esmc {

enum class LawKind : std::uint8_t {
  esmc,            ///< [F29]: an error, a surface and a switching term in every channel
  esmc_projected,  ///< [F33]: one surface in the independent coordinates, switching in every channel
  smc,             ///< [F27]: surface and switching in the independent coordinates
  ctc,             ///< computed torque, independent coordinates
  pd,              ///< no model: base-joint spring and damper
};

/// Gains, one entry per channel of p; laws in independent coordinates use `independent`.
template <class M, class S = typename M::Scalar>
struct Gains {
  using Channels = typename M::Channels;
  Channels lambda = Channels::Zero();  ///< Lambda, 1/s, > 0
  Channels k = Channels::Zero();       ///< K, unit of the channel / s2, >= 0
  Channels layer = Channels::Ones();   ///< epsilon, unit of the channel / s, > 0
  struct Independent {                 ///< of (x, y) for the 5R, of the joints for RR
    S lambda{}, k{}, layer{S(1)};
    S kp{}, kd{};  ///< ctc: 1/s2 and 1/s; pd: N m/rad and N m s/rad
  } independent{};
};

/// State and reference in the form every law takes. Poses are closed and rates belong to them.
template <class M>
struct Tracking {
  typename M::Pose pose, desired_pose;
  typename M::Rates rates, desired_rates;
  typename M::Rates desired_acceleration;
};

/// What a law asks for, and the sliding variables it saw (for the log; zero where a law has none).
template <class M>
struct Demand {
  typename M::Channels acceleration = M::Channels::Zero();  ///< v'
  typename M::Channels sliding = M::Channels::Zero();       ///< s of the channels
};

/// v' = qdd_d + Lambda e' + K sw(s), s = e' + Lambda e in every channel [F29].
template <class M>
[[nodiscard]] Demand<M> demand_esmc(const M& m, const Gains<M>& gain, Reaching reaching, const Tracking<M>& t) {
  using S = typename M::Scalar;
  using Channels = typename M::Channels;
  const Channels e = m.error(t.desired_pose, t.pose);
  const Channels rate_d = m.channel_rates(t.desired_pose, t.desired_rates);
  const Channels rate = m.channel_rates(t.pose, t.rates);
  const Channels acc_d = m.channel_accelerations(t.desired_pose, t.desired_rates, t.desired_acceleration);
  Demand<M> out;
  for (int i = 0; i < M::channels; ++i) {
    const S ed = rate_d[i] - rate[i];
    out.sliding[i] = ed + gain.lambda[i] * e[i];
    out.acceleration[i] = acc_d[i] + gain.lambda[i] * ed;
  }
  add_switching(reaching, out.sliding, gain.k, gain.layer, out.acceleration);
  return out;
}

/// v' = C a_r + Cdot v_r + K sw(C sigma), sigma = e' + lambda e in the independent coordinates,
/// v_r = v_d + lambda e, a_r = a_d + lambda e' [F33]. V' <= 0 holds exactly for an exact model.
template <class M>
[[nodiscard]] Demand<M> demand_projected(const M& m, const Gains<M>& gain, Reaching reaching, const Tracking<M>& t) {
  using S = typename M::Scalar;
  const S lambda = gain.independent.lambda;
  const Vec2<S> e = M::independent_error(t.desired_pose, t.pose);
  const Vec2<S> ed = M::independent(t.desired_rates) - M::independent(t.rates);
  const typename M::Rates reference = m.chain_rates(t.pose, Vec2<S>(M::independent(t.desired_rates) + e * lambda));
  const typename M::Rates sigma = m.chain_rates(t.pose, Vec2<S>(ed + e * lambda));
  const typename M::Rates straight =
      m.chain_rates(t.pose, Vec2<S>(M::independent(t.desired_acceleration) + ed * lambda));
  typename M::Rates acceleration = m.chain_bias(t.pose, t.rates, reference);
  add(acceleration, straight);
  Demand<M> out;
  out.sliding = m.channel_rates(t.pose, sigma);
  out.acceleration = m.channel_accelerations(t.pose, t.rates, reference, acceleration);
  add_switching(reaching, out.sliding, gain.k, gain.layer, out.acceleration);
  return out;
}

/// v' = C u + c, where u is the acceleration asked of the independent coordinates.
template <class M, class S = typename M::Scalar>
[[nodiscard]] typename M::Channels demand_independent(const M& m, const Tracking<M>& t, const Vec2<S>& u) {
  return m.channel_accelerations(t.pose, t.rates, m.chain_accelerations(t.pose, t.rates, u));
}

/// u = a_d + lambda e' + k sw(e' + lambda e) [F27].
template <class M>
[[nodiscard]] Demand<M> demand_smc(const M& m, const Gains<M>& gain, Reaching reaching, const Tracking<M>& t) {
  using S = typename M::Scalar;
  const auto& g = gain.independent;
  const Vec2<S> e = M::independent_error(t.desired_pose, t.pose);
  const Vec2<S> ed = M::independent(t.desired_rates) - M::independent(t.rates);
  Vec2<S> u = M::independent(t.desired_acceleration);
  Demand<M> out;
  unroll<2>([&](auto i) {
    const S s = ed[i] + g.lambda * e[i];
    out.sliding[i] = s;
    u[i] += g.lambda * ed[i] + g.k * switching(reaching, s, g.layer);
  });
  out.acceleration = demand_independent(m, t, u);
  return out;
}

/// u = a_d + Kd e' + Kp e, model.md section 8.
template <class M>
[[nodiscard]] Demand<M> demand_ctc(const M& m, const Gains<M>& gain, const Tracking<M>& t) {
  using S = typename M::Scalar;
  const auto& g = gain.independent;
  const Vec2<S> e = M::independent_error(t.desired_pose, t.pose);
  const Vec2<S> ed = M::independent(t.desired_rates) - M::independent(t.rates);
  Demand<M> out;
  out.acceleration = demand_independent(
      m, t, Vec2<S>(M::independent(t.desired_acceleration) + ed * g.kd + e * g.kp));
  return out;
}

/// Base-joint torque of the model-free law: Kp e + Kd e', N m.
template <class M, class S = typename M::Scalar>
[[nodiscard]] Vec2<S> torque_pd(const Gains<M>& gain, const Tracking<M>& t) {
  return M::base_error(t.desired_pose, t.pose) * gain.independent.kp +
         (M::base(t.desired_rates) - M::base(t.rates)) * gain.independent.kd;
}

/// The demand of any model-based law (all but pd, which asks for a torque directly).
template <class M>
[[nodiscard]] Demand<M> demand(LawKind law, const M& m, const Gains<M>& gain, Reaching reaching,
                               const Tracking<M>& t) {
  switch (law) {
    case LawKind::esmc: return demand_esmc(m, gain, reaching, t);
    case LawKind::esmc_projected: return demand_projected(m, gain, reaching, t);
    case LawKind::smc: return demand_smc(m, gain, reaching, t);
    case LawKind::ctc: return demand_ctc(m, gain, t);
    case LawKind::pd: break;
  }
  return {};
}

}  // namespace esmc
