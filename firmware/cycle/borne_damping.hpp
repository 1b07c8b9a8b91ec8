#pragma once
/// Damping that a sampled loop with delays bears.

#include "firmware/cycle/controller_config.hpp"

namespace esmc {

/// Damping of two coordinates, N m s/rad (N s/m), each of which takes a fifth of its speed in a tick, less
/// where the loop has delays: by its inertia with the other one free, M_ii - M_ij^2 / M_jj. Both together
/// take at most twice as much, g = 0.4 / (1 + delay_ticks + lag_ticks); D ticks of delay bear g < 2 sin(pi /
/// (4 D + 2)), so D may be 3 (1 + delay_ticks + lag_ticks). `first`, `second`: rates of the mechanism at a
/// unit rate of each. Not finite where the coordinates are singular.
template <class M>
[[nodiscard, gnu::cold, gnu::noinline]] Vec2<typename M::Scalar> borne_damping(
    const ControllerConfig<M>& config, const typename M::Pose& pose, const typename M::Rates& first,
    const typename M::Rates& second) {
  using S = typename M::Scalar;
  const M& m = config.mechanism;
  const typename M::Channels a = m.channel_rates(pose, first), b = m.channel_rates(pose, second),
                             of_a = m.mass().cwiseProduct(a), of_b = m.mass().cwiseProduct(b);
  S aa(0), ab(0), bb(0);
  for (int i = 0; i < M::channels; ++i) {
    aa += a[i] * of_a[i];
    ab += a[i] * of_b[i];
    bb += b[i] * of_b[i];
  }
  const S ticks = S(1) + config.delay_ticks + config.lag_ticks;
  const S share = S(0.2) / (ticks * config.sample_time);
  return {share * (aa - ab * ab / bb), share * (bb - ab * ab / aa)};
}

}  // namespace esmc
