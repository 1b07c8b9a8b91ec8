/// What the laws cost in double, beside the same as straight-line code and written by hand.

#include <array>
#include <utility>

#include "tests/benchmarks/hand_written.hpp"
#include "tests/benchmarks/laws.hpp"
#include "tests/benchmarks/straight_line.hpp"

namespace esmc::bench {
namespace {

/// A yardstick, called as the laws are: inlined into the loop, it would have its constants in registers.
template <class Law, class... A>
[[nodiscard, gnu::noinline]] auto called(const Law& law, A&&... a) {
  return law(std::forward<A>(a)...);
}

/// The same from generated code.
template <class Straight>
void straight_five_bar(benchmark::State& state) {
  const auto states = five_bar_states(FiveBar<double>(five_bar<double>));
  const Straight straight(five_bar<double>, gains<FiveBar<double>>());
  int i = 0;
  for (auto _ : state) {
    benchmark::DoNotOptimize(called(straight, states[static_cast<std::size_t>(i++ % state_count)]));
  }
}

std::vector<Tracking<Rr<double>>> rr_states(const Rr<double>& m) {
  std::vector<Tracking<Rr<double>>> states;
  for (int i = 0; i < state_count; ++i) {
    const double a = 0.0981748 * i;
    Tracking<Rr<double>> t;
    t.pose = m.pose({a, 1.0});
    t.desired_pose = m.pose({a + 0.01, 1.01});
    t.rates = {1.0, -0.5};
    t.desired_rates = {1.1, -0.4};
    t.desired_acceleration = {2.0, 3.0};
    states.push_back(t);
  }
  return states;
}
const RrParams<double> arm{leg<double>, 9.8};

void law_rr(benchmark::State& state) {
  const Rr<double> m(arm);
  const auto g = gains<Rr<double>>();
  const auto states = rr_states(m);
  int i = 0;
  for (auto _ : state) {
    benchmark::DoNotOptimize(
        torque_of<LawKind::esmc>(m, g, states[static_cast<std::size_t>(i++ % state_count)]));
  }
}

void straight_rr(benchmark::State& state) {
  const auto states = rr_states(Rr<double>(arm));
  const test::StraightArm straight(arm, gains<Rr<double>>());
  int i = 0;
  for (auto _ : state) {
    benchmark::DoNotOptimize(called(straight, states[static_cast<std::size_t>(i++ % state_count)]));
  }
}

/// The same written out for this arm alone.
void hand_written_rr(benchmark::State& state) {
  const auto states = rr_states(Rr<double>(arm));
  const test::HandWrittenArm by_hand(arm, gains<Rr<double>>());
  std::array<double, 8> sliding{};
  int i = 0;
  for (auto _ : state) {
    benchmark::DoNotOptimize(called(by_hand, states[static_cast<std::size_t>(i++ % state_count)], sliding));
    benchmark::DoNotOptimize(sliding);
  }
}

}  // namespace

void add_laws(bool counted) {
  add_law(counted, "law/five_bar/esmc/double", law_five_bar<LawKind::esmc, double>);
  add_law(counted, "law/five_bar/esmc_projected/double", law_five_bar<LawKind::esmc_projected, double>);
  add_law(counted, "law/rr/esmc/double", law_rr);
  add_law(counted, "law/five_bar/straight_line_esmc/double", straight_five_bar<test::StraightEsmc<double>>);
  add_law(counted, "law/five_bar/straight_line_esmc_projected/double",
          straight_five_bar<test::StraightProjected<double>>);
  add_law(counted, "law/rr/straight_line_esmc/double", straight_rr);
  add_law(counted, "law/rr/hand_written_esmc/double", hand_written_rr);
}

}  // namespace esmc::bench
