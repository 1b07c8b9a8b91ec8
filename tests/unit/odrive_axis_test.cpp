/// How one axis is enabled and released, as the controller sees it. Expectations are computed here.

#include <gtest/gtest.h>

#include <cstdint>
#include <vector>

#include "tests/support/odrive_bench.hpp"

namespace esmc::test {
namespace {

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
    EXPECT_EQ(word(sent[0], 0), 1U) << "torque control";
    EXPECT_EQ(word(sent[0], 4), 1U) << "passthrough";
    EXPECT_EQ(sent[1].id, 0x078U);
    EXPECT_EQ(sent[1].size, v == Version::v0_6 ? 1 : 0);
    EXPECT_EQ(sent[2].id, 0x067U);
    EXPECT_EQ(word(sent[2], 0), 8U);
    for (const CanFrame& f : sent)
      EXPECT_TRUE(esmc::hal::well_formed(f) && !f.extended && !f.remote && !f.fd);
  }
}

/// Set_Axis_State has the smaller identifier: mailboxes sorted by it, or a mode frame that was dropped, would
/// arm the axis in the mode it has stored.
TEST(OdriveAxis, ClosedLoopIsAskedForOnlyAfterAHeartbeatThatIsNewerThanTheMode) {
  OdriveAxis a = axis();
  hear(a, 1);
  EXPECT_TRUE(only(enable(a), cmd_mode));
  for (std::uint32_t tick = 1; tick < retry; ++tick) {
    a.begin_tick();
    (void)a.receive(encoder(node, 0, 0));
    EXPECT_TRUE(enable(a).empty()) << "the heartbeat is older";
  }
  EXPECT_TRUE(only(enable(a), cmd_mode)) << "nothing was heard: again";
  hear(a, 1);
  EXPECT_TRUE(only(enable(a), cmd_axis_state));
}

TEST(OdriveAxis, WhatTheBusDidNotTakeIsSentAgainAndNotSkipped) {
  OdriveAxis a = axis();
  for (int i = 0; i < 5; ++i) {
    hear(a, 1, 0x200);
    EXPECT_TRUE(only(enable(a, false), cmd_mode)) << i;
  }
  EXPECT_TRUE(only(enable(a), cmd_mode));
  for (int i = 0; i < 5; ++i) {
    hear(a, 1, 0x200);
    EXPECT_TRUE(only(enable(a, false), cmd_clear_errors)) << i;
  }
  hear(a, 1, 0x200);
  EXPECT_TRUE(only(enable(a), cmd_clear_errors));
  for (int i = 0; i < 2; ++i) {
    hear(a, 1);
    EXPECT_TRUE(only(enable(a, false), cmd_axis_state)) << i;
  }
  EXPECT_FALSE(a.must_be_released());
  hear(a, 1);
  EXPECT_TRUE(only(enable(a), cmd_axis_state));
  EXPECT_TRUE(a.must_be_released());
}

/// A mode that was sent before the axis was there may have reached nobody.
TEST(OdriveAxis, ASilentAxisIsCalledEveryRetryTicksAndConfiguredOnceItIsHeard) {
  OdriveAxis a = axis();
  for (std::uint32_t tick = 0; tick < 5 * retry; ++tick) {
    a.begin_tick();
    const auto sent = enable(a);
    EXPECT_TRUE(tick % retry == 0 ? only(sent, cmd_mode) : sent.empty()) << "tick " << tick;
    EXPECT_FALSE(a.alive());
  }
  (void)enable(a);
  a.begin_tick();
  (void)a.receive(encoder(node, 0, 0));
  EXPECT_TRUE(a.alive());
  EXPECT_TRUE(only(enable(a), cmd_mode));
  hear(a, 1);
  EXPECT_TRUE(only(enable(a), cmd_axis_state));
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
  a.begin_enabling();
  EXPECT_TRUE(a.ready()) << "an axis in closed loop stays there";
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

/// An axis without motor power goes to state 8, notices, and drops out: it shows 8 in one heartbeat after
/// every request and never two, whenever the heartbeat falls.
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
          (void)a.receive(heartbeat(node, state, reported));
          if (state == 8) reported = error;
          state = 1;
        }
        for (const CanFrame& f : enable(a)) {
          if (command_of(f) == cmd_clear_errors) reported = 0;
          if (command_of(f) != cmd_axis_state) continue;
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
  EXPECT_EQ(a.receive(heartbeat(node, 8)), Received::accepted);
  EXPECT_EQ(a.receive(heartbeat(node, 8)), Received::accepted);
  EXPECT_FALSE(a.ready());
}

/// A heartbeat that says otherwise starts the count again within its tick, whatever was counted up to then.
TEST(OdriveAxis, AConfirmationAfterAnErrorInTheSameTickIsTheFirstOfANewCount) {
  OdriveAxis a = ready_axis();
  hear(a, 8);
  EXPECT_EQ(a.receive(heartbeat(node, 8, 1)), Received::accepted);
  EXPECT_FALSE(a.ready());
  EXPECT_EQ(a.receive(heartbeat(node, 8)), Received::accepted);
  EXPECT_FALSE(a.ready()) << "one tick without an error since";
  hear(a, 8);
  EXPECT_TRUE(a.ready()) << "two";
}

TEST(OdriveAxis, TheWholeSequenceIsRepeatedRetryTicksAfterTheRequest) {
  OdriveAxis a = axis();
  for (std::uint32_t tick = 0; tick < 5 * (retry + 1); ++tick) {
    hear(a, 1);
    const auto sent = enable(a);
    switch (tick % (retry + 1)) {
      case 0:
        EXPECT_TRUE(only(sent, cmd_mode)) << tick;
        break;
      case 1:
        EXPECT_TRUE(only(sent, cmd_axis_state)) << tick;
        break;
      default:
        EXPECT_TRUE(sent.empty()) << tick;
    }
  }
}

