/// Homing: base joints with end stops and encoders that count from where they were switched on, behind drives
/// made of bytes.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <tuple>
#include <type_traits>

#include "tests/support/cycle_rig.hpp"
#include "tests/support/link_bytes.hpp"

namespace {

using namespace esmc;
using test::Desk;
using test::Rig;
using test::Setup;
using Five = FiveBar<double>;
using Arm = Rr<float>;

constexpr double configured = -1.0;  ///< side of passive() in the assembly mode of setup()
constexpr double tick_time = 1e-3, torque_most = 0.3, speed = 0.4, back_off = 0.02;

/// Passive angles of a five-bar with these base angles; `side`: of the two ways to assemble it.
std::array<double, 2> passive(double q1, double q2, double side) {
  const double x1 = test::half_base + test::bar1 * std::cos(q1), y1 = test::bar1 * std::sin(q1);
  const double x2 = -test::half_base - test::bar1 * std::cos(q2), y2 = test::bar1 * std::sin(q2);
  const double dx = x2 - x1, dy = y2 - y1, d = std::hypot(dx, dy);
  const double h = side * std::sqrt(test::bar2 * test::bar2 - 0.25 * d * d);
  const double x = 0.5 * (x1 + x2) - h * dy / d, y = 0.5 * (y1 + y2) + h * dx / d;
  return {std::atan2(y - y1, x - x1) - q1, std::atan2(y - y2, x2 - x) - q2};
}

/// Base joints with inertia and friction between two stops, and what the encoders say of them.
template <class M>
struct Bench {
  using S = typename M::Scalar;
  static constexpr int second = M::joints / 2;

  static std::array<double, 2> start() {
    if constexpr (std::is_same_v<M, Five>) {
      const auto a = test::five_bar_angles(0.015, 0.18);
      return {a[0], a[2]};
    }
    return {0.4, 0.9};
  }
  /// Joint 1 moves down to its stop, joint 2 up.
  static std::array<double, 2> stops() { return {start()[0] - 0.3, start()[1] + 0.25}; }

  static Setup<M> usual() {
    Setup<M> s = test::setup<M>();
    s.zero_absolute = false;
    s.controller.halt_ticks = 100;
    s.homing.speed = {S(-speed), S(speed)};
    s.homing.torque = {S(torque_most), S(torque_most)};
    s.homing.damping = {S(0.08), S(0.08)};
    s.homing.travel = S(2.0);
    s.homing.back_off = S(back_off);
    s.homing.share = S(0.01);
    s.zero_pose[0] = S(stops()[0]);
    s.zero_pose[second] = S(stops()[1]);
    s.link.base_id = 0x780;
    s.link.session = 5;
    s.link.command_age_ticks_max = 100;
    s.link.parameters = link::Parameters({20, 20, 8, 8, 1e-3F, 2, 2, 50, 2, 40, 5, 50}, {});
    return s;
  }
  explicit Bench(const Setup<M>& s = usual()) : rig(s) {
    desk.session = 5;
    show();
  }

  /// The encoders, each off by where its joint was switched on.
  void show() {
    const double kept = frozen < 0 ? 0.0 : rig.angle[static_cast<std::size_t>(frozen) * second];
    rig.angle[0] = q[0] - start()[0];
    rig.angle[second] = q[1] - start()[1];
    rig.rate[0] = v[0];
    rig.rate[second] = v[1];
    if (frozen >= 0) {
      rig.angle[static_cast<std::size_t>(frozen) * second] = kept;
      rig.rate[static_cast<std::size_t>(frozen) * second] = 0.0;
    }
    if constexpr (M::joints == 4) {
      if (rig.controller().sensors != Sensors::all) return;
      const auto now = passive(q[0], q[1], side), then = passive(start()[0], start()[1], side);
      for (std::size_t i = 0; i < 2; ++i) rig.angle[2 * i + 1] = now[i] - then[i];
    }
  }
  TickResult<M> tick(Command c = Command::none, const std::vector<hal::CanFrame>& frames = {}) {
    for (const auto& f : frames) rig.bus.push(f);
    const TickResult<M> r = rig.tick(c);
    for (const auto& f : rig.bus.sent()) desk.hear(f);
    for (std::size_t i = 0; i < 2; ++i) {
      const double torque = static_cast<double>(r.torque[static_cast<int>(i) * second]);
      most = std::max(most, std::abs(torque));
      v[i] += (gives[i] * torque + push[i] - friction * v[i]) / inertia * tick_time;
      fastest = std::max(fastest, std::abs(v[i]));
      const double to = q[i] + v[i] * tick_time, at = std::clamp(to, lower[i], upper[i]);
      if (at != to) v[i] = 0.0;
      q[i] = at;
    }
    show();
    return r;
  }
  /// With a console that is there, until `over` or many ticks have passed.
  void run(const std::function<bool()>& over, int ticks = 20'000) {
    for (int n = 0; n < ticks && !over(); ++n) tick(Command::none, {desk.order(Desk::none)});
    EXPECT_TRUE(over()) << name(state()) << ' ' << name(fault());
  }
  /// From power-up through the order of the console to the first tick of homing.
  void home() {
    for (int n = 0; n < 8; ++n) tick(Command::none, {desk.ask(2)});
    tick(Command::none, {desk.order(Desk::home)});
    run([&] { return state() == State::testing; }, 30);
  }
  [[nodiscard]] State state() const { return rig.cycle.supervisor().state(); }
  [[nodiscard]] Fault fault() const { return rig.cycle.supervisor().fault(); }
  [[nodiscard]] bool still() const { return std::max(std::abs(v[0]), std::abs(v[1])) < 0.26 * speed; }
  [[nodiscard]] bool zero_unknown() { return (desk.last(Desk::status).data[3] & 0x20) != 0; }

