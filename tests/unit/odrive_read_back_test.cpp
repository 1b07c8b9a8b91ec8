/// What an ODrive of firmware 0.6 is asked before it is armed. Frames are packed by hand.

#include "firmware/drive/odrive_read_back.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include "tests/support/odrive_bench.hpp"

namespace esmc::test {
namespace {

using drive::OdriveReadBack;
using drive::OdriveTable;
using drive::odrive::ValueType;

constexpr unsigned version = 0x00, read = 0x04, value = 0x05;

/// u8 0 (read), u16 endpoint, u8 0, value.
CanFrame answer(std::uint16_t endpoint, std::uint32_t raw, std::uint8_t size = 8) {
  return message(node, value, endpoint * 0x100U, raw, size);
}
CanFrame answer(std::uint16_t endpoint, float v) { return answer(endpoint, std::bit_cast<std::uint32_t>(v)); }
CanFrame firmware(std::uint8_t major, std::uint8_t minor, std::uint8_t revision) {
  return message(node, version, 2, major + 0x100U * minor + 0x10000U * revision);
}

OdriveTable table() {
  OdriveTable t;
  t.check_version = true;
  t.firmware = {0, 6, 10};
  t.checks[0] = {0x1234, ValueType::u8, 1.0F, 1.0F};
  t.checks[1] = {77, ValueType::f32, 0.5F, 2.0F};
  t.checks[2] = {78, ValueType::u32, 1000.0F, 1000.0F};
  t.count = 3;
  return t;
}

std::vector<CanFrame> ask(OdriveReadBack& r, bool taken = true) {
  std::vector<CanFrame> sent;
  r.ask(node, [&](const CanFrame& f) {
    sent.push_back(f);
    return taken;
  });
  return sent;
}

TEST(OdriveReadBack, AsksForTheVersionAndThenForOneEndpointAfterTheOther) {
  OdriveReadBack r(table());
  EXPECT_FALSE(r.done());
  auto sent = ask(r);
  ASSERT_EQ(sent.size(), 1U);
  EXPECT_TRUE(sent[0].remote);
  EXPECT_EQ(sent[0].id, 0x060U);
  EXPECT_TRUE(ask(r).empty()) << "one at a time";
  EXPECT_EQ(r.take_version(firmware(0, 6, 10)), Received::accepted);
  sent = ask(r);
  ASSERT_EQ(sent.size(), 1U);
  EXPECT_EQ(sent[0], message(node, read, 0x123400, 0));
  EXPECT_EQ(r.take_value(answer(0x1234, 1U, 5)), Received::accepted);
  EXPECT_EQ(ask(r)[0], message(node, read, 77 * 256, 0));
  EXPECT_EQ(r.take_value(answer(77, 1.5F)), Received::accepted);
  EXPECT_EQ(ask(r)[0], message(node, read, 78 * 256, 0));
  EXPECT_FALSE(r.done());
  EXPECT_EQ(r.take_value(answer(78, 1000U)), Received::accepted);
  EXPECT_TRUE(r.done());
  EXPECT_FALSE(r.config_mismatch());
  EXPECT_FALSE(r.refused());
  EXPECT_TRUE(ask(r).empty());
}

TEST(OdriveReadBack, NothingToAskIsDone) {
  OdriveReadBack r;
  EXPECT_TRUE(r.done());
  EXPECT_TRUE(ask(r).empty());
  OdriveTable t = table();
  t.check_version = false;
  OdriveReadBack without(t);
  EXPECT_EQ(ask(without)[0], message(node, read, 0x123400, 0));
}

/// The whole table is asked, up to its end and in its order.
TEST(OdriveReadBack, ATableHoldsTwelveEndpoints) {
  OdriveTable t;
  ASSERT_EQ(t.checks.size(), 12U);
  for (std::uint16_t i = 0; i < 12; ++i) t.checks[i] = {i, ValueType::u8, 0.0F, 0.0F};
  t.count = 12;
  OdriveReadBack r(t);
  for (std::uint16_t i = 0; i < 12; ++i) {
    EXPECT_FALSE(r.done());
    ASSERT_EQ(ask(r).size(), 1U);
    EXPECT_EQ(r.take_value(answer(i, 0U)), Received::accepted);
  }
  EXPECT_TRUE(r.done());
}

TEST(OdriveReadBack, AnotherVersionIsAContradiction) {
  for (int i = 0; i < 3; ++i) {
    OdriveReadBack r(table());
    (void)ask(r);
    EXPECT_EQ(r.take_version(firmware(i == 0, i == 1 ? 5 : 6, i == 2 ? 11 : 10)), Received::accepted);
    EXPECT_TRUE(r.config_mismatch());
    EXPECT_FALSE(r.done());
    EXPECT_EQ(r.refused(), OdriveReadBack::version_endpoint);
    EXPECT_TRUE(ask(r).empty()) << "and that is the end";
    r.restart();
    EXPECT_FALSE(r.config_mismatch());
    EXPECT_TRUE(r.refused()) << "for a message";
    EXPECT_EQ(ask(r).size(), 1U);
    EXPECT_FALSE(r.refused());
  }
}

TEST(OdriveReadBack, BoundsAreAllowedAndWhatIsOutsideOrNoNumberIsAContradiction) {
  constexpr float inf = std::numeric_limits<float>::infinity();
  for (const float v : {0.5F, 1.0F, 2.0F, 0.4999F, 2.0001F, -1.0F, inf, -inf, std::nanf("")}) {
    OdriveReadBack r(table());
    (void)ask(r);
    (void)r.take_version(firmware(0, 6, 10));
    (void)ask(r);
    (void)r.take_value(answer(0x1234, 1U));
    (void)ask(r);
    EXPECT_EQ(r.take_value(answer(77, v)), Received::accepted);
    EXPECT_EQ(r.config_mismatch(), !(v >= 0.5F && v <= 2.0F)) << v;
  }
}

TEST(OdriveReadBack, SilenceIsAContradictionAfterFourQuestions) {
  OdriveReadBack r(table());
  int asked = 0, ticks = 0;
  while (!r.config_mismatch() && ticks < 1000) {
    asked += static_cast<int>(ask(r).size());
    ++ticks;
  }
  EXPECT_EQ(asked, 4);
  EXPECT_EQ(ticks, 101) << "25 ticks each";
  EXPECT_EQ(r.refused(), OdriveReadBack::version_endpoint);
}

TEST(OdriveReadBack, EveryQuestionIsAskedFourTimes) {
  OdriveReadBack r(table());
  for (int i = 0; i < 60; ++i) (void)ask(r);
  EXPECT_EQ(r.take_version(firmware(0, 6, 10)), Received::accepted) << "at the third time of asking";
  EXPECT_EQ(r.take_value(answer(0x1234, 1U)), Received::not_mine) << "not asked yet";
  EXPECT_EQ(ask(r).size(), 1U) << "at once";
  int asked = 1;
  while (!r.config_mismatch()) asked += static_cast<int>(ask(r).size());
  EXPECT_EQ(asked, 4);
  EXPECT_EQ(r.refused(), 0x1234);
}

TEST(OdriveReadBack, RestartingWithdrawsTheQuestionAndBeginsWithTheFirst) {
  OdriveReadBack r(table());
  (void)ask(r);
  (void)r.take_version(firmware(0, 6, 10));
  (void)ask(r);
  r.restart();
  EXPECT_EQ(r.take_value(answer(0x1234, 0U)), Received::not_mine);
  EXPECT_EQ(r.take_version(firmware(0, 6, 9)), Received::not_mine);
  const auto sent = ask(r);
  ASSERT_EQ(sent.size(), 1U) << "at once";
  EXPECT_TRUE(sent[0].remote) << "the version";
  EXPECT_EQ(r.take_version(firmware(0, 6, 10)), Received::accepted);
  EXPECT_FALSE(r.config_mismatch());
}

TEST(OdriveReadBack, WhatTheBusDidNotTakeIsNoQuestion) {
  OdriveReadBack r(table());
  for (int i = 0; i < 50; ++i) EXPECT_EQ(ask(r, false).size(), 1U);
  EXPECT_EQ(r.take_version(firmware(0, 6, 9)), Received::not_mine) << "sent cyclically, unasked";
  EXPECT_FALSE(r.config_mismatch());
  EXPECT_EQ(ask(r).size(), 1U);
}

TEST(OdriveReadBack, AnswersToOtherQuestionsAndUnaskedOnesAreNotOurs) {
  OdriveReadBack r(table());
  EXPECT_EQ(r.take_value(answer(0x1234, 0U)), Received::not_mine);
  (void)ask(r);
  EXPECT_EQ(r.take_value(answer(0x1234, 0U)), Received::not_mine);
  CanFrame request = firmware(0, 6, 10);
  request.remote = true;
  EXPECT_EQ(r.take_version(request), Received::not_mine);
  (void)r.take_version(firmware(0, 6, 10));
  (void)ask(r);
  EXPECT_EQ(r.take_version(firmware(0, 5, 6)), Received::not_mine);
  EXPECT_EQ(r.take_value(answer(0x1235, 0U)), Received::not_mine);
  EXPECT_EQ(r.take_value(answer(0x1234, 0U, 3)), Received::not_mine) << "it names no endpoint";
  request = answer(0x1234, 0U);
  request.remote = true;
  EXPECT_EQ(r.take_value(request), Received::not_mine);
  EXPECT_FALSE(r.config_mismatch());
}

TEST(OdriveReadBack, AnswersOfAWrongLengthOrFormatAreMalformed) {
  for (std::uint8_t size = 0; size <= 7; ++size) {
    OdriveReadBack r(table());
    (void)ask(r);
    CanFrame f = firmware(0, 6, 10);
    f.size = size;
    EXPECT_EQ(r.take_version(f), Received::malformed);
    f.size = 8;
    f.fd = true;
    EXPECT_EQ(r.take_version(f), Received::malformed);
    (void)r.take_version(firmware(0, 6, 10));
    (void)ask(r);
    if (size >= 4) {
      EXPECT_EQ(r.take_value(answer(0x1234, 1U, size)), size >= 5 ? Received::accepted : Received::malformed)
          << int{size};
    }
    (void)r.take_value(answer(0x1234, 1U));
    (void)ask(r);
    if (size >= 4) {
      EXPECT_EQ(r.take_value(answer(77, 0x3FC00000U, size)), Received::malformed) << int{size};
    }
    f = answer(77, 1.5F);
    f.fd = true;
    EXPECT_EQ(r.take_value(f), Received::malformed);
    EXPECT_FALSE(r.config_mismatch());
  }
}

// ---- in the axis

std::vector<unsigned> commands(const std::vector<CanFrame>& sent) {
  std::vector<unsigned> out;
  for (const CanFrame& f : sent) out.push_back(command_of(f));
  return out;
}
using Commands = std::vector<unsigned>;

OdriveTable one_check() {
  OdriveTable t;
  t.checks[0] = {77, ValueType::f32, 0.5F, 2.0F};
  t.count = 1;
  return t;
}

TEST(OdriveReadBack, ClosedLoopIsAskedForWhenAllOfItWasAnswered) {
  OdriveAxis a({.node = node}, Version::v0_6, 150, one_check());
  hear(a);
  EXPECT_EQ(commands(enable(a)), Commands{cmd_mode});
  for (int i = 0; i < 5; ++i) {
    hear(a);
    EXPECT_EQ(commands(enable(a)), i == 0 ? Commands{read} : Commands{});
  }
  hear(a);
  EXPECT_EQ(a.receive(answer(77, 1.0F)), Received::accepted);
  EXPECT_EQ(commands(enable(a)), Commands{cmd_axis_state});
}

TEST(OdriveReadBack, TheVersionReachesTheTable) {
  OdriveTable t;
  t.check_version = true;
  t.firmware = {0, 6, 10};
  OdriveAxis a({.node = node}, Version::v0_6, 150, t);
  hear(a);
  (void)enable(a);
  hear(a);
  EXPECT_EQ(commands(enable(a)), Commands{version});
  EXPECT_EQ(a.receive(firmware(0, 6, 10)), Received::accepted);
  hear(a);
  EXPECT_EQ(commands(enable(a)), Commands{cmd_axis_state});
}

TEST(OdriveReadBack, AnAxisIsSetUpUntilItHasAnswered) {
  OdriveAxis a({.node = node}, Version::v0_6, 150, one_check());
  hear(a);
  EXPECT_FALSE(a.setting_up());
  (void)enable(a);
  EXPECT_TRUE(a.setting_up()) << "the mode is sent, and an endpoint will be asked for";
  hear(a);
  (void)enable(a);
  EXPECT_EQ(a.receive(answer(77, 1.0F)), Received::accepted);
  EXPECT_FALSE(a.setting_up()) << "now it waits for a heartbeat";
}
TEST(OdriveReadBack, AContradictedAxisIsNotArmedAndForgetsItWhenItIsDisabled) {
  OdriveAxis a({.node = node}, Version::v0_6, 150, one_check());
  hear(a);
  (void)enable(a);
  hear(a);
  (void)enable(a);
  EXPECT_EQ(a.receive(answer(77, 3.0F)), Received::accepted);
  EXPECT_TRUE(a.config_mismatch());
  EXPECT_EQ(a.refused_endpoint(), 77);
  EXPECT_EQ(a.node(), node);
  EXPECT_FALSE(a.idle()) << "so that it is disabled once";
  for (int i = 0; i < 200; ++i) {
    hear(a);
    EXPECT_TRUE(enable(a).empty());
  }
  a.disable([](const CanFrame&) {});
  EXPECT_FALSE(a.config_mismatch());
  hear(a);
  EXPECT_TRUE(a.idle());
  EXPECT_EQ(commands(enable(a)), Commands{cmd_mode});
}

/// A drive that may have restarted has what it had stored, whatever it answered before: it was silent, or
/// fell idle by itself.
TEST(OdriveReadBack, AnAxisThatMayHaveRestartedIsAskedAgain) {
  for (const int silent : {-1, 0, 4, 40}) {  // -1: fell idle before the second heartbeat
    OdriveAxis a({.node = node}, Version::v0_6, 20, one_check());
    a.restarts_within(3);
    for (const Commands& next : {Commands{cmd_mode}, Commands{read}}) {
      hear(a);
      EXPECT_EQ(commands(enable(a)), next);
    }
    EXPECT_EQ(a.receive(answer(77, 1.0F)), Received::accepted);
    hear(a);
    EXPECT_EQ(commands(enable(a)), Commands{cmd_axis_state});
    hear(a, 8);
    if (silent >= 0) hear(a, 8);
    for (int i = 0; i < silent; ++i) {
      EXPECT_EQ(a.ready(), i < 4) << "of what was silent for so long nothing is known: " << i;
      a.begin_tick();
    }
    EXPECT_EQ(a.ready(), silent == 0) << silent;
    int asked = 0;
    for (int i = 0; i < 60; ++i) {
      hear(a);
      for (const unsigned c : commands(enable(a))) {
        EXPECT_NE(c, cmd_axis_state) << "not before it has answered";
        asked += c == read ? 1 : 0;
      }
      EXPECT_FALSE(a.ready());
    }
    EXPECT_GE(asked, 2) << silent;
    EXPECT_EQ(a.receive(answer(77, 3.0F)), Received::accepted);
    EXPECT_TRUE(a.config_mismatch()) << "as it is now";
    for (int i = 0; i < 40; ++i) a.begin_tick();
    EXPECT_TRUE(a.config_mismatch()) << "silence takes nothing back";
  }
}

/// What ends the starving and is not the watchdog may have been a restart as well.
TEST(OdriveReadBack, AnAxisThatFellIdleWhileItWasStarvedIsAskedAgain) {
  for (const std::uint32_t error : {0U, 0x40U, 0x01000000U}) {
    OdriveAxis a({.node = node}, Version::v0_6, 20, one_check());
    a.prove_watchdog(30);
    hear(a);
    (void)enable(a);
    hear(a);
    (void)enable(a);
    EXPECT_EQ(a.receive(answer(77, 1.0F)), Received::accepted);
    hear(a);
    EXPECT_EQ(commands(enable(a)), Commands{cmd_axis_state});
    hear(a, 8);
    hear(a, 8);
    ASSERT_TRUE(a.tx_suspended());
    hear(a, 1, error);
    EXPECT_TRUE(enable(a).empty());
    bool asked = false;
    for (int i = 0; i < 5; ++i) {
      hear(a);
      for (const unsigned c : commands(enable(a))) asked = asked || c == read;
    }
    EXPECT_EQ(asked, error != 0x01000000U) << "the watchdog is no restart";
  }
}

/// Shorter than that is a heartbeat that was lost; and nobody waits longer than for an answer.
TEST(OdriveReadBack, AHeartbeatThatIsMissingIsNoRestart) {
  for (const std::uint32_t told : {5U, 20U, 1000U}) {
    OdriveAxis a({.node = node}, Version::v0_6, 20);
    a.restarts_within(told);
    hear(a);
    (void)enable(a);
    hear(a);
    EXPECT_EQ(commands(enable(a)), Commands{cmd_axis_state});
    hear(a, 8);
    hear(a, 8);
    for (std::uint32_t i = 0; i < std::min(told, 20U); ++i) a.begin_tick();
    EXPECT_TRUE(a.ready()) << told;
    a.begin_tick();
    EXPECT_FALSE(a.ready()) << told;
  }
}

/// The default is the retry time, also of one tick, and of an unconfigured axis.
TEST(OdriveReadBack, NotReadyAfterRetryTimeWithoutHeartbeat) {
  for (const int ticks : {1, 7, 150}) {
    OdriveAxis a = ticks == 150 ? OdriveAxis()
                                : OdriveAxis({.node = 0}, Version::v0_6, static_cast<std::uint32_t>(ticks));
    for (const int state : {1, 1, 8, 8}) {
      a.begin_tick();
      ASSERT_EQ(a.receive(heartbeat(0, static_cast<std::uint8_t>(state), 0)), Received::accepted);
      (void)enable(a);
    }
    for (int i = 0; i < ticks; ++i) {
      EXPECT_TRUE(a.ready()) << ticks << ' ' << i;
      a.begin_tick();
    }
    EXPECT_TRUE(a.ready());
    a.begin_tick();
    EXPECT_FALSE(a.ready());
  }
}

TEST(OdriveReadBack, AConfigurationWriteIsAForeignCommand) {
  OdriveAxis a({.node = node}, Version::v0_6, 150), old({.node = node}, Version::v0_5_6, 150, one_check());
  CanFrame write = message(node, read, 77 * 256 + 1, 0);
  EXPECT_EQ(a.receive(write), Received::foreign_command);
  EXPECT_EQ(old.receive(write), Received::not_mine) << "0.5.6 sends encoder errors with this number";
  EXPECT_EQ(a.receive(message(node, read, 77 * 256, 0)), Received::not_mine) << "another node reads";
  write.size = 1;
  EXPECT_EQ(a.receive(write), Received::foreign_command) << "however short";
  write.size = 0;
  EXPECT_EQ(a.receive(write), Received::not_mine);
  write.size = 8;
  write.remote = true;
  EXPECT_EQ(a.receive(write), Received::not_mine);
  EXPECT_EQ(a.receive(firmware(0, 6, 10)), Received::not_mine);
  hear(old);
  (void)enable(old);
  hear(old);
  EXPECT_EQ(commands(enable(old)), Commands{cmd_axis_state}) << "0.5.6 cannot be asked";
}

}  // namespace
}  // namespace esmc::test
