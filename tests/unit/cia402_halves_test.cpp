/// A CiA 402 axis that has heard half of something: one PDO of a set, the first bytes of a set-up.

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

/// It may have missed our heartbeat, and would be watched by nobody until it hears the next one: time for that is in the set-up.
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

TEST(Cia402Axis, StaysOperationalWithoutUsWhereTheDriveLetsItBeWritten) {
  Bench b;
  ASSERT_TRUE(b.make_ready());
  EXPECT_EQ(b.slave.objects[entry(0x1029, 1)], 1U) << "in the length that it has";
}

TEST(Cia402Axis, AfterAReportOfTorqueItTakesTwoWithout) {
  Bench b;
  ASSERT_TRUE(b.make_ready());
  for (int i = 0; i < 3; ++i) b.disable();
  ASSERT_TRUE(b.axis.idle());
  b.axis.expect_set(false);
  b.axis.begin_tick();
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

/// Nobody asks for sets here, so that nothing but the set-up lies before the first PDO.
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
