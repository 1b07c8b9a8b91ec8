#pragma once
/// A law of the five-bar in a loop. One scalar per file, as in the firmware's archive: what else a file holds
/// decides what is inlined.

#include <benchmark/benchmark.h>

#include <vector>

#include "firmware/control/fused_law.hpp"
#include "tests/benchmarks/setting.hpp"

namespace esmc::bench {

inline constexpr int state_count = 64;

/// States around the comparison circle, a little off the reference.
template <class S>
std::vector<Tracking<FiveBar<S>>> five_bar_states(const FiveBar<S>& m) {
  std::vector<Tracking<FiveBar<S>>> out;
  const typename FiveBar<S>::Mode mode{{{1, 1}}, -1};
  for (int i = 0; i < state_count; ++i) {
    const S a = S(0.0981748F) * S(i), r = S(0.07F), w = S(10);
    const SinCos<S> t = sin_cos(a), u = sin_cos(a + S(0.01F));
    Tracking<FiveBar<S>> k;
    const auto d = desired_at_effector<FiveBar<S>>(m, mode, {r * t.cos, S(0.17F) + r * t.sin},
                                                   {-r * w * t.sin, r * w * t.cos},
                                                   {-r * w * w * t.cos, -r * w * w * t.sin});
    const auto p = desired_at_effector<FiveBar<S>>(m, mode, {r * u.cos, S(0.17F) + r * u.sin},
                                                   {-r * w * u.sin, r * w * u.cos}, {S(0), S(0)});
    k.pose = p->pose;
    k.rates = p->rates;
    k.desired_pose = d->pose;
    k.desired_rates = d->rates;
    k.desired_acceleration = d->acceleration;
    out.push_back(k);
  }
  return out;
}

/// As the controller's tick has it. The sliding variables are for a log.
template <LawKind Law, class M>
[[nodiscard, gnu::noinline]] Vec2<typename M::Scalar> torque_of(const M& m, const Gains<M>& g,
                                                                const Tracking<M>& t) {
  typename M::Channels acceleration, sliding;
  fused_acceleration(Law, m, g, Reaching::implicit, t, acceleration, sliding);
  benchmark::DoNotOptimize(sliding);
  return m.base_torque(t.pose, m.force(acceleration, t.rates));
}

/// State and reference, as poses and rates, to base-joint torque.
template <LawKind Law, class S>
void law_five_bar(benchmark::State& state) {
  const FiveBar<S> m(five_bar<S>);
  const auto states = five_bar_states(m);
  const auto g = gains<FiveBar<S>>();
  int i = 0;
  for (auto _ : state) {
    benchmark::DoNotOptimize(torque_of<Law>(m, g, states[static_cast<std::size_t>(i++ % state_count)]));
  }
}

/// `counted`: for counting instructions, each state once, however slow the machine is; their number depends
/// on the state.
inline void add_law(bool counted, const char* name, void (*law)(benchmark::State&)) {
  auto* const registered = benchmark::RegisterBenchmark(name, law);
  if (counted) registered->Iterations(state_count);
}
/// What the laws cost, and their yardsticks.
void add_laws(bool counted);
void add_laws_in_float(bool counted);

}  // namespace esmc::bench
