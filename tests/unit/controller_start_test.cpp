/// How the controller starts: ramp, joining, homing, and what the interface sets and tells.

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>
#include <vector>

#include "firmware/cycle/linked.hpp"
#include "tests/support/controller_alone.hpp"

namespace esmc::test {
namespace {

using Five = FiveBar<double>;
using Arm = Rr<float>;

template <class M>
class ControllerStart : public testing::Test {};
using Both = testing::Types<Five, Arm>;
TYPED_TEST_SUITE(ControllerStart, Both);

/// Parts that ask for the same acceleration always, and that note what they were asked.
struct Constant {
  static inline double acceleration;
  static inline bool too_much = false;
  static inline std::vector<double> forces;
  template <class M>
  static void reach(const ControllerConfig<M>&, const Tracking<M>&, PartMemory<M>&, typename M::Channels& a,
                    typename M::Channels& sliding) {
    a.setConstant(static_cast<typename M::Scalar>(acceleration));
    sliding.setZero();
  }
  template <class M>
  static void observe(const ControllerConfig<M>&, const Tracking<M>&, PartMemory<M>&) {}
  template <class M>
  static void predict(const ControllerConfig<M>&, const PartMemory<M>&, Tracking<M>&) {}
  template <class M>
  static void correct(const ControllerConfig<M>&, const Sample<M>&, MotorTorque,
                      Vec<typename M::Scalar, M::joints>&) {}
  /// The first forces and the preload.
  static bool allocate(const ControllerConfig<Five>& c, const Five::Pose&, const Five::Channels& w,
                       Vec<double, 4>& torque) {
    for (int j = 0; j < 4; ++j) torque[j] = w[j] + c.preload[j];
    forces.push_back(w.norm());
    return too_much;
  }
  static std::uint8_t fuse(const ControllerConfig<Five>&, const Vec<double, 4>&, const Vec<double, 4>&,
                           Estimate<Five>& out) {
    out.closure = 1.0;
    return odd;
  }
  static inline std::uint8_t odd = 0;
};

template <class M>
Alone<M> constant(double acceleration, std::uint32_t ramp, bool four_motors) {
  Alone<M> a;
  Constant::acceleration = acceleration;
  Constant::too_much = false;
  a.config.reach = &Constant::reach<M>;
  a.config.ramp_ticks = ramp;
  a.config.torque_limit.setConstant(1000);
  if constexpr (M::joints == 4) {
    if (four_motors) {
      a.config.motors = Motors::all;
      a.config.allocate = &Constant::allocate;
      a.config.preload = {0.5, -0.25, 0.125, 0.0};
    }
  }
  return a;
}

/// All but the weight grows in equal steps; a preload is no weight. A halt is not ramped.
TYPED_TEST(ControllerStart, TheTorqueBeyondTheWeightGrowsInEqualSteps) {
  for (const bool four : {false, true}) {
    if (four && TypeParam::joints == 2) continue;
    auto still = constant<TypeParam>(0, 0, four);
    Vec<double, TypeParam::joints> weight = still.start().torque.template cast<double>();
    if (four) weight -= still.config.preload.template cast<double>();
    auto whole = constant<TypeParam>(3, 0, four);
    const Vec<double, TypeParam::joints> full = whole.start().torque.template cast<double>();
    auto a = constant<TypeParam>(3, 8, four);
    a.config.halt_ticks = 4;
    a.config.observer = &Constant::observe<TypeParam>;
    for (int k = 0; k < 12; ++k) {
      const auto r = k == 0 ? a.start() : a.tick();
      EXPECT_EQ(a.controller->memory().whole, k >= 8) << k;
      const double share = k < 8 ? (k + 1) / 8.0 : 1.0;
      const Vec<double, TypeParam::joints> expected = weight + (full - weight) * share;
      EXPECT_LT((r.torque.template cast<double>() - expected).norm(), 1e-4) << k;
    }
    auto halted = constant<TypeParam>(3, 100, four);
    halted.config.halt_ticks = 4;
    halted.config.observer = &Constant::observe<TypeParam>;
    halted.start();
    halted.tick();
    EXPECT_FALSE(halted.controller->memory().whole);
    EXPECT_EQ(halted.controller->memory().ticks, 2);
    const auto r = halted.tick(Command::halt);
    EXPECT_EQ(r.state, State::halting);
    EXPECT_LT((r.torque.template cast<double>() - full).norm(), 1e-4);
    EXPECT_TRUE(halted.controller->memory().whole);
    EXPECT_EQ(halted.controller->memory().ticks, 3) << "what was sent before still acts";
  }
}

TYPED_TEST(ControllerStart, EachPartHasItsMemory) {
  for (int part = 0; part < 4; ++part) {
    Alone<TypeParam> a;
    if (part == 0) a.config.reach = &Constant::reach<TypeParam>;
    if (part == 1) a.config.observer = &Constant::observe<TypeParam>;
    if (part == 2) a.config.predict = &Constant::predict<TypeParam>;
    if (part == 3) a.config.correct = &Constant::correct<TypeParam>;
    a.start();
    EXPECT_EQ(a.controller->memory().ticks, 1) << part;
  }
}

// ---- joining the reference: along a quintic from rest to rest, looked at in sixteen points of seventeen

struct Joining : Alone<Arm> {
  static constexpr std::uint32_t ticks = 1700;
  static constexpr double duration = 1.7;
  explicit Joining(const Vec2<float>& way) {
    config.reference = {.kind = ReferenceKind::sine,
                        .space = ReferenceSpace::base_joints,
                        .centre = {now.angle[0] + way[0], now.angle[1] + way[1]}};
    config.join_ticks = ticks;
    config.torque_limit.setConstant(1e4F);
    config.limits.joint_speed = 1e3F;
  }
  /// The tick of the fault, from 1; 0: none.
  int fault() {
    auto r = start();
    for (int n = 1; n < 40; ++n, r = tick()) {
      if (r.fault == Fault::join_infeasible) return n;
      if (r.fault != Fault::none) return -1;
    }
    return 0;
  }
};

TEST(ControllerJoining, SpeedAndAccelerationOfEachJointAreLookedAt) {
  for (const int joint : {0, 1}) {
    Vec2<float> way(0, 0);
    way[joint] = 0.5F;
    for (int n = 1; n <= 8; ++n) {
      const double u = n / 17.0;
      const double speed = 0.5 / Joining::duration * 30 * u * u * (1 - u) * (1 - u);
      Joining j(way);
      j.config.limits.joint_speed = static_cast<float>(speed * 0.999);
      EXPECT_EQ(j.fault(), n) << joint;
      if (n == 8) {  // the fastest that is looked at
        Joining slower(way);
        slower.config.limits.joint_speed = static_cast<float>(speed * 1.001);
        EXPECT_EQ(slower.fault(), 0);
      }
    }
    for (int n = 1; n <= 3; ++n) {
      const double u = n / 17.0;
      const double acceleration =
          0.5 / (Joining::duration * Joining::duration) * (60 * u - 180 * u * u + 120 * u * u * u);
      Joining j(way);
      j.config.limits.join_acceleration = static_cast<float>(acceleration * 0.999);
      EXPECT_EQ(j.fault(), n) << joint;
    }
    Joining gentle(way);
    gentle.config.limits.join_acceleration = static_cast<float>(5.78 * 0.5 / (1.7 * 1.7));
    EXPECT_EQ(gentle.fault(), 0);
    Joining none(way);
    none.config.limits.join_acceleration = std::nanf("");
    EXPECT_EQ(none.fault(), 1) << "NaN allows nothing";
  }
}

/// So slow that only the weight counts; it grows as the arm comes down from upright.
TEST(ControllerJoining, TorqueOfEachJointIsLookedAt) {
  for (const int joint : {0, 1}) {
    const Vec2<float> from(1.2F, 0.3F);
    for (const int n : {2, 7, 13, 16}) {
      const double u = n / 17.0, way = -(10 * u * u * u - 15 * u * u * u * u + 6 * std::pow(u, 5));
      Joining j(Vec2<float>::Zero());
      j.now.angle = from;
      j.config.reference.centre = {from[0] - 1.0F, from[1]};
      j.config.join_ticks = 170'000;
      const auto needed = weight_of_the_arm(Vec2<float>(from[0] + static_cast<float>(way), from[1]));
      j.config.torque_limit[joint] = static_cast<float>(needed[joint] * 0.999);
      EXPECT_EQ(j.fault(), n) << joint;
    }
  }
}

TEST(ControllerJoining, MotorsThatCannotGiveTheTorqueAreSeen) {
  for (const bool too_much : {false, true}) {
    auto a = constant<Five>(0, 0, true);
    Constant::too_much = too_much;
    a.config.join_ticks = 1700;
    a.config.limits.joint_speed = 1e3;
    EXPECT_EQ(a.start().fault, too_much ? Fault::join_infeasible : Fault::none);
    auto guided = a;
    guided.controller.reset();
    guided.done = false;
    guided.tick();
    guided.controller->setpoints().activate(true);
    EXPECT_EQ(guided.start().fault, Fault::none) << "the reference is not followed";
  }
  Constant::too_much = false;
}

/// What is looked at at another rate leaves a twentieth of the torque to the loop.
TEST(ControllerJoining, AtAnotherRateTheLoopKeepsATwentieth) {
  auto a = constant<Five>(0, 0, true);
  a.config.reference = {.kind = ReferenceKind::hold_start, .space = ReferenceSpace::effector};
  a.start();
  a.controller->path_rate().want(50);
  Constant::forces.clear();
  ASSERT_EQ(a.tick().state, State::running);
  ASSERT_EQ(Constant::forces.size(), 2U);
  EXPECT_NEAR(Constant::forces[0] * 0.95, Constant::forces[1], 1e-9);
}

TEST(ControllerJoining, WhatFourMotorsWereAskedForIsKeptOfTheBaseMotors) {
  auto four = constant<Five>(3, 0, true);
  four.config.observer = &Constant::observe<Five>;
  four.start();
  const auto base = constant<Five>(3, 0, false).start();
  EXPECT_NEAR(four.controller->memory().asked[0], base.torque[0], 1e-9);
  EXPECT_NEAR(four.controller->memory().asked[1], base.torque[2], 1e-9);
}

/// All of it, and not what comes after its end.
TEST(ControllerJoining, AJoinOfFewTicksIsLookedAtInTheFirst) {
  const double mean = 0.5 / 0.008, at_three = 30 * 9.0 / 64 * 25.0 / 64, fastest = 1.875;
  for (const double limit : {(at_three + fastest) / 2, 0.999 * fastest, 1.001 * fastest}) {
    Joining j(Vec2<float>(0.5F, 0.0F));
    j.config.join_ticks = 8;
    j.config.limits.joint_speed = static_cast<float>(mean * limit);
    EXPECT_EQ(j.fault(), limit < fastest ? 1 : 0) << limit;
  }
}

/// The reference turns back where the arm stands and is the fastest after the end of the join: at sin(72 deg)
/// of its speed in the last point that is looked at, and at sin(76.5 deg) where the join ends.
TEST(ControllerJoining, TheReferenceFromItsEndOnIsNotLookedAt) {
  for (const double share : {0.965, 0.95}) {
    Joining j(Vec2<float>(-0.1F, 0.0F));
    const double speed = turn / 0.16;
    j.config.reference.amplitude = {0.1F, 0.0F};
    j.config.reference.speed.setConstant(static_cast<float>(speed));
    j.config.reference.phase[0] = {1ULL << 62U, static_cast<std::uint64_t>(0x1p64 / 160)};
    j.config.join_ticks = 34;
    j.config.limits.joint_speed = static_cast<float>(share * 0.1 * speed);
    EXPECT_EQ(j.fault(), share > 0.96 ? 0 : 16);
  }
}

TEST(ControllerJoining, AJoinOfASingleTickIsLookedAt) {
  for (const std::uint32_t ticks : {0U, 1U}) {
    Joining j(Vec2<float>::Zero());
    j.config.join_ticks = ticks;
    j.config.torque_limit[0] = static_cast<float>(weight_of_the_arm(j.now.angle)[0] * 0.999);
    EXPECT_EQ(j.fault(), ticks);
  }
}

/// The elbow's motor turns its own rotor too.
TEST(ControllerJoining, TheRotorAtTheElbowNeedsTorque) {
  constexpr double duration = 0.17, rotor = 0.01, bar = 1e-3 + 0.3 * 0.07 * 0.07, friction = 0.01;
  for (const int n : {1, 2, 3}) {
    const double u = n / 17.0, v = 1 - u;
    const double way = 0.5 * u * u * u * (10 - 15 * u + 6 * u * u),
                 speed = 0.5 / duration * 30 * u * u * v * v,
                 acceleration = 0.5 / (duration * duration) * 60 * u * v * (v - u);
    for (const double share : {0.999, 1.001}) {
      Joining j(Vec2<float>(0.0F, 0.5F));
      j.config.mechanism = Arm({{0.2F, 0.15F, 0.09F, 0.07F, 0.4F, 0.3F, 2e-3F, 1e-3F, 0.01F, 0.01F, 0.0F,
                                 0.0F, 0.0F, 0.0F, static_cast<float>(rotor)},
                                9.8F});
      j.config.join_ticks = 170;
      const Vec2<float> there(j.now.angle[0], j.now.angle[1] + static_cast<float>(way));
      const double needed = (bar + rotor) * acceleration + friction * speed + weight_of_the_arm(there)[1];
      j.config.torque_limit[1] = static_cast<float>(needed * share);
      EXPECT_EQ(j.fault(), share < 1 ? n : n + 1);
    }
  }
}

TEST(ControllerJoining, WhereItCannotBeJoinedNothingIsDesired) {
  Joining j(Vec2<float>(0.5F, 0.0F));
  j.config.limits.join_acceleration = 1e-6F;
  const auto r = j.start();
  EXPECT_EQ(r.fault, Fault::join_infeasible);
  EXPECT_EQ(r.desired_effector.norm(), 0.0F);
  for (const auto& d : r.desired_direction.items) EXPECT_EQ(d.norm(), 0.0F);
}

TEST(ControllerBegins, LegsThatCannotCloseHaveNoEffector) {
  Alone<Five> a;
  a.now.angle.setZero();  // away from each other
  const auto r = a.tick(Command::enable);
  EXPECT_EQ(r.fault, Fault::loop_not_closed);
  EXPECT_EQ(r.effector.norm(), 0.0);
}

/// The sign test pushes each motor by a twentieth of its limit, within the limits of running.
TEST(ControllerBegins, ASignTestKeepsToTheLimits) {
  Alone<Arm> a;
  a.config.sign_test_move = 0.01F;
  a.config.torque_limit = {3.0F, 2.0F};
  a.config.limits.joint_angle[1].upper = a.now.angle[1] + 0.01F;
  const auto r = a.start();
  EXPECT_EQ(r.state, State::testing);
  EXPECT_NEAR(std::abs(static_cast<double>(r.torque[0]) - weight_of_the_arm(a.now.angle)[0]), 0.05 * 3.0,
              1e-5);
  EXPECT_NEAR(r.torque[1], weight_of_the_arm(a.now.angle)[1], 1e-5);
  a.now.angle[1] += 0.02F;
  EXPECT_EQ(a.tick().fault, Fault::joint_angle);
}

/// It begins to run where each joint has answered a twentieth of the limit of its own motor.
TEST(ControllerBegins, AnArmThatAnswersPassesTheSignTest) {
  Alone<Arm> a;
  a.config.sign_test_move = 0.01F;
  a.config.torque_limit = {3.0F, 2.0F};
  Vec2<double> angle = a.now.angle.cast<double>(), rate(0, 0), most(0, 0);
  auto r = a.start();
  for (int n = 0; n < 1000 && r.state == State::testing; ++n, r = a.tick()) {
    const Vec2<double> push = r.torque.cast<double>() - weight_of_the_arm(a.now.angle);
    most = most.cwiseMax(push.cwiseAbs());
    const Vec2<double> faster = answer_of_the_arm(a.now.angle, push) * 1e-3;
    angle += (rate + faster / 2) * 1e-3;
    rate += faster;
    a.now.angle = angle.cast<float>();
    a.now.rate = rate.cast<float>();
  }
  EXPECT_EQ(r.state, State::running) << name(r.fault);
  EXPECT_NEAR(most[0], 0.05 * 3.0, 1e-5);
  EXPECT_NEAR(most[1], 0.05 * 2.0, 1e-5);
}

// ---- set points

TYPED_TEST(ControllerStart, ABaseJointGoesRoundTheShorterWayUnlessItHasALimit) {
  using S = typename TypeParam::Scalar;
  constexpr S pi = std::numbers::pi_v<S>;
  for (const auto space : {ReferenceSpace::effector, ReferenceSpace::base_joints}) {
    for (const int joint : {0, 1}) {
      for (const auto& [range, round] : {std::pair{Range<S>{}, true},
                                         {Range<S>{S(-3.2), S(3.2)}, true},
                                         {Range<S>{-pi, pi}, false},
                                         {Range<S>{S(2), S(5)}, false}}) {
        auto config = Alone<TypeParam>().config;
        config.reference.space = space;
        config.limits.joint_angle = {};
        config.limits.joint_angle[static_cast<unsigned>(joint)] = range;
        config.limits.joint_angle[static_cast<unsigned>(1 - joint)] = {S(-1), S(1)};
        Controller<TypeParam> c(config);
        auto& s = c.setpoints();
        s.activate(true);
        Vec2<S> begin(S(0.1), S(0.1)), end = begin;
        s.start(begin, Vec2<S>::Zero());
        end[joint] += S(6);  // less than a turn, by 0.28 rad
        s.go_to(end);
        for (int n = 0; n < 20; ++n) s.advance();
        const bool back = round && space == ReferenceSpace::base_joints;
        EXPECT_EQ(s.at().velocity[joint] < 0, back) << joint;
        EXPECT_NE(s.at().velocity[joint], 0);
        Vec2<S> other = begin;
        s.start(begin, Vec2<S>::Zero());
        other[1 - joint] += S(6);
        s.go_to(other);
        for (int n = 0; n < 20; ++n) s.advance();
        EXPECT_GT(s.at().velocity[1 - joint], 0) << "it has a limit";
      }
    }
  }
}

// ---- homing

template <class S>
HomingConfig<S> quarter_speed() {
  return {.speed = {S(-0.25), S(0.25)},
          .torque = {S(0.5), S(0.5)},
          .damping = {S(0.125), S(0.125)},
          .travel = S(2),
          .back_off = S(0.0625),
          .share = S(1.0 / 64)};
}

TYPED_TEST(ControllerStart, HomingGivesNoTorqueThatIsNoNumber) {
  using S = typename TypeParam::Scalar;
  for (const bool bad : {false, true}) {
    Alone<TypeParam> a;
    a.approach = quarter_speed<S>();
    if (bad) a.config.torque_limit[0] = std::numeric_limits<S>::quiet_NaN();
    EXPECT_FALSE(a.tick(Command::home).stage_done);
    a.now.rate[Alone<TypeParam>::second] = S(0.125);  // the waiting joint is damped
    const auto r = a.tick();
    EXPECT_EQ(r.fault, bad ? Fault::torque_not_finite : Fault::none);
    EXPECT_EQ(r.state, bad ? State::fault : State::testing);
    EXPECT_NEAR(r.torque[Alone<TypeParam>::second], bad ? 0.0 : -0.015625, 1e-9);
    EXPECT_FALSE(r.stage_done);
  }
}

/// The first joint is off its stop and stands; the second one's stop gives way.
TYPED_TEST(ControllerStart, AFaultWhileBothLeaveTheirStopsIsBraked) {
  using S = typename TypeParam::Scalar;
  constexpr int second = Alone<TypeParam>::second;
  Alone<TypeParam> a;
  a.approach = quarter_speed<S>();
  a.config.halt_ticks = 100;
  auto r = a.tick(Command::home);
  const S dt = a.config.sample_time;
  const auto begin = a.now.angle;
  const auto turn = [&](int joint, S rate) {
    a.now.rate[joint] = rate;
    a.now.angle[joint] += rate * dt;
    r = a.tick();
  };
  const auto until = [&](const char* stage, const auto& reached, const auto& move) {
    int n = 0;
    while (!reached() && r.fault == Fault::none && ++n < 4000) move();
    ASSERT_TRUE(reached()) << stage << ": " << name(r.fault);
  };
  // On its stop each joint stands under the whole torque, leaves it by more than back_off and comes back.
  for (const int j : {0, second}) {
    const S to = j == 0 ? S(-0.25) : S(0.25);  // the stop
    const auto pressing = [&](S sign) { return r.torque[j] * sign > S(0.499); };
    const S way = to > S(0) ? S(1) : S(-1);
    until(
        "away", [&] { return pressing(-way); }, [&] { turn(j, S(0)); });
    until(
        "off", [&] { return pressing(way); },
        [&] { turn(j, std::abs(a.now.angle[j] - begin[j]) > S(0.07) ? S(0) : -to); });
    until(
        "back", [&] { return way * (a.now.angle[j] - begin[j]) > -S(0.001); }, [&] { turn(j, to); });
    a.now.rate[j] = S(0);
  }
  until(
      "met", [&] { return a.homing->met(); }, [&] { turn(second, S(0)); });
  a.now.rate[second] =
      S(0.035);  // or it would stand under the whole torque, which is the fault of another test
  until(
      "the first is off", [&] { return a.now.angle[0] - begin[0] > S(0.07); },
      [&] {
        a.now.angle[second] += a.now.rate[second] * dt;
        turn(0, S(0.25));
      });
  a.now.rate[0] = S(0);
  until(
      "gives way", [&] { return r.state == State::halting; },
      [&] {
        EXPECT_FALSE(r.stage_done);
        turn(second, S(0.25));
      });
  EXPECT_EQ(r.fault, Fault::home_no_stop);
  EXPECT_FALSE(r.stage_done) << "the brake has not begun";
  for (int n = 0; n < 5; ++n) {
    turn(second, S(0.25));
    EXPECT_EQ(r.state, State::halting);
  }
  EXPECT_LT(r.torque[second], S(0)) << "it brakes";
  turn(second, S(0));
  EXPECT_TRUE(r.stage_done);
  turn(second, S(0));
  EXPECT_EQ(r.state, State::fault);
}

// ---- the interface

TEST(ControllerTold, TheOddEncoderIsToldAsADriveMotorsFirst) {
  for (const auto& [motors, axes] :
       {std::pair{Motors::base, std::array{0, 2, 1, 3}}, {Motors::all, std::array{0, 1, 2, 3}}}) {
    for (std::uint8_t joint = 0; joint <= 4; ++joint) {
      Alone<Five> a;
      a.config.sensors = Sensors::all;
      a.config.motors = motors;
      a.config.fuse = &Constant::fuse;
      Constant::odd = joint;
      a.now.rate.setConstant(0.25);
      auto r = a.tick(Command::enable);
      EXPECT_EQ(r.fault, Fault::loop_not_closed);
      Constant::odd = 0;
      a.tick();
      EXPECT_EQ(a.controller->odd_encoder(), joint) << "the last one that explained it";
      const auto told = report_of(*a.controller, r, a.now);
      EXPECT_EQ(told.encoder, joint == 0 ? link::Report{}.encoder : axes[joint - 1U]);
      r.fault = Fault::drive_error;
      EXPECT_EQ(report_of(*a.controller, r, a.now).encoder, link::Report{}.encoder) << "not of its making";
      EXPECT_EQ(told.joints, motors == Motors::base ? 2 : 4);
      for (unsigned i = told.joints; i < 4; ++i) EXPECT_EQ(told.angle[i], 0.0F);
    }
  }
}

/// Gains of angles and of positions each go to their channels; a layer follows where there is a gain and the
/// law is the implicit one.
TYPED_TEST(ControllerStart, GainsGoToTheChannelsOfTheirKind) {
  using S = typename TypeParam::Scalar;
  const std::array<link::Bounds, link::gain_count> free{{{0, 9}, {0, 9}, {0, 9}, {0, 9}}};
  for (const auto& [with_gain, reaching] :
       {std::pair{true, Reaching::implicit}, {false, Reaching::implicit}, {true, Reaching::saturation}}) {
    const float position = with_gain ? 0.5F : 0.0F, angle = with_gain ? 0.25F : 0.0F;
    const bool derived = with_gain && reaching == Reaching::implicit;
    const link::Parameters p({2.0F, 3.0F, position, angle}, free);
    Gains<TypeParam> g;
    g.layer.setConstant(7);
    g.independent.layer = 7;
    set_gains(g, p, reaching, S(0.125), S(1));
    for (int i = 0; i < TypeParam::channels; ++i) {
      const bool turns = TypeParam::is_angle(i);
      EXPECT_EQ(g.lambda[i], turns ? S(3) : S(2)) << i;
      EXPECT_EQ(g.k[i], turns ? angle : position) << i;
      EXPECT_EQ(g.layer[i], derived ? S(0.25) * g.k[i] : S(7)) << i;
    }
    const bool joints = TypeParam::joints == 2;  // the arm's coordinates are angles
    EXPECT_EQ(g.independent.lambda, joints ? S(3) : S(2));
    EXPECT_EQ(g.independent.k, joints ? angle : position);
    EXPECT_EQ(g.independent.layer, derived ? S(0.25) * g.independent.k : S(7));
  }
}

}  // namespace
}  // namespace esmc::test
