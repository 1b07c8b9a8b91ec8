/// One CiA 402 axis as the controller sees it: state machine, what counts as alive, ready and idle.
/// Expectations are those of the profile.

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>

#include "tests/support/cia402_bench.hpp"

namespace esmc::test {
namespace {

// ---- state machine

TEST(Cia402Axis, EveryControlwordWaitsForTheStatuswordBefore) {
  Bench b;
  b.slave.obeys = false;
  ASSERT_TRUE(b.until([&] { return b.slave.state == 5; }));
  EXPECT_EQ(b.control(), 0U) << "no statusword yet";
  struct Step {
    unsigned status, control;
  };
  for (const Step s : {Step{0x0250, 0x06}, Step{0x0250, 0x06}, Step{0x0231, 0x07}, Step{0x0231, 0x07},
                       Step{0x0233, 0x0F}, Step{0x0233, 0x0F}}) {
    b.slave.status = s.status;
    b.tick();
    EXPECT_EQ(b.control(), s.control) << std::hex << s.status;
    EXPECT_EQ(b.axis.must_be_released(), s.control == 0x0F);
    EXPECT_FALSE(b.axis.ready());
  }
  b.slave.status = 0x0237;
  b.tick();
  EXPECT_FALSE(b.axis.ready()) << "once";
  EXPECT_TRUE(b.axis.closed_loop());
  b.tick();
  EXPECT_TRUE(b.axis.ready());
  b.tick();
  EXPECT_EQ(b.sent.size(), 1U) << "nothing more to ask for";
  EXPECT_EQ(b.control(), 0x0FU);
}

TEST(Cia402Axis, AnyStateOnTheWayIsAnsweredByWhatItNeeds) {
  struct Case {
    unsigned status, control;
  };
  for (const Case c :
       {Case{0x0200, 0x00}, Case{0x020F, 0x00}, Case{0x0207, 0x00}, Case{0x0250, 0x06}, Case{0x0231, 0x07},
        Case{0x0233, 0x0F}, Case{0x0237, 0x00}, Case{0x0208, 0x80}, Case{0x0201, 0x00}, Case{0x026F, 0x00}}) {
    Bench b;
    b.slave.obeys = false;
    b.slave.status = c.status;
    ASSERT_TRUE(b.until([&] { return b.slave.state == 5; }));
    for (int i = 0; i < 5; ++i) {
      b.tick();
      EXPECT_EQ(b.control(), c.control) << std::hex << c.status;
      EXPECT_FALSE(b.axis.ready()) << "not even where it is enabled: nobody has asked";
    }
  }
}

TEST(Cia402Axis, AFaultIsResetByAnEdgeAndOncePerTry) {
  Bench b;
  b.slave.obeys = false;
  b.slave.status = 0x0218;
  ASSERT_TRUE(b.until([&] { return b.slave.state == 5; }));
  EXPECT_EQ(b.control(), 0x00U) << "bit 7 must have been 0";
  b.slave.waiting.push_back(emergency_of(node, 0x8130));
  for (int i = 0; i < retry; ++i) {
    b.tick();
    ASSERT_EQ(b.control(), 0x80U) << i;
    EXPECT_EQ(b.axis.error_code(), 0U) << "what comes now is new";
    EXPECT_TRUE(b.axis.error());
  }
  b.tick();
  EXPECT_EQ(b.control(), 0x00U) << "it stays: everything from the start";
  b.slave.obeys = true;
  EXPECT_TRUE(b.make_ready());
  EXPECT_FALSE(b.axis.error());
}

TEST(Cia402Axis, AnErrorReportedByEmergencyKeepsTheAxisFromBeingReady) {
  Bench b;
  b.slave.obeys = false;
  b.slave.status = 0x0233;
  ASSERT_TRUE(b.until([&] { return b.control() == 0x0F; }));
  b.slave.status = 0x0237;
  b.slave.waiting.push_back(emergency_of(node, 0x4210));
  for (int i = 0; i < 5; ++i) b.tick();
  EXPECT_TRUE(b.axis.error());
  EXPECT_FALSE(b.axis.ready());
  b.slave.waiting.push_back(emergency_of(node, 0));
  b.tick();
  EXPECT_FALSE(b.axis.error());
  EXPECT_FALSE(b.axis.ready()) << "once since";
  b.tick();
  EXPECT_TRUE(b.axis.ready());
  EXPECT_EQ(b.hear(emergency_of(node, 0x2310)), Received::accepted);
  EXPECT_FALSE(b.axis.ready());
  EXPECT_EQ(b.axis.error_code(), 0x2310U);
}

/// A tick is judged with both PDOs of it; what one of them denies is not ready all the same.
TEST(Cia402Axis, OnePdoIsEnoughToBeNotReady) {
  Bench b;
  ASSERT_TRUE(b.make_ready());
  b.axis.begin_tick();
  EXPECT_EQ(b.hear(report_of(node, 0x0218)), Received::accepted) << "a fault, and the other PDO is lost";
  EXPECT_FALSE(b.axis.ready());
  EXPECT_EQ(b.hear(report_of(node, 0x1237)), Received::accepted);
  EXPECT_TRUE(b.axis.ready());
  EXPECT_EQ(b.hear(motion_of(node, 0, 1)), Received::accepted) << "another mode";
  EXPECT_FALSE(b.axis.ready());
}

TEST(Cia402Axis, AnotherModeIsNoTorqueControl) {
  for (const int mode : {0, 1, 4, -1, 9, 11}) {
    Bench b;
    b.slave.mode = mode;
    b.until([&] { return b.slave.status == 0x1237; });
    for (int i = 0; i < 3; ++i) b.tick();
    EXPECT_FALSE(b.axis.closed_loop());
    EXPECT_FALSE(b.axis.ready()) << mode;
    b.slave.mode = 10;
    EXPECT_TRUE(b.make_ready());
    b.slave.mode = mode;
    b.tick(false);
    EXPECT_FALSE(b.axis.closed_loop() || b.axis.ready()) << "seen in the tick in which it changes";
    b.slave.mode = 10;
    b.tick();
    EXPECT_FALSE(b.axis.ready()) << "once since";
    b.tick();
    EXPECT_TRUE(b.axis.ready());
  }
}

TEST(Cia402Axis, ADriveWithoutPowerIsSetUpOnce) {
  Bench b;
  b.slave.obeys = false;
  ASSERT_TRUE(b.until([&] { return b.control() == 0x06; }));
  bool again = false;
  for (int i = 0; i < 1000; ++i) {
    b.tick();
    again = again || b.axis.setting_up();
  }
  EXPECT_FALSE(again);
}

/// What may take its time while it is enabled, and what waits for power.
TEST(Cia402Axis, ASetUpAndItsRepetitionTakeTheirTimeAndNoMore) {
  Bench b;
  EXPECT_FALSE(b.axis.setting_up()) << "it is called";
  b.slave.obeys = false;
  ASSERT_TRUE(b.until([&] { return b.slave.writes.size() > 3; }));
  EXPECT_TRUE(b.axis.setting_up());
  ASSERT_TRUE(b.until([&] { return b.slave.state == 5; }));
  ASSERT_TRUE(b.until([&] { return b.control() == 0x06; }));
  EXPECT_FALSE(b.axis.setting_up()) << "switch on disabled: it waits for power";
  for (const unsigned status : {0x0231U, 0x0233U}) {
    b.slave.status = status;
    b.tick();
    EXPECT_TRUE(b.axis.setting_up()) << "on its way: " << std::hex << status;
  }
  b.slave.status = 0x0250;  // it falls back: all of it once more, and no third time
  const auto attempts = [&] { return std::ranges::count(b.slave.reads, entry(0x6502, 0)); };
  const auto before = attempts();
  std::vector<bool> seen(100);  // setting_up(), attempt by attempt
  for (int i = 0; i < 4000; ++i) {
    b.tick();
    const auto attempt = static_cast<std::size_t>(attempts() - before);
    seen.at(attempt) = seen.at(attempt) || b.axis.setting_up();
  }
  ASSERT_GE(attempts(), before + 3);
  EXPECT_TRUE(seen[1]);
  EXPECT_EQ(std::ranges::count(seen.begin() + 2, seen.end(), true), 0) << "a third attempt";
  b.disable();
  b.disable();
  ASSERT_TRUE(b.until([&] { return b.axis.setting_up(); })) << "a new order begins anew";
}

TEST(Cia402Axis, NoProgressLeadsBackToTheStart) {
  Bench b;
  b.slave.obeys = false;  // a drive without power stays in switch on disabled
  ASSERT_TRUE(b.until([&] { return b.control() == 0x06; }));
  for (int i = 0; i < retry - 1; ++i) {
    b.tick();
    ASSERT_EQ(b.control(), 0x06U) << i;
  }
  b.tick();
  EXPECT_EQ(b.control(), 0x00U) << "first the voltage off, while it listens";
  EXPECT_EQ(b.count(0x000), 0);
  b.tick();
  EXPECT_EQ(b.sent[0], nmt(0x80, node));
  // NMT start that leads to nothing.
  Bench deaf;
  ASSERT_TRUE(deaf.until([&] { return deaf.slave.writes.size() == setup_writes; }));
  deaf.tick();
  deaf.tick();
  EXPECT_EQ(deaf.sent[0], nmt(0x01, node));
  for (int i = 0; i < retry - 1; ++i) {
    deaf.slave.state = 0x7F;
    deaf.tick();
    EXPECT_EQ(deaf.count(0x000), 0) << i;
  }
  deaf.tick();
  EXPECT_EQ(deaf.count(0x000), 1);
}

TEST(Cia402Axis, ADriveThatFallsBackWhileEnablingIsSetUpAgain) {
  for (const int state : {0x00, 0x7F, 0x04}) {
    Bench b;
    b.slave.obeys = false;
    ASSERT_TRUE(b.until([&] { return b.control() == 0x06; }));
    b.slave.state = state;
    b.tick();
    EXPECT_EQ(b.control(), 0x00U);
    EXPECT_FALSE(b.axis.closed_loop());
    b.slave.obeys = true;
    EXPECT_TRUE(b.make_ready());
    EXPECT_GT(b.slave.writes.size(), setup_writes);
  }
}

/// One that starts by itself sends its PDOs, as it had stored them, at once after the boot-up.
TEST(Cia402Axis, ADriveThatBootsIsSetUpAgainWhateverItSaysAfterwards) {
  for (const std::size_t written : {std::size_t{1}, std::size_t{10}, setup_writes - 1, setup_writes}) {
    for (const int then : {-1, 0x05, 0x7F}) {
      Bench b;
      ASSERT_TRUE(b.until([&] { return b.slave.writes.size() >= written; }));
      ASSERT_TRUE(written < setup_writes || b.make_ready());
      b.axis.begin_tick();
      EXPECT_EQ(b.hear(heartbeat_of(node, 0)), Received::accepted);
      EXPECT_EQ(b.hear(report_of(node, 0x1237)), Received::not_mine) << "it may be anything";
      EXPECT_EQ(b.hear(motion_of(node)), Received::not_mine);
      EXPECT_TRUE(then < 0 || b.hear(heartbeat_of(node, then)) == Received::accepted);
      EXPECT_FALSE(b.axis.ready());
      EXPECT_FALSE(b.axis.closed_loop());
      const std::size_t before = b.slave.writes.size();
      b.slave.state = 0x7F;
      b.command(true);
      EXPECT_EQ(b.control(), 0x00U);
      EXPECT_TRUE(b.make_ready());
      EXPECT_GE(b.slave.writes.size(), before + setup_writes) << written << ' ' << then;
    }
  }
}

/// The boot-up may be lost: back in switch on disabled, where nobody has sent it.
TEST(Cia402Axis, ADriveThatFallsBackOnItsWayThroughTheStatesIsSetUpAgain) {
  for (const unsigned told : {0x06U, 0x07U, 0x0FU}) {
    Bench b;
    b.slave.obeys = false;
    b.slave.status = told == 0x06 ? 0x0250 : told == 0x07 ? 0x0231 : 0x0233;
    ASSERT_TRUE(b.until([&] { return b.control() == told; }));
    const std::size_t before = b.slave.writes.size();
    b.slave.status = 0x0250;
    b.tick();
    EXPECT_EQ(b.control(), told == 0x06 ? 0x06U : 0x00U) << "where it waits for 06 it is at home";
    b.slave.obeys = true;
    EXPECT_TRUE(b.make_ready());
    EXPECT_EQ(b.slave.writes.size() >= before + setup_writes, told != 0x06);
  }
}

TEST(Cia402Axis, OperationalIsAlsoWhatItsHeartbeatSays) {
  Bench b;
  ASSERT_TRUE(b.until([&] { return b.slave.state == 5; }));
  b.axis.begin_tick();
  EXPECT_EQ(b.hear(heartbeat_of(node, 5)), Received::accepted);
  EXPECT_FALSE(b.axis.heard_this_tick()) << "its PDOs are its word of the tick";
  b.command(true);
  EXPECT_EQ(b.control(), 0U);
  EXPECT_TRUE(b.make_ready());
}

// ---- what it says

TEST(Cia402Axis, BothPdosMakeASampleAndASet) {
  Bench b;
  ASSERT_TRUE(b.make_ready());
  for (const bool report_first : {true, false}) {
    b.axis.begin_tick();
    EXPECT_EQ(b.axis.sample_age_ticks(), 1U);
    EXPECT_FALSE(b.axis.heard_this_tick());
    const float before = b.axis.sample<float>().angle;
    const CanFrame report = report_of(node, 0x0237, report_first ? 1024 : 2048), motion = motion_of(node, 7);
    EXPECT_EQ(b.hear(report_first ? report : motion), Received::accepted);
    EXPECT_FALSE(b.axis.heard_this_tick());
    EXPECT_EQ(b.axis.sample_age_ticks(), 1U);
    EXPECT_EQ(b.axis.sample<float>().angle, before) << "half a sample is none";
    EXPECT_FALSE(b.axis.brought_sample());
    EXPECT_EQ(b.hear(report_first ? motion : report), Received::accepted);
    EXPECT_TRUE(b.axis.heard_this_tick());
    EXPECT_EQ(b.axis.sample_age_ticks(), 0U);
    EXPECT_NE(b.axis.sample<float>().angle, before);
    EXPECT_TRUE(b.axis.brought_sample());
    EXPECT_EQ(b.hear(heartbeat_of(node, 5)), Received::accepted);
    EXPECT_FALSE(b.axis.brought_sample());
  }
}

TEST(Cia402Axis, AgesCountTicksAndBeginAtNever) {
  Bench b;
  for (int i = 0; i < 3; ++i) {
    EXPECT_EQ(b.axis.sample_age_ticks(), drive::age_max);
    EXPECT_EQ(b.axis.heartbeat_age_ticks(), drive::age_max);
    b.axis.begin_tick();
  }
  ASSERT_TRUE(b.make_ready());
  EXPECT_EQ(b.axis.sample_age_ticks(), 0U);
  EXPECT_GT(b.axis.heartbeat_age_ticks(), 1U) << "PDOs are no heartbeat";
  (void)b.hear(heartbeat_of(node, 5));
  EXPECT_EQ(b.axis.heartbeat_age_ticks(), 0U);
  for (unsigned i = 1; i < 5; ++i) {
    b.axis.begin_tick();
    EXPECT_EQ(b.axis.sample_age_ticks(), i);
    EXPECT_EQ(b.axis.heartbeat_age_ticks(), i);
  }
}

TEST(Cia402Axis, APdoSeenTwiceInATickConfirmsOnce) {
  Bench b;
  b.slave.obeys = false;
  b.slave.status = 0x0233;
  ASSERT_TRUE(b.until([&] { return b.control() == 0x0F; }));
  b.slave.status = 0x0237;
  b.listen();
  for (int i = 0; i < 4; ++i) {
    (void)b.hear(report_of(node, 0x0237));
    (void)b.hear(motion_of(node));
  }
  EXPECT_FALSE(b.axis.ready());
  b.listen();
  EXPECT_TRUE(b.axis.ready());
}

TEST(Cia402Axis, PdosBeforeTheMappingMayBeAnything) {
  Bench b;
  b.axis.begin_tick();
  EXPECT_EQ(b.hear(report_of(node, 0x0237)), Received::not_mine);
  EXPECT_EQ(b.hear(can(0x180 + node, {0x37, 0x02})), Received::not_mine);
  EXPECT_EQ(b.hear(can(0x280 + node, {1, 2, 3})), Received::not_mine);
  EXPECT_FALSE(b.axis.closed_loop());
  EXPECT_FALSE(b.axis.alive());
}

TEST(Cia402Axis, LeavingTorqueControlIsNoticed) {
  for (const unsigned status : {0x0250U, 0x0231U, 0x0233U, 0x0207U, 0x021FU, 0x0218U, 0x0200U}) {
    Bench b;
    ASSERT_TRUE(b.make_ready());
    b.slave.obeys = false;
    b.slave.status = status;
    b.tick(false);
    EXPECT_FALSE(b.axis.closed_loop()) << std::hex << status;
    EXPECT_FALSE(b.axis.ready());
    EXPECT_EQ(b.axis.error(), status == 0x021F || status == 0x0218);
    EXPECT_EQ(b.control(), 0x0FU) << "that is for disable()";
  }
  for (const int state : {0x00, 0x04, 0x7F}) {
    Bench b;
    ASSERT_TRUE(b.make_ready());
    b.slave.state = state;
    b.tick(false);
    EXPECT_FALSE(b.axis.closed_loop());
    EXPECT_FALSE(b.axis.ready());
    EXPECT_TRUE(b.axis.heard_this_tick());
    EXPECT_EQ(b.axis.must_be_released(), state != 0) << "a boot has released it";
    EXPECT_FALSE(b.axis.idle()) << "asked into torque control, and not out of it";
  }
}

// ---- disabling

TEST(Cia402Axis, DisablingTakesTheVoltageAwayAndWaitsForTwoReports) {
  Bench b;
  ASSERT_TRUE(b.make_ready());
  b.disable();
  EXPECT_EQ(b.sent.size(), 1U);
  EXPECT_EQ(b.sent[0], can(0x200 + node, {0, 0, 0, 0}));
  EXPECT_FALSE(b.axis.idle() || b.axis.ready());
  b.disable();
  EXPECT_FALSE(b.axis.idle()) << "one report";
  EXPECT_TRUE(b.axis.must_be_released());
  b.disable();
  EXPECT_TRUE(b.axis.idle());
  EXPECT_FALSE(b.axis.must_be_released());
  EXPECT_EQ(b.slave.state, 5) << "NMT stays as it is";
  EXPECT_TRUE(b.make_ready()) << "and set up again";
  EXPECT_GT(b.slave.writes.size(), 2 * setup_writes - 2);
}

TEST(Cia402Axis, OnlyStatesWithoutTorqueAreIdle) {
  for (const unsigned status :
       {0x0200U, 0x0250U, 0x0231U, 0x0218U, 0x0233U, 0x0237U, 0x0207U, 0x021FU, 0x0201U}) {
    Bench b;
    ASSERT_TRUE(b.make_ready());
    b.slave.obeys = false;
    b.slave.status = status;
    for (int i = 0; i < 6; ++i) b.disable();
    const bool free = status == 0x0200 || status == 0x0250 || status == 0x0231 || status == 0x0218;
    EXPECT_EQ(b.axis.idle(), free) << std::hex << status;
    EXPECT_EQ(b.axis.must_be_released(), !free);
  }
}

TEST(Cia402Axis, ADriveThatIsStoppedOrBootsIsIdle) {
  for (const int state : {0x00, 0x04}) {
    Bench b;
    ASSERT_TRUE(b.make_ready());
    b.disable();
    b.slave.state = state;
    b.disable();
    EXPECT_TRUE(b.axis.idle());
    EXPECT_FALSE(b.axis.must_be_released());
  }
}

/// With what it has stored it may not beat any more: that one message has to be enough, and nobody stops it
/// for ever.
TEST(Cia402Axis, ADriveThatBootsUnderTorqueAndIsSilentThenIsIdle) {
  Bench b;
  ASSERT_TRUE(b.make_ready());
  b.axis.begin_tick();
  ASSERT_EQ(b.hear(heartbeat_of(node, 0)), Received::accepted);
  EXPECT_FALSE(b.axis.ready());
  b.axis.disable([](const CanFrame&) { return true; });
  for (int i = 0; i < 3; ++i) {
    EXPECT_TRUE(b.axis.idle());
    EXPECT_FALSE(b.axis.must_be_released());
    b.axis.begin_tick();
  }
}

/// It hears no torque frame any more, and the profile lets it keep its last torque: it is stopped at once,
/// and again until it says so.
TEST(Cia402Axis, APreOperationalDriveIsNotIdleAndIsStopped) {
  Bench b;
  ASSERT_TRUE(b.make_ready());
  b.slave.state = 0x7F;
  for (int i = 0; i < 3; ++i) {
    b.listen();
    int stops = 0;
    b.axis.disable([&](const CanFrame& f) {
      EXPECT_EQ(f, nmt(0x02, node));
      ++stops;
      return false;
    });
    EXPECT_EQ(stops, 1);
    EXPECT_FALSE(b.axis.idle());
    EXPECT_TRUE(b.axis.must_be_released());
  }
  b.disable();
  b.listen();
  EXPECT_TRUE(b.axis.idle());
  EXPECT_FALSE(b.axis.must_be_released());
  Bench fresh;
  EXPECT_FALSE(fresh.axis.idle()) << "never heard";
  fresh.tick(false);
  EXPECT_FALSE(fresh.axis.idle()) << "and its state is unknown";
}

/// RPDO1 does not reach it, and our heartbeat does: nothing else would end its torque after a stop.
TEST(Cia402Axis, ADriveThatDoesNotObeyItsControlwordIsStopped) {
  Bench b;
  for (int round = 0; round < 2; ++round) {
    ASSERT_TRUE(b.make_ready());
    b.slave.obeys = false;
    for (int n = 1; n <= 2 * test::retry; ++n) {
      b.listen();
      std::vector<CanFrame> sent;
      b.axis.disable([&](const CanFrame& f) {
        sent.push_back(f);
        return true;
      });
      EXPECT_EQ(sent.size(), n % test::retry == 0 ? 1U : 0U) << n;
      for (const CanFrame& f : sent) EXPECT_EQ(f, nmt(0x02, node));
      EXPECT_FALSE(b.axis.idle());
    }
    b.disable();
    b.slave.take(nmt(0x02, node));
    b.tick(false);
    EXPECT_TRUE(b.axis.idle());
    b.slave.obeys = true;
    b.slave.status = 0x0250;
  }
}

/// PDO mapping of another master: the drive would not understand our controlword.
TEST(Cia402Axis, ADriveWhosePdosAreNotOursIsAtLeastStopped) {
  Bench b;
  b.slave.state = 5;
  b.axis.begin_tick();
  (void)b.hear(heartbeat_of(node, 5));
  b.axis.disable([&](const CanFrame& f) {
    EXPECT_EQ(f, nmt(0x02, node));
    b.slave.take(f);
    return true;
  });
  b.tick(false);
  EXPECT_TRUE(b.axis.idle());
}

}  // namespace
}  // namespace esmc::test
