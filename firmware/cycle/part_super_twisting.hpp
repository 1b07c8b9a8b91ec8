#pragma once
/// Optional part: the law of firmware/control/super_twisting.hpp on the independent coordinates.

#include "firmware/cycle/part_law.hpp"

namespace esmc::part {

template <class M>
void super_twisting(const ControllerConfig<M>& config, const Tracking<M>& t, PartMemory<M>& memory,
                    typename M::Channels& acceleration, typename M::Channels& sliding) {
  using S = typename M::Scalar;
  const M& m = config.mechanism;
  without_switching(config, t, acceleration, sliding);
  Vec2<S> s = sliding.template head<2>(), lost = Vec2<S>::Zero();
  const bool all_went_out = memory.ticks == 0 || memory.whole;
  if (config.law == LawKind::esmc || !all_went_out) {
    const Reduced<M> reduced(m, t.pose);
    const auto of_base = [&](const Vec2<S>& base) { return M::independent(m.base_rates(t.pose, base)); };
    if (config.law == LawKind::esmc) s = of_base(reduced.nearest(sliding));
    if (!all_went_out) lost = of_base(reduced.solve(memory.asked - on_base(m, t.pose, memory.sent[0])));
  }
  const Vec2<S> w = memory.twisting.step(s, lost, config.gains.independent.k, config.sample_time,
                                         {reaching_delay(config), config.lag_ticks});
  acceleration += m.channel_rates(t.pose, m.chain_rates(t.pose, w));
}

}  // namespace esmc::part
