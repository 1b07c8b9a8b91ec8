#pragma once
/// The control laws as one kind of object: from state and reference to the acceleration v' asked of every
/// channel; the torque is then C^T (M v' + f + g) for all of them. No mass matrix is inverted.

#include <cstdint>

#include "firmware/control/reaching.hpp"
#include "firmware/types.hpp"

namespace esmc {

/// Laws, see docs/theory.md.
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
  /// Gains of the laws that act in the independent coordinates.
  struct Independent {  ///< of (x, y) for the 5R, of the joints for RR
    S lambda{}, k{}, layer{S(1)};
    S kp{}, kd{};  ///< ctc: 1/s2 and 1/s; pd: N m/rad and N m s/rad
  } independent{};
};

/// Rates of a mechanism at rest.
template <class M>
[[nodiscard]] typename M::Rates rest() {
  if constexpr (requires { M::Rates::zero(); }) {
    return M::Rates::zero();
  } else {
    return M::Rates::Zero();
  }
}

/// State and reference in the form every law takes. Poses are closed and rates belong to them. Not
/// initialised by itself.
template <class M>
struct Tracking {
  typename M::Pose pose, desired_pose;
  typename M::Rates rates, desired_rates;
  typename M::Rates desired_acceleration;
};

/// Which rows of v' are asked for. What has no mass takes no force: on the way to a torque its rows are never
/// read.
enum class Rows : std::uint8_t { all, with_mass };

/// v' = qdd_d + Lambda e' + K sw(s), s = e' + Lambda e in every channel [F29]. With Rows::with_mass the other
/// rows of `acceleration` are not set; those of `sliding` are then the differences of the bars', for a log.
template <class M, Rows rows = Rows::all>
void esmc_acceleration(const M& m, const Gains<M>& gain, const Tracking<M>& t,
                       typename M::Channels& acceleration, typename M::Channels& sliding) {
  using S = typename M::Scalar;
  m.template for_each_error_row<rows == Rows::all>(
      t.desired_pose, t.desired_rates, t.desired_acceleration, t.pose, t.rates,
      [&](auto row, S e, S rate, S of_reference) ESMC_INLINE {
        const S lambda = gain.lambda[row], s = rate + lambda * e;
        sliding[row] = s;
        acceleration[row] = of_reference + lambda * rate + gain.k[row] * saturated(s, gain.layer[row]);
      });
  if constexpr (rows == Rows::with_mass) M::fill_joint_rows(sliding);
}
/// v' = C a_r + Cdot v_r + K sw(C sigma), sigma = e' + lambda e in the independent coordinates,
/// v_r = v_d + lambda e, a_r = a_d + lambda e' [F33]. V' <= 0 holds exactly for an exact model. Rows as for
/// esmc_acceleration.
template <class M, Rows rows = Rows::all>
void projected_acceleration(const M& m, const Gains<M>& gain, const Tracking<M>& t,
                            typename M::Channels& acceleration, typename M::Channels& sliding) {
  using S = typename M::Scalar;
  const S lambda = gain.independent.lambda;
  const Vec2<S> e = M::independent_error(t.desired_pose, t.pose);
  const Vec2<S> ed = M::independent(t.desired_rates) - M::independent(t.rates);
  const typename M::Rates reference =
      m.chain_rates(t.pose, Vec2<S>(M::independent(t.desired_rates) + e * lambda));
  const typename M::Rates sigma = m.chain_rates(t.pose, Vec2<S>(ed + e * lambda));
  const typename M::Rates straight =
      m.chain_rates(t.pose, Vec2<S>(M::independent(t.desired_acceleration) + ed * lambda));
  typename M::Rates whole = m.chain_bias(t.pose, t.rates, reference);
  add(whole, straight);
  m.template for_each_reference_row<rows == Rows::all>(
      t.pose, sigma, whole, t.rates, reference, [&](auto row, S s, S asked) ESMC_INLINE {
        sliding[row] = s;
        acceleration[row] = asked + gain.k[row] * saturated(s, gain.layer[row]);
      });
  if constexpr (rows == Rows::with_mass) M::fill_joint_rows(sliding);
}

