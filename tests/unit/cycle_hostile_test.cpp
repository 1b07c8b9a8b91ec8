/// A hostile bus: random identifiers, lengths, formats, bytes, duplicates and losses, in every state.
/// Whatever arrives, only well-formed commands with bounded torque leave, and none but zero unless the cycle
/// runs.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <random>

#include "tests/support/cycle_rig.hpp"

namespace {

using namespace esmc;
using test::Rig;
using test::Setup;
using test::setup;

class Attacker {
 public:
  explicit Attacker(std::uint64_t seed) : random_(seed) {}

  std::uint32_t below(std::uint32_t n) { return static_cast<std::uint32_t>(random_() % n); }
  bool one_in(std::uint32_t n) { return below(n) == 0; }

  float number() {
    const float plain = static_cast<float>(below(20001)) * 1e-3F - 10.0F;
    switch (below(8)) {
      case 0:
        return std::numeric_limits<float>::quiet_NaN();
      case 1:
        return one_in(2) ? std::numeric_limits<float>::infinity() : std::numeric_limits<float>::max();
      case 2:
        return std::bit_cast<float>(static_cast<std::uint32_t>(random_()));
      case 3:
        return std::numeric_limits<float>::denorm_min();
      default:
        return plain;
    }
  }

  hal::CanFrame frame() {
    const unsigned node = test::mountings[below(4)].node;
    hal::CanFrame f;
    switch (below(6)) {
      case 0:
        f = test::heartbeat(node, static_cast<std::uint8_t>(one_in(2) ? 8 : below(256)),
                            one_in(2) ? 0 : 1U << below(32));
        break;
      case 1:
        f = test::encoder(node, number(), number());
        break;
      case 2:
        f = test::heartbeat(node, 8);
        break;
      case 3:
        f = test::message(node, below(32), below(16), below(16));
        break;
      default:
        f.id = below(0x800);
        f.size = static_cast<std::uint8_t>(below(9));
        for (auto& byte : f.data) byte = static_cast<std::uint8_t>(random_());
    }
    if (one_in(8)) f.size = static_cast<std::uint8_t>(below(65));
    if (one_in(20)) f.remote = true;
    if (one_in(20)) f.fd = true;
    if (one_in(20)) f.extended = true;
    if (one_in(50)) f.id ^= 1U << below(29);
    return f;
  }

 private:
  std::mt19937_64 random_;
};

template <class M>
struct Inspector {
  std::array<std::uint32_t, fault_count> faults{};
  std::uint32_t running = 0, pushing = 0;

  void inspect(const Rig<M>& rig, const TickResult<M>& r) {
    ASSERT_EQ(r.fault != Fault::none, r.state == State::fault);
    ++faults[static_cast<std::size_t>(r.fault)];
    running += r.state == State::running ? 1U : 0U;
    for (const auto& f : rig.bus.sent()) inspect(rig, r, f);
    for (std::size_t i = 0; i < rig.motors(); ++i) {
      ASSERT_LE(rig.torque_frames(rig.axis_of_motor(i)), 1);
    }
    if (r.state != State::running) {
      ASSERT_TRUE(r.torque.isZero(0));
    }
  }

