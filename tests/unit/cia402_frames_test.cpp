/// One CiA 402 axis as the controller sees it: whose frames it takes, units, and what all axes of a bus
/// share.

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <limits>
#include <set>
#include <vector>

#include "tests/support/cia402_bench.hpp"

namespace esmc::test {
namespace {

// ---- frames of others

TEST(Cia402Axis, WhatOnlyWeMaySendMakesAnImpostor) {
  const std::vector<CanFrame> commands{
      nmt(0x81, 0),          nmt(0x80, node),       can(0x000, {0x01, node, 0}), can(0x080, {}),
      can(0x080, {7}),       can(0x764, {5}),       can(0x203, {0x0F, 0, 0, 0}), can(0x203, {}),
      can(0x303, {0x0F, 0}), can(0x403, {0x0F, 0}), can(0x503, {0x0F, 0}),       sdo(0x603, 0x40, 0x6041, 0)};
  for (CanFrame f : commands) {
    Bench b;
    ASSERT_TRUE(b.make_ready());
    b.axis.begin_tick();
    EXPECT_EQ(b.hear(f), Received::foreign_command) << std::hex << f.id;
    EXPECT_FALSE(b.axis.heard_this_tick());
    f.fd = true;
    EXPECT_EQ(b.hear(f), Received::foreign_command);
    f.fd = false;
    f.remote = true;
    EXPECT_EQ(b.hear(f), Received::not_mine);
    f.remote = false;
    f.extended = true;
    EXPECT_EQ(b.hear(f), Received::not_mine);
  }
}

TEST(Cia402Axis, WhatConcernsOthersIsNotMine) {
  Bench b;
  ASSERT_TRUE(b.make_ready());
  b.axis.begin_tick();
  for (const CanFrame& f :
       {nmt(0x81, 4), can(0x000, {0x81}), can(0x000, {}), heartbeat_of(4, 0), emergency_of(4, 0x1000),
        report_of(4, 0), motion_of(4), can(0x204, {0, 0, 0, 0}), sdo(0x604, 0x40, 0x6041, 0),
        sdo(0x584, 0x60, 0x6041, 0), can(0x100, {1, 2, 3}), can(0x383, {1}), can(0x483, {1}), can(0x683, {1}),
        can(0x783, {1}), can(0x883, {1, 2, 3, 4, 5, 6, 7, 8}), can(0x7E4, {1})}) {
    EXPECT_EQ(b.hear(f), Received::not_mine) << std::hex << f.id;
  }
  CanFrame wide = report_of(node, 0x0250);
  wide.extended = true;
  EXPECT_EQ(b.hear(wide), Received::not_mine);
  EXPECT_TRUE(b.axis.ready());
  EXPECT_EQ(b.axis.sample_age_ticks(), 1U);
}

TEST(Cia402Axis, AWrongLengthOrFormatIsMalformedAndChangesNothing) {
  for (const CanFrame& right : {heartbeat_of(node, 0x7F), emergency_of(node, 0x1000), report_of(node, 0x0250),
                                motion_of(node, 5, 0), sdo(0x580 + node, 0x60, 0x6040, 0)}) {
    Bench b;
    ASSERT_TRUE(b.make_ready());
    const auto before = b.axis.sample<double>();
    b.axis.begin_tick();
    for (std::uint8_t size = 0; size <= 8; ++size) {
      CanFrame f = right;
      f.size = size;
      if (size == right.size) continue;
      EXPECT_EQ(b.hear(f), Received::malformed) << std::hex << f.id << " " << int{size};
    }
    CanFrame f = right;
    f.remote = true;
    EXPECT_EQ(b.hear(f), Received::malformed);
    f.remote = false;
    f.fd = true;
    EXPECT_EQ(b.hear(f), Received::malformed);
    EXPECT_TRUE(b.axis.ready() && b.axis.closed_loop() && !b.axis.error() && !b.axis.heard_this_tick());
    EXPECT_EQ(b.axis.sample<double>().angle, before.angle);
    EXPECT_EQ(b.axis.sample_age_ticks(), 1U);
    EXPECT_NE(b.hear(heartbeat_of(node, 0x85)), Received::accepted) << "node guarding";
  }
}

/// Whatever comes in whatever order: no torque before ready, no controlword but those that there are.
TEST(Cia402Axis, RandomFramesNeverEnableAnything) {
  std::uint64_t seed = 1;
  const auto random = [&](unsigned n) {
    seed = seed * 6364136223846793005U + 1442695040888963407U;
    return static_cast<unsigned>(seed >> 33U) % n;
  };
  const std::set<unsigned> controls{0x00, 0x06, 0x07, 0x0F, 0x80};
  Bench b;
  for (int i = 0; i < 200'000; ++i) {
    if (random(4) == 0) {
      b.axis.begin_tick();
      if (random(8) > 0) {
        b.axis.enable([&](const CanFrame& f) { return hal::well_formed(f) && random(4) > 0; });
      } else if (random(4) == 0) {
        b.axis.disable([](const CanFrame&) { return true; });
      }
    }
    CanFrame f;
    f.id = random(16) * 0x80U + (random(8) == 0 ? random(128) : node);
    f.size = static_cast<std::uint8_t>(random(9));
    for (std::size_t k = 0; k < 8; ++k)
      f.data[k] = static_cast<std::uint8_t>(random(3) == 0 ? random(256) : 0);
    f.remote = random(50) == 0;
    f.fd = !f.remote && random(50) == 0;
    f.extended = random(50) == 0;
    (void)b.axis.receive(f);
    const CanFrame t = test::torque_frame(b.axis, 1.0F);
    ASSERT_TRUE(hal::well_formed(t) && t.size == 4 && t.id == 0x203);
    ASSERT_TRUE(controls.contains(little(t, 0, 2)));
    ASSERT_FALSE(b.axis.ready() && b.axis.idle());
  }
}

// ---- units

TEST(Cia402Axis, CountsAndSpeedsBecomeAnglesAndRates) {
  for (const float direction : {1.0F, -1.0F}) {
    Bench b;
    b.axis =
        Cia402Axis({.node = node, .direction = direction, .gear_ratio = 4.0F, .offset = 0.5F}, settings());
    ASSERT_TRUE(b.make_ready());
    b.axis.begin_tick();
    (void)b.hear(report_of(node, 0x0237, -1024 - 4096));
    (void)b.hear(motion_of(node, 250));
    const auto s = b.axis.sample<double>();
    const double pi = 3.14159265358979323846;
    const double sign = direction > 0 ? 1.0 : -1.0;
    EXPECT_NEAR(s.angle, -1.25 * 2 * pi * sign / 4 + 0.5, 1e-12);
    EXPECT_NEAR(s.rate, 2.5 * sign / 4, 1e-7);
    EXPECT_NEAR(static_cast<double>(b.axis.sample<float>().angle), s.angle, 1e-6);
  }
}

std::int16_t thousandths(const Cia402Axis& a, float torque) {
  return static_cast<std::int16_t>(little(test::torque_frame(a, torque), 2, 2));
}

TEST(Cia402Axis, TorqueIsInThousandthsOfWhatTheDriveSaysIsRated) {
  Bench b;
  EXPECT_EQ(thousandths(b.axis, 1.0F), 0) << "the scale is not known yet";
  b.slave.objects[entry(0x6076, 0)] = 2010;  // 0.5 % more than expected
  ASSERT_TRUE(b.make_ready());
  EXPECT_NEAR(b.axis.torque_lsb(), 2.010e-3F, 1e-8F);
  EXPECT_EQ(thousandths(b.axis, 2.010F), 1000);
  EXPECT_EQ(thousandths(b.axis, -2.010F), -1000);
  EXPECT_EQ(thousandths(b.axis, 0.0F), 0);
  const float lsb = 2.010e-3F;
  for (const int n : {0, 1, 7, 500}) {
    const auto steps = static_cast<float>(n);
    EXPECT_EQ(thousandths(b.axis, (steps + 0.49F) * lsb), n);
    EXPECT_EQ(thousandths(b.axis, (steps + 0.51F) * lsb), n + 1);
    EXPECT_EQ(thousandths(b.axis, -(steps + 0.49F) * lsb), -n);
    EXPECT_EQ(thousandths(b.axis, -(steps + 0.51F) * lsb), -n - 1);
  }
}

TEST(Cia402Axis, TheReportedTorqueIsThatOfTheJointAndOfThisTick) {
  Bench b;
  b.axis = Cia402Axis({.node = node, .direction = -1.0F, .gear_ratio = 3.0F}, settings());
  EXPECT_FALSE(b.axis.observed_torque());
  ASSERT_TRUE(b.make_ready());
  b.axis.begin_tick();
  EXPECT_FALSE(b.axis.observed_torque());
  (void)b.hear(report_of(node, 0x0237, 0, -250));
  ASSERT_TRUE(b.axis.observed_torque());
  EXPECT_NEAR(*b.axis.observed_torque(), 0.25F * 2.0F * 3.0F, 1e-6F);
}

TEST(Cia402Axis, WhatNoMotorHasIsNotCarried) {
  Bench b;
  b.axis = Cia402Axis({.node = node, .direction = -1.0F, .gear_ratio = 0.5F}, settings());
  ASSERT_TRUE(b.make_ready());
  EXPECT_EQ(thousandths(b.axis, 1.0F), -1000) << "2 N m at the shaft, against";
  for (const float torque : {NAN, std::numeric_limits<float>::infinity(),
                             -std::numeric_limits<float>::infinity(), 5001.0F, -5001.0F}) {
    EXPECT_FALSE(b.axis.can_carry(torque));
    EXPECT_EQ(thousandths(b.axis, torque), 0);
  }
  EXPECT_TRUE(b.axis.can_carry(4999.0F));
  EXPECT_FALSE(b.axis.emergency_stopped());
  EXPECT_FALSE(b.axis.tx_suspended());
  b.axis.acknowledge();
}

TEST(Cia402Axis, TheTorqueFrameHalvesExactlyAwayFromZeroAndEndsWithItsLastStep) {
  Bench b;
  auto s = settings();
  s.rated_torque = 1024.0F;  // so that thousandths are exact in binary
  s.rated_torque_unit = 1.024F;
  s.torque_limit = 1.0F;
  b.axis = Cia402Axis(AxisConfig{.node = node}, s);
  b.slave.objects[entry(0x6076, 0)] = 1000;
  ASSERT_TRUE(b.make_ready());
  EXPECT_EQ(thousandths(b.axis, 0.512F), 1);
  EXPECT_EQ(thousandths(b.axis, -0.512F), -1);
  EXPECT_EQ(thousandths(b.axis, 0.511F), 0);
  Bench end;
  ASSERT_TRUE(end.make_ready());
  for (const auto& [steps, sent] : {std::pair{32'500.2F, 32'500},
                                    {32'700.2F, 32'700},
                                    {32'766.2F, 32'766},
                                    {32'767.8F, 32'767},
                                    {33'000.0F, 32'767},
                                    {70'000.0F, 32'767}}) {
    EXPECT_EQ(thousandths(end.axis, steps * 2e-3F), sent) << steps;
    EXPECT_EQ(thousandths(end.axis, -steps * 2e-3F), -sent) << steps;
  }
}

// ---- line

TEST(CanopenLine, SyncOnRequestAndAHeartbeatEveryFewGoodTicks) {
  drive::CanopenLine line(100, 3);
  std::vector<CanFrame> sent;
  bool takes = true;
  const auto send = [&](const CanFrame& f) {
    sent.push_back(f);
    return takes;
  };
  line.request(send);
  EXPECT_EQ(sent, std::vector<CanFrame>{can(0x080, {})});
  std::vector<int> at;
  const auto tick = [&](int i, bool good) {
    sent.clear();
    line.end_tick(send, good);
    if (!sent.empty()) {
      EXPECT_EQ(sent, std::vector<CanFrame>{can(0x764, {5})});
      at.push_back(i);
    }
  };
  for (int i = 0; i < 8; ++i) tick(i, true);
  EXPECT_EQ(at, (std::vector<int>{0, 3, 6}));
  at.clear();
  for (int i = 0; i < 8; ++i) tick(i, false);
  EXPECT_TRUE(at.empty()) << "a controller with a fault says nothing";
  takes = false;
  for (int i = 0; i < 3; ++i) tick(i, true);
  EXPECT_EQ(at, (std::vector<int>{0, 1, 2})) << "until the bus takes it";
}

}  // namespace
}  // namespace esmc::test
