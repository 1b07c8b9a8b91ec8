/// Every effect on a plant whose answer is known in closed form: two bars without coupling, so that joint 1
/// is a single inertia under its own torque.

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "host_sim/drives/actuators.hpp"
#include "host_sim/effects/shaft_sensor.hpp"
#include "host_sim/plant/motion.hpp"

namespace esmc::host {
namespace {

constexpr double inertia = 1e-3;  // kg m2, of bar 1
constexpr double pi = std::numbers::pi;

RrParams<double> two_wheels(double gravity = 0.0) { return {{0.1, 0.1, 0, 0, 0, 0, inertia, 2e-3}, gravity}; }

Motion<RrPlant> wheels(const std::vector<Effect>& effects, double angle, double rate,
                       Method method = Method::rk4) {
  const RrPlant plant(two_wheels());
  return {{plant, plant, effects, {0}, method}, RrPlant::from_joints({angle, 1.0}, {rate, -rate})};
}
double angle(const Motion<RrPlant>& m) { return m.state().angle[0]; }
double rate(const Motion<RrPlant>& m) { return m.state().rate[0]; }
MotorTorques<RrPlant::Joints> torque(double tau) { return {{tau, 0.0}, nullptr}; }

TEST(Effects, ViscousFrictionDecaysExponentially) {
  auto m = wheels({ViscousFriction{{0.01, 0.0}}}, 0.0, 10.0);
  m.advance(0.0, 0.2, 2000, torque(0.0));
  EXPECT_NEAR(rate(m), 10.0 * std::exp(-2.0), 1e-12);
  EXPECT_NEAR(angle(m), 10.0 * 0.1 * (1.0 - std::exp(-2.0)), 1e-12);
}

TEST(Effects, CoulombFrictionStopsWhereItShouldAndStays) {  // B6
  for (const double step : {1e-4, 3.7e-4, 1e-3}) {
    auto m = wheels({CoulombFriction{{0.05, 0.0}}}, 0.0, 10.0);
    EXPECT_EQ(m.method(), Method::moreau_jean);
    m.advance(0.0, 0.19, static_cast<int>(std::ceil(0.19 / step)), torque(0.0));
    EXPECT_NEAR(rate(m), 0.5, 1e-11);
    m.advance(0.19, 0.11, static_cast<int>(std::ceil(0.11 / step)), torque(0.0));
    EXPECT_EQ(rate(m), 0.0) << "step " << step;
    EXPECT_NEAR(angle(m), 1.0, 50.0 * step * step / 8.0 + 1e-12) << "step " << step;
    EXPECT_LT(m.energy_error(), 1e-9);
  }
}

TEST(Effects, AHeldJointDoesNotMoveAtAllInAnHour) {
  auto m = wheels({CoulombFriction{{0.05, 0.1}}}, 0.3, 0.0);
  for (int s = 0; s < 3600; ++s) m.advance(s, 1.0, 1000, torque(0.04));
  EXPECT_EQ(angle(m), 0.3);
  EXPECT_EQ(rate(m), 0.0);
  m.advance(3600, 0.1, 1000, torque(0.0501));
  EXPECT_NEAR(rate(m), 1e-4 / (inertia + 2e-3) * 0.1, 1e-12) << "just above breakaway it must slip";
}

TEST(Effects, TheCheapFrictionCreeps) {
  auto m = wheels({CoulombFriction{{0.05, 0.0}, 0.01}}, 0.0, 0.0);
  for (int s = 0; s < 60; ++s) m.advance(s, 1.0, 4000, torque(0.04));
  EXPECT_NEAR(angle(m), 60.0 * 0.01 * std::atanh(0.8), 1e-4);
}

TEST(Effects, FiveBarStuckByTwoJointsRests) {
  const FiveBarParams<double> p{
      0.05,
      0.1,
      9.8,
      {{{0.12, 0.16, 0.06, 0.068, 0.1, 0.1, 2e-4, 7e-4}, {0.12, 0.16, 0.06, 0.068, 0.1, 0.1, 2e-4, 7e-4}}}};
  const FiveBarPlant plant(p);
  const FiveBarPlant::State start = FiveBarPlant::from_joints(
      {0.33914579427821183820, 1.85318013531281830819, 1.31276054418215195822, 1.48475269532538599760},
      {0, 0, 0, 0});
  Motion<FiveBarPlant> m({plant, plant, {CoulombFriction{{1.0, 0.2, 1.0, 0.2}}}, {0, 2}, Method::rk4}, start);
  const auto before = m.state().angle;
  m.advance(0.0, 10.0, 10000, {});
  EXPECT_EQ(m.state().angle, before);
  EXPECT_EQ(m.state().rate, (FiveBarPlant::Angles{}));
}

TEST(Effects, TorqueLag) {
  const double tau = 0.02, lag = 0.01, t = 0.05;
  auto m = wheels({TorqueLag{lag}}, 0.0, 0.0);
  m.advance(0.0, t, 1000, torque(tau));
  EXPECT_NEAR(rate(m), tau / inertia * (t - lag * (1.0 - std::exp(-t / lag))), 1e-10);
  EXPECT_EQ(m.state_dimension(), 5);
}

TEST(Effects, FlexibleJointSwingsAtItsFrequencyAndKeepsMomentum) {
  const double rotor = 5e-4, stiffness = 40.0, t = 0.037;
  // A torque on the rotor for a while, then free: all impulse is momentum, and the twist swings.
  auto f = wheels({JointFlexibility{{stiffness, 1.0}, {0, 0}, {rotor, 1e-4}}}, 0.0, 0.0);
  f.advance(0.0, t, 4000, torque(0.1));
  EXPECT_NEAR(inertia * rate(f) + rotor * f.shaft(0).rate, 0.1 * t, 1e-12);
  EXPECT_EQ(f.state_dimension(), 6);
  const double w = std::sqrt(stiffness * (1.0 / rotor + 1.0 / inertia)), equilibrium = 0.1 / rotor / (w * w);
  EXPECT_NEAR(f.shaft(0).angle - angle(f), equilibrium * (1.0 - std::cos(w * t)), 1e-9);
}

TEST(Effects, BacklashPassesNothingInsideTheGap) {
  const double gap = 0.02, rotor = 1e-4, tau = 0.01;
  const double contact = std::sqrt(gap * rotor / tau);  // gap / 2 = tau t^2 / (2 rotor)
  auto m = wheels({Backlash{gap, 1000.0, 0.1, rotor}}, 0.0, 0.0);
  m.advance(0.0, 0.999 * contact, 1000, torque(tau));
  EXPECT_EQ(angle(m), 0.0);
  m.advance(0.999 * contact, 0.02, 20000, torque(tau));
  EXPECT_GT(angle(m), 1e-4);
  EXPECT_NEAR(inertia * rate(m) + rotor * m.shaft(0).rate, tau * (0.999 * contact + 0.02), 1e-9);
}

TEST(Effects, RigidStopReboundsWithItsRestitution) {
  auto m = wheels({EndStops{{-1, -9}, {0.5, 9}, {}, 0.6}}, 0.0, 5.0);
  m.advance(0.0, 0.15, 1500, torque(0.0));
  EXPECT_NEAR(rate(m), -3.0, 1e-12);
  EXPECT_NEAR(angle(m), 0.5 - 3.0 * 0.05, 5.0 * 1e-4);
  m.advance(0.15, 3.0, 30000, torque(-0.01));  // pressed into the other stop it comes to rest there
  EXPECT_NEAR(angle(m), -1.0, 1e-3);
  EXPECT_NEAR(rate(m), 0.0, 2e-3);
}

TEST(Effects, SoftStopReboundsWithItsRestitution) {
  const double stiffness = 500.0, e = 0.6;
  auto m = wheels({EndStops{{-1, -9}, {0.5, 9}, stiffness, e}}, 0.0, 5.0);
  EXPECT_EQ(m.method(), Method::rk4);
  m.advance(0.0, 0.15, 150000, torque(0.0));
  EXPECT_NEAR(rate(m), -5.0 * e, 2e-3);
  const double quarter = 0.5 * pi * std::sqrt(inertia / stiffness), contact = quarter * (1.0 + 1.0 / e);
  EXPECT_NEAR(angle(m), 0.5 - 5.0 * e * (0.15 - 0.1 - contact), 1e-3);
}

TEST(Effects, PayloadComesAndGoesMovingWithTheEffector) {
  const RrParams<double> p{{0.3, 0.25, 0.1, 0.1, 1.0, 0.8, 0.01, 0.008}, 9.8};
  const RrPlant bare(p), loaded(p, 0.5);
  const auto start = RrPlant::from_joints({0.3, 0.9}, {1.0, -0.5});
  Motion<RrPlant> m({bare, loaded, {Payload{0.5, 0.0503, 0.1007}}, {0, 1}, Method::rk4}, start);
  m.advance(0.0, 0.15, 150, {});
  // The same by hand, switched at the very instants.
  Motion<RrPlant> first({bare, bare, {}, {0, 1}, Method::rk4}, start);
  first.advance(0.0, 0.0503, 500, {});
  Motion<RrPlant> second({loaded, loaded, {}, {0, 1}, Method::rk4}, first.state());
  second.advance(0.0, 0.0504, 500, {});
  Motion<RrPlant> third({bare, bare, {}, {0, 1}, Method::rk4}, second.state());
  third.advance(0.0, 0.0493, 500, {});
  for (std::size_t i = 0; i < 2; ++i) EXPECT_NEAR(m.state().angle[i], third.state().angle[i], 1e-9);
  EXPECT_LT(m.energy_error(), 1e-9) << "what the load brings and takes is accounted for";
}

TEST(Effects, PulseIsAnImpulseAndTheHandASpring) {
  const RrParams<double> p{{0.3, 0.25, 0.1, 0.1, 1.0, 0.8, 0.01, 0.008}, 0.0};
  const RrPlant plant(p);
  const auto start = RrPlant::from_joints({0.3, 0.9}, {0.0, 0.0});
  ExternalForce pulse;
  pulse.force = {2.0, -1.0};
  pulse.to = 1e-4;
  Motion<RrPlant> m({plant, plant, {pulse}, {0, 1}, Method::rk4}, start);
  m.advance(0.0, 1e-3, 1, {});
  // Short against any motion: M qd = J^T F dt, so F dt . v / 2 is the kinetic energy.
  const V2 v = m.output().effector_rate;
  EXPECT_NEAR(0.5 * 1e-4 * (2.0 * v.x - v.y), m.energy(), 1e-5 * m.energy());

  ExternalForce hand;
  hand.human = true;
  hand.anchor = {0.1, 0.4};
  hand.stiffness = 50.0;
  hand.to = 100.0;
  Motion<RrPlant> h({plant, plant, {hand}, {0, 1}, Method::rk4}, start);
  const auto stored = [&] {
    const V2 d = h.output().effector - V2{0.1, 0.4};
    return 25.0 * dot(d, d) + h.energy();
  };
  const double before = stored();
  h.advance(0.0, 1.0, 4000, {});
  EXPECT_NEAR(stored(), before, 1e-9 * before);
}

TEST(Effects, RippleIsAPotential) {
  const double amplitude = 0.01, n = 14.0;
  auto m = wheels({TorqueRipple{amplitude, n}}, 0.0, 2.0);
  const auto energy = [&] {
    return 0.5 * inertia * rate(m) * rate(m) + amplitude / n * std::cos(n * angle(m));
  };
  const double before = energy();
  m.advance(0.0, 0.7, 7000, torque(0.0));
  EXPECT_NEAR(energy(), before, 1e-10);
  EXPECT_GT(std::abs(rate(m) - 2.0), 1e-3);
}

TEST(Effects, ThermalLimitTripsWhenTheHeatSaysSo) {
  const double time_constant = 2.0, tick = 1e-3, ratio = 3.0;
  TorqueStage stage({ThermalLimit{0.5, time_constant}});
  const double trips = -time_constant * std::log(1.0 - 1.0 / (ratio * ratio));
  bool clipped = false;
  int ticks = 0;
  while (ticks < 10000 && stage(0.5 * ratio, tick, clipped) > 0.5) ++ticks;
  EXPECT_NEAR(ticks * tick, trips, 2.0 * tick);
  EXPECT_TRUE(clipped);
  clipped = false;
  EXPECT_EQ(stage(-0.1, tick, clipped), -0.1);
  EXPECT_FALSE(clipped);
}

TEST(Effects, SaturationClampsAndSays) {
  TorqueStage stage({TorqueSaturation{0.5}});
  bool clipped = false;
  EXPECT_EQ(stage(0.4, 1e-3, clipped), 0.4);
  EXPECT_FALSE(clipped);
  EXPECT_EQ(stage(-0.7, 1e-3, clipped), -0.5);
  EXPECT_TRUE(clipped);
}

double speed_after(const std::vector<Effect>& effects, int ticks, std::uint64_t seed) {
  auto m = wheels({}, 0.0, 0.0);
  Actuators<RrPlant> a(effects, {0, 1}, seed);
  bool clipped = false;
  for (int n = 0; n < ticks; ++n) a.advance(m, n * 1e-3, 1e-3, 5e-4, a.deliver({0.02, 0.0}, 1e-3, clipped));
  return rate(m);
}

TEST(Effects, ComputeDelayHoldsTheTorqueBack) {
  for (const double delay : {2.5e-4, 1e-3, 2.7e-3}) {
    EXPECT_NEAR(speed_after({ComputeDelay{delay}}, 20, 1), 0.02 / inertia * (0.02 - delay), 1e-12) << delay;
  }
}

TEST(Effects, JitterIsLateByItsMeanMagnitudeAndRepeats) {
  // Only the first torque's lateness shows in the speed: the torque is the same ever after.
  const double sigma = 1e-4;
  double sum = 0.0;
  constexpr int runs = 4000;
  for (std::uint64_t seed = 1; seed <= runs; ++seed)
    sum += 0.003 - speed_after({Jitter{sigma}}, 3, seed) * inertia / 0.02;
  EXPECT_NEAR(sum / runs, sigma * std::sqrt(2.0 / pi), 4.0 * sigma / std::sqrt(runs));
  EXPECT_EQ(speed_after({Jitter{sigma}}, 3, 7), speed_after({Jitter{sigma}}, 3, 7));
  EXPECT_NE(speed_after({Jitter{sigma}}, 3, 7), speed_after({Jitter{sigma}}, 3, 8));
}

ShaftSensor sensor(const std::vector<Effect>& effects, std::uint64_t seed = 1) {
  return ShaftSensor(SensorEffects(effects), 1e-3, 1.0 / (2.0 * pi), 0, seed);
}

TEST(Effects, WithoutSensorEffectsADriveReadsTheTruth) {
  ShaftSensor s = sensor({});
  s.settle({0.1, 0.0});
  const ShaftReading r = s.read({0.123456789, 4.5});
  EXPECT_EQ(r.position_rev, 0.123456789);
  EXPECT_EQ(r.velocity_rev_s, 4.5);
}

TEST(Effects, BiasAndDelay) {
  ShaftSensor s = sensor({SensorBias{{2.0 * pi * 0.01, 0, 0, 0}}, SensorDelay{2}});
  s.settle({0.5, 0.0});
  std::vector<double> seen;
  for (int n = 1; n <= 5; ++n) seen.push_back(s.read({0.5 + 0.1 * n, 1.0}).position_rev);
  const std::vector<double> want{0.51, 0.51, 0.61, 0.71, 0.81};
  for (std::size_t i = 0; i < want.size(); ++i) EXPECT_NEAR(seen[i], want[i], 1e-15);
}

TEST(Effects, EncoderFollowsAConstantRateWithinACount) {
  ShaftSensor s = sensor({Encoder{12, 1000.0}});
  s.settle({0.0, 0.0});
  ShaftReading r{};
  for (int n = 1; n <= 400; ++n) r = s.read({0.002 * n, 2.0});
  EXPECT_NEAR(r.velocity_rev_s, 2.0, 0.2);
  EXPECT_NEAR(r.position_rev, 0.8, 1.5 / 4096.0);
}

TEST(Effects, TheObserverReportsAConstantSpeedHoweverFastItIs) {
  for (const double bandwidth : {100.0, 1000.0, 8000.0, 1e5}) {
    ShaftSensor s = sensor({Encoder{32, bandwidth}});
    s.settle({0.0, 0.0});
    ShaftReading r{};
    for (int n = 1; n <= 2000; ++n) r = s.read({0.002 * n, 2.0});
    EXPECT_NEAR(r.velocity_rev_s, 2.0, 1e-4) << bandwidth;
    EXPECT_NEAR(r.position_rev, 4.0, 1e-6) << bandwidth;
  }
}

TEST(Effects, NoiseHasItsSigmaBeforeTheObserver) {
  const double sigma = 1e-3;
  ShaftSensor s =
      sensor({SensorNoise{sigma, 1e5}});  // an observer far above the sampling rate passes nearly all of it
  s.settle({0.0, 0.0});
  double sum = 0.0, squares = 0.0;
  constexpr int n = 20000;
  for (int i = 0; i < n; ++i) {
    const double x = s.read({0.0, 0.0}).position_rev * 2.0 * pi;
    sum += x;
    squares += x * x;
  }
  EXPECT_NEAR(sum / n, 0.0, 5.0 * sigma / std::sqrt(n));
  EXPECT_NEAR(std::sqrt(squares / n), sigma, 0.03 * sigma);
}

TEST(Effects, WhatActsElsewhereLeavesTheRightHandSideAlone) {
  auto bare = wheels({}, 0.1, 3.0);
  auto same = wheels(
      {Encoder{14, 1000.0}, SensorNoise{1e-3, 1000.0}, TorqueSaturation{1.0}, Jitter{1e-4}, SensorDelay{1}},
      0.1, 3.0);
  bare.advance(0.0, 1.0, 1000, torque(0.001));
  same.advance(0.0, 1.0, 1000, torque(0.001));
  EXPECT_EQ(bare.state().angle, same.state().angle);
  EXPECT_EQ(bare.state().rate, same.state().rate);
  EXPECT_EQ(same.state_dimension(), 4);
}

}  // namespace
}  // namespace esmc::host
