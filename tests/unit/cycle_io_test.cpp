/// The pins of a board: the enable contact, drive_enable, the brake, and when the watchdog may be refreshed.

#include <gtest/gtest.h>

#include "hal/io.hpp"
#include "tests/support/cycle_rig.hpp"

namespace {

using esmc::Command;
using esmc::Fault;
using esmc::State;
using Five = esmc::FiveBar<double>;
using Rig = esmc::test::Rig<Five>;

struct Pin {
  bool high = false;
  void set(bool v) { high = v; }
  [[nodiscard]] bool closed() const { return high; }
  void refresh() {}
};
static_assert(esmc::hal::DigitalInput<Pin> && esmc::hal::DigitalOutput<Pin> && esmc::hal::Watchdog<Pin>);

TEST(Io, AnOpenEnableContactTakesTheTorqueInTheSameTickAndIsLatched) {
  Rig rig;
  ASSERT_TRUE(rig.start());
  ASSERT_FALSE(rig.all_zero());
  rig.cycle.enable_input(false);
  EXPECT_EQ(rig.tick().fault, Fault::enable_open);
  EXPECT_TRUE(rig.all_zero());
  rig.cycle.enable_input(true);
  for (int i = 0; i < 10; ++i) EXPECT_EQ(rig.tick().state, State::fault);
  rig.tick(Command::reset);
  EXPECT_TRUE(rig.start());
}

TEST(Io, AnOpeningBetweenTwoTicksIsSeen) {
  Rig rig;
  rig.cycle.enable_input(false);
  rig.cycle.enable_input(true);
  rig.tick();  // disabled: there is nothing to take away, and nothing is remembered
  ASSERT_TRUE(rig.start());
  rig.cycle.enable_input(false);
  rig.cycle.enable_input(true);
  EXPECT_EQ(rig.tick().fault, Fault::enable_open);
  EXPECT_TRUE(rig.all_zero());
}

TEST(Io, AnImageWhoseDrivesAreNotConfirmedSeesThemAndAsksThemForNothing) {
  auto s = esmc::test::setup<Five>();
  s.confirmed = false;
  Rig rig(s);
  for (int i = 0; i < 10; ++i) rig.tick();
  EXPECT_EQ(rig.cycle.supervisor().state(), State::disabled);
  EXPECT_TRUE(rig.cycle.heard());
  rig.tick(Command::enable);
  EXPECT_EQ(rig.cycle.supervisor().fault(), Fault::drives_not_confirmed);
  for (std::size_t i = 0; i < rig.axis_count(); ++i) EXPECT_EQ(rig.count(i, esmc::test::cmd_axis_state), 0);
  rig.tick(Command::reset);
  rig.tick(Command::enable);
  EXPECT_EQ(rig.cycle.supervisor().fault(), Fault::drives_not_confirmed);
}

TEST(Io, DrivesHavePowerFromEnablingOnAndTheBrakeOpensForTorqueOnly) {
  Rig rig;
  EXPECT_FALSE(rig.cycle.drive_enable());
  EXPECT_FALSE(rig.cycle.release_brake());
  rig.tick(Command::enable);
  EXPECT_TRUE(rig.cycle.drive_enable());
  EXPECT_FALSE(rig.cycle.release_brake());
  ASSERT_TRUE(rig.until(State::running));
  EXPECT_TRUE(rig.cycle.release_brake());
  rig.tick(Command::stop);
  EXPECT_TRUE(rig.cycle.drive_enable()) << "they still have to say that they are idle";
  EXPECT_FALSE(rig.cycle.release_brake());
  ASSERT_TRUE(rig.until(State::disabled));
  EXPECT_FALSE(rig.cycle.drive_enable());
  ASSERT_TRUE(rig.start());
  rig.cycle.enable_input(false);
  rig.tick();
  EXPECT_FALSE(rig.cycle.drive_enable());
  EXPECT_FALSE(rig.cycle.release_brake());
}

TEST(Io, TicksAreGoodInEveryStateAndNoneHasBeenBeforeTheFirst) {
  Rig rig;
  EXPECT_FALSE(rig.cycle.output_ok());
  for (const Command c :
       {Command::none, Command::enable, Command::none, Command::none, Command::stop, Command::none}) {
    rig.tick(c);
    EXPECT_TRUE(rig.cycle.output_ok());
  }
}

/// A controller with a small FIFO: what it lost may have been an emergency stop.
TEST(Io, FramesThatTheControllerLostAreAFault) {
  esmc::test::Rig<Five, esmc::test::LosingBus> rig;
  rig.bus.lost = 7;  // before the cycle listened
  rig.tick();
  rig.tick(Command::reset);
  ASSERT_TRUE(rig.start());
  ASSERT_FALSE(rig.all_zero());
  ++rig.bus.lost;
  EXPECT_EQ(rig.tick().fault, Fault::bus_overload);
  EXPECT_TRUE(rig.all_zero());
  rig.tick(Command::reset);
  EXPECT_TRUE(rig.start()) << "counted once";
}

TEST(Io, TicksThatBeginLateAreAFaultOfTheirOwn) {
  Rig rig;
  rig.cycle.tick_late();  // nothing to bring to rest, nothing to remember
  EXPECT_EQ(rig.tick().fault, Fault::none);
  ASSERT_TRUE(rig.start());
  ASSERT_FALSE(rig.all_zero());
  rig.cycle.tick_late();
  EXPECT_EQ(rig.tick().fault, Fault::tick_late);
  EXPECT_TRUE(rig.all_zero()) << "this rig cannot halt";
  EXPECT_EQ(rig.tick().state, State::fault);
  EXPECT_EQ(rig.cycle.supervisor().count(Fault::tick_late), 1U);
  EXPECT_EQ(reaction(Fault::tick_late), esmc::Reaction::halt);
  rig.tick(Command::reset);
  EXPECT_TRUE(rig.start()) << "counted once";
}

TEST(Io, TorquesAreOfOneTickAndWhatArmsOrDisarmsIsNot) {
  constexpr std::uint32_t set_input_torque = 0x0E;
  Rig rig;
  std::size_t torques = 0, others = 0;
  const auto look = [&] {
    for (const esmc::hal::CanFrame& f : rig.bus.sent()) {
      const bool torque = (f.id & 0x1FU) == set_input_torque;
      EXPECT_EQ(f.perishable, torque) << std::hex << f.id;
      ++(torque ? torques : others);
    }
  };
  rig.tick(Command::enable);
  for (int i = 0; i < 50; ++i) look(), rig.tick();
  EXPECT_EQ(rig.cycle.supervisor().state(), State::running);
  rig.tick(Command::stop);
  for (int i = 0; i < 10; ++i) look(), rig.tick();
  EXPECT_GT(torques, 50U);
  EXPECT_GT(others, 4U);
}

}  // namespace
