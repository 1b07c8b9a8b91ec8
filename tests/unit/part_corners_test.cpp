/// Optional parts, estimates and gains where their other tests do not lead: corners that structure.coverage
/// found.

#include <gtest/gtest.h>

#include <cmath>
#include <utility>

#include "firmware/cycle/estimate.hpp"
#include "firmware/cycle/linked.hpp"
#include "firmware/cycle/part_elbow_rotors.hpp"
#include "firmware/cycle/part_motor_map.hpp"
#include "tests/support/cycle_rig.hpp"

namespace esmc::test {
namespace {

using Five = FiveBar<double>;
using Arm = Rr<double>;

ControllerConfig<Arm> arm_config() {
  ControllerConfig<Arm> c;
  c.mechanism = Arm({{0.2, 0.15, 0.09, 0.07, 0.4, 0.3, 2e-3, 1e-3, 0.0, 0.0, 0.0, 0.0}, 9.8});
  c.mode = {1};
  c.gains.lambda.setConstant(20.0);
  c.gains.k.setConstant(8.0);
  c.gains.layer.setConstant(0.7);
  c.gains.independent = {20.0, 8.0, 0.7, 90.0, 15.0};
  c.torque_limit.setConstant(3.0);
  c.sample_time = 1e-3;
  return c;
}

TEST(PartCorners, WithoutFusionNoEncoderIsBlamed) {
  const auto s = setup<Five>();
  Controller<Five> controller(s.controller);
  TickResult<Five> result;
  result.fault = Fault::loop_not_closed;
  EXPECT_EQ(report_of(controller, result, Sample<Five>{}).encoder, link::no_axis);
}

TEST(PartCorners, ADelayIsRoundedAndNoLongerThanTheMemory) {
  ControllerConfig<Arm> c = arm_config();
  for (const auto& [ticks, whole] : {std::pair{0.0, 0}, {0.4, 0}, {1.6, 2}, {7.9, 8}, {8.0, 8}, {1e9, 8}}) {
    c.delay_ticks = ticks;
    EXPECT_EQ(part::whole_delay(c), whole) << ticks;
  }
}

/// From four motors without a preload, too, the torque rises in equal steps.
TEST(PartCorners, FourMotorsRampInEqualSteps) {
  auto s = setup<Five>();
  s.controller.motors = Motors::all;
  s.controller.sensors = Sensors::all;
  s.controller.ramp_ticks = 10;
  Rig<Five> rig(s);
  ASSERT_TRUE(rig.start());
  const Vec<double, 4> second = rig.tick().torque, third = rig.tick().torque, fourth = rig.tick().torque;
  EXPECT_GT((third - second).norm(), 1e-3);
  // The reference moves on by a thousandth of its radius in these ticks, and the rig stands still.
  EXPECT_LT((fourth - 2.0 * third + second).norm(), 0.1 * (third - second).norm());
}

/// Rotors at the elbows add to their own rows, to the law's accelerations or to those of the part behind.
TEST(PartCorners, ElbowRotorsAddToWhatIsBehindThem) {
  auto s = setup<Five>();
  FiveBarParams<double> p{.l0 = half_base, .m0 = 0.05, .g = 9.8, .legs = {}};
  for (auto& leg : p.legs) {
    leg = {bar1, bar2, 0.06, 0.068, 0.1, 0.11, 2e-4, 7e-4, 0.01, 0.012, 0.0, 0.0};
    leg.rotor2 = 3e-4;
  }
  auto& c = s.controller;
  c.mechanism = Five(p);
  Tracking<Five> t{};
  ASSERT_TRUE(desired_at_effector(c.mechanism, c.mode, {0.01, 0.18}, {0.1, 0.0}, {0.0, 0.0}, t.pose, t.rates,
                                  t.desired_acceleration));
  t.desired_pose = t.pose;
  t.desired_rates = t.rates;
  PartMemory<Five> memory;
  memory.reset();
  Five::Channels of_law = Five::Channels::Zero(), with_rotors = of_law, sliding;
  fused_acceleration(c.law, c.mechanism, c.gains, c.reaching, t, of_law, sliding);
  part::elbow_rotors(c, t, memory, with_rotors, sliding);
  Five::Channels expected = of_law;
  c.mechanism.add_rotors(expected);
  EXPECT_EQ(with_rotors, expected);
  EXPECT_NE(with_rotors, of_law);
  c.behind = [](const ControllerConfig<Five>&, const Tracking<Five>&, PartMemory<Five>&, Five::Channels& a,
                Five::Channels& s1) {
    a.setConstant(2.0);
    s1.setConstant(3.0);
  };
  part::elbow_rotors(c, t, memory, with_rotors, sliding);
  expected.setConstant(2.0);
  c.mechanism.add_rotors(expected);
  EXPECT_EQ(with_rotors, expected);
  EXPECT_EQ(sliding[0], 3.0);
}

/// Motors are asked for what makes them give the law's torque, at the angle of the instant at which it acts.
TEST(PartCorners, MotorMapAndBack) {
  ControllerConfig<Arm> c = arm_config();
  c.torque_lead = 2e-3;
  c.delay_ticks = 3.0;
  c.motor_map.factor = {0.9, 1.2};
  c.motor_map.amplitude = {0.0, 0.3};
  c.motor_map.per_turn = {5.0, 7.0};
  c.motor_map.phase = {1.0, 0.4};
  Sample<Arm> measured;
  measured.angle = {0.5, -1.1};
  measured.rate = {3.0, 2.0};
  const double cogging = 0.3 * std::sin(7.0 * (-1.1 + 2.0 * (2e-3 + 3.0 * c.sample_time)) + 0.4);
  Vec2<double> torque(1.8, -0.6);
  part::motor_map(c, measured, MotorTorque::given_to_asked, torque);
  EXPECT_NEAR(torque[0], 1.8 / 0.9, 1e-15);
  EXPECT_NEAR(torque[1], (-0.6 - cogging) / 1.2, 1e-15);
  part::motor_map(c, measured, MotorTorque::asked_to_given, torque);
  EXPECT_NEAR(torque[0], 1.8, 1e-15);
  EXPECT_NEAR(torque[1], -0.6, 1e-15);
  measured.angle[1] = 1e5;  // beyond sin_cos: the limit of torques refuses it
  part::motor_map(c, measured, MotorTorque::given_to_asked, torque);
  EXPECT_FALSE(std::isfinite(torque[1]));
}

TEST(PartCorners, EveryVectorThatALaterTickReadsIsShown) {
  ControllerConfig<Arm> c = arm_config();
  Controller<Arm> controller(c);
  int shown = 0;
  controller.memory().each_state([&](Vec2<double>& v) {
    v.setConstant(1.5);
    ++shown;
  });
  EXPECT_EQ(shown, PartMemory<Arm>::depth + 3 + 4 + SuperTwisting<double>::most_delay + 1);
  EXPECT_EQ(controller.memory().disturbance, Vec2<double>(1.5, 1.5));
  controller.memory().reset();
  EXPECT_EQ(controller.memory().disturbance, Vec2<double>(0.0, 0.0));
}

TEST(PartCorners, ByValueOrByReferenceItIsTheSameState) {
  const auto s = setup<Five>();
  const auto& c = s.controller;
  const auto up = desired_at_effector(c.mechanism, c.mode, {0.01, 0.18}, {0.1, -0.2}, {1.0, 2.0});
  ASSERT_TRUE(up.has_value());
  EXPECT_FALSE(desired_at_effector(c.mechanism, c.mode, {0.0, 3.0}, {0.0, 0.0}, {0.0, 0.0}).has_value());
  const Vec2<double> q = Five::base_angles(up->pose), qd = Five::base(up->rates);
  const auto at = desired_at_base(c.mechanism, c.mode, q, qd, Five::base(up->acceleration));
  ASSERT_TRUE(at.has_value());
  EXPECT_TRUE(at->pose.effector.isApprox(up->pose.effector, 1e-12));
  EXPECT_TRUE(at->acceleration.platform.isApprox(up->acceleration.platform, 1e-9));
  const auto seen = estimate_from_base(c.mechanism, c.mode, q, qd);
  ASSERT_TRUE(seen.has_value());
  EXPECT_EQ(seen->closure, 0.0);
  EXPECT_TRUE(seen->pose.effector.isApprox(up->pose.effector, 1e-12));
  const Vec2<double> apart(0.0, 0.0);  // both first bars outwards along the base line
  EXPECT_FALSE(estimate_from_base(c.mechanism, c.mode, apart, qd).has_value());
  EXPECT_FALSE(desired_at_base(c.mechanism, c.mode, apart, qd, qd).has_value());
}

}  // namespace
}  // namespace esmc::test
