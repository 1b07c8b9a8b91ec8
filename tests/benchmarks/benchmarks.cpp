/// What the pieces cost. Figures of a shared machine: read ratios within one run, not nanoseconds.

#include <benchmark/benchmark.h>

#include <array>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "firmware/cycle/instances.hpp"
#include "hal/virtual/virtual_bus.hpp"
#include "host_sim/plant/kinematics.hpp"
#include "host_sim/plant/motion.hpp"
#include "tests/benchmarks/hand_written.hpp"
#include "tests/benchmarks/straight_line.hpp"

namespace esmc {
namespace {

template <class S>
constexpr LegParams<S> leg{S(0.12), S(0.16), S(0.06), S(0.068), S(0.1), S(0.1), S(2e-4), S(7e-4)};
template <class S>
constexpr FiveBarParams<S> five_bar{S(0.05), S(0), S(9.8), {leg<S>, leg<S>}};
constexpr int state_count = 64;

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

/// As the controller's tick has it. The sliding variables are for a log.
template <LawKind Law, class M>
[[nodiscard, gnu::noinline]] Vec2<typename M::Scalar> torque_of(const M& m, const Gains<M>& g, const Tracking<M>& t) {
  typename M::Channels acceleration, sliding;
  demand<M, Rows::with_mass>(Law, m, g, Reaching::implicit, t, acceleration, sliding);
  benchmark::DoNotOptimize(sliding);
  return m.base_torque(t.pose, m.force(acceleration, t.rates));
}

/// A yardstick, called as the laws are: inlined into the loop, it would have its constants in registers.
template <class Law, class... A>
[[nodiscard, gnu::noinline]] auto called(const Law& law, A&&... a) {
  return law(std::forward<A>(a)...);
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
    benchmark::DoNotOptimize(torque_of<LawKind::esmc>(m, g, states[static_cast<std::size_t>(i++ % state_count)]));
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

/// One whole control tick: two encoder frames in, supervisor, closure, law, limits, two torque frames out.
template <LawKind Law, class S>
void tick_five_bar(benchmark::State& state) {
  using M = FiveBar<S>;
  typename OdriveCycle<M>::Config c;
  c.controller.mechanism = M(five_bar<S>);
  c.controller.mode = {{{1, 1}}, -1};
  c.controller.law = Law;
  c.controller.gains = gains<M>();
  c.controller.reference.kind = ReferenceKind::circle;
  c.controller.reference.centre = {S(0), S(0.17)};
  c.controller.reference.amplitude = {S(0.07), S(0.07)};
  c.controller.limits.min_abs_sin_type1 = S(0.02);
  c.controller.limits.min_abs_sin_type2 = S(0.05);
  c.controller.limits.joint_speed = S(50);
  c.controller.limits.closure = S(1);
  c.controller.torque_limit.setConstant(S(2));
  c.controller.sample_time = S(1e-3);
  c.heartbeat_age_ticks_max = 0xFFFF'FFFF;
  for (std::uint8_t i = 0; i < 2; ++i) {
    c.axes[i] =
        drive::OdriveAxis({static_cast<std::uint8_t>(i + 1), 1, 1, 0}, drive::odrive::Version::v0_6, 150);
  }
  OdriveCycle<M> cycle(c);
  const auto bus = std::make_unique<hal::VirtualBus<2>>();
  auto &control = bus->port(0), &drives = bus->port(1);
  const auto q = host::reach(five_bar<double>, {0.07, 0.17}, {1, 1});
  const auto rev = [&](std::size_t joint) { return static_cast<float>((*q)[joint] / 6.283185307179586); };
  const std::array<hal::CanFrame, 2> encoder{drive::odrive::encode_encoder_estimates(1, rev(0), 0),
                                             drive::odrive::encode_encoder_estimates(2, rev(2), 0)};
  hal::CanFrame sink;
  cycle.command(Command::enable);
  const auto publish = [&](bool heartbeat) {
    for (std::uint8_t i = 0; i < 2; ++i) {
      if (heartbeat) {
        (void)drives.try_send(drive::odrive::encode_heartbeat(static_cast<std::uint8_t>(i + 1), 0,
                                                              drive::odrive::AxisState::closed_loop_control));
      }
      (void)drives.try_send(encoder[i]);
    }
  };
  const auto tick = [&] {
    cycle.receive(control);
    return cycle.tick(control);
  };
  for (int i = 0; i < 5; ++i) {
    publish(true);
    (void)tick();
    while (drives.try_receive(sink)) {
    }
  }
  if (!cycle.supervisor().running()) {
    state.SkipWithError("the cycle does not run");
    return;
  }
  for (auto _ : state) {
    publish(false);
    benchmark::DoNotOptimize(tick());
    while (drives.try_receive(sink)) {
    }
  }
}

host::FiveBarPlant::State plant_start() {
  const auto q = host::reach(five_bar<double>, {0.07, 0.17}, {1, 1});
  return host::FiveBarPlant::from_joints(*q, {0.5, -0.2, 0.1, 0.3});
}

void plant_kkt(benchmark::State& state) {
  const host::FiveBarPlant plant(five_bar<double>);
  auto s = plant_start();
  plant.project(s.angle, s.rate);
  for (auto _ : state) {
    benchmark::DoNotOptimize(s);
    benchmark::DoNotOptimize(plant.acceleration(s.angle, s.rate, {0.1, 0.0, -0.1, 0.0}));
  }
}

/// The same accelerations from generated code in minimal coordinates: a yardstick, which type 2 breaks.
void plant_straight_line(benchmark::State& state) {
  const test::StraightLine straight(five_bar<double>);
  const auto s = plant_start();
  auto theta = host::FiveBarPlant::joint_angles(s.angle);
  const auto rate = host::FiveBarPlant::joint_rates(s.rate);
  for (auto _ : state) {
    benchmark::DoNotOptimize(theta);
    benchmark::DoNotOptimize(straight(theta, {rate[0], rate[2]}, {0.1, 0.0, -0.1, 0.0}));
  }
}

void plant_step(benchmark::State& state) {
  const host::FiveBarPlant plant(five_bar<double>);
  host::Motion<host::FiveBarPlant> motion({plant, plant, {}, {0, 2}, host::Method::rk4}, plant_start());
  for (auto _ : state) {
    motion.advance(0.0, 1e-4, 1, {{0.05, 0.0, 0.05, 0.0}, nullptr});
    benchmark::DoNotOptimize(motion.state());
  }
}

template <LawKind Law>
void add_ticks(const std::string& law) {
  benchmark::RegisterBenchmark(("tick/five_bar/" + law + "/double").c_str(), tick_five_bar<Law, double>);
  benchmark::RegisterBenchmark(("tick/five_bar/" + law + "/float").c_str(), tick_five_bar<Law, float>);
}

}  // namespace
}  // namespace esmc

int main(int argc, char** argv) {
  using namespace esmc;
  benchmark::RegisterBenchmark("law/five_bar/esmc/double", law_five_bar<LawKind::esmc, double>);
  benchmark::RegisterBenchmark("law/five_bar/esmc/float", law_five_bar<LawKind::esmc, float>);
  benchmark::RegisterBenchmark("law/five_bar/esmc_projected/double",
                               law_five_bar<LawKind::esmc_projected, double>);
  benchmark::RegisterBenchmark("law/five_bar/esmc_projected/float",
                               law_five_bar<LawKind::esmc_projected, float>);
  benchmark::RegisterBenchmark("law/rr/esmc/double", law_rr);
  benchmark::RegisterBenchmark("law/five_bar/straight_line_esmc/double", straight_five_bar<test::StraightEsmc>);
  benchmark::RegisterBenchmark("law/five_bar/straight_line_esmc_projected/double", straight_five_bar<test::StraightProjected>);
  benchmark::RegisterBenchmark("law/rr/straight_line_esmc/double", straight_rr);
  benchmark::RegisterBenchmark("law/rr/hand_written_esmc/double", hand_written_rr);
  add_ticks<LawKind::esmc>("esmc");
  add_ticks<LawKind::esmc_projected>("esmc_projected");
  add_ticks<LawKind::smc>("smc");
  add_ticks<LawKind::ctc>("ctc");
  add_ticks<LawKind::pd>("pd");
  benchmark::RegisterBenchmark("plant/five_bar/kkt/double", plant_kkt);
  benchmark::RegisterBenchmark("plant/five_bar/straight_line/double", plant_straight_line);
  benchmark::RegisterBenchmark("plant/five_bar/step_rk4/double", plant_step);
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 2;
  benchmark::RunSpecifiedBenchmarks();
  benchmark::Shutdown();
  return 0;
}
