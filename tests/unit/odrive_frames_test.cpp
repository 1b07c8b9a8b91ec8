/// Which frames one axis takes, their ages, and what it makes of turns and newton metres.

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include "tests/support/odrive_bench.hpp"

namespace esmc::test {
namespace {

TEST(OdriveAxis, OnlyAnEncoderFrameBringsASample) {
  OdriveAxis a = axis();
  EXPECT_FALSE(a.brought_sample());
  for (int n = 0; n < 2; ++n) {
    hear(a, 1);
    EXPECT_FALSE(a.brought_sample());
    ASSERT_EQ(a.receive(encoder(node, 0, 0)), Received::accepted);
    EXPECT_TRUE(a.brought_sample());
    ASSERT_EQ(a.receive(encoder(node, 0, 0)), Received::accepted);
    EXPECT_TRUE(a.brought_sample());
  }
  ASSERT_EQ(a.receive(message(node, 0x02, 0, 0, 0)), Received::accepted);
  EXPECT_FALSE(a.brought_sample()) << "an emergency stop";
  ASSERT_EQ(a.receive(encoder(node, 0, 0)), Received::accepted);
  EXPECT_TRUE(a.brought_sample());
  ASSERT_EQ(a.receive(message(0x3F, 0x02, 0, 0, 0)), Received::accepted);
  EXPECT_FALSE(a.brought_sample()) << "an emergency stop of all nodes";
}

TEST(OdriveAxis, TakesItsHeartbeatItsEncoderAndEmergencyStopsAmongAllIdentifiers) {
  for (const Version v : {Version::v0_6, Version::v0_5_6}) {
    const bool newer = v == Version::v0_6;
    for (const unsigned command : {cmd_heartbeat, cmd_encoder, cmd_torques}) {
      for (std::uint32_t id = 0; id <= 0x7FF; ++id) {
        CanFrame f = message(node, command, 0, 0);
        f.id = id;
        OdriveAxis a = axis(v);
        const bool to_us = id / 32 == node || (newer && id / 32 == 0x3F);  // 0.5.6 has no node for all
        const bool mine = id == 0x061 || id == 0x069 || (newer && id == 0x07C) || (to_us && id % 32 == 0x02);
        const bool ours = to_us && is_command(id % 32, newer);  // what we alone may send
        EXPECT_EQ(a.receive(f),
                  mine ? Received::accepted : (ours ? Received::foreign_command : Received::not_mine))
            << std::hex << id;
        f.remote = true;
        if (id == 0x07C) {
          EXPECT_EQ(a.receive(f), newer ? Received::not_mine : Received::foreign_command)
              << "another node requests";
        }
        if (ours) {
          EXPECT_EQ(a.receive(f), newer ? Received::not_mine : Received::foreign_command)
              << std::hex << id << ": a request is no command, but 0.5.6 does not look";
        }
      }
    }
  }
}

TEST(OdriveAxis, ExtendedAndImpossibleIdentifiersAreNotItsOwn) {
  for (std::uint32_t high = 0; high <= 0x1FFFF; ++high) {
    CanFrame f = heartbeat(node, 8);
    f.extended = true;
    f.id += high << 11U;
    OdriveAxis a = axis();
    ASSERT_EQ(a.receive(f), Received::not_mine) << std::hex << f.id;
    if (high == 0) continue;
    f.extended = false;  // bits that a standard identifier does not have
    ASSERT_EQ(a.receive(f), Received::not_mine) << std::hex << f.id;
  }
}

TEST(OdriveAxis, MalformedFramesHaveNoSideEffect) {
  OdriveAxis fresh = ready_axis();
  ASSERT_EQ(fresh.receive(encoder(node, 0.25F, 0.5F)), Received::accepted);
  fresh.begin_tick();
  for (const unsigned command : {cmd_heartbeat, cmd_encoder, cmd_torques}) {
    for (int flags = 0; flags < 4; ++flags) {
      for (unsigned size = 0; size <= 64; ++size) {
        CanFrame f = message(node, command, 0xFFFFFFFF, 0xFFFFFFFF);
        f.size = static_cast<std::uint8_t>(size);
        f.remote = (flags & 1) != 0;
        f.fd = (flags & 2) != 0;
        if (size == 8 && flags == 0) continue;
        OdriveAxis a = fresh;
        ASSERT_NE(a.receive(f), Received::accepted) << command << " size " << size << " flags " << flags;
        if ((flags & 1) == 0) {
          ASSERT_EQ(a.receive(f), Received::malformed) << command << " size " << size << " flags " << flags;
        }
        ASSERT_TRUE(a.ready() && a.closed_loop() && !a.error() && !a.observed_torque());
        ASSERT_EQ(a.sample_age_ticks(), 1U);
        ASSERT_EQ(a.heartbeat_age_ticks(), 1U);
        ASSERT_EQ(a.sample<double>().angle, fresh.sample<double>().angle);
        ASSERT_EQ(a.sample<double>().rate, fresh.sample<double>().rate);
      }
    }
  }
}

TEST(OdriveAxis, ItsEstimatedTorqueIsOfTheJointAndOfThisTick) {
  OdriveAxis a({.node = node, .direction = -1.0F, .gear_ratio = 8.0F}, Version::v0_6, retry);
  EXPECT_FALSE(a.observed_torque());
  EXPECT_EQ(a.torque_age_ticks(), OdriveAxis::age_max);
  a.begin_tick();
  EXPECT_EQ(a.torque_age_ticks(), OdriveAxis::age_max) << "it stands still there";
  ASSERT_EQ(a.receive(encoder(node, 0, 0)), Received::accepted);
  ASSERT_EQ(a.receive(torques(node, 1.5F, 0.25F)), Received::accepted);
  EXPECT_FALSE(a.brought_sample());
  EXPECT_EQ(a.observed_torque(), -2.0F) << "what it estimates, not what it was told";
  EXPECT_EQ(a.torque_age_ticks(), 0U);
  a.begin_tick();
  EXPECT_FALSE(a.observed_torque());
  EXPECT_EQ(a.torque_age_ticks(), 1U);
  OdriveAxis fresh = axis();
  ASSERT_EQ(fresh.receive(torques(node, 0, 0)), Received::accepted);
  EXPECT_FALSE(fresh.alive() || fresh.heard_this_tick());
}

// ---- ages

TEST(OdriveAxis, AgesCountTicksSinceTheLastFrameOfTheirKind) {
  OdriveAxis a = axis();
  a.begin_tick();
  EXPECT_EQ(a.sample_age_ticks(), OdriveAxis::age_max) << "does not wrap to a fresh sample";
  EXPECT_EQ(a.heartbeat_age_ticks(), OdriveAxis::age_max);
  EXPECT_FALSE(a.heard_this_tick());
  (void)a.receive(encoder(node, 0, 0));
  EXPECT_TRUE(a.heard_this_tick());
  EXPECT_EQ(a.sample_age_ticks(), 0U);
  EXPECT_EQ(a.heartbeat_age_ticks(), OdriveAxis::age_max);
  for (std::uint32_t tick = 1; tick <= 20; ++tick) {
    a.begin_tick();
    EXPECT_EQ(a.sample_age_ticks(), tick);
    EXPECT_FALSE(a.heard_this_tick());
  }
  (void)a.receive(heartbeat(node, 1));
  EXPECT_FALSE(a.heard_this_tick()) << "a heartbeat is no sample";
  EXPECT_EQ(a.heartbeat_age_ticks(), 0U);
  EXPECT_EQ(a.sample_age_ticks(), 20U);
  for (std::uint32_t tick = 1; tick <= 20; ++tick) {
    a.begin_tick();
    EXPECT_EQ(a.heartbeat_age_ticks(), tick);
  }
}

// ---- direction, gear, offset

TEST(OdriveAxis, TurnsBecomeJointAnglesAndRates) {
  constexpr double turn = 2 * 3.14159265358979323846;
  for (const float direction : {1.0F, -1.0F}) {
    for (const float gear : {1.0F, 0.5F, 6.0F, 9.75F}) {
      for (const float offset : {0.0F, 0.5F, -2.0F}) {
        OdriveAxis a({node, direction, gear, offset}, Version::v0_6, retry);
        for (const float position : {0.0F, 0.25F, -1.0F, 12.375F}) {
          for (const float velocity : {0.0F, 1.0F, -3.5F}) {
            (void)a.receive(encoder(node, position, velocity));
            // motor turns = direction * gear * (joint - offset) / 2 pi
            const double angle = static_cast<double>(offset) + turn * static_cast<double>(position) *
                                                                   static_cast<double>(direction) /
                                                                   static_cast<double>(gear);
            const double rate = turn * static_cast<double>(velocity) * static_cast<double>(direction) /
                                static_cast<double>(gear);
            EXPECT_NEAR(a.sample<double>().angle, angle, 1e-14 * (1 + std::abs(angle)));
            EXPECT_NEAR(a.sample<double>().rate, rate, 1e-14 * (1 + std::abs(rate)));
            EXPECT_NEAR(static_cast<double>(a.sample<float>().angle), angle, 3e-7 * (1 + std::abs(angle)));
            EXPECT_NEAR(static_cast<double>(a.sample<float>().rate), rate, 3e-7 * (1 + std::abs(rate)));
          }
        }
      }
    }
  }
}

/// The power at the joint is the power at the shaft: torque * rate of one is torque * rate of the other.
TEST(OdriveAxis, JointTorqueBecomesShaftTorqueOfTheSamePower) {
  for (const float direction : {1.0F, -1.0F}) {
    for (const float gear : {1.0F, 0.5F, 6.0F, 9.75F}) {
      OdriveAxis a({node, direction, gear, 0.3F}, Version::v0_6, retry);
      for (const double torque : {0.0, 1.5, -0.2, 20.0}) {
        const CanFrame f = test::torque_frame(a, torque);
        EXPECT_EQ(f.id, 0x06EU);
        const auto shaft = static_cast<double>(real(f, 0));
        EXPECT_NEAR(shaft, torque * static_cast<double>(direction) / static_cast<double>(gear),
                    2e-7 * std::abs(torque));
        EXPECT_EQ(word(test::torque_frame(a, static_cast<float>(torque)), 0), word(f, 0));
        (void)a.receive(encoder(node, 0, 1));
        EXPECT_NEAR(a.sample<double>().rate * torque, 2 * 3.14159265358979 * shaft, 1e-5);
      }
    }
  }
}

/// A gear ratio of 1e-40 makes infinity of a torque that is finite at the joint, and 1e-30 makes 2e30 N m.
TEST(OdriveAxis, ATorqueThatNoShaftHasIsNotPutIntoAFrame) {
  for (const float gear : {1e-40F, 1e-30F, 1e-5F, 0.0F, NAN, INFINITY}) {
    const OdriveAxis a({node, -1.0F, gear, 0.0F}, Version::v0_6, retry);
    for (const double torque : {2.0, -2.0, static_cast<double>(NAN), static_cast<double>(INFINITY)}) {
      if (gear == INFINITY && std::abs(torque) == 2.0) continue;  // a zero
      EXPECT_FALSE(a.can_carry(torque)) << gear << ' ' << torque;
      EXPECT_EQ(real(test::torque_frame(a, torque), 0), 0.0F) << gear << ' ' << torque;
      EXPECT_EQ(real(test::torque_frame(a, static_cast<float>(torque)), 0), 0.0F) << gear << ' ' << torque;
    }
  }
  const OdriveAxis a = axis();
  EXPECT_TRUE(a.can_carry(1e4) && a.can_carry(-1e4F));
  EXPECT_FALSE(a.can_carry(1.0001e4) || a.can_carry(-1.0001e4F));
  EXPECT_EQ(real(test::torque_frame(a, 1e4F), 0), 1e4F);
}

}  // namespace
}  // namespace esmc::test
