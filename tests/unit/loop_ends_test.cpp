/// The ends of a loop on a bus that carries other frames as well, and their shut-down.

#include "host_sim/loop/controller_end.hpp"
#include "host_sim/loop/plant_end.hpp"

#include <gtest/gtest.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "host_sim/operate/link_client.hpp"
#include "tests/support/odrive_bytes.hpp"

namespace esmc::host {
namespace {

using namespace std::chrono_literals;
using Socket = hal::SocketCan;

class LoopEnds : public testing::Test {
 protected:
  LoopEnds() {
    std::array<int, 2> fd{};
    EXPECT_EQ(::socketpair(AF_UNIX, SOCK_SEQPACKET, 0, fd.data()), 0);
    here_ = HostBus("here", Socket(fd[0]));
    there_ = Socket(fd[1]);
    options_.scene = ESMC_SCENE;  // nodes 1 and 2
    scene_ = read_loop_scene(options_);
  }
  [[nodiscard]] int sent(unsigned command) {
    hal::CanFrame f;
    int n = 0;
    while (there_.try_receive(f)) n += test::command_of(f) == command ? 1 : 0;
    return n;
  }

  RunOptions options_;
  Scene scene_;
  FrameLog frames_;
  HostBus here_{"here", Socket(-1)};
  Socket there_{-1};
};

TEST_F(LoopEnds, AWatchdogWithMoreThanItsTimeIsNoProof) {
  DriveScene d = scene_.drives;
  for (const double rate : {250.0, 1000.0, 8000.0}) {
    for (const double timeout : {0.01, 0.1}) {
      d.watchdog_timeout = timeout;
      d.heartbeat_timeout = 0.02;
      const double given = watchdog_proof_ticks(d, rate) / rate;
      EXPECT_GE(given, timeout + d.heartbeat_timeout) << "one that trips in time must be heard";
      EXPECT_LE(given, 1.01 * timeout + d.heartbeat_timeout + 3.0 / rate)
          << timeout << " s at " << rate << " Hz";
    }
  }
}

/// Passive encoders stand between the motors, joint by joint, and nobody enables them.
TEST_F(LoopEnds, OnlyMotorsAreReportedAsNotReady) {
  options_.sets = {"control.sensors=\"all\"", "drives.nodes=[7, 8]", "sensors.nodes=[3, 4]"};
  const Scene mixed = read_loop_scene(options_);
  const ControllerEnd<FiveBarTraits, HostBus> controller(mixed, Pacing::realtime, here_);
  EXPECT_EQ(controller.reports().unready(), "node 7 (silent), node 8 (silent)");
}

TEST_F(LoopEnds, ThePlantHearsAControllerOnlyInCommandsToItsDrives) {
  PlantEnd<FiveBarTraits, HostBus> plant(scene_, options_, here_, frames_, nullptr, false);
  hal::CanFrame request = test::message(1, test::cmd_torque, 0, 0);
  request.remote = true;
  hal::CanFrame wide = test::message(1, test::cmd_mode, 1, 1);
  wide.extended = true;
  for (const hal::CanFrame& f :
       {test::heartbeat(9, 8), test::message(9, test::cmd_mode, 1, 1), test::heartbeat(1, 8),
        test::encoder(2, 0, 0), test::message(1, 0x02, 0, 0, 0), test::message(1, 0x17, 0, 0), request,
        wide}) {
    ASSERT_EQ(there_.try_send(f), hal::SendStatus::ok);
    EXPECT_EQ(plant.drain(), 0) << std::hex << f.id;
  }
  for (const unsigned command :
       {test::cmd_mode, test::cmd_axis_state, test::cmd_torque, test::cmd_clear_errors}) {
    ASSERT_EQ(there_.try_send(test::message(2, command, 1, 0)), hal::SendStatus::ok);
    EXPECT_EQ(plant.drain(), 1) << command;
  }
}

/// What a controller is made of decides, and nothing else: not what only the plant knows.
TEST_F(LoopEnds, TheIdentityCoversWhatTheControllerIsMadeOf) {
  options_.scene = ESMC_COMMAND_SCENE;
  const auto identity = [&](const char* set) {
    RunOptions o = options_;
    if (*set != '\0') o.sets = {set};
    return read_loop_scene(o).identity;
  };
  const std::uint32_t own = identity("");
  EXPECT_NE(own, 0U);
  EXPECT_EQ(identity(""), own);
  for (const char* same :
       {"simulation.step=1e-4", "simulation.duration=0.5", "simulation.integrator=\"dopri5\""})
    EXPECT_EQ(identity(same), own) << same;
  for (const char* other : {"control.gain=45.0", "control.rate_hz=250.0", "drives.nodes=[2, 1]",
                            "mechanism.gravity=9.7", "limits.joint_speed=7.5", "command.speed=0.05"}) {
    EXPECT_NE(identity(other), own) << other;
  }
  EXPECT_EQ(scene_.identity, 0U) << "without a command interface nobody can say it";
}

TEST_F(LoopEnds, ThePlantRefusesAControllerOfAnotherScene) {
  options_.scene = ESMC_COMMAND_SCENE;
  scene_ = read_loop_scene(options_);
  const auto base = static_cast<std::uint32_t>(scene_.command->base_id);
  PlantEnd<FiveBarTraits, HostBus> plant(scene_, options_, here_, frames_, nullptr, false);
  for (const hal::CanFrame& f :
       {link::encode_identity(base, scene_.identity, false), link::encode_identity(base, 0, false),
        link::encode_identity(base + 32, scene_.identity + 1, false)}) {
    ASSERT_EQ(there_.try_send(f), hal::SendStatus::ok);
    EXPECT_EQ(plant.drain(), 0);
  }
  hal::CanFrame later = link::encode_identity(base, scene_.identity, false);
  later.data[4] = link::protocol_version + 1;
  for (const auto& [frame, words] :
       {std::pair(link::encode_identity(base, scene_.identity + 1, false), "made from another scene"),
        std::pair(later, "a later esmc is needed")}) {
    ASSERT_EQ(there_.try_send(frame), hal::SendStatus::ok);
    try {
      plant.drain();
      FAIL() << "not noticed";
    } catch (const RunError& e) {
      EXPECT_NE(std::string(e.what()).find(words), std::string::npos) << e.what();
    }
  }
}

TEST_F(LoopEnds, TheControllerSaysWhichSceneItWasMadeOf) {
  options_.scene = ESMC_COMMAND_SCENE;
  scene_ = read_loop_scene(options_);
  ControllerEnd<FiveBarTraits, HostBus> controller(scene_, Pacing::lockstep, here_);
  controller.request_arming();
  std::optional<std::uint32_t> said;
  for (hal::CanFrame f; there_.try_receive(f);) {
    if (const auto id = link::decode_identity(f, static_cast<std::uint32_t>(scene_.command->base_id)))
      said = id->scene;
  }
  EXPECT_EQ(said, scene_.identity);
}

/// A stranger speaks at once and all the time; the drive comes late.
TEST_F(LoopEnds, TheControllerAsksUntilOneOfItsDrivesAnswers) {
  ControllerEnd<FiveBarTraits, HostBus> controller(scene_, Pacing::lockstep, here_);
  std::thread others([&] {
    for (int i = 0; i < 30; ++i) {
      (void)there_.try_send(test::heartbeat(9, 8));
      std::this_thread::sleep_for(10ms);
    }
    (void)there_.try_send(test::encoder(1, 0, 0));
  });
  EXPECT_EQ(controller.await_drives(20ms), Waited::done);
  others.join();
  EXPECT_TRUE(controller.heard());
  EXPECT_GE(sent(test::cmd_mode), 2 * 4)
      << "in 300 ms, every 20 ms, two motors; a slow machine asks less often";
}

TEST_F(LoopEnds, AFloodInsteadOfASetIsAFaultAndNotAWait) {
  ControllerEnd<FiveBarTraits, HostBus> controller(scene_, Pacing::lockstep, here_);
  std::atomic<bool> over{false};
  std::thread others([&] {
    while (!over) {
      if (there_.try_send(test::heartbeat(9, 8)) != hal::SendStatus::ok) std::this_thread::sleep_for(1ms);
    }
  });
  EXPECT_EQ(controller.await_samples(), Waited::done);
  EXPECT_TRUE(controller.overloaded());
  controller.tick(true);
  EXPECT_EQ(controller.supervisor().fault(), Fault::bus_overload);
  over = true;
  others.join();
  EXPECT_EQ(sent(test::cmd_torque), 2) << "zero torque, although no set asked for it";
}

/// One lockstep loop on a virtual bus, as hil runs it.
template <std::size_t ports = 2>
class Loop {
 public:
  Loop(const Scene& scene, const RunOptions& o, FrameLog& frames)
      : plant(scene, o, bus->port(0), frames, nullptr, true),
        controller(scene, Pacing::lockstep, bus->port(1)) {}
  void tick() {
    plant.publish();
    EXPECT_EQ(controller.await_samples(), Waited::done);
    controller.tick(true);
    EXPECT_TRUE(plant.await_torques());
    plant.advance(controller.view());
  }
  bool next() {
    (void)plant.await_last_torques();
    plant.publish();
    return controller.await_last_samples();
  }
  using Bus = hal::VirtualBus<ports>;
  std::unique_ptr<Bus> bus = std::make_unique<Bus>();
  PlantEnd<FiveBarTraits, typename Bus::Port> plant;
  ControllerEnd<FiveBarTraits, typename Bus::Port> controller;
};

TEST_F(LoopEnds, ShutDownEndsDisabledWhenTheDrivesReportIdle) {
  for (const int ticks : {1, 15, 25, 100}) {  // while enabling, and while running
    Loop<> loop(scene_, options_, frames_);
    for (int i = 0; i < ticks; ++i) loop.tick();
    EXPECT_EQ(loop.plant.released(), ticks > 40);
    loop.controller.shut_down([&] { return loop.next(); });
    EXPECT_EQ(loop.controller.supervisor().state(), State::disabled) << ticks;
  }
}

TEST_F(LoopEnds, ShutDownEndsWithSilentDrives) {
  Loop<> loop(scene_, options_, frames_);
  for (int i = 0; i < 100; ++i) loop.tick();
  int passes = 0;
  loop.controller.shut_down([&] { return ++passes, true; });
  EXPECT_EQ(loop.controller.supervisor().state(), State::stopping);
  EXPECT_GE(passes, 10) << "a heartbeat period";
  EXPECT_LE(passes, 60);
}

/// What a random override of a reference does to the plant: controller, drives and plant on a bus, orders in
/// frames.
struct Ride {
  double off = 0.0;                     ///< m, of the effector from the path of the reference at full speed
  double jump = 0.0;                    ///< m/s, of its velocity in a tick
  double fastest = 0.0, slowest = 1e9;  ///< m/s
  int saturated = 0;
  State state = State::disabled;
};
Ride ride(const RunOptions& options, FrameLog& frames, int ticks) {
  const Scene scene = read_loop_scene(options);
  const double h = scene.tick();
  // The path, a hundred points per tick.
  const ReferenceBundle<double> bundle = make_reference<double>(scene, Pacing::lockstep);
  std::vector<V2> path;
  for (std::uint64_t i = 0; i <= 100ULL * bundle.reference.repeat_ticks; ++i) {
    const auto fraction = static_cast<std::uint32_t>((i % 100) * (1U << TickTime::bits) / 100);
    const Vec2<double> p = bundle.get().at(TickTime{i / 100, fraction}, h).position;
    path.push_back({p.x(), p.y()});
  }
  const auto off = [&](const V2& p) {
    double best = 1.0;
    for (std::size_t k = 0; k + 1 < path.size(); ++k) {
      const V2 side = path[k + 1] - path[k], from = p - path[k];
      const double u = std::clamp(dot(from, side) / std::max(dot(side, side), 1e-300), 0.0, 1.0);
      const V2 miss = from - u * side;
      best = std::min(best, dot(miss, miss));
    }
    return std::sqrt(best);
  };
  Loop<3> loop(scene, options, frames);
  auto& port = loop.bus->port(2);
  LinkClient console(static_cast<std::uint32_t>(scene.command->base_id));
  std::mt19937 random(4);
  Ride r;
  std::optional<V2> last, last_rate;
  for (int i = 0; i < ticks; ++i) {
    loop.tick();
    for (hal::CanFrame f; port.try_receive(f);) (void)console.hear(f);
    if (i > 200 && random() % 80 == 0) {
      const auto draw = static_cast<unsigned>(random() % 200);  // half of them all or nothing
      const auto percent = static_cast<std::uint8_t>(draw <= 100 ? draw : draw % 2 * 100);
      EXPECT_EQ(port.try_send(console.order(link::Order::override, percent)), hal::SendStatus::ok);
    }
    if (!loop.plant.released()) continue;
    const V2 at = loop.plant.plant().motion().output().effector;
    if (last) {
      const V2 rate = (1.0 / h) * (at - *last);
      const double speed = std::sqrt(dot(rate, rate));
      r.fastest = std::max(r.fastest, speed);
      r.slowest = std::min(r.slowest, speed);
      if (last_rate) r.jump = std::max(r.jump, std::sqrt(dot(rate - *last_rate, rate - *last_rate)));
      last_rate = rate;
    }
    last = at;
    if (i % 3 == 0) r.off = std::max(r.off, off(at));
    r.saturated += loop.controller.result().saturated ? 1 : 0;
  }
  r.state = loop.controller.supervisor().state();
  return r;
}

TEST_F(LoopEnds, ThePlantStaysOnTheReferencesPathAtAnySpeed) {
  options_.sets = {
      "command={speed=0.5, acceleration=2.0}",
      R"(reference={type="polyline", points=[[0.0,0.15],[0.05,0.15],[0.05,0.2]], speed=0.2, repeat=true})"};
  const Ride r = ride(options_, frames_, 5000);
  EXPECT_EQ(r.state, State::running);
  EXPECT_EQ(r.saturated, 0);
  EXPECT_LT(r.off, 2e-5);
  EXPECT_LT(r.jump, 12.0 * 1e-3);
  EXPECT_LT(r.fastest, 0.2 * 1.9);
  EXPECT_LT(r.slowest, 1e-5);
}

/// A program that takes all of the torque but a reserve, and a hold that would need more.
TEST_F(LoopEnds, AProgramAtItsTorqueLimitIsHeldWithinIt) {
  options_.scene = ESMC_PROGRAM_SCENE;
  options_.sets = {"command={speed=0.5, acceleration=30.0}"};
  const Ride r = ride(options_, frames_, 5000);
  EXPECT_EQ(r.state, State::running);
  EXPECT_LE(r.saturated, 25) << "the loop corrects as well; without orders 0";
  EXPECT_LT(r.off, 1e-4);
  EXPECT_LT(r.slowest, 1e-4);
  EXPECT_GT(r.fastest, 1.0);
}

/// t = 0: the second heartbeat of closed-loop control reaches both ends, in the same tick.
TEST_F(LoopEnds, BothEndsAgreeOnTheBeginningOfTheRun) {
  Loop<> loop(scene_, options_, frames_);
  int ticks = 0;
  while (!loop.plant.released() && ticks < 100) {
    loop.tick();
    ++ticks;
    EXPECT_EQ(loop.controller.supervisor().running(), loop.plant.released()) << ticks;
  }
  EXPECT_LT(ticks, 100);
}

}  // namespace
}  // namespace esmc::host
