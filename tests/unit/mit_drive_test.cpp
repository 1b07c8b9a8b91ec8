/// The emulated drive in MIT mode against the original firmware's rules, and in a loop with the controller.

#include "host_sim/drives/mit_axis.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "host_sim/loop/controller_end.hpp"
#include "host_sim/loop/plant_end.hpp"
#include "tests/support/mit_bytes.hpp"

namespace esmc::host {
namespace {

class MitDrive : public testing::Test {
 protected:
  static MitAxis make(const MitAxis::Settings& s = {}, const AxisMount& m = {.node = 3}) {
    return MitAxis(m, s, SensorEffects({}), 0, 1);
  }
  /// What it sends in a period at this joint angle and rate.
  std::vector<hal::CanFrame> publish(MitAxis& a, double angle = 0.0, double rate = 0.0) {
    std::vector<hal::CanFrame> sent;
    a.publish(angle, rate, [&](const hal::CanFrame& f) { sent.push_back(f); });
    return sent;
  }
  std::vector<hal::CanFrame> tell(MitAxis& a, const hal::CanFrame& f) {
    std::vector<hal::CanFrame> sent;
    completes_ = a.receive(f, [&](const hal::CanFrame& r) { sent.push_back(r); });
    return sent;
  }
  static hal::CanFrame torque(unsigned code) { return test::mit_command(3, 0x8000, 0x800, 0, 0, code); }

