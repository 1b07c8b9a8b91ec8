#pragma once
/// Optional part: the coupled implicit step (firmware/control/coupled.hpp) with the known delay.

#include "firmware/control/coupled.hpp"
#include "firmware/cycle/part_law.hpp"

namespace esmc::part {

template <class M>
void implicit_coupled(const ControllerConfig<M>& config, const Tracking<M>& t, PartMemory<M>&,
                      typename M::Channels& acceleration, typename M::Channels& sliding) {
  using S = typename M::Scalar;
  without_switching(config, t, acceleration, sliding);
  const Reduced<M> reduced(config.mechanism, t.pose);
  const S T = implicit_layer(S(1), config.sample_time, S(reaching_delay(config)) + config.lag_ticks);
  typename M::Channels weight;
  for (int i = 0; i < M::channels; ++i) weight[i] = T * reduced.mass()[i] * config.gains.k[i];
  Vec2<S> q;
  if (CoupledStep<M>(reduced, sliding, weight).solve(q)) {
    acceleration += reduced.channels(q * (S(-1) / T));
  } else {
    acceleration += config.gains.k.cwiseProduct(switching(Reaching::implicit, sliding, config.gains.layer));
  }
}

}  // namespace esmc::part
