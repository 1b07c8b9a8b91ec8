/// What the pieces cost. Figures of a shared machine: read ratios within one run, not nanoseconds.

#include <benchmark/benchmark.h>

#include <array>
#include <memory>
#include <string>

#include "hal/virtual/virtual_bus.hpp"
#include "host_sim/plant/kinematics.hpp"
#include "host_sim/plant/motion.hpp"
#include "tests/benchmarks/laws.hpp"
#include "tests/benchmarks/setting.hpp"
#include "tests/benchmarks/straight_line.hpp"

namespace esmc {
namespace {

using bench::five_bar;
using bench::gains;

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
  const bool counted = argc > 1 && std::string(argv[1]) == "--counted";
  if (counted) {
    --argc;
    ++argv;
  }
  bench::add_laws(counted);
  bench::add_laws_in_float(counted);
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
