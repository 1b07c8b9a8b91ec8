#pragma once
/// The control laws: from state and reference to the acceleration v' of every channel. The base torque is
/// then C^T (M v' + f + g) for all of them but pd, see esmc.hpp.

#include "firmware/control/esmc.hpp"

namespace esmc {

/// Laws, see docs/theory.md.
enum class LawKind : std::uint8_t {
  esmc,            ///< [F29]: an error, a surface and a switching term in every channel
  esmc_projected,  ///< [F33]: one surface in the independent coordinates, switching in every channel
  smc,             ///< [F27]: surface and switching in the independent coordinates
  ctc,             ///< computed torque, independent coordinates
  pd,              ///< no model: base-joint spring and damper
};

/// e = x_d - x and e' of the independent coordinates, m and m/s (5R) or rad and rad/s (RR).
template <class M, class S = typename M::Scalar>
struct IndependentError {
  Vec2<S> e, rate;
  explicit IndependentError(const Tracking<M>& t)
      : e(M::independent_error(t.desired_pose, t.pose)),
        rate(M::independent(t.desired_rates) - M::independent(t.rates)) {}
};

/// Motion that the projected law lets the channels follow [F33]: sigma = e' + lambda e, v_r = v_d + lambda e,
/// a_r = a_d + lambda e'; calls f(row, (C sigma)_row, (C a_r + Cdot v_r)_row).
template <class M, class F>
ESMC_INLINE inline void for_each_projected_row(const M& m, const Gains<M>& gain, const Tracking<M>& t,
                                               F&& f) {
  using S = typename M::Scalar;
  const S lambda = gain.independent.lambda;
  const IndependentError<M> x(t);
  const typename M::Rates v_r =
      m.chain_rates(t.pose, Vec2<S>(M::independent(t.desired_rates) + x.e * lambda));
  const typename M::Rates sigma = m.chain_rates(t.pose, Vec2<S>(x.rate + x.e * lambda));
  const typename M::Rates straight =
      m.chain_rates(t.pose, Vec2<S>(M::independent(t.desired_acceleration) + x.rate * lambda));
  typename M::Rates joined = m.chain_bias(t.pose, t.rates, v_r);
  joined += straight;
  m.for_each_reference_row(t.pose, sigma, joined, t.rates, v_r, f);
}

/// v' = C a_r + Cdot v_r + K sw(C sigma), s = C sigma [F33]. An exact model gives V' <= 0 (V: [F33]).
template <class M>
[[nodiscard]] Demand<M> projected_acceleration(const M& m, const Gains<M>& gain, Reaching reaching,
                                               const Tracking<M>& t) {
  using S = typename M::Scalar;
  Demand<M> out;
  for_each_projected_row(m, gain, t, [&](auto row, S s, S reference) ESMC_INLINE {
    out.sliding[row] = s;
    out.acceleration[row] = reference;
  });
  out.acceleration += gain.k.cwiseProduct(switching(reaching, out.sliding, gain.layer));
  return out;
}

/// v' = C u + c: accelerations of all channels (m/s2, rad/s2) if the independent coordinates accelerate with
/// u: (x, y) in m/s2 (5R), joints in rad/s2 (RR). Not finite at type 1 of the 5R.
template <class M, class S = typename M::Scalar>
[[nodiscard]] typename M::Channels independent_acceleration(const M& m, const Tracking<M>& t,
                                                            const Vec2<S>& u) {
  return m.channel_accelerations(t.pose, t.rates, m.chain_accelerations(t.pose, t.rates, u));
}

/// Sets v' = C u + c with u = a_d + lambda e' + k sw(s), s = e' + lambda e of the independent coordinates
/// [F27]. s stands in the first two rows of `sliding`, the others are zero.
template <class M>
void smc_acceleration(const M& m, const Gains<M>& gain, Reaching reaching, const Tracking<M>& t,
                      typename M::Channels& acceleration, typename M::Channels& sliding) {
  using S = typename M::Scalar;
  const auto& g = gain.independent;
  const IndependentError<M> x(t);
  Vec2<S> u = M::independent(t.desired_acceleration);
  sliding.setZero();
  unroll<2>([&](auto i) {
    const S s = x.rate[i] + g.lambda * x.e[i];
    sliding[i] = s;
    u[i] += g.lambda * x.rate[i] + g.k * switching(reaching, s, g.layer);
  });
  acceleration = independent_acceleration(m, t, u);
}

/// Sets v' = C u + c with u = a_d + Kd e' + Kp e of the independent coordinates (computed torque, model.md
/// section 8), and `sliding` to zero.
template <class M>
void ctc_acceleration(const M& m, const Gains<M>& gain, const Tracking<M>& t,
                      typename M::Channels& acceleration, typename M::Channels& sliding) {
  using S = typename M::Scalar;
  const auto& g = gain.independent;
  const IndependentError<M> x(t);
  sliding.setZero();
  acceleration = independent_acceleration(
      m, t, Vec2<S>(M::independent(t.desired_acceleration) + x.rate * g.kd + x.e * g.kp));
}

/// Base-joint torque of the law without a model: Kp e + Kd e', N m.
template <class M, class S = typename M::Scalar>
[[nodiscard]] Vec2<S> torque_pd(const Gains<M>& gain, const Tracking<M>& t) {
  return M::base_error(t.desired_pose, t.pose) * gain.independent.kp +
         (M::base(t.desired_rates) - M::base(t.rates)) * gain.independent.kd;
}

/// Sets v' and s of smc, or v' and s = 0 of ctc; zeros for any other law (pd: see torque_pd).
template <class M>
void independent_law(LawKind law, const M& m, const Gains<M>& gain, Reaching reaching, const Tracking<M>& t,
                     typename M::Channels& acceleration, typename M::Channels& sliding) {
  if (law == LawKind::smc) return smc_acceleration(m, gain, reaching, t, acceleration, sliding);
  if (law == LawKind::ctc) return ctc_acceleration(m, gain, t, acceleration, sliding);
  acceleration.setZero();
  sliding.setZero();
}

/// v' and s of any law, all rows; zeros for pd. The controller calls `fused_acceleration`.
template <class M>
[[nodiscard]] Demand<M> demand(LawKind law, const M& m, const Gains<M>& gain, Reaching reaching,
                               const Tracking<M>& t) {
  if (law == LawKind::esmc) return esmc_acceleration(m, gain, reaching, t);
  if (law == LawKind::esmc_projected) return projected_acceleration(m, gain, reaching, t);
  Demand<M> out;
  independent_law(law, m, gain, reaching, t, out.acceleration, out.sliding);
  return out;
}

}  // namespace esmc
