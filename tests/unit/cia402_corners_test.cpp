/// Corners of a CiA 402 axis: what is left of an earlier enabling, what comes late or at the wrong time,
/// bounds to the last bit, and long times. Each was found as a change of the code that no other test noticed.

#include <gtest/gtest.h>

#include <cstdint>

#include "tests/support/cia402_bench.hpp"

namespace esmc::test {
namespace {

/// Disabled, so that the next enabling starts anew.
void forget(Bench& b) {
  for (int i = 0; i < 3; ++i) b.disable();
}

TEST(Cia402Corners, AReadyAxisStaysReadyHoweverLongOthersTake) {
  Bench b;
  ASSERT_TRUE(b.make_ready());
  for (int i = 0; i < 10 * retry; ++i) {
    b.tick();
    ASSERT_TRUE(b.axis.ready()) << i;
    ASSERT_EQ(b.sent.size(), 1U) << "the torque frame " << i;
  }
}

TEST(Cia402Corners, AskingAgainOrAnewCallsASilentAxisAtOnce) {
  Bench b;
  b.command(true);
  EXPECT_EQ(b.count(0x000), 1);
  b.command(true);
  EXPECT_EQ(b.count(0x000), 0);
  b.axis.ask_again();
  b.command(true);
  EXPECT_EQ(b.count(0x000), 1);
  for (int i = 0; i < 2; ++i) b.axis.begin_tick();
  b.command(true);
  EXPECT_EQ(b.count(0x000), 1) << "another enabling";
}

TEST(Cia402Corners, AnAxisThatHasHeardNothingSaysNothing) {
  const Cia402Axis a({.node = node, .offset = 0.5F}, settings());
  EXPECT_FALSE(a.heard_this_tick() || a.brought_sample());
  EXPECT_FALSE(a.ready() || a.idle() || a.alive() || a.error() || a.closed_loop() || a.must_be_released() ||
               a.config_mismatch());
  EXPECT_EQ(a.sample<double>().angle, 0.5);
  EXPECT_EQ(a.sample<double>().rate, 0.0);
  EXPECT_EQ(a.torque_lsb(), 0.0F);
  EXPECT_EQ(a.error_code(), 0U);
  EXPECT_FALSE(a.observed_torque());
}

TEST(Cia402Corners, AnUnconfiguredLineIsNode127AndSpeaksInEveryTick) {
  drive::CanopenLine line;
  for (int i = 0; i < 3; ++i) {
    int sent = 0;
    line.end_tick(
        [&](const CanFrame& f) {
          EXPECT_EQ(f, can(0x77F, {5}));
          return ++sent > 0;
        },
        true);
    EXPECT_EQ(sent, 1) << i;
  }
}

TEST(Cia402Corners, AnEmergencyIsALifeSign) {
  Bench b;
  EXPECT_EQ(b.hear(emergency_of(node, 0x8130)), Received::accepted);
  EXPECT_TRUE(b.axis.alive());
  EXPECT_TRUE(b.axis.error());
  b.axis.begin_tick();
  b.command(true);
  EXPECT_FALSE(b.axis.error()) << "from before the enabling";
}

// ---- confirmations

/// On the way up the drive has reported states without torque all the time: they do not count.
TEST(Cia402Corners, OnlyReportsAfterTheVoltageWasDisabledMakeItIdle) {
  Bench b;
  b.slave.obeys = false;
  ASSERT_TRUE(b.until([&] { return b.control() == 0x06; }));
  for (int i = 0; i < 5; ++i) b.tick();
  b.axis.disable([](const CanFrame&) { return true; });
  EXPECT_FALSE(b.axis.idle());
  b.listen();
  EXPECT_FALSE(b.axis.idle()) << "once";
  b.listen();
  EXPECT_TRUE(b.axis.idle());
}

TEST(Cia402Corners, AfterAnInterruptionItTakesTwoReports) {
  Bench b;
  ASSERT_TRUE(b.make_ready());
  EXPECT_EQ(b.hear(heartbeat_of(node, 0x04)), Received::accepted);
  EXPECT_FALSE(b.axis.ready());
  b.tick(false);
  EXPECT_FALSE(b.axis.ready()) << "once since";
  b.tick(false);
  EXPECT_TRUE(b.axis.ready());
  EXPECT_EQ(b.hear(emergency_of(node, 0x4210)), Received::accepted);
  EXPECT_EQ(b.hear(emergency_of(node, 0)), Received::accepted);
  EXPECT_FALSE(b.axis.ready());
  b.tick(false);
  EXPECT_FALSE(b.axis.ready()) << "once since";
  b.tick(false);
  EXPECT_TRUE(b.axis.ready());
}

// ---- what is left of an earlier enabling

/// The drive's word that it is pre-operational has to be newer than the call.
TEST(Cia402Corners, AnEarlierAnswerIsNoAnswer) {
  Bench b;
  ASSERT_TRUE(b.make_ready());
  forget(b);
  const auto deaf = [](const CanFrame&) { return true; };  // the bus takes it, the drive does not hear it
  for (int i = 0; i < 5; ++i) {
    b.axis.begin_tick();
    EXPECT_EQ(b.hear(report_of(node, 0x0250)), i == 0 ? Received::accepted : Received::not_mine)
        << "its PDOs are nobody's";
    EXPECT_EQ(b.hear(heartbeat_of(node, 5)), Received::accepted);
    int sdos = 0;
    b.axis.enable([&](const CanFrame& f) {
      sdos += f.id == 0x600U + node ? 1 : 0;
      return deaf(f);
    });
    EXPECT_EQ(sdos, i == 0 ? 1 : 0) << "nothing but the call, in tick " << i;
  }
}

TEST(Cia402Corners, AnEarlierStatuswordIsNotAnswered) {
  Bench b;
  b.slave.obeys = false;
  b.slave.status = 0x0231;
  ASSERT_TRUE(b.until([&] { return b.control() == 0x07; }));
  forget(b);
  const std::size_t writes = b.slave.writes.size();
  ASSERT_TRUE(b.until([&] { return b.slave.state == 5 && b.slave.writes.size() > writes + 30; }));
  b.axis.begin_tick();
  EXPECT_EQ(b.hear(heartbeat_of(node, 5)), Received::accepted);
  b.command(true);
  EXPECT_EQ(b.control(), 0x00U) << "no statusword since";
}

TEST(Cia402Corners, AnEarlierModeIsNoMode) {
  Bench b;
  ASSERT_TRUE(b.make_ready());
  forget(b);
  b.slave.obeys = false;
  const std::size_t writes = b.slave.writes.size();
  ASSERT_TRUE(b.until([&] { return b.slave.state == 5 && b.slave.writes.size() > writes + 30; }));
  b.axis.begin_tick();
  EXPECT_EQ(b.hear(report_of(node, 0x0237)), Received::accepted);
  EXPECT_FALSE(b.axis.closed_loop()) << "it has not said in which mode";
}

/// Operational because we started it, not because it said so while it was set up.
TEST(Cia402Corners, OperationalDuringTheSetUpIsForgotten) {
  Bench b;
  b.slave.obeys = false;
  ASSERT_TRUE(b.until([&] { return b.slave.writes.size() == setup_writes; }));
  b.axis.begin_tick();
  for (const CanFrame& f : b.slave.speak()) EXPECT_EQ(b.hear(f), Received::accepted);
  b.command(true);  // reads the last entry back
  b.axis.begin_tick();
  EXPECT_EQ(b.hear(heartbeat_of(node, 5)), Received::accepted);
  for (const CanFrame& f : b.slave.waiting) EXPECT_EQ(b.hear(f), Received::accepted);
  b.slave.waiting.clear();
  b.command(true);
  EXPECT_EQ(b.sent[0], nmt(0x01, node));
  EXPECT_FALSE(b.axis.closed_loop());
  b.axis.begin_tick();
  EXPECT_EQ(b.hear(heartbeat_of(node, 0x7F)), Received::accepted) << "on its way when it was started";
  b.command(true);
  b.axis.begin_tick();
  b.command(true);
  EXPECT_EQ(b.count(0x000), 0) << "it is waited for";
  EXPECT_EQ(b.hear(report_of(node, 0x0250)), Received::accepted);
  b.axis.begin_tick();
  b.command(true);
  EXPECT_EQ(b.control(), 0x06U);
}

// ---- answers at the wrong time

TEST(Cia402Corners, AnAnswerAfterTheSequenceBeganAnewIsIgnored) {
  Bench b;
  b.slave.silent.insert(entry(0x6502, 0));
  ASSERT_TRUE(b.make_ask(entry(0x6502, 0)));
  forget(b);
  EXPECT_EQ(b.hear(sdo(0x580 + node, 0x43, 0x6502, 0, 0)), Received::accepted);
  EXPECT_FALSE(b.axis.config_mismatch());
}

TEST(Cia402Corners, AnAnswerBeforeTheQuestionWasTakenIsIgnored) {
  Bench b;
  ASSERT_TRUE(b.make_ask(entry(0x1005, 0)));
  b.listen();
  b.bus_takes = false;
  b.command(true);  // 1006 is next
  ASSERT_EQ(b.count(0x600U + node), 1);
  EXPECT_EQ(b.hear(sdo(0x580 + node, 0x80, 0x1006, 0, 0x0601'0002)), Received::accepted);
  EXPECT_FALSE(b.axis.config_mismatch());
}

TEST(Cia402Corners, WhatALongAnswerHasBesidesTheObjectIsNoMatter) {
  Bench b;
  b.slave.command[entry(0x6060, 0)] = 0x42;  // four bytes, without saying how many count
  b.slave.says[entry(0x6060, 0)] = 0xABCD'EF0A;
  b.slave.command[entry(0x6007, 0)] = 0x42;
  b.slave.says[entry(0x6007, 0)] = 0xABCD'0001;
  EXPECT_TRUE(b.make_ready());
}

// ---- bounds

/// A drive that is left to these arms nothing: its rated torque is not 0.
TEST(Cia402Corners, DefaultSettings) {
  const drive::Cia402Settings s;
  EXPECT_EQ(s.rated_torque, 0.0F) << "arms nothing";
  EXPECT_EQ(s.torque_limit, 0.0F);
  EXPECT_EQ(s.counts_per_turn, 1U << 20U);
  EXPECT_NEAR(s.velocity_unit, 2e-3 * 3.14159265358979 / 60, 1e-11) << "a thousandth of a turn per minute";
  EXPECT_EQ(s.heartbeat_ms, 10);
  EXPECT_EQ(s.consumer_ms, 10);
  EXPECT_EQ(s.master_node, 127);
  EXPECT_EQ(s.retry_ticks, 150);
  EXPECT_EQ(s.sdo_ticks, 100);
  const drive::cia402::Entry e{{0x6041, 0}, 2, drive::cia402::Task::write};
  EXPECT_EQ(e.constant, 0U);
  EXPECT_EQ(e.source, drive::cia402::Source::constant);
  EXPECT_EQ(e.mask, 0xFFFF'FFFFU);
}

TEST(Cia402Corners, OptionCodesReachTheirObjects) {
  Bench b;
  auto s = settings();
  s.abort_connection = 3;
  s.fault_reaction = -2;
  s.quick_stop = 6;
  b.axis = Cia402Axis(AxisConfig{.node = node}, s);
  ASSERT_TRUE(b.make_ready());
  EXPECT_EQ(b.slave.objects[entry(0x1029, 1)], 1U) << "stays operational, in the length that the object has";
  EXPECT_EQ(b.slave.objects[entry(0x6007, 0)], 3U);
  EXPECT_EQ(b.slave.objects[entry(0x605E, 0)], 0xFFFEU);
  EXPECT_EQ(b.slave.objects[entry(0x605A, 0)], 6U);
}

Bench with(float scene, std::uint32_t drive, float limit, std::uint32_t allowed) {
  Bench b;
  auto s = settings();
  s.rated_torque = scene;
  s.rated_torque_unit = 1.0F;
  s.torque_limit = limit;
  b.axis = Cia402Axis(AxisConfig{.node = node}, s);
  b.slave.says[entry(0x6076, 0)] = drive;
  b.slave.says[entry(0x6072, 0)] = allowed;
  b.until([&] { return b.axis.ready() || b.axis.config_mismatch(); });
  return b;
}

TEST(Cia402Corners, OnePerCentOfTheRatedTorqueIsAllowedToTheLastBit) {
  EXPECT_TRUE(with(99.0F, 100, 0.0F, 0).axis.ready());
  EXPECT_TRUE(with(101.0F, 100, 0.0F, 0).axis.ready()) << "and a limit of 0 needs nothing";
  EXPECT_TRUE(with(98.99F, 100, 0.0F, 0).axis.config_mismatch());
  EXPECT_TRUE(with(101.01F, 100, 0.0F, 0).axis.config_mismatch());
  EXPECT_TRUE(with(0.0F, 0, 0.0F, 0).axis.config_mismatch()) << "no scale";
}

TEST(Cia402Corners, SmallMotorsAreMotors) {
  Bench b;
  auto s = settings();
  s.rated_torque = 0.2F;
  s.torque_limit = 0.25F;
  b.axis = Cia402Axis(AxisConfig{.node = node}, s);
  b.slave.objects[entry(0x6076, 0)] = 200;
  b.slave.objects[entry(0x6072, 0)] = 1250;
  EXPECT_TRUE(b.make_ready()) << "and exactly the torque that is asked for";
  EXPECT_EQ(little(test::torque_frame(b.axis, 0.1F), 2, 2), 500U);
}

}  // namespace
}  // namespace esmc::test
