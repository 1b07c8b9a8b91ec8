/// One axis as the controller sees it: which frames it takes, how it is enabled, what it makes of turns and
/// newton metres. Frames are packed by hand, expectations are computed here.

#include "firmware/drive/odrive_axis.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include "tests/support/odrive_bytes.hpp"

namespace {

using esmc::drive::AxisConfig;
using esmc::drive::OdriveAxis;
using esmc::drive::Received;
using esmc::drive::odrive::Version;
using esmc::hal::CanFrame;
namespace test = esmc::test;

constexpr std::uint8_t node = 3;
constexpr std::uint32_t retry = 10;

OdriveAxis axis(Version v = Version::v0_6) { return {AxisConfig{.node = node}, v, retry}; }

std::vector<CanFrame> enable(OdriveAxis& a) {
  std::vector<CanFrame> sent;
  a.enable([&](const CanFrame& f) { sent.push_back(f); });
  return sent;
}
std::vector<CanFrame> disable(OdriveAxis& a) {
  std::vector<CanFrame> sent;
  a.disable([&](const CanFrame& f) { sent.push_back(f); });
  return sent;
}
/// A heartbeat in a tick of its own.
void hear(OdriveAxis& a, std::uint8_t state, std::uint32_t error = 0, std::array<std::uint8_t, 3> rest = {}) {
  a.begin_tick();
  ASSERT_EQ(a.receive(test::heartbeat(node, state, error, rest)), Received::accepted);
}
/// Asks for closed-loop control and confirms it twice.
OdriveAxis ready_axis() {
  OdriveAxis a = axis();
  (void)enable(a);
  hear(a, 8);
  hear(a, 8);
  return a;
}

// ---- enabling --------------------------------------------------------------------------------------------------

TEST(OdriveAxis, EnablingSendsModeThenClearsErrorsThenAsksForClosedLoop) {
  for (const Version v : {Version::v0_6, Version::v0_5_6}) {
    OdriveAxis a = axis(v);
    const auto sent = enable(a);
    ASSERT_EQ(sent.size(), 3U);
    EXPECT_EQ(sent[0].id, 0x06BU);
    EXPECT_EQ(test::word(sent[0], 0), 1U) << "torque control";
    EXPECT_EQ(test::word(sent[0], 4), 1U) << "passthrough";
    EXPECT_EQ(sent[1].id, 0x078U);
    EXPECT_EQ(sent[1].size, v == Version::v0_6 ? 1 : 0);
    EXPECT_EQ(sent[2].id, 0x067U);
    EXPECT_EQ(test::word(sent[2], 0), 8U);
    for (const CanFrame& f : sent) EXPECT_TRUE(esmc::hal::well_formed(f) && !f.extended && !f.remote && !f.fd);
  }
}

TEST(OdriveAxis, TwoHeartbeatsInClosedLoopMakeItReady) {
  OdriveAxis a = axis();
  EXPECT_FALSE(a.ready());
  (void)enable(a);
  EXPECT_FALSE(a.ready());
  hear(a, 8);
  EXPECT_FALSE(a.ready());
  hear(a, 8);
  EXPECT_TRUE(a.ready());
  EXPECT_TRUE(enable(a).empty()) << "nothing more to ask for";
}

TEST(OdriveAxis, AnythingButClosedLoopWithoutErrorStartsTheCountAgain) {
  for (unsigned state = 0; state < 256; ++state) {
    if (state == 8) continue;
    OdriveAxis a = axis();
    (void)enable(a);
    hear(a, 8);
    hear(a, static_cast<std::uint8_t>(state));
    hear(a, 8);
    EXPECT_FALSE(a.ready()) << "state " << state << " in between";
    hear(a, 8);
    EXPECT_TRUE(a.ready());
  }
  for (int bit = 0; bit < 32; ++bit) {
    OdriveAxis a = axis();
    (void)enable(a);
    hear(a, 8);
    hear(a, 8, 1U << bit);
    EXPECT_TRUE(a.error());
    EXPECT_EQ(a.error_code(), 1U << bit);
    hear(a, 8);
    EXPECT_FALSE(a.error());
    EXPECT_FALSE(a.ready()) << "error bit " << bit << " in between";
  }
}

TEST(OdriveAxis, ReadyIsLostWithTheNextHeartbeatThatSaysOtherwise) {
  for (const std::uint8_t state : std::array<std::uint8_t, 5>{0, 1, 2, 9, 255}) {
    OdriveAxis a = ready_axis();
    hear(a, state);
    EXPECT_FALSE(a.ready());
    EXPECT_FALSE(a.closed_loop());
    EXPECT_FALSE(a.idle()) << "asked into closed loop: idle only once it is asked out of it and says so";
  }
  OdriveAxis a = ready_axis();
  hear(a, 8, 0x200);
  EXPECT_FALSE(a.ready());
  EXPECT_TRUE(a.closed_loop());
}

/// An axis without motor power goes to state 8, notices, and drops out: it shows 8 in one heartbeat after every
/// request and never two.
TEST(OdriveAxis, AnAxisWithoutPowerIsNeverReady) {
  OdriveAxis a = axis();
  int requests = 0;
  for (int tick = 0; tick < 500; ++tick) {
    if (!enable(a).empty()) {
      ++requests;
      hear(a, 8);
    }
    ASSERT_FALSE(a.ready()) << tick;
    if (tick % 5 == 4) hear(a, 1, 0x200);
    ASSERT_FALSE(a.ready()) << tick;
  }
  EXPECT_GT(requests, 30);
}

/// The case above with unlucky timing: every heartbeat happens to fall just after a request and says 8.
TEST(OdriveAxis, OneConfirmationPerRequestIsNotTwo) {
  OdriveAxis a = axis();
  for (int tick = 0; tick < 500; ++tick) {
    if (!enable(a).empty()) hear(a, 8);
    ASSERT_FALSE(a.ready()) << tick;
  }
}

/// CAN delivers a frame twice when the sender alone sees an error in its last bit; a backlog looks the same.
TEST(OdriveAxis, AHeartbeatReceivedTwiceInATickConfirmsOnce) {
  OdriveAxis a = axis();
  (void)enable(a);
  a.begin_tick();
  EXPECT_EQ(a.receive(test::heartbeat(node, 8)), Received::accepted);
  EXPECT_EQ(a.receive(test::heartbeat(node, 8)), Received::accepted);
  EXPECT_FALSE(a.ready());
}

TEST(OdriveAxis, TheWholeSequenceIsRepeatedEveryRetryTicks) {
  OdriveAxis a = axis();
  for (std::uint32_t tick = 0; tick < 5 * retry; ++tick) {
    EXPECT_EQ(enable(a).size(), tick % retry == 0 ? 3U : 0U) << "tick " << tick;
  }
}

TEST(OdriveAxis, AskingAgainDoesNotWaitForTheRetryAndForgetsWhatWasConfirmed) {
  OdriveAxis a = axis();
  (void)enable(a);
  hear(a, 8);
  EXPECT_TRUE(enable(a).empty());
  a.ask_again();
  EXPECT_EQ(enable(a).size(), 3U);
  hear(a, 8);
  EXPECT_FALSE(a.ready());
  hear(a, 8);
  EXPECT_TRUE(a.ready());
  a.ask_again();
  EXPECT_TRUE(a.ready() && enable(a).empty()) << "a ready axis is left alone";
}

/// A drive found in closed loop (left there by somebody else, in any control mode) is not ready: nobody has told
/// it to be in torque mode. Heartbeats count only after a request.
TEST(OdriveAxis, ConfirmationsBeforeARequestDoNotCount) {
  OdriveAxis a = axis();
  for (int i = 0; i < 5; ++i) hear(a, 8);
  EXPECT_FALSE(a.ready());
  EXPECT_EQ(enable(a).size(), 3U);
  EXPECT_FALSE(a.ready());
}

TEST(OdriveAxis, DisablingAsksForIdleAndForgetsTheConfirmations) {
  OdriveAxis a = ready_axis();
  const auto sent = disable(a);
  ASSERT_EQ(sent.size(), 1U);
  EXPECT_EQ(sent[0].id, 0x067U);
  EXPECT_EQ(test::word(sent[0], 0), 1U);
  EXPECT_FALSE(a.ready());
  EXPECT_EQ(enable(a).size(), 3U) << "and asks again at once";
  hear(a, 8);
  EXPECT_FALSE(a.ready());
}

TEST(OdriveAxis, DisablingWhileWaitingForARetryDoesNotDelayTheNextRequest) {
  OdriveAxis a = axis();
  (void)enable(a);
  (void)enable(a);
  (void)disable(a);
  EXPECT_EQ(enable(a).size(), 3U);
}

/// What a drive said before it was asked to do something else says nothing about what it does now.
TEST(OdriveAxis, IdleIsWhatIsHeardAfterTheLastRequest) {
  OdriveAxis a = axis();
  hear(a, 1);
  EXPECT_TRUE(a.idle());
  (void)enable(a);
  EXPECT_FALSE(a.idle()) << "it has just been asked into closed loop";
  hear(a, 1);
  EXPECT_FALSE(a.idle()) << "it may still be on its way";
  (void)disable(a);
  EXPECT_FALSE(a.idle()) << "nothing has been heard since";
  hear(a, 8);
  EXPECT_FALSE(a.idle());
  hear(a, 1);
  EXPECT_TRUE(a.idle());
}

// ---- errors ----------------------------------------------------------------------------------------------------

TEST(OdriveAxis, BeforeTheFirstHeartbeatNothingIsKnown) {
  const OdriveAxis a = axis();
  EXPECT_FALSE(a.idle() || a.error() || a.closed_loop() || a.ready());
  EXPECT_EQ(a.heartbeat_age_ticks(), OdriveAxis::age_max);
  EXPECT_EQ(a.sample_age_ticks(), OdriveAxis::age_max);
}

TEST(OdriveAxis, ComponentErrorsOf056AreErrorsAndTrajectoryDoneIsNot) {
  for (std::size_t at = 0; at < 3; ++at) {
    for (unsigned bit = 0; bit < 8; ++bit) {
      std::array<std::uint8_t, 3> rest{};
      rest[at] = static_cast<std::uint8_t>(1U << bit);
      OdriveAxis old = axis(Version::v0_5_6), now = axis(Version::v0_6);
      hear(old, 8, 0, rest);
      hear(now, 8, 0, rest);
      EXPECT_EQ(old.error(), !(at == 2 && bit == 7)) << at << ' ' << bit;
      EXPECT_FALSE(now.error()) << at << ' ' << bit;
    }
  }
}

// ---- which frames ----------------------------------------------------------------------------------------------

TEST(OdriveAxis, TakesItsHeartbeatAndItsEncoderAmongAllIdentifiers) {
  for (const unsigned command : {test::cmd_heartbeat, test::cmd_encoder}) {
    for (std::uint32_t id = 0; id <= 0x7FF; ++id) {
      CanFrame f = test::message(node, command, 0, 0);
      f.id = id;
      OdriveAxis a = axis();
      const bool mine = id == 0x061 || id == 0x069;
      EXPECT_EQ(a.receive(f), mine ? Received::accepted : Received::not_mine) << std::hex << id;
    }
  }
}

TEST(OdriveAxis, ExtendedAndImpossibleIdentifiersAreNotItsOwn) {
  for (std::uint32_t high = 0; high <= 0x1FFFF; ++high) {
    CanFrame f = test::heartbeat(node, 8);
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
  ASSERT_EQ(fresh.receive(test::encoder(node, 0.25F, 0.5F)), Received::accepted);
  fresh.begin_tick();
  for (const unsigned command : {test::cmd_heartbeat, test::cmd_encoder}) {
    for (int flags = 0; flags < 4; ++flags) {
      for (unsigned size = 0; size <= 64; ++size) {
        CanFrame f = test::message(node, command, 0xFFFFFFFF, 0xFFFFFFFF);
        f.size = static_cast<std::uint8_t>(size);
        f.remote = (flags & 1) != 0;
        f.fd = (flags & 2) != 0;
        if (size == 8 && flags == 0) continue;
        OdriveAxis a = fresh;
        ASSERT_NE(a.receive(f), Received::accepted) << command << " size " << size << " flags " << flags;
        if ((flags & 1) == 0) {
          ASSERT_EQ(a.receive(f), Received::malformed) << command << " size " << size << " flags " << flags;
        }
        ASSERT_TRUE(a.ready() && a.closed_loop() && !a.error());
        ASSERT_EQ(a.sample_age_ticks(), 1U);
        ASSERT_EQ(a.heartbeat_age_ticks(), 1U);
        ASSERT_EQ(a.sample<double>().angle, fresh.sample<double>().angle);
        ASSERT_EQ(a.sample<double>().rate, fresh.sample<double>().rate);
      }
    }
  }
}

// ---- ages ------------------------------------------------------------------------------------------------------

TEST(OdriveAxis, AgesCountTicksSinceTheLastFrameOfTheirKind) {
  OdriveAxis a = axis();
  a.begin_tick();
  EXPECT_EQ(a.sample_age_ticks(), OdriveAxis::age_max) << "does not wrap to a fresh sample";
  EXPECT_EQ(a.heartbeat_age_ticks(), OdriveAxis::age_max);
  (void)a.receive(test::encoder(node, 0, 0));
  EXPECT_EQ(a.sample_age_ticks(), 0U);
  EXPECT_EQ(a.heartbeat_age_ticks(), OdriveAxis::age_max);
  for (std::uint32_t tick = 1; tick <= 20; ++tick) {
    a.begin_tick();
    EXPECT_EQ(a.sample_age_ticks(), tick);
  }
  (void)a.receive(test::heartbeat(node, 1));
  EXPECT_EQ(a.heartbeat_age_ticks(), 0U);
  EXPECT_EQ(a.sample_age_ticks(), 20U);
  for (std::uint32_t tick = 1; tick <= 20; ++tick) {
    a.begin_tick();
    EXPECT_EQ(a.heartbeat_age_ticks(), tick);
  }
}

// ---- direction, gear, offset -----------------------------------------------------------------------------------

TEST(OdriveAxis, TurnsBecomeJointAnglesAndRates) {
  constexpr double turn = 2 * 3.14159265358979323846;
  for (const float direction : {1.0F, -1.0F}) {
    for (const float gear : {1.0F, 0.5F, 6.0F, 9.75F}) {
      for (const float offset : {0.0F, 0.5F, -2.0F}) {
        OdriveAxis a({node, direction, gear, offset}, Version::v0_6, retry);
        for (const float position : {0.0F, 0.25F, -1.0F, 12.375F}) {
          for (const float velocity : {0.0F, 1.0F, -3.5F}) {
            (void)a.receive(test::encoder(node, position, velocity));
            // motor turns = direction * gear * (joint - offset) / 2 pi
            const double angle = static_cast<double>(offset) + turn * static_cast<double>(position) * static_cast<double>(direction) / static_cast<double>(gear);
            const double rate = turn * static_cast<double>(velocity) * static_cast<double>(direction) / static_cast<double>(gear);
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
        const CanFrame f = a.torque_frame(torque);
        EXPECT_EQ(f.id, 0x06EU);
        const auto shaft = static_cast<double>(test::real(f, 0));
        EXPECT_NEAR(shaft, torque * static_cast<double>(direction) / static_cast<double>(gear), 2e-7 * std::abs(torque));
        EXPECT_EQ(test::word(a.torque_frame(static_cast<float>(torque)), 0), test::word(f, 0));
        (void)a.receive(test::encoder(node, 0, 1));
        EXPECT_NEAR(a.sample<double>().rate * torque, 2 * 3.14159265358979 * shaft, 1e-5);
      }
    }
  }
}

}  // namespace
