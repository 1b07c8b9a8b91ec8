/// How a CiA 402 drive is set up by SDO: order and values written down from the profile, not from the code;
/// answers that are wrong, late, missing or nobody's.

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <limits>
#include <set>
#include <utility>
#include <vector>

#include "tests/support/cia402_bench.hpp"

namespace esmc::test {
namespace {

// ---- set-up

using Writes = std::vector<std::pair<std::uint32_t, std::uint32_t>>;

/// Order and values, from the remapping rules: off, no entries, type, entries, count, on.
const Writes expected_writes{
    {entry(0x1017, 0), 8},  // the call, to hear it at all
    {entry(0x6040, 0), 0},           {entry(0x1017, 0), 8},           {entry(0x1016, 1), 100U * 65536 + 15},
    {entry(0x1029, 1), 1},           {entry(0x1006, 0), 1000},        {entry(0x6007, 0), 1},
    {entry(0x605E, 0), 0},           {entry(0x605A, 0), 0},           {entry(0x6060, 0), 10},
    {entry(0x60B2, 0), 0},           {entry(0x60C2, 1), 1},           {entry(0x60C2, 2), 0xFD},
    {entry(0x1401, 1), 0x8000'0303}, {entry(0x1402, 1), 0x8000'0403}, {entry(0x1403, 1), 0x8000'0503},
    {entry(0x1802, 1), 0xC000'0383}, {entry(0x1803, 1), 0xC000'0483}, {entry(0x1400, 1), 0x8000'0203},
    {entry(0x1600, 0), 0},           {entry(0x1400, 2), 255},         {entry(0x1400, 5), 15},
    {entry(0x1600, 1), 0x6040'0010}, {entry(0x1600, 2), 0x6071'0010}, {entry(0x1600, 0), 2},
    {entry(0x1400, 1), 0x0000'0203}, {entry(0x1800, 1), 0xC000'0183}, {entry(0x1A00, 0), 0},
    {entry(0x1800, 2), 1},           {entry(0x1A00, 1), 0x6041'0010}, {entry(0x1A00, 2), 0x6064'0020},
    {entry(0x1A00, 3), 0x6077'0010}, {entry(0x1A00, 0), 3},           {entry(0x1800, 1), 0x4000'0183},
    {entry(0x1801, 1), 0xC000'0283}, {entry(0x1A01, 0), 0},           {entry(0x1801, 2), 1},
    {entry(0x1A01, 1), 0x606C'0020}, {entry(0x1A01, 2), 0x6061'0008}, {entry(0x1A01, 0), 2},
    {entry(0x1801, 1), 0x4000'0283}};
/// Written for what comes next in the sequence, and not read back.
const std::set<std::pair<std::uint32_t, std::uint32_t>> in_passing{
    {entry(0x6040, 0), 0},           {entry(0x1029, 1), 1},
    {entry(0x1400, 1), 0x8000'0203}, {entry(0x1800, 1), 0xC000'0183},
    {entry(0x1801, 1), 0xC000'0283}, {entry(0x1600, 0), 0},
    {entry(0x1A00, 0), 0},           {entry(0x1A01, 0), 0}};
const std::vector<std::uint32_t> only_read{entry(0x1014, 0), entry(0x1005, 0), entry(0x6502, 0),
                                           entry(0x6076, 0), entry(0x6072, 0)};
const std::set<std::uint32_t> optional{entry(0x1014, 0), entry(0x1005, 0), entry(0x6072, 0), entry(0x60B2, 0),
                                       entry(0x1400, 5), entry(0x1006, 0), entry(0x60C2, 1), entry(0x60C2, 2),
                                       entry(0x1401, 1), entry(0x1402, 1), entry(0x1403, 1), entry(0x1802, 1),
                                       entry(0x1803, 1)};

TEST(Cia402Axis, SetsTheDriveUpInThisOrderAndReadsEverythingBack) {
  Bench b;
  ASSERT_TRUE(b.make_ready());
  EXPECT_EQ(b.slave.writes, expected_writes);
  EXPECT_EQ(expected_writes.size(), setup_writes);
  std::multiset<std::uint32_t> reads(b.slave.reads.begin(), b.slave.reads.end()),
      wanted(only_read.begin(), only_read.end());
  for (std::size_t i = 1; i < expected_writes.size(); ++i) {
    if (!in_passing.contains(expected_writes[i])) wanted.insert(expected_writes[i].first);
  }
  EXPECT_EQ(reads, wanted);
  EXPECT_FALSE(b.axis.config_mismatch());
}

TEST(Cia402Axis, AsksOneThingAtATimeAndNothingOperationalBeforeTheEnd) {
  Bench b;
  for (int i = 0; i < 300 && !b.axis.ready(); ++i) {
    b.tick();
    EXPECT_LE(b.count(0x600U + node), 1) << "tick " << i;
    for (const CanFrame& f : b.sent) EXPECT_TRUE(hal::well_formed(f) && !f.extended && !f.remote && !f.fd);
    if (b.slave.writes.size() < expected_writes.size()) {
      EXPECT_EQ(b.slave.state, 0x7F);
      EXPECT_EQ(b.control(), 0U);
    }
  }
  EXPECT_TRUE(b.axis.ready());
  EXPECT_TRUE(b.axis.alive());
}

TEST(Cia402Axis, AnAbortThatMattersIsAContradiction) {
  std::set<std::uint32_t> objects(only_read.begin(), only_read.end());
  for (const auto& w : expected_writes) objects.insert(w.first);
  for (const std::uint32_t object : objects) {
    for (const std::uint32_t code : {0x0602'0000U, 0x0609'0011U, 0x0601'0002U, 0x0800'0022U}) {
      Bench b;
      b.slave.aborts[object] = code;
      const bool missing = code == 0x0602'0000U || code == 0x0609'0011U;
      const bool ready =
          b.until([&] { return b.axis.ready() || b.axis.config_mismatch(); }) && b.axis.ready();
      const bool refusable = object == entry(0x1029, 1);
      EXPECT_EQ(ready, refusable || (missing && optional.contains(object)))
          << std::hex << object << " " << code;
      EXPECT_EQ(b.axis.config_mismatch(), !ready);
      if (!ready) {
        EXPECT_EQ(b.control(), 0U);
      }
    }
  }
}

TEST(Cia402Axis, SaysThatTheTorqueLimitWasNotReadBack) {
  Bench b;
  b.slave.aborts[entry(0x60B2, 0)] = 0x0602'0000;
  ASSERT_TRUE(b.make_ready());
  EXPECT_FALSE(b.axis.torque_limit_unread()) << "the limit was there";
  Bench without;
  without.slave.aborts[entry(0x6072, 0)] = 0x0602'0000;
  ASSERT_TRUE(without.make_ready());
  EXPECT_TRUE(without.axis.torque_limit_unread());
  without.slave.aborts.clear();
  for (int i = 0; i < 5; ++i) without.disable();
  ASSERT_TRUE(without.make_ready());
  EXPECT_FALSE(without.axis.torque_limit_unread()) << "of the set-up before";
}

TEST(Cia402Axis, WhatIsReadBackAndDiffersIsAContradiction) {
  for (std::size_t i = 1; i < expected_writes.size(); ++i) {
    const auto& [object, value] = expected_writes[i];
    if (in_passing.contains(expected_writes[i])) continue;
    for (const unsigned bit : {0U, 1U, 7U}) {
      const bool pdo_off = optional.contains(object) && object % 256 == 1 && object > entry(0x1400, 0) &&
                           object < entry(0x2000, 0);
      Bench b;
      b.slave.says[object] = value ^ (pdo_off ? 0x8000'0000U : 1U << bit);
      b.until([&] { return b.axis.ready() || b.axis.config_mismatch(); });
      EXPECT_TRUE(b.axis.config_mismatch()) << std::hex << object << " bit " << bit;
    }
  }
}

TEST(Cia402Axis, WhatMayDifferIsNoContradiction) {
  Bench b;
  b.slave.says[entry(0x1400, 1)] = 0x4000'0203;  // bit 30 has no meaning there
  b.slave.says[entry(0x1800, 1)] = 0x0000'0183;  // a drive that answers remote frames
  b.slave.says[entry(0x1801, 1)] = 0x0000'0283;
  b.slave.says[entry(0x1802, 1)] = 0x8000'0000;  // off is off
  b.slave.says[entry(0x1005, 0)] = 0x8000'0080;
  b.slave.says[entry(0x1014, 0)] = 0x4000'0083;
  b.slave.says[entry(0x6502, 0)] = 0x0000'0200;
  b.slave.command[entry(0x6076, 0)] = 0x42;  // does not say how long
  b.slave.command[entry(0x6060, 0)] = 0x42;
  EXPECT_TRUE(b.make_ready());
}

TEST(Cia402Axis, WhatIsOnlyReadMustBeRight) {
  struct Case {
    std::uint32_t object, value;
  };
  for (const Case c :
       {Case{entry(0x1014, 0), 0x84}, Case{entry(0x1014, 0), 0x8000'0083}, Case{entry(0x1005, 0), 0x81},
        Case{entry(0x1005, 0), 0x4000'0080}, Case{entry(0x6502, 0), 0x1DF}, Case{entry(0x6076, 0), 0},
        Case{entry(0x6076, 0), 1979}, Case{entry(0x6076, 0), 2021}, Case{entry(0x6072, 0), 1249}}) {
    Bench b;
    b.slave.says[c.object] = c.value;
    EXPECT_FALSE(b.axis.contradicting_object());
    b.until([&] { return b.axis.ready() || b.axis.config_mismatch(); });
    EXPECT_TRUE(b.axis.config_mismatch()) << std::hex << c.object << " " << c.value;
    ASSERT_TRUE(b.axis.contradicting_object());
    EXPECT_EQ(entry(b.axis.contradicting_object()->index, b.axis.contradicting_object()->sub), c.object);
    EXPECT_EQ(b.axis.node(), node);
  }
  for (const Case c :
       {Case{entry(0x6076, 0), 1981}, Case{entry(0x6076, 0), 2019}, Case{entry(0x6072, 0), 1251}}) {
    Bench b;
    b.slave.says[c.object] = c.value;
    EXPECT_TRUE(b.make_ready()) << std::hex << c.object << " " << c.value;
  }
  for (const auto object : {entry(0x6076, 0), entry(0x6060, 0)}) {
    Bench b;
    b.slave.command[object] = 0x4B;  // two bytes, with the right value in them, of four or one
    b.until([&] { return b.axis.ready() || b.axis.config_mismatch(); });
    EXPECT_TRUE(b.axis.config_mismatch()) << std::hex << object;
  }
}

/// The message of a refusal is written after the torque has been taken away.
TEST(Cia402Axis, WhatContradictedIsKnownUntilTheNextSetUp) {
  Bench b;
  b.slave.says[entry(0x6502, 0)] = 0x1DF;
  b.until([&] { return b.axis.config_mismatch(); });
  b.axis.disable([](const CanFrame&) { return true; });
  EXPECT_FALSE(b.axis.config_mismatch());
  ASSERT_TRUE(b.axis.contradicting_object());
  EXPECT_EQ(b.axis.contradicting_object()->index, 0x6502);
  b.slave.says.erase(entry(0x6502, 0));
  EXPECT_TRUE(b.make_ready());
  EXPECT_FALSE(b.axis.contradicting_object());
}

TEST(Cia402Axis, NonsenseAsRatedTorqueOfTheSceneArmsNothing) {
  for (const float rated : {0.0F, -2.0F, NAN, std::numeric_limits<float>::infinity()}) {
    Bench b;
    auto s = settings();
    s.rated_torque = rated;
    b.axis = Cia402Axis(AxisConfig{.node = node}, s);
    b.until([&] { return b.axis.ready() || b.axis.config_mismatch(); });
    EXPECT_TRUE(b.axis.config_mismatch()) << rated;
  }
}

/// It is seen for at least one whole tick, and the next enabling begins anew: the drive may have been put
/// right.
TEST(Cia402Axis, AMismatchLastsUntilDisable) {
  Bench b;
  b.slave.says[entry(0x6076, 0)] = 1000;
  ASSERT_TRUE(b.until([&] { return b.axis.config_mismatch(); }));
  for (int i = 0; i < 10 * retry; ++i) {
    ASSERT_EQ(b.sent.size(), 1U) << "nothing but the torque frame " << i;
    b.tick();
    ASSERT_TRUE(b.axis.config_mismatch()) << i;
  }
  b.tick(false);
  EXPECT_TRUE(b.axis.config_mismatch()) << "asked in the tick before";
  b.tick(false);
  EXPECT_FALSE(b.axis.config_mismatch());
  b.slave.says.clear();
  EXPECT_TRUE(b.make_ready());
}

TEST(Cia402Axis, ASilentServerIsAskedFourTimesAndThenEverythingBeginsAnew) {
  for (const std::uint32_t object : {entry(0x6502, 0), entry(0x1600, 2)}) {
    Bench b;
    b.slave.silent.insert(object);
    ASSERT_TRUE(b.make_ask(object));
    std::vector<int> asked{0};
    int tick = 0;
    while (b.count(0x000) == 0 && ++tick < 200) {
      b.tick();
      if (b.count(0x600U + node) > 0 && b.count(0x000) == 0) asked.push_back(tick);
    }
    EXPECT_EQ(asked, (std::vector<int>{0, patience, 2 * patience, 3 * patience}));
    EXPECT_EQ(tick, 4 * patience + 1);
    EXPECT_EQ(b.sent[0], nmt(0x80, node));
    EXPECT_FALSE(b.axis.config_mismatch());
    b.slave.silent.clear();
    EXPECT_TRUE(b.make_ready());
  }
}

TEST(Cia402Axis, ALateAnswerIsAnAnswer) {
  Bench b;
  b.slave.silent.insert(entry(0x6502, 0));
  ASSERT_TRUE(b.make_ask(entry(0x6502, 0)));
  for (int i = 0; i < patience - 2; ++i) b.tick();
  EXPECT_EQ(b.hear(sdo(0x580 + node, 0x43, 0x6502, 0, 0x200)), Received::accepted);
  b.tick();
  EXPECT_EQ(b.slave.writes.back().first, entry(0x6060, 0));
}

TEST(Cia402Axis, UnrequestedAnswersDoNothing) {
  Bench b;
  b.slave.silent.insert(entry(0x6502, 0));
  ASSERT_TRUE(b.make_ask(entry(0x6502, 0)));
  for (const CanFrame& f :
       {sdo(0x580 + node, 0x43, 0x6502, 1, 0x200), sdo(0x580 + node, 0x43, 0x6503, 0, 0x200),
        sdo(0x580 + node, 0x80, 0x6076, 0, 0x06020000), sdo(0x580 + node, 0x60, 0x6502, 0),
        sdo(0x580 + node, 0x41, 0x6502, 0, 4), sdo(0x580 + node, 0xFF, 0x6502, 0)}) {
    EXPECT_EQ(b.hear(f), Received::accepted);
    b.command(true);
    EXPECT_EQ(b.count(0x600U + node), 0) << "still waiting";
    EXPECT_FALSE(b.axis.config_mismatch());
  }
  EXPECT_EQ(b.hear(sdo(0x580 + node, 0x43, 0x6502, 0, 0x200)), Received::accepted);
  EXPECT_EQ(b.hear(sdo(0x580 + node, 0x43, 0x6502, 0, 0)), Received::accepted) << "answered already";
  EXPECT_FALSE(b.axis.config_mismatch());
  EXPECT_TRUE(b.make_ready());
  EXPECT_EQ(b.hear(sdo(0x580 + node, 0x43, 0x6502, 0, 0)), Received::accepted);
  EXPECT_TRUE(b.axis.ready());
  Bench fresh;
  fresh.axis.begin_tick();
  EXPECT_EQ(fresh.hear(sdo(0x580 + node, 0x60, 0x6040, 0)), Received::accepted);
  EXPECT_TRUE(fresh.axis.alive());
}

TEST(Cia402Axis, WhatTheBusDidNotTakeIsSentAgainAndNotSkipped) {
  Bench b;
  b.slave.state = 5;
  b.axis.begin_tick();
  EXPECT_EQ(b.hear(heartbeat_of(node, 0x7F)), Received::accepted);
  b.bus_takes = false;
  for (int i = 0; i < 5; ++i) {
    b.command(true);
    ASSERT_EQ(b.sent.size(), 1U) << "NMT was refused, no SDO after it";
    EXPECT_EQ(b.sent[0], nmt(0x80, node));
    b.axis.begin_tick();
  }
  b.bus_takes = true;
  b.command(true);
  EXPECT_EQ(b.count(0x000), 1);
  EXPECT_EQ(b.count(0x600U + node), 1);
  ASSERT_TRUE(b.make_ask(entry(0x6502, 0)));
  b.listen();
  b.bus_takes = false;
  for (int i = 0; i < 3 * patience; ++i) {
    b.command(true);
    ASSERT_EQ(b.count(0x600U + node), 1) << "the next request, until it is taken";
  }
  b.bus_takes = true;
  b.command(true);
  EXPECT_EQ(b.slave.writes.back().first, entry(0x6060, 0));
  // NMT start likewise.
  ASSERT_TRUE(b.until([&] { return b.slave.writes.size() == expected_writes.size(); }));
  b.tick();
  b.listen();
  b.bus_takes = false;
  for (int i = 0; i < 3; ++i) {
    b.command(true);
    ASSERT_EQ(b.count(0x000), 1);
    EXPECT_EQ(b.sent[0], nmt(0x01, node));
    b.axis.begin_tick();
  }
  b.bus_takes = true;
  EXPECT_TRUE(b.make_ready());
}

/// Drives leave the factory without heartbeat: what is sent before anything was heard may have reached
/// nobody.
TEST(Cia402Axis, ASilentAxisIsCalledEveryRetryTicksAndBegunWithOnceItsHeartbeatIsHeard) {
  Bench b;
  for (int tick = 0; tick < 3 * retry; ++tick) {
    b.axis.begin_tick();
    b.command(true);
    EXPECT_EQ(b.count(0x000) + b.count(0x600U + node), tick % retry == 0 ? 2 : 0) << tick;
    if (tick % retry == 0) {
      EXPECT_EQ(b.sent[0], nmt(0x80, node));
      EXPECT_EQ(b.sent[1], sdo(0x600 + node, 0x2B, 0x1017, 0, 8));
    }
    b.slave.waiting.clear();
    EXPECT_FALSE(b.axis.alive());
    EXPECT_FALSE(b.axis.heard_this_tick());
  }
  b.axis.begin_tick();
  EXPECT_EQ(b.hear(sdo(0x580 + node, 0x60, 0x1017, 0)), Received::accepted);
  EXPECT_TRUE(b.axis.alive());
  EXPECT_FALSE(b.axis.heard_this_tick()) << "an answer comes when it likes";
  b.command(true);
  EXPECT_EQ(b.count(0x000), 1) << "the time had come";
  b.tick();
  EXPECT_TRUE(b.axis.heard_this_tick());
  EXPECT_EQ(b.count(0x000), 1) << "heard at last: at once";
  b.tick();
  EXPECT_EQ(b.slave.writes.back(), (std::pair<std::uint32_t, std::uint32_t>{entry(0x6040, 0), 0}));
  b.axis.ask_again();
  EXPECT_TRUE(b.make_ready());
}

TEST(Cia402Axis, ADriveThatDoesNotBecomePreOperationalIsToldAgain) {
  Bench b;
  b.axis.begin_tick();
  (void)b.hear(heartbeat_of(node, 0x00));
  b.command(true);
  EXPECT_EQ(b.count(0x000), 1);
  for (int tick = 1; tick <= 2 * retry; ++tick) {
    b.axis.begin_tick();
    (void)b.hear(heartbeat_of(node, tick % 2 == 0 ? 0x04 : 0x05));
    b.command(true);
    EXPECT_EQ(b.count(0x000), tick % retry == 0 ? 1 : 0) << tick;
    b.slave.waiting.clear();
  }
}

}  // namespace
}  // namespace esmc::test
