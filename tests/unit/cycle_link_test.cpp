/// The whole cycle with a supervisor computer on its bus, made of bytes: what is armed, led and stopped by
/// frames alone, and what is not.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <random>
#include <vector>

#include "firmware/link/parameter_slots.hpp"
#include "tests/support/cycle_rig.hpp"
#include "tests/support/link_bytes.hpp"
#include "tests/support/slot_memory.hpp"

namespace {

using namespace esmc;
using test::Desk;
using test::Rig;
using test::Setup;
using test::setup;

template <class M>
link::LinkConfig link_of() {
  link::LinkConfig c;
  c.base_id = 0x780;
  c.session = 5;
  c.command_age_ticks_max = 100;
  c.status_ticks = 5;
  c.telemetry_ticks = 10;
  c.period_ns = 1'000'000;
  c.space = M::joints == 4 ? link::Space::effector : link::Space::base_joints;
  c.position = {link::Bounds{-3.0F, 3.0F}, link::Bounds{-3.0F, 3.0F}};
  c.parameters = link::Parameters(
      {20, 20, 8, 8, 1e-3F, 2, 2, 50, 2.0F, 40.0F, 5, 0},
      {link::Bounds{10, 60}, link::Bounds{10, 60}, link::Bounds{1, 20}, link::Bounds{1, 20}});
  return c;
}

template <class M>
Setup<M> with_link() {
  Setup<M> s = setup<M>();
  s.link = link_of<M>();
  s.controller.setpoint_speed = 2;
  s.controller.setpoint_acceleration = 40;
  return s;
}

/// The mechanism does not move; what it is asked to do is looked at.
template <class M>
struct Linked {
  explicit Linked(const Setup<M>& s = with_link<M>()) : rig(s) {}

