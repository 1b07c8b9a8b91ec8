/// usage: rhs_cost STEPS [SCENE EFFECT]. Moves a mechanism, for callgrind to count the instructions. Built
/// twice: with the whole library and its effects (Motion), and without the files of the effects. EFFECT: the
/// inside of its TOML table.

#include <cstdio>
#include <cstdlib>

#ifdef WITHOUT_EFFECTS
#include "host_sim/plant/engine.hpp"
#else
#include "host_sim/plant/motion.hpp"
#include "host_sim/scene/scene.hpp"
#endif

#ifdef WITHOUT_EFFECTS
/// Behind a call, as in Motion: a compiler that saw which engine it is would build another loop around the
/// steps.
[[gnu::noinline]] std::unique_ptr<esmc::host::Engine<esmc::host::FiveBarPlant>> bare_engine(
    const esmc::host::FiveBarPlant& plant, const esmc::host::FiveBarPlant::State& start) {
  using namespace esmc::host;
  using Bare = BareSystem<FiveBarPlant>;
  return std::make_unique<EngineOf<FiveBarPlant, Bare, Rk4<Bare>>>(
      plant, std::make_unique<Attachments>(), Method::rk4, start, [](const Bare& s) { return Rk4<Bare>(s); });
}
#endif

int main(int argc, char** argv) {
  const int steps = argc > 1 ? std::atoi(argv[1]) : 1000;
  using namespace esmc;
  using namespace esmc::host;
  const LegParams<double> leg{0.12, 0.16, 0.06, 0.068, 0.1, 0.1, 2e-4, 7e-4};
  const FiveBarPlant plant(FiveBarParams<double>{0.05, 0.0, 9.8, {{leg, leg}}});
  auto start = FiveBarPlant::from_joints(
      {0.33914579427821183820, 1.85318013531281830819, 1.31276054418215195822, 1.48475269532538599760},
      {0, 0, 0, 0});
  const MotorTorques<FiveBarPlant::Joints> torque{{0.05, 0.0, 0.03, 0.0}, nullptr};
#ifdef WITHOUT_EFFECTS
  plant.project(start.angle, start.rate);  // as Motion does
  const auto engine = bare_engine(plant, start);
  engine->run(0.0, steps * 1e-4 / steps, steps, torque);
  FiveBarPlant::Angles y, rate;
  engine->get(y, rate);
  std::printf("%a %a %a %a\n", y[0], y[1], y[2], y[3]);
#else
  std::vector<Effect> effects;
  if (argc > 3) effects = read_scene(argv[2], {"effects=[{" + std::string(argv[3]) + "}]"}).effects;
  Motion<FiveBarPlant> motion({plant, plant, effects, {0, 2}, Method::rk4}, start);
  motion.advance(0.0, steps * 1e-4, steps, torque);
  const auto& y = motion.state().angle;
  std::printf("%a %a %a %a\n", y[0], y[1], y[2], y[3]);
#endif
}
