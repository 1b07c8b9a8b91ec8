/// Every fault of the cycle, provoked through frames: zero torque in the same tick, and none after.

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "tests/support/cycle_rig.hpp"

namespace {

using namespace esmc;
using hal::SendStatus;
using test::Rig;
using test::Setup;
using test::setup;

using Five = FiveBar<double>;
using Arm = Rr<float>;
constexpr float infinity = std::numeric_limits<float>::infinity();

template <class M>
class CycleFault : public testing::Test {};
using Machines = testing::Types<Five, Arm>;
TYPED_TEST_SUITE(CycleFault, Machines);

// ---- every fault

template <class M>
struct Case {
  Fault fault;
  std::function<void(Rig<M>&)> provoke;  ///< in the running cycle; the next tick must fail
  std::function<void(Setup<M>&)> prepare = [](Setup<M>&) {};  ///< before the rig is built
};

template <class M>
void heal(Rig<M>& rig) {
  const Setup<M> s = setup<M>();
  rig.angle = s.angle;
  rig.rate = s.rate;
  rig.error = {};
  rig.sends_encoder.fill(true);
  rig.sends_heartbeat.fill(true);
  rig.bus.answer(SendStatus::ok);
}
/// An encoder frame of axis 0 with these numbers, after the healthy one: the newest counts.
template <class M>
std::function<void(Rig<M>&)> encoder_says(float position, float velocity) {
  return [=](Rig<M>& rig) {
    rig.sends_encoder[0] = false;
    rig.bus.push(test::encoder(rig.node(0), position, velocity));
  };
}
template <class M>
std::function<void(Rig<M>&)> at(const std::array<double, static_cast<std::size_t>(M::joints)>& angle) {
  return [=](Rig<M>& rig) { rig.angle = angle; };
}

template <class M>
std::vector<Case<M>> common_cases() {
  using S = typename M::Scalar;
  std::vector<Case<M>> all{
      {Fault::stale_feedback,
       [](Rig<M>& rig) {
         rig.sends_encoder[1] = false;
         rig.tick();
         rig.tick();
       }},
      {Fault::malformed_frame,
       [](Rig<M>& rig) { rig.bus.push(test::message(rig.node(1), test::cmd_heartbeat, 0, 8, 7)); }},
      {Fault::heartbeat_lost,
       [](Rig<M>& rig) {
         rig.sends_heartbeat[1] = false;
         for (int i = 0; i < 20; ++i) rig.tick();
       }},
      {Fault::drive_error, [](Rig<M>& rig) { rig.error[1] = 0x01000000; }},
      {Fault::emergency_stop, [](Rig<M>& rig) { rig.error[1] = 0x02000000; }},
      {Fault::emergency_stop, [](Rig<M>& rig) { rig.bus.push(test::message(rig.node(1), 0x02, 0, 0, 0)); }},
      {Fault::drive_disarmed, [](Rig<M>& rig) { rig.state[0] = 1; }},
      {Fault::drive_disarmed, [](Rig<M>& rig) { rig.state[1] = 0; }},
      {Fault::bus_off,
       [](Rig<M>& rig) {
         rig.bus.answer(SendStatus::bus_off);
         rig.tick();
         rig.bus.answer(SendStatus::ok);
       }},
      {Fault::joint_speed, [](Rig<M>& rig) { rig.rate[0] = 50.1; }},
      {Fault::joint_speed, [](Rig<M>& rig) { rig.rate[rig.joint_of(1)] = -50.1; }},
      {Fault::joint_angle, [](Rig<M>& rig) { rig.angle[rig.joint_of(1)] = 1.5; },
       [](Setup<M>& s) { s.controller.limits.joint_angle[1].upper = S(1.4); }},
      {Fault::joint_angle, [](Rig<M>& rig) { rig.angle[0] = 0.05; },
       [](Setup<M>& s) { s.controller.limits.joint_angle[0].lower = S(0.1); }}};
  for (const float bad : {NAN, -NAN, infinity, -infinity}) {
    all.push_back({Fault::feedback_not_finite, encoder_says<M>(bad, 0)});
    all.push_back({Fault::feedback_not_finite, encoder_says<M>(0, bad)});
  }
  return all;
}

template <class M>
std::vector<Case<M>> cases();

template <>
std::vector<Case<Five>> cases<Five>() {
  auto all = common_cases<Five>();
  const auto pose = [](double x, double y, int m1, int m2) {
    return at<Five>(test::five_bar_angles(x, y, m1, m2));
  };
  // leg 1 stretched to 0.01 rad; distal bars within 2 degrees of one line; a leg bent to the other side
  const double phi = 1.9;
  const double x = test::half_base + test::bar1 * std::cos(phi) + test::bar2 * std::cos(phi + 0.01);
  const double y = test::bar1 * std::sin(phi) + test::bar2 * std::sin(phi + 0.01);
  all.insert(all.end(), {{Fault::loop_not_closed, at<Five>({0.0, 0.0, 0.0, 0.0})},
                         {Fault::type1_singularity, pose(x, y, 1, 1)},
                         {Fault::type2_singularity, at<Five>({0.4115, 0.0, 0.4115, 0.0})},
                         {Fault::working_mode, pose(0.1, 0.2, -1, 1)},
                         {Fault::working_mode, pose(0.1, 0.2, 1, -1)},
                         {Fault::workspace, pose(0.0, 0.21, 1, 1),
                          [](Setup<Five>& s) { s.controller.limits.workspace_y.upper = 0.2; }},
                         {Fault::workspace, pose(-0.02, 0.18, 1, 1),
                          [](Setup<Five>& s) { s.controller.limits.workspace_x.lower = -0.01; }}});
  return all;
}
template <>
std::vector<Case<Arm>> cases<Arm>() {
  auto all = common_cases<Arm>();
  all.insert(all.end(), {{Fault::type1_singularity, at<Arm>({0.4, 0.015})},
                         {Fault::working_mode, at<Arm>({0.4, -0.9})},
                         {Fault::workspace, at<Arm>({0.1, 0.3}),
                          [](Setup<Arm>& s) { s.controller.limits.workspace_x.upper = 0.25F; }},
                         {Fault::workspace, at<Arm>({-0.8, 0.9}),
                          [](Setup<Arm>& s) { s.controller.limits.workspace_y.lower = -0.05F; }}});
  return all;
}

TYPED_TEST(CycleFault, TakesAllTorqueInTheSameTickAndStaysUntilReset) {
  for (const auto& c : cases<TypeParam>()) {
    SCOPED_TRACE(name(c.fault));
    Setup<TypeParam> s = setup<TypeParam>();
    c.prepare(s);
    Rig<TypeParam> rig(s);
    ASSERT_TRUE(rig.start());
    for (int i = 0; i < 5; ++i) ASSERT_EQ(rig.tick().state, State::running);
    ASSERT_FALSE(rig.all_zero());
    c.provoke(rig);
    const auto r = rig.tick();
    EXPECT_EQ(r.state, State::fault);
    EXPECT_EQ(r.fault, c.fault) << name(r.fault);
    EXPECT_TRUE(r.torque.isZero(0));
    EXPECT_TRUE(rig.all_zero());
    for (std::size_t i = 0; i < 2; ++i) EXPECT_TRUE(rig.asked(i, 1) || rig.state[i] == 1) << "axis " << i;
    heal(rig);
    for (const Command command : {Command::none, Command::enable, Command::stop, Command::enable}) {
      rig.bus.push(test::encoder(rig.node(0), NAN, NAN));  // other faults do not take its place
      rig.bus.push(test::message(rig.node(0), test::cmd_encoder, 0, 0, 3));
      for (int i = 0; i < 30; ++i) {
        const auto later = rig.tick(command);
        ASSERT_EQ(later.state, State::fault);
        ASSERT_EQ(later.fault, c.fault);
        ASSERT_TRUE(rig.all_zero());
        ASSERT_FALSE(rig.asked(0, 8) || rig.asked(1, 8));
      }
    }
    EXPECT_EQ(rig.tick(Command::reset).state, State::disabled);
    if (c.fault == Fault::bus_off) continue;  // CycleFault.BusOffIsOverOnceTheBusIsBackAndTheOperatorResets
    ASSERT_TRUE(rig.start(200));
    EXPECT_FALSE(rig.all_zero());
  }
}

TYPED_TEST(CycleFault, ReferenceOutOfReachAndTorqueNotFiniteStrikeBeforeAnyTorque) {
  using S = typename TypeParam::Scalar;
  Setup<TypeParam> far = setup<TypeParam>(), wild = setup<TypeParam>();
  far.controller.reference = {.kind = ReferenceKind::hold_start, .space = ReferenceSpace::effector};
  far.controller.reference.kind = ReferenceKind::sine;
  far.controller.reference.centre = {S(0), S(1)};
  wild.controller.gains.k.setConstant(std::numeric_limits<S>::infinity());
  for (const auto& [s, fault] :
       {std::pair{far, Fault::reference_unreachable}, std::pair{wild, Fault::torque_not_finite}}) {
    Rig<TypeParam> rig(s);
    EXPECT_FALSE(rig.start());
    EXPECT_EQ(rig.cycle.supervisor().fault(), fault) << name(rig.cycle.supervisor().fault());
    EXPECT_TRUE(rig.all_zero());
  }
}

/// What was news while nothing could be raised is not held against a later start.
TYPED_TEST(CycleFault, AFloodWhileTheBusWasOffIsNotHeardOfLater) {
  Rig<TypeParam, test::BasicFakeBus<4096>> rig;
  rig.bus.answer(SendStatus::bus_off);
  rig.tick();
  for (int n = 0; n < 1100; ++n) rig.bus.push(test::message(2, 0, 0, 0, 0));
  rig.tick();
  rig.bus.answer(SendStatus::ok);
  rig.tick();
  EXPECT_EQ(rig.tick(Command::enable).state, State::enabling) << name(rig.cycle.supervisor().fault());
}

TYPED_TEST(CycleFault, BusOffIsOverOnceTheBusIsBackAndTheOperatorResets) {
  Rig<TypeParam> rig;
  ASSERT_TRUE(rig.start());
  rig.bus.answer(SendStatus::bus_off);
  rig.tick();
  EXPECT_EQ(rig.tick().fault, Fault::bus_off);
  rig.bus.answer(SendStatus::ok);
  rig.tick();
  rig.tick();
  rig.tick(Command::reset);
  EXPECT_TRUE(rig.start()) << name(rig.cycle.supervisor().fault());
}

TYPED_TEST(CycleFault, ABusThatWasOffBeforeEnablingIsNotHeldAgainstALiveOne) {
  Rig<TypeParam> rig;
  rig.bus.answer(SendStatus::bus_off);  // the node starts before the cable is plugged in
  for (int i = 0; i < 5; ++i) EXPECT_EQ(rig.tick().state, State::disabled);
  rig.bus.answer(SendStatus::ok);
  for (int i = 0; i < 5; ++i) rig.tick();
  EXPECT_TRUE(rig.start()) << name(rig.cycle.supervisor().fault());
}

TYPED_TEST(CycleFault, BusOffInTheMiddleOfATickIsAFaultInTheNext) {
  for (const std::size_t accepted : {0U, 1U}) {
    Rig<TypeParam> rig;
    ASSERT_TRUE(rig.start());
    rig.bus.answer(SendStatus::bus_off, accepted);
    rig.tick();
    rig.bus.answer(SendStatus::ok);
    const auto r = rig.tick();
    EXPECT_EQ(r.fault, Fault::bus_off) << accepted;
    EXPECT_TRUE(rig.all_zero());
  }
}

TYPED_TEST(CycleFault, IdleIsAskedForUntilItIsReportedAndAgainIfAnAxisRearms) {
  Rig<TypeParam> rig;
  ASSERT_TRUE(rig.start());
  rig.obedient = false;
  rig.error[0] = 1;
  for (int i = 0; i < 50; ++i) {
    rig.tick();
    ASSERT_TRUE(rig.asked(0, 1) && rig.asked(1, 1));
  }
  rig.state = {};
  rig.state.fill(1);
  rig.tick();
  EXPECT_FALSE(rig.asked(0, 1) || rig.asked(1, 1));
  rig.state[1] = 8;
  rig.tick();
  EXPECT_TRUE(rig.asked(1, 1));
}

// ---- ages, to the tick

TYPED_TEST(CycleFault, MissedSamplesAreExtrapolatedUpToTheLimitAndNotOneMore) {
  for (const std::uint32_t limit : {0U, 1U, 2U, 7U}) {
    for (unsigned silent = 1; silent < 4; ++silent) {  // axis 0, axis 1, both
      Setup<TypeParam> s = setup<TypeParam>();
      s.controller.limits.max_age_ticks = limit;
      s.rate.fill(0.5);
      Rig<TypeParam> rig(s);
      ASSERT_TRUE(rig.start());
      for (std::size_t i = 0; i < 2; ++i) rig.sends_encoder[i] = (silent >> i & 1U) == 0;
      for (std::uint32_t missed = 1; missed <= limit; ++missed) {
        const auto r = rig.tick();
        ASSERT_EQ(r.state, State::running) << limit << ' ' << silent << ' ' << missed;
        EXPECT_FALSE(rig.all_zero());
        EXPECT_EQ(rig.cycle.sample().age_ticks[0], (silent & 1U) != 0 ? missed : 0U);
      }
      EXPECT_EQ(rig.tick().fault, Fault::stale_feedback) << limit << ' ' << silent;
      EXPECT_TRUE(rig.all_zero());
    }
  }
}

/// A motor whose encoder nobody needs is missed all the same: its share of the torque is.
TEST(CycleFaultOfFour, AMotorThatIsNotHeardIsStaleAlsoWhereItsEncoderIsNotUsed) {
  for (const std::uint32_t limit : {0U, 2U, 5U}) {
    for (std::size_t silent = 0; silent < 4; ++silent) {
      auto s = setup<FiveBar<double>>();
      s.controller.motors = Motors::all;
      s.controller.limits.max_age_ticks = limit;
      Rig<FiveBar<double>> rig(s);
      ASSERT_TRUE(rig.start());
      rig.sends_encoder[silent] = false;  // its heartbeats go on
      for (std::uint32_t missed = 1; missed <= limit; ++missed)
        ASSERT_EQ(rig.tick().state, State::running) << silent;
      EXPECT_EQ(rig.tick().fault, Fault::stale_feedback) << silent;
      EXPECT_TRUE(rig.all_zero());
    }
  }
}

TYPED_TEST(CycleFault, ASampleInTimeStartsTheCountAgain) {
  Rig<TypeParam> rig;
  ASSERT_TRUE(rig.start());
  for (int i = 0; i < 300; ++i) {
    rig.sends_encoder[0] = i % 3 == 2;
    rig.sends_encoder[1] = i % 3 == 1;
    ASSERT_EQ(rig.tick().state, State::running) << i;
  }
}

TYPED_TEST(CycleFault, AHeartbeatMayBeAsOldAsItsLimitAndNotOlder) {
  for (const std::uint32_t limit : {1U, 5U, 20U}) {
    for (const std::size_t axis : {0U, 1U}) {
      Setup<TypeParam> s = setup<TypeParam>();
      s.heartbeat_age_ticks_max = limit;
      Rig<TypeParam> rig(s);
      ASSERT_TRUE(rig.start());
      rig.sends_heartbeat[axis] = false;
      for (std::uint32_t i = 0; i < limit; ++i) ASSERT_EQ(rig.tick().state, State::running) << i;
      EXPECT_EQ(rig.tick().fault, Fault::heartbeat_lost);
      EXPECT_TRUE(rig.all_zero());
    }
  }
}

TYPED_TEST(CycleFault, StaleSamplesAreNoFaultBeforeItRunsAndOneAtOnceWhenItDoes) {
  Rig<TypeParam> rig;
  rig.sends_encoder.fill(false);
  rig.tick(Command::enable);
  rig.tick();
  EXPECT_EQ(rig.cycle.supervisor().state(), State::enabling);
  EXPECT_TRUE(rig.until(State::fault, 4));
  EXPECT_EQ(rig.cycle.supervisor().fault(), Fault::stale_feedback);
  EXPECT_TRUE(rig.all_zero());
}

}  // namespace
