#pragma once
/// The machine of the benchmarks and its gains.

#include "firmware/cycle/instances.hpp"

namespace esmc::bench {

template <class S>
inline constexpr LegParams<S> leg{S(0.12), S(0.16), S(0.06), S(0.068), S(0.1), S(0.1), S(2e-4), S(7e-4)};
template <class S>
inline constexpr FiveBarParams<S> five_bar{S(0.05), S(0), S(9.8), {leg<S>, leg<S>}};

template <class M>
Gains<M> gains() {
  using S = typename M::Scalar;
  Gains<M> g;
  g.lambda.setConstant(S(40));
  g.k.setConstant(S(150));
  g.layer.setConstant(S(0.15));
  g.independent = {S(40), S(150), S(0.15), S(1600), S(80)};
  return g;
}

}  // namespace esmc::bench
