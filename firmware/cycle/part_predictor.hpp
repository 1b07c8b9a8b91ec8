#pragma once
/// Optional part: predicts the state at the instant at which the torque of this tick acts.

#include "firmware/cycle/part_law.hpp"

namespace esmc::part {

template <class M>
void predictor(const ControllerConfig<M>& config, const PartMemory<M>& memory, Tracking<M>& t) {
  using S = typename M::Scalar;
  const M& m = config.mechanism;
  const S h = config.sample_time;
  for (int ago = whole_delay(config) - 1; ago >= 0; --ago) {
    const Vec2<S> tau = on_base(m, t.pose, memory.torque(ago)) + memory.disturbance;
    typename M::Channels bias =
        m.channel_accelerations(t.pose, t.rates, m.base_accelerations(t.pose, t.rates, Vec2<S>::Zero()));
    m.add_rotors(bias);
    const Vec2<S> acceleration =
        Reduced<M>(m, t.pose).solve(tau - m.base_torque(t.pose, m.force(bias, t.rates)));
    const Vec2<S> rate = M::base(t.rates);
    const Vec2<S> angle = M::base_angles(t.pose) + rate * h + acceleration * (h * h * S(0.5));
    // If the predicted angles fit no closed mechanism, the last valid prediction is used.
    typename M::Pose pose;
    typename M::Rates rates;
    if (!estimate_from_base(m, config.mode, angle, Vec2<S>(rate + acceleration * h), pose, rates)) return;
    t.pose = pose;
    t.rates = rates;
  }
}

}  // namespace esmc::part