  TickResult<M> tick(const std::vector<hal::CanFrame>& frames = {}) {
    for (const auto& f : frames) rig.bus.push(f);
    const auto r = rig.tick();
    for (const auto& f : rig.bus.sent()) desk.hear(f);
    return r;
  }
  void until_told(unsigned state, int ticks = 40) {
    for (int i = 0; i < ticks && desk.state != state; ++i) tick();
    ASSERT_EQ(desk.state, state);
  }
  void listen() {
    for (int i = 0; i < 6; ++i) tick();
    tick({desk.ask(2)});
  }
  void arm() {
    tick({desk.order(Desk::arm)});
    until_told(static_cast<unsigned>(State::running));
  }
  void arm_for_set_points() {
    listen();
    tick({desk.order(Desk::stream)});
    arm();
  }
  Rig<M> rig;
  Desk desk;
};

TEST(CycleLink, StoredGainsAreTheControllersBeforeAnythingCanBeArmed) {
  test::SlotMemory<2> memory;
  for (const bool stored : {false, true}) {
    auto s = with_link<FiveBar<double>>();
    s.link.scene = 7;
    Linked<FiveBar<double>> l(s);
    link::ParameterSlots slots(memory, l.rig.cycle.link().parameters(), l.rig.cycle.link().scene(), 100);
    link::restore(l.rig.cycle.link(), slots);
    l.tick();
    const auto& g = l.rig.cycle.controller().config().gains;
    EXPECT_EQ(g.lambda[0] == 33.0, stored);
    EXPECT_EQ(g.k[0] == 11.0, stored);
    if (stored) break;
    for (int i = 0; i < 10; ++i) l.tick({l.desk.ask(2)});
    for (const unsigned i : {0U, 1U}) l.tick({l.desk.set_gain(i, 33.0F)});
    for (const unsigned i : {2U, 3U}) l.tick({l.desk.set_gain(i, 11.0F)});
    for (int i = 0; i < 10; ++i) l.tick();  // their answers and the table
    l.tick({l.desk.order(Desk::store)});
    for (int i = 0; i < 100; ++i) {
      link::serve(l.rig.cycle.link(), slots);
      l.tick();
    }
    EXPECT_EQ(slots.status().state, link::StoreState::stored);
    l.tick({l.desk.order(Desk::forget)});
    EXPECT_NE(g.lambda[0], 33.0) << "baked ones in use at once; the power goes before they are forgotten";
  }
}

TEST(CycleLink, WithoutOneNothingIsDifferent) {
  Rig<FiveBar<double>> without;
  auto s = with_link<FiveBar<double>>();
  s.link.source = link::Source::reference;
  Rig<FiveBar<double>> with(s);
  ASSERT_TRUE(without.start());
  ASSERT_TRUE(with.start());
  for (int i = 0; i < 200; ++i) {
    const auto a = without.tick(), b = with.tick();
    ASSERT_EQ(a.torque, b.torque);
    std::vector<hal::CanFrame> rest;
    for (const auto& f : with.bus.sent()) {
      if (f.id < 0x780 || f.id >= 0x7A0) rest.push_back(f);
    }
    ASSERT_TRUE(std::ranges::equal(rest, without.bus.sent()));
  }
}

template <class M>
void live_by_frames() {
  Linked<M> l;
  Desk& desk = l.desk;
  l.arm_for_set_points();
  EXPECT_EQ(desk.source, 2U);
  // It holds where it is, then takes a set point 20 mm or mrad away, along a way without jumps.
  const auto here = l.tick();
  const auto where = [](const TickResult<M>& r) -> Vec2<double> {
    return (M::joints == 4 ? r.desired_effector : r.desired_base()).template cast<double>();
  };
  const Vec2<double> start = where(here);
  EXPECT_NEAR((start - where(l.tick())).norm(), 0.0, 1e-6);
  const auto um = [](double v) { return static_cast<int>(std::lround(v * 1e6)); };
  const unsigned space = M::joints == 4 ? 0 : 1;
  auto r = l.tick({desk.pair(Desk::point, um(start[0] - 0.02), um(start[1] + 0.01), space)});
  auto before = where(r);
  for (int i = 0; i < 120; ++i) {
    r = l.tick();
    EXPECT_LE(std::abs(where(r)[0] - before[0]), 2e-3);
    before = where(r);
  }
  EXPECT_NEAR(where(r)[0], start[0] - 0.02, 2e-6);
  EXPECT_NEAR(where(r)[1], start[1] + 0.01, 2e-6);
  // A stream that begins there and stops: the stream's end without a word is a fault with a name.
  for (int i = 0; i < 50; ++i) {
    const double t = i * 1e-3, x = start[0] - 0.02 + 0.01 * (1 - std::cos(20 * t)),
                 v = 0.2 * std::sin(20 * t);
    desk.counter[Desk::velocity] = desk.counter[Desk::position];
    r = l.tick({desk.pair(Desk::position, um(x), um(start[1] + 0.01), space),
                desk.pair(Desk::velocity, static_cast<int>(std::lround(v * 1e5)), 0, space)});
    EXPECT_NEAR(where(r)[0], x, 3e-6) << i;
  }
  EXPECT_EQ(r.state, State::running);
  for (int i = 0; i < 5; ++i) EXPECT_EQ(l.tick().state, State::running);
  EXPECT_EQ(l.tick().fault, Fault::command_lost);
  EXPECT_TRUE(l.rig.all_zero());
  for (int i = 0; i < 5; ++i) l.tick();
  EXPECT_EQ(desk.fault, static_cast<unsigned>(Fault::command_lost));
  EXPECT_EQ(desk.last(Desk::record).data[0], static_cast<unsigned>(Fault::command_lost));
  // Reset, arm once more, disarm.
  l.tick({desk.order(Desk::reset)});
  l.until_told(static_cast<unsigned>(State::disabled));
  l.arm();
  l.tick({desk.order(Desk::disarm)});
  l.until_told(static_cast<unsigned>(State::disabled));
  EXPECT_TRUE(l.rig.all_zero());
}

TEST(CycleLink, FiveBarLivesByFramesAlone) { live_by_frames<FiveBar<double>>(); }
TEST(CycleLink, RrInFloatLivesByFramesAlone) { live_by_frames<Rr<float>>(); }

TEST(CycleLink, TheReferenceRunsUnlessTheComputerChoosesOtherwise) {
  Linked<FiveBar<double>> l;
  l.listen();
  l.arm();
  const auto a = l.tick(), b = l.tick();
  EXPECT_NE(a.desired_effector, b.desired_effector) << "the circle turns";
  l.tick({l.desk.order(Desk::off)});
  l.until_told(static_cast<unsigned>(State::disabled));
  l.tick({l.desk.order(Desk::hold)});
  l.arm();
  const auto c = l.tick(), d = l.tick();
  EXPECT_EQ(c.desired_effector, d.desired_effector);
}

/// By frames alone: slower along the circle, at rest on it, on from there.
TEST(CycleLink, TheReferenceIsHeldOnItsPath) {
  auto s = with_link<FiveBar<double>>();
  s.link.source = link::Source::reference;
  s.controller.limits.joint_speed = 1e3;  // the mechanism does not follow
  Linked<FiveBar<double>> l(s);
  l.listen();
  l.arm();
  Vec2<double> last = l.tick().desired_effector;
  double speed = 0.2;  // 0.02 m at 10 rad/s
  const auto go = [&](int ticks, const std::vector<hal::CanFrame>& frames = {}) {
    for (int i = 0; i < ticks; ++i) {
      const Vec2<double> now = l.tick(i == 0 ? frames : std::vector<hal::CanFrame>{}).desired_effector;
      const double step = (now - last).norm() / 1e-3;
      EXPECT_NEAR((now - Vec2<double>(0.0, 0.17)).norm(), 0.02, 1e-12);
      EXPECT_LE(std::abs(step - speed), 0.2 * 10 * 1e-3 + 1e-6) << "no jump of the speed";
      speed = step;
      last = now;
    }
  };
  go(5);
  EXPECT_NEAR(speed, 0.2, 1e-5);
  go(200, {l.desk.order(Desk::override_speed, 25)});
  EXPECT_NEAR(speed, 0.05, 1e-5);
  go(200, {l.desk.order(Desk::hold)});
  EXPECT_EQ(speed, 0.0);
  EXPECT_EQ(l.desk.pace, 2U);
  go(200, {l.desk.order(Desk::resume)});
  EXPECT_NEAR(speed, 0.05, 1e-5);
  go(200, {l.desk.order(Desk::hold)});
  // After an episode the hold is over, the percentage is not.
  l.tick({l.desk.order(Desk::disarm)});
  l.until_told(static_cast<unsigned>(State::disabled));
  l.arm();
  last = l.tick().desired_effector;
  speed = 0.05;
  go(100);
  EXPECT_NEAR(speed, 0.05, 1e-5);
}

/// A hold that the motors cannot follow waits, but not for ever.
TEST(CycleLink, AHoldBeyondTheTorqueWaitsAndEnds) {
  auto s = with_link<FiveBar<double>>();
  s.link.source = link::Source::reference;
  s.controller.limits.joint_speed = 1e3;
  for (auto& most : s.controller.torque_limit) most = 1e-6;
  Linked<FiveBar<double>> l(s);
  l.listen();
  l.arm();
  Vec2<double> last = l.tick({l.desk.order(Desk::hold)}).desired_effector;
  const auto speed_after = [&](int ticks) {
    Vec2<double> now = last;
    for (int i = 0; i < ticks; ++i) last = now, now = l.tick().desired_effector;
    const double speed = (now - last).norm() / 1e-3;
    last = now;
    return speed;
  };
  EXPECT_NEAR(speed_after(200), 0.2, 1e-5) << "waits";
  EXPECT_EQ(speed_after(20000), 0.0);
}

TEST(CycleLink, ASetPointOutOfReachIsNotFollowed) {
  Linked<FiveBar<double>> l;
  l.arm_for_set_points();
  const auto before = l.tick();
  const auto refused = l.rig.cycle.link().counters().refused;
  l.tick({l.desk.pair(Desk::point, 900'000, 900'000)});
  for (int i = 0; i < 50; ++i) l.tick();
  const auto after = l.tick();
  EXPECT_EQ(after.state, State::running);
  EXPECT_EQ(after.desired_effector, before.desired_effector);
  EXPECT_EQ(l.rig.cycle.link().counters().refused, refused + 1);
}

/// The console must not call a zero confirmed that could not be.
TEST(CycleLink, AZeroWithoutSamplesIsCountedAsRefused) {
  Linked<FiveBar<double>> l;
  l.listen();
  const auto refused = [&] { return l.rig.cycle.link().counters().refused; };
  const auto before = refused();
  l.tick({l.desk.order(Desk::confirm_zero)});
  EXPECT_EQ(refused(), before);
  l.rig.sends_encoder[1] = false;
  for (int i = 0; i < 10; ++i) l.tick();
  l.tick({l.desk.order(Desk::confirm_zero)});
  EXPECT_EQ(refused(), before + 1);
}

TEST(CycleLink, HoldEndsTheWayToASetPoint) {
  Linked<FiveBar<double>> l;
  l.arm_for_set_points();
  const Vec2<double> start = l.tick().desired_effector;
  l.tick({l.desk.pair(Desk::point, 0, 200'000)});
  for (int i = 0; i < 20; ++i) l.tick();
  l.tick({l.desk.order(Desk::hold)});
  for (int i = 0; i < 300; ++i) l.tick();
  const Vec2<double> end = l.tick().desired_effector;
  EXPECT_GT((end - start).norm(), 1e-5);
  EXPECT_GT((end - Vec2<double>(0.0, 0.2)).norm(), 1e-3);
  EXPECT_EQ(l.tick().desired_effector, end);
}

TEST(CycleLink, ASenderOfOurIdentifiersIsAForeignController) {
  Linked<FiveBar<double>> l;
  ASSERT_TRUE(l.rig.start());
  hal::CanFrame f = l.desk.make(0, 0);
  f.id = 0x790;
  EXPECT_EQ(l.tick({f}).fault, Fault::foreign_controller);
}

/// A computer that arms and then says nothing more, in every state that it can leave the controller in.
TEST(CycleLink, AComputerThatIsGoneEndsEveryArmedState) {
  using M = FiveBar<double>;
  for (const AfterHalt end : {AfterHalt::release, AfterHalt::hold, AfterHalt::lower}) {
    for (const State at :
         {State::enabling, State::testing, State::running, State::halting, State::holding, State::lowering}) {
      if (at == State::holding && end != AfterHalt::hold) continue;
      if (at == State::lowering && end != AfterHalt::lower) continue;
      auto s = with_link<M>();
      auto values = s.link.parameters.values();
      constexpr int silence = 30;
      values[static_cast<unsigned>(link::Index::silence)] = silence;
      s.link.parameters = link::Parameters(values, s.link.parameters.bounds());
      s.controller.after_halt = end;
      s.controller.halt_ticks = 10;
      s.controller.lower_ticks = 200;
      s.controller.join_ticks = 1000;
      if (at == State::testing) s.controller.sign_test_move = 0.2;
      Linked<M> l(s);
      l.listen();
      l.tick();
      l.rig.obedient = at != State::enabling;
      l.tick({l.desk.order(Desk::arm)});
      const auto state = [&] { return l.rig.cycle.supervisor().state(); };
      const bool running = at == State::halting || at == State::holding || at == State::lowering;
      for (int i = 0; i < 25 && state() != (running ? State::running : at); ++i) l.tick();
      if (running) l.tick({l.desk.order(Desk::disarm)});
      for (int i = 0; i < 15 && state() != at; ++i) l.tick();
      ASSERT_EQ(state(), at);
      for (int i = 0; i <= silence; ++i) l.tick();
      EXPECT_EQ(l.rig.cycle.supervisor().fault(),
                at == State::halting && end == AfterHalt::release ? Fault::none : Fault::command_lost)
          << name(at);
      for (int i = 0; i < 300; ++i) l.tick();
      const bool held = end == AfterHalt::hold && at != State::enabling && at != State::testing;
      EXPECT_EQ(l.rig.cycle.supervisor().powered(), held) << name(at) << ": " << name(state());
      EXPECT_NE(state(), State::running);
    }
  }
}

/// What is kept of a tick is its measured angles, its torques and its errors, to the step of each number.
template <class M>
void keeps_ticks() {
  constexpr double limit = 3.0;  // N m
  auto s = with_link<M>();
  auto values = s.link.parameters.values();
  values[static_cast<unsigned>(link::Index::torque_limit_1)] = static_cast<float>(limit);
  values[static_cast<unsigned>(link::Index::torque_limit_2)] = static_cast<float>(limit);
  s.link.parameters = link::Parameters(values, s.link.parameters.bounds());
  Linked<M> l(s);
  std::vector<link::CaptureRecord> memory(400);
  l.rig.cycle.link().capture_into(memory);
  l.arm_for_set_points();
  std::vector<TickResult<M>> results;
  std::vector<Sample<M>> samples;
  l.tick({l.desk.pair(Desk::point, 50'000, 150'000, M::joints == 4 ? 0 : 1)});
  for (int i = 0; i < 150; ++i) {
    l.rig.cycle.late_by(static_cast<std::uint32_t>(i));
    l.rig.angle[0] += 1e-4;
    results.push_back(l.tick());
    samples.push_back(l.rig.cycle.sample());
  }
  l.tick({l.desk.order(Desk::off)});
  l.until_told(static_cast<unsigned>(State::disabled));
  std::vector<std::uint8_t> bytes;
  for (unsigned block = 0; block < 7; ++block) {
    l.desk.heard.clear();
    l.tick({l.desk.ask(3, block)});
    for (int i = 0; i < 1500; ++i) l.tick();
    for (const auto& f : l.desk.heard) {
      if (f.id == 0x780 + Desk::capture && Desk::word(f, 0, 2) != 0xFFFF)
        bytes.insert(bytes.end(), f.data.begin() + 2, f.data.begin() + 8);
    }
  }
  ASSERT_EQ(bytes.size() % 24, 0U);
  const auto number = [&](std::size_t row, std::size_t at, std::size_t n) {
    std::int64_t v = 0;
    for (std::size_t i = n; i-- > 0;) v = v * 256 + bytes[24 * row + at + i];
    return static_cast<double>(v >= (std::int64_t{1} << (8 * n - 1)) ? v - (std::int64_t{1} << (8 * n)) : v);
  };
  std::size_t row = 0;  // of the first of `results`: the only ticks that are late, but for the first
  while (row < bytes.size() / 24 && number(row, 20, 2) != 1.0) ++row;
  ASSERT_GE(row, 1U);
  --row;
  ASSERT_LE(row + results.size(), bytes.size() / 24);
  bool torque = false;
  for (std::size_t i = 0; i < results.size(); ++i) {
    for (int j = 0; j < 2; ++j) {
      const int joint = j * M::joints / 2;
      const auto u = static_cast<std::size_t>(j);
      ASSERT_NEAR(number(row + i, 4 + 3 * u, 3) * 1e-6, static_cast<double>(samples[i].angle[joint]), 0.8e-6)
          << i;
      ASSERT_NEAR(number(row + i, 10 + 2 * u, 2) / 32767 * limit,
                  static_cast<double>(results[i].torque[joint]), 0.51 * limit / 32767);
      ASSERT_NEAR(number(row + i, 14 + 3 * u, 3) * 1e-6,
                  static_cast<double>(results[i].desired_effector[j] - results[i].effector[j]), 0.8e-6);
      torque = torque || results[i].torque[joint] != 0;
    }
    ASSERT_EQ(bytes[24 * (row + i) + 23] & 15U, static_cast<unsigned>(results[i].state));
    ASSERT_EQ(number(row + i, 20, 2), static_cast<double>(i));
    ASSERT_EQ(number(row + i, 0, 4), number(row, 0, 4) + static_cast<double>(i));
  }
  EXPECT_TRUE(torque);
}
TEST(CycleLink, KeepsTheTicksOfAFiveBar) { keeps_ticks<FiveBar<double>>(); }
TEST(CycleLink, KeepsTheTicksOfAnArm) { keeps_ticks<Rr<float>>(); }

TEST(CycleLink, GainsReachTheLaw) {
  const auto torque = [](std::optional<float> lambda) {
    Linked<FiveBar<double>> l;
    for (int i = 0; i < 6; ++i) l.tick();
    if (lambda) {
      for (const unsigned i : {0U, 1U}) l.tick({l.desk.set_gain(i, *lambda)});
      for (const unsigned i : {2U, 3U}) l.tick({l.desk.set_gain(i, 8.0F)});
    }
    l.tick({l.desk.ask(2)});
    for (int i = 0; i < 10; ++i) l.tick();  // answers and the table
    l.arm();
    for (int i = 0; i < 20; ++i) l.tick();
    const auto& g = l.rig.cycle.controller().config().gains;
    EXPECT_EQ(g.lambda.minCoeff(), lambda.value_or(20.0F));
    EXPECT_EQ(g.lambda.maxCoeff(), lambda.value_or(20.0F));
    EXPECT_EQ(g.independent.lambda, lambda.value_or(20.0F));
    if (lambda) {
      EXPECT_NEAR(g.layer.maxCoeff(), 8.0e-3, 1e-15) << "implicit: h k";
    }
    return l.tick().torque;
  };
  EXPECT_NE(torque(20.0F), torque(40.0F));
}

TEST(CycleLink, TelemetryIsWhatTheTickDid) {
  Linked<FiveBar<double>> l;
  ASSERT_TRUE(l.rig.start());
  TickResult<FiveBar<double>> r;
  for (int i = 0; i < 30; ++i) {
    l.desk.heard.clear();
    r = l.tick();
    if (l.desk.count(Desk::effector) == 0) continue;
    EXPECT_EQ(Desk::real(l.desk.last(Desk::effector), 0), static_cast<float>(r.effector[0]));
    for (int k = 0; k < 8; ++k) l.tick();  // the rest of the set, of the same tick
    EXPECT_EQ(Desk::real(l.desk.last(Desk::error), 4),
              static_cast<float>(r.desired_effector[1] - r.effector[1]));
    EXPECT_EQ(Desk::real(l.desk.last(Desk::joint + 1), 4), static_cast<float>(r.torque[2]));
    EXPECT_NEAR(Desk::real(l.desk.last(Desk::joint), 0), l.rig.angle[0], 1e-6);
    EXPECT_EQ(l.desk.count(Desk::joint + 2), 0);
    return;
  }
  FAIL() << "no telemetry";
}

TEST(CycleLink, AReferenceThatLeavesTheReachWhileItsSpeedChangesIsAFault) {
  auto s = with_link<FiveBar<double>>();
  s.controller.setpoint_acceleration = 1e-3;  // the change goes on for the whole test
  s.controller.reference.centre = {0.0, 0.2};
  s.controller.reference.amplitude = {0.1, 0.1};
  Linked<FiveBar<double>> l(s);
  ASSERT_TRUE(l.rig.start());
  for (int i = 0; i < 6; ++i) l.tick();
  l.tick({l.desk.order(Desk::override_speed, 50)});
  ASSERT_TRUE(l.rig.cycle.supervisor().running()) << name(l.rig.cycle.supervisor().fault());
  for (int i = 0; i < 300 && l.rig.cycle.supervisor().running(); ++i) l.tick();
  EXPECT_EQ(l.rig.cycle.supervisor().fault(), Fault::reference_unreachable);
  EXPECT_TRUE(l.rig.all_zero());
}

/// Frames of every kind, damaged in every way that a bus and a program can: nothing is armed, nothing moves.
/// Good ones of another session are among them.
TEST(CycleLink, DamagedFramesNeverMoveAnything) {
  std::mt19937 random(3);
  const auto draw = [&](unsigned n) { return static_cast<unsigned>(random() % n); };
  for (const bool running : {false, true}) {
    Linked<FiveBar<double>> l;
    l.listen();
    l.tick({l.desk.order(Desk::stream)});
    if (running) {
      l.arm();
    }
    const auto still = l.tick().desired_effector;
    Desk other = l.desk;
    other.session = static_cast<std::uint8_t>(l.desk.session + 1 + draw(200));
    for (int n = 0; n < 20'000; ++n) {
      other.tick = l.desk.tick;
      other.crc32 = l.desk.crc32;
      const unsigned what = draw(4);
      // Not the two that take torque away.
      const unsigned orders[] = {Desk::arm,  Desk::reset,     Desk::confirm_zero,
                                 Desk::hold, Desk::reference, Desk::stream};
      hal::CanFrame f = what == 0   ? other.order(orders[draw(6)])
                        : what == 1 ? other.pair(Desk::point, static_cast<int>(draw(20'000)), 170'000)
                        : what == 2 ? other.pair(Desk::position, static_cast<int>(draw(20'000)), 170'000)
                                    : other.pair(Desk::velocity, 0, 0);
      f.data[0] = static_cast<std::uint8_t>(f.data[0] + (draw(3) == 0 ? 1 + draw(255) : 0));
      if (f.data[0] == l.desk.seal(f, l.desk.session).data[0]) continue;  // a random sum is right once in 256
      if (draw(20) == 0) f.size = static_cast<std::uint8_t>(draw(8));
      const auto r = l.tick({f});
      ASSERT_EQ(r.state, running ? State::running : State::disabled);
      ASSERT_EQ(r.desired_effector, still);
    }
  }
}

}  // namespace
