#pragma once
/// The laws as a control tick evaluates them: bit for bit `demand` of law.hpp, but in one pass over the rows
/// that stores no errors. Joint rows of v' are undefined: without mass they do not enter C^T (M v' + f + g).

#include "firmware/control/law.hpp"

namespace esmc {

/// Sets v' and s of esmc or esmc_projected with a reaching law that clamps. One function per law: in one, the
/// compiler no longer keeps the rows in registers.
template <LawKind law, class M>
[[gnu::noinline]] void clamped_acceleration(const M& m, const Gains<M>& gain, const Tracking<M>& t,
                                            typename M::Channels& acceleration,
                                            typename M::Channels& sliding) {
  using S = typename M::Scalar;
  if constexpr (law == LawKind::esmc) {
    m.template for_each_error_row<false>(t, [&](auto row, S e, S e_rate, S qdd_d) ESMC_INLINE {
      const S lambda = gain.lambda[row], s = e_rate + lambda * e;
      sliding[row] = s;
      acceleration[row] = qdd_d + lambda * e_rate + gain.k[row] * saturated(s, gain.layer[row]);
    });
  } else {
    for_each_projected_row(m, gain, t, [&](auto row, S s, S reference) ESMC_INLINE {
      if constexpr (M::has_mass(row)) {
        sliding[row] = s;
        acceleration[row] = reference + gain.k[row] * saturated(s, gain.layer[row]);
      }
    });
  }
  M::fill_joint_rows(sliding);
}
/// Calls clamped_acceleration for esmc, or for esmc_projected where `law` is anything else.
template <class M>
void channelwise_acceleration(LawKind law, const M& m, const Gains<M>& gain, const Tracking<M>& t,
                              typename M::Channels& acceleration, typename M::Channels& sliding) {
  if (law == LawKind::esmc) {
    clamped_acceleration<LawKind::esmc>(m, gain, t, acceleration, sliding);
  } else {
    clamped_acceleration<LawKind::esmc_projected>(m, gain, t, acceleration, sliding);
  }
}

/// Sets v' and s of esmc or esmc_projected with sign or tanh: a second pass adds K sw(s), and takes longer.
template <class M>
[[gnu::noinline]] void unclamped_acceleration(LawKind law, const M& m, const Gains<M>& gain,
                                              Reaching reaching, const Tracking<M>& t,
                                              typename M::Channels& acceleration,
                                              typename M::Channels& sliding) {
  Gains<M> without = gain;
  without.k.setZero();
  without.layer.setOnes();  // `sign` needs none: it may be 0
  acceleration.setZero();
  channelwise_acceleration(law, m, without, t, acceleration, sliding);
  acceleration += gain.k.cwiseProduct(switching(reaching, sliding, gain.layer));
}

/// Sets v' (unit of the channel / s2; joint rows undefined) and, for a log, s (/ s; in a joint's row that of
/// its bar less that of the bar before). smc: s of both coordinates in the first two rows, else 0; ctc: s 0;
/// pd: both 0, see torque_pd.
template <class M>
void fused_acceleration(LawKind law, const M& m, const Gains<M>& gain, Reaching reaching,
                        const Tracking<M>& t, typename M::Channels& acceleration,
                        typename M::Channels& sliding) {
  if (law != LawKind::esmc && law != LawKind::esmc_projected) {
    independent_law(law, m, gain, reaching, t, acceleration, sliding);
  } else if (clamps(reaching)) {
    channelwise_acceleration(law, m, gain, t, acceleration, sliding);
  } else {
    unclamped_acceleration(law, m, gain, reaching, t, acceleration, sliding);
  }
}

}  // namespace esmc
