#pragma once
/// Optional part: commands that make the motors give the torque of the law.

#include "firmware/cycle/controller_config.hpp"

namespace esmc::part {

template <class M>
void motor_map(const ControllerConfig<M>& config, const Sample<M>& measured, MotorTorque change,
               Vec<typename M::Scalar, M::joints>& torque) {
  using S = typename M::Scalar;
  const MotorMap<S, M::joints>& m = config.motor_map;
  const S later = config.torque_lead + config.delay_ticks * config.sample_time;
  const int n = config.motor_count();
  for (int k = 0; k < n; ++k) {
    const int i = config.joint_of(k, n);
    S cogging(0);
    if (m.amplitude[i] != S(0)) {
      const S angle = measured.angle[i] + measured.rate[i] * later;
      cogging = m.amplitude[i] * sin_cos(m.per_turn[i] * angle + m.phase[i]).sin;
    }
    torque[i] = change == MotorTorque::given_to_asked ? (torque[i] - cogging) / m.factor[i]
                                                      : m.factor[i] * torque[i] + cogging;
  }
}

}  // namespace esmc::part
