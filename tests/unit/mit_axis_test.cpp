/// One drive in MIT mode as the controller sees it: whose frames it takes, how it gets into motor mode and
/// out, what it makes of codes. Frames are packed by hand, expectations computed here.

#include "firmware/drive/mit_axis.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <random>
#include <vector>

#include "tests/support/mit_bytes.hpp"
#include "tests/support/torque_frame.hpp"

namespace {

using esmc::drive::AxisConfig;
using esmc::drive::MitAxis;
using esmc::drive::Received;
using esmc::hal::CanFrame;
using Dialect = MitAxis::Dialect;
namespace test = esmc::test;
using test::disable;
using test::enable;

constexpr std::uint8_t node = 3;
constexpr std::uint32_t retry = 10;
constexpr unsigned enter = 0xFC, leave = 0xFD;

MitAxis axis(Dialect d = Dialect::mini_cheetah, std::uint16_t master = 0) {
  return {AxisConfig{.node = node}, {.dialect = d, .master_id = master, .retry_ticks = retry}};
}

bool only(const std::vector<CanFrame>& sent, unsigned last) {
  return sent.size() == 1 && sent[0].id == node && test::is_special(sent[0], last);
}
/// A reply in the middle of all ranges.
CanFrame rest(unsigned first = node, std::uint8_t size = 6) {
  return test::mit_reply(0, first, 0x8000, 0x800, 0x800, size);
}
/// A reply in a tick of its own.
void hear(MitAxis& a, const CanFrame& f = rest()) {
  a.begin_tick();
  ASSERT_EQ(a.receive(f), Received::accepted);
}
/// Brings a drive to where motor mode has been asked for.
void ask(MitAxis& a, const CanFrame& reply = rest()) {
  hear(a, reply);
  ASSERT_TRUE(only(enable(a), leave));
  hear(a, reply);
  ASSERT_TRUE(enable(a).empty());
  hear(a, reply);
  ASSERT_TRUE(only(enable(a), enter));
}
MitAxis ready_axis() {
  MitAxis a = axis();
  ask(a);
  hear(a);
  hear(a);
  return a;
}

// ---- whose frames

TEST(MitAxis, TakesRepliesThatNameItOnTheMastersIdentifier) {
  for (const std::uint16_t master : {std::uint16_t{0}, std::uint16_t{0x11}, std::uint16_t{0x7FF}}) {
    MitAxis a = axis(Dialect::mini_cheetah, master);
    a.begin_tick();
    for (unsigned first = 0; first < 256; ++first) {
      EXPECT_EQ(a.receive(test::mit_reply(master, first, 1, 2, 3)),
                first == node ? Received::accepted : Received::not_mine);
    }
    EXPECT_EQ(a.receive(test::mit_reply(master ^ 1U, node, 1, 2, 3)), Received::not_mine);
    EXPECT_EQ(a.receive(test::bytes(master, {})), Received::not_mine) << "it names nobody";
  }
}

TEST(MitAxis, DamiaoHasTheNodeInTheLowHalfOfTheFirstByte) {
  MitAxis a = axis(Dialect::damiao, 0x13);
  for (unsigned first = 0; first < 256; ++first) {
    EXPECT_EQ(a.receive(test::mit_reply(0x13, first, 0x8000, 0x800, 0x800, 8)),
              first % 16 == node ? Received::accepted : Received::not_mine);
  }
}

TEST(MitAxis, AnEmptyFrameHasNoNode) {
  MitAxis a({.node = 0x10}, {.dialect = Dialect::damiao, .master_id = 0x13, .retry_ticks = retry});
  CanFrame f = test::bytes(0x13, {});
  EXPECT_EQ(a.receive(f), Received::not_mine) << "nor do the bytes that it does not have";
  f.size = 1;
  EXPECT_EQ(a.receive(f), Received::malformed);
}

TEST(MitAxis, CommandsToItAreForeign) {
  MitAxis a = axis();
  for (const CanFrame& f :
       {test::mit_command(node, 0x8000, 0x800, 0, 0, 0xFFF), test::mit_special(node, enter),
        test::mit_special(node, leave), test::mit_special(node, 0xFE), test::bytes(node, {}),
        test::mit_reply(node, node, 1, 2, 3)}) {
    EXPECT_EQ(a.receive(f), Received::foreign_command);
  }
  CanFrame f = test::mit_special(node, enter);
  f.fd = true;
  EXPECT_EQ(a.receive(f), Received::foreign_command);
  f = test::mit_special(node, enter);
  f.extended = true;
  EXPECT_EQ(a.receive(f), Received::not_mine);
  f.extended = false;
  f.remote = true;
  EXPECT_EQ(a.receive(f), Received::not_mine);
  EXPECT_EQ(a.receive(test::mit_special(node + 1, enter)), Received::not_mine);
  EXPECT_FALSE(a.alive());
}

TEST(MitAxis, ADriveThatRepliesOnItsOwnIdentifierIsToldFromACommand) {
  MitAxis old = axis(Dialect::mini_cheetah, node);
  for (std::uint8_t size = 5; size <= 7; ++size) {
    EXPECT_EQ(old.receive(test::mit_reply(node, node, 0x8000, 0x800, 1, size)), Received::accepted);
    EXPECT_EQ(old.receive(test::mit_reply(node, node + 1, 0x8000, 0x800, 1, size)),
              Received::foreign_command);
  }
  EXPECT_EQ(old.receive(test::mit_command(node, 0x0300, 0x800, 0, 0, 0x800)), Received::foreign_command)
      << "its first byte is the node, its length is not that of a reply";
  EXPECT_EQ(old.receive(test::bytes(node, {})), Received::foreign_command);
  MitAxis now = axis(Dialect::cubemars, node);
  EXPECT_EQ(now.receive(test::mit_reply(node, node, 0x8000, 0x800, 1, 8)), Received::accepted);
  EXPECT_EQ(now.receive(test::mit_special(node, enter)), Received::foreign_command);
  EXPECT_EQ(now.receive(test::mit_command(node, 0x8000, 0x800, 0, 0, 0x800)), Received::foreign_command);
}

TEST(MitAxis, WrongLengthsAndFormatsOfItsRepliesAreMalformedAndChangeNothing) {
  for (const Dialect d : {Dialect::mini_cheetah, Dialect::cubemars, Dialect::damiao}) {
    MitAxis a = axis(d);
    for (std::uint8_t size = 1; size <= 8; ++size) {
      const bool right = d == Dialect::mini_cheetah ? size >= 5 && size <= 7 : size == 8;
      if (right) continue;
      EXPECT_EQ(a.receive(rest(node, size)), Received::malformed) << int{size};
    }
    CanFrame f = rest(node, d == Dialect::mini_cheetah ? 6 : 8);
    f.fd = true;
    EXPECT_EQ(a.receive(f), Received::malformed);
    f.fd = false;
    f.remote = true;
    EXPECT_EQ(a.receive(f), Received::not_mine);
    f.remote = false;
    f.extended = true;
    EXPECT_EQ(a.receive(f), Received::not_mine);
    EXPECT_FALSE(a.alive());
    EXPECT_EQ(a.sample_age_ticks(), MitAxis::age_max);
    EXPECT_EQ(a.heartbeat_age_ticks(), MitAxis::age_max);
  }
}

TEST(MitAxis, AReplyIsSampleAndHeartbeat) {
  MitAxis a = axis();
  EXPECT_FALSE(a.alive() || a.heard_this_tick() || a.error() || a.idle() || a.ready() || a.closed_loop());
  a.begin_tick();
  EXPECT_EQ(a.sample_age_ticks(), MitAxis::age_max) << "an age that has never begun does not wrap";
  hear(a);
  EXPECT_TRUE(a.alive() && a.heard_this_tick() && a.brought_sample());
  for (std::uint32_t age = 1; age < 5; ++age) {
    a.begin_tick();
    EXPECT_FALSE(a.heard_this_tick());
    EXPECT_EQ(a.sample_age_ticks(), age);
    EXPECT_EQ(a.heartbeat_age_ticks(), age);
  }
}

// ---- numbers

TEST(MitAxis, CodesBecomeJointAngleAndRate) {
  const AxisConfig mounting{.node = node, .direction = -1.0F, .gear_ratio = 4.0F, .offset = 0.25F};
  MitAxis a(mounting, {.ranges = {.position = 95.5F, .velocity = 45.0F, .torque = 18.0F}});
  for (const unsigned p : {1U, 1000U, 32767U, 32768U, 60000U, 65534U}) {
    for (const unsigned v : {1U, 2047U, 2048U, 4094U}) {
      (void)a.receive(test::mit_reply(0, node, p, v, 0));
      const double shaft = p * 191.0 / 65535 - 95.5, speed = v * 90.0 / 4095 - 45.0;
      EXPECT_NEAR(a.sample<double>().angle, -shaft / 4 + 0.25, 1e-5);
      EXPECT_NEAR(a.sample<double>().rate, -speed / 4, 1e-5);
      EXPECT_NEAR(a.sample<float>().angle, -shaft / 4 + 0.25, 1e-5);
    }
  }
}

TEST(MitAxis, TorqueIsTurnedRoundedAndClamped) {
  const AxisConfig mounting{.node = node, .direction = -1.0F, .gear_ratio = 2.0F};
  const MitAxis a(mounting, {.ranges = {.torque = 10.0F}});
  // (-t/2 + 10) 4095 / 20: 4 N m at the joint is -2 at the shaft, code 1638.
  EXPECT_EQ(test::torque_frame(a, 4.0), test::mit_command(node, 0x8000, 0x800, 0, 0, 1638));
  EXPECT_EQ(test::torque_frame(a, -4.0F), test::mit_command(node, 0x8000, 0x800, 0, 0, 2457));
  EXPECT_EQ(test::torque_frame(a, 0.0), test::mit_command(node, 0x8000, 0x800, 0, 0, 2048));
  EXPECT_EQ(test::torque_frame(a, 30.0), test::mit_command(node, 0x8000, 0x800, 0, 0, 0));
  EXPECT_EQ(test::torque_frame(a, -30.0), test::mit_command(node, 0x8000, 0x800, 0, 0, 4095));
}

TEST(MitAxis, WhatCannotBeCarriedIsZero) {
  const MitAxis a = axis();
  for (const double bad : {std::nan(""), HUGE_VAL, -HUGE_VAL, 1.1e4, -1.1e4}) {
    EXPECT_FALSE(a.can_carry(bad));
    EXPECT_EQ(test::torque_frame(a, bad), test::mit_command(node, 0x8000, 0x800, 0, 0, 2048)) << bad;
  }
  EXPECT_EQ(test::torque_frame(a, std::nanf("")), test::mit_command(node, 0x8000, 0x800, 0, 0, 2048));
  EXPECT_TRUE(a.can_carry(1e4) && a.can_carry(-1e4) && a.can_carry(0.0F));
}

TEST(MitAxis, TheTorqueADriveReportsIsTurnedToTheJoint) {
  const AxisConfig mounting{.node = node, .direction = -1.0F, .gear_ratio = 2.0F};
  MitAxis a(mounting, {.ranges = {.torque = 10.0F}});
  (void)a.receive(test::mit_reply(0, node, 0x8000, 0x800, 4000));
  ASSERT_TRUE(a.observed_torque());
  EXPECT_NEAR(static_cast<double>(*a.observed_torque()), -2 * (4000 * 20.0 / 4095 - 10), 1e-5);
  EXPECT_EQ(a.torque_age_ticks(), 0U);
  a.begin_tick();
  (void)a.receive(test::mit_reply(0, node, 0x8000, 0x800, 4000, 5));
  EXPECT_FALSE(a.observed_torque());
  EXPECT_EQ(a.torque_age_ticks(), 1U) << "a reply without it";
  EXPECT_EQ(MitAxis{}.torque_age_ticks(), MitAxis::age_max);
}

// ---- errors

/// Beyond the range the drive repeats its first or last code: the shaft may be anywhere.
TEST(MitAxis, ASampleAtTheRailIsAnErrorAndNotAPosition) {
  for (const unsigned p : {0U, 1U, 0xFFFEU, 0xFFFFU}) {
    for (const unsigned v : {0U, 1U, 0xFFEU, 0xFFFU}) {
      MitAxis a = axis();
      hear(a, test::mit_reply(0, node, p, v, 0x800));
      const std::uint32_t want = (p % 0xFFFF == 0 ? MitAxis::position_at_rail : 0) +
                                 (v % 0xFFF == 0 ? MitAxis::velocity_at_rail : 0);
      EXPECT_EQ(a.error_code(), want) << p << ' ' << v;
      EXPECT_EQ(a.error(), want != 0);
      hear(a, test::mit_reply(0, node, p == 0 ? 1 : (p == 0xFFFF ? 0xFFFE : p), 0x800, 0x800));
      EXPECT_FALSE(a.error()) << "back in range";
    }
  }
}

/// Firmware that does not clamp goes on at the other end.
TEST(MitAxis, APositionThatWrapsAroundIsLost) {
  MitAxis a = axis();
  hear(a, test::mit_reply(0, node, 0xFFF0, 0x800, 0));
  hear(a, test::mit_reply(0, node, 0xFFF0 - 32767, 0x800, 0));
  EXPECT_FALSE(a.error()) << "half of the span is a jump, but no proof";
  hear(a, test::mit_reply(0, node, 0xFFF0, 0x800, 0));
  EXPECT_FALSE(a.error());
  hear(a, test::mit_reply(0, node, 0x0010, 0x800, 0));
  EXPECT_EQ(a.error_code(), MitAxis::position_lost);
  for (int i = 0; i < 10; ++i) hear(a, test::mit_reply(0, node, 0x0010, 0x800, 0));
  EXPECT_EQ(a.error_code(), MitAxis::position_lost) << "latched: it is wrong from now on";
  hear(a, test::mit_reply(0, node, 0xFFF0, 0x800, 0));
  EXPECT_TRUE(a.error());
}

TEST(MitAxis, TheErrorFieldWhereThereIsOne) {
  for (unsigned e = 0; e < 256; ++e) {
    MitAxis ak = axis(Dialect::cubemars), old = axis();
    CanFrame f = rest(node, 8);
    f.data[7] = static_cast<std::uint8_t>(e);
    hear(ak, f);
    EXPECT_EQ(ak.error_code(), e);
    f.size = 7;
    f.data[6] = static_cast<std::uint8_t>(e);
    hear(old, f);
    EXPECT_FALSE(old.error()) << "a voltage";
  }
  for (unsigned e = 0; e < 16; ++e) {
    MitAxis a = axis(Dialect::damiao);
    hear(a, rest(e * 16 + node, 8));
    EXPECT_EQ(a.error_code(), e <= 1 ? 0 : e) << "0 and 1 are modes";
  }
}

// ---- into motor mode and out of it

TEST(MitAxis, EnablingLeavesMotorModeWaitsForTheZeroCommandAndEnters) {
  MitAxis a = axis();
  ask(a);
  EXPECT_TRUE(a.must_be_released());
  EXPECT_FALSE(a.ready());
  EXPECT_TRUE(a.closed_loop()) << "as far as is known";
  hear(a);
  EXPECT_FALSE(a.ready());
  EXPECT_TRUE(enable(a).empty());
  hear(a);
  EXPECT_TRUE(a.ready());
  for (int i = 0; i < 300; ++i) {
    ASSERT_TRUE(enable(a).empty()) << "nothing more to ask for: " << i;
    hear(a);
    ASSERT_TRUE(a.ready()) << i;
  }
}

TEST(MitAxis, TwoRepliesInOneTickAreOne) {
  MitAxis a = axis();
  hear(a);
  EXPECT_TRUE(only(enable(a), leave));
  hear(a);
  EXPECT_EQ(a.receive(rest()), Received::accepted);
  EXPECT_TRUE(enable(a).empty());
  hear(a);
  EXPECT_TRUE(only(enable(a), enter));
  hear(a);
  EXPECT_EQ(a.receive(rest()), Received::accepted);
  EXPECT_FALSE(a.ready());
  hear(a);
  EXPECT_TRUE(a.ready());
}

/// A reply that says otherwise starts the count again within its tick, whatever was counted up to then.
TEST(MitAxis, AReplyAfterAnErrorInTheSameTickIsTheFirstOfANewCount) {
  MitAxis a = ready_axis();
  hear(a);
  EXPECT_EQ(a.receive(test::mit_reply(0, node, 0xFFFF, 0x800, 0x800)), Received::accepted);
  EXPECT_FALSE(a.ready());
  EXPECT_EQ(a.receive(rest()), Received::accepted);
  EXPECT_FALSE(a.ready()) << "one tick without an error since";
  hear(a);
  EXPECT_TRUE(a.ready()) << "two";
}

TEST(MitAxis, WhatTheBusDidNotTakeIsSentAgain) {
  MitAxis a = axis();
  for (int i = 0; i < 5; ++i) {
    hear(a);
    EXPECT_TRUE(only(enable(a, false), leave)) << i;
  }
  EXPECT_TRUE(only(enable(a), leave));
  hear(a);
  hear(a);
  for (int i = 0; i < 5; ++i) EXPECT_TRUE(only(enable(a, false), enter)) << i;
  EXPECT_FALSE(a.must_be_released() || a.closed_loop());
  EXPECT_TRUE(only(enable(a), enter));
  for (int i = 0; i < 2; ++i) hear(a);
  EXPECT_TRUE(a.ready());
  EXPECT_TRUE(disable(a).empty());
  for (int i = 0; i < 5; ++i) {
    hear(a);
    EXPECT_TRUE(only(disable(a, false), leave)) << i;
    EXPECT_FALSE(a.idle());
  }
  EXPECT_TRUE(only(disable(a), leave));
}

TEST(MitAxis, ASilentDriveIsCalledEveryRetryTicksAndStartsAnewWhenHeard) {
  MitAxis a = axis();
  for (std::uint32_t tick = 0; tick < 5 * retry; ++tick) {
    a.begin_tick();
    const auto sent = enable(a);
    EXPECT_TRUE(tick % retry == 0 ? only(sent, leave) : sent.empty()) << tick;
  }
  for (int i = 0; i < 4; ++i)
    EXPECT_EQ(enable(a, false).size(), i == 0 ? 1U : 0U) << "nor when the bus takes nothing";
  hear(a);
  EXPECT_TRUE(only(enable(a), leave));
}

TEST(MitAxis, WhoSetsNoRetryTimeWaits150Ticks) {
  MitAxis a({.node = node}, {});
  for (int i = 0; i < 301; ++i) EXPECT_EQ(enable(a).size(), i % 150 == 0 ? 1U : 0U) << i;
}

TEST(MitAxis, ADriveThatFallsSilentIsAskedFromTheStart) {
  MitAxis a = axis();
  ask(a);
  for (std::uint32_t i = 0; i + 1 < retry; ++i) EXPECT_TRUE(enable(a).empty()) << i;
  EXPECT_TRUE(only(enable(a), leave));
  for (std::uint32_t i = 0; i + 1 < retry; ++i) EXPECT_TRUE(enable(a).empty()) << i;
  EXPECT_TRUE(only(enable(a), leave));
  a.ask_again();
  EXPECT_TRUE(only(enable(a), leave));
  MitAxis b({.node = node}, {.retry_ticks = 0});
  for (int i = 0; i < 3; ++i) EXPECT_TRUE(only(enable(b), leave)) << "silent: in every tick " << i;
  hear(b);
  for (int i = 0; i < 3; ++i) EXPECT_TRUE(only(enable(b), leave)) << "no reply since " << i;
}

TEST(MitAxis, ADriveThatMayHaveRestartedIsAskedFromTheStart) {
  const auto restarts = [](MitAxis& a) {
    const auto quiet = [&] { return a.begin_tick(), enable(a); };
    const bool was = a.ready();
    for (int i = 0; i < 2; ++i) EXPECT_TRUE(quiet().empty());
    EXPECT_EQ(a.ready(), was) << "two replies may be lost";
    EXPECT_TRUE(only(quiet(), leave));
    EXPECT_FALSE(a.ready());
    for (int i = 0; i < 3; ++i) EXPECT_TRUE(quiet().empty()) << "once";
    hear(a);
    EXPECT_TRUE(enable(a).empty());
    hear(a);
    EXPECT_TRUE(only(enable(a), enter));
  };
  MitAxis ready = ready_axis(), asked = axis(), left = axis();
  restarts(ready);
  ask(asked);
  restarts(asked);
  hear(left);
  EXPECT_TRUE(only(enable(left), leave));
  hear(left);
  restarts(left);
}

TEST(MitAxis, AnErrorKeepsItOutOfMotorModeAndCountsAgain) {
  MitAxis a = axis();
  hear(a);
  EXPECT_TRUE(only(enable(a), leave));
  for (std::uint32_t i = 0; i + 1 < retry; ++i) {
    hear(a, test::mit_reply(0, node, 0xFFFF, 0x800, 0x800));
    EXPECT_TRUE(enable(a).empty());
  }
  hear(a, test::mit_reply(0, node, 0xFFFF, 0x800, 0x800));
  EXPECT_TRUE(only(enable(a), leave)) << "from the start";
  MitAxis b = axis();
  ask(b);
  hear(b);
  hear(b, test::mit_reply(0, node, 0x8000, 0xFFF, 0x800));
  EXPECT_FALSE(b.ready());
  hear(b);
  EXPECT_FALSE(b.ready());
  hear(b);
  EXPECT_TRUE(b.ready());
}

/// The cycle sends a torque frame after this in every tick, and it says zero: that comes before the frame
/// that leaves.
TEST(MitAxis, DisablingGivesTheZeroCommandATickAndThenLeavesUntilTwoTicksHaveReplied) {
  MitAxis a = ready_axis();
  EXPECT_TRUE(disable(a).empty());
  EXPECT_FALSE(a.ready() || a.idle() || a.closed_loop());
  hear(a);
  EXPECT_TRUE(only(disable(a), leave));
  EXPECT_FALSE(a.idle());
  hear(a);
  EXPECT_FALSE(a.idle()) << "it may answer what it was told before";
  EXPECT_TRUE(a.must_be_released());
  EXPECT_TRUE(only(disable(a), leave)) << "again: the first may be lost";
  hear(a);
  EXPECT_TRUE(a.idle());
  EXPECT_FALSE(a.must_be_released());
}

TEST(MitAxis, ADriveThatWasNeverAskedIsNotKnownToBeIdle) {
  MitAxis a = axis();
  for (int i = 0; i < 5; ++i) hear(a);
  EXPECT_FALSE(a.idle() || a.must_be_released());
  EXPECT_TRUE(disable(a).empty());
  EXPECT_TRUE(only(disable(a), leave));
  hear(a);
  hear(a);
  EXPECT_TRUE(a.idle());
}

TEST(MitAxis, EnablingAfterDisablingBeginsAtOnce) {
  MitAxis a = ready_axis();
  (void)disable(a);
  EXPECT_TRUE(only(enable(a), leave));
  MitAxis b = ready_axis();
  (void)disable(b);
  (void)disable(b);
  hear(b);
  hear(b);
  EXPECT_TRUE(only(enable(b), enter)) << "it is out of motor mode, and has had zero commands since";
}

TEST(MitAxis, ThereIsNoEmergencyStopAndNothingToReadBack) {
  MitAxis a = ready_axis();
  a.acknowledge();
  EXPECT_FALSE(a.emergency_stopped() || a.config_mismatch() || a.tx_suspended() || a.setting_up());
  EXPECT_TRUE(a.ready());
}

// ---- Damiao reports its mode

CanFrame mode(unsigned m) { return rest(m * 16 + node, 8); }

TEST(MitAxis, AReportedModeMustAgree) {
  MitAxis a = axis(Dialect::damiao);
  ask(a, mode(0));
  EXPECT_TRUE(a.closed_loop()) << "it has never said 1: older firmware always says 0";
  hear(a, mode(1));
  hear(a, mode(1));
  EXPECT_TRUE(a.ready());
  hear(a, mode(0));
  EXPECT_FALSE(a.closed_loop() || a.ready()) << "it left by itself";
  hear(a, mode(1));
  EXPECT_FALSE(a.ready());
  hear(a, mode(1));
  EXPECT_TRUE(a.ready());
  (void)disable(a);
  (void)disable(a);
  for (int i = 0; i < 5; ++i) hear(a, mode(1));
  EXPECT_FALSE(a.idle()) << "it says that it is still there";
  hear(a, mode(0));
  EXPECT_FALSE(a.idle()) << "once";
  hear(a, mode(1));
  hear(a, mode(0));
  EXPECT_FALSE(a.idle()) << "once since";
  hear(a, mode(0));
  EXPECT_TRUE(a.idle());
}

/// A 1 of another maker is an error like any other, and its going away no change of mode.
TEST(MitAxis, OnlyDamiaoReportsAMode) {
  MitAxis a = axis(Dialect::cubemars);
  ask(a, rest(node, 8));
  CanFrame error = rest(node, 8);
  error.data[7] = 1;
  hear(a, error);
  EXPECT_TRUE(a.error());
  hear(a, rest(node, 8));
  EXPECT_TRUE(a.closed_loop());
  hear(a, rest(node, 8));
  EXPECT_TRUE(a.ready());
}

/// What the bus did not take, or what a silent drive may not have heard, has not been asked.
TEST(MitAxis, RepliesAreCountedFromAFrameThatWasTakenAndThatAnAxisCouldHear) {
  MitAxis a = axis();
  hear(a);
  EXPECT_TRUE(only(enable(a, false), leave));
  hear(a);
  hear(a);
  EXPECT_FALSE(a.idle());
  EXPECT_TRUE(only(enable(a), leave)) << "again, not on to the next";
  MitAxis b = axis();
  EXPECT_TRUE(only(enable(b), leave));
  hear(b);
  hear(b);
  EXPECT_FALSE(b.idle());
  EXPECT_TRUE(only(enable(b), leave)) << "heard since: now it counts";
}

TEST(MitAxis, AModeThatIsNeverReportedIsNotAskedFor) {
  MitAxis a = axis(Dialect::damiao);
  ask(a, mode(0));
  hear(a, mode(0));
  hear(a, mode(0));
  EXPECT_TRUE(a.ready() && a.closed_loop());
}

// ---- anything at all

/// Whatever comes in whatever order: ready only after the frame that enters, samples finite, torque frames
/// ours.
TEST(MitAxis, RandomFramesAndCallsBreakNothing) {
  std::mt19937 random(1);
  const auto any = [&](unsigned n) { return static_cast<unsigned>(random() % n); };
  for (const Dialect d : {Dialect::mini_cheetah, Dialect::cubemars, Dialect::damiao}) {
    for (const std::uint16_t master : {std::uint16_t{0}, std::uint16_t{node}}) {
      MitAxis a = axis(d, master);
      bool entered = false;
      for (int i = 0; i < 200000; ++i) {
        CanFrame f;
        f.id = any(8) == 0 ? any(0x800) : (any(2) == 0 ? master : node);
        f.size = static_cast<std::uint8_t>(any(9));
        for (std::uint8_t k = 0; k < f.size; ++k) f.data[k] = static_cast<std::uint8_t>(any(256));
        if (any(2) == 0) f.data[0] = node;
        f.extended = any(50) == 0;
        f.remote = any(50) == 0;
        f.fd = any(50) == 0;
        if (any(4) == 0) a.begin_tick();
        (void)a.receive(f);
        if (any(100) == 0) {
          if (!disable(a).empty()) entered = false;
        }
        for (const CanFrame& s : enable(a, any(4) != 0)) {
          ASSERT_EQ(s.id, node);
          entered = entered || test::is_special(s, enter);
        }
        ASSERT_TRUE(!a.ready() || entered);
        ASSERT_FALSE(a.ready() && (a.idle() || a.error()));
        const auto s = a.sample<double>();
        ASSERT_LE(std::abs(s.angle), 12.5001);
        ASSERT_LE(std::abs(s.rate), 50.001);
      }
    }
  }
}

/// A driver board V3: 0.1 deg and 10 electrical rpm, both signed, behind 2900h + node.
CanFrame v3_reply(int position, int speed, unsigned error = 0) {
  const auto high = [](int v) { return static_cast<unsigned>(v & 0xFFFF) / 256; };
  const auto low = [](int v) { return static_cast<unsigned>(v & 0xFF); };
  CanFrame f =
      test::bytes(0x2900 + node, {high(position), low(position), high(speed), low(speed), 0, 0, 20, error});
  f.extended = true;
  return f;
}
MitAxis v3_axis() {
  return {AxisConfig{.node = node, .direction = -1.0F, .gear_ratio = 2.0F, .offset = 0.5F},
          {.dialect = Dialect::cubemars_v3, .retry_ticks = retry, .velocity_unit = 0.01F}};
}

TEST(MitAxis, CubemarsV3SaysDegreesAndElectricalSpeed) {
  MitAxis a = v3_axis();
  hear(a, v3_reply(-900, 250));
  const auto s = a.sample<double>();
  EXPECT_NEAR(s.angle, 0.5 * 1.5707963267948966 + 0.5, 1e-6);
  EXPECT_NEAR(s.rate, -0.5 * 2.5, 1e-6);
  EXPECT_FALSE(a.observed_torque());
  EXPECT_FALSE(a.error());
  for (const CanFrame& bad :
       {v3_reply(0, 0, 1), v3_reply(-32768, 0), v3_reply(0, 32767), v3_reply(0, -32768)}) {
    MitAxis b = v3_axis();
    hear(b, bad);
    EXPECT_TRUE(b.error());
  }
  MitAxis c = v3_axis();
  hear(c, v3_reply(0, 0x0FFF - 0x8000));
  EXPECT_FALSE(c.error()) << "the rail of twelve bits is a speed here";
}

TEST(MitAxis, CubemarsV3ArmsAndPartsWithoutSpecialFrames) {
  MitAxis a = v3_axis();
  EXPECT_TRUE(enable(a).empty()) << "a silent drive is asked by the zero command of every tick";
  for (int i = 0; i < 6 && !a.ready(); ++i) {
    hear(a, v3_reply(0, 0));
    EXPECT_TRUE(enable(a).empty());
  }
  ASSERT_TRUE(a.ready());
  EXPECT_TRUE(a.closed_loop() && a.must_be_released());
  CanFrame f;
  a.put_torque(f, 0.0F);
  EXPECT_TRUE(f.extended);
  EXPECT_EQ(f.id, 0x800U + node);
  EXPECT_EQ(test::mit_number(f, 0, 8), 0x0000'0080'0080'0800U);
  a.put_torque(f, 36.0F);  // -18 N m at the shaft
  EXPECT_EQ(test::mit_number(f, 0, 8), 0x0000'0080'0080'0000U);
  for (int i = 0; i < 6 && !a.idle(); ++i) {
    hear(a, v3_reply(0, 0));
    EXPECT_TRUE(disable(a).empty());
  }
  EXPECT_TRUE(a.idle());
  EXPECT_FALSE(a.must_be_released());
}

TEST(MitAxis, CubemarsV3KnowsItsFramesByAllOfTheIdentifier) {
  MitAxis a = v3_axis();
  const auto with = [](std::uint32_t id, bool extended = true) {
    CanFrame f = v3_reply(0, 0);
    f.id = id;
    f.extended = extended;
    return f;
  };
  EXPECT_EQ(a.receive(with(0x800 + node)), Received::foreign_command);
  EXPECT_EQ(a.receive(with(0x100 + node)), Received::foreign_command) << "a current";
  EXPECT_EQ(a.receive(with(0xF00 + node)), Received::foreign_command) << "disable";
  EXPECT_EQ(a.receive(with(0x1000 + node)), Received::foreign_command);
  EXPECT_EQ(a.receive(with(0x2A00 + node)), Received::not_mine) << "another report";
  EXPECT_EQ(a.receive(with(0x2900 + node + 1)), Received::not_mine);
  EXPECT_EQ(a.receive(with(0x800 + node + 1)), Received::not_mine);
  EXPECT_EQ(a.receive(with(node, false)), Received::not_mine);
  EXPECT_EQ(a.receive(with(0, false)), Received::not_mine) << "the master's of the others";
  CanFrame cut = v3_reply(0, 0);
  cut.size = 7;
  EXPECT_EQ(a.receive(cut), Received::malformed);
  CanFrame remote = v3_reply(0, 0);
  remote.remote = true;
  EXPECT_EQ(a.receive(remote), Received::not_mine);
  EXPECT_FALSE(a.alive());
  EXPECT_EQ(a.receive(v3_reply(0, 0)), Received::accepted);
}

}  // namespace
