#include "host_sim/studies/ledger.hpp"

#include "host_sim/controller/controller_config.hpp"
#include "host_sim/drives/actuators.hpp"
#include "host_sim/plant/system.hpp"

namespace esmc::host {
namespace {

/// Instructions of one mechanism: of a right-hand side with its share of the projection, and of a tick:
/// controller, sensors, record.
struct MechanismPrice {
  double right_hand_side, tick, open_tick;
};
constexpr MechanismPrice five_bar{622.5, 3600.0, 700.0}, rr{300.0, 2200.0, 450.0};

/// What an effect adds, in instructions per right-hand side, per step of moreau_jean, and per tick.
struct EffectPrice {
  const char* type;
  double right_hand_side, set_valued_step, tick;
};
constexpr EffectPrice effect_prices[] = {
    {ViscousFriction::type, 171, 0, 0},  {CoulombFriction::type, 395, 5464, 0},
    {JointFlexibility::type, 364, 0, 0}, {Backlash::type, 390, 0, 0},
    {EndStops::type, 167, 571, 0},       {Payload::type, 0, 0, 20},
    {ExternalForce::type, 469, 0, 0},    {TorqueLag::type, 320, 0, 0},
    {TorqueRipple::type, 504, 0, 0},     {TorqueSaturation::type, 0, 0, 20},
    {ThermalLimit::type, 0, 0, 150},     {Encoder::type, 0, 0, 400},
    {SensorNoise::type, 0, 0, 400},      {SensorBias::type, 0, 0, 100},
    {SensorDelay::type, 0, 0, 100},      {Jitter::type, 0, 0, 200},
    {ComputeDelay::type, 0, 0, 100}};

/// Right-hand sides of a step. Radau's include its linear algebra and as many as its iterations usually take.
double right_hand_sides(Method m) {
  switch (m) {
    case Method::semi_implicit_euler:
      return 1.0;
    case Method::rk4:
      return 4.0;
    case Method::dopri5:
      return 6.0;
    case Method::dopri8:
      return 12.0;
    case Method::radau5:
      return 40.0;
    case Method::moreau_jean:
      break;
  }
  return 3.0;
}

/// Takes the place of a plant in motion, to count the steps.
struct StepCounter {
  double steps = 0.0;
  void advance(double, double, int n, const MotorTorques<FiveBarPlant::Joints>&) { steps += n; }
};

double steps_of(const Scene& s) {
  const double all = tick_count(s), each = steps_per_tick(s);
  if (!s.closed_loop() || !(find_effect<ComputeDelay>(s.effects) || find_effect<Jitter>(s.effects)))
    return all * each;
  Actuators<FiveBarPlant> actuators(s.effects, s.motor_joints(), s.seed);
  StepCounter counter;
  for (double n = 0.0; n < all; ++n) actuators.advance(counter, n * s.tick(), s.tick(), s.tick() / each, {});
  return counter.steps;
}

}  // namespace

Method method_in_use(const Scene& scene) {
  return set_valued(scene.effects) ? Method::moreau_jean : scene.method;
}

double counted_cost(const Scene& scene) {
  const MechanismPrice& m = scene.type == MechanismType::five_bar ? five_bar : rr;
  const bool jumps = set_valued(scene.effects);
  double slope = m.right_hand_side, step = 0.0, tick = scene.closed_loop() ? m.tick : m.open_tick;
  for (const Effect& e : scene.effects) {
    const auto* dry = std::get_if<CoulombFriction>(&e);
    const auto* stops = std::get_if<EndStops>(&e);
    const bool set = (dry != nullptr && !(dry->regularised > 0.0)) || (stops != nullptr && !stops->stiffness);
    for (const EffectPrice& p : effect_prices) {
      if (p.type != std::string_view(type_name(e))) continue;
      slope += set ? 0.0 : p.right_hand_side;
      step += set ? p.set_valued_step : 0.0;
      if (scene.closed_loop()) tick += p.tick;
    }
  }
  const double stages = right_hand_sides(jumps ? Method::moreau_jean : scene.method);
  return steps_of(scene) * (stages * slope + step) + tick_count(scene) * tick;
}

}  // namespace esmc::host
