/// The states of the control cycle as the bus sees them: which frames go out in which state and when.

#include <gtest/gtest.h>

#include <array>
#include <cstdint>
#include <utility>

#include "tests/support/cycle_rig.hpp"

namespace {

using namespace esmc;
using test::Rig;
using test::Setup;
using test::setup;

template <class M>
class ControlCycle : public testing::Test {};
using Machines = testing::Types<FiveBar<double>, Rr<float>>;
TYPED_TEST_SUITE(ControlCycle, Machines);

/// Not zero in at least one motor: the opposite of `all_zero` is not enough where frames could be missing.
template <class M>
bool pushes(const Rig<M>& rig) {
  bool any = false;
  for (std::size_t i = 0; i < rig.motors(); ++i) any = any || rig.shaft_torque(rig.axis_of_motor(i)) != 0.0F;
  return any && rig.torque_frames() == static_cast<int>(rig.motors());
}

TYPED_TEST(ControlCycle, TorqueFramesAreZeroInEveryStateButRunning) {
  Rig<TypeParam> rig;
  for (int i = 0; i < 10; ++i) {
    EXPECT_EQ(rig.tick().state, State::disabled);
    EXPECT_TRUE(rig.all_zero());
    EXPECT_EQ(rig.bus.sent().size(), rig.motors()) << "nothing but the torque frames while disabled";
  }
  rig.obedient = false;
  rig.tick(Command::enable);
  for (int i = 0; i < 10; ++i) {
    EXPECT_EQ(rig.tick().state, State::enabling);
    EXPECT_TRUE(rig.all_zero());
  }
  rig.state.fill(8);
  while (rig.tick().state == State::enabling) EXPECT_TRUE(rig.all_zero());
  EXPECT_EQ(rig.cycle.supervisor().state(), State::running);
  EXPECT_TRUE(pushes(rig));
  EXPECT_EQ(rig.tick(Command::stop).state, State::stopping);
  EXPECT_TRUE(rig.all_zero()) << "in the very tick of the command";
  for (int i = 0; i < 10; ++i) {
    EXPECT_EQ(rig.tick().state, State::stopping);
    EXPECT_TRUE(rig.all_zero());
  }
  rig.bus.push(test::message(rig.node(0), test::cmd_encoder, 0, 0, 7));
  for (int i = 0; i < 10; ++i) {
    EXPECT_EQ(rig.tick().state, State::fault);
    EXPECT_TRUE(rig.all_zero());
  }
}

TYPED_TEST(ControlCycle, EnablingSendsModeThenStatePerAxisBeforeItsTorqueFrame) {
  Rig<TypeParam> rig;
  for (const unsigned step : {test::cmd_mode, test::cmd_axis_state}) {
    rig.tick(Command::enable);
    const auto sent = rig.bus.sent();
    ASSERT_EQ(sent.size(), 2 * rig.motors());
    const unsigned order[] = {step, test::cmd_torque};
    for (std::size_t i = 0; i < sent.size(); ++i) {
      EXPECT_EQ(test::node_of(sent[i]), rig.node(i / 2));
      EXPECT_EQ(test::command_of(sent[i]), order[i % 2]);
    }
  }
  EXPECT_TRUE(rig.asked(0, 8) && rig.asked(1, 8));
}

/// The queue takes `room` frames per tick and drops the others, mode frames of either axis among them. An
/// axis that is asked into closed loop must have been configured in an earlier tick.
TYPED_TEST(ControlCycle, NoAxisIsArmedBeforeTheBusTookItsMode) {
  for (std::size_t room = 0; room < 5; ++room) {
    Rig<TypeParam> rig;
    std::array<bool, 2> configured{}, armed{};
    rig.bus.answer(hal::SendStatus::bus_full, room);
    rig.tick(Command::enable);
    for (int i = 0; i < 40; ++i) {
      for (std::size_t axis = 0; axis < 2; ++axis) {
        armed[axis] = armed[axis] || rig.asked(axis, 8);
        ASSERT_TRUE(!armed[axis] || configured[axis]) << "axis " << axis << " tick " << i << " room " << room;
        configured[axis] = configured[axis] || rig.count(axis, test::cmd_mode) > 0;
      }
      rig.bus.answer(i < 20 ? hal::SendStatus::bus_full : hal::SendStatus::ok, room);
      rig.tick();
    }
    EXPECT_TRUE(armed[0] && armed[1]);
    EXPECT_EQ(rig.cycle.supervisor().state(), State::running);
  }
}

/// The tick that hears the second confirmation of the last axis still belongs to enabling; the next one runs.
TYPED_TEST(ControlCycle, RunsInTheTickAfterEveryAxisBecameReady) {
  Rig<TypeParam> rig;
  rig.obedient = false;
  rig.tick(Command::enable);
  rig.tick();
  ASSERT_TRUE(rig.asked(0, 8) && rig.asked(1, 8));
  rig.sends_heartbeat.fill(false);
  const auto confirm = [&](std::size_t axis) { rig.bus.push(test::heartbeat(rig.node(axis), 8)); };
  EXPECT_EQ(rig.tick().state, State::enabling);
  confirm(0);
  EXPECT_EQ(rig.tick().state, State::enabling);
  confirm(0);
  EXPECT_EQ(rig.tick().state, State::enabling) << "one of two axes is ready";
  confirm(1);
  EXPECT_EQ(rig.tick().state, State::enabling);
  EXPECT_TRUE(rig.all_zero());
  confirm(1);
  EXPECT_EQ(rig.tick().state, State::enabling);
  EXPECT_TRUE(rig.all_zero());
  const auto first = rig.tick();
  EXPECT_EQ(first.state, State::running);
  EXPECT_EQ(first.running_tick, 0U);
  EXPECT_TRUE(pushes(rig));
  EXPECT_EQ(rig.tick().running_tick, 1U);
}

/// What it observes before it is armed and after a fault is what it will run from; without samples it says
/// nothing.
TYPED_TEST(ControlCycle, TellsWhereTheMechanismIsInEveryState) {
  Rig<TypeParam> rig;
  const auto disabled = rig.tick();
  ASSERT_EQ(disabled.state, State::disabled);
  EXPECT_TRUE((disabled.torque.array() == typename TypeParam::Scalar(0)).all());
  ASSERT_TRUE(rig.start());
  rig.tick(Command::stop);
  const auto stopping = rig.tick();
  EXPECT_NE(stopping.state, State::running);
  Rig<TypeParam> other;
  ASSERT_TRUE(other.start());
  const auto running = other.tick();
  ASSERT_EQ(running.state, State::running);
  EXPECT_TRUE((running.effector.array() != typename TypeParam::Scalar(0)).any());
  for (int i = 0; i < 2; ++i) {
    EXPECT_NEAR(disabled.effector[i], running.effector[i], 1e-6);
    EXPECT_NEAR(stopping.effector[i], running.effector[i], 1e-6);
  }
  Rig<TypeParam> silent;
  EXPECT_TRUE((silent.bare_tick().effector.array() == typename TypeParam::Scalar(0)).all());
}

TYPED_TEST(ControlCycle, EnablingWaitsForADriveWithErrorsAndAsksAgain) {
  Setup<TypeParam> s = setup<TypeParam>();
  s.retry_ticks = 5;
  Rig<TypeParam> rig(s);
  rig.error[1] = 0x200;
  rig.tick(Command::enable);
  int again = 0;
  for (int i = 0; i < 60; ++i) {
    ASSERT_EQ(rig.tick().state, State::enabling) << "an error of a drive being enabled is no fault";
    again += rig.count(1, test::cmd_clear_errors);
    ASSERT_FALSE(rig.asked(1, 8)) << "it would refuse, or arm with what it has forgotten";
  }
  EXPECT_GE(again, 10);
  EXPECT_LE(again, 12) << "every retry";
  rig.error[1] = 0;
  EXPECT_TRUE(rig.until(State::running, 5));
}

/// An order that is broken off between mode and closed loop leaves an axis idle, which is then told nothing:
/// the next order begins with the mode, for somebody may have changed it since.
TYPED_TEST(ControlCycle, AnOrderToEnableBeginsWithTheMode) {
  for (const Command end : {Command::stop, Command::halt}) {
    Rig<TypeParam> rig;
    rig.tick();
    rig.tick(Command::enable);
    ASSERT_EQ(rig.count(0, test::cmd_mode), 1);
    rig.tick(end);
    ASSERT_TRUE(rig.until(State::disabled, 10));
    for (int i = 0; i < 50; ++i) rig.tick();
    rig.tick(Command::enable);
    for (const std::size_t axis : {0U, 1U}) {
      EXPECT_EQ(rig.count(axis, test::cmd_mode), 1);
      EXPECT_FALSE(rig.asked(axis, 8));
    }
    EXPECT_TRUE(rig.until(State::running, 40));
  }
}

/// Somebody presses the emergency stop before or while the axes are enabled: clearing that error and asking
/// again, as is right for what was left over from before, would take the stop back.
TYPED_TEST(ControlCycle, AnEmergencyStopWhileEnablingIsNotClearedAway) {
  for (const auto& [version, estop] : {std::pair{drive::odrive::Version::v0_6, 0x02000000U},
                                       std::pair{drive::odrive::Version::v0_5_6, 0x00004000U}}) {
    for (int before = 0; before < 8; ++before) {  // ticks of enabling
      Setup<TypeParam> s = setup<TypeParam>();
      s.version = version;
      s.retry_ticks = 5;
      Rig<TypeParam> rig(s);
      rig.error[0] = 0x200;  // a motive to clear
      if (before > 0) rig.tick(Command::enable);
      for (int i = 1; i < before; ++i) rig.tick();
      rig.state[1] = 1;
      rig.error[1] = estop;
      rig.obedient = false;
      EXPECT_EQ(rig.tick(before > 0 ? Command::none : Command::enable).fault, Fault::emergency_stop);
      for (int i = 0; i < 30; ++i) {
        ASSERT_TRUE(rig.all_zero());
        ASSERT_EQ(rig.count(0, test::cmd_clear_errors) + rig.count(1, test::cmd_clear_errors), 0);
        ASSERT_FALSE(rig.asked(0, 8) || rig.asked(1, 8));
        rig.tick();
      }
    }
  }
}

/// Firmware 0.5.6 clears the errors of both axes of a board. So nothing is cleared on one axis while the
/// other one's heartbeat, every 10 ms, has not come yet or is overdue: its samples alone do not tell of a
/// stop.
TYPED_TEST(ControlCycle, NoErrorIsClearedWhileAnotherAxisMayBeStopped) {
  for (const auto version : {drive::odrive::Version::v0_6, drive::odrive::Version::v0_5_6}) {
    const bool both = version == drive::odrive::Version::v0_5_6;
    for (const bool heard_before : {false, true}) {
      Setup<TypeParam> s = setup<TypeParam>();
      s.version = version;
      s.retry_ticks = 5;
      Rig<TypeParam> rig(s);
      rig.obedient = false;
      if (heard_before) rig.tick();
      rig.sends_heartbeat[1] = false;
      for (std::uint32_t i = 0; heard_before && i <= s.heartbeat_age_ticks_max; ++i) rig.tick();
      rig.error[0] = 0x200;
      rig.tick(Command::enable);
      int cleared = 0;
      for (int i = 0; i < 10; ++i) {
        EXPECT_EQ(rig.tick().state, State::enabling);
        cleared += rig.count(0, test::cmd_clear_errors);
      }
      EXPECT_EQ(cleared > 0, !both);
      rig.sends_heartbeat[1] = true;
      if (heard_before) {  // it reports no stop
        for (int i = 0; i < 10; ++i) {
          rig.tick();
          cleared += rig.count(0, test::cmd_clear_errors);
        }
        EXPECT_GT(cleared, 0);
        continue;
      }
      rig.error[1] = both ? 0x4000U : 0x0200'0000U;
      EXPECT_EQ(rig.tick().fault, Fault::emergency_stop);
      EXPECT_EQ(rig.count(0, test::cmd_clear_errors), 0);
    }
  }
}

/// Seen on the bus it needs no heartbeat: not from the axis it was meant for, and not from any with 0x7E2.
TYPED_TEST(ControlCycle, AnEmergencyStopOnTheBusStrikesInTheTickThatHearsIt) {
  for (const unsigned node : {Rig<TypeParam>::node(0), Rig<TypeParam>::node(1), 0x3FU}) {
    for (const bool running : {false, true}) {
      Rig<TypeParam> rig;
      rig.tick(Command::enable);
      if (running) {
        ASSERT_TRUE(rig.until(State::running));
      }
      rig.bus.push(test::message(node, 0x02, 0, 0, 0));
      EXPECT_EQ(rig.tick().fault, Fault::emergency_stop);
      EXPECT_TRUE(rig.all_zero());
      for (int i = 0; i < 30; ++i) {
        rig.tick();
        ASSERT_EQ(rig.cycle.supervisor().state(), State::fault);
        ASSERT_FALSE(rig.asked(0, 8) || rig.asked(1, 8));
      }
    }
  }
}

/// Pressed while disabled, or while something else is wrong: no reset of an operator has been for it.
TYPED_TEST(ControlCycle, AnUnreportedEmergencyStopIsNamedAtTheNextEnabling) {
  for (const bool faulty : {false, true}) {
    Rig<TypeParam> rig;
    if (faulty) {
      ASSERT_TRUE(rig.start());
      rig.error[0] = 1;
      EXPECT_EQ(rig.tick().fault, Fault::drive_error);
      rig.error[0] = 0;
    }
    rig.bus.push(test::message(rig.node(1), 0x02, 0, 0, 0));
    rig.tick();
    rig.tick(Command::reset);
    EXPECT_EQ(rig.tick().state, State::disabled);
    EXPECT_EQ(rig.tick(Command::enable).fault, Fault::emergency_stop);
    rig.tick(Command::reset);
    EXPECT_TRUE(rig.start());
  }
}

/// The operator resets the first one and has not seen the second.
TYPED_TEST(ControlCycle, AnEmergencyStopInTheTickOfTheResetIsNotAcknowledgedByIt) {
  Rig<TypeParam> rig;
  ASSERT_TRUE(rig.start());
  rig.bus.push(test::message(rig.node(0), 0x02, 0, 0, 0));
  EXPECT_EQ(rig.tick().fault, Fault::emergency_stop);
  for (int i = 0; i < 5; ++i) rig.tick();
  rig.bus.push(test::message(rig.node(1), 0x02, 0, 0, 0));
  rig.tick(Command::reset);
  rig.tick();
  EXPECT_EQ(rig.tick(Command::enable).fault, Fault::emergency_stop);
  rig.tick(Command::reset);
  EXPECT_TRUE(rig.start());
}

/// An emergency stop ends the run; the operator's reset and enable clear its error, once, and it runs again.
TYPED_TEST(ControlCycle, AfterAnEmergencyStopResetAndEnableWork) {
  for (const bool running : {false, true}) {
    Rig<TypeParam> rig;
    rig.tick(Command::enable);
    rig.tick();
    if (running) {
      ASSERT_TRUE(rig.until(State::running));
    }
    rig.error[1] = 0x02000000;
    rig.state[1] = 1;
    EXPECT_EQ(rig.tick().fault, Fault::emergency_stop);
    EXPECT_TRUE(rig.all_zero());
    for (int i = 0; i < 5; ++i) rig.tick();
    rig.tick(Command::reset);
    EXPECT_EQ(rig.tick().state, State::disabled);
    EXPECT_EQ(rig.tick(Command::enable).state, State::enabling);
    EXPECT_EQ(rig.tick().state, State::enabling);
    ASSERT_EQ(rig.count(1, test::cmd_clear_errors), 1) << "running " << running;
    rig.error[1] = 0;
    EXPECT_TRUE(rig.until(State::running)) << name(rig.cycle.supervisor().fault());
  }
}

TYPED_TEST(ControlCycle, StoppingAsksForIdleUntilEveryAxisSaysSo) {
  Rig<TypeParam> rig;
  ASSERT_TRUE(rig.start());
  rig.obedient = false;
  rig.tick(Command::stop);
  EXPECT_TRUE(rig.asked(0, 1) && rig.asked(1, 1));
  rig.state[0] = 1;
  for (int i = 0; i < 20; ++i) {
    EXPECT_EQ(rig.tick().state, State::stopping);
    EXPECT_FALSE(rig.asked(0, 1)) << "it is idle";
    EXPECT_TRUE(rig.asked(1, 1)) << "the frame may have been lost";
    EXPECT_FALSE(rig.asked(0, 8) || rig.asked(1, 8));
  }
  EXPECT_FALSE(rig.cycle.all_idle());
  rig.state[1] = 1;
  EXPECT_TRUE(rig.until(State::disabled, 2));
  EXPECT_TRUE(rig.cycle.all_idle());
}

TYPED_TEST(ControlCycle, RunsAgainAfterStopAndAfterReset) {
  Rig<TypeParam> rig;
  for (int round = 0; round < 3; ++round) {
    ASSERT_TRUE(rig.start()) << round;
    EXPECT_TRUE(pushes(rig));
    for (int i = 1; i < 10; ++i) EXPECT_EQ(rig.tick().running_tick, static_cast<std::uint32_t>(i));
    rig.tick(Command::stop);
    EXPECT_TRUE(rig.until(State::disabled, 3));
    ASSERT_TRUE(rig.start()) << round;
    rig.error[0] = 1;
    EXPECT_EQ(rig.tick().fault, Fault::drive_error);
    rig.error[0] = 0;
    for (int i = 0; i < 3; ++i) rig.tick();
    EXPECT_EQ(rig.tick(Command::reset).state, State::disabled);
    EXPECT_EQ(rig.tick().fault, Fault::none);
  }
}

/// An axis that dropped out by itself waits for no retry of an earlier attempt.
TYPED_TEST(ControlCycle, EveryAttemptToEnableBeginsByAskingEveryAxis) {
  Rig<TypeParam> rig;
  ASSERT_TRUE(rig.start());
  rig.state[0] = 1;
  EXPECT_EQ(rig.tick().fault, Fault::drive_disarmed);
  rig.tick();
  rig.tick(Command::reset);
  rig.tick(Command::enable);
  EXPECT_EQ(rig.count(0, test::cmd_mode), 1);
  EXPECT_EQ(rig.count(1, test::cmd_mode), 1);
  rig.tick();
  EXPECT_TRUE(rig.asked(0, 8));
  EXPECT_TRUE(rig.asked(1, 8));
}

TYPED_TEST(ControlCycle, ACommandLastsOneTick) {
  Rig<TypeParam> rig;
  rig.tick(Command::reset);
  rig.tick(Command::stop);
  EXPECT_EQ(rig.tick().state, State::disabled);
  ASSERT_TRUE(rig.start());
  rig.tick(Command::enable);  // already running: nothing, now or later
  rig.tick(Command::stop);
  for (int i = 0; i < 5; ++i) rig.tick();
  EXPECT_EQ(rig.cycle.supervisor().state(), State::disabled);
}

/// Two callers in one tick, an operator's stop and anything else: the stop must not be lost.
TYPED_TEST(ControlCycle, AStopIsNotOverwrittenAndAHaltByAStopOnly) {
  for (const Command first : {Command::stop, Command::halt}) {
    for (const Command later :
         {Command::none, Command::enable, Command::reset, Command::halt, Command::stop}) {
      auto s = test::setup<TypeParam>();
      s.controller.halt_ticks = 50;
      Rig<TypeParam> rig(s);
      ASSERT_TRUE(rig.start());
      rig.cycle.command(first);
      rig.cycle.command(later);
      const bool stops = first == Command::stop || later == Command::stop;
      EXPECT_EQ(rig.tick().state, stops ? State::stopping : State::halting) << static_cast<int>(later);
    }
  }
}

/// Lockstep without a complete set: nobody waits for an answer.
TYPED_TEST(ControlCycle, AnUnansweredTickSendsNoTorque) {
  Rig<TypeParam> rig;
  ASSERT_TRUE(rig.start());
  EXPECT_EQ(rig.tick(Command::none, false).state, State::running);
  EXPECT_EQ(rig.torque_frames(), 0);
  EXPECT_EQ(rig.tick().state, State::running);
  EXPECT_TRUE(pushes(rig));
}

TYPED_TEST(ControlCycle, AFaultInAnUnansweredTickStillAsksForIdle) {
  Rig<TypeParam> rig;
  ASSERT_TRUE(rig.start());
  rig.error[0] = 1;
  EXPECT_EQ(rig.tick(Command::none, false).state, State::fault);
  EXPECT_TRUE(rig.asked(0, 1) && rig.asked(1, 1));
}

TYPED_TEST(ControlCycle, ASetIsCompleteWhenEveryAxisHasSentASample) {
  Rig<TypeParam> rig;
  EXPECT_FALSE(rig.cycle.complete() || rig.cycle.set_begun()) << "nothing received yet";
  rig.push_encoder(0);
  rig.cycle.receive(rig.bus);
  EXPECT_TRUE(rig.cycle.set_begun());
  EXPECT_FALSE(rig.cycle.complete());
  rig.push_heartbeat(1);
  rig.cycle.receive(rig.bus);
  EXPECT_FALSE(rig.cycle.complete()) << "a heartbeat is not a sample";
  rig.push_encoder(1);
  rig.cycle.receive(rig.bus);
  EXPECT_TRUE(rig.cycle.complete());
  (void)rig.cycle.tick(rig.bus);
  EXPECT_FALSE(rig.cycle.complete()) << "that set was used";
  rig.cycle.receive(rig.bus);
  EXPECT_FALSE(rig.cycle.complete());
}

TYPED_TEST(ControlCycle, ReceivingSeveralTimesInATickAgesOnce) {
  Rig<TypeParam> rig;
  rig.tick();
  for (int i = 0; i < 5; ++i) rig.cycle.receive(rig.bus);
  rig.bare_tick();
  EXPECT_EQ(rig.cycle.sample().age_ticks[0], 1U);
  (void)rig.cycle.tick(rig.bus);  // without a receive: a tick all the same
  EXPECT_EQ(rig.cycle.sample().age_ticks[0], 2U);
}

// ---- what an axis may be left in

/// Heartbeats come every 100 ms, so that the last one is older than the request. Stopped (or failed) before
/// the next one, the cycle believes the old "idle" and must not leave the axes armed for that.
TYPED_TEST(ControlCycle, StopWhileEnablingLeavesNoAxisArmed) {
  Rig<TypeParam> rig;
  rig.tick(Command::enable);
  rig.tick();
  rig.sends_heartbeat.fill(false);
  ASSERT_EQ(rig.state[0], 8) << "the drives have obeyed, and not yet reported it";
  rig.tick(Command::stop);
  for (int i = 0; i < 300; ++i) {
    rig.sends_heartbeat.fill(i % 100 == 60);
    rig.tick();
  }
  EXPECT_EQ(rig.state[0], 1) << "state " << name(rig.cycle.supervisor().state());
  EXPECT_EQ(rig.state[1], 1) << "state " << name(rig.cycle.supervisor().state());
}

/// The same when it ends in a fault and the first request for idle is lost: it is repeated until a heartbeat
/// that is newer than the request says idle.
TYPED_TEST(ControlCycle, IdleIsAskedForAsLongAsOnlyAnOldHeartbeatSaysIdle) {
  for (const bool fault : {false, true}) {
    Rig<TypeParam> rig;
    rig.tick(Command::enable);
    rig.tick();
    rig.sends_heartbeat.fill(false);
    ASSERT_EQ(rig.state[0], 8);
    rig.bus.answer(hal::SendStatus::bus_full);
    if (fault) rig.bus.push(test::message(rig.node(0), test::cmd_encoder, 0, 0, 3));
    rig.tick(fault ? Command::none : Command::stop);
    rig.bus.answer(hal::SendStatus::ok);
    for (int i = 0; i < 50; ++i) {
      rig.tick();
      ASSERT_TRUE(rig.asked(0, 1) && rig.asked(1, 1))
          << name(rig.cycle.supervisor().state()) << " tick " << i;
    }
    rig.sends_heartbeat.fill(true);
    rig.tick();
    rig.tick();
    EXPECT_FALSE(rig.asked(0, 1) || rig.asked(1, 1)) << "they have said idle";
  }
}

/// The idle requests are lost (queue full) and the operator resets at once: the axes still stand armed.
TYPED_TEST(ControlCycle, ResetDoesNotForgetAnAxisThatIsStillArmed) {
  Rig<TypeParam> rig;
  ASSERT_TRUE(rig.start());
  rig.error[1] = 1;
  rig.bus.answer(hal::SendStatus::bus_full);
  EXPECT_EQ(rig.tick().state, State::fault);
  rig.bus.answer(hal::SendStatus::ok);
  rig.tick(Command::reset);
  for (int i = 0; i < 300; ++i) rig.tick();
  EXPECT_EQ(rig.state[0], 1) << "state " << name(rig.cycle.supervisor().state());
}

}  // namespace