  bool completes_ = false;
};

TEST_F(MitDrive, RepliesOncePerPeriodInLockstepAndOncePerCommandInRealTime) {
  MitAxis lockstep = make();
  EXPECT_EQ(publish(lockstep).size(), 1U);
  EXPECT_TRUE(tell(lockstep, torque(0)).empty());
  EXPECT_TRUE(completes_);
  EXPECT_TRUE(tell(lockstep, test::mit_special(3, 0xFC)).empty());
  EXPECT_FALSE(completes_) << "no command of a tick";
  MitAxis live = make({.realtime = true});
  EXPECT_TRUE(publish(live).empty());
  EXPECT_EQ(tell(live, torque(0)).size(), 1U);
  EXPECT_EQ(tell(live, test::mit_special(3, 0xFC)).size(), 1U);
  EXPECT_EQ(tell(live, test::mit_special(3, 0xFD)).size(), 1U);
}

TEST_F(MitDrive, WhoAsksBeforeTheFirstPeriodIsToldWhereTheShaftStands) {
  MitAxis a = make({.realtime = true}), b = make({.realtime = true});
  a.settle(1.25);
  const auto early = tell(a, torque(0));
  publish(b, 1.25);
  EXPECT_EQ(test::mit_p(early.at(0)), test::mit_p(tell(b, torque(0)).at(0)));
  EXPECT_NE(test::mit_p(early.at(0)), 0x7FFFU);
}

/// (int)((x - min) (2^n - 1) / (max - min)), by hand.
TEST_F(MitDrive, CodesAreTruncated) {
  MitAxis a = make();
  const auto f = publish(a, 6.25, -25.0)[0];
  EXPECT_EQ(f.id, 0U);
  EXPECT_EQ(f.size, 6);
  EXPECT_EQ(f.data[0], 3);
  EXPECT_EQ(test::mit_p(f), 49151U) << "49151.25";
  EXPECT_EQ(test::mit_v(f), 1023U) << "1023.75";
  EXPECT_EQ(test::mit_t(f), 2047U) << "2047.5: zero";
}

TEST_F(MitDrive, WhatIsOutOfRangeWrapsAround) {
  MitAxis a = make();
  // (12.6 + 12.5) 65535 / 25 = 65797.14, less 65536; (-50.1 + 50) 4095 / 100 = -4.095, truncated, is 4092 of
  // 4096.
  const auto f = publish(a, 12.6, -50.1)[0];
  EXPECT_EQ(test::mit_p(f), 261U);
  EXPECT_EQ(test::mit_v(f), 4092U);
  EXPECT_EQ(test::mit_p(publish(a, std::nan(""), 0.0)[0]), 0U);
}

TEST_F(MitDrive, MountingTurnsAnglesAndTorques) {
  MitAxis a = make({}, {.node = 3, .direction = -1.0, .gear_ratio = 2.0, .offset = 0.5});
  const auto f = publish(a, 1.5, 3.0)[0];  // shaft at -2 rad and -6 rad/s
  EXPECT_EQ(test::mit_p(f), static_cast<unsigned>(10.5 * 65535 / 25));
  EXPECT_EQ(test::mit_v(f), static_cast<unsigned>(44.0 * 4095 / 100));
  tell(a, test::mit_special(3, 0xFC));
  tell(a, torque(4095));
  EXPECT_NEAR(a.joint_torque(), -36.0, 1e-9);
}

TEST_F(MitDrive, ThereIsTorqueInMotorModeOnlyAndTheLastCommandIsRemembered) {
  MitAxis a = make();
  publish(a);
  tell(a, torque(3071));
  EXPECT_EQ(a.joint_torque(), 0.0);
  EXPECT_FALSE(a.closed_loop());
  tell(a, test::mit_special(3, 0xFC));
  EXPECT_TRUE(a.closed_loop());
  EXPECT_NEAR(a.joint_torque(), 3071 * 36.0 / 4095 - 18, 1e-9) << "the kick";
  EXPECT_EQ(test::mit_t(publish(a)[0]), 3071U);
  tell(a, test::mit_special(3, 0xFD));
  EXPECT_EQ(a.joint_torque(), 0.0);
  EXPECT_EQ(a.error(), 0U);
}

TEST_F(MitDrive, GainsActOnPositionAndSpeed) {
  MitAxis a = make();
  publish(a, 1.0, 2.0);
  tell(a, test::mit_special(3, 0xFC));
  tell(a, test::mit_command(3, 0x8000, 0x800, 16, 819, 2048));
  const double q = 25.0 * 0x8000 / 65535 - 12.5, v = 100.0 * 0x800 / 4095 - 50, t = 36.0 * 2048 / 4095 - 18;
  EXPECT_NEAR(a.joint_torque(), 500.0 * 16 / 4095 * (q - 1.0) + 5.0 * 819 / 4095 * (v - 2.0) + t, 1e-9);
  tell(a, test::mit_command(3, 0xFFFF, 0x800, 4095, 0, 2048));
  EXPECT_NEAR(a.joint_torque(), 18.0, 1e-9) << "what the drive can do";
}

TEST_F(MitDrive, ZeroingMovesTheZero) {
  MitAxis a = make();
  publish(a, 2.0);
  tell(a, test::mit_special(3, 0xFE));
  EXPECT_EQ(test::mit_p(publish(a, 3.0)[0]), static_cast<unsigned>(13.5 * 65535 / 25));
}

/// 1000 cycles of 25 us: after 25 periods without a command; it stays in motor mode.
TEST_F(MitDrive, TheTimeoutZeroesTheCommandAndLeavesItEnabled) {
  MitAxis a = make();
  publish(a);
  tell(a, test::mit_special(3, 0xFC));
  tell(a, torque(4095));
  for (int i = 0; i < 25; ++i) publish(a);
  EXPECT_FALSE(a.timed_out());
  EXPECT_NEAR(a.joint_torque(), 18.0, 1e-9);
  publish(a);
  EXPECT_TRUE(a.timed_out());
  EXPECT_EQ(a.joint_torque(), 0.0);
  EXPECT_TRUE(a.closed_loop());
  tell(a, torque(4095));
  EXPECT_FALSE(a.timed_out());
  EXPECT_NEAR(a.joint_torque(), 18.0, 1e-9) << "and goes on with the next command";
}

TEST_F(MitDrive, OtherFramesAreIgnored) {
  MitAxis a = make({.realtime = true});
  publish(a);
  std::vector<hal::CanFrame> others(5, test::mit_special(3, 0xFC));
  others[0].id = 4;
  others[1].extended = true;
  others[2].remote = true;
  others[3].fd = true;
  others[4].size = 7;
  for (const auto& f : others) {
    EXPECT_TRUE(tell(a, f).empty());
    EXPECT_FALSE(a.commanded_by(f) || a.closed_loop());
  }
  EXPECT_TRUE(a.commanded_by(torque(1)) && a.commanded_by(test::mit_special(3, 0xFC)));
}

TEST_F(MitDrive, DialectsAndIdentifiersOfReplies) {
  MitAxis own = make({.master_id = 3, .reply_size = 7});
  EXPECT_EQ(publish(own)[0].id, 3U);
  EXPECT_EQ(publish(own)[0].size, 7);
  MitAxis dm = make({.dialect = MitAxis::Dialect::damiao, .master_id = 0x13, .reply_size = 8});
  EXPECT_EQ(publish(dm)[0].data[0], 0x03) << "not in motor mode";
  tell(dm, test::mit_special(3, 0xFC));
  EXPECT_EQ(publish(dm)[0].data[0], 0x13) << "in motor mode";
  EXPECT_EQ(publish(dm)[0].id, 0x13U);
}

TEST_F(MitDrive, ADriverBoardV3ActsOnEveryCommand) {
  MitAxis a = make({.dialect = MitAxis::Dialect::cubemars_v3, .velocity_unit = 0.01, .realtime = true});
  publish(a, -1.0, 0.5);
  hal::CanFrame command = test::bytes(0x803, {0x00, 0x00, 0x00, 0x80, 0x00, 0x80, 0x0B, 0xFF});
  EXPECT_TRUE(tell(a, command).empty()) << "eleven bits";
  command.extended = true;
  const auto reply = tell(a, command);
  ASSERT_EQ(reply.size(), 1U);
  EXPECT_TRUE(reply[0].extended);
  EXPECT_EQ(reply[0].id, 0x2903U);
  EXPECT_EQ(static_cast<std::int16_t>(test::mit_number(reply[0], 0, 2)), -572) << "of 57.29 deg";
  EXPECT_EQ(static_cast<std::int16_t>(test::mit_number(reply[0], 2, 2)), 50);
  EXPECT_TRUE(completes_ && a.closed_loop() && a.commanded_by(command));
  EXPECT_NEAR(a.joint_torque(), 3071 * 36.0 / 4095 - 18, 1e-9);
  hal::CanFrame special = test::mit_special(0x803, 0xFD);
  special.extended = true;
  tell(a, special);
  EXPECT_TRUE(a.closed_loop()) << "no special frame there: all fields at their ends";
}

// ---- with the controller

class MitLoop : public testing::Test {
 protected:
  void run(const std::vector<std::string>& sets) {
    RunOptions o;
    o.scene = ESMC_SCENE;
    o.sets = sets;
    o.sets.emplace_back("drives.protocol=mit");
    const Scene scene = read_loop_scene(o);
    FrameLog frames;
    const auto bus = std::make_unique<hal::VirtualBus<3>>();
    using Port = hal::VirtualBus<3>::Port;
    PlantEnd<FiveBarTraits, Port> plant(scene, o, bus->port(0), frames, nullptr, true);
    ControllerEnd<FiveBarTraits, Port> controller(scene, Pacing::lockstep, bus->port(1));
    const bool has_mode = scene.drives.dialect != MitAxis::Dialect::cubemars_v3;
    int ticks = 0, zeros = 0, entered = 0;
    const unsigned node = static_cast<unsigned>(scene.drives.nodes[0]);
    const auto watch = [&] {
      hal::CanFrame f;
      while (bus->port(2).try_receive(f)) {
        if (f == test::mit_command(node, 0x8000, 0x800, 0, 0, 0x800)) ++zeros;
        if (f.id != node || !test::is_special(f, 0xFC)) continue;
        ++entered;
        EXPECT_GE(zeros, 2) << "a drive that enters motor mode acts on its last command";
      }
    };
    while (plant.done() < 100 && ticks < 200) {
      plant.publish();
      ASSERT_EQ(controller.await_samples(), Waited::done);
      EXPECT_FALSE(controller.overloaded());
      controller.tick(true);
      ++ticks;
      EXPECT_EQ(controller.supervisor().running(), plant.released()) << "tick " << ticks;
      ASSERT_TRUE(plant.await_torques());
      plant.advance(controller.view());
      watch();
    }
    EXPECT_EQ(entered, has_mode ? 1 : 0);
    EXPECT_EQ(plant.done(), 100U);
    EXPECT_EQ(controller.supervisor().state(), State::running);
    controller.shut_down([&] {
      (void)plant.await_last_torques();
      plant.publish();
      watch();
      return controller.await_last_samples();
    });
    EXPECT_EQ(controller.supervisor().state(), State::disabled);
  }
};

TEST_F(MitLoop, ArmsRunsAndPartsInEveryDialect) {
  run({});
  run({"drives.master_id=17"});
  run({"drives.master_id=[1,2]"});  // on their own identifiers
  run({"drives.dialect=cubemars"});
  run({"drives.dialect=damiao", "drives.master_id=[17,18]"});
  run({"drives.dialect=cubemars_v3", "drives.velocity_unit=0.005"});
  run({"drives.direction=[-1,1]", "drives.gear_ratio=[3.0,2.0]", "drives.velocity_range=200.0"});
}

}  // namespace
}  // namespace esmc::host
