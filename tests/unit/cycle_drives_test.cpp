/// Which drive the cycle looks at, for what, and until when: each axis in turn is the one that is different.

#include <gtest/gtest.h>

#include <array>
#include <cstdint>
#include <tuple>
#include <utility>
#include <vector>

#include "tests/support/told_drive.hpp"

namespace esmc::test {
namespace {

using Five = FiveBar<double>;
using Bench = ToldBench;

TEST(CycleDrives, CountersBeginAtZeroAndCountEachKind) {
  Bench b;
  b.build();
  const auto& n = b.cycle->counters();
  EXPECT_EQ(n.received + n.not_mine + n.malformed + n.foreign_command + n.sent + n.send_failed, 0U);
  b.tick();
  EXPECT_EQ(n.received, 2U);
  EXPECT_EQ(n.sent, b.bus.sent().size());
  EXPECT_EQ(n.send_failed, 0U);
  const std::uint32_t before = n.sent;
  const auto offered = static_cast<std::uint32_t>(b.bus.sent().size());
  b.bus.answer(hal::SendStatus::bus_full);
  b.tick();
  EXPECT_EQ(n.sent, before);
  EXPECT_EQ(n.send_failed, offered);
  b.bus.answer(hal::SendStatus::bus_off);
  b.tick();
  EXPECT_EQ(n.sent, before);
  EXPECT_EQ(n.send_failed, 2 * offered);
  b.bus.push({.id = b.drive[0].id, .size = 0});
  b.bus.push({.id = b.drive[0].id, .remote = true, .size = 8});
  b.bus.push({.id = 0x555, .size = 8});
  b.tick();
  EXPECT_EQ(n.malformed, 1U);
  EXPECT_EQ(n.foreign_command, 1U);
  EXPECT_EQ(n.not_mine, 1U);
}

TEST(CycleDrives, AFullBusIsNoFaultADeadOneIs) {
  for (const auto& [status, fault] : {std::pair{hal::SendStatus::bus_full, Fault::none},
                                      {hal::SendStatus::refused, Fault::none},
                                      {hal::SendStatus::bus_off, Fault::bus_off},
                                      {hal::SendStatus::ok, Fault::none}}) {
    Bench b;
    ASSERT_TRUE(b.start());
    b.bus.answer(status);
    b.tick();
    b.bus.answer(hal::SendStatus::ok);
    b.tick();
    EXPECT_EQ(b.fault(), fault);
  }
}

TEST(CycleDrives, WhatIsNotConfiguredTakesItsUsualValue) {
  const Bench::C::Config c;
  EXPECT_EQ(c.axis_count, 2);
  EXPECT_EQ(c.heartbeat_age_ticks_max, 0U);
  EXPECT_EQ(c.waiting_ticks_max, 750U);
  EXPECT_TRUE(c.confirmed && c.zero_absolute && c.samples_timed);
}

/// The places behind the last axis hold drives too, unconfigured ones.
TEST(CycleDrives, NothingIsAskedOfAnAxisBehindTheLastOne) {
  Bench b;
  stranger.error = stranger.emergency = stranger.mismatch = true;
  stranger.ready = stranger.idle = false;
  b.config.link = {.base_id = 0x780, .telemetry_ticks = 1};
  b.build();
  hal::IdFilters wanted;
  wanted.add({0x100, 0x7FF, false});
  wanted.add({0x101, 0x7FF, false});
  wanted.add({0x780, 0x7E0, false});
  const hal::IdFilters heard = b.cycle->filters();
  ASSERT_EQ(heard.list().size(), wanted.list().size());
  for (std::size_t i = 0; i < wanted.list().size(); ++i) EXPECT_EQ(heard.list()[i], wanted.list()[i]);
  EXPECT_TRUE(b.start());
  b.drive[1].emergency = true;
  b.tick();
  EXPECT_EQ(b.fault(), Fault::emergency_stop);
  b.drive[1].emergency = false;
  for (int i = 0; i < 20; ++i) b.tick();
  EXPECT_EQ(b.drive[0].acknowledged + b.drive[1].acknowledged, 0) << "only the operator does";
  b.tick(Command::reset);
  EXPECT_EQ(b.drive[0].acknowledged, 1);
  EXPECT_EQ(b.drive[1].acknowledged, 1);
  EXPECT_EQ(stranger.acknowledged, 0);
  EXPECT_EQ(stranger.begun, 0);
  EXPECT_EQ(stranger.enabled + stranger.disabled + stranger.torques, 0);
  EXPECT_EQ(b.desk.last(Desk::record).data[1], 0xFF) << "no drive has an error";
  EXPECT_EQ(Desk::word(b.desk.last(Desk::detail), 4, 4), 0U);
}

TEST(CycleDrives, ASetIsCompleteWithEachAxis) {
  for (const unsigned missing : {0U, 1U}) {
    Bench b;
    b.tick();
    b.quiet[missing] = true;
    b.bus.push({.id = b.drive[1 - missing].id, .size = 8});
    b.cycle->receive(b.bus);
    EXPECT_FALSE(b.cycle->complete());
    b.bus.push({.id = b.drive[missing].id, .size = 8});
    b.cycle->receive(b.bus);
    EXPECT_TRUE(b.cycle->complete());
  }
}

TEST(CycleDrives, EveryDriveIsAskedAgain) {
  Bench b(Sensors::all);
  b.build();
  b.cycle->ask_again();
  for (const Script& d : b.drive) EXPECT_EQ(d.asked_again, 1);
}

/// Motors of a five-bar with encoders everywhere are on axes 0 and 2.
TEST(CycleDrives, EachMotorIsJudgedAndNoPassiveEncoder) {
  struct Case {
    bool Script::*what;
    bool value;
    Fault fault;
  };
  for (const Sensors sensors : {Sensors::base, Sensors::all}) {
    for (const auto& [what, value, fault] : {Case{&Script::error, true, Fault::drive_error},
                                             Case{&Script::closed_loop, false, Fault::drive_disarmed},
                                             Case{&Script::mismatch, true, Fault::drive_configuration}}) {
      for (unsigned axis = 0; axis < (sensors == Sensors::all ? 4U : 2U); ++axis) {
        Bench b(sensors);
        ASSERT_TRUE(b.start());
        b.drive[axis].*what = value;
        b.tick();
        const bool motor = sensors == Sensors::base || axis % 2 == 0;
        EXPECT_EQ(b.fault(), motor ? fault : Fault::none) << axis;
      }
    }
    for (unsigned axis = 0; axis < (sensors == Sensors::all ? 4U : 2U); ++axis) {
      const bool motor = sensors == Sensors::base || axis % 2 == 0;
      Bench b(sensors);
      b.drive[axis].ready = false;
      EXPECT_EQ(b.start(), !motor) << axis;
      Bench busy(sensors);
      ASSERT_TRUE(busy.start());
      busy.drive[axis].idle = false;
      busy.tick(Command::stop);
      for (int i = 0; i < 5; ++i) busy.tick();
      EXPECT_EQ(busy.state(), motor ? State::stopping : State::disabled) << axis;
      EXPECT_EQ(busy.drive[axis].disabled > 0, motor) << axis;
      EXPECT_EQ(busy.drive[axis].enabled > 0, motor) << axis;
      EXPECT_EQ(busy.drive[axis].torques > 0, motor) << axis;
    }
  }
}

TEST(CycleDrives, TheErrorOfTheFirstMotorThatHasOneIsTold) {
  for (const Sensors sensors : {Sensors::base, Sensors::all}) {
    for (const unsigned errors : {1U, 2U, 3U}) {
      Bench b(sensors);
      b.config.link = {.base_id = 0x780, .telemetry_ticks = 1};
      ASSERT_TRUE(b.start());
      const unsigned step = sensors == Sensors::all ? 2 : 1;
      for (unsigned i = 0; i < 2; ++i) {
        b.drive[i * step].error = (errors & (1U << i)) != 0;
        b.drive[i * step].error_code = 0x50 + i;
      }
      for (int i = 0; i < 20; ++i) b.tick();
      const unsigned first = errors == 2 ? 1 : 0;
      EXPECT_EQ(b.desk.last(Desk::record).data[1], first) << errors;
      EXPECT_EQ(Desk::word(b.desk.last(Desk::detail), 4, 4), 0x50 + first) << errors;
    }
  }
}

TEST(CycleDrives, OfALateSampleAndALostHeartbeatTheDriveIsToBlame) {
  Bench b;
  ASSERT_TRUE(b.start());
  b.drive[1].heartbeat_age = b.drive[1].sample_age = silence_max + 5;
  b.quiet[1] = true;
  b.tick();
  EXPECT_EQ(b.fault(), Fault::heartbeat_lost);
}

TEST(CycleDrives, ReportsOfTorqueBeforeAStopDoNotCountAfterIt) {
  Bench b;
  b.config.torque_mismatch = 0.5;
  ASSERT_TRUE(b.start());
  for (Script& d : b.drive) d.observed = 100.0F;
  for (int i = 0; i < 4; ++i) b.tick();
  EXPECT_EQ(b.state(), State::running);
  b.tick(Command::stop);
  for (int i = 0; i < 3; ++i) b.tick();
  ASSERT_EQ(b.state(), State::disabled);
  for (Script& d : b.drive) d.observed.reset();
  ASSERT_TRUE(b.start());
  for (Script& d : b.drive) d.observed = 100.0F;
  for (int i = 0; i < 4; ++i) {
    b.tick();
    EXPECT_EQ(b.state(), State::running) << i;
  }
  b.tick();
  EXPECT_EQ(b.fault(), Fault::torque_mismatch);
}

TEST(CycleDrives, NothingIsSentToADriveWhoseWatchdogIsTested) {
  Bench b;
  ASSERT_TRUE(b.start());
  b.drive[1].suspended = true;
  const int first = b.drive[0].torques, second = b.drive[1].torques;
  b.tick();
  EXPECT_EQ(b.drive[0].torques, first + 1);
  EXPECT_EQ(b.drive[1].torques, second);
  b.drive[1].suspended = false;
  b.tick(Command::none, false);
  EXPECT_EQ(b.drive[1].torques, second) << "no answer";
}

TEST(CycleDrives, AnOpenContactStaysOpenUntilItIsReadClosed) {
  Bench b;
  ASSERT_TRUE(b.start());
  b.cycle->enable_input(false);
  b.tick();
  EXPECT_EQ(b.fault(), Fault::enable_open);
  for (int i = 0; i < 3; ++i) {
    b.tick(Command::reset);
    EXPECT_EQ(b.state(), State::disabled);
    b.tick(Command::enable);
    EXPECT_EQ(b.fault(), Fault::enable_open);
  }
  b.cycle->enable_input(true);
  b.tick(Command::reset);
  EXPECT_TRUE(b.start());
}

// ---- a line that is shared

TEST(CycleDrives, ARequestIsWorthNothingAfterItsTick) {
  struct Kept : FakeBus {
    std::vector<hal::CanFrame> all;
    hal::SendStatus try_send(const hal::CanFrame& f) {
      all.push_back(f);
      return hal::SendStatus::ok;
    }
  };
  Bench b;
  b.build();
  Kept bus;
  b.cycle->request(bus);
  ASSERT_EQ(bus.all.size(), 1U);
  EXPECT_EQ(bus.all[0].id, ToldDrive::Line::request_id);
  EXPECT_TRUE(bus.all[0].perishable);
  EXPECT_EQ(b.cycle->counters().sent, 1U);
}

TEST(CycleDrives, TheLineIsSilentBeforeTheFirstEnablingAndInAFault) {
  Bench b;
  for (int i = 0; i < 3; ++i) {
    b.tick();
    EXPECT_EQ(b.sent(ToldDrive::Line::end_id), 0);
  }
  ASSERT_TRUE(b.start());
  EXPECT_EQ(b.sent(ToldDrive::Line::end_id), 1);
  b.tick(Command::stop);
  for (int i = 0; i < 3; ++i) b.tick();
  ASSERT_EQ(b.state(), State::disabled);
  EXPECT_EQ(b.sent(ToldDrive::Line::end_id), 1) << "once is enough";
  ASSERT_TRUE(b.start());
  b.drive[0].error = true;
  b.tick();
  EXPECT_EQ(b.sent(ToldDrive::Line::end_id), 0);
}

// ---- torque within limits

TEST(CycleDrives, OutputIsJudgedByTheLimitsUnderTorqueAndByZeroWithout) {
  Bench b;
  b.tick();
  EXPECT_TRUE(b.cycle->output_ok());
  ASSERT_TRUE(b.start());
  const auto r = b.tick();
  EXPECT_NE(r.torque[0], 0.0);
  EXPECT_NE(r.torque[2], 0.0);
  EXPECT_TRUE(b.cycle->output_ok());
  for (const int joint : {1, 3}) {  // a joint without a motor, where zero is not within the limit
    Bench odd;
    odd.config.controller.torque_limit[joint] = -1.0;
    odd.tick();
    EXPECT_TRUE(odd.cycle->output_ok());
    ASSERT_TRUE(odd.start());
    EXPECT_FALSE(odd.cycle->output_ok());
  }
}

/// The whole torque goes, and the tick says so, where one shaft cannot carry what its joint was to get.
TEST(CycleDrives, AShaftThatCannotCarryItsTorqueEndsAll) {
  for (const Sensors sensors : {Sensors::base, Sensors::all}) {
    for (const unsigned motor : {0U, 1U}) {
      Bench b(sensors);
      b.config.controller.torque_limit = {2.0, 2.0, 2.0, 2.0};
      Script& weak = b.drive[motor * (sensors == Sensors::all ? 2 : 1)];
      weak.carries = 1e-6F;
      b.tick();
      b.tick(Command::enable);
      TickResult<Five> r;
      for (int i = 0; i < 3 && b.fault() == Fault::none; ++i) r = b.tick();
      EXPECT_EQ(b.fault(), Fault::torque_not_finite);
      EXPECT_EQ(r.state, State::fault);
      EXPECT_EQ(r.fault, Fault::torque_not_finite);
      EXPECT_EQ(r.torque.norm(), 0.0);
      EXPECT_EQ(weak.torque, 0.0F);
      EXPECT_TRUE(b.cycle->output_ok());
    }
  }
}

/// Each motor by the limit of its own joint: the second one has a limit that its shaft cannot carry.
TEST(CycleDrives, EachShaftIsMeasuredByItsOwnJoint) {
  for (const Sensors sensors : {Sensors::base, Sensors::all}) {
    Bench b(sensors);
    b.config.controller.torque_limit = {1e-9, 1.0, 2.0, 1.0};
    b.drive[sensors == Sensors::all ? 2 : 1].carries = 1e-6F;
    EXPECT_FALSE(b.start());
    EXPECT_EQ(b.fault(), Fault::torque_not_finite);
  }
}

// ---- waiting for drives

/// Ticks of enabling until the fault; 0: none in 2000.
int ticks_until_given_up(Bench& b) {
  b.tick(Command::enable);
  for (int n = 1; n < 2000; ++n) {
    if (b.fault() == Fault::enabling_timeout) return n;
    b.tick();
  }
  return 0;
}

/// A motor is there when it speaks, an encoder when it measures.
TEST(CycleDrives, AMotorCountsByItsFramesAndAnEncoderByItsSamples) {
  for (unsigned axis = 0; axis < 4; ++axis) {
    Bench b(Sensors::all);
    b.config.waiting_ticks_max = 10;
    b.drive[0].ready = false;
    b.drive[2].sets_up = true;  // as long as everybody is there, it may take its time
    b.drive[axis].samples = false;
    EXPECT_EQ(ticks_until_given_up(b), axis % 2 == 0 ? 0 : 10) << axis;
  }
  for (const unsigned axis : {0U, 1U}) {
    Bench b;
    b.config.waiting_ticks_max = 10;
    b.drive[0].ready = false;
    b.drive[1].sets_up = true;
    b.drive[axis].samples = false;
    EXPECT_EQ(ticks_until_given_up(b), 0) << axis;
  }
}

TEST(CycleDrives, OnlyASetUpOfAMotorIsWaitedFor) {
  for (unsigned axis = 0; axis < 4; ++axis) {
    Bench b(Sensors::all);
    b.config.waiting_ticks_max = 10;
    b.drive[0].ready = false;
    b.drive[axis].sets_up = true;
    EXPECT_EQ(ticks_until_given_up(b), axis % 2 == 0 ? 0 : 10) << axis;
  }
  for (const unsigned axis : {0U, 1U}) {
    Bench b;
    b.config.waiting_ticks_max = 10;
    b.drive[0].ready = false;
    b.drive[axis].sets_up = true;
    EXPECT_EQ(ticks_until_given_up(b), 0) << axis;
  }
}

/// A drive that spoke once, long before the order, is silent.
TEST(CycleDrives, ASilentDriveIsAskedFirstHoweverLongAgoItSpoke) {
  for (const bool after_a_stop : {false, true}) {
    for (const auto& [sensors, silent, other] : {std::tuple{Sensors::base, 0U, 1U},
                                                 {Sensors::base, 1U, 0U},
                                                 {Sensors::all, 0U, 2U},
                                                 {Sensors::all, 2U, 0U}}) {
      Bench b(sensors);
      for (Script& d : b.drive) d.ready = false;
      for (int i = 0; i < 5; ++i) b.tick();
      if (after_a_stop) {
        b.tick(Command::enable);
        for (int i = 0; i < 5; ++i) b.tick();
        b.tick(Command::stop);
        for (int i = 0; i < 5; ++i) b.tick();
        ASSERT_EQ(b.state(), State::disabled);
      }
      b.quiet[silent] = true;
      b.tick();
      const int asked = b.drive[silent].enabled, others = b.drive[other].enabled;
      b.tick(Command::enable);
      for (int i = 0; i < 5; ++i) b.tick();
      EXPECT_EQ(b.drive[silent].enabled - asked, 6);
      EXPECT_EQ(b.drive[other].enabled, others) << "it waits for the other one";
      b.quiet[silent] = false;
      b.tick();
      EXPECT_EQ(b.drive[silent].enabled - asked, 7);
      EXPECT_EQ(b.drive[other].enabled - others, 1);
    }
  }
}

TEST(CycleDrives, ErrorsAreKnownWhenEveryAxisHasReported) {
  struct Case {
    std::uint32_t age;
    bool within, just_now;
  };
  for (const auto& [age, within, just_now] :
       {Case{0, true, true}, Case{1, true, true}, Case{2, true, false}, Case{silence_max, true, false},
        Case{silence_max + 1, false, false}}) {
    for (const unsigned axis : {0U, 1U}) {
      Bench b;
      for (Script& d : b.drive) d.ready = false;
      b.tick();
      b.tick(Command::enable);
      b.quiet[axis] = true;
      for (std::uint32_t n = 0; n < age; ++n) b.tick();
      if (age == 0) b.quiet[axis] = false, b.tick();
      for (const unsigned i : {0U, 1U})
        EXPECT_EQ(b.drive[i].known, (std::array<bool, 2>{within, just_now})) << age;
    }
  }
}

/// In lockstep a long time may pass between two ticks; under torque the cycle waits for no drive.
TEST(CycleDrives, TimeThatPassesUnderTorqueIsNoWaitForDrives) {
  Bench b;
  ASSERT_TRUE(b.start());
  b.cycle->time_passed(900'000);
  b.tick(Command::none, false);
  EXPECT_EQ(b.fault(), Fault::none);
  EXPECT_EQ(b.state(), State::running);
}

TEST(CycleDrives, TimeThatPassedIsCountedOnce) {
  Bench b;
  b.drive[0].ready = false;
  b.tick(Command::enable);
  b.cycle->time_passed(700'000);  // of the 750 ticks of 1 ms that it may wait
  b.tick(Command::none, false);
  for (int i = 0; i < 200; ++i) b.tick(Command::none, false);
  EXPECT_EQ(b.fault(), Fault::none) << "no time has passed since";
  b.cycle->time_passed(100'000);
  b.tick(Command::none, false);
  EXPECT_EQ(b.fault(), Fault::enabling_timeout);
}

}  // namespace
}  // namespace esmc::test
