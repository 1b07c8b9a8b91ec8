#include "host_sim/studies/ledger.hpp"

#include <algorithm>
#include <iterator>
#include <string_view>

#include "host_sim/controller/controller_config.hpp"
#include "host_sim/drives/actuators.hpp"
#include "host_sim/plant/system.hpp"

namespace esmc::host {
namespace {

/// A step of a method: right-hand sides, of which an effect pays its share in each, and instructions without
/// effects, for a five-bar and an arm.
struct StepPrice {
  Method method;
  double right_hand_sides, five_bar, rr;
};
/// A method that is not listed costs what the first does. Radau's are those of a motion that it solves in its
/// usual number of iterations.
constexpr StepPrice step_prices[] = {
    {Method::rk4, 4, 2490, 1262},       {Method::semi_implicit_euler, 1, 1412, 294},
    {Method::dopri5, 6, 3776, 2148},    {Method::dopri8, 12, 7744, 4461},
    {Method::radau5, 60, 64277, 20942}, {Method::moreau_jean, 3, 1951, 1143}};
constexpr double five_bar_tick = 4936, rr_tick = 3180, five_bar_open_tick = 3092, rr_open_tick = 2000;

/// What an effect adds, in instructions per right-hand side, per step where it is set-valued, and per tick.
struct EffectPrice {
  const char* type;
  double right_hand_side, set_valued_step, tick;
};
constexpr EffectPrice effect_prices[] = {
    {ViscousFriction::type, 171, 0, 0},  {CoulombFriction::type, 395, 5379, 0},
    {JointFlexibility::type, 364, 0, 0}, {Backlash::type, 390, 0, 0},
    {EndStops::type, 167, 486, 0},       {ExternalForce::type, 469, 0, 0},
    {TorqueLag::type, 321, 0, 0},        {TorqueRipple::type, 504, 0, 0},
    {Payload::type, 0, 0, 105},          {TorqueSaturation::type, 0, 0, 11},
    {ThermalLimit::type, 0, 0, 130},     {Encoder::type, 0, 0, 1262},
    {SensorNoise::type, 0, 0, 3649},     {SensorBias::type, 0, 0, 41},
    {SensorDelay::type, 0, 0, 97},       {Jitter::type, 0, 0, 380},
    {ComputeDelay::type, 0, 0, 242}};

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
  return set_valued(scene.effects) && scene.method != Method::event_driven ? Method::moreau_jean
                                                                           : scene.method;
}

double counted_cost(const Scene& scene) {
  const bool five_bar = scene.type == MechanismType::five_bar;
  const auto* listed = std::ranges::find(step_prices, method_in_use(scene), &StepPrice::method);
  const StepPrice& method = listed == std::end(step_prices) ? step_prices[0] : *listed;
  double step = five_bar ? method.five_bar : method.rr;
  double tick = scene.closed_loop() ? (five_bar ? five_bar_tick : rr_tick)
                                    : (five_bar ? five_bar_open_tick : rr_open_tick);
  for (const Effect& e : scene.effects) {
    const bool jumps = set_valued({e});
    for (const EffectPrice& p : effect_prices) {
      if (p.type != std::string_view(type_name(e))) continue;
      step += jumps ? p.set_valued_step : method.right_hand_sides * p.right_hand_side;
      if (scene.closed_loop()) tick += p.tick;
    }
  }
  return steps_of(scene) * step + tick_count(scene) * tick;
}

}  // namespace esmc::host