TEST(OdriveAxis, AskingAgainDoesNotWaitForTheRetryAndForgetsWhatWasConfirmed) {
  OdriveAxis a = axis();
  ask(a);
  hear(a, 8);
  EXPECT_TRUE(enable(a).empty());
  a.ask_again();
  EXPECT_TRUE(only(enable(a), cmd_mode));
  hear(a, 8);
  EXPECT_FALSE(a.ready());
  EXPECT_TRUE(only(enable(a), cmd_axis_state));
  hear(a, 8);
  EXPECT_FALSE(a.ready());
  hear(a, 8);
  EXPECT_TRUE(a.ready());
  a.ask_again();
  EXPECT_TRUE(a.ready() && enable(a).empty()) << "a ready axis is left alone";
}

/// A drive found in closed loop (left there by somebody else, in any control mode) is not ready: nobody has
/// told it to be in torque mode. Heartbeats count only after a request.
TEST(OdriveAxis, ConfirmationsBeforeARequestDoNotCount) {
  OdriveAxis a = axis();
  for (int i = 0; i < 5; ++i) hear(a, 8);
  EXPECT_FALSE(a.ready());
  EXPECT_TRUE(only(enable(a), cmd_mode));
  for (int i = 0; i < 5; ++i) hear(a, 8);
  EXPECT_FALSE(a.ready());
  EXPECT_TRUE(only(enable(a), cmd_axis_state));
  EXPECT_FALSE(a.ready());
}

TEST(OdriveAxis, DisablingAsksForIdleAndForgetsTheConfirmations) {
  OdriveAxis a = ready_axis();
  const auto sent = disable(a);
  ASSERT_EQ(sent.size(), 1U);
  EXPECT_EQ(sent[0].id, 0x067U);
  EXPECT_EQ(word(sent[0], 0), 1U);
  EXPECT_FALSE(a.ready());
  EXPECT_TRUE(only(enable(a), cmd_mode)) << "and begins again at once";
  hear(a, 8);
  EXPECT_FALSE(a.ready());
}

TEST(OdriveAxis, DisablingASilentAxisDoesNotDelayTheNextCall) {
  OdriveAxis a = axis();
  a.begin_tick();
  EXPECT_TRUE(only(enable(a), cmd_mode));
  (void)disable(a);
  EXPECT_TRUE(only(enable(a), cmd_mode));
}

/// Owed from the request until it has said idle after being asked for it.
TEST(OdriveAxis, MustBeReleasedFromTheRequestUntilItSaysIdle) {
  OdriveAxis a = axis();
  hear(a, 1);
  (void)enable(a);
  EXPECT_FALSE(a.must_be_released());
  hear(a, 1);
  EXPECT_TRUE(only(enable(a), cmd_axis_state));
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
  EXPECT_TRUE(only(enable(a), cmd_mode));
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

/// Firmware 0.5.6 reports position 0 and speed 0, wherever the shaft is, from a boot to the first closed
/// loop.
TEST(OdriveAxis, ZerosBeforeTheFirstClosedLoopAreNoSample) {
  OdriveAxis a = axis(Version::v0_5_6);
  const auto told = [&](float position, float speed) {
    EXPECT_EQ(a.receive(encoder(node, position, speed)), Received::accepted);
    EXPECT_TRUE(a.heard_this_tick()) << "it completes a set";
    return a.brought_sample();
  };
  a.begin_tick();
  EXPECT_FALSE(told(0.0F, 0.0F));
  EXPECT_FALSE(told(-0.0F, 0.0F));
  EXPECT_TRUE(a.encoder_unconnected());
  EXPECT_EQ(a.sample_age_ticks(), OdriveAxis::age_max);
  EXPECT_TRUE(told(0.0F, 1e-30F));
  EXPECT_TRUE(told(1e-30F, 0.0F)) << "0.5.5 reads the encoder";
  EXPECT_TRUE(told(0.0F, 0.0F)) << "from nearby it is an angle";
  EXPECT_TRUE(told(-0.25F, 0.0F));
  EXPECT_FALSE(told(0.0F, 0.0F)) << "from a distance it may have restarted";
  EXPECT_TRUE(told(0.25F, 0.0F));
  EXPECT_FALSE(told(0.0F, 0.0F)) << "whatever the side";
  ask(a);
  hear(a, 8);
  EXPECT_FALSE(told(0.0F, 0.0F));
  hear(a, 8);
  EXPECT_FALSE(a.ready()) << "before it has said where it is";
  EXPECT_TRUE(told(0.0F, 0.0F)) << "now it is a position";
  EXPECT_TRUE(a.ready());
  (void)disable(a);
  hear(a, 1);
  EXPECT_TRUE(told(0.0F, 0.0F)) << "the encoder stays connected";
  for (std::uint32_t i = 0; i <= retry; ++i) a.begin_tick();
  EXPECT_FALSE(told(0.0F, 0.0F)) << "silent for long: it may have restarted";

  OdriveAxis newer = axis(Version::v0_6);
  EXPECT_EQ(newer.receive(encoder(node, 0.0F, 0.0F)), Received::accepted);
  EXPECT_TRUE(newer.brought_sample()) << "0.6 reads the encoder";
}

TEST(OdriveAxis, BeforeTheFirstHeartbeatNothingIsKnown) {
  const OdriveAxis a = axis();
  EXPECT_FALSE(a.idle() || a.error() || a.closed_loop() || a.ready());
  EXPECT_EQ(a.heartbeat_age_ticks(), OdriveAxis::age_max);
  EXPECT_EQ(a.sample_age_ticks(), OdriveAxis::age_max);
}

}  // namespace
}  // namespace esmc::test