  void inspect(const Rig<M>& rig, const TickResult<M>& r, const hal::CanFrame& f) {
    ASSERT_FALSE(f.extended || f.remote || f.fd || f.bit_rate_switch);
    std::size_t axis = 99;
    for (std::size_t i = 0; i < rig.motors(); ++i) {
      if (test::node_of(f) == rig.node(rig.axis_of_motor(i))) axis = rig.axis_of_motor(i);
    }
    ASSERT_NE(axis, 99U) << "a command to another node: " << std::hex << f.id;
    switch (test::command_of(f)) {
      case test::cmd_torque: {
        const float torque = test::real(f, 0);
        ASSERT_TRUE(std::isfinite(torque));
        const int joint = static_cast<int>(rig.joint_of(axis));
        const double limit = static_cast<double>(rig.controller().torque_limit[joint]);
        ASSERT_LE(std::abs(static_cast<double>(torque)), limit / test::mountings[axis].gear * (1 + 1e-6));
        if (r.state != State::running) {
          ASSERT_EQ(torque, 0.0F) << name(r.state);
        }
        pushing += torque != 0.0F ? 1U : 0U;
        break;
      }
      case test::cmd_axis_state:
        ASSERT_EQ(test::word(f, 0), r.state == State::enabling ? 8U : 1U) << name(r.state);
        ASSERT_NE(r.state, State::running);
        break;
      case test::cmd_mode:
        ASSERT_EQ(test::word(f, 0), 1U);
        ASSERT_EQ(test::word(f, 4), 1U);
        [[fallthrough]];
      case test::cmd_clear_errors:
        ASSERT_EQ(r.state, State::enabling);
        break;
      default:
        FAIL() << "a command that must not be sent: " << std::hex << f.id;
    }
  }
};

/// `sequences` bursts of hostile ticks, each in a cycle that was just put into some state.
template <class M>
Inspector<M> attack(const Setup<M>& s, int sequences, std::uint64_t seed) {
  Attacker attacker(seed);
  Inspector<M> seen;
  Rig<M> rig(s);
  for (int n = 0; n < sequences && !testing::Test::HasFatalFailure(); ++n) {
    if (attacker.one_in(4)) rig = Rig<M>(s);
    rig.obedient = !attacker.one_in(8);
    if (rig.cycle.supervisor().state() == State::fault) rig.tick(Command::reset);
    if (!attacker.one_in(8)) (void)rig.start(8);
    for (std::uint32_t ticks = attacker.below(4); ticks > 0; --ticks) {
      for (std::uint32_t frames = attacker.below(6); frames > 0; --frames) {
        const hal::CanFrame f = attacker.frame();
        rig.bus.push(f);
        if (attacker.one_in(10)) rig.bus.push(f);
      }
      rig.sends_encoder.fill(!attacker.one_in(4));
      rig.sends_heartbeat.fill(!attacker.one_in(4));
      if (attacker.one_in(30)) rig.bus.answer(hal::SendStatus::bus_off, attacker.below(3));
      if (attacker.one_in(30)) rig.bus.answer(hal::SendStatus::bus_full, attacker.below(3));
      const auto command = static_cast<Command>(attacker.one_in(3) ? attacker.below(4) : 0);
      const bool before = attacker.one_in(2);  // hostile frames before or after the healthy ones
      const auto r = before ? rig.tick(command) : rig.bare_tick(command);
      seen.inspect(rig, r);
      rig.bus.answer(hal::SendStatus::ok);
    }
    rig.sends_encoder.fill(true);
    rig.sends_heartbeat.fill(true);
    seen.inspect(rig, rig.tick());
  }
  return seen;
}

template <class M>
void expect_thorough(const Inspector<M>& seen, int sequences) {
  EXPECT_GT(seen.running, static_cast<std::uint32_t>(sequences) / 4) << "most attacks hit a cycle that runs";
  EXPECT_GT(seen.pushing, static_cast<std::uint32_t>(sequences) / 4);
  for (const Fault f : {Fault::feedback_not_finite, Fault::stale_feedback, Fault::malformed_frame,
                        Fault::drive_error, Fault::drive_disarmed, Fault::bus_off, Fault::joint_speed}) {
    EXPECT_GT(seen.faults[static_cast<std::size_t>(f)], 20U) << name(f);
  }
}

constexpr int sequences = 100000;

TEST(CycleHostile, FiveBarWithTwoMotors) {
  expect_thorough(attack(setup<FiveBar<double>>(), sequences, 1), sequences);
}

TEST(CycleHostile, FiveBarWithFourMotorsAndPassiveEncoders) {
  auto s = setup<FiveBar<double>>();
  s.controller.motors = Motors::all;
  s.controller.sensors = Sensors::all;
  s.controller.law = LawKind::esmc_projected;
  s.version = drive::odrive::Version::v0_5_6;
  expect_thorough(attack(s, sequences, 2), sequences);
}

TEST(CycleHostile, ArmInFloat) { expect_thorough(attack(setup<Rr<float>>(), sequences, 3), sequences); }

/// No limit but the torque's, a stiff sign law: everything that can overflow does.
TEST(CycleHostile, ArmInFloatWithoutLimits) {
  auto s = setup<Rr<float>>();
  const float most = std::numeric_limits<float>::max();
  s.controller.limits.joint_speed = most;
  s.controller.limits.joint_angle = {};
  s.controller.limits.workspace_x = s.controller.limits.workspace_y = {};
  s.controller.limits.min_abs_sin_type1 = 0.0F;
  s.controller.reaching = Reaching::sign;
  s.controller.gains.k.setConstant(1e30F);
  const auto seen = attack(s, sequences / 2, 4);
  EXPECT_GT(seen.pushing, 1000U);
}

}  // namespace