  static constexpr double inertia = 2e-3, friction = 0.02;
  Rig<M> rig;
  Desk desk;
  std::array<double, 2> q = start(), v{}, gives{1.0, 1.0}, push{};
  std::array<double, 2> lower{stops()[0], -9.0}, upper{9.0, stops()[1]};
  int frozen = -1;  ///< base joint whose encoder is; -1: none
  double side = configured, most = 0.0, fastest = 0.0;
};

template <class M>
class Homing : public testing::Test {};
using Mechanisms = testing::Types<Five, Arm>;
TYPED_TEST_SUITE(Homing, Mechanisms);

TYPED_TEST(Homing, BothStopsSetTheZero) {
  Bench<TypeParam> b;
  b.home();
  EXPECT_TRUE(b.zero_unknown());
  b.run([&] { return b.state() == State::disabled; });
  EXPECT_EQ(b.fault(), Fault::none);
  EXPECT_LE(b.most, torque_most * (1 + 1e-6));
  EXPECT_LT(b.fastest, 1.5 * speed);
  b.tick();
  b.run([&] { return !b.zero_unknown(); }, 20);
  for (std::size_t i = 0; i < 2; ++i) {
    const double at =
        static_cast<double>(b.rig.cycle.sample().angle[static_cast<int>(i) * Bench<TypeParam>::second]);
    EXPECT_NEAR(at, b.q[i], 1e-4);
    EXPECT_NEAR(std::abs(at - b.stops()[i]), 1.5 * back_off, 0.5 * back_off);
  }
  EXPECT_TRUE(b.rig.start()) << name(b.fault());
}

TYPED_TEST(Homing, AJointOnItsStopMovesAwayAndComesBack) {
  Bench<TypeParam> b;
  b.q = Bench<TypeParam>::stops();
  b.show();
  double away = 0.0;
  b.home();
  b.run([&] {
    away = std::max({away, b.q[0] - b.lower[0], b.upper[1] - b.q[1]});
    return b.state() == State::disabled;
  });
  EXPECT_EQ(b.fault(), Fault::none);
  EXPECT_GT(away, 0.02);
  EXPECT_NEAR(b.q[0], b.lower[0] + 1.5 * back_off, 0.5 * back_off);
}

TYPED_TEST(Homing, AMotorThatLosesItsTorqueHasNoStop) {
  for (const std::size_t i : {0U, 1U}) {
    for (const double way : {-1.0, 0.1}) {  // from the beginning, and on the way
      Bench<TypeParam> b;
      b.home();
      b.run([&] { return std::abs(b.q[i] - b.start()[i]) > way; });
      b.gives[i] = 0.0;
      b.run([&] { return b.state() == State::fault; });
      EXPECT_EQ(b.fault(), Fault::sign_test) << name(b.fault());
      EXPECT_TRUE(b.zero_unknown() && b.rig.all_zero());
    }
  }
}

TYPED_TEST(Homing, AnEncoderThatFreezesHasNoStop) {
  for (const std::size_t i : {0U, 1U}) {
    Bench<TypeParam> b;
    b.home();
    b.run([&] { return std::abs(b.q[i] - b.start()[i]) > 0.1; });
    b.frozen = static_cast<int>(i);
    b.run([&] { return b.state() == State::fault; });
    EXPECT_EQ(b.fault(), Fault::sign_test) << name(b.fault());
    EXPECT_TRUE(b.zero_unknown());
  }
}

TYPED_TEST(Homing, AStopThatIsNotInTheSamePlaceAgainIsNone) {
  for (const std::size_t i : {0U, 1U}) {
    Bench<TypeParam> b;
    const double first = i == 0 ? b.lower[0] : b.upper[1], way = i == 0 ? -1.0 : 1.0;
    b.home();
    b.run([&] { return std::abs(b.q[i] - first) < 1e-6; });
    b.run([&] { return std::abs(b.q[i] - first) > 0.015; });
    (i == 0 ? b.lower[0] : b.upper[1]) += way * 0.03;  // it gives way by more than a hundredth of the travel
    b.run([&] { return b.state() == State::fault; }, 1500);
    EXPECT_EQ(b.fault(), Fault::home_no_stop) << name(b.fault());
    EXPECT_TRUE(b.still());
  }
}

TYPED_TEST(Homing, WithoutAStopItEndsAtRestWithAFault) {
  for (const std::size_t i : {0U, 1U}) {
    Bench<TypeParam> b;
    b.lower[i] = -99.0;
    b.upper[i] = 99.0;
    b.home();
    bool halted = false;
    b.run([&] {
      halted = halted || b.state() == State::halting;
      return b.state() == State::fault;
    });
    EXPECT_EQ(b.fault(), Fault::home_no_stop);
    EXPECT_TRUE(halted && b.still());
    EXPECT_NEAR(std::abs(b.q[i] - Bench<TypeParam>::start()[i]), 2.0, 0.05) << "its travel, and no further";
    EXPECT_TRUE(b.zero_unknown());
  }
}

TYPED_TEST(Homing, AFirstJointThatLeavesItsStopIsNotHome) {
  Bench<TypeParam> b;
  b.home();
  b.run([&] { return b.v[1] > 0.9 * speed; });
  b.push[0] = torque_most + 0.02;
  b.run([&] { return b.state() == State::fault; }, 1000);
  EXPECT_EQ(b.fault(), Fault::home_no_stop) << name(b.fault());
}

TYPED_TEST(Homing, ASilentConsoleEndsItAtRest) {
  Bench<TypeParam> b;
  b.home();
  b.run([&] { return std::abs(b.v[0]) > 0.9 * speed; });
  int ticks = 0;
  for (; b.state() != State::fault && ticks < 1000; ++ticks) b.tick();
  EXPECT_EQ(b.fault(), Fault::command_lost);
  EXPECT_LE(ticks, 50 + 40);
  EXPECT_TRUE(b.still());
  EXPECT_TRUE(b.rig.all_zero() && b.zero_unknown());
}

TYPED_TEST(Homing, AHaltComesToRestAndAnOffIsZeroTorque) {
  Bench<TypeParam> b;
  b.home();
  b.run([&] { return std::abs(b.v[0]) > 0.9 * speed; });
  b.tick(Command::none, {b.desk.order(Desk::disarm)});
  EXPECT_EQ(b.state(), State::halting);
  b.run([&] { return b.state() == State::disabled; }, 45);
  EXPECT_TRUE(b.still());
  EXPECT_EQ(b.fault(), Fault::none);
  EXPECT_TRUE(b.zero_unknown());

  b.tick(Command::none, {b.desk.ask(2)});
  b.tick(Command::none, {b.desk.order(Desk::home)});
  b.run([&] { return std::abs(b.v[0]) > 0.9 * speed; });
  b.tick(Command::none, {b.desk.order(Desk::off)});
  EXPECT_EQ(b.state(), State::stopping);
  EXPECT_TRUE(b.rig.all_zero());

  auto s = Bench<TypeParam>::usual();
  s.controller.halt_ticks = 0;
  Bench<TypeParam> cannot(s);
  cannot.home();
  cannot.tick(Command::halt);
  EXPECT_EQ(cannot.state(), State::stopping);
}

TYPED_TEST(Homing, WhatCannotComeToRestIsLetGo) {
  Bench<TypeParam> b;
  b.home();
  b.run([&] { return std::abs(b.v[0]) > 0.9 * speed; });
  b.gives = {0.0, 0.0};
  b.push[0] = -0.01;
  b.tick(Command::halt);
  b.run([&] { return b.state() == State::fault; }, 1000);
  EXPECT_EQ(b.fault(), Fault::halt_failed) << name(b.fault());
}

TYPED_TEST(Homing, SamplesAreJudgedAsEverywhere) {
  const auto ends_in = [](const auto& change, Fault wanted) {
    Bench<TypeParam> b;
    b.home();
    b.run([&] { return std::abs(b.v[0]) > 0.5 * speed; });
    change(b);
    b.tick(Command::none, {b.desk.order(Desk::none)});
    for (int n = 0; n < 5; ++n) b.tick(Command::none, {b.desk.order(Desk::none)});
    EXPECT_EQ(b.fault(), wanted) << name(b.fault());
    EXPECT_TRUE(b.rig.all_zero());
  };
  ends_in([](auto& b) { b.rig.angle[0] = std::numeric_limits<double>::quiet_NaN(); },
          Fault::feedback_not_finite);
  ends_in([](auto& b) { b.rig.rate[0] = std::numeric_limits<double>::infinity(); },
          Fault::feedback_not_finite);
  ends_in([](auto& b) { b.rig.sends_encoder[1] = false; }, Fault::stale_feedback);
  ends_in([](auto& b) { b.v[0] = -5.0 * speed; }, Fault::joint_speed);
  ends_in([](auto& b) { b.v[1] = 5.0 * speed; }, Fault::joint_speed);
  ends_in([](auto& b) { b.rig.error[0] = 1; }, Fault::drive_error);
}

/// Four times the speed of homing are allowed where that is not above limits.joint_speed.
TYPED_TEST(Homing, NoJointIsFasterThanTheLimit) {
  for (const std::size_t joint : {0U, 1U}) {
    auto s = Bench<TypeParam>::usual();
    s.controller.limits.joint_speed = static_cast<typename TypeParam::Scalar>(2.0 * speed);
    Bench<TypeParam> b(s);
    b.home();
    b.run([&] { return std::abs(b.v[0]) > 0.5 * speed; });
    b.v[joint] = joint == 0 ? -3.0 * speed : 3.0 * speed;
    for (int n = 0; n < 5; ++n) b.tick(Command::none, {b.desk.order(Desk::none)});
    EXPECT_EQ(b.fault(), Fault::joint_speed) << name(b.fault());
    EXPECT_TRUE(b.rig.all_zero());
  }
}

TYPED_TEST(Homing, WhileEnablingASampleMayBeMissingButNotWrong) {
  Bench<TypeParam> late, wrong;
  late.rig.sends_encoder[1] = false;
  for (Bench<TypeParam>* b : {&late, &wrong}) {
    b->rig.obedient = false;
    for (int n = 0; n < 8; ++n) b->tick(Command::none, {b->desk.ask(2)});
    b->tick(Command::none, {b->desk.order(Desk::home)});
  }
  late.tick();
  EXPECT_EQ(late.state(), State::enabling) << name(late.fault());
  wrong.rig.angle[0] = std::numeric_limits<double>::quiet_NaN();
  wrong.tick();
  EXPECT_EQ(wrong.fault(), Fault::feedback_not_finite);
}

TYPED_TEST(Homing, AnEarlyEndLeavesNoZero) {
  Bench<TypeParam> b;
  b.home();
  b.run([&] { return b.state() == State::disabled; });
  b.run([&] { return !b.zero_unknown(); }, 20);
  b.tick(Command::none, {b.desk.ask(2)});
  b.tick(Command::none, {b.desk.order(Desk::home)});
  b.run([&] { return b.state() == State::testing; }, 30);
  b.tick(Command::none, {b.desk.order(Desk::off)});
  b.run([&] { return b.state() == State::disabled; }, 30);
  b.run([&] { return b.zero_unknown(); }, 20);
  b.tick(Command::enable);
  EXPECT_EQ(b.fault(), Fault::zero_not_confirmed);
}

TYPED_TEST(Homing, AHaltAfterBothStopsLeavesNoZero) {
  Bench<TypeParam> b;
  b.home();
  b.run([&] { return b.q[1] > b.upper[1] - back_off / 2 && b.v[0] > 0.5 * speed; });
  b.tick(Command::none, {b.desk.order(Desk::disarm)});
  b.run([&] { return b.state() == State::disabled; }, 500);
  b.tick();
  EXPECT_TRUE(b.zero_unknown());
}

/// The new zero shifts the angles of the next tick: a brake would take that for a jump.
TYPED_TEST(Homing, AHaltInTheTickAfterItsEndIsNoFault) {
  Bench<TypeParam> b;
  b.home();
  while (!b.tick(Command::none, {b.desk.order(Desk::none)}).stage_done) ASSERT_EQ(b.state(), State::testing);
  b.tick(Command::halt);
  EXPECT_EQ(b.state(), State::stopping) << name(b.fault());
  b.run([&] { return b.state() == State::disabled && !b.zero_unknown(); }, 30);
}

/// In a tick an angle is off its prediction by what four times the speed makes, 0.0016 rad, or 0.002 rad,
/// unless the limits allow less.
TYPED_TEST(Homing, AnAngleThatJumpsIsAFaultByTheSmallerBound) {
  for (const auto& [limit, jump, caught] : {std::tuple{0.0, 0.0025, true},
                                            {0.0, 0.0015, false},
                                            {0.5, 0.0025, true},
                                            {0.5, 0.0015, false},
                                            {0.001, 0.0015, true},
                                            {0.001, 0.0008, false}}) {
    Setup<TypeParam> s = Bench<TypeParam>::usual();
    s.controller.limits.feedback_jump = static_cast<typename TypeParam::Scalar>(limit);
    Bench<TypeParam> b(s);
    b.home();
    b.run([&] { return b.v[0] < -0.5 * speed; });
    b.q[0] += jump;
    b.show();
    for (int n = 0; n < 3; ++n) b.tick(Command::none, {b.desk.order(Desk::none)});
    EXPECT_EQ(b.fault(), caught ? Fault::feedback_jump : Fault::none) << limit << ' ' << jump;
  }
}

TYPED_TEST(Homing, IsOrderedWhileDisabledWithTheKnownTableAndOnlyWhereItExists) {
  auto none = Bench<TypeParam>::usual();
  none.homing = {};
  Bench<TypeParam> without(none);
  for (int n = 0; n < 8; ++n) without.tick(Command::none, {without.desk.ask(2)});
  without.tick(Command::none, {without.desk.order(Desk::home)});
  without.tick(Command::home);
  EXPECT_EQ(without.state(), State::disabled);

  Bench<TypeParam> b;
  for (int n = 0; n < 8; ++n) b.tick(Command::none, {b.desk.ask(2)});
  Desk stranger = b.desk;
  ++stranger.session;
  b.tick(Command::none, {stranger.order(Desk::home)});
  b.desk.crc32 ^= 1;
  b.tick(Command::none, {b.desk.order(Desk::home)});
  EXPECT_EQ(b.state(), State::disabled);

  Bench<TypeParam> running;
  for (int n = 0; n < 8; ++n) running.tick(Command::none, {running.desk.ask(2)});
  running.home();
  running.run([&] { return running.state() == State::disabled; });
  ASSERT_TRUE(running.rig.start());
  running.tick(Command::none, {running.desk.order(Desk::home)});
  running.tick(Command::home);
  EXPECT_EQ(running.state(), State::running);
}

/// Four encoders that all count from power-up.
Setup<Five> all_encoders() {
  Setup<Five> s = Bench<Five>::usual();
  s.controller.sensors = Sensors::all;
  const auto at = passive(Bench<Five>::stops()[0], Bench<Five>::stops()[1], configured);
  for (int i = 0; i < 2; ++i) s.zero_pose[2 * i + 1] = at[static_cast<std::size_t>(i)];
  return s;
}
TEST(HomingWithAllEncoders, ShowsTheAssemblyModeAndAStopThatIsNone) {
  const auto ends_in = [](double side, double obstacle) {
    Bench<Five> b(all_encoders());
    b.side = side;
    b.lower[0] += obstacle;
    b.q[0] += 0.4;  // the elbows come closer on the way: only then the two modes differ
    b.show();
    b.home();
    b.run([&] { return b.state() == State::disabled || b.state() == State::fault; });
    return b.fault();
  };
  const auto a = test::five_bar_angles(0.015, 0.18);
  ASSERT_NEAR(passive(a[0], a[2], configured)[0], a[1], 1e-9);
  EXPECT_EQ(ends_in(configured, 0.0), Fault::none);
  EXPECT_EQ(ends_in(-configured, 0.0), Fault::loop_not_closed);
  EXPECT_EQ(ends_in(configured, 0.1), Fault::loop_not_closed);
}

}  // namespace
