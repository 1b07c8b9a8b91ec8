/// Errors, emergency stops, and the watchdog that has to bite once before the first torque.

#include <gtest/gtest.h>

#include <cstdint>
#include <vector>

#include "tests/support/odrive_bench.hpp"

namespace esmc::test {
namespace {

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

// ---- emergency stop

constexpr std::uint32_t estop_bit(Version v) { return v == Version::v0_6 ? 0x02000000 : 0x00004000; }

/// Whatever an enabling tick sends to an axis that reports this.
bool clears(OdriveAxis& a, std::uint8_t state, std::uint32_t error) {
  hear(a, state, error);
  bool cleared = false;
  for (const CanFrame& f : enable(a)) {
    cleared = cleared || command_of(f) == cmd_clear_errors;
    EXPECT_NE(command_of(f), cmd_axis_state) << "it is stopped";
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
        EXPECT_TRUE(a.emergency_stopped()) << "another node has cleared it: latched all the same";
      }
    }
  }
}

/// Pressed and not yet reported when the errors of something else are to be cleared.
TEST(OdriveAxis, AnEmergencyStopSeenOnTheBusStopsTheClearingOfOtherErrors) {
  OdriveAxis a = axis();
  hear(a, 1, 0x200);
  EXPECT_TRUE(only(enable(a), cmd_mode));
  EXPECT_EQ(a.receive(message(node, 0x02, 0, 0, 0)), Received::accepted);
  EXPECT_TRUE(a.emergency_stopped());
  for (int i = 0; i < 100; ++i) EXPECT_FALSE(clears(a, 1, 0x200));
}

/// Between the report of an error and the next one anything may have happened.
TEST(OdriveAxis, ErrorsAreClearedInTheTickOfTheirReportOrNotAtAll) {
  OdriveAxis a = axis();
  hear(a, 1, 0x200);
  EXPECT_TRUE(only(enable(a), cmd_mode));
  hear(a, 1, 0x200);
  a.begin_tick();
  EXPECT_TRUE(enable(a).empty());
  hear(a, 1, 0x200);
  EXPECT_TRUE(only(enable(a), cmd_clear_errors));
}

/// Of 0.5.6, which clears both axes of a board: not while the other one's errors are unknown, and at the 16th
/// report where they are known and never fresh. 0.6 clears one axis.
TEST(OdriveAxis, ErrorsAreClearedWhenThoseOfTheOtherAxisAreKnown) {
  for (const Version v : {Version::v0_6, Version::v0_5_6}) {
    for (const bool known : {false, true}) {
      for (const bool fresh : {false, true}) {
        OdriveAxis a = axis(v);
        hear(a, 1, 0x200);
        EXPECT_TRUE(only(enable(a), cmd_mode));
        int reports = 0;
        for (bool cleared = false; reports < 40 && !cleared; ++reports) {
          a.know_errors(known, fresh);
          hear(a, 1, 0x200);
          for (const CanFrame& f : enable(a)) cleared = cleared || command_of(f) == cmd_clear_errors;
        }
        EXPECT_EQ(reports, v == Version::v0_6 || (known && fresh) ? 1 : known ? 16 : 40);
      }
    }
  }
}

