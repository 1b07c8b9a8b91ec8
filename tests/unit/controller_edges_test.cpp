/// The controller by itself: which torque is limited, lowered, compensated or taken away, and from which
/// state a motion begins. Expected values are those of the formulas in words.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "tests/support/controller_alone.hpp"

namespace esmc::test {
namespace {

using Five = FiveBar<double>;
using Arm = Rr<float>;
template <class M>
class ControllerEdges : public testing::Test {};
using Both = testing::Types<Five, Arm>;
TYPED_TEST_SUITE(ControllerEdges, Both);

// ---- halting and lowering

template <class M>
Alone<M> lowering() {
  Alone<M> a;
  a.config.halt_ticks = 4;
  a.config.lower_ticks = 8;
  a.config.after_halt = AfterHalt::lower;
  a.config.reference = {.kind = ReferenceKind::hold_start, .space = a.config.reference.space};
  return a;
}

TEST(ControllerLowering, TheWeightFadesAndSpeedIsDamped) {
  auto a = lowering<Arm>();
  a.config.torque_limit = {3.0F, 1.0F};
  const Vec2<double> weight = weight_of_the_arm(a.now.angle);
  for (int round = 0; round < 2; ++round) {
    a.start();
    a.now.rate.setZero();
    a.tick(Command::halt);
    for (int n = 0; n < 20 && a.supervisor->state() == State::halting; ++n) a.tick();
    a.now.rate = {0.25F, -0.5F};  // a tenth of joint_speed is 5 rad/s
    const Vec2<double> brake(-0.25 * 3.0 / 5.0, 0.5 * 1.0 / 5.0);
    for (int k = 1; k <= 8; ++k) {  // the first one has been the tick that was at rest
      const auto r = a.tick();
      if (k == 8) {
        EXPECT_EQ(r.state, State::lowering);
      }
      const Vec2<double> expected = weight * (1.0 - k / 8.0) + brake;
      EXPECT_NEAR(r.torque[0], expected[0], 1e-5) << k;
      EXPECT_NEAR(r.torque[1], expected[1], 1e-5) << k;
      EXPECT_EQ(r.stage_done, k == 8) << k;
      EXPECT_EQ(r.sliding.norm(), 0.0F) << "there is no law";
    }
    EXPECT_EQ(a.tick().state, State::stopping);
    a.now.rate.setZero();
    EXPECT_EQ(a.tick().state, State::disabled);
  }
}

/// Where the torque limit would ask for more: a fifth of the speed in a tick by the inertia of each joint
/// with the other one free, and a third of that with two ticks of delay.
TEST(ControllerLowering, DampsNoMoreThanTheLoopBears) {
  auto a = lowering<Arm>();
  a.config.torque_limit = {300.0F, 200.0F};
  a.config.delay_ticks = 2.0F;
  a.start();
  a.tick(Command::halt);
  for (int n = 0; n < 20 && a.supervisor->state() == State::halting; ++n) a.tick();
  a.now.rate = {0.25F, -0.5F};
  const Vec2<double> weight = weight_of_the_arm(a.now.angle);
  const double share = 0.2 / 3.0 / static_cast<double>(a.config.sample_time);
  const auto r = a.tick();
  for (int i = 0; i < 2; ++i) {
    const double inertia = 1.0 / answer_of_the_arm(a.now.angle, Vec2<double>::Unit(i))[i];
    const double expected =
        weight[i] * (1.0 - 1 / 8.0) - share * inertia * static_cast<double>(a.now.rate[i]);
    EXPECT_NEAR(r.torque[i], expected, 1e-4 * std::abs(expected)) << i;
  }
}

TEST(ControllerLowering, BothBaseMotorsOfAFiveBarAreDamped) {
  auto a = lowering<Five>();
  a.config.torque_limit = {2.0, 9.0, 1.0, 9.0};
  a.start();
  a.tick(Command::halt);
  for (int n = 0; n < 20 && a.supervisor->state() == State::halting; ++n) a.tick();
  for (int k = 0; k < 5; ++k) a.tick();
  const auto still = a.tick();
  for (const int joint : {0, 2}) {
    a.now.rate.setZero();
    a.now.rate[joint] = 0.125;
    const auto r = a.tick();
    if (joint == 2) {  // the weight is gone
      EXPECT_NEAR(r.torque[2], -0.125 * 1.0 / 5.0, 1e-12);
      EXPECT_NEAR(r.torque[0], 0.0, 1e-12);
    } else {  // an eighth of the weight is left, two before
      EXPECT_NEAR(r.torque[0] - still.torque[0] / 2, -0.125 * 2.0 / 5.0, 1e-12);
      EXPECT_NEAR(r.torque[2] - still.torque[2] / 2, 0.0, 1e-12);
    }
  }
}

/// Four motors and four encoders: all joints must be at rest, and what lowers is gathered where the effector
/// is.
TEST(ControllerLowering, FourMotorsWithFourEncodersAreLoweredByTheEffector) {
  auto a = lowering<Five>(), base = lowering<Five>();
  a.config.motors = Motors::all;
  a.config.sensors = Sensors::all;
  a.config.allocate = allocation_for<Five>(Motors::all);
  a.config.torque_limit.setConstant(9.0);
  a.config.torque_weight.setOnes();
  a.config.preload = {0.5, -0.25, 0.125, 0.25};
  const Five& m = a.config.mechanism;
  const auto pose = estimate_from_all(m, a.now.angle, Vec<double, 4>::Zero().eval()).pose;
  const auto moving = [&](double share) {
    const auto r = m.base_rates(pose, Vec2<double>(share, share));
    a.now.rate = {r.leg[0][0], r.leg[0][1], r.leg[1][0], r.leg[1][1]};
    return std::max(std::abs(r.leg[0][1]), std::abs(r.leg[1][1])) / share;
  };
  const double farther = moving(1.0);
  ASSERT_GT(farther, 1.1) << "an elbow turns faster than the base joints";
  a.start();
  const double slow = 0.02 * a.config.limits.joint_speed;
  a.tick(Command::halt);
  for (int n = 0; n < 6; ++n) {
    moving(0.95 * slow);  // the base joints are slow enough
    EXPECT_EQ(a.tick().state, State::halting) << n;
  }
  moving(1.5 * slow);
  EXPECT_EQ(a.tick().state, State::halting);
  a.now.rate.setZero();
  for (int n = 0; n < 3 && a.supervisor->state() == State::halting; ++n) a.tick();
  base.start();
  base.tick(Command::halt);
  for (int n = 0; n < 20 && base.supervisor->state() == State::halting; ++n) base.tick();
  ASSERT_EQ(a.supervisor->state(), State::lowering);
  const auto gathered = [&](const Vec<double, 4>& torque) {
    const auto x = m.base_rates(pose, Vec2<double>::UnitX()), y = m.base_rates(pose, Vec2<double>::UnitY());
    const auto work = [&](const Five::Rates& r) {
      return torque[0] * r.leg[0][0] + torque[1] * r.leg[0][1] + torque[2] * r.leg[1][0] +
             torque[3] * r.leg[1][1];
    };
    return Vec2<double>(work(x), work(y));
  };
  const auto four = a.tick(), two = base.tick();
  ASSERT_EQ(four.state, State::lowering) << name(four.fault);
  ASSERT_EQ(two.state, State::lowering);
  EXPECT_GT(std::abs(two.torque[0]), 0.01);
  EXPECT_LT((gathered(four.torque) - Vec2<double>(two.torque[0], two.torque[2])).norm(), 1e-9);
  moving(0.5 * slow);
  const auto braked = a.tick();
  EXPECT_LT(braked.torque.dot(a.now.rate), four.torque.dot(a.now.rate)) << "against the motion";
}

/// Straight on, unless that way leaves the reach or comes too near to its edge: then the base joints come to
/// rest, if the pose is of their assembly mode.
TEST(ControllerHalting, FourMotorsWithFourEncodersStopTheEffectorWithinItsReach) {
  const struct {
    double speed, least_type1;  // m/s; of the present sine of type 1
    bool other_mode, straight;
  } cases[] = {
      {0.2, 0.5, false, true}, {8.0, 0.0, false, false}, {1.5, 0.9, false, false}, {8.0, 0.0, true, true}};
  for (const auto& c : cases) {
    auto a = lowering<Five>();
    a.config.motors = Motors::all;
    a.config.sensors = Sensors::all;
    a.config.allocate = allocation_for<Five>(Motors::all);
    a.config.torque_limit.setConstant(9.0);
    a.config.halt_ticks = 100;
    a.config.limits.joint_speed = 1e4;
    const Five& m = a.config.mechanism;
    const auto pose = estimate_from_all(m, a.now.angle, Vec<double, 4>::Zero().eval()).pose;
    a.config.limits.min_abs_sin_type1 = c.least_type1 * Five::min_abs_sin_type1(pose);
    if (c.other_mode) a.config.mode.assembly = -a.config.mode.assembly;
    a.start();
    const Vec2<double> away(0.1, 1.0);
    const auto r = m.chain_rates(pose, Vec2<double>(away * c.speed));
    a.now.rate = {r.leg[0][0], r.leg[0][1], r.leg[1][0], r.leg[1][1]};
    a.tick(Command::halt);
    TickResult<Five> last = a.tick();
    for (int n = 0; n < 10; ++n) last = a.tick();
    ASSERT_EQ(last.state, State::halting) << c.speed << ' ' << name(last.fault);
    const Vec2<double> way = last.desired_effector - pose.effector;
    EXPECT_GT(way.dot(away), 0.0);
    const double aside = std::abs(way[0] * away[1] - way[1] * away[0]) / way.norm();
    EXPECT_EQ(aside < 1e-9, c.straight) << c.speed << ' ' << aside;
    if (!c.other_mode) continue;  // no other way is known
    for (int n = 0; n < 100 && last.state == State::halting; ++n) last = a.tick();
    EXPECT_EQ(last.state, State::fault);
    EXPECT_EQ(last.fault, Fault::halt_failed);
    EXPECT_TRUE(last.torque.isZero(0));
  }
}

TEST(ControllerLowering, AJointIsAtRestIfItsDriveTellsNoMore) {
  for (const double told : {0.0, 2.0}) {
    auto a = lowering<Arm>();  // 2 % of joint_speed are 1 rad/s
    a.config.limits.rest_speed = static_cast<float>(told);
    a.start();
    a.now.rate = {1.5F, 0.0F};
    a.tick(Command::halt);
    for (int n = 0; n < 8; ++n) a.tick();
    EXPECT_EQ(a.supervisor->state(), told > 0.0 ? State::lowering : State::halting);
  }
}

/// The law that brings to rest predicts as under the reference; lowering has no law.
TEST(ControllerLowering, AHaltIsPredicted) {
  static int predicted;
  predicted = 0;
  auto a = lowering<Arm>();
  a.config.predict = [](const ControllerConfig<Arm>&, const PartMemory<Arm>&, Tracking<Arm>&) {
    ++predicted;
  };
  a.config.delay_ticks = 2.0F;
  a.start();
  const int running = predicted;
  a.tick(Command::halt);
  EXPECT_EQ(predicted, running + 1);
  for (int n = 0; n < 20 && a.supervisor->state() == State::halting; ++n) a.tick();
  const int halted = predicted;
  EXPECT_GT(halted, running + 1);
  a.tick();
  ASSERT_EQ(a.supervisor->state(), State::lowering);
  EXPECT_EQ(predicted, halted);
}

/// The way to rest begins with the state that is measured, each time anew, and in the tick of the fault.
TYPED_TEST(ControllerEdges, AHaltBeginsWhereTheMechanismIs) {
  Alone<TypeParam> a;
  a.config.halt_ticks = 50;
  a.config.after_halt = AfterHalt::release;
  for (const double moved : {0.0, 0.01, -0.02}) {
    a.now.angle[0] += static_cast<typename TypeParam::Scalar>(moved);
    a.start();
    a.tick();
    a.now.rate[0] = a.now.rate[Alone<TypeParam>::second] = 0.125;
    const auto r = a.tick(Command::halt);
    EXPECT_EQ(r.state, State::halting);
    EXPECT_LT(r.sliding.norm(), 1e-4) << moved;
    a.now.rate.setZero();
    for (int n = 0; n < 100 && a.supervisor->state() != State::disabled; ++n) a.tick();
    EXPECT_EQ(a.supervisor->state(), State::disabled);
  }
}

/// With no way to rest at all, a halt takes the torque away.
TYPED_TEST(ControllerEdges, AWayToRestMayTakeASingleTick) {
  for (const std::uint32_t ticks : {0U, 1U}) {
    Alone<TypeParam> a;
    a.config.halt_ticks = ticks;
    a.start();
    a.tick();
    const auto r = a.tick(Command::halt);
    EXPECT_EQ(r.state, ticks == 0 ? State::stopping : State::halting);
    EXPECT_EQ(r.torque.norm() > 0, ticks > 0);
  }
}

TYPED_TEST(ControllerEdges, AFaultThatHaltsBeginsTheHaltInItsTick) {
  Alone<TypeParam> a;
  a.config.halt_ticks = 50;
  a.config.limits.joint_angle[1].upper =
      a.now.angle[Alone<TypeParam>::second] + typename TypeParam::Scalar(0.01);
  a.start();
  a.tick();
  a.now.angle[Alone<TypeParam>::second] += typename TypeParam::Scalar(0.02);
  const auto r = a.tick();
  EXPECT_EQ(r.state, State::halting);
  EXPECT_EQ(r.fault, Fault::joint_angle);
  EXPECT_LT(r.sliding.norm(), 1e-4);
  EXPECT_GT(r.torque.norm(), 0.0);
  EXPECT_EQ(r.desired_effector, r.effector);
}

// ---- the beginning of a motion

/// While it is joined, the reference begins with the measured position and velocity, at every rate.
TYPED_TEST(ControllerEdges, AReferenceIsJoinedFromTheMeasuredMotion) {
  for (const auto space : {ReferenceSpace::effector, ReferenceSpace::base_joints}) {
    for (const unsigned percent : {100U, 50U}) {
      Alone<TypeParam> a;
      a.config.join_ticks = 500;
      a.config.limits.joint_speed = 1e3;
      a.config.torque_limit.setConstant(1e3);
      a.config.reference.space = space;
      if (space == ReferenceSpace::base_joints)
        a.config.reference.centre = {a.now.angle[0], a.now.angle[Alone<TypeParam>::second]};
      a.now.rate[0] = 0.25;
      a.now.rate[Alone<TypeParam>::second] = -0.5;
      a.tick();
      a.controller->path_rate().want(percent);
      const auto r = a.start();
      ASSERT_EQ(r.state, State::running) << name(r.fault);
      EXPECT_LT(r.sliding.norm(), 1e-3) << percent;
    }
  }
}

/// With a predictor the reference is taken at the instant to which it predicts.
TYPED_TEST(ControllerEdges, APredictorLooksAheadInTheReference) {
  Alone<TypeParam> plain, ahead;
  ahead.config.delay_ticks = 3;
  ahead.config.predict = [](const auto&, const auto&, auto&) {};
  plain.start(), ahead.start();
  std::vector<Vec2<double>> desired;
  for (int n = 1; n < 20; ++n) desired.push_back(plain.tick().desired_effector.template cast<double>());
  for (std::size_t n = 0; n + 3 < desired.size(); ++n) {
    const auto r = ahead.tick();
    EXPECT_LT((r.desired_effector.template cast<double>() - desired[n + 3]).norm(), 1e-6) << n;
  }
}

// ---- limits

/// The sign test gives no more than the limit, although the weight alone is above it.
TEST(ControllerLimits, ASignTestIsLimitedToo) {
  Alone<Arm> a;
  a.config.sign_test_move = 0.01F;
  a.config.torque_limit = {0.5F, 2.0F};
  ASSERT_GT(weight_of_the_arm(a.now.angle)[0], 0.7);
  const auto r = a.start();
  EXPECT_EQ(r.state, State::testing);
  EXPECT_EQ(r.torque[0], 0.5F);
  EXPECT_TRUE(r.saturated);
}

/// A motor that does not move fails after its first half, as soon the second time as the first.
TEST(ControllerLimits, ASignTestBeginsAnewEachTime) {
  Alone<Arm> a;
  a.config.sign_test_move = 0.01F;
  std::array<int, 3> ticks{};
  for (int round = 0; round < 3; ++round) {
    a.start();
    if (round == 1) {  // ended in the midst of it
      for (int n = 0; n < ticks[0] / 2; ++n) a.tick();
      a.tick(Command::stop);
      a.tick();
      a.start();
    }
    int& n = ticks[static_cast<unsigned>(round)];
    while (a.supervisor->state() == State::testing && n < 5000) ++n, a.tick();
    EXPECT_EQ(a.supervisor->fault(), Fault::sign_test);
    a.tick(Command::reset);
  }
  EXPECT_GT(ticks[0], 4);
  EXPECT_EQ(ticks[1], ticks[0]);
  EXPECT_EQ(ticks[2], ticks[0]);
}

TYPED_TEST(ControllerEdges, AJumpOfTheLastEncoderIsSeen) {
  for (const int joint : {0, Alone<TypeParam>::second}) {
    Alone<TypeParam> a;
    a.config.limits.feedback_jump = typename TypeParam::Scalar(0.01);
    a.start();
    ASSERT_EQ(a.tick().state, State::running);
    a.now.angle[joint] += typename TypeParam::Scalar(0.05);
    EXPECT_EQ(a.tick().fault, Fault::feedback_jump) << joint;
  }
}

TEST(ControllerLimits, AJumpOfAPassiveEncoderIsSeen) {
  for (int joint = 0; joint < 4; ++joint) {
    Alone<Five> a;
    a.config.sensors = Sensors::all;
    a.config.limits.closure = 1.0;
    a.config.limits.feedback_jump = 0.01;
    a.start();
    ASSERT_EQ(a.tick().state, State::running);
    a.now.angle[joint] += 0.05;
    EXPECT_EQ(a.tick().fault, Fault::feedback_jump) << joint;
  }
}

// ---- ticks without torque

template <class M>
void expect_nothing(const TickResult<M>& r) {
  EXPECT_EQ(r.torque.norm(), 0);
  EXPECT_EQ(r.sliding.norm(), 0);
  EXPECT_EQ(r.desired_effector.norm(), 0);
  for (const auto& d : r.desired_direction.items) EXPECT_EQ(d.norm(), 0);
  EXPECT_FALSE(r.stage_done);
  EXPECT_FALSE(r.saturated);
  EXPECT_EQ(r.running_tick, 0U);
}

TYPED_TEST(ControllerEdges, WithoutTorqueNothingIsDesiredAndNothingSlides) {
  Alone<TypeParam> a;
  for (int round = 0; round < 2; ++round) {
    expect_nothing(a.tick());
    expect_nothing(a.tick(Command::enable));
    EXPECT_GT(a.tick().sliding.norm(), 0);
    const auto r = a.tick(Command::stop);
    EXPECT_EQ(r.state, State::stopping);
    expect_nothing(r);
    EXPECT_EQ(a.tick().state, State::disabled);
  }
  a.start();
  a.now.rate[0] = 1e3;
  const auto r = a.tick();
  EXPECT_EQ(r.fault, Fault::joint_speed);
  EXPECT_EQ(r.torque.norm(), 0);
  EXPECT_EQ(r.sliding.norm(), 0);
  EXPECT_EQ(r.desired_effector.norm(), 0);
  expect_nothing(a.tick(Command::reset));
}

TYPED_TEST(ControllerEdges, OnlyEnablingIsEndedByAGuardWithoutTorque) {
  for (const bool stale : {false, true}) {
    Alone<TypeParam> a;
    const auto spoil = [&] {
      if (stale) {
        a.now.age_ticks[0] = 3;
      } else {
        a.now.rate[Alone<TypeParam>::second] = 1e3;
      }
    };
    const auto good = a.now;
    spoil();
    EXPECT_EQ(a.tick().fault, Fault::none) << "disabled";
    EXPECT_EQ(a.tick(Command::enable).fault, stale ? Fault::none : Fault::joint_speed);
    a.now = good;
    a.tick(Command::reset);
    a.tick(Command::stop);
    a.tick();
    a.start();
    ASSERT_EQ(a.supervisor->state(), State::running);
    spoil();
    const auto r = a.tick(Command::stop);
    EXPECT_EQ(r.state, State::stopping);
    EXPECT_EQ(r.fault, Fault::none);
  }
}

// ---- optional parts, written here

struct Part {
  static inline bool broken = false;
  static inline std::vector<MotorTorque> asked;
  static inline double disturbance[2];

