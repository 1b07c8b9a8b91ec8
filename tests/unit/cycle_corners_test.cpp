/// The cycle where its other tests do not lead: corners that structure.coverage found.

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>

#include "firmware/cycle/enabling_wait.hpp"
#include "firmware/cycle/plausibility.hpp"
#include "firmware/cycle/sign_test.hpp"
#include "tests/support/cycle_rig.hpp"

namespace esmc::test {
namespace {

using Five = FiveBar<double>;
using Arm = Rr<float>;

bool hears(const hal::IdFilters& filters, std::uint32_t id) {
  bool heard = false;
  for (const hal::IdFilter& f : filters.list()) heard = heard || f.matches({.id = id});
  return heard;
}

TEST(CycleCorners, FiltersPassTheDrivesAndTheLinkAndNothingElse) {
  auto s = setup<Five>();
  s.link.base_id = 0x780;
  const Rig<Five> rig(s);
  for (std::uint32_t id = 0; id < 0x800; ++id) {
    const std::uint32_t node = id >> 5U;
    const bool ours = node == mountings[0].node || node == mountings[1].node || (id >= 0x780 && id < 0x7A0);
    const bool broadcast = node == 0x3F || node == 0;
    if (broadcast) continue;
    EXPECT_EQ(hears(rig.cycle.filters(), id), ours) << id;
  }
}

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

/// A drive that does not answer gets its request again after retry_ticks, or at once where it is said so.
TEST(CycleCorners, AskedAgainBeforeItsTime) {
  Rig<Five> rig;
  rig.obedient = false;
  rig.tick(Command::enable);
  const auto next_request = [&] {
    int ticks = 1;
    for (rig.tick(); !rig.asked(0, axis_closed_loop) && ticks < 400; ++ticks) rig.tick();
    return ticks;
  };
  next_request();
  const int usual = next_request();
  EXPECT_GT(usual, 100);
  rig.cycle.ask_again();
  EXPECT_LT(next_request(), usual / 2);
}

/// A drive that has not been heard gets the request although the other one has, which then waits for it.
TEST(CycleCorners, OnlyTheSilentDriveIsAskedWhileItIsMissing) {
  auto s = setup<Five>();
  s.controller.enabling_ticks_max = 50;
  Rig<Five> rig(s);
  rig.sends_heartbeat[1] = rig.sends_encoder[1] = false;
  rig.tick(Command::enable);
  bool silent = false, heard = false;
  for (int i = 0; i < 20; ++i) {
    rig.tick();
    silent = silent || rig.bus.sent().size() > 0;
    heard = heard || rig.asked(0, axis_closed_loop);
  }
  EXPECT_TRUE(silent);
  EXPECT_FALSE(heard);
  EXPECT_EQ(rig.cycle.supervisor().state(), State::enabling);
  for (int i = 0; i < 60; ++i) rig.tick();
  EXPECT_EQ(rig.cycle.supervisor().fault(), Fault::enabling_timeout);
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

TEST(EnablingWait, ProgressOfADriveStopsTheClockAndTheLastOneResetsIt) {
  EnablingWait<4> wait;
  const auto tick = [&](bool second, bool sets_up) {
    return wait.expired(
        2, 1, 10, [&](int i) { return i == 0 || second ? 0U : 5U; }, [&](int) { return sets_up; });
  };
  for (int i = 0; i < 9; ++i) EXPECT_FALSE(tick(false, true)) << "not every drive is there: it counts";
  EXPECT_FALSE(wait.all);
  EXPECT_FALSE(tick(true, false)) << "from the start, with the last drive";
  for (int i = 0; i < 20; ++i) EXPECT_FALSE(tick(true, true));
  for (int i = 0; i < 8; ++i) EXPECT_FALSE(tick(true, false));
  EXPECT_TRUE(tick(true, false));
  EXPECT_TRUE(wait.all && wait.waits);
}

/// What the bus does not take for good is counted, and is no fault by itself.
TEST(CycleCorners, RefusedFramesAreCounted) {
  Rig<Five> rig;
  rig.start();
  rig.bus.answer(hal::SendStatus::refused);
  rig.tick();
  EXPECT_EQ(rig.cycle.counters().send_failed, 2U);
  EXPECT_EQ(rig.cycle.supervisor().state(), State::running);
}

/// Whatever a frame has waited: its age in whole ticks and the rest are the time it waited.
TEST(CycleCorners, AgeAndPhaseAreTheTimeThatASampleWaited) {
  struct Aged : FakeBus {
    std::uint32_t age_us = 0;
    [[nodiscard]] std::uint32_t frame_age_us() const { return age_us; }
  };
  for (std::uint32_t us = 1; us < 400'000; us += us < 4000 ? 1 : 997) {
    Rig<Arm, Aged> rig;
    rig.bus.age_us = us;
    rig.tick();
    const auto& now = rig.cycle.sample();
    const double waited = now.age_ticks[0] * 1e-3 + static_cast<double>(now.phase[0]);
    ASSERT_NEAR(waited, static_cast<double>(us) * 1e-6, 1e-6 + 1e-6 * waited) << us;
    ASSERT_GE(now.phase[0], 0.0F) << us;
    ASSERT_LE(now.phase[0], 1.000001e-3F) << us;
  }
}

TEST(CycleCorners, AfterASecondWithoutASampleThereIsNoPrediction) {
  SampleJumpCheck<Arm> check;
  Sample<Arm> now;
  now.angle.setConstant(0.1F);
  check.keep(now, 1);
  now.angle.setConstant(2.0F);
  EXPECT_FALSE(check.plausible(0, now, 0.01F, 1e-3F));
  Sample<Arm> silent = now;
  for (std::uint32_t n = 1; n <= 1002; ++n) {
    silent.age_ticks.fill(n);
    check.keep(silent, 1);
    EXPECT_EQ(check.plausible(0, now, 1e-4F, 1e-3F), n > 1000) << n;
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

TEST(CycleCorners, AShortJoinIsLookedAtOnlyAsLongAsItTakes) {
  auto s = setup<Five>();
  s.controller.join_ticks = 8;
  s.controller.limits.joint_speed = 1e3;
  s.controller.torque_limit.setConstant(1e6);
  s.controller.reference = {.kind = ReferenceKind::hold_start};
  Rig<Five> rig(s);
  ASSERT_TRUE(rig.start());
  for (int n = 0; n < 30; ++n) EXPECT_EQ(rig.tick().fault, Fault::none) << n;
}

TEST(CycleCorners, FourMotorsAreNotTestedForTheirSign) {
  auto s = setup<Five>();
  s.controller.sign_test_move = 0.01;
  EXPECT_TRUE(Controller<Five>(s.controller).supervision().sign_test);
  s.controller.motors = Motors::all;
  EXPECT_FALSE(Controller<Five>(s.controller).supervision().sign_test);
}

// ---- the sign test on an arm whose inertia is written down here

struct SignBench {
  static constexpr double limit = 2.0, move = 0.004, tick = 1e-3;
  RrParams<double> p{{0.2, 0.15, 0.09, 0.07, 0.4, 0.3, 2e-3, 1e-3, 0.0, 0.0, 0.0, 0.0}, 0.0};
  Rr<double> arm{p};
  Vec2<double> angle{0.4, 0.9};
  SignTest<Rr<double>> test{move, tick};

  /// Accelerations of both joints under a torque on the first one.
  [[nodiscard]] Vec2<double> answer(double torque) const {
    const double c2 = std::cos(angle[1]);
    const double h22 = 0.3 * 0.07 * 0.07 + 1e-3, h12 = h22 + 0.3 * 0.2 * 0.07 * c2;
    const double h11 = 0.4 * 0.09 * 0.09 + 2e-3 + 0.3 * (0.2 * 0.2 + 2 * 0.2 * 0.07 * c2) + h22;
    const double det = h11 * h22 - h12 * h12;
    return {h22 * torque / det, -h12 * torque / det};
  }
  /// Verdict of the first half where the joints move `share` of what they should.
  SignTest<Rr<double>>::Verdict first_half(const Vec2<double>& share) {
    const Vec2<double> a = answer(0.05 * limit);
    for (int n = 0; n < 500; ++n) {
      const double t = n * tick;
      const Vec2<double> now = angle + (a * (t * t / 2)).cwiseProduct(share);
      Vec2<double> torque(0.0, 0.0);
      const auto verdict = test.step(arm, arm.pose(angle), now, Vec2<double>::Zero(), {limit, limit}, torque);
      if (verdict != SignTest<Rr<double>>::Verdict::going_on) return verdict;
      if (torque[0] < 0) return verdict;  // the second half has begun
    }
    return SignTest<Rr<double>>::Verdict::failed;
  }
};

TEST(SignTestCorners, EachPartOfTheAnswerIsJudged) {
  using V = SignTest<Rr<double>>::Verdict;
  EXPECT_EQ(SignBench().first_half({1.0, 1.0}), V::going_on);
  EXPECT_EQ(SignBench().first_half({0.3, 0.3}), V::going_on);
  EXPECT_EQ(SignBench().first_half({0.2, 0.2}), V::failed);
  EXPECT_EQ(SignBench().first_half({3.9, 3.9}), V::going_on);
  EXPECT_EQ(SignBench().first_half({4.1, 4.1}), V::failed);
  EXPECT_EQ(SignBench().first_half({0.2, 1.0}), V::failed) << "the motor's own joint hardly moved";
  EXPECT_EQ(SignBench().first_half({5.0, 1.0}), V::failed) << "and here too far, the other as expected";
  EXPECT_EQ(SignBench().first_half({-1.0, -1.0}), V::failed);
}

TEST(SignTestCorners, APoseThatIsNoNumberIsNotTested) {
  SignBench b;
  b.angle[1] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(b.first_half({1.0, 1.0}), SignTest<Rr<double>>::Verdict::failed);
}

}  // namespace
}  // namespace esmc::test
