/// Drives without power when the board is armed, over the registers of its CAN controller: an order to arm
/// must not outlive the operator's attention. The drives are the emulated ones, the loop is the image's.

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "boards/node.hpp"
#include "hal/fdcan/fdcan.hpp"
#include "host_sim/controller/axes_config.hpp"
#include "host_sim/drives/placed_axes.hpp"
#include "host_sim/loop/run.hpp"
#include "host_sim/scene/scene.hpp"
#include "tests/support/board_double.hpp"
#include "tests/support/fdcan_model.hpp"
#include "tests/support/odrive_bytes.hpp"

namespace esmc::test {
namespace {

using M = FiveBar<float>;
using Bus = hal::Fdcan<hal::fdcan::G4, FdcanModelAccess>;

host::Scene scene_of(const std::vector<std::string>& sets) {
  std::vector<std::string> all{"reference.type=\"hold\"", "initial.position=[0.0, 0.17]"};
  all.insert(all.end(), sets.begin(), sets.end());
  return host::read_scene_text(std::string(host::starting_scene("five_bar")), "scene of a test", all);
}

WireFrame on_wire(const hal::CanFrame& f) {
  return {f.id, f.extended, f.remote, false, false, f.size, {f.data.begin(), f.data.begin() + f.size}};
}
hal::CanFrame off_wire(const WireFrame& w) {
  hal::CanFrame f{.id = w.id, .extended = w.extended, .remote = w.remote};
  for (const std::uint8_t b : w.bytes) f.data[f.size++] = b;
  return f;
}

template <class Node>
using Timed = TimedLoop<Node, BoardDouble<Bus>>;
template <class Node>
using Lockstep = LockstepLoop<Node, BoardDouble<Bus>>;

/// The image of a board and two drives whose mechanism stands still under a brake.
template <class D, template <class> class Loop = Timed>
class Bench {
 public:
  using Node = Cycle<M, D>;

  explicit Bench(const host::Scene& scene)
      : scene_(scene),
        reference_(host::make_reference<float>(scene, host::Pacing::realtime)),
        node_(std::get<typename Node::Config>(
            host::make_cycle_config<M>(scene, host::Pacing::realtime, reference_))),
        board_{Bus(FdcanModelAccess{&model_}), {}, {true}, {}, {}, 0},
        loop_(make_loop(node_, board_)) {
    EXPECT_TRUE(board_.bus().open(80'000'000, 1'000'000, 0, node_.filters()));
    model_.handler = [this] { board_.bus().interrupt(); };
    for (const host::PlacedAxis& place : host::placed_axes(scene)) {
      places_.push_back(place);
      axes_.push_back(nullptr);
    }
  }
  ~Bench() {
    for (const std::string& w : model_.wrong) ADD_FAILURE() << w;
  }

  void power(std::size_t i) {
    axes_[i] = host::make_axis(scene_, places_[i], false);
    axes_[i]->settle(angle(i));
  }
  void power() {
    for (std::size_t i = 0; i < axes_.size(); ++i) power(i);
  }
  void cut(std::size_t i) { axes_[i].reset(); }
  void cut() {
    for (auto& axis : axes_) axis.reset();
  }
  /// The program does not run; frames are lost.
  void freeze(double seconds) {
    board_.now += static_cast<std::uint32_t>(static_cast<std::uint64_t>(seconds * 1e6));
  }
  void run(double seconds) {
    for (int n = 0; n < static_cast<int>(seconds * 1e6 / period_us); ++n) tick();
  }
  [[nodiscard]] State state() const { return node_.supervisor().state(); }
  [[nodiscard]] Fault fault() const { return node_.supervisor().fault(); }

