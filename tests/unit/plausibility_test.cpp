/// What fits the confirmed zero, the command and the clock: the cycle on drives made of bytes, and the parts
/// alone.

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

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
  ASSERT_TRUE(absolute.start());
  const auto a = absolute.tick(), b = rig.tick();
  EXPECT_NEAR(a.torque[0], b.torque[0], 1e-3) << "the same torque as with absolute encoders";
  EXPECT_NEAR(a.torque[2], b.torque[2], 1e-3);
}

TEST(ZeroPose, IsNotConfirmedBySilentEncodersNorWhileRunningNorTwiceAsFar) {
  Rig silent(relative());
  silent.sends_encoder.fill(false);
  silent.tick();
  silent.tick(Command::confirm_zero);
  silent.sends_encoder.fill(true);
  silent.tick(Command::enable);
  EXPECT_EQ(silent.cycle.supervisor().fault(), Fault::zero_not_confirmed);

  Rig nan(relative());
  nan.angle[0] = std::numeric_limits<double>::quiet_NaN();
  nan.tick();
  nan.tick(Command::confirm_zero);
  nan.tick(Command::enable);
  EXPECT_EQ(nan.cycle.supervisor().fault(), Fault::zero_not_confirmed);

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

/// Drives that say where they are only once they are set up (CiA 402): enabling gets that far, not to a
/// torque.
TEST(ZeroPose, EncodersThatAreSilentUntilEnabledAreWaitedForAndThenToBeConfirmed) {
  Rig late(relative());
  late.sends_encoder.fill(false);
  late.tick(Command::enable);
  EXPECT_EQ(late.cycle.supervisor().state(), State::enabling);
  late.sends_encoder.fill(true);
  late.tick();
  EXPECT_EQ(late.cycle.supervisor().fault(), Fault::zero_not_confirmed);
  late.tick(Command::reset);
  late.tick(Command::confirm_zero);
  EXPECT_TRUE(late.start());

  Rig never(relative());
  never.sends_encoder.fill(false);
  EXPECT_FALSE(never.start());
  EXPECT_NE(never.cycle.supervisor().fault(), Fault::none);
  EXPECT_TRUE(never.all_zero());
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

/// The heartbeats of passive encoders are not looked at, and may be off or slower than ours must be: what
/// tells that one was away is its samples.
TEST(ZeroPose, APassiveEncoderThatWasAwayHasLostItWhateverItsHeartbeat) {
  for (const bool beaten : {false, true}) {
    for (const int silent : {0, 20, 21}) {
      auto s = relative();
      s.controller.sensors = esmc::Sensors::all;
      s.controller.limits.closure = 1e-3;
      Rig rig(s);
      rig.sends_heartbeat[1] = rig.sends_heartbeat[3] = beaten;
      rig.tick();
      rig.sends_heartbeat[1] = rig.sends_heartbeat[3] = false;
      rig.tick(Command::confirm_zero);
      for (int n = 0; n < 30; ++n) rig.tick();
      rig.sends_encoder[3] = false;
      for (int n = 0; n < silent; ++n) rig.tick();
      rig.sends_encoder[3] = true;
      rig.tick();
      EXPECT_EQ(rig.start(), silent <= 20) << beaten << ' ' << silent;
      EXPECT_EQ(rig.cycle.supervisor().fault(), silent > 20 ? Fault::zero_not_confirmed : Fault::none);
    }
  }
}

TEST(ZeroPose, AbsoluteEncodersHaveNothingToConfirm) {
  Rig rig;
  rig.tick();
  const auto before = rig.cycle.sample().angle;
  rig.tick(Command::confirm_zero);
  rig.tick();
  EXPECT_EQ(rig.cycle.sample().angle, before);
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

TEST(TorqueFeedbackCheck, FiveTicksOffInARowAreAFault) {
  for (const double off : {0.049, 0.051, -0.051}) {
    Echo echo(0.05, 0.0, tick);
    echo.commanded({1.0, 0, 0, 0});
    for (int n = 1; n <= 8; ++n) {
      EXPECT_EQ(echo.plausible(0, static_cast<float>(1.0 + off)), std::abs(off) < 0.05 || n < 5)
          << off << ' ' << n;
    }
  }
  Echo echo(0.05, 0.0, tick);
  for (int n = 1; n <= 20; ++n)
    EXPECT_TRUE(echo.plausible(2, n % 5 == 0 ? 0.0F : 1.0F)) << "one that fits begins anew";
  const float nan = std::numeric_limits<float>::quiet_NaN();
  for (int n = 1; n <= 5; ++n) EXPECT_EQ(echo.plausible(3, nan), n < 5);
}

TEST(TorqueFeedbackCheck, WhatWasOffBeforeThereWasTorqueIsForgotten) {
  Echo echo(0.05, 0.0, tick);
  for (int n = 1; n <= 4; ++n) EXPECT_TRUE(echo.plausible(1, 1.0F));
  echo.forget();
  for (int n = 1; n <= 6; ++n) EXPECT_EQ(echo.plausible(1, 1.0F), n < 5) << n;
}

TEST(TorqueFeedbackCheck, WithoutToleranceNothingIsCompared) {
  Echo echo(0.0, 0.0, tick);
  for (int n = 0; n < 20; ++n) {
    EXPECT_TRUE(echo.plausible(0, 100.0F));
    EXPECT_TRUE(echo.plausible(0, std::nullopt));
  }
}

TEST(TorqueFeedbackCheck, ReportsNeedNotComeInEveryTick) {
  Echo echo(0.05, 0.0, tick);
  for (int n = 1; n <= 5; ++n) {
    for (int i = 0; i < 9; ++i) EXPECT_TRUE(echo.plausible(2, std::nullopt));
    EXPECT_EQ(echo.plausible(2, 1.0F), n < 5) << "five in a row, whatever lies between them";
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
  struct Stamped : esmc::test::FakeBus {
    [[nodiscard]] std::uint32_t frame_age_us() const { return 700; }
  };
  esmc::test::Rig<Five, Stamped> rig;
  ASSERT_TRUE(rig.start());
  EXPECT_NEAR(rig.cycle.sample().phase[0], 7e-4, 1e-9);
  EXPECT_NEAR(rig.cycle.sample().phase[2], 7e-4, 1e-9);

  // What waited for longer than a tick is not of this tick, and what is too old is no sample.
  struct Queued : esmc::test::FakeBus {
    std::uint32_t age_us = 0;
    [[nodiscard]] std::uint32_t frame_age_us() const { return age_us; }
  };
  esmc::test::Rig<Five, Queued> queued;
  ASSERT_TRUE(queued.start());
  queued.bus.age_us = 1400;
  queued.tick();
  EXPECT_EQ(queued.cycle.sample().age_ticks[0], 1U);
  EXPECT_NEAR(queued.cycle.sample().phase[0], 4e-4, 1e-9);
  EXPECT_EQ(queued.cycle.supervisor().fault(), Fault::none);
  for (const std::uint32_t us : {500'000U, 0xFFFF'FFFFU}) {
    esmc::test::Rig<Five, Queued> old;
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
  esmc::test::Rig<Five, Stamped> lockstep(counted);
  ASSERT_TRUE(lockstep.start());
  EXPECT_EQ(lockstep.cycle.sample().phase[0], 0.0);
}

}  // namespace