/// An error with a cause comes back at once: it is cleared once per retry time, not at the pace of the
/// heartbeats.
TEST(OdriveAxis, AnErrorThatStaysIsClearedOncePerRetryTime) {
  OdriveAxis a = axis();
  std::vector<int> cleared, begun;
  for (int tick = 0; tick < 45; ++tick) {
    hear(a, 1, 0x200);
    for (const CanFrame& f : enable(a)) (command_of(f) == cmd_clear_errors ? cleared : begun).push_back(tick);
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
  (void)a.receive(message(node, 0x02, 0, 0, 0));
  EXPECT_TRUE(a.emergency_stopped());
}

TEST(OdriveAxis, EmergencyStopsToItOrToAllAreItsOwnInAnyFormat) {
  for (const Version v : {Version::v0_6, Version::v0_5_6}) {
    for (std::uint32_t id = 0; id <= 0x7FF; ++id) {
      for (const bool remote : {false, true}) {
        CanFrame f = message(0, 0, 0, 0, static_cast<std::uint8_t>(id % 9));
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

// ---- the watchdog has to bite once

constexpr std::uint32_t watchdog_bit(Version v) { return v == Version::v0_6 ? 0x01000000U : 0x00000800U; }

/// An axis with a watchdog to prove, in closed loop and confirmed twice.
OdriveAxis starving(Version v, std::uint32_t ticks = 20) {
  OdriveAxis a = axis(v);
  a.prove_watchdog(ticks);
  hear(a, 1);
  arm(a);
  return a;
}

/// The watchdog has tripped.
void bite(OdriveAxis& a, Version v = Version::v0_6) {
  hear(a, 1, watchdog_bit(v));
  (void)enable(a);
}
/// A heartbeat, and another one in closed loop where that is asked for.
void obey(OdriveAxis& a, std::uint8_t state, std::uint32_t error = 0) {
  hear(a, state, error);
  for (const CanFrame& f : enable(a)) {
    if (command_of(f) == cmd_axis_state) hear(a, 8);
  }
}

TEST(OdriveAxis, AWatchdogToBeProvenIsStarvedOnceBeforeTheAxisIsReady) {
  for (const Version v : {Version::v0_6, Version::v0_5_6}) {
    OdriveAxis a = starving(v);
    EXPECT_TRUE(a.tx_suspended());
    EXPECT_FALSE(a.ready());
    for (int n = 0; n < 5; ++n) {
      a.begin_tick();
      hear(a, 8);
      EXPECT_TRUE(enable(a).empty()) << "nothing may feed it";
      EXPECT_TRUE(a.tx_suspended());
      EXPECT_FALSE(a.ready());
    }
    bite(a, v);
    EXPECT_FALSE(a.tx_suspended());
    EXPECT_FALSE(a.config_mismatch());
    // All of it once more, and then it is ready at the second heartbeat.
    for (int n = 0; n < 10 && !a.closed_loop(); ++n) {
      obey(a, 1, n < 2 ? watchdog_bit(v) : 0);
    }
    a.begin_tick();
    hear(a, 8);
    EXPECT_TRUE(a.ready());
    EXPECT_FALSE(a.tx_suspended());
  }
}

/// A watchdog that was switched on and not saved is off after a restart, and 0.5.6 cannot be asked.
TEST(OdriveAxis, AnAxisThatWasSilentHasToProveItsWatchdogAgain) {
  for (const std::uint32_t silent : {retry, retry + 1}) {
    OdriveAxis a = starving(Version::v0_5_6);
    bite(a, Version::v0_5_6);
    (void)disable(a);
    hear(a, 1);
    for (std::uint32_t n = 1; n < silent; ++n) a.begin_tick();
    arm(a);
    EXPECT_EQ(a.tx_suspended(), silent > retry) << silent;
    EXPECT_EQ(a.ready(), silent <= retry) << silent;
  }
}

/// Where heartbeats may be missing for longer than `retry`, an axis that runs is not tested again when they
/// come back: torque goes on.
TEST(OdriveAxis, AnAxisThatRunsIsNeverStarved) {
  for (const std::uint32_t silent : {retry, retry + 1, 3 * retry}) {
    OdriveAxis a = starving(Version::v0_6, silent == retry + 1 ? 1 : 20);
    bite(a);
    arm(a);
    ASSERT_TRUE(a.ready());
    for (std::uint32_t n = 0; n < silent; ++n) a.begin_tick();  // the cycle runs: nobody calls enable()
    for (int n = 0; n < 4; ++n) {
      a.begin_tick();
      hear(a, 8);
      EXPECT_FALSE(a.tx_suspended()) << silent;
      EXPECT_TRUE(a.closed_loop());
    }
    // Enabled the next time it has to prove its watchdog again.
    (void)disable(a);
    hear(a, 1);
    arm(a);
    EXPECT_EQ(a.tx_suspended(), silent >= retry) << silent;
  }
}

/// Out of closed loop without having been asked: if it was not the watchdog, it may have restarted.
TEST(OdriveAxis, AnAxisThatFellIdleHasToProveItsWatchdogAgain) {
  for (const bool bitten : {false, true}) {
    OdriveAxis a = starving(Version::v0_6);
    bite(a);
    arm(a);
    ASSERT_TRUE(a.ready());
    hear(a, 1, bitten ? watchdog_bit(Version::v0_6) : 0);
    EXPECT_FALSE(a.ready());
    for (std::uint32_t n = 0; n < 4 * retry && !a.ready() && !a.tx_suspended(); ++n) {
      obey(a, a.closed_loop() ? 8 : 1);
    }
    EXPECT_EQ(a.tx_suspended(), !bitten);
    EXPECT_EQ(a.ready(), bitten);
  }
}

/// 0.5.6 feeds its watchdog with any frame: a node that polls it keeps our last torque alive after us.
TEST(OdriveAxis, AnyFrameThatFeedsThe056WatchdogIsForeign) {
  for (unsigned command = 0; command < 32; ++command) {
    OdriveAxis old = axis(Version::v0_5_6), now = axis(Version::v0_6);
    CanFrame poll = message(node, command, 0, 0, 0);
    for (const bool remote : {false, true}) {
      poll.remote = remote;
      poll.size = remote ? 8 : 0;
      const Received r = old.receive(poll);
      const bool ours = command == 0x01 || command == 0x09;  // which have a length
      EXPECT_EQ(r, command == 0x02 ? Received::accepted
                   : ours          ? Received::malformed
                                   : Received::foreign_command)
          << command;
      const bool asks = remote && command != 0x01 && command != 0x02 && command != 0x09;
      EXPECT_TRUE(!asks || now.receive(poll) == Received::not_mine)
          << command << ": 0.6 feeds it with set points only";
    }
  }
}

/// While it is being enabled, the whole sequence begins anew: the mode that it was told may be gone.
TEST(OdriveAxis, AnAxisThatWasSilentBeforeItConfirmedIsToldItsModeAgain) {
  OdriveAxis a = axis(Version::v0_6);
  a.prove_watchdog(20);
  hear(a, 1);
  ask(a);
  for (std::uint32_t n = 0; n <= retry + 1; ++n) a.begin_tick();
  const auto sent = enable(a);
  ASSERT_EQ(sent.size(), 1U);
  EXPECT_EQ(sent[0].id & 0x1FU, cmd_mode);
}

/// Without heartbeats the starving goes on: nothing may be sent to a drive of which nothing is known.
TEST(OdriveAxis, ASilentDriveIsStarvedToTheEnd) {
  OdriveAxis a = starving(Version::v0_6, 5 * retry);
  for (std::uint32_t n = 0; n < 2 * retry; ++n) {
    a.begin_tick();
    EXPECT_TRUE(enable(a).empty()) << n;
    EXPECT_TRUE(a.tx_suspended()) << n;
  }
}

TEST(OdriveAxis, AWatchdogThatDoesNotExpireIsAContradictionUntilTheAxisIsReleased) {
  OdriveAxis a = starving(Version::v0_6, 20);
  for (int n = 1; n <= 21; ++n) {
    EXPECT_FALSE(a.config_mismatch()) << n;
    a.begin_tick();
    hear(a, 8);
    (void)enable(a);
  }
  EXPECT_TRUE(a.config_mismatch());
  EXPECT_FALSE(a.ready());
  (void)disable(a);
  EXPECT_FALSE(a.config_mismatch());
  EXPECT_FALSE(a.tx_suspended());
}

TEST(OdriveAxis, AnotherErrorIsNoProofOfAWatchdog) {
  OdriveAxis a = starving(Version::v0_6);
  a.begin_tick();
  hear(a, 1, 0x40);
  (void)enable(a);
  EXPECT_FALSE(a.tx_suspended());
  for (int n = 0; n < 400 && !a.tx_suspended(); ++n) {
    obey(a, a.closed_loop() ? 8 : 1);
  }
  EXPECT_TRUE(a.tx_suspended()) << "the watchdog is tested again";
  EXPECT_FALSE(a.ready());
}

/// It may leave closed loop without a word: no proof either.
TEST(OdriveAxis, LeavingClosedLoopEndsTheStarving) {
  OdriveAxis a = starving(Version::v0_6);
  hear(a, 1);
  EXPECT_TRUE(enable(a).empty());
  EXPECT_FALSE(a.tx_suspended());
  arm(a);
  EXPECT_TRUE(a.tx_suspended()) << "the watchdog is tested again";
}

/// In the tick after the last one that it has: in time.
TEST(OdriveAxis, AWatchdogMayExpireInTheLastTick) {
  OdriveAxis a = starving(Version::v0_6, 1);
  ASSERT_TRUE(a.tx_suspended());
  hear(a, 8);
  EXPECT_TRUE(enable(a).empty());
  EXPECT_FALSE(a.config_mismatch());
  hear(a, 1, watchdog_bit(Version::v0_6));
  EXPECT_TRUE(enable(a).empty());
  EXPECT_FALSE(a.config_mismatch() || a.tx_suspended());
}

TEST(OdriveAxis, EveryStarvingHasAllItsTicks) {
  OdriveAxis a = starving(Version::v0_6, 20);
  for (int round = 0; round < 3; ++round) {
    for (int n = 0; n < 15; ++n) {
      hear(a, 8);
      (void)enable(a);
    }
    EXPECT_TRUE(a.tx_suspended());
    EXPECT_FALSE(a.config_mismatch()) << round;
    hear(a, 1, 0x40);
    (void)enable(a);
    arm(a);
  }
}

/// An axis may report an error and stay in closed loop: no proof, and no reason to go on starving it.
TEST(OdriveAxis, AnErrorInClosedLoopEndsTheStarvingWithoutAProof) {
  for (const std::uint32_t error : {0x40U, watchdog_bit(Version::v0_6)}) {
    OdriveAxis a = starving(Version::v0_6);
    hear(a, 8, error);
    EXPECT_TRUE(enable(a).empty());
    EXPECT_FALSE(a.tx_suspended());
    EXPECT_FALSE(a.config_mismatch());
    hear(a, 1);
    EXPECT_TRUE(only(enable(a), cmd_mode)) << "from the start";
    hear(a, 1);
    EXPECT_TRUE(only(enable(a), cmd_axis_state));
    hear(a, 8);
    hear(a, 8);
    EXPECT_TRUE(a.tx_suspended()) << "the watchdog is tested again";
  }
}

}  // namespace
}  // namespace esmc::test
