/// The supervisor against a table written out by hand, and the reactions against a list of what may be
/// brought to rest.

#include <gtest/gtest.h>

#include <algorithm>
#include <set>
#include <string>
#include <vector>

#include "firmware/safety/supervisor.hpp"

namespace {

using esmc::AfterHalt;
using esmc::Command;
using esmc::DriveStatus;
using esmc::Fault;
using esmc::State;
using esmc::Supervisor;

const std::vector<Command> commands{Command::none, Command::enable, Command::stop, Command::halt,
                                    Command::reset};
// confirm_zero is the cycle's: to the supervisor it is none.
const std::vector<State> states{State::disabled, State::enabling, State::testing,
                                State::running,  State::halting,  State::holding,
                                State::lowering, State::stopping, State::fault};
const std::vector<AfterHalt> ends{AfterHalt::release, AfterHalt::hold, AfterHalt::lower};
/// After these the state is known and the drives obey.
const std::set<Fault> gentle{Fault::workspace,       Fault::joint_angle,  Fault::reference_unreachable,
                             Fault::join_infeasible, Fault::command_lost, Fault::tick_late,
                             Fault::home_no_stop};

std::vector<Fault> faults() {
  std::vector<Fault> all;
  for (int i = 1; i < esmc::fault_count; ++i) all.push_back(static_cast<Fault>(i));
  return all;
}

/// A supervisor that halts, in a state; with a gentle fault latched in those that follow one, if asked for.
Supervisor in(State s, AfterHalt end = AfterHalt::hold, Fault why = Fault::none) {
  const AfterHalt way =
      s == State::holding ? AfterHalt::hold : (s == State::lowering ? AfterHalt::lower : end);
  Supervisor v({.can_halt = true, .after_halt = way, .sign_test = s == State::testing});
  if (s == State::disabled) return v;
  v.begin_tick(Command::enable, {});
  if (s != State::enabling && s != State::fault) v.begin_tick(Command::none, {.all_ready = true});
  if (s == State::stopping) v.begin_tick(Command::stop, {});
  if (s == State::fault) v.raise(Fault::bus_off);
  if (s == State::halting || s == State::holding || s == State::lowering) {
    if (why == Fault::none) {
      v.begin_tick(Command::halt, {});
    } else {
      v.raise(why);
    }
    if (s != State::halting) v.begin_tick(Command::none, {}, true);
  }
  EXPECT_EQ(v.state(), s) << name(v.state());
  return v;
}

/// Next state for (ready, idle, stage done) = 000, 001, ..., 111 in that order of bits; D disabled, E
/// enabling, T testing, R running, H halting, O holding, L lowering, S stopping, F fault, X what after_halt
/// says (release: S).
struct Row {
  State from;
  Command command;
  const char* to;
};
const Row table[] = {
    {State::disabled, Command::none, "DDDDDDDD"},   {State::disabled, Command::enable, "EEEEEEEE"},
    {State::disabled, Command::stop, "DDDDDDDD"},   {State::disabled, Command::halt, "DDDDDDDD"},
    {State::disabled, Command::reset, "DDDDDDDD"},  {State::enabling, Command::none, "EEEERRRR"},
    {State::enabling, Command::enable, "EEEERRRR"}, {State::enabling, Command::stop, "SSSSSSSS"},
    {State::enabling, Command::halt, "SSSSSSSS"},   {State::enabling, Command::reset, "EEEERRRR"},
    {State::testing, Command::none, "TRTRTRTR"},    {State::testing, Command::enable, "TRTRTRTR"},
    {State::testing, Command::stop, "SSSSSSSS"},    {State::testing, Command::halt, "SSSSSSSS"},
    {State::testing, Command::reset, "TRTRTRTR"},   {State::running, Command::none, "RRRRRRRR"},
    {State::running, Command::enable, "RRRRRRRR"},  {State::running, Command::stop, "SSSSSSSS"},
    {State::running, Command::halt, "HHHHHHHH"},    {State::running, Command::reset, "RRRRRRRR"},
    {State::halting, Command::none, "HXHXHXHX"},    {State::halting, Command::enable, "HXHXHXHX"},
    {State::halting, Command::stop, "SSSSSSSS"},    {State::halting, Command::halt, "HXHXHXHX"},
    {State::halting, Command::reset, "HXHXHXHX"},   {State::holding, Command::none, "OOOOOOOO"},
    {State::holding, Command::enable, "OOOOOOOO"},  {State::holding, Command::stop, "SSSSSSSS"},
    {State::holding, Command::halt, "OOOOOOOO"},    {State::holding, Command::reset, "SSSSSSSS"},
    {State::lowering, Command::none, "LSLSLSLS"},   {State::lowering, Command::enable, "LSLSLSLS"},
    {State::lowering, Command::stop, "SSSSSSSS"},   {State::lowering, Command::halt, "LSLSLSLS"},
    {State::lowering, Command::reset, "LSLSLSLS"},  {State::stopping, Command::none, "SSDDSSDD"},
    {State::stopping, Command::enable, "SSDDSSDD"}, {State::stopping, Command::stop, "SSDDSSDD"},
    {State::stopping, Command::halt, "SSDDSSDD"},   {State::stopping, Command::reset, "SSDDSSDD"},
    {State::fault, Command::none, "FFFFFFFF"},      {State::fault, Command::enable, "FFFFFFFF"},
    {State::fault, Command::stop, "FFFFFFFF"},      {State::fault, Command::halt, "FFFFFFFF"},
    {State::fault, Command::reset, "DDDDDDDD"},
};
State state_of(char c, AfterHalt end) {
  switch (c) {
    case 'D':
      return State::disabled;
    case 'E':
      return State::enabling;
    case 'T':
      return State::testing;
    case 'R':
      return State::running;
    case 'H':
      return State::halting;
    case 'O':
      return State::holding;
    case 'L':
      return State::lowering;
    case 'S':
      return State::stopping;
    case 'X':
      return end == AfterHalt::hold ? State::holding
                                    : (end == AfterHalt::lower ? State::lowering : State::stopping);
    default:
      return State::fault;
  }
}

TEST(Supervisor, FollowsTheTable) {
  std::set<std::pair<State, Command>> seen;
  for (const Row& row : table) {
    seen.emplace(row.from, row.command);
    for (const AfterHalt end : ends) {
      for (unsigned bits = 0; bits < 8; ++bits) {
        Supervisor v = in(row.from, end);
        v.begin_tick(row.command, {.all_ready = (bits & 4U) != 0, .all_idle = (bits & 2U) != 0},
                     (bits & 1U) != 0);
        EXPECT_EQ(v.state(), state_of(row.to[bits], end))
            << name(row.from) << " command " << static_cast<int>(row.command) << " bits " << bits << " is "
            << name(v.state());
        EXPECT_EQ(v.fault() != Fault::none, v.state() == State::fault);
        EXPECT_EQ(v.running(), v.state() == State::running);
      }
    }
  }
  EXPECT_EQ(seen.size(), states.size() * commands.size());
}

TEST(Supervisor, ThereIsTorqueInFiveStatesOnly) {
  const std::set<State> torque{State::testing, State::running, State::halting, State::holding,
                               State::lowering};
  for (const State s : states) {
    const Supervisor v = in(s);
    EXPECT_EQ(v.powered(), torque.count(s) == 1) << name(s);
    EXPECT_EQ(v.halting_or_held(), v.powered() && s != State::running && s != State::testing) << name(s);
  }
}

TEST(Supervisor, StartsDisabledWithoutFault) {
  const Supervisor v;
  EXPECT_EQ(v.state(), State::disabled);
  EXPECT_EQ(v.fault(), Fault::none);
  for (const Fault f : faults()) EXPECT_EQ(v.count(f), 0U);
}

/// The default is the cautious answer.
TEST(Supervisor, SilenceIsNeitherReadyNorIdleNorAtRest) {
  for (const State s : {State::enabling, State::testing, State::stopping, State::halting, State::lowering}) {
    Supervisor v = in(s);
    v.begin_tick(Command::none, {});
    EXPECT_EQ(v.state(), s) << name(v.state());
  }
  Supervisor v({.can_halt = true});
  v.begin_tick(Command::enable, {});
  v.begin_tick(Command::none, {.all_ready = true});
  EXPECT_EQ(v.state(), State::running) << "no sign test";
  v.begin_tick(Command::halt, {});
  EXPECT_EQ(v.state(), State::halting);
  v.begin_tick(Command::none, {}, true);
  EXPECT_EQ(v.state(), State::stopping) << "released";
}

TEST(Supervisor, EveryFaultStrikesAtOnceInEveryStateButDisabled) {
  for (const Fault f : faults()) {
    EXPECT_EQ(esmc::reaction(f) == esmc::Reaction::halt, gentle.count(f) == 1) << name(f);
    for (const State s : states) {
      if (s == State::fault) continue;
      Supervisor v = in(s);
      v.raise(f);
      if (s == State::disabled) {
        EXPECT_EQ(v.state(), State::disabled) << name(f);
        EXPECT_EQ(v.fault(), Fault::none);
        EXPECT_EQ(v.count(f), 0U);
        continue;
      }
      const bool torque =
          s == State::running || s == State::halting || s == State::holding || s == State::lowering;
      const State wanted =
          torque && gentle.count(f) == 1 ? (s == State::running ? State::halting : s) : State::fault;
      EXPECT_EQ(v.state(), wanted) << name(s) << ' ' << name(f);
      EXPECT_EQ(v.fault(), f);
      EXPECT_FALSE(v.running());
      EXPECT_EQ(v.count(f), 1U);
    }
  }
}

TEST(Supervisor, WithoutHaltingEveryFaultTakesTheTorqueAway) {
  for (const Fault f : faults()) {
    Supervisor v;
    v.begin_tick(Command::enable, {});
    v.begin_tick(Command::none, {.all_ready = true});
    v.raise(f);
    EXPECT_EQ(v.state(), State::fault) << name(f);
  }
  Supervisor v;
  v.begin_tick(Command::enable, {});
  v.begin_tick(Command::none, {.all_ready = true});
  v.begin_tick(Command::halt, {});
  EXPECT_EQ(v.state(), State::stopping);
}

TEST(Supervisor, AMechanismAtRestAfterAFaultEndsInFault) {
  for (const Fault f : gentle) {
    for (const AfterHalt end : ends) {
      Supervisor v = in(State::halting, end, f);
      v.begin_tick(Command::none, {}, true);
      if (end != AfterHalt::release) {
        EXPECT_TRUE(v.powered());
        v.begin_tick(end == AfterHalt::hold ? Command::reset : Command::none, {}, true);
      }
      EXPECT_EQ(v.state(), State::fault);
      EXPECT_EQ(v.fault(), f);
      v.begin_tick(Command::reset, {});
      EXPECT_EQ(v.state(), State::disabled);
    }
  }
}

TEST(Supervisor, AHarderFaultOnTheWayToRestTakesTheTorqueAndKeepsTheFirstName) {
  for (const State s : {State::halting, State::holding, State::lowering}) {
    for (const Fault second : faults()) {
      Supervisor v = in(s, AfterHalt::hold, Fault::workspace);
      v.raise(second);
      EXPECT_EQ(v.state(), gentle.count(second) == 1 ? s : State::fault);
      EXPECT_EQ(v.fault(), Fault::workspace);
      EXPECT_EQ(v.count(second), 1U) << "a workspace that is still left is the same fault";
    }
  }
}

TEST(Supervisor, NoFaultIsNoFault) {
  for (const State s : states) {
    Supervisor v = in(s);
    const Fault before = v.fault();
    v.raise(Fault::none);
    EXPECT_EQ(v.state(), s);
    EXPECT_EQ(v.fault(), before);
    EXPECT_EQ(v.count(Fault::none), 0U);
  }
}

TEST(Supervisor, TheFirstFaultKeepsItsNameUntilReset) {
  for (const Fault first : faults()) {
    for (const Fault second : faults()) {
      Supervisor v = in(State::enabling);
      v.begin_tick(Command::none, {});
      v.raise(first);
      v.raise(second);
      for (const Command c : {Command::none, Command::enable, Command::stop, Command::halt}) {
        for (int drives = 0; drives < 4; ++drives) {
          v.begin_tick(c, {(drives & 1) != 0, (drives & 2) != 0}, true);
          v.raise(second);
          ASSERT_EQ(v.state(), State::fault);
          ASSERT_EQ(v.fault(), first) << name(first) << " then " << name(second);
        }
      }
      ASSERT_EQ(v.count(second), 1U) << "in tick after tick is once";
      v.begin_tick(Command::reset, {});
      ASSERT_EQ(v.state(), State::disabled);
      ASSERT_EQ(v.fault(), Fault::none);
      v.begin_tick(Command::enable, {});
      v.raise(second);
      ASSERT_EQ(v.fault(), second) << "a new episode has its own name";
    }
  }
}

TEST(Supervisor, CountsStopAtTheirEnd) {
  Supervisor v = in(State::running);
  for (int i = 0; i < 70000; ++i) {
    v.raise(Fault::bus_off);
    EXPECT_EQ(v.count(Fault::bus_off), std::min(i + 1, 0xFFFF));
    v.begin_tick(Command::none, {});
    v.begin_tick(Command::none, {});
  }
}

TEST(Supervisor, AFaultThatGoesOnIsCountedOnceAndOneThatComesAgainTwice) {
  Supervisor v;
  v.begin_tick(Command::enable, {});
  v.raise(Fault::enable_open);
  v.raise(Fault::enable_open);  // twice in the first of all ticks
  EXPECT_EQ(v.count(Fault::enable_open), 1U);
  for (int i = 0; i < 5; ++i) {
    v.begin_tick(Command::none, {});
    v.raise(Fault::enable_open);
    v.raise(Fault::bus_off);  // two at a time do not hide each other
  }
  EXPECT_EQ(v.count(Fault::enable_open), 1U);
  EXPECT_EQ(v.count(Fault::bus_off), 1U);
  v.begin_tick(Command::none, {});
  v.raise(Fault::bus_off);
  v.begin_tick(Command::none, {});
  v.raise(Fault::enable_open);
  EXPECT_EQ(v.count(Fault::enable_open), 2U) << "a tick without it was between";
  EXPECT_EQ(v.count(Fault::bus_off), 1U);
}

TEST(Supervisor, HomingEndsWithoutTorqueInEveryWay) {
  for (const AfterHalt end : ends) {
    const auto homing = [&](bool can_halt = true) {
      Supervisor v({.can_halt = can_halt, .after_halt = end});
      v.begin_tick(Command::home, {});
      EXPECT_EQ(v.state(), State::enabling);
      v.begin_tick(Command::none, {.all_ready = true});
      EXPECT_EQ(v.state(), State::testing);
      EXPECT_TRUE(v.homing() && v.powered());
      return v;
    };
    Supervisor v = homing();
    v.begin_tick(Command::none, {}, true);
    EXPECT_EQ(v.state(), State::stopping) << "on its stops it does not run";
    v.begin_tick(Command::none, {.all_idle = true});
    EXPECT_EQ(v.state(), State::disabled);
    EXPECT_FALSE(v.homing());
    v.begin_tick(Command::enable, {});
    v.begin_tick(Command::none, {.all_ready = true});
    EXPECT_TRUE(v.running() && !v.homing());

    v = homing();
    v.begin_tick(Command::stop, {});
    EXPECT_EQ(v.state(), State::stopping);
    v = homing();
    v.begin_tick(Command::halt, {});
    EXPECT_EQ(v.state(), State::halting);
    v = homing();
    v.begin_tick(Command::halt, {}, true);
    EXPECT_EQ(v.state(), State::stopping)
        << "the zero has just changed: the motion before it is no more known";
    v = homing();
    v.begin_tick(Command::halt, {});
    v.begin_tick(Command::none, {}, true);
    EXPECT_EQ(v.state(), State::stopping) << "nothing is held or lowered in a pose that is not known";
    v = homing(false);
    v.begin_tick(Command::halt, {});
    EXPECT_EQ(v.state(), State::stopping);
    for (const Fault f : faults()) {
      v = homing();
      v.raise(f);
      EXPECT_EQ(v.state(), gentle.count(f) == 1 ? State::halting : State::fault) << name(f);
      v.begin_tick(Command::none, {}, true);
      EXPECT_EQ(v.state(), State::fault);
      EXPECT_FALSE(v.homing());
      v = homing(false);
      v.raise(f);
      EXPECT_EQ(v.state(), State::fault);
    }
  }
  for (const State s : states) {
    Supervisor v = in(s);
    v.begin_tick(Command::home, {});
    EXPECT_EQ(v.homing(), s == State::disabled) << name(s);
  }
}

TEST(Supervisor, AnOrderToArmExpires) {
  Supervisor v({.enabling_ticks_max = 3, .stopping_ticks_max = 3});
  v.begin_tick(Command::enable, {});
  for (int i = 0; i < 100; ++i) v.begin_tick(Command::none, {}, false, 0);  // no time passes: lockstep
  v.begin_tick(Command::enable, {});
  v.begin_tick(Command::reset, {});
  EXPECT_EQ(v.state(), State::enabling) << "asked again, the time goes on";
  v.begin_tick(Command::none, {});
  EXPECT_EQ(v.state(), State::fault);
  EXPECT_EQ(v.fault(), Fault::enabling_timeout);
  for (int i = 0; i < 10; ++i) v.begin_tick(Command::none, {.all_ready = true});
  EXPECT_EQ(v.state(), State::fault) << "drives that are ready later start nothing";
  v.begin_tick(Command::reset, {.all_ready = true});
  v.begin_tick(Command::none, {.all_ready = true});
  EXPECT_EQ(v.state(), State::disabled) << "nor does a reset";
  v.begin_tick(Command::enable, {.all_ready = true});
  Supervisor gap = v;
  gap.begin_tick(Command::none, {.all_ready = true}, false, 1000);
  EXPECT_EQ(gap.fault(), Fault::enabling_timeout) << "what was said before so long a gap is old";
  gap = v;
  gap.begin_tick(Command::none, {.all_ready = true}, false, 2);
  EXPECT_EQ(gap.state(), State::running);
  v.begin_tick(Command::none, {});
  v.begin_tick(Command::none, {});
  v.begin_tick(Command::none, {.all_ready = true});
  EXPECT_EQ(v.state(), State::running) << "each order has its own time, and its last tick counts";
}

TEST(Supervisor, StoppingEndsWithoutTheDrivesWordToo) {
  for (const State from :
       {State::enabling, State::testing, State::running, State::halting, State::holding, State::lowering}) {
    Supervisor v = in(from);
    v.begin_tick(Command::stop, {});
    ASSERT_EQ(v.state(), State::stopping) << name(from);
    const std::uint32_t most = Supervisor::Config{}.stopping_ticks_max;
    for (std::uint32_t i = 0; i <= most; ++i)
      v.begin_tick(Command::none, {}, false, 0);  // lockstep: no time passes
    v.begin_tick(Command::none, {}, false, 100);  // or much at once
    for (std::uint32_t i = 101; i < most; ++i) v.begin_tick(Command::none, {});
    EXPECT_EQ(v.state(), State::stopping) << name(from);
    v.begin_tick(Command::none, {});
    EXPECT_EQ(v.state(), State::disabled) << name(from);
  }
}

TEST(Supervisor, NamesAreDistinct) {
  std::set<std::string> names;
  for (int i = 0; i < esmc::fault_count; ++i) names.insert(name(static_cast<Fault>(i)));
  EXPECT_EQ(names.size(), static_cast<std::size_t>(esmc::fault_count));
  EXPECT_EQ(names.count("unknown"), 0U);
  EXPECT_STREQ(name(static_cast<Fault>(esmc::fault_count)), "unknown");
  names.clear();
  for (int i = 0; i < esmc::state_count; ++i) names.insert(name(static_cast<State>(i)));
  EXPECT_EQ(names.size(), states.size());
  EXPECT_EQ(names.count("unknown"), 0U);
  EXPECT_STREQ(name(static_cast<State>(esmc::state_count)), "unknown");
}

}  // namespace
