#pragma once
/// Gains from the command interface.

#include "firmware/control/law.hpp"
#include "firmware/link/parameters.hpp"

namespace esmc {

/// Sets lambda and K, for angles or positions, of each channel and of the independent coordinates. With the
/// implicit reaching law K > 0 also sets the layer: implicit_layer of K, sample_time (s) and delay_ticks.
template <class M>
void set_gains(Gains<M>& g, const link::Parameters& p, Reaching reaching, typename M::Scalar sample_time,
               typename M::Scalar delay_ticks) {
  using S = typename M::Scalar;
  const auto apply = [&](bool angle, S& lambda, S& k, S& layer) {
    lambda = S(p[angle ? link::Index::lambda_angle : link::Index::lambda_position]);
    k = S(p[angle ? link::Index::gain_angle : link::Index::gain_position]);
    if (reaching == Reaching::implicit && k > S(0)) layer = implicit_layer(k, sample_time, delay_ticks);
  };
  for (int i = 0; i < M::channels; ++i) apply(M::is_angle(i), g.lambda[i], g.k[i], g.layer[i]);
  apply(!M::has_type2, g.independent.lambda, g.independent.k, g.independent.layer);
}

}  // namespace esmc
