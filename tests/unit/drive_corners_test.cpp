/// Corners of the drive layer that ordinary enabling never meets. Frames are packed by hand.

#include <gtest/gtest.h>

#include <cstdint>
#include <vector>

#include "firmware/drive/axis.hpp"
#include "firmware/drive/cia402_setup.hpp"
#include "tests/support/odrive_bench.hpp"

namespace {

using namespace esmc::drive;
namespace test = esmc::test;
using esmc::hal::CanFrame;
using test::enable;
using test::hear;
using test::node;
using test::only;

TEST(NoLine, SaysNothing) {
  NoLine line;
  int sent = 0;
  const auto send = [&](const CanFrame&) { return ++sent > 0; };
  line.request(send);
  line.end_tick(send, true);
  line.end_tick(send, false);
  EXPECT_EQ(sent, 0);
}

/// The bus takes nothing and nobody has been heard: called again after retry_ticks, not in every tick.
TEST(OdriveAxisCorners, ASilentAxisOnABusThatTakesNothing) {
  OdriveAxis a({.node = node}, OdriveAxis::Version::v0_6, 4);
  for (int i = 0; i < 12; ++i) {
    a.begin_tick();
    EXPECT_EQ(enable(a, false).size(), i % 4 == 0 ? 1U : 0U) << i;
  }
}

/// A retry time of zero asks again in every tick and waits for no heartbeat that could be missed.
TEST(OdriveAxisCorners, WithoutARetryTimeEveryTickAsks) {
  OdriveAxis a({.node = node}, OdriveAxis::Version::v0_6, 0);
  hear(a, 1);
  EXPECT_TRUE(only(enable(a), test::cmd_mode));
  hear(a, 1);
  EXPECT_TRUE(only(enable(a), test::cmd_axis_state));
  hear(a, 8);
  EXPECT_TRUE(enable(a).empty()) << "confirmed once: its second heartbeat may come";
  hear(a, 8);
  EXPECT_TRUE(a.ready());
  EXPECT_TRUE(enable(a).empty());
}

/// Pressed between the mode and the request, on an axis that reports no error yet.
TEST(OdriveAxisCorners, AnEmergencyStopSeenOnTheBusStopsTheRequest) {
  OdriveAxis a({.node = node}, OdriveAxis::Version::v0_6, 10);
  hear(a, 1);
  EXPECT_TRUE(only(enable(a), test::cmd_mode));
  EXPECT_EQ(a.receive(test::message(node, 0x02, 0, 0, 0)), Received::accepted);
  for (int i = 1; i < 30; ++i) {
    hear(a, 1);
    const auto sent = enable(a);
    EXPECT_TRUE(i % 10 == 0 ? only(sent, test::cmd_mode) : sent.empty())
        << "from the start every ten ticks: " << i;
  }
  EXPECT_FALSE(a.must_be_released());
}

TEST(OdriveAxisCorners, WithoutARetryTimeSilenceIsAskedInEveryTick) {
  OdriveAxis silent({.node = node}, OdriveAxis::Version::v0_6, 0);
  for (int i = 0; i < 5; ++i) {
    silent.begin_tick();
    EXPECT_TRUE(only(enable(silent), test::cmd_mode)) << i;
  }
  OdriveAxis a({.node = node}, OdriveAxis::Version::v0_6, 0);
  hear(a, 1);
  (void)enable(a);
  hear(a, 1);
  EXPECT_TRUE(only(enable(a), test::cmd_axis_state));
  a.begin_tick();
  EXPECT_TRUE(only(enable(a), test::cmd_mode)) << "no confirmation: from the start";
  hear(a, 1);
  EXPECT_TRUE(only(enable(a), test::cmd_axis_state));
  hear(a, 8);
  EXPECT_TRUE(enable(a).empty()) << "confirmed once";
  a.begin_tick();
  EXPECT_TRUE(only(enable(a), test::cmd_mode)) << "and not a second time";
}

TEST(OdriveAxisCorners, AFrameThatIsNotTakenSaysNothingAboutTheLastSample) {
  OdriveAxis a({.node = node}, OdriveAxis::Version::v0_6, 10);
  a.begin_tick();
  ASSERT_EQ(a.receive(test::encoder(node, 0, 0)), Received::accepted);
  EXPECT_EQ(a.receive(test::heartbeat(node + 1, 1)), Received::not_mine);
  EXPECT_TRUE(a.brought_sample());
  CanFrame f = test::heartbeat(node, 1);
  f.size = 7;
  EXPECT_EQ(a.receive(f), Received::malformed);
  EXPECT_TRUE(a.brought_sample());
  EXPECT_EQ(a.receive(test::message(node, test::cmd_axis_state, 8, 8, 0)), Received::foreign_command);
  EXPECT_TRUE(a.brought_sample());
}

/// An axis that is never asked again has proven its watchdog no more than others when it is ready for the
/// first time.
TEST(OdriveAxisCorners, TheLongestRetryTimeProvesNoWatchdog) {
  OdriveAxis a({.node = node}, OdriveAxis::Version::v0_6, 0xFFFF'FFFF);
  a.prove_watchdog(5);
  test::arm(a);
  EXPECT_FALSE(a.ready());
  EXPECT_TRUE(a.tx_suspended() && a.setting_up()) << "its watchdog is being tested";
}

TEST(AxisConfig, IsAMotorThatTurnsWithItsJoint) {
  const AxisConfig c;
  EXPECT_EQ(c.node, 0);
  EXPECT_EQ(c.direction, 1.0F);
  EXPECT_EQ(c.gear_ratio, 1.0F);
  EXPECT_EQ(c.offset, 0.0F);
  EXPECT_EQ(shaft_torque(c, 2.5), 2.5F);
}

TEST(OdriveAxisCorners, ADefaultAxisSpeaks06AndIsPatient) {
  OdriveAxis a;
  EXPECT_FALSE(a.must_be_released());
  for (int i = 0; i < 301; ++i) {
    a.begin_tick();
    EXPECT_EQ(enable(a).size(), i % 150 == 0 ? 1U : 0U) << i;
  }
  EXPECT_EQ(a.receive(test::message(0x3F, 0x02, 0, 0, 0)), Received::accepted) << "to all";
  EXPECT_TRUE(a.emergency_stopped());
  const OdriveCheck c;
  EXPECT_EQ(c.endpoint, 0);
  EXPECT_EQ(c.type, odrive::ValueType::f32);
  EXPECT_EQ(c.lower, 0.0F);
  EXPECT_EQ(c.upper, 0.0F);
}

/// Entries of the set-up table from the words of the object dictionary.
TEST(Cia402Entries, ArePackedAsTheProfileHasThem) {
  // Not constants, so that the functions run here.
  std::uint16_t communication = 0x1801, mapping = 0x1A01;
  std::uint32_t id = 0x280;
  const cia402::Entry off = cia402::detail::disabled(communication, id);
  EXPECT_TRUE((off.object == canopen::Object{0x1801, 1}));
  EXPECT_EQ(off.constant, 0x8000'0280U) << "bit 31: the PDO does not exist";
  EXPECT_EQ(off.mask, 0x8000'0000U);
  EXPECT_TRUE(off.optional);
  EXPECT_EQ(off.bytes, 4);
  EXPECT_EQ(off.task, cia402::Task::verify);
  EXPECT_EQ(off.source, cia402::Source::plus_node);
  const cia402::Entry on = cia402::detail::cob(communication, cia402::Task::verify, id, 0xFU);
  EXPECT_TRUE((on.object == canopen::Object{0x1801, 1}));
  EXPECT_EQ(on.constant, 0x280U);
  EXPECT_EQ(on.mask, 0xFU);
  EXPECT_FALSE(on.optional);
  EXPECT_EQ(on.bytes, 4);
  EXPECT_EQ(on.task, cia402::Task::verify);
  EXPECT_EQ(on.source, cia402::Source::plus_node);
  EXPECT_EQ(cia402::detail::cob(communication, cia402::Task::write, id).mask, 0xFFFF'FFFFU);
  const cia402::Entry entry = cia402::detail::map(mapping, 2, {0x606C, 0}, 32);
  EXPECT_TRUE((entry.object == canopen::Object{0x1A01, 2}));
  EXPECT_EQ(entry.constant, 0x606C'0020U);
  EXPECT_FALSE(entry.optional);
  EXPECT_EQ(entry.bytes, 4);
  EXPECT_EQ(entry.task, cia402::Task::verify);
}

TEST(CanopenObjects, DifferInIndexOrSubIndex) {
  std::uint16_t index = 0x6041;
  const canopen::Object a{index, 0};
  EXPECT_TRUE((a == canopen::Object{0x6041, 0}));
  EXPECT_FALSE((a == canopen::Object{0x6041, 1}));
  EXPECT_FALSE((a == canopen::Object{0x6040, 0}));
}

}  // namespace
