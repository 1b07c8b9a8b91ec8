/// What fits the confirmed zero, the command and the clock: the cycle on drives made of bytes, and the parts
/// alone.

#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/cycle_rig.hpp"

namespace {

using esmc::Command;
using esmc::Fault;
using esmc::FiveBar;
using esmc::State;
using Five = FiveBar<double>;
using Rig = esmc::test::Rig<Five>;

// ---- zero

/// Encoders that count from where they were switched on: off by 0.3 and -0.2 rad.
esmc::test::Setup<Five> relative() {
  auto s = esmc::test::setup<Five>();
  s.zero_absolute = false;
  for (int j = 0; j < 4; ++j) s.zero_pose[j] = s.angle[static_cast<std::size_t>(j)];
  s.angle[0] += 0.3;
  s.angle[2] -= 0.2;
  return s;
}

TEST(ZeroPose, WithoutItsConfirmationThereIsNoArming) {
  Rig rig(relative());
  rig.tick(Command::enable);
  EXPECT_EQ(rig.cycle.supervisor().state(), State::fault);
  EXPECT_EQ(rig.cycle.supervisor().fault(), Fault::zero_not_confirmed);
  EXPECT_TRUE(rig.all_zero());
}

TEST(ZeroPose, ConfirmedInThePoseAnglesAreThoseOfThePose) {
  const auto truth = esmc::test::setup<Five>().angle;
  Rig rig(relative());
  rig.tick();
  rig.tick(Command::confirm_zero);
  ASSERT_TRUE(rig.start());
  EXPECT_NEAR(rig.cycle.sample().angle[0], truth[0], 1e-6);
  EXPECT_NEAR(rig.cycle.sample().angle[2], truth[2], 1e-6);
  Rig absolute;
  absolute.tick();
  absolute.tick(Command::confirm_zero);
  ASSERT_TRUE(absolute.start()) << "nothing to confirm";
  const auto a = absolute.tick(), b = rig.tick();
  EXPECT_NEAR(a.torque[0], b.torque[0], 1e-3) << "the same torque as with absolute encoders";
  EXPECT_NEAR(a.torque[2], b.torque[2], 1e-3);
}

TEST(ZeroPose, IsNotConfirmedWhileRunningNorTwiceAsFar) {
  Rig twice(relative());
  twice.tick();
  twice.tick(Command::confirm_zero);
  twice.tick(Command::confirm_zero);
  ASSERT_TRUE(twice.start());
  EXPECT_NEAR(twice.cycle.sample().angle[0], esmc::test::setup<Five>().angle[0], 1e-6);
  twice.angle[0] += 0.01;
  twice.tick(Command::confirm_zero);
  EXPECT_NEAR(twice.cycle.sample().angle[0], esmc::test::setup<Five>().angle[0] + 0.01, 1e-6);
}

TEST(ZeroPose, ADriveThatWasAwayHasLostIt) {
  Rig rig(relative());
  rig.tick();
  rig.tick(Command::confirm_zero);
  ASSERT_TRUE(rig.start());
  rig.sends_heartbeat[1] = false;
  for (int i = 0; i < 25; ++i) rig.tick();
  EXPECT_EQ(rig.cycle.supervisor().fault(), Fault::heartbeat_lost);
  rig.sends_heartbeat[1] = true;
  rig.tick();
  rig.tick(Command::reset);
  rig.tick(Command::enable);
  EXPECT_EQ(rig.cycle.supervisor().fault(), Fault::zero_not_confirmed);
}

/// A confirmation that cannot be had must not leave the zero of before in force: the mechanism stands
/// elsewhere.
TEST(ZeroPose, WithoutSamplesItIsNotConfirmedAndTheOneBeforeNoLongerCounts) {
  Rig rig(relative());
  rig.tick();
  rig.tick(Command::confirm_zero);
  rig.sends_encoder[1] = false;
  for (int i = 0; i < 10; ++i) rig.tick();
  rig.tick(Command::confirm_zero);
  rig.sends_encoder[1] = true;
  rig.tick();
  rig.tick(Command::enable);
  EXPECT_EQ(rig.cycle.supervisor().fault(), Fault::zero_not_confirmed);
}

// ---- reported torque

using Echo = esmc::TorqueFeedbackCheck<Five>;
constexpr double tick = 1e-3;

TEST(TorqueFeedbackCheck, ADriveThatFollowsInItsTimeIsPlausible) {
  Echo echo(0.05, 5e-3, tick);
  double real = 0.0;
  for (int n = 0; n < 500; ++n) {
    const double told = std::sin(0.05 * n);
    ASSERT_TRUE(echo.plausible(0, static_cast<float>(real))) << n;
    echo.commanded({told, 0, 0, 0});
    real += (told - real) * (1.0 - std::exp(-tick / 5e-3));
  }
}

// ---- phase and lead

TEST(Phase, AnglesAreTakenToWhereTheyWillBeWhenTheTorqueActs) {
  auto s = esmc::test::setup<Five>();
  s.controller.torque_lead = 2e-4;
  esmc::Controller<Five> late(s.controller);
  s.controller.torque_lead = 0.0;
  esmc::Controller<Five> prompt(s.controller);
  esmc::Sample<Five> now, then;
  for (const int j : {0, 2}) {
    now.angle[j] = s.angle[static_cast<std::size_t>(j)];
    now.rate[j] = 2.0;
    then = now;
  }
  for (const int j : {0, 2}) {
    now.rate[j] = then.rate[j] = 2.0;
    then.angle[j] = s.angle[static_cast<std::size_t>(j)] + 2.0 * (3e-4 + 2e-4);
    now.angle[j] = s.angle[static_cast<std::size_t>(j)];
    now.phase[static_cast<std::size_t>(j)] = 3e-4;
  }
  const auto torque = [](esmc::Controller<Five>& c, const esmc::Sample<Five>& sample) {
    esmc::Supervisor v;
    v.begin_tick(Command::enable, {});
    v.begin_tick(Command::none, {.all_ready = true});
    return c.tick(sample, v).torque;
  };
  EXPECT_TRUE(torque(late, now).isApprox(torque(prompt, then), 1e-9));
  EXPECT_FALSE(torque(late, now).isApprox(torque(prompt, now), 1e-6));
}

TEST(Phase, ABusThatStampsItsFramesGivesItToTheSample) {
  using Timed = esmc::test::Rig<Five, esmc::test::TimedBus>;
  // What is too old is no sample.
  for (const std::uint32_t us : {500'000U, 0xFFFF'FFFFU}) {
    Timed old;
    ASSERT_TRUE(old.start());
    old.bus.age_us = us;
    old.tick();
    EXPECT_EQ(old.cycle.supervisor().fault(), Fault::stale_feedback) << us;
    EXPECT_TRUE(old.all_zero()) << us;
  }

  // What comes after the sample, a heartbeat, has an age of its own; another sample counts from its own
  // arrival.
  struct Aging : esmc::test::FakeBus {
    std::uint32_t age_us = 900;
    [[nodiscard]] std::uint32_t frame_age_us() const { return age_us; }
    bool try_receive(esmc::hal::CanFrame& f) {
      age_us -= 100;
      return esmc::test::FakeBus::try_receive(f);
    }
  };
  esmc::test::Rig<Five, Aging> aging;
  aging.push_encoder(0);
  aging.push_encoder(1);
  aging.push_heartbeat(0);
  aging.push_heartbeat(1);
  aging.push_encoder(1);
  aging.bare_tick();
  EXPECT_NEAR(aging.cycle.sample().phase[0], 8e-4, 1e-9);
  EXPECT_NEAR(aging.cycle.sample().phase[2], 4e-4, 1e-9);

  // In lockstep a frame waits for the scheduler, and the result must not depend on that.
  auto counted = esmc::test::setup<Five>();
  counted.samples_timed = false;
  Timed lockstep(counted);
  lockstep.bus.age_us = 700;
  ASSERT_TRUE(lockstep.start());
  EXPECT_EQ(lockstep.cycle.sample().phase[0], 0.0);
}

}  // namespace
