/// The cycle and two CiA 402 slaves made of bytes, against the clock: SYNC at the beginning of a tick, torque
/// at its end.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <utility>
#include <vector>

#include "firmware/cycle/instances.hpp"
#include "tests/support/cia402_bench.hpp"
#include "tests/support/cycle_setup.hpp"
#include "tests/support/fake_bus.hpp"

namespace esmc::test {
namespace {

using Five = FiveBar<double>;
using Node = Cia402Cycle<Five>;

struct Clocked {
  std::array<Slave, 2> slaves{};
  TimedBus bus;
  Node cycle;
  std::vector<CanFrame> late;
  bool cuts = false;  ///< the second frame of each drive comes after the tick, and waits for 0.55 ms until
                      ///< the next begins

  static Node::Config config(bool absolute) {
    Node::Config c;
    const auto s = setup<Five>();
    c.controller = s.controller;
    for (unsigned i = 0; i < 2; ++i) {
      drive::AxisConfig mount;
      mount.node = static_cast<std::uint8_t>(i + 1);
      mount.offset = static_cast<float>(s.angle[2 * i]);
      c.axes[i] = Cia402Axis(mount, settings());
    }
    c.line = drive::CanopenLine(100, 1);
    c.heartbeat_age_ticks_max = 20;
    c.zero_absolute = absolute;
    for (int j = 0; j < 4; ++j) c.zero_pose[j] = s.angle[static_cast<unsigned>(j)];
    return c;
  }
  explicit Clocked(bool absolute = true) : cycle(config(absolute)) {
    for (unsigned i = 0; i < 2; ++i) {
      slaves[i].node = i + 1;
      slaves[i].objects[entry(0x1014, 0)] = 0x80U + i + 1;
    }
  }
  void tick(Command command = Command::none) {
    for (const CanFrame& f : std::exchange(late, {})) bus.push(f);
    bus.age_us = 550;
    cycle.receive(bus);
    bus.age_us = 0;
    cycle.request(bus);
    for (Slave& s : slaves) {
      std::vector<CanFrame> said = s.speak();
      if (cuts && said.size() > 1) {
        late.push_back(said.back());
        said.pop_back();
      }
      for (const CanFrame& f : said) bus.push(f);
      if (s.state == 5) bus.push(heartbeat_of(s.node, 5));
    }
    cycle.receive(bus);
    cycle.command(command);
    bus.clear();
    (void)cycle.tick(bus);
    for (const CanFrame& f : bus.sent()) {
      for (Slave& s : slaves) s.take(f);
    }
  }
  [[nodiscard]] bool beats() const { return std::ranges::count(bus.sent(), can(0x764, {5})) != 0; }
  [[nodiscard]] State state() const { return cycle.supervisor().state(); }
  bool start() {
    for (int i = 0; i < 400 && state() != State::running && (i < 4 || state() != State::fault); ++i)
      tick(i == 3 ? Command::enable : Command::none);
    return state() == State::running;
  }
};

// A controller that was reset has nothing to say to a drive that the one before has left under torque: its
// watchdog ends that.
TEST(Cia402Cycle, SaysNothingThatKeepsADriveAliveBeforeItHasCalledIt) {
  Clocked c;
  for (Slave& s : c.slaves) {
    s.state = 5;
    s.status = 0x1237;
    s.torque = 500;
  }
  for (int i = 0; i < 50; ++i) {
    c.tick();
    ASSERT_EQ(c.state(), State::disabled);
    EXPECT_FALSE(c.beats());
  }
  c.tick(Command::enable);
  c.tick();
  EXPECT_EQ(c.state(), State::enabling);
  EXPECT_TRUE(c.beats());
}

TEST(Cia402Cycle, BeatsOnWhenItIsDisabledAgainAndNotInAFault) {
  Clocked c;
  ASSERT_TRUE(c.start());
  EXPECT_TRUE(c.beats());
  c.tick(Command::stop);
  for (int i = 0; i < 50; ++i) c.tick();
  ASSERT_EQ(c.state(), State::disabled);
  EXPECT_TRUE(c.beats());
  ASSERT_TRUE(c.start());
  c.cycle.enable_input(false);
  c.tick();
  ASSERT_EQ(c.state(), State::fault);
  EXPECT_FALSE(c.beats());
}

/// However soon its heartbeats are back.
TEST(Cia402Cycle, ADriveThatSaysThatItHasBootedHasLostItsZero) {
  for (const bool boots : {false, true}) {
    Clocked c(false);
    EXPECT_FALSE(c.start()) << "the first arming sets the drives up";
    for (int i = 0; i < 60; ++i) c.tick();
    c.tick(Command::reset);
    for (int i = 0; i < 20; ++i) c.tick();
    c.tick(Command::confirm_zero);
    ASSERT_TRUE(c.start());
    c.tick(Command::stop);
    for (int i = 0; i < 100; ++i) c.tick();
    if (boots) c.bus.push(heartbeat_of(2, 0));
    for (int i = 0; i < 10; ++i) c.tick();
    EXPECT_EQ(c.start(), !boots);
    EXPECT_EQ(c.cycle.supervisor().fault(), boots ? Fault::zero_not_confirmed : Fault::none);
  }
}

TEST(Cia402Cycle, ADriveThatIsNotWhatWasConfiguredIsNotArmed) {
  Clocked c;
  c.slaves[1].objects[entry(0x6502, 0)] = 0;  // no cyclic synchronous torque
  EXPECT_FALSE(c.start());
  EXPECT_EQ(c.cycle.supervisor().fault(), Fault::drive_configuration);
}

/// What came before the drives were asked for the samples of this tick answers an earlier request: no set of
/// this one.
TEST(Cia402Cycle, ARequestMakesWhatCameBeforeItLate) {
  Clocked c;
  const auto hear = [&] {
    for (unsigned i = 1; i <= 2; ++i) c.bus.push(heartbeat_of(i, 127));
    c.cycle.receive(c.bus);
  };
  hear();
  EXPECT_TRUE(c.cycle.complete())
      << "of drives that are not operational a heartbeat is their word of the tick";
  c.cycle.request(c.bus);
  EXPECT_FALSE(c.cycle.complete());
  hear();
  EXPECT_TRUE(c.cycle.complete());
}

// Sampled at SYNC: a tick later it is a tick old, wherever in that tick the answer has come and however long
// it has waited.
TEST(Cia402Cycle, ASetThatTheTickCutsInTwoIsOneTickOldAndNoMore) {
  Clocked c;
  c.cuts = true;
  ASSERT_TRUE(c.start());
  c.tick();
  for (const unsigned joint : {0U, 2U}) {
    EXPECT_EQ(c.cycle.sample().age_ticks[joint], 1U);
    EXPECT_EQ(c.cycle.sample().phase[joint], 0.0);
  }
  Clocked prompt;
  ASSERT_TRUE(prompt.start());
  prompt.tick();
  EXPECT_EQ(prompt.cycle.sample().age_ticks[0], 0U);
}

}  // namespace
}  // namespace esmc::test
