#pragma once
/// Functions that several optional parts share.

#include <type_traits>

#include "firmware/control/reduced.hpp"
#include "firmware/cycle/controller.hpp"

namespace esmc::part {

/// Sets v' and s of the configured law, without K sw(s); joint rows of v', which have no mass, may be zero.
template <class M>
void without_switching(const ControllerConfig<M>& config, const Tracking<M>& t,
                       typename M::Channels& acceleration, typename M::Channels& sliding) {
  Gains<M> gain = config.gains;
  gain.k.setZero();
  gain.independent.k = typename M::Scalar(0);
  acceleration.setZero();  // the caller adds to every row
  fused_acceleration(config.law, config.mechanism, gain, Reaching::saturation, t, acceleration, sliding);
}

/// Base-joint torques (N m) that act as `torque` (N m) at all joints does, C^_a^T tau [F25].
template <class S>
[[nodiscard]] Vec2<S> on_base(const FiveBar<S>& m, const typename FiveBar<S>::Pose& p,
                              const std::type_identity_t<Vec<S, 4>>& torque) {
  return m.gather_on_base(p, Vec2<S>::Zero(), {{torque.template head<2>(), torque.template tail<2>()}});
}
/// The torques themselves, N m: both joints of an RR arm are base joints.
template <class S>
[[nodiscard]] Vec2<S> on_base(const Rr<S>&, const typename Rr<S>::Pose&,
                              const std::type_identity_t<Vec2<S>>& torque) {
  return torque;
}

/// The known delay of the torque in ticks: delay_ticks rounded, at most SuperTwisting::most_delay.
template <class M>
[[nodiscard]] int whole_delay(const ControllerConfig<M>& config) {
  using S = typename M::Scalar;
  constexpr int most = SuperTwisting<S>::most_delay;
  return config.delay_ticks < S(most) ? static_cast<int>(config.delay_ticks + S(0.5)) : most;
}
/// The delay in ticks that the reaching law has to bridge: 0 if the state is predicted, else whole_delay.
template <class M>
[[nodiscard]] int reaching_delay(const ControllerConfig<M>& config) {
  return config.predict != nullptr ? 0 : whole_delay(config);
}

}  // namespace esmc::part
