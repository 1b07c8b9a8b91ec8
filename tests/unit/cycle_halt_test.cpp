/// Coming to rest under control, on the simulator's plant: what halts, how far, how fast, and what comes
/// after.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/support/control_loop.hpp"
#include "tests/support/cycle_rig.hpp"

namespace {

using esmc::AfterHalt;
using esmc::Fault;
using esmc::FiveBar;
using esmc::State;
using esmc::test::ControlLoop;
using esmc::test::LoopSetup;
using Config = esmc::ControllerConfig<FiveBar<double>>;

constexpr double tick = 1e-3;
constexpr std::uint32_t halt_ticks = 100;

/// B7, to be stopped; `change` before it is built.
template <class Change>
ControlLoop loop(AfterHalt end, const Change& change) {
  LoopSetup s;
  s.adjust = [&](Config& c) {
    c.halt_ticks = halt_ticks;
    c.lower_ticks = 500;
    c.after_halt = end;
    change(c);
  };
  return ControlLoop(s);
}
void leaves_the_box(Config& c) { c.limits.workspace_y.upper = 0.2; }

double speed(const ControlLoop& l) { return std::max(std::abs(l.truth().qd[2]), std::abs(l.truth().qd[4])); }
double largest(const esmc::Vec<double, 4>& v) { return v.cwiseAbs().maxCoeff(); }

TEST(Halt, TheTickThatFindsTheFaultAlreadyBrakes) {
  ControlLoop l = loop(AfterHalt::release, leaves_the_box);
  while (l.supervisor().running() || l.ticks() == 0) ASSERT_LT(l.tick().running_tick, 300U);
  EXPECT_EQ(l.supervisor().state(), State::halting);
  EXPECT_EQ(l.supervisor().fault(), Fault::workspace);
  EXPECT_GT(largest(l.result().torque), 0.0) << "not let go in between";
  EXPECT_LE(largest(l.result().torque), 2.0);
}

TEST(Halt, ComesToRestInItsTimeWithoutJumpAndWithinHalfTheWayOfConstantSpeed) {
  ControlLoop l = loop(AfterHalt::hold, leaves_the_box);
  while (l.ticks() == 0 || l.supervisor().running()) l.tick();
  const auto start = l.truth();
  const double v1 = start.qd[2], v2 = start.qd[4];
  double last1 = v1;
  for (std::uint32_t n = 0; n < halt_ticks + 5; ++n) {
    l.tick();
    // The braking profile has at most 1.5 v / T of deceleration.
    EXPECT_LE(std::abs(l.truth().qd[2] - last1),
              1.05 * 1.5 * std::abs(v1) / (halt_ticks * tick) * tick + 0.02);
    last1 = l.truth().qd[2];
  }
  EXPECT_EQ(l.supervisor().state(), State::holding);
  EXPECT_LT(speed(l), 0.01);
  // The first tick of the way had passed where `start` was taken.
  EXPECT_NEAR(l.truth().q[2], start.q[2] + v1 * (0.5 * halt_ticks - 1) * tick, 1e-3);
  EXPECT_NEAR(l.truth().q[4], start.q[4] + v2 * (0.5 * halt_ticks - 1) * tick, 1e-3);
}

TEST(Halt, HeldAgainstGravityItStays) {
  ControlLoop l = loop(AfterHalt::hold, leaves_the_box);
  while (l.supervisor().state() != State::holding) ASSERT_LT(l.tick().running_tick, 1000U);
  const auto rest = l.truth();
  for (int n = 0; n < 5000; ++n) l.tick();
  EXPECT_EQ(l.supervisor().state(), State::holding);
  EXPECT_GT(l.truth().q[1], 0.2) << "outside of the box that it has left";
  for (std::size_t i = 0; i < 6; ++i) EXPECT_NEAR(l.truth().q[i], rest.q[i], 1e-4);
}

TEST(Halt, LetDownItSinksSlowlyAndEndsWithoutTorque) {
  ControlLoop l = loop(AfterHalt::lower, leaves_the_box);
  while (l.supervisor().state() != State::lowering) ASSERT_LT(l.tick().running_tick, 1000U);
  const double height = l.truth().q[1];
  double fastest = 0.0;
  int ticks = 0;
  for (; l.supervisor().state() == State::lowering; ++ticks) {
    l.tick();
    fastest = std::max(fastest, speed(l));
  }
  EXPECT_NEAR(ticks, 500, 3);
  EXPECT_EQ(l.supervisor().state(), State::fault);
  EXPECT_EQ(largest(l.result().torque), 0.0);
  EXPECT_LT(l.truth().q[1], height);
  EXPECT_LT(fastest, 0.1 * 50.0)
      << "a tenth of joint_speed, where damping alone takes the whole torque limit";
}

TEST(Halt, ReleasedItFallsOnlyAfterItCameToRest) {
  ControlLoop l = loop(AfterHalt::release, leaves_the_box);
  while (l.supervisor().state() != State::fault) ASSERT_LT(l.tick().running_tick, 1000U);
  EXPECT_LT(speed(l), 0.1) << "one tick without torque";
  EXPECT_EQ(largest(l.result().torque), 0.0);
  EXPECT_EQ(l.supervisor().fault(), Fault::workspace);
}

TEST(Halt, WhatCannotBeTrustedIsNotBraked) {
  // The same limits crossed without halt_ticks, and a singularity with them: no torque from that tick on.
  ControlLoop l = loop(AfterHalt::hold, [](Config& c) {
    leaves_the_box(c);
    c.halt_ticks = 0;
  });
  while (l.ticks() == 0 || l.supervisor().running()) l.tick();
  EXPECT_EQ(l.supervisor().state(), State::fault);
  EXPECT_EQ(largest(l.result().torque), 0.0);
  ControlLoop near = loop(AfterHalt::hold, [](Config& c) { c.limits.min_abs_sin_type2 = 0.9; });
  while (near.ticks() == 0 || near.supervisor().running()) ASSERT_LT(near.tick().running_tick, 600U);
  EXPECT_EQ(near.supervisor().state(), State::fault);
  EXPECT_EQ(near.supervisor().fault(), Fault::type2_singularity);
  EXPECT_EQ(largest(near.result().torque), 0.0);
}

TEST(Halt, AMotorTooWeakToBrakeIsAFaultOfItsOwnNotForEver) {
  ControlLoop l = loop(AfterHalt::hold, [](Config& c) {
    leaves_the_box(c);
    c.halt_ticks = 4;  // 6 rad/s in 4 ms is more than 0.3 N m can do
    c.torque_limit.setConstant(0.3);
  });
  while (l.ticks() == 0 || l.supervisor().running()) l.tick();
  for (int n = 0; l.supervisor().powered(); ++n) {
    ASSERT_LT(n, 20) << "neither at rest nor given up";
    l.tick();
  }
  EXPECT_EQ(l.supervisor().count(Fault::halt_failed), 1U);
  EXPECT_EQ(l.supervisor().fault(), Fault::workspace) << "the first name stays";
}

// ---- the way onto the reference

TEST(Join, AWayThatNeedsMoreSpeedOrTorqueThanAllowedIsNotTaken) {
  const auto joins = [](std::uint32_t ticks, double speed_limit, double torque_limit,
                        esmc::Motors motors = esmc::Motors::base) {
    LoopSetup s;
    s.motors = motors;
    s.start = esmc::host::V2{0.0, 0.2};
    s.hold = esmc::host::V2{0.0, 0.23};
    s.torque_limit = torque_limit;
    s.adjust = [=](Config& c) {
      c.join_ticks = ticks;
      c.limits.joint_speed = speed_limit;
    };
    ControlLoop l(s);
    for (std::uint32_t n = 0; n < ticks + 20; ++n) l.tick();
    return l.supervisor().fault();
  };
  EXPECT_EQ(joins(500, 50.0, 2.0), Fault::none);
  EXPECT_EQ(joins(20, 50.0, 2.0), Fault::join_infeasible) << "torque";
  EXPECT_EQ(joins(500, 0.2, 2.0), Fault::join_infeasible) << "speed";
  // Four share it, and have limits all the same.
  const auto four = esmc::Motors::all;
  EXPECT_EQ(joins(500, 50.0, 2.0, four), Fault::none);
  EXPECT_EQ(joins(20, 50.0, 20.0, four), Fault::none);
  EXPECT_EQ(joins(20, 50.0, 1.0, four), Fault::join_infeasible);
}

TEST(Join, IsRefusedBeforeItHasGoneFar) {
  LoopSetup s;
  s.start = esmc::host::V2{0.0, 0.2};
  s.hold = esmc::host::V2{0.0, 0.25};
  s.adjust = [](Config& c) {
    c.join_ticks = 300;
    c.limits.joint_speed = 1.0;
  };
  ControlLoop l(s);
  while (l.ticks() == 0 || l.supervisor().running()) ASSERT_LT(l.tick().running_tick, 17U);
  EXPECT_NEAR(l.truth().q[1], 0.2, 1e-4);
}

// ---- sign test

/// State that the test of a loop ends in, and how far a base joint got in it.
struct Tested {
  State state;
  Fault fault;
  double moved, torque;
  int ticks;
};
template <class Change>
Tested sign_test(const Change& change) {
  LoopSetup s;
  s.start = esmc::host::V2{0.06, 0.19};  // not its own mirror image
  s.hold = s.start;
  s.adjust = [](Config& c) { c.sign_test_move = 2e-3; };
  change(s);
  ControlLoop l(s);
  const auto start = l.truth();
  Tested t{State::testing, Fault::none, 0.0, 0.0, 0};
  esmc::Vec<double, 4> weight{};
  do {
    l.tick();
    if (t.ticks++ == 0) weight = l.result().torque;
    for (const std::size_t i : {2U, 4U}) t.moved = std::max(t.moved, std::abs(l.truth().q[i] - start.q[i]));
    if (l.supervisor().state() == State::testing)
      t.torque = std::max(t.torque, largest(l.result().torque - weight));
  } while (l.supervisor().state() == State::testing && t.ticks < 1000);
  t.state = l.supervisor().state();
  t.fault = l.supervisor().fault();
  return t;
}

TEST(SignTest, AMechanismThatAnswersAsItsModelRuns) {
  const Tested t = sign_test([](LoopSetup&) {});
  EXPECT_EQ(t.state, State::running) << name(t.fault);
  EXPECT_LT(t.moved, 0.015) << "a few times the move asked for";
  EXPECT_GT(t.moved, 2e-3);
  EXPECT_LE(t.torque, 2 * 0.05 * 2.0 + 0.02) << "5 % of the limit, up and down again";
}

/// A supervisor that does not go on, although both motors have answered.
TEST(SignTest, NothingMoreIsTestedAfterItHasPassed) {
  LoopSetup setup;
  setup.adjust = [](Config& c) { c.sign_test_move = 2e-3; };
  ControlLoop l(setup);
  while (l.supervisor().state() != State::running) {
    l.tick();
    ASSERT_LT(l.ticks(), 2000U);
    ASSERT_NE(l.supervisor().state(), State::fault);
  }
  esmc::Controller<FiveBar<double>> c = l.controller();
  esmc::Supervisor stuck(c.supervision());
  stuck.begin_tick(esmc::Command::enable, {});
  stuck.begin_tick(esmc::Command::none, {.all_ready = true, .all_idle = false});
  ASSERT_EQ(stuck.state(), State::testing);
  const auto first = c.tick(l.sample(), stuck);
  for (int i = 0; i < 300; ++i) {
    const auto again = c.tick(l.sample(), stuck);
    EXPECT_TRUE(again.stage_done);
    EXPECT_EQ(again.torque, first.torque) << "the weight, and no pulse";
  }
  EXPECT_EQ(stuck.state(), State::testing);
}

TEST(SignTest, AMotorThatTurnsTheOtherWayIsFound) {
  for (const int joint : {0, 2}) {
    const Tested t = sign_test(
        [&](LoopSetup& s) { s.wiring = [joint](esmc::Vec<double, 4>& tau) { tau[joint] = -tau[joint]; }; });
    EXPECT_EQ(t.fault, Fault::sign_test) << joint;
    EXPECT_LT(t.moved, 0.03);
  }
}

TEST(SignTest, CommandsThatReachTheOtherMotorAreFound) {
  const Tested t = sign_test(
      [&](LoopSetup& s) { s.wiring = [](esmc::Vec<double, 4>& tau) { std::swap(tau[0], tau[2]); }; });
  EXPECT_EQ(t.fault, Fault::sign_test);
  EXPECT_LT(t.moved, 0.03);
}

TEST(SignTest, AMotorWithoutTorqueIsFound) {
  for (const int joint : {0, 2}) {
    const Tested t = sign_test([&](LoopSetup& s) {
      s.truth.g = s.believed.g = 0.0;
      s.wiring = [joint](esmc::Vec<double, 4>& tau) { tau[joint] = 0.0; };
    });
    EXPECT_EQ(t.fault, Fault::sign_test) << joint;
  }
}

TEST(SignTest, WrongMassesPass) {
  for (const double factor : {0.7, 1.4}) {
    const Tested t = sign_test([&](LoopSetup& s) {
      s.truth.g = s.believed.g = 0.0;
      s.believed = esmc::test::scaled_bars(s.truth, factor);
    });
    EXPECT_EQ(t.state, State::running) << factor << ' ' << name(t.fault);
  }
}

TEST(SignTest, AJointThatFivePercentCannotMoveIsNotTested) {
  const Tested t = sign_test([](LoopSetup& s) {
    s.torque_limit = 1e-4;
    s.truth.g = s.believed.g = 0.0;
  });
  EXPECT_EQ(t.fault, Fault::sign_test);
  EXPECT_EQ(t.ticks, 1);
}

// ---- torque ramps in

/// What was carried by a brake, or by the sign test, a tick before does not fall while the law's torque
/// rises.
TEST(Ramp, TheWeightIsCarriedFromTheFirstTickOn) {
  for (const bool four : {false, true}) {
    for (const bool tested : {false, true}) {
      if (four && tested) continue;  // no sign test with four motors
      double most = 0.0;
      for (const int ramp : {1, 200}) {
        LoopSetup s;
        s.start = s.hold = esmc::host::V2{0.06, 0.19};
        s.motors = four ? esmc::Motors::all : esmc::Motors::base;
        s.adjust = [&](Config& c) {
          c.ramp_ticks = static_cast<std::uint32_t>(ramp);
          if (tested) c.sign_test_move = 2e-3;
          if (four) c.preload = {0.1, -0.1, 0.1, -0.1};
        };
        ControlLoop l(s);
        while (l.supervisor().state() != State::running) {
          l.tick();
          ASSERT_LT(l.ticks(), 2000U);
          ASSERT_NE(l.supervisor().state(), State::fault);
        }
        const auto begun = l.truth();
        double moved = 0.0;
        for (int n = 0; n < 300; ++n) {
          l.tick();
          for (const std::size_t i : {2U, 4U}) moved = std::max(moved, std::abs(l.truth().q[i] - begun.q[i]));
        }
        EXPECT_EQ(l.supervisor().state(), State::running);
        if (ramp == 1) most = moved;
        EXPECT_LT(moved, 2 * most + 1e-3) << four << tested;
      }
    }
  }
}

// ---- samples that do not fit each other

TEST(Jump, AnAngleThatMovedWithoutItsRateIsAFault) {
  for (const double off : {0.9e-3, 1.1e-3, -0.9e-3, -1.1e-3, 0.1}) {
    for (const double rate : {0.0, 3.0}) {
      auto s = esmc::test::setup<FiveBar<double>>();
      s.controller.limits.feedback_jump = 1e-3;
      esmc::test::Rig<FiveBar<double>> rig(s);
      ASSERT_TRUE(rig.start());
      rig.rate[0] = rate;
      rig.angle[0] += rate * tick + off;
      const auto r = rig.tick();
      EXPECT_EQ(r.fault, std::abs(off) > 1e-3 ? Fault::feedback_jump : Fault::none) << off << ' ' << rate;
    }
  }
}

TEST(Jump, ATickLateEachTimeItIsAFaultOfTheCycle) {
  auto s = esmc::test::setup<FiveBar<double>>();
  s.controller.limits.feedback_jump = 1e-3;
  s.controller.limits.max_age_ticks = 2;
  esmc::Controller<FiveBar<double>> c(s.controller);
  for (const double off : {0.9e-3, 1.1e-3}) {
    esmc::Controller<FiveBar<double>> one = c;
    esmc::Supervisor v(one.supervision());
    v.begin_tick(esmc::Command::enable, {});
    esmc::Sample<FiveBar<double>> m;
    for (int j = 0; j < 4; ++j) m.angle[j] = s.angle[static_cast<std::size_t>(j)];
    m.age_ticks.fill(1);
    for (int n = 0; n < 3; ++n) {
      v.begin_tick(esmc::Command::none, {.all_ready = true, .all_idle = false});
      EXPECT_EQ(one.tick(m, v).fault, Fault::none);
    }
    m.angle[0] += off;
    v.begin_tick(esmc::Command::none, {});
    EXPECT_EQ(one.tick(m, v).fault, off > 1e-3 ? Fault::feedback_jump : Fault::none);
  }
}

}  // namespace