  /// Node 1 reports 50 us before an idle tick would be due, node 2 100 us later.
  bool torn_set_is_answered() {
    for (std::size_t i = 0; i < axes_.size(); ++i)
      axes_[i]->publish(angle(i), 0.0, [&](const hal::CanFrame& f) { to_board(f); });
    quiet(0);  // the tick of this set: time counts from here
    for (std::uint32_t waited = 0; waited < 99'900; waited += 100) quiet(100);
    quiet(50);
    axes_[0]->publish(angle(0), 0.0, [&](const hal::CanFrame& f) { to_board(f); });
    quiet(100);
    axes_[1]->publish(angle(1), 0.0, [&](const hal::CanFrame& f) { to_board(f); });
    return node_.complete();
  }

  int closed_ticks = 0;         ///< in which a drive was in torque control
  double largest_torque = 0.0;  ///< N m, of any drive
  bool motor_power = true;      ///< false: drives speak and cannot leave idle
  Node& node() { return node_; }

 private:
  static constexpr std::uint32_t period_us = 1000;

  [[nodiscard]] double angle(std::size_t i) const {
    return scene_.start_angle[static_cast<std::size_t>(places_[i].joint)];
  }
  /// Drives speak in the first half of a tick, and hear what the board sends at once; a receive FIFO holds
  /// three frames.
  void tick() {
    for (std::size_t i = 0; i < axes_.size(); ++i) {
      if (axes_[i]) axes_[i]->publish(angle(i), 0.0, [&](const hal::CanFrame& f) { to_board(f); });
    }
    for (const std::uint32_t end = board_.now + period_us; board_.now != end; board_.now += 100) {
      model_.idle(100);
      loop_.turn();
      carry();
    }
    for (const auto& axis : axes_) {
      if (!axis) continue;
      closed_ticks += axis->closed_loop() ? 1 : 0;
      largest_torque = std::max(largest_torque, std::abs(axis->joint_torque()));
    }
  }
  void quiet(std::uint32_t us) {
    board_.now += us;
    model_.idle(us);
    loop_.turn();
    carry();
  }
  void carry() {
    while (const auto w = model_.take()) {
      hal::CanFrame f = off_wire(*w);
      if (!motor_power && scene_.drives.protocol == host::Protocol::cia402 && f.id / 0x80U == 4)
        f.data[0] = 0;  // controlword
      const bool arms = scene_.drives.protocol != host::Protocol::cia402 && f.id % 0x20U == cmd_axis_state &&
                        f.data[0] == axis_closed_loop;
      for (const auto& axis : axes_) {
        if (axis && (motor_power || !arms))
          (void)axis->receive(f, [&](const hal::CanFrame& reply) { to_board(reply); });
      }
    }
  }
  void to_board(const hal::CanFrame& f) {
    model_.deliver(on_wire(f));
    node_.receive(board_.bus());
  }

  static Loop<Node> make_loop(Node& node, BoardDouble<Bus>& board) {
    if constexpr (std::is_same_v<Loop<Node>, Timed<Node>>) {
      return Loop<Node>(node, board, period_us * 1000);
    } else {
      return Loop<Node>(node, board);
    }
  }

  host::Scene scene_;
  host::ReferenceBundle<float> reference_;
  FdcanModel model_{FdcanModel::Chip::g4};
  Node node_;
  BoardDouble<Bus> board_;
  Loop<Node> loop_;
  std::vector<host::PlacedAxis> places_;
  std::vector<std::unique_ptr<host::EmulatedAxis>> axes_;
};

struct Kind {
  const char* name;
  std::vector<std::string> sets;
};
const std::vector<Kind>& kinds() {
  static const std::vector<Kind> all{
      {"odrive", {}},
      {"odrive_0.5", {"drives.protocol=\"odrive_0.5\""}},
      {"odrive_0.5.6", {"drives.protocol=\"odrive_0.5\"", "drives.defect=\"zero_until_closed_loop\""}},
      {"cia402", {"drives.protocol=\"cia402\""}},
      {"mit", {"drives.protocol=\"mit\""}}};
  return all;
}

/// Calls `test` with a bench of each kind of drive.
template <class Test>
void for_each_kind(const Test& test) {
  for (const Kind& k : kinds()) {
    SCOPED_TRACE(k.name);
    const host::Scene scene = scene_of(k.sets);
    switch (scene.drives.protocol) {
      case host::Protocol::cia402:
        test([&] { return std::make_unique<Bench<drive::Cia402Axis>>(scene); });
        break;
      case host::Protocol::mit:
        test([&] { return std::make_unique<Bench<drive::MitAxis>>(scene); });
        break;
      default:
        test([&] { return std::make_unique<Bench<drive::OdriveAxis>>(scene); });
        break;
    }
  }
}

/// The commands of the host; an operator may take longer than a minute, and a mechanism to home.
TEST(BoardArming, InRealTimeAConsoleHasNoLimitOfTime) {
  const auto by_link = scene_of({"command.arm=\"link\"", "command.speed=0.5", "command.acceleration=5.0"});
  EXPECT_TRUE(std::isinf(host::arming_time_max(by_link, true)));
  EXPECT_EQ(host::arming_time_max(by_link, false), 60.0);
  EXPECT_LT(host::arming_time_max(scene_of({}), true), 60.0);
}

TEST(BoardArming, DrivesThatHavePowerAreArmed) {
  for_each_kind([](const auto& make) {
    auto b = make();
    b->power();
    b->run(0.2);
    EXPECT_EQ(b->closed_ticks, 0) << "before the order";
    b->node().command(Command::enable);
    b->run(0.7);
    EXPECT_EQ(b->state(), State::running) << name(b->fault());
    EXPECT_GT(b->largest_torque, 0.01) << "the weight";
    b->node().command(Command::stop);
    b->run(0.1);
    EXPECT_EQ(b->state(), State::disabled);
  });
}

TEST(BoardArming, PowerThatComesLaterStartsNothing) {
  for (const double later : {1.0, 10.0, 60.0}) {
    SCOPED_TRACE(later);
    for_each_kind([&](const auto& make) {
      auto b = make();
      b->run(0.2);
      b->node().command(Command::enable);
      b->run(later);
      EXPECT_EQ(b->fault(), Fault::enabling_timeout);
      b->power();
      b->run(3.0);
      EXPECT_EQ(b->state(), State::fault);
      EXPECT_EQ(b->closed_ticks, 0);
      EXPECT_EQ(b->largest_torque, 0.0);
      b->node().command(Command::reset);
      b->run(1.0);
      EXPECT_EQ(b->state(), State::disabled);
      EXPECT_EQ(b->closed_ticks, 0) << "a reset is no order to arm";
      b->node().command(Command::enable);
      b->run(0.7);
      EXPECT_EQ(b->state(), State::running) << name(b->fault());
    });
  }
}

TEST(BoardArming, OneSilentDriveKeepsTheOtherFromTorque) {
  for (const std::size_t missing : {0U, 1U}) {
    for_each_kind([&](const auto& make) {
      auto b = make();
      b->power(1 - missing);
      b->run(0.2);
      b->node().command(Command::enable);
      b->run(2.0);
      EXPECT_EQ(b->fault(), Fault::enabling_timeout);
      EXPECT_EQ(b->closed_ticks, 0) << missing;
      b->power(missing);
      b->run(2.0);
      EXPECT_EQ(b->closed_ticks, 0) << missing;
    });
  }
}

/// Not MIT: a reply says neither mode nor power.
TEST(BoardArming, MotorPowerThatComesLaterStartsNothing) {
  for_each_kind([](const auto& make) {
    auto b = make();
    if (std::is_same_v<std::decay_t<decltype(b->node())>, Cycle<M, drive::MitAxis>>) return;
    b->power();
    b->motor_power = false;
    b->run(0.2);
    b->node().command(Command::enable);
    b->run(2.5);
    EXPECT_EQ(b->fault(), Fault::enabling_timeout);
    b->motor_power = true;
    b->run(2.0);
    EXPECT_EQ(b->closed_ticks, 0);
  });
}

TEST(BoardArming, ADriveThatRestartsEndsTheOrder) {
  for_each_kind([](const auto& make) {
    auto b = make();
    if (std::is_same_v<std::decay_t<decltype(b->node())>, Cycle<M, drive::MitAxis>>)
      return;  // it is running by then
    b->power();
    b->motor_power = false;
    b->node().command(Command::enable);
    b->run(0.3);
    ASSERT_EQ(b->state(), State::enabling);
    b->cut(1);
    b->run(0.8);
    EXPECT_EQ(b->fault(), Fault::enabling_timeout);
    b->power(1);
    b->motor_power = true;
    b->run(2.0);
    EXPECT_EQ(b->closed_ticks, 0);
  });
}

TEST(BoardArming, AProgramThatStoodStillStartsNothing) {
  for_each_kind([](const auto& make) {
    for (const double minutes : {1.0, 36.0, 60.0, 71.0}) {  // the clock of a board goes round in 71.6 minutes
      auto frozen = make();
      frozen->node().command(Command::enable);
      frozen->run(0.3);
      frozen->freeze(60.0 * minutes);
      frozen->power();
      frozen->run(2.0);
      EXPECT_EQ(frozen->fault(), Fault::tick_late) << minutes;
      EXPECT_EQ(frozen->closed_ticks, 0) << minutes;
    }
  });
}

TEST(BoardArming, DrivesBehindAContactorHaveTheirBootTime) {
  for (const double boot : {3.0, 20.0})
    for (const bool in_time : {true, false}) {
      Bench<drive::OdriveAxis> b(scene_of({"drives.boot_time=" + std::to_string(boot)}));
      b.run(0.2);
      b.node().command(Command::enable);
      b.run(in_time ? boot - 0.1 : boot + 0.3);
      b.power();
      b.run(0.7);
      EXPECT_EQ(b.state(), in_time ? State::running : State::fault) << name(b.fault());
    }
}

/// Shorter than any time-out: heartbeats do not show it.
TEST(BoardArming, ZerosAfterAShortRestartAreNotBelieved) {
  Bench<drive::OdriveAxis> b(
      scene_of({"drives.protocol=\"odrive_0.5\"", "drives.defect=\"zero_until_closed_loop\"",
                "drives.heartbeat_timeout=0.2"}));
  b.power();
  b.run(0.2);
  EXPECT_TRUE(b.node().axis(0).encoder_unconnected());
  b.node().command(Command::enable);
  b.run(1.0);
  ASSERT_EQ(b.state(), State::running) << name(b.fault());
  const float angle = b.node().axis(0).sample<float>().angle;
  b.node().command(Command::stop);
  b.run(0.1);
  b.cut(0);
  b.run(0.1);
  b.power(0);
  b.run(0.1);
  EXPECT_TRUE(b.node().axis(0).encoder_unconnected());
  EXPECT_EQ(b.node().axis(0).sample<float>().angle, angle);
  b.node().command(Command::enable);
  b.run(1.0);
  EXPECT_EQ(b.state(), State::running) << name(b.fault());
}

TEST(BoardArming, LockstepTakesOrdersWithoutDrives) {
  Bench<drive::OdriveAxis, Lockstep> b(scene_of({}));
  b.run(1.0);
  b.node().command(Command::enable);
  b.run(0.2);
  EXPECT_EQ(b.state(), State::enabling);
  b.node().command(Command::stop);
  b.run(2.0);
  EXPECT_EQ(b.state(), State::disabled);
  b.node().command(Command::enable);
  b.run(6.0);
  EXPECT_EQ(b.fault(), Fault::enabling_timeout);
}

TEST(BoardArming, LockstepKeepsNoOrderForDrivesThatCameBack) {
  Bench<drive::OdriveAxis, Lockstep> b(scene_of({}));
  b.power();
  b.run(0.2);
  b.cut();
  b.node().command(Command::enable);
  b.run(60.0);
  EXPECT_EQ(b.fault(), Fault::enabling_timeout);
  b.power();
  b.run(1.0);
  EXPECT_EQ(b.closed_ticks, 0);
  b.node().command(Command::reset);
  b.run(0.2);
  b.node().command(Command::enable);
  b.run(0.5);
  EXPECT_EQ(b.state(), State::running) << name(b.fault());
}

/// The idle tick comes between the frames of a set: the second one must still complete it.
TEST(BoardArming, LockstepDoesNotTearASet) {
  Bench<drive::OdriveAxis, Lockstep> b(scene_of({}));
  b.power();
  b.run(0.2);
  ASSERT_EQ(b.state(), State::disabled);
  EXPECT_TRUE(b.torn_set_is_answered());
}

TEST(BoardArming, OffEndsWithSilentDrivesToo) {
  for_each_kind([](const auto& make) {
    auto b = make();
    b->node().command(Command::enable);
    b->run(0.1);
    EXPECT_EQ(b->state(), State::enabling);
    b->node().command(Command::stop);
    b->run(0.1);
    EXPECT_EQ(b->state(), State::stopping);
    b->run(1.5);
    EXPECT_EQ(b->state(), State::disabled);
    b->power();
    b->run(2.0);
    EXPECT_EQ(b->state(), State::disabled);
    EXPECT_EQ(b->closed_ticks, 0);
  });
}

}  // namespace
}  // namespace esmc::test
