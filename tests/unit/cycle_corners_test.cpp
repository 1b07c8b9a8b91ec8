/// The cycle where its other tests do not lead: corners that structure.coverage found.

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <utility>

#include "tests/support/cycle_rig.hpp"

namespace esmc::test {
namespace {

using Five = FiveBar<double>;
using Arm = Rr<float>;

TEST(CycleCorners, FramesOfOthersAreCountedWithAndWithoutALink) {
  for (const std::uint32_t base : {0U, 0x780U}) {
    auto s = setup<Five>();
    s.link.base_id = base;
    Rig<Five> rig(s);
    rig.bus.push({.id = 0x555, .size = 8});
    rig.bare_tick();
    EXPECT_EQ(rig.cycle.counters().not_mine, 1U);
    EXPECT_EQ(std::as_const(rig.cycle).link().active(), base != 0);
  }
}

TEST(CycleCorners, ASetHasBegunWithItsFirstFrameAndIsCompleteWithItsLast) {
  Rig<Five> rig;
  rig.start();
  EXPECT_FALSE(rig.cycle.set_begun());
  const auto one = [&](std::size_t axis) {
    rig.push_heartbeat(axis);
    rig.push_encoder(axis);
    rig.cycle.receive(rig.bus);
  };
  rig.cycle.receive(rig.bus);
  EXPECT_FALSE(rig.cycle.set_begun());
  one(0);
  EXPECT_TRUE(rig.cycle.set_begun());
  EXPECT_FALSE(rig.cycle.complete());
  one(1);
  EXPECT_TRUE(rig.cycle.complete());
  EXPECT_FALSE(rig.cycle.all_idle());
  rig.tick(Command::stop);
  rig.tick();
  rig.tick();
  EXPECT_TRUE(rig.cycle.all_idle());
}

/// In lockstep a tick without an answer counts the time that has passed, not one tick.
TEST(CycleCorners, TimeCountsWithoutAnswers) {
  const auto ticks_to_fault = [](std::uint32_t us) {
    auto s = setup<Five>();
    s.controller.enabling_ticks_max = 40;
    Rig<Five> rig(s);
    rig.cycle.enable_input(true);
    rig.bare_tick(Command::enable);
    for (int n = 1; n < 1000; ++n) {
      rig.cycle.time_passed(us);
      rig.bare_tick(Command::none, false);
      if (rig.cycle.supervisor().fault() == Fault::enabling_timeout) return n;
    }
    return 1000;
  };
  EXPECT_NEAR(ticks_to_fault(1000), 40, 2);
  EXPECT_NEAR(ticks_to_fault(5000), 8, 2);
  EXPECT_EQ(ticks_to_fault(0), 1000);
}

/// Whatever a frame has waited: its age in whole ticks and the rest are the time it waited.
TEST(CycleCorners, AgeAndPhaseAreTheTimeThatASampleWaited) {
  for (std::uint32_t us = 1; us < 400'000; us += us < 4000 ? 1 : 997) {
    Rig<Arm, TimedBus> rig;
    rig.bus.age_us = us;
    rig.tick();
    const auto& now = rig.cycle.sample();
    const double waited = now.age_ticks[0] * 1e-3 + static_cast<double>(now.phase[0]);
    ASSERT_NEAR(waited, static_cast<double>(us) * 1e-6, 1e-6 + 1e-6 * waited) << us;
    ASSERT_GE(now.phase[0], 0.0F) << us;
    ASSERT_LE(now.phase[0], 1.000001e-3F) << us;
  }
}

// ---- a halt, and what may go wrong in it

Setup<Five> halting(std::uint32_t ticks) {
  auto s = setup<Five>();
  s.controller.halt_ticks = ticks;
  s.controller.after_halt = AfterHalt::hold;
  s.controller.limits.joint_speed = 10.0;
  return s;
}

TEST(CycleCorners, AStopWhoseWayTheLegsCannotGoIsAFault) {
  Rig<Five> rig(halting(2000));
  ASSERT_TRUE(rig.start());
  rig.rate[0] = 9.0;  // a turn and more until rest
  rig.rate[2] = 9.0;
  rig.tick(Command::halt);
  for (int n = 0; n < 2000 && rig.cycle.supervisor().state() == State::halting; ++n) rig.tick();
  EXPECT_EQ(rig.cycle.supervisor().fault(), Fault::halt_failed);
  rig.tick();
  EXPECT_TRUE(rig.all_zero());
}

/// Each joint is judged, and a mechanism that comes to rest in the last moment has not failed.
TEST(CycleCorners, RestInTheLastMomentIsRest) {
  for (const std::size_t joint : {0U, 2U}) {
    for (const int late : {0, 1}) {
      Rig<Five> rig(halting(10));
      ASSERT_TRUE(rig.start());
      rig.rate[joint] = 0.5;  // 2 % of joint_speed is 0.2
      rig.tick(Command::halt);
      const int last = 40 + late;
      for (int n = 1; n < last && rig.cycle.supervisor().state() == State::halting; ++n) rig.tick();
      rig.rate[joint] = 0.0;
      for (int n = 0; n < 3; ++n) rig.tick();
      EXPECT_EQ(rig.cycle.supervisor().fault(), late == 0 ? Fault::none : Fault::halt_failed) << joint;
      EXPECT_EQ(rig.cycle.supervisor().state() == State::holding, late == 0) << joint;
    }
  }
}

TEST(CycleCorners, AJoiningWayOutOfReachIsNotBegun) {
  auto s = setup<Five>();
  s.controller.join_ticks = 1000;
  s.controller.limits.joint_speed = 1e6;
  s.controller.torque_limit.setConstant(1e6);
  s.controller.reference.centre = {0.0, 3.0};
  Rig<Five> rig(s);
  rig.start();
  for (int n = 0; n < 20; ++n) rig.tick();
  EXPECT_EQ(rig.cycle.supervisor().fault(), Fault::join_infeasible);
}

TEST(CycleCorners, FourMotorsAreNotTestedForTheirSign) {
  auto s = setup<Five>();
  s.controller.sign_test_move = 0.01;
  EXPECT_TRUE(Controller<Five>(s.controller).supervision().sign_test);
  s.controller.motors = Motors::all;
  EXPECT_FALSE(Controller<Five>(s.controller).supervision().sign_test);
}

}  // namespace
}  // namespace esmc::test