  template <class M>
  static void reach(const ControllerConfig<M>&, const Tracking<M>&, PartMemory<M>&,
                    typename M::Channels& acceleration, typename M::Channels& sliding) {
    acceleration.setZero();
    sliding.setConstant(typename M::Scalar(0.375));
  }
  template <class M>
  static void observe(const ControllerConfig<M>&, const Tracking<M>&, PartMemory<M>& memory) {
    for (int i = 0; i < 2; ++i) memory.disturbance[i] = static_cast<typename M::Scalar>(disturbance[i]);
  }
  /// Motors give an eighth less than they are asked for; broken, the first one is asked for NaN.
  template <class M>
  static void correct(const ControllerConfig<M>&, const Sample<M>&, MotorTorque change,
                      Vec<typename M::Scalar, M::joints>& torque) {
    asked.push_back(change);
    for (const int j : {0, M::joints / 2})
      torque[j] += typename M::Scalar(change == MotorTorque::given_to_asked ? 0.125 : -0.125);
    if (broken) torque[0] = std::numeric_limits<typename M::Scalar>::quiet_NaN();
  }
};

template <class M>
Alone<M> at_rest() {
  Alone<M> a;
  a.config.reach = &Part::reach<M>;
  a.config.torque_limit.setConstant(5);
  return a;
}

TYPED_TEST(ControllerEdges, APartThatReachesReplacesTheLaw) {
  auto a = at_rest<TypeParam>();
  const auto r = a.start();
  typename TypeParam::Channels told;
  told.setConstant(typename TypeParam::Scalar(0.375));
  EXPECT_EQ(r.sliding, told);
  if constexpr (TypeParam::joints == 2) {  // no acceleration: the weight alone
    EXPECT_LT((r.torque.template cast<double>() - weight_of_the_arm(a.now.angle)).norm(), 1e-5);
  }
}

TYPED_TEST(ControllerEdges, ADisturbanceIsCompensatedOnItsOwnMotor) {
  const auto torque = [](double first, double second, bool observed) {
    auto a = at_rest<TypeParam>();
    if (observed) a.config.observer = &Part::observe<TypeParam>;
    Part::disturbance[0] = first;
    Part::disturbance[1] = second;
    const auto r = a.start();
    if (observed) {
      EXPECT_EQ(a.controller->memory().asked[0], r.torque[0]);
      EXPECT_EQ(a.controller->memory().asked[1], r.torque[Alone<TypeParam>::second]);
      EXPECT_EQ(a.controller->memory().ticks, 1);
      EXPECT_TRUE(a.controller->memory().whole);
    }
    return Vec2<double>(r.torque[0], r.torque[Alone<TypeParam>::second]);
  };
  const Vec2<double> plain = torque(9, 9, false);
  EXPECT_LT((torque(0.25, -0.5, true) - plain - Vec2<double>(-0.25, 0.5)).norm(), 1e-5);
  EXPECT_LT((torque(0, 0, true) - plain).norm(), 1e-6);
}

TYPED_TEST(ControllerEdges, APredictedEffectorIsTold) {
  auto a = at_rest<TypeParam>();
  a.config.predict = [](const auto&, const auto&, auto& t) { t.pose.effector = {0.25F, -0.75F}; };
  const auto r = a.start();
  EXPECT_EQ(r.effector[0], 0.25F);
  EXPECT_EQ(r.effector[1], -0.75F);
}

/// Asked for more by what the motor does not give, then limited; kept is what the motors give of that.
TYPED_TEST(ControllerEdges, MemoryIsOfTorquesThatTheMotorsGive) {
  for (const bool limited : {false, true}) {
    for (const bool ramp : {false, true}) {
      auto plain = at_rest<TypeParam>();
      auto a = at_rest<TypeParam>();
      a.config.correct = &Part::correct<TypeParam>;
      if (limited) a.config.torque_limit.setConstant(typename TypeParam::Scalar(0.0625));
      if (ramp) plain.config.ramp_ticks = a.config.ramp_ticks = 10;
      Part::asked.clear();
      const auto wanted = plain.start();
      const auto r = a.start();
      EXPECT_EQ(Part::asked, (std::vector{MotorTorque::given_to_asked, MotorTorque::asked_to_given}));
      for (const int j : {0, Alone<TypeParam>::second}) {
        const double most = limited ? 0.0625 : 5.0;
        EXPECT_NEAR(r.torque[j], std::clamp(static_cast<double>(wanted.torque[j]) + 0.125, -most, most),
                    1e-6);
        EXPECT_NEAR(a.controller->memory().torque(0)[j], static_cast<double>(r.torque[j]) - 0.125, 1e-6);
      }
      EXPECT_EQ(a.controller->memory().whole, !limited && !ramp);
    }
  }
}

TYPED_TEST(ControllerEdges, MemoryEndsWithTheTorque) {
  auto a = at_rest<TypeParam>();
  a.config.observer = &Part::observe<TypeParam>;
  a.start();
  for (int n = 0; n < 3; ++n) a.tick();
  EXPECT_EQ(a.controller->memory().ticks, 4);
  a.tick(Command::stop);
  EXPECT_EQ(a.controller->memory().ticks, 0);
  Alone<TypeParam> without;
  without.start();
  EXPECT_EQ(without.controller->memory().ticks, 0) << "no part needs it";
}

/// One torque that is no number takes the other one away too, and ends what was about to be done.
TYPED_TEST(ControllerEdges, OneTorqueThatIsNoNumberEndsAll) {
  auto a = at_rest<TypeParam>();
  a.config.halt_ticks = 4;
  a.config.correct = &Part::correct<TypeParam>;
  a.start();
  a.tick(Command::halt);
  for (int n = 0; n < 3; ++n) EXPECT_FALSE(a.tick().stage_done);
  Part::broken = true;
  const auto r = a.tick();
  Part::broken = false;
  EXPECT_EQ(r.state, State::fault);
  EXPECT_EQ(r.fault, Fault::torque_not_finite);
  EXPECT_EQ(r.torque.norm(), 0);
  EXPECT_FALSE(r.stage_done);
}

TYPED_TEST(ControllerEdges, ATorqueLawHasNothingThatSlides) {
  Alone<TypeParam> a;
  a.config.law = LawKind::pd;
  const auto r = a.start();
  EXPECT_EQ(r.sliding.norm(), 0);
  EXPECT_GT(r.torque.norm(), 0);
}

}  // namespace
}  // namespace esmc::test
