/// What the cycle makes of samples: their age, the zero of their encoders, and the first tick of all.

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>

#include "tests/support/cycle_rig.hpp"
#include "tests/support/told_drive.hpp"

namespace esmc::test {
namespace {

using Five = FiveBar<double>;
using Bench = ToldBench;

Bench without_zero(Sensors sensors) {
  Bench b(sensors);
  b.config.zero_absolute = false;
  const auto s = setup<Five>();
  for (int j = 0; j < 4; ++j) b.config.zero_pose[j] = s.angle[static_cast<unsigned>(j)];
  return b;
}

TEST(CycleSamples, TheZeroIsTakenFromFreshAndFiniteAnglesOnly) {
  constexpr double nan = std::numeric_limits<double>::quiet_NaN();
  for (const Sensors sensors : {Sensors::base, Sensors::all}) {
    const unsigned n = sensors == Sensors::all ? 4 : 2;
    for (unsigned axis = 0; axis < n; ++axis) {
      for (const std::uint32_t age : {0U, 2U, 3U}) {  // max_age_ticks is 2
        Bench b = without_zero(sensors);
        b.tick();
        b.quiet[axis] = age > 0;
        for (std::uint32_t i = 1; i < age; ++i) b.tick();
        b.tick(Command::confirm_zero);
        b.quiet[axis] = false;
        EXPECT_EQ(b.start(), age <= 2) << axis << ' ' << age;
        if (age > 2) {
          EXPECT_EQ(b.fault(), Fault::zero_not_confirmed);
        }
      }
      for (const bool angle : {true, false}) {
        Bench b = without_zero(sensors);
        const double good = b.drive[axis].angle;
        (angle ? b.drive[axis].angle : b.drive[axis].rate) = nan;
        b.tick();
        b.tick(Command::confirm_zero);
        b.drive[axis].angle = good;
        b.drive[axis].rate = 0;
        EXPECT_EQ(b.start(), !angle) << axis << ": a rate has no zero";
        EXPECT_EQ(b.fault(), angle ? Fault::zero_not_confirmed : Fault::none);
      }
    }
  }
}

/// Also of drives that say where they are only once they are set up (CiA 402): enabling gets that far, not to
/// a torque.
TEST(CycleSamples, TheZeroIsConfirmedWhileDisabledOnly) {
  Bench b = without_zero(Sensors::base);
  for (Script& d : b.drive) d.ready = false;
  b.drive[0].samples = false;
  b.tick();
  b.tick(Command::enable);
  b.tick();
  ASSERT_EQ(b.state(), State::enabling);
  b.drive[0].samples = true;
  b.tick(Command::confirm_zero);
  EXPECT_EQ(b.fault(), Fault::zero_not_confirmed);
  b.tick(Command::reset);
  b.tick(Command::enable);
  EXPECT_EQ(b.fault(), Fault::zero_not_confirmed);
}

/// An encoder that was silent for as long as a drive may be has lost its zero, also one that never beats.
TEST(CycleSamples, SilenceLosesTheZero) {
  struct Case {
    std::uint32_t silent;
    bool beats, kept;
  };
  for (const auto& [silent, beats, kept] :
       {Case{silence_max, true, true}, Case{silence_max + 1, true, false}, Case{silence_max, false, true},
        Case{silence_max + 1, false, false}}) {
    for (unsigned axis = 0; axis < 4; ++axis) {
      Bench b = without_zero(Sensors::all);
      b.tick();
      b.tick(Command::confirm_zero);
      b.quiet[axis] = true;
      if (!beats) b.drive[axis].heartbeat_age = drive::age_max;
      for (std::uint32_t i = 0; i < silent; ++i) b.tick();
      b.quiet[axis] = false;
      EXPECT_EQ(b.start(), kept) << axis << ' ' << silent << beats;
    }
  }
  for (unsigned axis = 0; axis < 4; ++axis) {  // it beats on without samples: enough for a motor
    Bench b = without_zero(Sensors::all);
    b.tick();
    b.tick(Command::confirm_zero);
    b.drive[axis].samples = false;
    for (std::uint32_t i = 0; i <= silence_max; ++i) b.tick();
    b.drive[axis].samples = true;
    EXPECT_EQ(b.start(), axis % 2 == 0) << axis;
  }
}

/// Under torque as well: the drives are well, the samples not yet too old for the law.
TEST(CycleSamples, AnEncoderThatLosesItsZeroUnderTorqueIsAFault) {
  for (const unsigned axis : {1U, 3U}) {
    Bench b = without_zero(Sensors::all);
    b.config.controller.limits.max_age_ticks = 100;
    b.tick();
    b.tick(Command::confirm_zero);
    ASSERT_TRUE(b.start());
    b.quiet[axis] = true;
    for (std::uint32_t i = 0; i < silence_max; ++i) b.tick();
    EXPECT_EQ(b.state(), State::running);
    const auto r = b.tick();
    EXPECT_EQ(b.fault(), Fault::zero_not_confirmed);
    EXPECT_EQ(r.torque.norm(), 0.0);
  }
}

/// Waited for a time in a queue, and then for ticks without another sample: the age is the sum.
TEST(CycleSamples, ASampleIsAsOldAsItWaitedAndMore) {
  constexpr double us = static_cast<double>(1e-6F);
  struct Case {
    std::uint32_t waited_us, ticks, age;
    double tick_us;
  };
  for (const auto& [waited_us, ticks, age, tick_us] :
       {Case{2500, 0, 2, 1000}, Case{2500, 3, 5, 1000}, Case{1000, 0, 1, 1000}, Case{999, 0, 0, 1000},
        Case{0, 7, 7, 1000}, Case{999'999, 0, 999'999, 1}, Case{995'000, 0, 995'000, 1},
        Case{1'000'000, 0, drive::age_max, 1}, Case{1'005'000, 0, drive::age_max, 1}}) {
    Bench b;
    b.config.controller.sample_time = tick_us * us;
    b.bus.age_us = waited_us;
    b.tick();
    b.bus.age_us = 0;
    b.quiet = {true, true, true, true};
    for (std::uint32_t i = 0; i < ticks; ++i) b.tick();
    for (const unsigned joint : {0U, 2U}) EXPECT_EQ(b.cycle->sample().age_ticks[joint], age) << waited_us;
  }
}

/// A float's quotient may be rounded up to whole ticks: what is left over is then nothing, and not less.
TEST(CycleSamples, NoPhaseIsNegative) {
  Rig<Rr<float>, TimedBus> rig;
  rig.bus.age_us = 207'000;
  ASSERT_LT(207'000.0F * 1e-6F, 207.0F * 1e-3F);
  ASSERT_EQ(207'000.0F * 1e-6F / 1e-3F, 207.0F);
  rig.tick();
  EXPECT_EQ(rig.cycle.sample().age_ticks[0], 207U);
  EXPECT_EQ(rig.cycle.sample().phase[0], 0.0F);
}

/// Part of a tick in a queue leaves a sample fresh.
TEST(CycleSamples, AZeroIsTakenFromASampleThatWaitedForPartOfATick) {
  auto s = setup<Five>();
  s.zero_absolute = false;
  for (int j = 0; j < 4; ++j) s.zero_pose[j] = s.angle[static_cast<unsigned>(j)];
  Rig<Five, TimedBus> rig(s);
  rig.bus.age_us = 300;
  rig.tick();
  rig.tick(Command::confirm_zero);
  EXPECT_TRUE(rig.start());
}

// ---- the first tick

TEST(CycleSamples, TheFirstTickIsATickLikeAnyOther) {
  Bench b;
  b.config.waiting_ticks_max = 1;
  b.build();
  EXPECT_FALSE(b.cycle->complete() || b.cycle->set_begun());
  b.drive[0].ready = false;
  b.tick(Command::enable, false);
  EXPECT_EQ(b.fault(), Fault::none) << "no time has passed";
  EXPECT_EQ(b.drive[0].begun, 1);
  b.tick(Command::none, false);
  EXPECT_EQ(b.drive[0].begun, 2);

  Bench losing;
  losing.build();
  LosingBus bus;
  losing.cycle->receive(bus);
  losing.cycle->command(Command::enable);
  (void)losing.cycle->tick(bus);
  EXPECT_EQ(losing.fault(), Fault::none);
  bus.lost = 1;
  losing.cycle->receive(bus);
  (void)losing.cycle->tick(bus);
  EXPECT_EQ(losing.fault(), Fault::bus_overload);
}

TEST(CycleSamples, TheFirstStatusTellsWhetherTheZeroIsKnown) {
  for (const bool absolute : {true, false}) {
    Bench b;
    b.config.zero_absolute = absolute;
    b.config.link.base_id = b.desk.base;
    b.tick();
    const auto status = b.desk.last(Desk::status);
    ASSERT_EQ(status.size, 8);
    EXPECT_EQ((status.data[3] & 0x20) != 0, !absolute);
  }
}

// ---- frames of the link that waited

/// Behind the last frame that a tick reads may be others, which are unknown.
TEST(CycleSamples, ATickThatReads1024FramesIsFlooded) {
  for (const unsigned frames : {1023U, 1024U}) {
    Bench b;
    ASSERT_TRUE(b.start());
    for (unsigned n = b.axes(); n < frames; ++n) b.bus.push({.id = 0x7F0});
    EXPECT_EQ(b.tick().fault, frames == 1024 ? Fault::bus_overload : Fault::none);
  }
}

TEST(CycleSamples, AnOrderThatWaitedIsOlderByTheTicksThatItWaited) {
  for (const auto& [ticks, obeyed] : {std::pair{0U, true}, {80U, true}, {101U, false}, {2'000'000U, false}}) {
    Bench b;
    b.config.link = {.base_id = b.desk.base, .command_age_ticks_max = 100, .table_ticks = 1};
    for (int i = 0; i < 15; ++i) b.tick();
    b.bus.push(b.desk.order(Desk::arm));  // it answers a Status of one of these ticks
    b.bus.age_us = ticks * 1000 + 500;
    b.tick();
    EXPECT_EQ(b.state() == State::enabling, obeyed) << ticks;
    EXPECT_EQ(b.cycle->counters().not_mine, 0U) << "it is ours in any case";
  }
}

// ---- where homing begins

/// Both joints are driven as they are told, at their speed under the whole torque, up to their stops. All
/// angles and steps are multiples of 2^-12, so that sums are exact.
struct HomingBench : Bench {
  static constexpr double torque = 0.3, speed = 0.25, tick_s = 0x1p-10;
  static double rounded(double v) { return std::round(v * 0x1p12) * 0x1p-12; }
  explicit HomingBench(Sensors sensors) : Bench(sensors) {
    const auto at_stops = five_bar_angles(0.0, 0.17);
    const auto begin = five_bar_angles(0.004, 0.172);
    config.controller.sample_time = tick_s;
    config.zero_absolute = false;
    for (int j = 0; j < 4; ++j) {
      const auto u = static_cast<unsigned>(j);
      config.zero_pose[j] = rounded(at_stops[u]);
      first[j] = rounded(begin[u]) + 1.0;                            // by an unknown amount
      stop[j] = j % 2 == 0 ? rounded(at_stops[u]) + 1.0 : first[j];  // the passive joints do not move
    }
    encoder = first;
    const auto way = [&](int j) { return stop[j] > first[j] ? 1.0 : -1.0; };
    config.homing = {.speed = {way(0) * speed, way(2) * speed},
                     .torque = {torque, torque},
                     .damping = {0.08, 0.08},
                     .travel = 2.0,
                     .back_off = 0.02,
                     .share = 0.01};
  }
  /// The end of homing, or its fault.
  Fault run() {
    Vec<double, 4> given = Vec<double, 4>::Zero();
    for (int n = 0; n < 20'000; ++n) {
      for (const int j : {0, 2}) {
        double rate = std::abs(given[j]) > 0.99 * torque ? std::copysign(speed, given[j]) : 0.0;
        const double next = encoder[j] + rate * tick_s;
        if (stop[j] > first[j] ? next > stop[j] : next < stop[j]) rate = 0;
        encoder[j] += rate * tick_s;
        drive[joint_axis(j)].rate = rate;
      }
      for (unsigned i = 0; i < axes(); ++i) drive[i].angle = encoder[static_cast<int>(i * (4 / axes()))];
      given = tick(n == 1 ? Command::home : Command::none).torque;
      if (fault() != Fault::none || (n > 10 && state() == State::disabled)) return fault();
    }
    return Fault::halt_failed;
  }
  [[nodiscard]] unsigned joint_axis(int joint) const { return static_cast<unsigned>(joint) * axes() / 4; }
  Vec<double, 4> encoder = Vec<double, 4>::Zero(), stop = encoder, first = encoder;
};

TEST(CycleSamples, HomingEndsWithAZeroWhereTheMechanismCouldBegin) {
  HomingBench b(Sensors::base);
  for (const int passive : {1, 3}) b.config.zero_pose[passive] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(b.run(), Fault::none) << "of joints without an encoder no pose is asked";
  b.tick(Command::enable);
  EXPECT_EQ(b.fault(), Fault::none);
  HomingBench apart(Sensors::base);
  apart.config.zero_pose.setZero();  // the legs point away from each other, too far for the second bars
  EXPECT_EQ(apart.run(), Fault::loop_not_closed);
}

/// With encoders on all joints it is also seen that the tips of the legs meet, to within the limit itself.
TEST(CycleSamples, HomingJudgesTheGapBetweenTheTips) {
  const HomingBench b(Sensors::all);
  const Vec<double, 4> began = b.first - b.stop + b.config.zero_pose;
  const auto tip = [&](double base, double side, int leg) {
    const double one = began[2 * leg], both = one + began[2 * leg + 1];
    return Vec2<double>(base + side * (bar1 * std::cos(one) + bar2 * std::cos(both)),
                        bar1 * std::sin(one) + bar2 * std::sin(both));
  };
  const double gap = (tip(half_base, 1, 0) - tip(-half_base, -1, 1)).norm();
  ASSERT_GT(gap, 1e-5);
  for (const auto& [limit, fault] :
       {std::pair{1.001 * gap, Fault::none}, {0.999 * gap, Fault::loop_not_closed}}) {
    HomingBench h(Sensors::all);
    h.config.controller.limits.closure = limit;
    EXPECT_EQ(h.run(), fault);
  }
  const double exact =
      estimate_from_all(b.config.controller.mechanism, began, Vec<double, 4>::Zero().eval()).closure;
  for (const auto& [limit, fault] :
       {std::pair{exact, Fault::none}, {std::nextafter(exact, 0.0), Fault::loop_not_closed}}) {
    HomingBench h(Sensors::all);
    h.config.controller.limits.closure = limit;
    EXPECT_EQ(h.run(), fault);
  }
}

}  // namespace
}  // namespace esmc::test
