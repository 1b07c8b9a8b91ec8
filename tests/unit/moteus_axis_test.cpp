/// One moteus as the controller sees it: whose frames it takes, how it is armed with read-back and stopped,
/// and that it is given torque while it is armed only. Frames are written by hand.

#include "firmware/drive/moteus_axis.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>
#include <string>

#include "tests/support/moteus_bytes.hpp"

namespace {

using esmc::drive::AxisConfig;
using esmc::drive::MoteusAxis;
using esmc::drive::Received;
using esmc::hal::CanFrame;
using Reply = esmc::test::MoteusReply;

constexpr std::uint8_t node = 3;
constexpr std::uint32_t retry = 10;
constexpr const char* limits = "2525c80025270a00";  // 2 N m, 10 ms
const std::string version = esmc::test::moteus_version;

MoteusAxis axis(bool absolute = true, const AxisConfig& c = {.node = node}) {
  return {c, {.torque_max = 2.0F, .watchdog = 0.01F, .absolute = absolute, .retry_ticks = retry}};
}
int asked = 0;  // frames from enable() and disable(), which are for a drive that was never heard
bool silent = false, takes = true;
bool send(const CanFrame& f) {
  EXPECT_TRUE(silent);
  EXPECT_EQ(esmc::test::digits_of(f), "11001f01110f118202110c50");
  ++asked;
  return takes;
}
/// A reply in a tick of its own.
void hear(MoteusAxis& a, const Reply& r) {
  a.begin_tick();
  ASSERT_EQ(a.receive(r.frame(node)), Received::accepted);
}
std::string frame(const MoteusAxis& a, double torque = 1.5) {
  CanFrame f;
  a.put_torque(f, torque);
  EXPECT_EQ(f.id, 0x8000U + node);
  return esmc::test::digits_of(f);
}
const std::string stop = "010000", zero = "01000a0320800000", run = "01000a022080000d22";
bool begins(const std::string& text, const std::string& with) { return text.substr(0, with.size()) == with; }

const Reply stopped{.more = version}, armed{.mode = 10, .more = limits}, running{.mode = 10};

MoteusAxis wanted_axis(bool absolute = true) {
  MoteusAxis a = axis(absolute);
  hear(a, stopped);
  hear(a, stopped);
  a.enable(send);
  return a;
}
MoteusAxis ready_axis() {
  MoteusAxis a = wanted_axis();
  hear(a, armed);
  hear(a, armed);
  return a;
}

TEST(MoteusAxis, TakesRepliesOfItsNodeToUs) {
  MoteusAxis a = axis();
  EXPECT_EQ(a.node(), node);
  EXPECT_FALSE(a.alive());
  EXPECT_EQ(a.sample_age_ticks(), MoteusAxis::age_max);
  a.begin_tick();
  EXPECT_FALSE(a.heard_this_tick());
  EXPECT_EQ(a.receive(running.frame(node)), Received::accepted);
  EXPECT_TRUE(a.alive() && a.heard_this_tick() && a.brought_sample());
  EXPECT_EQ(a.heartbeat_age_ticks(), 0U);
  a.begin_tick();
  EXPECT_EQ(a.sample_age_ticks(), 1U);
  for (unsigned other = 0; other < 128; ++other) {
    if (other == node) continue;
    EXPECT_EQ(a.receive(running.frame(other)), Received::not_mine) << other;
  }
  CanFrame f = running.frame(node);
  f.remote = true;
  EXPECT_EQ(a.receive(f), Received::not_mine);
  f = running.frame(node);
  f.extended = true;
  EXPECT_EQ(a.receive(f), Received::not_mine) << "11 bits are enough for its identifier";
  f = running.frame(node);
  f.id |= 0x10000;
  EXPECT_EQ(a.receive(f), Received::not_mine) << "of another prefix";
  f = running.frame(node);
  f.id |= 0x05;
  EXPECT_EQ(a.receive(f), Received::not_mine) << "to another controller";
  EXPECT_EQ(a.sample_age_ticks(), 1U);
  MoteusAxis far = axis(true, {.node = 0x41});
  EXPECT_EQ(far.receive(running.frame(0x41)), Received::accepted) << "29 bits";
}

TEST(MoteusAxis, FramesToItAreForeign) {
  MoteusAxis a = axis();
  for (const std::uint32_t id : {0x8003U, 0x0003U, 0x0103U, 0x8503U, 0x7F03U, 0x007FU, 0x807FU, 0x417FU})
    EXPECT_EQ(a.receive(esmc::test::fd_frame(id, "1100")), Received::foreign_command) << id;
  EXPECT_EQ(a.receive(esmc::hal::data_frame(0x703, 8)), Received::foreign_command) << "classic ones too";
  EXPECT_FALSE(a.alive());
}

TEST(MoteusAxis, BrokenRepliesHaveNoEffect) {
  MoteusAxis a = axis();
  CanFrame f = running.frame(node);
  f.fd = false;
  f.size = 8;
  EXPECT_EQ(a.receive(f), Received::malformed);
  EXPECT_EQ(a.receive(esmc::test::fd_frame(0x300, "21000a")), Received::malformed);
  EXPECT_FALSE(a.alive());
}

TEST(MoteusAxis, TurnsBecomeRadiansAtTheJoint) {
  MoteusAxis a = axis(true, {.node = node, .direction = -1.0F, .gear_ratio = 2.0F, .offset = 0.5F});
  hear(a, {.mode = 10, .position = 0.5F, .velocity = -4.0F, .torque = 0.25F});
  const auto s = a.sample<double>();
  EXPECT_NEAR(s.angle, 0.5 - 3.14159265358979 / 2.0, 1e-12);
  EXPECT_NEAR(s.rate, 4.0 * 3.14159265358979, 1e-12);
  EXPECT_EQ(a.observed_torque(), -0.5F);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  hear(a, {.mode = 10, .position = nan, .velocity = nan});
  EXPECT_TRUE(std::isnan(a.sample<float>().angle)) << "for the guard to see";
}

TEST(MoteusAxis, ArmsAfterTwoStopsAndTwoRepliesWithItsLimits) {
  MoteusAxis a = axis();
  EXPECT_TRUE(begins(frame(a), stop)) << "silent";
  hear(a, stopped);
  a.enable(send);
  EXPECT_TRUE(begins(frame(a), stop));
  EXPECT_FALSE(a.idle());
  hear(a, stopped);
  EXPECT_TRUE(a.idle());
  EXPECT_FALSE(a.must_be_released());
  a.enable(send);
  EXPECT_TRUE(a.must_be_released());
  EXPECT_EQ(frame(a), "01000a0320800000022300000525c80005270a0011001f01110f152515275050");
  hear(a, stopped);  // of the stop before
  EXPECT_FALSE(a.closed_loop());
  hear(a, running);  // not asked for its limits
  hear(a, armed);
  EXPECT_FALSE(a.ready());
  EXPECT_EQ(a.receive(armed.frame(node)), Received::accepted);
  EXPECT_FALSE(a.ready()) << "two replies in a tick";
  EXPECT_TRUE(begins(frame(a), zero));
  hear(a, armed);
  EXPECT_TRUE(a.ready() && a.closed_loop() && !a.error() && !a.config_mismatch() && !a.idle());
  EXPECT_EQ(frame(a), "01000a022080000d220000c03f022300000525c80005270a0011001f01110f50");
  hear(a, running);
  a.enable(send);
  EXPECT_TRUE(a.ready()) << "limits are read back before only";
}

TEST(MoteusAxis, TorqueIsThatOfTheShaftOrNone) {
  MoteusAxis a({.node = node, .direction = -1.0F, .gear_ratio = 3.0F},
               {.torque_max = 2.0F, .watchdog = 0.01F, .retry_ticks = retry});
  hear(a, stopped);
  hear(a, stopped);
  a.enable(send);
  hear(a, armed);
  hear(a, armed);
  EXPECT_TRUE(begins(frame(a, 4.5), run + "0000c0bf"));
  EXPECT_TRUE(begins(frame(a, std::nan("")), run + "00000000"));
  EXPECT_TRUE(begins(frame(a, 1e9), run + "00000000"));
  EXPECT_TRUE(a.can_carry(2e4) && !a.can_carry(4e4));
}

TEST(MoteusAxis, LimitsAreRoundedUp) {
  const auto sent = [](float torque, float watchdog) {
    MoteusAxis a({.node = node}, {.torque_max = torque, .watchdog = watchdog, .retry_ticks = retry});
    hear(a, stopped);
    hear(a, stopped);
    a.enable(send);
    return frame(a).substr(24, 16);
  };
  EXPECT_EQ(sent(2.0F, 0.01F), "0525c80005270a00");
  EXPECT_EQ(sent(2.001F, 0.0101F), "0525c90005270b00");
  EXPECT_EQ(sent(0.07F, 0.003F), "0525070005270300");
  EXPECT_EQ(sent(0.0F, 1e-5F), "0525010005270100");
  EXPECT_EQ(sent(1e9F, std::nanf("")), "0525ff7f0527ff7f");
}

TEST(MoteusAxis, RefusesToArmByWhatWasReadBack) {
  const struct {
    std::string stopped, armed;
    std::uint32_t name;
  } cases[] = {{"21820204210c02", "", 0x102},        {"", "", 0x102},
               {"21820205210c00", "", 0x00C},        {"21820205", "", 0x00C},
               {version, "2525c70025270a00", 0x025}, {version, "2525c80025270b00", 0x027},
               {version, "2525008025270a00", 0}};
  for (const auto& c : cases) {
    MoteusAxis a = axis();
    hear(a, {.more = c.stopped});
    hear(a, {.more = c.stopped});
    EXPECT_FALSE(a.config_mismatch()) << "not before it is wanted";
    a.enable(send);
    if (!c.armed.empty()) hear(a, {.mode = 10, .more = c.armed});
    if (!c.armed.empty()) hear(a, {.mode = 10, .more = c.armed});
    EXPECT_FALSE(a.ready());
    EXPECT_EQ(a.config_mismatch(), c.name != 0) << c.stopped << ' ' << c.armed;
    if (c.name == 0) continue;  // NaN is no answer
    EXPECT_EQ(a.refused_register(), c.name);
    a.enable(send);
    EXPECT_FALSE(begins(frame(a), run));
    a.disable(send);
    EXPECT_FALSE(a.config_mismatch());
    EXPECT_EQ(a.refused_register(), c.name) << "for the report";
    EXPECT_TRUE(begins(frame(a), stop));
  }
}

static_assert(!esmc::drive::may_have_restarted(18, 150) && esmc::drive::may_have_restarted(19, 150));
static_assert(!esmc::drive::may_have_restarted(2, 3) && esmc::drive::may_have_restarted(3, 3));

TEST(MoteusAxis, WhatWasReadBackBeforeASilenceDoesNotCount) {
  for (const bool silent_when_asked : {true, false}) {
    MoteusAxis a = axis();
    hear(a, stopped);
    hear(a, stopped);
    if (!silent_when_asked) a.enable(send);
    if (!silent_when_asked) hear(a, armed);
    if (!silent_when_asked) hear(a, armed);
    EXPECT_EQ(a.ready(), !silent_when_asked);
    for (int i = 0; i < 2; ++i) a.begin_tick();
    if (!silent_when_asked) a.enable(send);
    EXPECT_EQ(a.ready(), !silent_when_asked) << "two replies may be lost";
    a.begin_tick();
    a.enable(send);
    EXPECT_TRUE(begins(frame(a), stop));
    hear(a, {.more = "21820205210c00"});  // restarted elsewhere
    a.enable(send);
    EXPECT_FALSE(a.config_mismatch());
    hear(a, {.more = "21820205210c00"});
    a.enable(send);
    EXPECT_TRUE(a.config_mismatch());
    EXPECT_FALSE(a.idle()) << "until disable()";
    a.disable(send);
    EXPECT_TRUE(a.idle());
    hear(a, stopped);
    EXPECT_EQ(a.refused_register(), 0x00CU) << "for the report";
    a.enable(send);
    EXPECT_TRUE(begins(frame(a), zero)) << "it has been set up";
    EXPECT_EQ(a.refused_register(), esmc::drive::moteus::no_register);
  }
}

TEST(MoteusAxis, ARelativePositionIsEnoughWhereTheZeroIsConfirmed) {
  MoteusAxis a = axis(false);
  hear(a, {.more = "21820205210c00"});
  hear(a, {.more = "21820205210c00"});
  a.enable(send);
  EXPECT_FALSE(a.config_mismatch());
  EXPECT_TRUE(begins(frame(a), zero));
}

TEST(MoteusAxis, ARegisterThatTheDriveRefusesIsAMismatch) {
  MoteusAxis a = axis();
  hear(a, {.more = version + "302701"});
  hear(a, {.more = version + "302701"});
  EXPECT_FALSE(a.config_mismatch()) << "not before it is wanted";
  a.enable(send);
  hear(a, {.mode = 10, .more = "302701"});
  EXPECT_TRUE(a.config_mismatch());
  EXPECT_EQ(a.refused_register(), 0x27U);
  MoteusAxis b = ready_axis();
  hear(b, {.mode = 10, .more = "302501"});
  EXPECT_EQ(b.refused_register(), 0x25U);
}

TEST(MoteusAxis, FaultsAndTimeOutsAreErrorsByTheirCode) {
  for (const auto& [reply, code] : {std::pair{Reply{.mode = 1, .fault = 39}, 39U},
                                    {Reply{.mode = 1}, 1U},
                                    {Reply{.mode = 11}, 11U},
                                    {Reply{.mode = 11, .fault = 99}, 11U}}) {
    MoteusAxis a = ready_axis();
    EXPECT_EQ(a.last_error(), 0U);
    hear(a, reply);
    EXPECT_TRUE(a.error() && !a.ready() && !a.closed_loop());
    EXPECT_EQ(a.error_code(), code);
    EXPECT_TRUE(begins(frame(a), zero)) << "no torque any more";
    a.disable(send);
    EXPECT_TRUE(begins(frame(a), stop)) << "which clears it";
    hear(a, stopped);
    EXPECT_FALSE(a.error());
    EXPECT_EQ(a.last_error(), code);
    EXPECT_TRUE(a.must_be_released());
    hear(a, stopped);
    EXPECT_TRUE(a.idle() && !a.must_be_released());
  }
  MoteusAxis a = ready_axis();
  hear(a, {.mode = 10, .fault = 102});
  EXPECT_TRUE(a.ready() && !a.error()) << "a limit acts: no fault";
  hear(a, {.mode = 12});
  EXPECT_TRUE(!a.ready() && !a.closed_loop() && !a.error()) << "a mode of somebody else";
}

TEST(MoteusAxis, StartsOverWithoutProgress) {
  MoteusAxis a = wanted_axis();
  for (std::uint32_t n = 1; n < retry; ++n) {
    a.enable(send);
    EXPECT_TRUE(begins(frame(a), zero)) << n;
  }
  a.enable(send);
  EXPECT_TRUE(begins(frame(a), stop));
  hear(a, {.mode = 11});
  a.enable(send);
  EXPECT_TRUE(begins(frame(a), stop)) << "until it has stopped";
  MoteusAxis b({.node = node}, {.retry_ticks = 0});
  hear(b, stopped);
  hear(b, stopped);
  b.enable(send);
  b.enable(send);
  EXPECT_TRUE(begins(frame(b), stop));
}

TEST(MoteusAxis, ASilentDriveIsAskedNowAndThen) {
  MoteusAxis a = axis();
  asked = 0;
  silent = true;
  for (std::uint32_t n = 0; n < 3 * retry; ++n) a.enable(send);
  EXPECT_EQ(asked, 3);
  a.enable(send);
  a.ask_again();
  a.enable(send);
  EXPECT_EQ(asked, 5) << "at once";
  takes = false;
  a.ask_again();
  for (int n = 0; n < 3; ++n) a.enable(send);
  EXPECT_EQ(asked, 8) << "again where the bus did not take it";
  takes = true;
  silent = false;
  hear(a, stopped);
  a.enable(send);
  EXPECT_EQ(asked, 8);
}

TEST(MoteusAxis, HasNoEmergencyStopAndNoSetUp) {
  MoteusAxis a = ready_axis();
  a.acknowledge();
  a.ask_again();
  EXPECT_FALSE(a.emergency_stopped() || a.tx_suspended() || a.setting_up());
  EXPECT_TRUE(a.ready());
  EXPECT_FALSE(MoteusAxis{}.ready());
  EXPECT_TRUE(begins(frame(axis()), stop));
}

// Whatever a drive replies, in whatever order of calls: a torque is sent only while it is ready, and it is
// not after a reply that shows an error or another mode, nor after one that is missing for the limits.
TEST(MoteusAxis, RandomRepliesNeverLeaveTorqueAfterAFault) {
  std::mt19937 engine(1);
  const auto random = [&] { return static_cast<unsigned>(engine()); };
  MoteusAxis a = axis();
  int torques = 0, faults = 0;
  bool healthy = false;  // the last accepted reply was in torque control
  CanFrame sent;
  a.put_torque(sent, 1.5);
  const CanFrame calm = Reply{.mode = 0, .more = version}.frame(node);
  const CanFrame good = Reply{.mode = 10, .more = limits}.frame(node);
  for (int n = 0; n < 1'000'000; ++n) {
    const auto draw = random() % 100;
    if (draw < 50) {
      a.begin_tick();
      CanFrame f = sent.data[2] == 0 ? calm : good;
      if (random() % 8 == 0) f.data[2] = static_cast<std::uint8_t>(random() % 16);
      if (random() % 16 == 0) f.data[20] = 0x30;  // an error in place of more values
      if (random() % 8 == 0) f.data[random() % f.size] ^= static_cast<std::uint8_t>(1U << random() % 8);
      if (random() % 16 == 0) f.size = static_cast<std::uint8_t>(random() % 65);
      if (a.receive(f) == Received::accepted) healthy = a.closed_loop() && !a.error();
      if (a.error()) ++faults;
    } else if (draw < 95) {
      silent = !a.alive();
      a.enable(send);
      silent = false;
    } else if (draw < 97) {
      a.disable(send);
    }
    a.put_torque(sent, 1.5);
    ASSERT_TRUE(sent.data[2] == 0 || (sent.data[2] == 10 && (sent.data[3] == 2 || sent.data[3] == 3)));
    if (sent.data[3] != 2) continue;  // a stop, or no torque as three bytes
    ++torques;
    ASSERT_TRUE(a.ready() && healthy) << n;
  }
  EXPECT_GT(torques, 50'000);
  EXPECT_GT(faults, 5'000);
}

}  // namespace
