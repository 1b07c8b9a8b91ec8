#pragma once
/// Optional part: observes the disturbance torques on the base joints by their generalised momentum.

#include "firmware/cycle/part_law.hpp"

namespace esmc::part {

/// (a - b) / 4: by polarisation, a bilinear form from two of its squares.
template <class S>
typename FiveBar<S>::Rates quarter(const typename FiveBar<S>::Rates& a, const typename FiveBar<S>::Rates& b,
                                   const FiveBar<S>&) {
  typename FiveBar<S>::Rates out;
  out.platform = (a.platform - b.platform) * S(0.25);
  for (int j = 0; j < 2; ++j) out.leg[j] = (a.leg[j] - b.leg[j]) * S(0.25);
  return out;
}
/// (a - b) / 4 for the RR arm.
template <class S>
Vec2<S> quarter(const Vec2<S>& a, const Vec2<S>& b, const Rr<S>&) {
  return (a - b) * S(0.25);
}

/// Change of the momentum p = C_a^T M q' of the base joints besides torque: p' = tau + Cdot_a^T M q' - C_a^T
/// (f + g). Column k of Cdot_a is the bias of the present motion and a unit rate of base joint k.
template <class M, class S = typename M::Scalar>
Vec2<S> drift(const M& m, const typename M::Pose& p, const typename M::Rates& r,
              const typename M::Channels& momenta) {
  const Vec2<S> base = M::base(r);
  Vec2<S> out = -m.base_torque(p, m.force(M::Channels::Zero().eval(), r));
  for (int k = 0; k < 2; ++k) {
    const Vec2<S> unit = Vec2<S>::Unit(k);
    const auto square = [&](const Vec2<S>& b) {
      return m.base_accelerations(p, m.base_rates(p, b), Vec2<S>::Zero());
    };
    const typename M::Rates mixed = quarter(square(base + unit), square(base - unit), m);
    const typename M::Channels column = m.channel_accelerations(p, r, m.base_rates(p, unit), mixed);
    for (int i = 0; i < M::channels; ++i) out[k] += column[i] * momenta[i];
  }
  return out;
}

/// Updates memory.disturbance by d' = omega (p' - tau - drift - d): backward Euler in d, trapezoid in drift.
template <class M>
void momentum_observer(const ControllerConfig<M>& config, const Tracking<M>& t, PartMemory<M>& memory) {
  using S = typename M::Scalar;
  const M& m = config.mechanism;
  const S h = config.sample_time, bandwidth = config.observer_bandwidth;
  const typename M::Channels momenta = m.mass().cwiseProduct(m.channel_rates(t.pose, t.rates));
  const Vec2<S> p = m.base_torque(t.pose, momenta), half = drift(m, t.pose, t.rates, momenta) * (h * S(0.5));
  if (memory.ticks > 0) {
    const Vec2<S> acted = on_base(m, t.pose, memory.torque(whole_delay(config)));
    const Vec2<S> unknown = p - half - memory.momentum - acted * h;
    memory.disturbance = (memory.disturbance + unknown * bandwidth) / (S(1) + bandwidth * h);
    const S most = config.torque_limit.sum();  // no more can be compensated; NaN stays NaN
    for (int i = 0; i < 2; ++i) {
      if (memory.disturbance[i] > most) memory.disturbance[i] = most;
      if (memory.disturbance[i] < -most) memory.disturbance[i] = -most;
    }
  }
  memory.momentum = p + half;
}

}  // namespace esmc::part
