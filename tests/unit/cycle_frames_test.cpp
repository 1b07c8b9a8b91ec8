/// Frames that are not ours, broken, or too many; frames that cannot be sent.

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>

#include "tests/support/cycle_rig.hpp"

namespace {

using namespace esmc;
using test::Rig;
using test::Setup;
using test::setup;

template <class M>
class CycleFrames : public testing::Test {};
using Machines = testing::Types<FiveBar<double>, Rr<float>>;
TYPED_TEST_SUITE(CycleFrames, Machines);

TYPED_TEST(CycleFrames, FramesOfOthersAreCountedAndChangeNothing) {
  Rig<TypeParam> rig;
  ASSERT_TRUE(rig.start());
  const auto before = rig.cycle.counters();
  std::uint32_t others = 0, ticks = 0;
  const auto sample = rig.cycle.sample();
  for (std::uint32_t id = 0; id <= 0x7FF; ++id) {
    const unsigned command = id % 32;
    bool ours = false;
    for (std::size_t i = 0; i < 2; ++i) ours = ours || id / 32 == rig.node(i);
    if (ours &&
        (command == test::cmd_heartbeat || command == test::cmd_encoder || command == test::cmd_torques))
      continue;
    if (command == 0x02 && (ours || id / 32 == 0x3F)) continue;  // emergency stops
    if ((ours || id / 32 == 0x3F) && test::is_command(command, true)) continue;
    for (const bool extended : {false, true}) {
      hal::CanFrame f = test::message(0, 0, 0x7FC00000, 0x7FC00000, static_cast<std::uint8_t>(id % 9));
      f.id = id;
      f.extended = extended;
      rig.bus.push(f);
      ++others;
    }
    if (rig.bus.waiting() < 100) continue;
    ASSERT_EQ(rig.tick().state, State::running) << std::hex << id;
    ++ticks;
  }
  EXPECT_EQ(rig.tick().state, State::running);
  ++ticks;
  EXPECT_EQ(rig.cycle.counters().not_mine - before.not_mine, others);
  EXPECT_EQ(rig.cycle.counters().received - before.received, 4 * ticks);
  EXPECT_EQ(rig.cycle.counters().malformed, 0U);
  EXPECT_EQ(rig.cycle.sample().angle, sample.angle);
}

TYPED_TEST(CycleFrames, ACommandToOurDrivesThatWeDidNotSendIsAForeignController) {
  // Set-points of position (0C) and speed (0D) carry a torque; 0F moves the limits, 19 the zero.
  for (const unsigned command : {0x07U, 0x0BU, 0x0CU, 0x0DU, 0x0EU, 0x0FU, 0x16U, 0x18U, 0x19U}) {
    for (std::size_t axis = 0; axis < 2; ++axis) {
      Rig<TypeParam> rig;
      ASSERT_TRUE(rig.start());
      rig.bus.push(test::message(rig.node(axis), command, 0, 0));
      EXPECT_EQ(rig.tick().fault, Fault::foreign_controller) << axis << ' ' << command;
      EXPECT_TRUE(rig.all_zero());
      EXPECT_EQ(rig.cycle.counters().foreign_command, 1U);
    }
  }
}

/// More frames per tick than the cycle reads: what it reads then grows old without its age saying so. Old
/// samples must not pass for new ones: either the newest is used, or the run ends.
TYPED_TEST(CycleFrames, AFloodDoesNotMakeOldSamplesLookNew) {
  constexpr int reads = esmc::OdriveCycle<TypeParam>::frames_per_tick_max;
  for (const int others : {10, reads / 2, reads - 10, reads, reads + 40}) {
    Rig<TypeParam, test::BasicFakeBus<4096>> rig;
    ASSERT_TRUE(rig.start());
    int behind = 0;
    for (int i = 0; i < 20 && rig.cycle.supervisor().running(); ++i) {
      for (int n = 0; n < others; ++n) rig.bus.push(test::message(2, 0, 0, 0, 0));
      rig.angle[0] += 1e-4;
      rig.tick();
      const auto seen = static_cast<double>(rig.cycle.sample().angle[0]);
      if (rig.cycle.supervisor().running())
        behind = static_cast<int>(std::lround((rig.angle[0] - seen) / 1e-4));
    }
    EXPECT_LE(behind, 2) << "ticks between what is controlled and what is, at " << others
                         << " frames per tick";
    if (others < reads - 5) {
      EXPECT_TRUE(rig.cycle.supervisor().running()) << others << " frames per tick can be read";
    } else {
      EXPECT_EQ(rig.cycle.supervisor().fault(), Fault::bus_overload) << others;
      EXPECT_TRUE(rig.all_zero());
    }
  }
}

/// Reading in several goes is reading the same number of frames.
TYPED_TEST(CycleFrames, AFloodIsCountedOverAllReadsOfATick) {
  constexpr int reads = esmc::OdriveCycle<TypeParam>::frames_per_tick_max;
  Rig<TypeParam, test::BasicFakeBus<4096>> rig;
  ASSERT_TRUE(rig.start());
  for (int part = 0; part < 2; ++part) {
    for (int n = 0; n < reads * 3 / 4; ++n) rig.bus.push(test::message(2, 0, 0, 0, 0));
    rig.cycle.receive(rig.bus);
  }
  EXPECT_EQ(rig.tick().fault, Fault::bus_overload);
  EXPECT_TRUE(rig.all_zero());
}

/// A loop that waits for a complete set must be told that none can come before the next tick.
TYPED_TEST(CycleFrames, AFloodBeforeACompleteSetIsSaidAtOnce) {
  constexpr int reads = esmc::OdriveCycle<TypeParam>::frames_per_tick_max;
  Rig<TypeParam, test::BasicFakeBus<4096>> rig;
  ASSERT_TRUE(rig.start());
  rig.push_encoder(0);
  for (int n = 0; n < reads - 2; ++n) rig.bus.push(test::message(2, 0, 0, 0, 0));
  rig.cycle.receive(rig.bus);
  EXPECT_FALSE(rig.cycle.complete() || rig.cycle.overloaded());
  rig.bus.push(test::message(2, 0, 0, 0, 0));
  rig.push_encoder(1);
  rig.cycle.receive(rig.bus);
  EXPECT_FALSE(rig.cycle.complete()) << "it reads no more";
  EXPECT_TRUE(rig.cycle.overloaded());
  EXPECT_EQ(rig.tick().fault, Fault::bus_overload);
  EXPECT_TRUE(rig.all_zero());
  EXPECT_FALSE(rig.cycle.overloaded());
}

/// A foreign node, or its emergency stop, is no sign that a drive of ours is there.
TYPED_TEST(CycleFrames, OnlyOurDrivesCountAsHeard) {
  Rig<TypeParam> rig;
  EXPECT_FALSE(rig.cycle.heard());
  rig.bus.push(test::heartbeat(2, 8));
  rig.bus.push(test::message(rig.node(0), 0x02, 0, 0, 0));
  rig.bus.push(test::message(rig.node(0), test::cmd_torque, 0, 0));
  rig.cycle.receive(rig.bus);
  EXPECT_FALSE(rig.cycle.heard());
  rig.push_encoder(1);
  rig.cycle.receive(rig.bus);
  EXPECT_TRUE(rig.cycle.heard());
}

/// Each motor says every ten ticks what it gives.
TYPED_TEST(CycleFrames, ATorqueThatIsNotWhatWasToldOrIsNotSaidAnyMoreIsAFault) {
  struct Case {
    float off;
    bool silent;
    State state;
  };
  for (const Case c :
       {Case{0.0F, false, State::running}, Case{0.05F, false, State::running},
        Case{-0.5F, false, State::fault}, Case{NAN, false, State::fault}, Case{0.0F, true, State::fault}}) {
    Setup<TypeParam> s = setup<TypeParam>();
    s.torque_mismatch = 0.1 * std::abs(s.gear[1]);
    Rig<TypeParam> rig(s);
    for (std::size_t i = 0; i < 2; ++i) rig.bus.push(test::torques(rig.node(i), 0, 0));
    ASSERT_TRUE(rig.start());
    int n = 0;
    for (; n < 100 && rig.cycle.supervisor().state() == State::running; ++n) {
      for (std::size_t i = 0; i < 2 && n % 10 == 0; ++i) {
        const float told = n == 0 ? 0.0F : rig.shaft_torque(i);
        if (!(c.silent && i == 1 && n > 50))
          rig.bus.push(test::torques(rig.node(i), told, told + (i == 1 ? c.off : 0.0F)));
      }
      (void)rig.tick();
    }
    EXPECT_EQ(rig.cycle.supervisor().state(), c.state) << c.off;
    if (c.state == State::running) continue;
    EXPECT_EQ(rig.cycle.supervisor().fault(), Fault::torque_mismatch);
    EXPECT_EQ(n, c.silent ? 50 + 22 : 41) << "five reports; or more than 20 ticks without one";
    EXPECT_TRUE(rig.all_zero());
  }
  Setup<TypeParam> s = setup<TypeParam>();
  s.torque_mismatch = 1e3;
  Rig<TypeParam> never(s);
  EXPECT_FALSE(never.start());
  EXPECT_EQ(never.cycle.supervisor().fault(), Fault::torque_mismatch) << "never said";
}

}  // namespace
