/// Drives at their edges: answers that nobody asked for, refusals in the midst of a set-up, numbers exactly
/// at a bound, orders repeated where there is nothing to do.

#include <gtest/gtest.h>

#include <algorithm>

#include "firmware/drive/mit_axis.hpp"
#include "tests/support/cia402_bench.hpp"
#include "tests/support/mit_bytes.hpp"

namespace esmc::test {
namespace {

// ---- CiA 402

TEST(Cia402Edges, UnrequestedAnswersShortenNothing) {
  Bench undisturbed;
  ASSERT_TRUE(undisturbed.make_ready());
  Bench b;
  for (int i = 0; i < 400 && !b.axis.ready(); ++i) {
    for (const int kind : {0x60, 0x43, 0x80}) {
      EXPECT_EQ(b.hear(sdo(0x580 + node, kind, 0x6041, 0, 0x0602'0000)), Received::accepted);
    }
    b.tick();
  }
  EXPECT_TRUE(b.axis.ready());
  EXPECT_EQ(b.slave.writes, undisturbed.slave.writes);
  EXPECT_EQ(b.slave.reads, undisturbed.slave.reads);
  EXPECT_FALSE(Bench{}.axis.torque_limit_unread()) << "before the first set-up";
}

TEST(Cia402Edges, AnAbsentObjectSkipsNoOther) {
  Bench complete;
  ASSERT_TRUE(complete.make_ready());
  for (const std::uint32_t object : {entry(0x1006, 0), entry(0x1029, 1), entry(0x60C2, 2), entry(0x1403, 1),
                                     entry(0x1400, 5), entry(0x6072, 0), entry(0x1014, 0)}) {
    Bench b;
    b.slave.aborts[object] = 0x0602'0000;
    ASSERT_TRUE(b.make_ready()) << std::hex << object;
    EXPECT_EQ(b.slave.writes, complete.slave.writes) << std::hex << object;
  }
}

TEST(Cia402Edges, ARefusalDoesNotMapThePdos) {
  Bench b;
  b.slave.aborts[entry(0x6060, 0)] = 0x0609'0030;
  ASSERT_TRUE(b.until([&] { return b.axis.config_mismatch(); }));
  EXPECT_EQ(b.hear(report_of(node, 0x1237)), Received::not_mine);
  EXPECT_FALSE(b.axis.observed_torque());
}

TEST(Cia402Edges, ARepetitionThatTheBusRefusesIsSentInTheNextTick) {
  Bench b;
  b.slave.silent.insert(entry(0x6502, 0));
  ASSERT_TRUE(b.make_ask(entry(0x6502, 0)));
  for (int i = 1; i < patience; ++i) {
    b.tick();
    EXPECT_EQ(b.count(0x600U + node), 0);
  }
  b.bus_takes = false;
  b.tick();
  EXPECT_EQ(b.count(0x600U + node), 1);
  b.bus_takes = true;
  b.tick();
  EXPECT_EQ(b.count(0x600U + node), 1);
}

TEST(Cia402Edges, ADriveThatDoesNotStartIsStillBeingSetUp) {
  Bench b;
  ASSERT_TRUE(b.until([&] { return b.count(0x000) == 1 && b.sent[0] == nmt(1, node); }));
  for (int i = 0; i < 5; ++i) {
    b.slave.state = 0x7F;
    b.tick();
    EXPECT_TRUE(b.axis.setting_up());
  }
}

/// What an earlier enabling achieved says nothing about this one.
TEST(Cia402Edges, ASecondAttemptWithoutProgressIsNoSetUp) {
  Bench b;
  ASSERT_TRUE(b.make_ready());
  for (int i = 0; i < 10; ++i) b.disable();
  b.slave.obeys = false;
  const auto asked = [&] { return std::ranges::count(b.slave.reads, entry(0x6502, 0)); };
  b.slave.reads.clear();
  ASSERT_TRUE(b.until([&] { return asked() == 1; }));
  EXPECT_TRUE(b.axis.setting_up());
  ASSERT_TRUE(b.until([&] { return asked() == 2; }));
  EXPECT_FALSE(b.axis.setting_up());
}

// ---- MIT mode

TEST(MitEdges, CommandsOfV3EndWithTheLastPacket) {
  drive::MitAxis::Settings s;
  EXPECT_EQ(s.velocity_unit, 0.0F) << "unknown";
  s.dialect = drive::mit::Dialect::cubemars_v3;
  drive::MitAxis axis({.node = 0xFF}, s);
  hal::CanFrame f = hal::data_frame(0x10FF, 8);
  f.extended = true;
  EXPECT_EQ(axis.receive(f), Received::foreign_command);
  f.id = 0x11FF;
  EXPECT_EQ(axis.receive(f), Received::not_mine);
}

}  // namespace
}  // namespace esmc::test
