/// Work-precision of the integrators: the problems.

#include <cmath>

#include "host_sim/plant/kinematics.hpp"
#include "host_sim/plant/system.hpp"
#include "host_sim/problems/problems.hpp"
#include "host_sim/studies/studies.hpp"

namespace esmc::host {
namespace {

/// `known`: positions at the end, from elsewhere; empty: finely integrated.
template <class S>
void known_problem(const std::string& name, const S& system, const typename S::State& start, double end,
                   const std::vector<double>& known, int fine, int first_steps, long most_steps,
                   double rounding, bool smooth, WorkPrecision& out) {
  Problem<S> p{name, &system, start, end};
  p.rounding = rounding;
  p.smooth = smooth;
  integrate_track(p, fine);
  p.reference = p.track.back();
  for (std::size_t i = 0; i < known.size(); ++i) p.reference[i] = known[i];
  work_precision(p, first_steps, most_steps, out);
}

template <class Plant>
void plant_problem(const std::string& name, const Plant& plant, const typename Plant::State& start,
                   double end, const MotorTorques<typename Plant::Joints>& torque, int fine, int first_steps,
                   long most_steps, WorkPrecision& out, const std::vector<double>& known = {}) {
  BareSystem<Plant> system(plant);
  system.set_torques(torque);
  typename BareSystem<Plant>::State y{};
  BareSystem<Plant>::put(y, start.angle, start.rate);
  known_problem(name, system, y, end, known, fine, first_steps, most_steps, 2e-15, true, out);
}

OpenLoop waves(double amplitude) {
  Waveform a{0.1 * amplitude, {{amplitude, 3.0, 0.3}}}, b{0.0, {{0.5 * amplitude, 4.0, 1.0}}};
  return {{a, b}, {0, 1}};
}

}  // namespace

WorkPrecision integrator_study(double effort, const std::function<void()>& after_run) {
  WorkPrecision out;
  out.after_run = after_run;
  const auto budget = static_cast<long>(20000 * effort);
  const RrPlant arm(RrParams<double>{{0.3, 0.25, 0.1, 0.1, 1.0, 0.8, 0.01, 0.008}, 9.8});
  plant_problem("rr free, 2 s", arm, RrPlant::from_joints({-1.2, -0.2}, {0, 0}), 2.0, {}, 200, 40, budget,
                out);
  OpenLoop wave = waves(0.2);
  plant_problem("rr driven, 2 s", arm, RrPlant::from_joints({-1.2, -0.2}, {0, 0}), 2.0, {{}, &wave}, 200, 40,
                budget, out);

  const LegParams<double> long_leg{0.25, 0.35, 0.12, 0.17, 0.40, 0.30, 2.5e-3, 3.2e-3};
  const FiveBarParams<double> large{0.125, 0.25, 9.81, {{long_leg, long_leg}}};
  const FiveBarPlant five_bar(large);
  const double degree = std::acos(-1.0) / 180.0;
  const auto hanging = close(large, {-80.0 * degree, -90.0 * degree}, -1);
  const auto start = FiveBarPlant::from_joints(*hanging, {0, 0, 0, 0});
  plant_problem("5r free, 2 s", five_bar, start, 2.0, {}, 200, 40, budget, out);
  wave = waves(0.05);
  wave.joint = {0, 2};
  plant_problem("5r driven, 2 s", five_bar, start, 2.0, {{}, &wave}, 200, 40, budget, out);

  // B4: a five-bar falls from rest through type 1 and type 2; the reference was computed in quadruple
  // precision.
  const LegParams<double> leg{0.12, 0.16, 0.06, 0.068, 0.1, 0.1, 2e-4, 7e-4};
  const FiveBarPlant falling(FiveBarParams<double>{0.05, 0.0, 9.8, {{leg, leg}}});
  const auto golden = FiveBarPlant::from_joints(
      {-2.22637410112360593504, 3.73679171077824686325, 0.18873371917602579560, 2.68678616236967082441},
      {0, 0, 0, 0});
  plant_problem("B4 5r-fall, 0.25 s", falling,
                FiveBarPlant::from_joints({0.33914579427821183820, 1.85318013531281830819,
                                           1.31276054418215195822, 1.48475269532538599760},
                                          {0, 0, 0, 0}),
                0.25, {}, 64, 32, budget, out, {golden.angle.begin(), golden.angle.end()});
  // B1 to B3: references of the literature, recomputed in quadruple precision. Of B2 only the position of B0
  // is known: the angle of its rod.
  known_problem("B1 Andrews, 0.03 s", Andrews(), Andrews().start(), 0.03,
                {15.81077119515370709711938, -15.75637105841183946972777, 0.04082224011964580485828232,
                 0.5244099658799540693716556, -0.5347301163420795937701850, 1.048080741041937873068515,
                 0.5347301163420795937701850},
                200, 160, budget, 1e-14, true, out);
  known_problem("B2 two four-bars, 20 s", TwoFourBars(), TwoFourBars().start(), 20.0, {}, 1000, 400, budget,
                2e-13, false, out);
  known_problem("B3 pendulum, 10 s", Pendulum(), Pendulum().start(), 10.0,
                {-0.275087462576116860054391, -0.961419205099125064265135}, 400, 80, budget, 1e-14, true,
                out);
  return out;
}

}  // namespace esmc::host
