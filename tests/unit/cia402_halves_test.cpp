/// A CiA 402 axis that has heard half of something, or late: one PDO of a set, a set after its tick, part of
/// a set-up.

#include <gtest/gtest.h>

#include "tests/support/cia402_bench.hpp"

namespace esmc::test {
namespace {

TEST(Cia402Axis, ADriveThatBootsDuringItsSetUpIsCalledAtOnce) {
  Bench b;
  ASSERT_TRUE(b.until([&] { return b.slave.writes.size() == 10; }));
  b.axis.begin_tick();
  EXPECT_EQ(b.hear(heartbeat_of(node, 0)), Received::accepted);
  b.command(true);
  b.axis.begin_tick();
  b.command(true);
  EXPECT_EQ(b.count(0x000), 1) << "not the next object first";
}

/// It may have missed our heartbeat, and would not be monitored until it hears the next one: time for
/// that is in the set-up.
TEST(Cia402Axis, AFaultOnTheWayToTorqueIsFollowedByTheWholeSetUp) {
  for (const unsigned told : {0x07U, 0x0FU}) {
    for (const unsigned status : {0x0218U, 0x020FU}) {
      Bench b;
      b.slave.obeys = false;
      b.slave.status = told == 0x07 ? 0x0231 : 0x0233;
      ASSERT_TRUE(b.until([&] { return b.control() == told; }));
      const std::size_t before = b.slave.writes.size();
      b.slave.status = status;
      b.slave.waiting.push_back(emergency_of(node, 0x8130));
      b.tick();
      EXPECT_EQ(b.control(), 0x00U);
      EXPECT_EQ(b.axis.error_code(), 0x8130U);
      b.slave.status = 0x0218;
      b.slave.obeys = true;
      EXPECT_TRUE(b.make_ready());
      EXPECT_GE(b.slave.writes.size(), before + setup_writes) << told << ' ' << status;
      EXPECT_FALSE(b.axis.error());
    }
  }
}

TEST(Cia402Axis, AFaultBeforeItIsSwitchedOnIsResetFromDisabledVoltage) {
  Bench b;
  b.slave.obeys = false;
  ASSERT_TRUE(b.until([&] { return b.control() == 0x06; }));
  b.slave.status = 0x0218;
  b.tick();
  EXPECT_EQ(b.control(), 0x00U);
  b.tick();
  EXPECT_EQ(b.control(), 0x80U);
}

TEST(Cia402Axis, AfterAReportOfTorqueItTakesTwoWithout) {
  Bench b;
  ASSERT_TRUE(b.make_ready());
  for (int i = 0; i < 3; ++i) b.disable();
  ASSERT_TRUE(b.axis.idle());
  b.axis.expect_set(false);
  b.axis.begin_tick();
  (void)b.hear(report_of(node, 0x0231));
  EXPECT_TRUE(b.axis.idle());
  EXPECT_EQ(b.hear(report_of(node, 0x0237)), Received::accepted);
  EXPECT_FALSE(b.axis.idle()) << "its other PDO is lost";
  for (const bool idle : {false, true}) {
    b.axis.expect_set(false);
    b.axis.begin_tick();
    (void)b.hear(report_of(node, 0x0250));
    (void)b.hear(motion_of(node));
    EXPECT_EQ(b.axis.idle(), idle);
  }
}

// An answer that comes after the controller gave up waiting is of the SYNC before; the next SYNC's set does
// without it.
TEST(Cia402Axis, LateAnswersAreNoPartOfTheNextSet) {
  Bench b;
  ASSERT_TRUE(b.make_ready());
  b.axis.begin_tick();
  EXPECT_EQ(b.hear(motion_of(node, 7)), Received::accepted);  // late
  b.axis.expect_set(true);
  EXPECT_EQ(b.hear(report_of(node, 0x0237, 1024)), Received::accepted);
  EXPECT_FALSE(b.axis.heard_this_tick());
  EXPECT_EQ(b.axis.sample_age_ticks(), 1U);
  EXPECT_EQ(b.hear(motion_of(node, 9)), Received::accepted);
  EXPECT_TRUE(b.axis.heard_this_tick());
  EXPECT_EQ(b.axis.sample_age_ticks(), 0U);
  // A whole set that is late is a sample, and a tick old.
  b.axis.begin_tick();
  EXPECT_EQ(b.hear(report_of(node, 0x0237, 2048)), Received::accepted);
  EXPECT_EQ(b.hear(motion_of(node, 7)), Received::accepted);
  b.axis.expect_set(true);
  EXPECT_FALSE(b.axis.heard_this_tick());
  EXPECT_EQ(b.axis.sample_age_ticks(), 1U);
  b.axis.begin_tick();
  b.axis.expect_set(true);
  EXPECT_EQ(b.axis.sample_age_ticks(), 2U);
}

// One PDO before the controller gave up waiting and one after: of one SYNC all the same, as long as no other
// has gone out.
TEST(Cia402Axis, ASetThatTheTickCutInTwoIsASampleThatIsATickOld) {
  for (const bool report_first : {true, false}) {
    const auto half = [&](bool first) {
      return first == report_first ? report_of(node, 0x0237, 1024, 250) : motion_of(node, 7);
    };
    Bench b;
    ASSERT_TRUE(b.make_ready());
    b.axis.begin_tick();
    b.axis.expect_set(true);
    EXPECT_EQ(b.hear(half(true)), Received::accepted);
    EXPECT_FALSE(b.axis.heard_this_tick());
    EXPECT_EQ(b.axis.sample_age_ticks(), 1U);
    EXPECT_EQ(b.axis.observed_torque().has_value(), report_first);
    const double angle = b.axis.sample<double>().angle;
    b.axis.begin_tick();
    EXPECT_EQ(b.hear(half(false)), Received::accepted);
    EXPECT_TRUE(b.axis.brought_sample());
    EXPECT_NE(b.axis.sample<double>().angle, angle);
    b.axis.expect_set(true);
    EXPECT_FALSE(b.axis.heard_this_tick());
    EXPECT_EQ(b.axis.sample_age_ticks(), 1U);
    EXPECT_EQ(b.axis.observed_torque().has_value(), !report_first)
        << "what was late is looked at as well, and once";
    EXPECT_TRUE(b.axis.ready());
  }
}

TEST(Cia402Axis, ALostPdoIsNotMadeUpForByTheNextSync) {
  Bench b;
  ASSERT_TRUE(b.make_ready());
  b.axis.begin_tick();
  b.axis.expect_set(true);
  (void)b.hear(report_of(node, 0x0237, 1024));  // its other half is lost
  b.axis.begin_tick();
  b.axis.expect_set(true);
  EXPECT_EQ(b.hear(motion_of(node, 7)), Received::accepted);
  EXPECT_FALSE(b.axis.brought_sample());
  EXPECT_EQ(b.axis.sample_age_ticks(), 2U);
  // In lockstep SYNC goes out between ticks, and ages nothing.
  b.axis.expect_set(false);
  b.axis.begin_tick();
  (void)b.hear(report_of(node, 0x0237, 1024));
  EXPECT_FALSE(b.axis.brought_sample());
  EXPECT_EQ(b.hear(motion_of(node, 7)), Received::accepted);
  EXPECT_EQ(b.axis.sample_age_ticks(), 0U);
  b.axis.expect_set(false);
  EXPECT_EQ(b.axis.sample_age_ticks(), 0U);
}

// Every set late in one half: it is enabled all the same, and released.
TEST(Cia402Axis, ADriveWhoseSetsAreAllCutInTwoIsEnabledAndReleased) {
  Bench b;
  b.cut = true;
  ASSERT_TRUE(b.make_ready());
  EXPECT_EQ(b.axis.sample_age_ticks(), 1U);
  for (int i = 0; i < 5; ++i) b.disable();
  EXPECT_TRUE(b.axis.idle());
}

/// No sets are requested here, so that nothing but the set-up lies before the first PDO.
TEST(Cia402Axis, TheFirstSetHasTwoHalvesAsWell) {
  for (const bool report_first : {true, false}) {
    Bench b;
    for (int i = 0; i < 400 && b.slave.state != 5; ++i) {
      b.axis.begin_tick();
      b.take(b.slave.speak());
      b.command(true);
    }
    ASSERT_EQ(b.slave.state, 5);
    b.axis.begin_tick();
    EXPECT_EQ(b.hear(report_first ? report_of(node, 0x0250) : motion_of(node)), Received::accepted);
    EXPECT_FALSE(b.axis.brought_sample());
    EXPECT_EQ(b.hear(report_first ? motion_of(node) : report_of(node, 0x0250)), Received::accepted);
    EXPECT_TRUE(b.axis.brought_sample());
  }
}

}  // namespace
}  // namespace esmc::test
