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

/// What is offered to a bus that takes all of it, or nothing.
std::vector<CanFrame> enable(OdriveAxis& a, bool taken = true) {
  std::vector<CanFrame> sent;
  a.enable([&](const CanFrame& f) {
    sent.push_back(f);
    return taken;
  });
  return sent;
}
bool only(const std::vector<CanFrame>& sent, unsigned command) {
  return sent.size() == 1 && test::node_of(sent[0]) == node && test::command_of(sent[0]) == command;
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
/// Brings an idle, healthy axis to where closed-loop control has been asked for.
void ask(OdriveAxis& a) {
  hear(a, 1);
  ASSERT_TRUE(only(enable(a), test::cmd_mode));
  hear(a, 1);
  ASSERT_TRUE(only(enable(a), test::cmd_axis_state));
}
/// Asks for closed-loop control and confirms it twice.
OdriveAxis ready_axis() {
  OdriveAxis a = axis();
  ask(a);
  hear(a, 8);
  hear(a, 8);
  return a;
}

// ---- enabling --------------------------------------------------------------------------------------------------

TEST(OdriveAxis, EnablingSendsModeThenClearsErrorsThenAsksForClosedLoop) {
  for (const Version v : {Version::v0_6, Version::v0_5_6}) {
    OdriveAxis a = axis(v);
    std::vector<CanFrame> sent;
    for (const std::uint32_t error : {0x200U, 0x200U, 0U}) {
      hear(a, 1, error);
      const auto now = enable(a);
      ASSERT_EQ(now.size(), 1U) << "one at a time";
      sent.push_back(now[0]);
    }
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

/// Set_Axis_State has the smaller identifier: mailboxes sorted by it, or a mode frame that was dropped, would arm
/// the axis in the mode it has stored.
TEST(OdriveAxis, ClosedLoopIsAskedForOnlyAfterAHeartbeatThatIsNewerThanTheMode) {
  OdriveAxis a = axis();
  hear(a, 1);
  EXPECT_TRUE(only(enable(a), test::cmd_mode));
  for (std::uint32_t tick = 1; tick < retry; ++tick) {
    a.begin_tick();
    (void)a.receive(test::encoder(node, 0, 0));
    EXPECT_TRUE(enable(a).empty()) << "the heartbeat is older";
  }
  EXPECT_TRUE(only(enable(a), test::cmd_mode)) << "nothing was heard: again";
  hear(a, 1);
  EXPECT_TRUE(only(enable(a), test::cmd_axis_state));
}

TEST(OdriveAxis, WhatTheBusDidNotTakeIsSentAgainAndNotSkipped) {
  OdriveAxis a = axis();
  for (int i = 0; i < 5; ++i) {
    hear(a, 1, 0x200);
    EXPECT_TRUE(only(enable(a, false), test::cmd_mode)) << i;
  }
  EXPECT_TRUE(only(enable(a), test::cmd_mode));
  for (int i = 0; i < 5; ++i) {
    hear(a, 1, 0x200);
    EXPECT_TRUE(only(enable(a, false), test::cmd_clear_errors)) << i;
  }
  hear(a, 1, 0x200);
  EXPECT_TRUE(only(enable(a), test::cmd_clear_errors));
  for (int i = 0; i < 2; ++i) {
    hear(a, 1);
    EXPECT_TRUE(only(enable(a, false), test::cmd_axis_state)) << i;
  }
  EXPECT_FALSE(a.must_be_released());
  hear(a, 1);
  EXPECT_TRUE(only(enable(a), test::cmd_axis_state));
  EXPECT_TRUE(a.must_be_released());
}

/// A mode that was sent before the axis was there may have reached nobody.
TEST(OdriveAxis, ASilentAxisIsCalledEveryRetryTicksAndConfiguredOnceItIsHeard) {
  OdriveAxis a = axis();
  for (std::uint32_t tick = 0; tick < 5 * retry; ++tick) {
    a.begin_tick();
    const auto sent = enable(a);
    EXPECT_TRUE(tick % retry == 0 ? only(sent, test::cmd_mode) : sent.empty()) << "tick " << tick;
    EXPECT_FALSE(a.alive());
  }
  (void)enable(a);
  a.begin_tick();
  (void)a.receive(test::encoder(node, 0, 0));
  EXPECT_TRUE(a.alive());
  EXPECT_TRUE(only(enable(a), test::cmd_mode));
  hear(a, 1);
  EXPECT_TRUE(only(enable(a), test::cmd_axis_state));
}

TEST(OdriveAxis, TwoHeartbeatsInClosedLoopMakeItReady) {
  OdriveAxis a = axis();
  EXPECT_FALSE(a.ready());
  ask(a);
  EXPECT_FALSE(a.ready());
  hear(a, 8);
  EXPECT_FALSE(a.ready());
  hear(a, 8);
  EXPECT_TRUE(a.ready());
  EXPECT_TRUE(enable(a).empty()) << "nothing more to ask for";
  for (int i = 0; i < 300; ++i) {
    hear(a, 8);
    ASSERT_TRUE(a.ready()) << i;
  }
  hear(a, 1);
  hear(a, 8);
  EXPECT_FALSE(a.ready()) << "twice, however often before";
}

TEST(OdriveAxis, AnythingButClosedLoopWithoutErrorStartsTheCountAgain) {
  for (unsigned state = 0; state < 256; ++state) {
    if (state == 8) continue;
    OdriveAxis a = axis();
    ask(a);
    hear(a, 8);
    hear(a, static_cast<std::uint8_t>(state));
    hear(a, 8);
    EXPECT_FALSE(a.ready()) << "state " << state << " in between";
    hear(a, 8);
    EXPECT_TRUE(a.ready());
  }
  for (int bit = 0; bit < 32; ++bit) {
    OdriveAxis a = axis();
    ask(a);
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
/// request and never two, whenever the heartbeat falls.
TEST(OdriveAxis, AnAxisWithoutPowerIsNeverReady) {
  for (const int period : {1, 3, 7, 12}) {
    for (const std::uint32_t error : {0U, 0x200U}) {
      OdriveAxis a = axis();
      int requests = 0;
      std::uint8_t state = 1;
      std::uint32_t reported = 0;
      for (int tick = 0; tick < 1000; ++tick) {
        a.begin_tick();
        if (tick % period == 0) {
          (void)a.receive(test::heartbeat(node, state, reported));
          if (state == 8) reported = error;
          state = 1;
        }
        for (const CanFrame& f : enable(a)) {
          if (test::command_of(f) == test::cmd_clear_errors) reported = 0;
          if (test::command_of(f) != test::cmd_axis_state) continue;
          state = 8;
          ++requests;
        }
        ASSERT_FALSE(a.ready()) << tick;
      }
      EXPECT_GT(requests, 15) << period;
    }
  }
}

/// The second heartbeat may come later than the retry: ODrive's default is one every 100 ms.
TEST(OdriveAxis, AConfirmationHoldsTheRetryBackOnce) {
  OdriveAxis a = axis();
  ask(a);
  for (int i = 0; i < 7; ++i) EXPECT_TRUE(enable(a).empty());
  hear(a, 8);
  for (int i = 0; i < 7; ++i) EXPECT_TRUE(enable(a).empty());
  hear(a, 8);
  EXPECT_TRUE(a.ready());
  OdriveAxis b = axis();
  ask(b);
  hear(b, 8);
  std::uint32_t quiet = 0;
  while (enable(b).empty() && quiet < 100) ++quiet;
  EXPECT_EQ(quiet, 2 * retry - 1);
  EXPECT_FALSE(b.ready());
}

/// CAN delivers a frame twice when the sender alone sees an error in its last bit; a backlog looks the same.
TEST(OdriveAxis, AHeartbeatReceivedTwiceInATickConfirmsOnce) {
  OdriveAxis a = axis();
  ask(a);
  a.begin_tick();
  EXPECT_EQ(a.receive(test::heartbeat(node, 8)), Received::accepted);
  EXPECT_EQ(a.receive(test::heartbeat(node, 8)), Received::accepted);
  EXPECT_FALSE(a.ready());
}

TEST(OdriveAxis, TheWholeSequenceIsRepeatedRetryTicksAfterTheRequest) {
  OdriveAxis a = axis();
  for (std::uint32_t tick = 0; tick < 5 * (retry + 1); ++tick) {
    hear(a, 1);
    const auto sent = enable(a);
    switch (tick % (retry + 1)) {
      case 0: EXPECT_TRUE(only(sent, test::cmd_mode)) << tick; break;
      case 1: EXPECT_TRUE(only(sent, test::cmd_axis_state)) << tick; break;
      default: EXPECT_TRUE(sent.empty()) << tick;
    }
  }
}

TEST(OdriveAxis, AskingAgainDoesNotWaitForTheRetryAndForgetsWhatWasConfirmed) {
  OdriveAxis a = axis();
  ask(a);
  hear(a, 8);
  EXPECT_TRUE(enable(a).empty());
  a.ask_again();
  EXPECT_TRUE(only(enable(a), test::cmd_mode));
  hear(a, 8);
  EXPECT_FALSE(a.ready());
  EXPECT_TRUE(only(enable(a), test::cmd_axis_state));
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
  EXPECT_TRUE(only(enable(a), test::cmd_mode));
  for (int i = 0; i < 5; ++i) hear(a, 8);
  EXPECT_FALSE(a.ready());
  EXPECT_TRUE(only(enable(a), test::cmd_axis_state));
  EXPECT_FALSE(a.ready());
}

TEST(OdriveAxis, DisablingAsksForIdleAndForgetsTheConfirmations) {
  OdriveAxis a = ready_axis();
  const auto sent = disable(a);
  ASSERT_EQ(sent.size(), 1U);
  EXPECT_EQ(sent[0].id, 0x067U);
  EXPECT_EQ(test::word(sent[0], 0), 1U);
  EXPECT_FALSE(a.ready());
  EXPECT_TRUE(only(enable(a), test::cmd_mode)) << "and begins again at once";
  hear(a, 8);
  EXPECT_FALSE(a.ready());
}

TEST(OdriveAxis, DisablingASilentAxisDoesNotDelayTheNextCall) {
  OdriveAxis a = axis();
  a.begin_tick();
  EXPECT_TRUE(only(enable(a), test::cmd_mode));
  (void)disable(a);
  EXPECT_TRUE(only(enable(a), test::cmd_mode));
}

/// Owed from the request until it has said idle after being asked for it.
TEST(OdriveAxis, MustBeReleasedFromTheRequestUntilItSaysIdle) {
  OdriveAxis a = axis();
  hear(a, 1);
  (void)enable(a);
  EXPECT_FALSE(a.must_be_released());
  hear(a, 1);
  EXPECT_TRUE(only(enable(a), test::cmd_axis_state));
  EXPECT_TRUE(a.must_be_released());
  hear(a, 1);
  EXPECT_TRUE(a.must_be_released()) << "not yet there, or gone by itself";
  hear(a, 8);
  EXPECT_TRUE(a.must_be_released());
  (void)disable(a);
  EXPECT_TRUE(a.must_be_released());
  hear(a, 8);
  EXPECT_TRUE(a.must_be_released());
  hear(a, 1);
  EXPECT_FALSE(a.must_be_released());
}

TEST(OdriveAxis, DisablingWhileWaitingForARetryDoesNotDelayTheNextRequest) {
  OdriveAxis a = axis();
  ask(a);
  (void)enable(a);
  (void)disable(a);
  EXPECT_TRUE(only(enable(a), test::cmd_mode));
}

/// What a drive said before it was asked to do something else says nothing about what it does now.
TEST(OdriveAxis, IdleIsWhatIsHeardAfterTheLastRequest) {
  OdriveAxis a = axis();
  hear(a, 1);
  EXPECT_TRUE(a.idle());
  ask(a);
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

TEST(OdriveAxis, OnlyAnEncoderFrameBringsASample) {
  OdriveAxis a = axis();
  EXPECT_FALSE(a.brought_sample());
  for (int n = 0; n < 2; ++n) {
    hear(a, 1);
    EXPECT_FALSE(a.brought_sample());
    ASSERT_EQ(a.receive(test::encoder(node, 0, 0)), Received::accepted);
    EXPECT_TRUE(a.brought_sample());
    ASSERT_EQ(a.receive(test::encoder(node, 0, 0)), Received::accepted);
    EXPECT_TRUE(a.brought_sample());
  }
  ASSERT_EQ(a.receive(test::message(node, 0x02, 0, 0, 0)), Received::accepted);
  EXPECT_FALSE(a.brought_sample()) << "an emergency stop";
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

// ---- emergency stop --------------------------------------------------------------------------------------------

constexpr std::uint32_t estop_bit(Version v) { return v == Version::v0_6 ? 0x02000000 : 0x00004000; }

/// Whatever an enabling tick sends to an axis that reports this.
bool clears(OdriveAxis& a, std::uint8_t state, std::uint32_t error) {
  hear(a, state, error);
  bool cleared = false;
  for (const CanFrame& f : enable(a)) {
    cleared = cleared || test::command_of(f) == test::cmd_clear_errors;
    EXPECT_NE(test::command_of(f), test::cmd_axis_state) << "it is stopped";
  }
  return cleared;
}

TEST(OdriveAxis, AnEmergencyStopIsNeverClearedWithoutAnAcknowledgementWhateverElseIsReported) {
  for (const Version v : {Version::v0_6, Version::v0_5_6}) {
    for (const std::uint32_t others : {0U, 0x200U, 0x01000800U}) {
      for (const bool before : {false, true}) {  // before the first clean heartbeat, or after it
        OdriveAxis a = axis(v);
        if (!before) {
          ask(a);
          hear(a, 8);
        }
        for (int i = 0; i < 100; ++i) {
          EXPECT_FALSE(clears(a, 1, estop_bit(v) | others));
          EXPECT_TRUE(a.emergency_stopped());
        }
        hear(a, 1);
        EXPECT_TRUE(a.emergency_stopped()) << "somebody else has cleared it: latched all the same";
      }
    }
  }
}

/// Pressed and not yet reported when the errors of something else are to be cleared.
TEST(OdriveAxis, AnEmergencyStopSeenOnTheBusStopsTheClearingOfOtherErrors) {
  OdriveAxis a = axis();
  hear(a, 1, 0x200);
  EXPECT_TRUE(only(enable(a), test::cmd_mode));
  EXPECT_EQ(a.receive(test::message(node, 0x02, 0, 0, 0)), Received::accepted);
  EXPECT_TRUE(a.emergency_stopped());
  for (int i = 0; i < 100; ++i) EXPECT_FALSE(clears(a, 1, 0x200));
}

/// Between the report of an error and the next one anything may have happened.
TEST(OdriveAxis, ErrorsAreClearedInTheTickOfTheirReportOrNotAtAll) {
  OdriveAxis a = axis();
  hear(a, 1, 0x200);
  EXPECT_TRUE(only(enable(a), test::cmd_mode));
  hear(a, 1, 0x200);
  a.begin_tick();
  EXPECT_TRUE(enable(a).empty());
  hear(a, 1, 0x200);
  EXPECT_TRUE(only(enable(a), test::cmd_clear_errors));
}

/// An error with a cause comes back at once: it is cleared once per retry time, not at the pace of the heartbeats.
TEST(OdriveAxis, AnErrorThatStaysIsClearedOncePerRetryTime) {
  OdriveAxis a = axis();
  std::vector<int> cleared, begun;
  for (int tick = 0; tick < 45; ++tick) {
    hear(a, 1, 0x200);
    for (const CanFrame& f : enable(a)) (test::command_of(f) == test::cmd_clear_errors ? cleared : begun).push_back(tick);
  }
  EXPECT_EQ(begun, (std::vector<int>{0, 10, 20, 30, 40})) << "and all of it from the start";
  EXPECT_EQ(cleared, (std::vector<int>{1, 11, 21, 31, 41}));
}

TEST(OdriveAxis, AnAcknowledgedEmergencyStopIsClearedOnce) {
  for (const Version v : {Version::v0_6, Version::v0_5_6}) {
    OdriveAxis a = axis(v);
    hear(a, 1, estop_bit(v));
    a.acknowledge();
    EXPECT_FALSE(a.emergency_stopped());
    EXPECT_FALSE(clears(a, 1, estop_bit(v))) << "the mode comes first";
    EXPECT_TRUE(clears(a, 1, estop_bit(v)));
    EXPECT_FALSE(a.emergency_stopped()) << "until it is heard again";
    hear(a, 1, estop_bit(v));
    EXPECT_TRUE(a.emergency_stopped()) << "pressed again, or never released";
  }
}

TEST(OdriveAxis, AnEmergencyStopAfterTheAcknowledgementStopsAgain) {
  OdriveAxis a = axis();
  hear(a, 1, estop_bit(Version::v0_6));
  a.acknowledge();
  hear(a, 1);
  EXPECT_FALSE(a.emergency_stopped());
  hear(a, 1, estop_bit(Version::v0_6));
  EXPECT_TRUE(a.emergency_stopped());
  a.acknowledge();
  (void)a.receive(test::message(node, 0x02, 0, 0, 0));
  EXPECT_TRUE(a.emergency_stopped());
}

TEST(OdriveAxis, EmergencyStopsToItOrToAllAreItsOwnInAnyFormat) {
  for (const Version v : {Version::v0_6, Version::v0_5_6}) {
    for (std::uint32_t id = 0; id <= 0x7FF; ++id) {
      for (const bool remote : {false, true}) {
        CanFrame f = test::message(0, 0, 0, 0, static_cast<std::uint8_t>(id % 9));
        f.id = id;
        f.remote = remote;
        OdriveAxis a = axis(v);
        (void)a.receive(f);
        const bool mine = id == 0x062 || (id == 0x7E2 && v == Version::v0_6);  // 0.5.6 has no node for all
        EXPECT_EQ(a.emergency_stopped(), mine) << std::hex << id;
        f.extended = true;
        OdriveAxis b = axis(v);
        EXPECT_EQ(b.receive(f), Received::not_mine);
        EXPECT_FALSE(b.emergency_stopped());
      }
    }
  }
}

// ---- which frames ----------------------------------------------------------------------------------------------

TEST(OdriveAxis, TakesItsHeartbeatItsEncoderAndEmergencyStopsAmongAllIdentifiers) {
  for (const Version v : {Version::v0_6, Version::v0_5_6}) {
    const bool newer = v == Version::v0_6;
    for (const unsigned command : {test::cmd_heartbeat, test::cmd_encoder}) {
      for (std::uint32_t id = 0; id <= 0x7FF; ++id) {
        CanFrame f = test::message(node, command, 0, 0);
        f.id = id;
        OdriveAxis a = axis(v);
        const bool to_us = id / 32 == node || (newer && id / 32 == 0x3F);  // 0.5.6 has no node for all
        const bool mine = id == 0x061 || id == 0x069 || (to_us && id % 32 == 0x02);
        const bool ours = to_us && test::is_command(id % 32, newer);  // what we alone may send
        EXPECT_EQ(a.receive(f), mine ? Received::accepted : (ours ? Received::impostor : Received::not_mine))
            << std::hex << id;
        f.remote = true;
        if (ours) {
          EXPECT_EQ(a.receive(f), newer ? Received::not_mine : Received::impostor)
              << std::hex << id << ": a request is no command, but 0.5.6 does not look";
        }
      }
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
  EXPECT_FALSE(a.heard_this_tick());
  (void)a.receive(test::encoder(node, 0, 0));
  EXPECT_TRUE(a.heard_this_tick());
  EXPECT_EQ(a.sample_age_ticks(), 0U);
  EXPECT_EQ(a.heartbeat_age_ticks(), OdriveAxis::age_max);
  for (std::uint32_t tick = 1; tick <= 20; ++tick) {
    a.begin_tick();
    EXPECT_EQ(a.sample_age_ticks(), tick);
    EXPECT_FALSE(a.heard_this_tick());
  }
  (void)a.receive(test::heartbeat(node, 1));
  EXPECT_FALSE(a.heard_this_tick()) << "a heartbeat is no sample";
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

/// A gear ratio of 1e-40 makes infinity of a torque that is finite at the joint, and 1e-30 makes 2e30 N m.
TEST(OdriveAxis, ATorqueThatNoShaftHasIsNotPutIntoAFrame) {
  for (const float gear : {1e-40F, 1e-30F, 1e-5F, 0.0F, NAN, INFINITY}) {
    const OdriveAxis a({node, -1.0F, gear, 0.0F}, Version::v0_6, retry);
    for (const double torque : {2.0, -2.0, static_cast<double>(NAN), static_cast<double>(INFINITY)}) {
      if (gear == INFINITY && std::abs(torque) == 2.0) continue;  // a zero
      EXPECT_FALSE(a.can_carry(torque)) << gear << ' ' << torque;
      EXPECT_EQ(test::real(a.torque_frame(torque), 0), 0.0F) << gear << ' ' << torque;
      EXPECT_EQ(test::real(a.torque_frame(static_cast<float>(torque)), 0), 0.0F) << gear << ' ' << torque;
    }
  }
  const OdriveAxis a = axis();
  EXPECT_TRUE(a.can_carry(1e4) && a.can_carry(-1e4F));
  EXPECT_FALSE(a.can_carry(1.0001e4) || a.can_carry(-1.0001e4F));
  EXPECT_EQ(test::real(a.torque_frame(1e4F), 0), 1e4F);
}

// ---- the watchdog has to bite once ------------------------------------------------------------------------------

constexpr std::uint32_t watchdog_bit(Version v) { return v == Version::v0_6 ? 0x01000000U : 0x00000800U; }

/// An axis with a watchdog to prove, in closed loop and confirmed twice.
OdriveAxis starving(Version v, std::uint32_t ticks = 20) {
  OdriveAxis a = axis(v);
  a.prove_watchdog(ticks);
  hear(a, 1);
  ask(a);
  hear(a, 8);
  a.begin_tick();
  hear(a, 8);
  return a;
}

TEST(OdriveAxis, AWatchdogToBeProvenIsStarvedOnceBeforeTheAxisIsReady) {
  for (const Version v : {Version::v0_6, Version::v0_5_6}) {
    OdriveAxis a = starving(v);
    EXPECT_TRUE(a.muted());
    EXPECT_FALSE(a.ready());
    for (int n = 0; n < 5; ++n) {
      a.begin_tick();
      hear(a, 8);
      EXPECT_TRUE(enable(a).empty()) << "nothing may feed it";
      EXPECT_TRUE(a.muted());
      EXPECT_FALSE(a.ready());
    }
    a.begin_tick();
    hear(a, 1, watchdog_bit(v));
    (void)enable(a);
    EXPECT_FALSE(a.muted());
    EXPECT_FALSE(a.contradicted());
    // All of it once more, and then it is ready at the second heartbeat.
    for (int n = 0; n < 10 && !a.closed_loop(); ++n) {
      a.begin_tick();
      hear(a, 1, n < 2 ? watchdog_bit(v) : 0);
      for (const CanFrame& f : enable(a)) {
        if ((f.id & 0x1FU) == test::cmd_axis_state) hear(a, 8);
      }
    }
    a.begin_tick();
    hear(a, 8);
    EXPECT_TRUE(a.ready());
    EXPECT_FALSE(a.muted());
  }
}

/// A watchdog that was switched on and not saved is off after a restart, and 0.5.6 cannot be asked.
TEST(OdriveAxis, AnAxisThatWasSilentHasToProveItsWatchdogAgain) {
  for (const std::uint32_t silent : {retry, retry + 1}) {
    OdriveAxis a = starving(Version::v0_5_6);
    hear(a, 1, watchdog_bit(Version::v0_5_6));
    (void)enable(a);
    (void)disable(a);
    hear(a, 1);
    for (std::uint32_t n = 1; n < silent; ++n) a.begin_tick();
    ask(a);
    hear(a, 8);
    hear(a, 8);
    EXPECT_EQ(a.muted(), silent > retry) << silent;
    EXPECT_EQ(a.ready(), silent <= retry) << silent;
  }
}

TEST(OdriveAxis, AWatchdogThatDoesNotExpireIsAContradictionUntilTheAxisIsReleased) {
  OdriveAxis a = starving(Version::v0_6, 20);
  for (int n = 1; n <= 21; ++n) {
    EXPECT_FALSE(a.contradicted()) << n;
    a.begin_tick();
    hear(a, 8);
    (void)enable(a);
  }
  EXPECT_TRUE(a.contradicted());
  EXPECT_TRUE(a.watchdog_is_off());
  EXPECT_FALSE(a.ready());
  (void)disable(a);
  EXPECT_FALSE(a.contradicted());
  EXPECT_FALSE(a.muted());
}

TEST(OdriveAxis, AnotherErrorIsNoProofOfAWatchdog) {
  OdriveAxis a = starving(Version::v0_6);
  a.begin_tick();
  hear(a, 1, 0x40);
  (void)enable(a);
  EXPECT_FALSE(a.muted());
  for (int n = 0; n < 400 && !a.muted(); ++n) {
    a.begin_tick();
    hear(a, a.closed_loop() ? 8 : 1);
    for (const CanFrame& f : enable(a)) {
      if ((f.id & 0x1FU) == test::cmd_axis_state) hear(a, 8);
    }
  }
  EXPECT_TRUE(a.muted()) << "it is starved again";
  EXPECT_FALSE(a.ready());
}

/// It may leave closed loop without a word: no proof either.
TEST(OdriveAxis, LeavingClosedLoopEndsTheStarving) {
  OdriveAxis a = starving(Version::v0_6);
  hear(a, 1);
  EXPECT_TRUE(enable(a).empty());
  EXPECT_FALSE(a.muted());
  ask(a);
  hear(a, 8);
  hear(a, 8);
  EXPECT_TRUE(a.muted()) << "it is starved again";
}

/// In the tick after the last one that it has: in time.
TEST(OdriveAxis, AWatchdogMayExpireInTheLastTick) {
  OdriveAxis a = starving(Version::v0_6, 1);
  ASSERT_TRUE(a.muted());
  hear(a, 8);
  EXPECT_TRUE(enable(a).empty());
  EXPECT_FALSE(a.contradicted());
  hear(a, 1, watchdog_bit(Version::v0_6));
  EXPECT_TRUE(enable(a).empty());
  EXPECT_FALSE(a.contradicted() || a.muted());
}

TEST(OdriveAxis, EveryStarvingHasAllItsTicks) {
  OdriveAxis a = starving(Version::v0_6, 20);
  for (int round = 0; round < 3; ++round) {
    for (int n = 0; n < 15; ++n) {
      hear(a, 8);
      (void)enable(a);
    }
    EXPECT_TRUE(a.muted());
    EXPECT_FALSE(a.contradicted()) << round;
    hear(a, 1, 0x40);
    (void)enable(a);
    ask(a);
    hear(a, 8);
    hear(a, 8);
  }
}

/// An axis may report an error and stay in closed loop: no proof, and no reason to go on starving it.
TEST(OdriveAxis, AnErrorInClosedLoopEndsTheStarvingWithoutAProof) {
  for (const std::uint32_t error : {0x40U, watchdog_bit(Version::v0_6)}) {
    OdriveAxis a = starving(Version::v0_6);
    hear(a, 8, error);
    EXPECT_TRUE(enable(a).empty());
    EXPECT_FALSE(a.muted());
    EXPECT_FALSE(a.contradicted());
    hear(a, 1);
    EXPECT_TRUE(only(enable(a), test::cmd_mode)) << "from the start";
    hear(a, 1);
    EXPECT_TRUE(only(enable(a), test::cmd_axis_state));
    hear(a, 8);
    hear(a, 8);
    EXPECT_TRUE(a.muted()) << "it is starved again";
  }
}

}  // namespace