/// The laws that have a term in every channel.
enum class Channelwise : std::uint8_t { esmc, projected };
template <Channelwise law, class M, Rows rows>
ESMC_INLINE inline void clamped_acceleration(const M& m, const Gains<M>& gain, const Tracking<M>& t,
                                             typename M::Channels& acceleration,
                                             typename M::Channels& sliding) {
  if constexpr (law == Channelwise::esmc) {
    esmc_acceleration<M, rows>(m, gain, t, acceleration, sliding);
  } else {
    projected_acceleration<M, rows>(m, gain, t, acceleration, sliding);
  }
}
/// With a reaching law that does not clamp. A tick of those may take longer: they have their term added in a
/// second pass, so that the first one asks nothing in every channel.
template <Channelwise law, class M, Rows rows>
[[gnu::noinline]] void unclamped_acceleration(const M& m, const Gains<M>& gain, Reaching reaching,
                                              const Tracking<M>& t, typename M::Channels& acceleration,
                                              typename M::Channels& sliding) {
  Gains<M> without = gain;
  without.k.setZero();
  without.layer.setOnes();  // `sign` has none
  acceleration.setZero();
  clamped_acceleration<law, M, rows>(m, without, t, acceleration, sliding);
  add_switching(reaching, sliding, gain.k, gain.layer, acceleration);
}
/// Either of them with any reaching law.
template <Channelwise law, class M, Rows rows>
ESMC_INLINE inline void channelwise_acceleration(const M& m, const Gains<M>& gain, Reaching reaching,
                                                 const Tracking<M>& t, typename M::Channels& acceleration,
                                                 typename M::Channels& sliding) {
  if (clamps(reaching)) {
    clamped_acceleration<law, M, rows>(m, gain, t, acceleration, sliding);
  } else {
    unclamped_acceleration<law, M, rows>(m, gain, reaching, t, acceleration, sliding);
  }
}
template <class M, Rows rows = Rows::all>
void esmc_acceleration(const M& m, const Gains<M>& gain, Reaching reaching, const Tracking<M>& t,
                       typename M::Channels& acceleration, typename M::Channels& sliding) {
  channelwise_acceleration<Channelwise::esmc, M, rows>(m, gain, reaching, t, acceleration, sliding);
}
template <class M, Rows rows = Rows::all>
void projected_acceleration(const M& m, const Gains<M>& gain, Reaching reaching, const Tracking<M>& t,
                            typename M::Channels& acceleration, typename M::Channels& sliding) {
  channelwise_acceleration<Channelwise::projected, M, rows>(m, gain, reaching, t, acceleration, sliding);
}

/// v' = C u + c, where u is the acceleration asked of the independent coordinates.
template <class M, class S = typename M::Scalar>
[[nodiscard]] typename M::Channels independent_acceleration(const M& m, const Tracking<M>& t,
                                                            const Vec2<S>& u) {
  return m.channel_accelerations(t.pose, t.rates, m.chain_accelerations(t.pose, t.rates, u));
}

/// u = a_d + lambda e' + k sw(e' + lambda e) [F27].
template <class M>
void smc_acceleration(const M& m, const Gains<M>& gain, Reaching reaching, const Tracking<M>& t,
                      typename M::Channels& acceleration, typename M::Channels& sliding) {
  using S = typename M::Scalar;
  const auto& g = gain.independent;
  const Vec2<S> e = M::independent_error(t.desired_pose, t.pose);
  const Vec2<S> ed = M::independent(t.desired_rates) - M::independent(t.rates);
  Vec2<S> u = M::independent(t.desired_acceleration);
  sliding.setZero();
  unroll<2>([&](auto i) {
    const S s = ed[i] + g.lambda * e[i];
    sliding[i] = s;
    u[i] += g.lambda * ed[i] + g.k * switching(reaching, s, g.layer);
  });
  acceleration = independent_acceleration(m, t, u);
}

/// u = a_d + Kd e' + Kp e, model.md section 8.
template <class M>
void ctc_acceleration(const M& m, const Gains<M>& gain, const Tracking<M>& t,
                      typename M::Channels& acceleration, typename M::Channels& sliding) {
  using S = typename M::Scalar;
  const auto& g = gain.independent;
  const Vec2<S> e = M::independent_error(t.desired_pose, t.pose);
  const Vec2<S> ed = M::independent(t.desired_rates) - M::independent(t.rates);
  sliding.setZero();
  acceleration =
      independent_acceleration(m, t, Vec2<S>(M::independent(t.desired_acceleration) + ed * g.kd + e * g.kp));
}

/// Base-joint torque of the model-free law: Kp e + Kd e', N m.
template <class M, class S = typename M::Scalar>
[[nodiscard]] Vec2<S> torque_pd(const Gains<M>& gain, const Tracking<M>& t) {
  return M::base_error(t.desired_pose, t.pose) * gain.independent.kp +
         (M::base(t.desired_rates) - M::base(t.rates)) * gain.independent.kd;
}

/// The demand of any model-based law (all but pd, which asks for a torque directly: zeros): v' and, for the
/// log, the sliding variables of the channels, zero where a law has none.
template <class M, Rows rows = Rows::all>
void demand(LawKind law, const M& m, const Gains<M>& gain, Reaching reaching, const Tracking<M>& t,
            typename M::Channels& acceleration, typename M::Channels& sliding) {
  switch (law) {
    case LawKind::esmc:
      return channelwise_acceleration<Channelwise::esmc, M, rows>(m, gain, reaching, t, acceleration,
                                                                  sliding);
    case LawKind::esmc_projected:
      return channelwise_acceleration<Channelwise::projected, M, rows>(m, gain, reaching, t, acceleration,
                                                                       sliding);
    case LawKind::smc:
      return smc_acceleration(m, gain, reaching, t, acceleration, sliding);
    case LawKind::ctc:
      return ctc_acceleration(m, gain, t, acceleration, sliding);
    case LawKind::pd:
      break;
  }
  acceleration.setZero();
  sliding.setZero();
}

/// The same, for whoever has no place for it.
template <class M>
struct Demand {
  typename M::Channels acceleration;  ///< v'
  typename M::Channels sliding;       ///< s of the channels
};
template <class M>
[[nodiscard]] Demand<M> demand(LawKind law, const M& m, const Gains<M>& gain, Reaching reaching,
                               const Tracking<M>& t) {
  Demand<M> out;
  demand(law, m, gain, reaching, t, out.acceleration, out.sliding);
  return out;
}

}  // namespace esmc
