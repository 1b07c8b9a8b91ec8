/// What a CiA 402 axis counts, tick by tick, and what a frame that it does not take leaves as it was.

#include <gtest/gtest.h>

#include "tests/support/cia402_bench.hpp"

namespace esmc::test {
namespace {

TEST(Cia402Counts, ATickWithTorqueStartsTheQuietTicksAgain) {
  Bench b;
  ASSERT_TRUE(b.make_ready());
  b.disable();
  b.slave.obeys = false;
  for (const unsigned status : {0x0250U, 0x1237U, 0x0250U}) {
    b.slave.status = status;
    b.disable();
    EXPECT_FALSE(b.axis.idle()) << std::hex << status;
  }
  b.disable();
  EXPECT_TRUE(b.axis.idle()) << "twice since";
}

/// The PDOs that the loop runs on must be there when they are switched on, even if they were when they were
/// switched off.
TEST(Cia402Counts, APdoThatVanishesIsAContradiction) {
  struct Case {
    unsigned communication, mapping;
  };
  for (const Case c : {Case{0x1400, 0x1600}, Case{0x1800, 0x1A00}, Case{0x1801, 0x1A01}}) {
    Bench b;
    ASSERT_TRUE(b.make_ask(entry(c.mapping, 0)));
    b.slave.aborts[entry(c.communication, 1)] = 0x0602'0000;  // no such object
    EXPECT_TRUE(b.until([&] { return b.axis.config_mismatch(); })) << std::hex << c.communication;
    ASSERT_TRUE(b.axis.contradicting_object());
    EXPECT_EQ(b.axis.contradicting_object()->index, c.communication);
    EXPECT_EQ(b.axis.contradicting_object()->sub, 1);
  }
}

TEST(Cia402Counts, AFrameThatIsNotTakenSaysNothingAboutTheLastSample) {
  Bench b;
  ASSERT_TRUE(b.make_ready());
  b.listen();
  ASSERT_TRUE(b.axis.brought_sample());
  EXPECT_EQ(b.hear(heartbeat_of(node + 1, 5)), Received::not_mine);
  EXPECT_TRUE(b.axis.brought_sample());
  CanFrame f = heartbeat_of(node, 5);
  f.size = 2;
  EXPECT_EQ(b.hear(f), Received::malformed);
  EXPECT_TRUE(b.axis.brought_sample());
  EXPECT_EQ(b.hear(nmt(0x01, node)), Received::foreign_command);
  EXPECT_TRUE(b.axis.brought_sample());
}

}  // namespace
}  // namespace esmc::test
