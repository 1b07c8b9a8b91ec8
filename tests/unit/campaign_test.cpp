/// The campaign's own parts: a judge that cannot condemn would pass everything, so each invariant is broken
/// here by a world made for it; the wire's faults are looked at byte by byte.

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>
#include <set>
#include <string>

#include "host_sim/campaign/faulty_bus.hpp"
#include "host_sim/campaign/injections.hpp"
#include "host_sim/campaign/judge.hpp"
#include "host_sim/campaign/protocol_traits.hpp"
#include "tests/support/odrive_bytes.hpp"

namespace {

using namespace esmc;
using namespace esmc::host;

TEST(Draw, GivesThePublishedSequenceOfSplitMix64) {
  Draw zero(0), d(1234567);
  EXPECT_EQ(zero.bits(), 0xE220'A839'7B1D'CDAFULL);
  EXPECT_EQ(d.bits(), 6457827717110365317ULL);
  EXPECT_EQ(d.bits(), 3203168211198807973ULL);
  EXPECT_EQ(d.bits(), 9817491932198370423ULL);
}

TEST(Draw, StaysWithinItsBounds) {
  Draw d(3);
  bool low = false, high = false, negative = false, positive = false;
  for (int i = 0; i < 10000; ++i) {
    const int n = d.between(-2, 2);
    ASSERT_TRUE(n >= -2 && n <= 2);
    low = low || n == -2;
    high = high || n == 2;
    const double u = d.uniform();
    ASSERT_TRUE(u >= 0 && u < 1);
    const double m = d.signed_magnitude(1e3, 3e38);
    ASSERT_TRUE(std::abs(m) >= 1e3 && std::abs(m) <= 3e38);
    negative = negative || m < 0;
    positive = positive || m > 0;
  }
  EXPECT_TRUE(low && high && negative && positive);
}

const InjectionRow& row(std::string_view name) {
  for (const InjectionRow& r : injection_rows()) {
    if (r.name == name) return r;
  }
  throw std::runtime_error("no such fault: " + std::string(name));
}

/// No protocol has every fault; together they have.
TEST(Injections, EveryFaultIsDrawnInEveryPhaseItHas) {
  std::set<std::pair<std::string_view, Phase>> seen, wanted;
  std::set<std::string_view> names;
  for (const InjectionRow& r : injection_rows()) {
    EXPECT_TRUE(names.insert(r.name).second) << r.name;
    for (unsigned p = 0; p < phase_count; ++p) {
      if ((r.phases >> p) % 2 == 1) wanted.insert({r.name, static_cast<Phase>(p)});
    }
  }
  EXPECT_GE(names.size(), 30U);
  EpisodeTimes t;
  t.join_ticks = 50;
  t.halt_ticks = 30;
  t.max_age_ticks = 2;
  t.heartbeat_ticks = 50;
  t.link_ticks = 100;
  t.zeros_at_boot = true;
  std::array<int, 2> drives{};
  for (std::uint64_t seed = 0; seed < 5000; ++seed) {
    Draw d(seed);
    const Protocol p = seed % 2 == 0 ? Protocol::odrive : Protocol::cia402;
    const Injection i = draw_injection(d, t, protocol_traits(p));
    ASSERT_TRUE(possible(*i.row, protocol_traits(p), t));
    seen.insert({i.row->name, i.phase});
    ++drives[i.drive];
    ASSERT_GE(i.length, 1);
    ASSERT_TRUE(i.row->longest == 0 || (i.length >= i.row->shortest && i.length <= i.row->longest));
  }
  EXPECT_EQ(seen, wanted);
  EXPECT_GT(drives[0], 2000);
  EXPECT_GT(drives[1], 2000);
}

TEST(Injections, WhatIsDueDependsOnHowManySamplesAreGone) {
  EpisodeTimes t;
  t.join_ticks = 50;
  t.max_age_ticks = 4;
  t.heartbeat_ticks = 50;
  for (std::uint64_t seed = 0; seed < 5000; ++seed) {
    Draw d(seed);
    const Injection i = draw_injection(d, t, protocol_traits(Protocol::odrive));
    if (i.row->kind == Injected::loss) {
      EXPECT_EQ(i.must_pass, i.length <= 4);
      EXPECT_EQ(i.stale, i.length > 4);
      EXPECT_EQ(i.notice_ticks, i.length <= 4 ? -1 : 4);
    }
    if (i.row->kind == Injected::heartbeat_lost) {
      EXPECT_EQ(i.notice_ticks, 52);
    }
  }
}

TEST(Injections, ListsHoldWholeWords) {
  EXPECT_TRUE(lists("none stale_feedback", "none"));
  EXPECT_TRUE(lists("none stale_feedback", "stale_feedback"));
  EXPECT_FALSE(lists("none stale_feedback", "stale"));
  EXPECT_FALSE(lists("", "none"));
}

// ---- the judge

struct FakeMotion {
  double held = 1.0, done = 0.0;
  [[nodiscard]] double energy() const { return held; }
  [[nodiscard]] double work() const { return done; }
};
struct FakeWorld {
  std::array<MotorState, 2> state{};
  std::array<double, 2> way{};
  FakeMotion moved;
  bool brake_off = true;
  [[nodiscard]] std::size_t motors() const { return 2; }
  [[nodiscard]] const MotorState& motor(std::size_t i) const { return state[i]; }
  [[nodiscard]] double turned(std::size_t i) const { return way[i]; }
  [[nodiscard]] bool released() const { return brake_off; }
  [[nodiscard]] const FakeMotion& motion() const { return moved; }
};
struct FakeWire {
  bool second_hears = true;
  [[nodiscard]] bool hears(std::size_t i) const { return i == 0 || second_hears; }
};

/// A loop that runs well until a test breaks something.
class Court : public testing::Test {
 protected:
  void accuse(std::string_view fault) {
    injection.row = &row(fault);
    injection.notice_ticks = injection.row->notice_ticks;
    injection.safe_ms = injection.notice_ticks + 1.0;
  }
  /// One tick; torques are heard by both drives in it.
  void tick(Operator asked = Operator::nothing, bool first = false) {
    for (MotorState& m : world.state) {
      m.heard_now = word.ticked;
      if (word.ticked) m.heard_ms = m.fed_ms = static_cast<double>(now) + 0.3;
    }
    bare_tick(asked, first);
  }
  void bare_tick(Operator asked = Operator::nothing, bool first = false) {
    judge.look(now++, asked, word, world, wire, first);
  }
  void torque(double t) {
    for (MotorState& m : world.state) {
      if (t == 0.0 && m.torque != 0.0) m.zero_ms = static_cast<double>(now) + 0.3;
      m.torque = t;
      m.limit = 2.0;
    }
  }
  void run(int ticks = 5) {
    word = {true, false, false, "none"};
    torque(0.0);
    tick(Operator::enable);
    word.powered = true;
    torque(1.0);
    for (int i = 0; i < ticks; ++i) tick();
  }
  void latch(std::string_view fault, bool zero = true) {
    word = {true, false, true, fault};
    if (zero) torque(0.0);
  }
  std::string verdict() {
    judge.end();
    return std::string(judge.verdict().invariant);
  }

  Injection injection{.row = &row("nothing"), .phase = Phase::running};
  // Of 1 kHz where nothing else is said.
  EpisodeTimes times{.tick = 1e-3,
                     .join_ticks = 10,
                     .halt_ticks = 10,
                     .max_age_ticks = 2,
                     .heartbeat_ticks = 50,
                     .off_after_halt_ticks = 44,
                     .motors = 2};
  Judge judge{injection, times, true, true};
  FakeWorld world;
  FakeWire wire;
  ControllerWord word;
  std::uint64_t now = 0;
};

TEST_F(Court, AcquitsALoopThatRunsWell) {
  run(100);
  EXPECT_EQ(verdict(), "");
}
TEST_F(Court, TorqueThatIsNotANumber) {
  run();
  world.state[1].torque = std::numeric_limits<double>::quiet_NaN();
  tick();
  EXPECT_EQ(verdict(), "torque_finite");
}
TEST_F(Court, TorqueAboveTheLimit) {
  run();
  torque(2.0000001);
  tick();
  EXPECT_EQ(judge.verdict().invariant, "") << "a float's rounding is none";
  torque(-2.00001);
  tick();
  EXPECT_EQ(verdict(), "torque_limit");
}
TEST_F(Court, TorqueUnderTheBrake) {
  run();
  world.brake_off = false;
  tick();
  EXPECT_EQ(verdict(), "torque_before_armed");
}
TEST_F(Court, TorqueNotAllowed) {
  word = {true, true, false, "none"};
  torque(1.0);
  tick();
  EXPECT_EQ(verdict(), "torque_not_allowed");
}
TEST_F(Court, ADriveThatIsArmedWithoutAnOrder) {
  run();
  torque(0.0);
  tick(Operator::stop);
  tick();
  world.state[1].armed_now = true;
  tick();
  EXPECT_EQ(verdict(), "armed_without_order");
}
TEST_F(Court, AnOrderToArmThatMetSilentDrivesIsOver) {
  accuse("late_power");
  injection.usable_tick = 2000;
  word = {true, false, false, "none"};
  tick(Operator::enable, true);
  for (int i = 0; i < times.silent_ticks; ++i) tick();
  world.state[0].armed_now = true;
  tick();
  EXPECT_EQ(verdict(), "armed_without_order");
}
TEST_F(Court, AnOrderToArmThatDrivesCanHearIsNone) {
  accuse("late_power");
  injection.usable_tick = times.silent_ticks;
  word = {true, false, false, "none"};
  tick(Operator::enable, true);
  for (int i = 0; i < times.silent_ticks; ++i) tick();
  world.state[0].armed_now = true;
  tick();
  EXPECT_EQ(verdict(), "");
}
TEST_F(Court, TorqueAfterStop) {
  run();
  tick(Operator::stop);
  EXPECT_EQ(verdict(), "torque_not_allowed");
}
TEST_F(Court, AHaltEnds) {
  run();
  tick(Operator::halt);
  for (int i = 0; i < 43; ++i) tick();
  EXPECT_EQ(judge.verdict().invariant, "");
  tick();
  EXPECT_EQ(verdict(), "torque_not_allowed");
}
TEST_F(Court, TorqueAgainstTheControllersWord) {
  run();
  word.powered = false;
  tick();
  EXPECT_EQ(verdict(), "torque_without_power");
}
TEST_F(Court, NoResumeWithoutTheOperator) {
  accuse("flood");
  run();
  latch("bus_overload");
  tick(Operator::nothing, true);
  tick();
  word = {true, true, false, "none"};
  torque(1.0);
  tick(Operator::enable);
  EXPECT_EQ(verdict(), "torque_after_fault");
}
TEST_F(Court, ResumeAfterAReset) {
  accuse("flood");
  run();
  latch("bus_overload");
  tick(Operator::nothing, true);
  word = {true, false, false, "none"};
  tick(Operator::reset);
  tick(Operator::enable);
  word.powered = true;
  torque(1.0);
  tick();
  EXPECT_EQ(verdict(), "");
}
TEST_F(Court, TorqueNotRenewed) {
  accuse("controller_death");
  run();
  word.ticked = false;
  bare_tick(Operator::nothing, true);
  for (int i = 0; i < 11; ++i) tick();
  EXPECT_EQ(judge.verdict().invariant, "");
  tick();
  EXPECT_EQ(verdict(), "watchdog");
}
/// The drive hears commands, and not what its watchdog watches.
TEST_F(Court, ACommandIsNoSignOfLife) {
  run();
  for (int i = 0; i < 12; ++i) {
    for (MotorState& m : world.state) m.heard_ms = static_cast<double>(now) + 0.3;
    bare_tick();
  }
  EXPECT_EQ(judge.verdict().invariant, "");
  bare_tick();
  EXPECT_EQ(verdict(), "watchdog");
}
TEST_F(Court, AFaultThatFitsThisSceneOnly) {
  accuse("frame_loss");
  run();
  tick(Operator::nothing, true);
  latch("heartbeat_lost");
  tick();
  Judge strict = judge;
  strict.end();
  EXPECT_EQ(strict.verdict().invariant, "fault_name");
  injection.fits_too = " heartbeat_lost drive_error";
  EXPECT_EQ(verdict(), "");
}
TEST_F(Court, DeathIsMeasuredFromTheLastCommand) {
  accuse("controller_death");
  run();
  word.ticked = false;
  tick(Operator::nothing, true);
  for (int i = 0; i < 8; ++i) tick();
  torque(0.0);
  tick();
  EXPECT_EQ(verdict(), "");
  EXPECT_NEAR(judge.reaction().death_ms, 10.0, 1e-9);
}
TEST_F(Court, AFaultNoticedTooLate) {
  accuse("foreign_controller");
  run();
  tick(Operator::nothing, true);
  EXPECT_EQ(judge.verdict().invariant, "");
  tick();
  EXPECT_EQ(verdict(), "notice_time");
}
TEST_F(Court, AFaultNoticedInTime) {
  accuse("foreign_controller");
  run();
  tick(Operator::nothing, true);
  latch("foreign_controller");
  tick();
  EXPECT_EQ(verdict(), "");
  EXPECT_NEAR(judge.reaction().notice_ms, 1.0, 1e-9);
  EXPECT_NEAR(judge.reaction().safe_ms, 1.3, 1e-9);
}
TEST_F(Court, AStopTakesTheNeedToNoticeAway) {
  accuse("foreign_controller");
  run();
  torque(0.0);
  word.powered = false;
  tick(Operator::stop, true);
  for (int i = 0; i < 10; ++i) tick();
  EXPECT_EQ(verdict(), "");
}
TEST_F(Court, TorqueThatGoesTooLate) {
  accuse("flood");
  run();
  latch("bus_overload", false);
  world.state[0].heard_now = world.state[1].heard_now = false;
  bare_tick(Operator::nothing, true);
  EXPECT_EQ(judge.verdict().invariant, "");
  bare_tick();
  EXPECT_EQ(verdict(), "safe_time");
}
TEST_F(Court, ADriveThatCannotHearIsItsWatchdogsBusiness) {
  accuse("flood");
  run();
  wire.second_hears = false;
  latch("bus_overload", false);
  world.state[0].torque = 0.0;
  world.state[0].zero_ms = static_cast<double>(now) + 0.3;
  world.state[1].heard_now = false;
  for (int i = 0; i < 5; ++i) bare_tick(Operator::nothing, i == 0);
  EXPECT_EQ(verdict(), "");
}
TEST_F(Court, AFaultOfAnotherName) {
  accuse("flood");
  run();
  latch("joint_speed");
  tick(Operator::nothing, true);
  EXPECT_EQ(verdict(), "fault_name");
}
TEST_F(Court, AFaultWithoutACause) {
  accuse("flood");
  run();
  latch("bus_overload");
  tick();
  EXPECT_EQ(verdict(), "fault_without_cause");
}
TEST_F(Court, NothingHappensAndAFaultIsLatched) {
  run();
  latch("joint_speed");
  tick();
  EXPECT_EQ(verdict(), "fault_name");
}
TEST_F(Court, EnergyFromNowhere) {
  run();
  torque(0.0);
  tick();
  world.moved.held = 1.0005;
  tick();
  EXPECT_EQ(judge.verdict().invariant, "");
  world.moved.held = 1.002;
  tick();
  EXPECT_EQ(verdict(), "energy_without_torque");
}
/// A joint that spins by 0.3 rad in each of two steps: 2 x 0.3^5 of the energy is not resolved, per joint.
TEST_F(Court, EnergyOfASpinThatStepsDoNotResolve) {
  times.steps_per_tick = 2;
  Judge coarse{injection, times, true, true};
  accuse("frozen_sensor");
  const auto look = [&](bool first) {
    coarse.look(now++, Operator::nothing, {true, false, true, "joint_speed"}, world, wire, first);
  };
  look(true);
  world.way = {0.6, 0.6};
  world.moved.held = 1.0 + 1e-3 + 4 * 0.00243 - 1e-4;
  look(false);
  EXPECT_EQ(coarse.verdict().invariant, "");
  world.way = {};
  world.moved.held += 4e-4;
  look(false);
  EXPECT_EQ(coarse.verdict().invariant, "energy_without_torque");
}
TEST_F(Court, EnergyThatItsSurroundingsGave) {
  run();
  torque(0.0);
  tick();
  world.moved.held = 2.0;
  world.moved.done = 1.0;
  tick();
  EXPECT_EQ(verdict(), "");
}
TEST_F(Court, MoreEnergyThanTheMotorsHave) {
  accuse("frozen_sensor");
  run();
  tick(Operator::nothing, true);
  world.way = {0.01, 0.02};  // 2 N m over 0.03 rad
  world.moved.held = 1.061;
  tick();
  EXPECT_EQ(judge.verdict().invariant, "");
  world.way = {};
  world.moved.held = 1.063;
  tick();
  EXPECT_EQ(verdict(), "energy_after_fault");
}
TEST_F(Court, AMechanismThatIsNowhere) {
  run();
  world.moved.held = std::numeric_limits<double>::infinity();
  tick();
  EXPECT_EQ(verdict(), "finite");
}

// ---- the wire

class OnTheWire : public testing::Test {
 protected:
  std::vector<hal::CanFrame> sends(FaultyBus& wire, std::vector<hal::CanFrame> frames, bool active = true) {
    wire.begin_tick(active);
    for (const auto& f : frames) wire.from_drive(test::node_of(f) == 5 ? 0 : 1, f);
    wire.inject_foreign_frames();
    std::vector<hal::CanFrame> out;
    for (hal::CanFrame f; wire.try_receive(f);) out.push_back(f);
    return out;
  }
  FaultyBus wire(std::string_view fault, double amount = 0.0, int choice = 0) {
    injection.row = &row(fault);
    injection.amount = amount;
    injection.choice = choice;
    return {injection, protocol_traits(Protocol::odrive), nodes};
  }
  const std::vector<int> nodes{5, 6};
  Injection injection{.drive = 0};
  const hal::CanFrame mine = test::encoder(5, 0.25F, -3.0F), other = test::encoder(6, 1.5F, 2.0F),
                      beat = test::heartbeat(5, 8);
  using Frames = std::vector<hal::CanFrame>;
};

TEST_F(OnTheWire, WithoutAFaultFramesPass) {
  FaultyBus w = wire("flood", 5);
  EXPECT_EQ(sends(w, {beat, mine, other}, false), (Frames{beat, mine, other}));
}
TEST_F(OnTheWire, FramesOfOneDriveAreLost) {
  for (const char* fault : {"frame_loss", "drive_silent", "drive_bus_off"}) {
    FaultyBus w = wire(fault);
    EXPECT_EQ(sends(w, {beat, mine, other}), Frames{other}) << fault;
  }
  FaultyBus w = wire("heartbeat_lost");
  EXPECT_EQ(sends(w, {beat, mine, other}), (Frames{mine, other}));
}
TEST_F(OnTheWire, FramesOfAllAreLost) {
  for (const char* fault : {"babbling_node", "controller_bus_off"}) {
    FaultyBus w = wire(fault);
    EXPECT_EQ(sends(w, {beat, mine, other}), Frames{}) << fault;
  }
}
TEST_F(OnTheWire, FramesComeTwiceLateOrOvertaken) {
  FaultyBus twice = wire("duplication");
  EXPECT_EQ(sends(twice, {mine, other}), (Frames{mine, mine, other}));
  FaultyBus late = wire("delay", 2);
  EXPECT_EQ(sends(late, {mine, other}), Frames{other});
  EXPECT_EQ(sends(late, {other}), Frames{other});
  EXPECT_EQ(sends(late, {other}), (Frames{other, mine}));
  FaultyBus order = wire("reordering");
  const hal::CanFrame next = test::encoder(5, 0.5F, 0.0F);
  EXPECT_EQ(sends(order, {mine}), Frames{mine});  // an odd tick
  EXPECT_EQ(sends(order, {mine}), Frames{});
  EXPECT_EQ(sends(order, {next}), (Frames{next, mine}));
}
TEST_F(OnTheWire, NumbersInASample) {
  for (int choice = 0; choice < 8; ++choice) {
    FaultyBus w = wire("not_finite", 0, choice);
    const Frames f = sends(w, {beat, mine});
    ASSERT_EQ(f.size(), 2U);
    EXPECT_EQ(f[0], beat);
    EXPECT_FALSE(std::isfinite(test::real(f[1], choice % 2 == 0 ? 0 : 4)));
    EXPECT_TRUE(std::isfinite(test::real(f[1], choice % 2 == 0 ? 4 : 0)));
  }
  FaultyBus w = wire("huge", -1e30, 1);
  EXPECT_EQ(test::real(sends(w, {mine})[0], 4), -1e30F);
}
TEST_F(OnTheWire, FormatsAndLengths) {
  FaultyBus w = wire("wrong_length");
  for (int i = 0; i < 50; ++i) EXPECT_LT(sends(w, {mine})[0].size, 8);
  FaultyBus rtr = wire("remote_frame");
  EXPECT_TRUE(sends(rtr, {mine})[0].remote);
  FaultyBus fd = wire("fd_frame");
  EXPECT_TRUE(sends(fd, {mine})[0].fd);
  FaultyBus ext = wire("extended_frame");
  EXPECT_TRUE(sends(ext, {mine})[0].extended);
}
TEST_F(OnTheWire, BitsFlip) {
  FaultyBus w = wire("corruption");
  int flipped = 0;
  for (int i = 0; i < 50; ++i) {
    const hal::CanFrame f = sends(w, {mine})[0];
    EXPECT_EQ(f.id, mine.id);
    flipped += f == mine ? 0 : 1;
  }
  EXPECT_GT(flipped, 40);
}
TEST_F(OnTheWire, AFlood) {
  FaultyBus w = wire("flood", 1200);
  const Frames f = sends(w, {mine});
  EXPECT_EQ(f.size(), 1201U);
  // Extended identifiers below 0x10000 are commands to a moteus or a drive of CubeMars.
  for (std::size_t i = 1; i < f.size(); ++i) EXPECT_TRUE(f[i].extended && f[i].id > 0xFFFF) << f[i].id;
}
TEST_F(OnTheWire, WhatTheControllerSends) {
  const hal::CanFrame torque = test::message(5, test::cmd_torque, 0, 0);
  const auto send = [&](std::string_view fault) {
    FaultyBus w = wire(fault);
    w.begin_tick(true);
    const hal::SendStatus s = w.try_send(torque);
    return std::pair{s, w.to_drives().size()};
  };
  using enum hal::SendStatus;
  EXPECT_EQ(send("nothing"), (std::pair{ok, std::size_t{1}}));
  EXPECT_EQ(send("commands_lost"), (std::pair{ok, std::size_t{0}}));
  EXPECT_EQ(send("torque_lost"), (std::pair{ok, std::size_t{0}}));
  EXPECT_EQ(send("queue_full"), (std::pair{bus_full, std::size_t{0}}));
  EXPECT_EQ(send("babbling_node"), (std::pair{bus_full, std::size_t{0}}));
  EXPECT_EQ(send("controller_bus_off"), (std::pair{bus_off, std::size_t{0}}));
  FaultyBus w = wire("nothing");
  w.begin_tick(true);
  ASSERT_EQ(w.try_send(torque), ok);
  ASSERT_EQ(w.try_send(torque), ok);
  EXPECT_NEAR(w.to_drives()[1].ms, 0.270, 1e-12);  // two frames of 135 bits at 1 Mbit/s
}
TEST_F(OnTheWire, StrangersAreHeardByAll) {
  FaultyBus stop = wire("emergency_stop");
  stop.begin_tick(true);
  stop.inject_foreign_frames_after_tick({});
  ASSERT_EQ(stop.to_drives().size(), 1U);
  EXPECT_EQ(stop.to_drives()[0].frame.id, 5U * 32 + 2);
  EXPECT_FALSE(stop.to_drives()[0].ours);
  hal::CanFrame f;
  EXPECT_TRUE(stop.try_receive(f));
  FaultyBus push = wire("foreign_controller", 0.5, 0);
  push.begin_tick(true);
  push.inject_foreign_frames_after_tick(test::message(5, test::cmd_torque, 0x3F400000, 0));
  ASSERT_EQ(push.to_drives().size(), 1U);
  EXPECT_EQ(test::command_of(push.to_drives()[0].frame), test::cmd_torque);
  EXPECT_EQ(test::real(push.to_drives()[0].frame, 0), 0.75F);
}

}  // namespace
