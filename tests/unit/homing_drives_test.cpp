/// Homing over every protocol: the cycle as a board has it, emulated drives, and a mechanism with end stops,
/// tick by tick in virtual time. In real time drives of MIT and moteus send nothing unasked.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <string>
#include <type_traits>
#include <variant>
#include <vector>

#include "host_sim/controller/axes_config.hpp"
#include "host_sim/drives/emulated_plant.hpp"
#include "host_sim/record/recorder.hpp"
#include "tests/support/fake_bus.hpp"
#include "tests/support/link_bytes.hpp"

namespace esmc::host {
namespace {

using test::Desk;
using Sets = std::vector<std::string>;

struct Case {
  const char* name;
  const char* protocol;  ///< and dialect, as set
  Pacing pacing;
};
std::ostream& operator<<(std::ostream& out, const Case& c) { return out << c.name; }

/// Positions are of the mechanism, in rad: the stops, and where it is switched on.
template <class Traits>
struct Place;
template <>
struct Place<FiveBarTraits> {
  using Mechanism = FiveBar<float>;
  static constexpr const char* mechanism = R"(type = "five_bar"
half_base = 0.05
leg = { l1 = 0.12, l2 = 0.16, lg1 = 0.06, lg2 = 0.068, m1 = 0.1, m2 = 0.1, J1 = 2e-4, J2 = 7e-4 }
working_mode = ["+", "+"]
assembly_mode = "-")";
  static constexpr std::array<double, 2> stops{0.631942, 1.155262};
  static constexpr std::array<double, 2> point{0.05, 0.18};  ///< m
};
template <>
struct Place<RrTraits> {
  using Mechanism = Rr<float>;
  static constexpr const char* mechanism = R"(type = "rr"
leg = { l1 = 0.12, l2 = 0.16, lg1 = 0.06, lg2 = 0.068, m1 = 0.1, m2 = 0.1, J1 = 2e-4, J2 = 7e-4 }
working_mode = ["+"])";
  static constexpr std::array<double, 2> stops{0.75, 1.5};
  static constexpr std::array<double, 2> point{0.05, 0.18};
};

template <class Traits>
Scene scene_of(const Case& c, const Sets& more) {
  using P = Place<Traits>;
  const std::string stop1 = std::to_string(P::stops[0]), stop2 = std::to_string(P::stops[1]);
  const std::string text = "[mechanism]\ngravity = 0.0\n" + std::string(P::mechanism) + R"(
[control]
law = "ctc"
lambda = 10.0
rate_hz = 500
torque_limit = 2.0
[reference]
type = "circle"
center = [0.0, 0.17]
radius = 0.07
speed = 1.0
[initial]
at = "reference"
[limits]
min_abs_sin_type1 = 0.02
min_abs_sin_type2 = 0.05
joint_speed = 50.0
halt_time = 0.1
[drives]
protocol = "odrive"
nodes = [1, 2]
sign_test = false
zero = "end_stop"
homing_speed = [0.2, -0.2]
homing_torque = [0.1, 0.1]
zero_pose = [)" + stop1 + ", " +
                           stop2 +
                           R"(]
[[effects]]
type = "viscous_friction"
coefficient = [0.02, 0.02]
[[effects]]
type = "end_stops"
lower = [-9.0, )" + stop2 + "]\nupper = [" +
                           stop1 + R"(, 9.0]
[command]
arm = "link"
speed = 0.5
acceleration = 5.0
timeout = 0.2
[simulation]
duration = 600.0
step = 5e-4
)";
  Sets sets{c.protocol};
  for (std::string& s : sets) s = "drives." + s;
  sets.insert(sets.end(), more.begin(), more.end());
  return read_scene_text(text, "scene.toml", sets);
}

/// A machine with its console. Everything that crosses the bus is bytes.
template <class Traits>
class Machine {
 public:
  using M = typename Place<Traits>::Mechanism;
  using S = typename M::Scalar;

  explicit Machine(const Case& c, const Sets& more = {})
      : scene_(std::make_unique<Scene>(scene_of<Traits>(c, more))),
        live_(c.pacing == Pacing::realtime),
        reference_(std::make_unique<ReferenceBundle<S>>(make_reference<S>(*scene_, c.pacing))),
        cycle_(make_cycle<M>(*scene_, c.pacing, *reference_)),
        plant_(make_motion<Traits>(*scene_), *scene_, !live_) {
    desk_.base = static_cast<unsigned>(scene_->command->base_id);
    for (int n = 0; n < 20; ++n) tick(n % 4 == 0 ? Sends{desk_.ask(2)} : Sends{});
  }

  using Sends = std::vector<hal::CanFrame>;
  /// `sends`: of the console.
  void tick(const Sends& sends = {}) {
    plant_.begin_tick();
    const auto to_controller = [&](std::size_t, const hal::CanFrame& f) { bus_.push(f); };
    plant_.publish(to_controller, [&](std::size_t i, const Shaft& now) {
      return power[i] ? std::optional(now) : std::nullopt;
    });
    for (const hal::CanFrame& f : sends) bus_.push(f);
    std::visit(
        [&](auto& c) {
          c.receive(bus_);
          if (live_) {
            c.request(bus_);
            deliver();
            c.receive(bus_);
          }
          const auto r = c.tick(bus_);
          for (std::size_t i = 0; i < 2; ++i)
            torque[i] = static_cast<double>(r.torque[static_cast<int>(i) * (M::joints / 2)]);
          effector = {static_cast<double>(r.effector[0]), static_cast<double>(r.effector[1])};
          if (!live_) c.request(bus_);
        },
        cycle_);
    deliver();
    bool clipped = false;
    const double t = plant_.time();
    plant_.advance(t, scene_->tick(), scene_->step, plant_.deliver(plant_.asked(), scene_->tick(), clipped));
    for (std::size_t i = 0; i < 2; ++i) {
      most = std::max(most, std::abs(torque[i]));
      fastest = std::max(fastest, std::abs(shaft(i).rate));
    }
  }
  /// With a console that is there. Returns the number of ticks.
  int run(const std::function<bool()>& over, int ticks = 30'000) {
    int n = 0;
    for (; n < ticks && !over(); ++n) tick({desk_.order(Desk::none)});
    EXPECT_TRUE(over()) << name(state()) << ' ' << name(fault());
    return n;
  }
  void order(unsigned what) { tick({desk_.order(what)}); }
  /// In the midst of homing.
  void home() {
    order(Desk::home);
    run([&] { return (speed() > 0.15 && state() == State::testing) || state() == State::fault; });
    ASSERT_EQ(state(), State::testing) << name(fault());
  }
  [[nodiscard]] bool homed() {
    order(Desk::home);
    run([&] { return state() == State::disabled || state() == State::fault; });
    return state() == State::disabled && fault() == Fault::none;
  }
  void wait(int ticks) {
    for (int n = 0; n < ticks; ++n) tick({desk_.order(Desk::none)});
  }
  void goes_to(const std::array<double, 2>& p) {
    order(Desk::stream);
    order(Desk::arm);
    run([&] { return state() == State::running || state() == State::fault; }, 1000);
    ASSERT_EQ(state(), State::running) << name(fault());
    tick({desk_.pair(Desk::point, static_cast<int>(std::lround(1e6 * p[0])),
                     static_cast<int>(std::lround(1e6 * p[1])))});
    wait(1500);
    ASSERT_EQ(state(), State::running) << name(fault());
    EXPECT_NEAR(effector[0], p[0], 2e-3);
    EXPECT_NEAR(effector[1], p[1], 2e-3);
  }
  [[nodiscard]] Shaft shaft(std::size_t i) const {
    return plant_.motion().shaft(i * static_cast<std::size_t>(M::joints / 2));
  }
  [[nodiscard]] double speed() const { return std::max(std::abs(shaft(0).rate), std::abs(shaft(1).rate)); }
  [[nodiscard]] double measured(std::size_t i) const {
    return std::visit(
        [&](const auto& c) {
          return static_cast<double>(c.sample().angle[static_cast<int>(i) * (M::joints / 2)]);
        },
        cycle_);
  }
  [[nodiscard]] State state() const {
    return std::visit([](const auto& c) { return c.supervisor().state(); }, cycle_);
  }
  [[nodiscard]] Fault fault() const {
    return std::visit([](const auto& c) { return c.supervisor().fault(); }, cycle_);
  }
  [[nodiscard]] bool zero_unknown() const { return (desk_.last(Desk::status).data[3] & 0x20) != 0; }
  [[nodiscard]] const Scene& scene() const { return *scene_; }
  [[nodiscard]] EmulatedPlant<typename Traits::Plant>& plant() { return plant_; }

  std::array<double, 2> torque{}, effector{};
  std::array<bool, 2> power{true, true};
  double most = 0.0, fastest = 0.0;

 private:
  void deliver() {
    const std::vector<hal::CanFrame> sent(bus_.sent().begin(), bus_.sent().end());
    bus_.clear();
    for (const hal::CanFrame& f : sent) {
      desk_.hear(f);
      for (std::size_t i = 0; i < plant_.axes().size(); ++i) {
        if (power[i]) plant_.hand_over(i, f, [&](std::size_t, const hal::CanFrame& r) { bus_.push(r); });
      }
    }
    if (desk_.heard.size() > 1000) desk_.heard.erase(desk_.heard.begin(), desk_.heard.end() - 200);
  }

  std::unique_ptr<Scene> scene_;
  bool live_;
  std::unique_ptr<ReferenceBundle<S>> reference_;
  AnyCycle<M> cycle_;
  EmulatedPlant<typename Traits::Plant> plant_;
  test::FakeBus bus_;
  Desk desk_;
};

const std::array cases{Case{"odrive", "protocol=odrive", Pacing::realtime},
                       Case{"odrive_05", "protocol=\"odrive_0.5\"", Pacing::realtime},
                       Case{"cia402", "protocol=cia402", Pacing::realtime},
                       Case{"mit", "protocol=mit", Pacing::realtime},
                       Case{"moteus", "protocol=moteus", Pacing::realtime},
                       Case{"cia402_lockstep", "protocol=cia402", Pacing::lockstep},
                       Case{"mit_lockstep", "protocol=mit", Pacing::lockstep},
                       Case{"moteus_lockstep", "protocol=moteus", Pacing::lockstep}};

class HomingOver : public testing::TestWithParam<Case> {
 protected:
  /// On both mechanisms.
  template <class F>
  void each(const F& f, const Sets& more = {}) {
    {
      SCOPED_TRACE("five_bar");
      Machine<FiveBarTraits> m(GetParam(), more);
      f(m, Place<FiveBarTraits>::stops, Place<FiveBarTraits>::point);
    }
    SCOPED_TRACE("rr");
    Machine<RrTraits> m(GetParam(), more);
    f(m, Place<RrTraits>::stops, Place<RrTraits>::point);
  }
};
INSTANTIATE_TEST_SUITE_P(Drives, HomingOver, testing::ValuesIn(cases),
                         [](const auto& i) { return std::string(i.param.name); });

TEST_P(HomingOver, BothStopsSetTheZeroThatLastsAndTheMechanismLeavesThem) {
  each([](auto& m, const auto& stops, const auto& point) {
    ASSERT_TRUE(m.zero_unknown());
    ASSERT_TRUE(m.homed()) << name(m.fault());
    EXPECT_LE(m.most, 0.1 * (1 + 1e-6));
    m.wait(1000);
    EXPECT_FALSE(m.zero_unknown());
    for (std::size_t i = 0; i < 2; ++i) {
      EXPECT_NEAR(m.measured(i), m.shaft(i).angle, 2e-3);
      EXPECT_NEAR((stops[i] - m.shaft(i).angle) * (i == 0 ? 1.0 : -1.0), 0.06, 0.02) << "the back-off";
    }
    m.goes_to(point);
  });
}

TEST_P(HomingOver, ItArmsAndMovesOnWhereTheLimitsAreBeforeTheStops) {
  const auto limits = [](const auto& s) {
    return "limits.joint_angle=[[-1.0, " + std::to_string(s[0] - 0.03) + "], [" +
           std::to_string(s[1] + 0.03) + ", 3.1]]";
  };
  const auto check = [](auto& m, const auto& point) {
    ASSERT_TRUE(m.homed()) << name(m.fault());
    m.wait(10);
    m.goes_to(point);
  };
  Machine<FiveBarTraits> five(GetParam(), {limits(Place<FiveBarTraits>::stops)});
  check(five, Place<FiveBarTraits>::point);
  Machine<RrTraits> rr(GetParam(), {limits(Place<RrTraits>::stops)});
  check(rr, Place<RrTraits>::point);
}

/// Of a motor that gives twice what it is asked for, half of the joint's torque is asked.
TEST(HomingConfig, AsksMotorsForWhatTheJointsAreToGet) {
  using M = Place<FiveBarTraits>::Mechanism;
  const auto asked = [](const char* factors) {
    const Scene s = scene_of<FiveBarTraits>({"", "protocol=odrive", Pacing::lockstep},
                                            {std::string("control.model={torque_factor=") + factors + "}"});
    const auto reference = make_reference<float>(s, Pacing::lockstep);
    return std::visit([](const auto& c) { return c.homing; },
                      make_cycle_config<M>(s, Pacing::lockstep, reference));
  };
  const HomingConfig<float> plain = asked("1.0"), h = asked("[2.0, 0.5]");
  for (int i = 0; i < 2; ++i) {
    const float factor = i == 0 ? 2.0F : 0.5F;
    EXPECT_FLOAT_EQ(h.torque[i] * factor, plain.torque[i]);
    EXPECT_FLOAT_EQ(h.damping[i] * factor, plain.damping[i]);
    EXPECT_EQ(h.speed[i], plain.speed[i]);
  }
}

TEST_P(HomingOver, WithoutAStopItEndsAtRestWithAFault) {
  each(
      [](auto& m, const auto&, const auto&) {
        EXPECT_FALSE(m.homed());
        EXPECT_EQ(m.fault(), Fault::home_no_stop) << name(m.fault());
        EXPECT_LT(m.speed(), 0.07);
        EXPECT_EQ(m.torque, (std::array{0.0, 0.0}));
        m.wait(20);
        EXPECT_TRUE(m.zero_unknown());
      },
      {"limits.joint_angle=[[0.3, 0.9],[0.9, 2.2]]",
       "effects=[{type=\"viscous_friction\", coefficient=[0.02, 0.02]}]"});
}

TEST_P(HomingOver, ASilentConsoleAndAHaltEndItAtRest) {
  each([](auto& m, const auto&, const auto&) {
    m.home();
    m.order(Desk::disarm);
    EXPECT_EQ(m.state(), State::halting);
    m.run([&] { return m.state() != State::halting; }, 100);
    EXPECT_LT(m.speed(), 0.07);
    m.run([&] { return m.state() == State::disabled; }, 100);
    EXPECT_EQ(m.fault(), Fault::none);
    m.home();
    int n = 0;
    for (; m.state() != State::fault && n < 500; ++n) m.tick();
    EXPECT_EQ(m.fault(), Fault::command_lost) << name(m.fault());
    EXPECT_LT(m.speed(), 0.07);
    EXPECT_LT(n, 100 + 100);
    EXPECT_EQ(m.torque, (std::array{0.0, 0.0}));
  });
}

TEST_P(HomingOver, UnderWeightItHomesAndHalts) {
  each(
      [](auto& m, const auto&, const auto&) {
        m.home();
        m.order(Desk::disarm);
        m.run([&] { return m.state() == State::disabled || m.state() == State::fault; }, 200);
        EXPECT_EQ(m.fault(), Fault::none) << name(m.fault());
      },
      {"mechanism.gravity=9.8", "drives.homing_torque=[1.0, 1.0]", "drives.homing_speed=[0.5, -0.5]"});
  each(
      [](auto& m, const auto& stops, const auto&) {
        EXPECT_TRUE(m.homed()) << name(m.fault());
        m.wait(2);
        for (std::size_t i = 0; i < 2; ++i) EXPECT_NEAR(m.measured(i), m.shaft(i).angle, 5e-3) << stops[i];
      },
      {"mechanism.gravity=9.8", "drives.homing_torque=[1.0, 1.0]", "drives.homing_speed=[0.5, -0.5]"});
}

TEST_P(HomingOver, ADriveThatLosesItsPowerTakesTheTorqueAway) {
  for (const std::size_t i : {0U, 1U}) {
    each([i](auto& m, const auto&, const auto&) {
      m.home();
      m.power[i] = false;
      m.run([&] { return m.state() == State::fault; }, 100);
      EXPECT_TRUE(m.fault() == Fault::stale_feedback || m.fault() == Fault::heartbeat_lost)
          << name(m.fault());
      EXPECT_EQ(m.torque, (std::array{0.0, 0.0}));
    });
  }
}

/// A drive in MIT mode does not say that it has left motor mode: its joint cannot leave its stop.
TEST_P(HomingOver, ADriveThatRestartsIsAFault) {
  const bool mit = std::string(GetParam().protocol) == "protocol=mit";
  for (const std::size_t i : {0U, 1U}) {
    each([&](auto& m, const auto&, const auto&) {
      m.home();
      if (i == 1) m.run([&] { return std::abs(m.shaft(1).rate) > 0.15; });
      m.plant().restart_drive(i, m.scene(), GetParam().pacing == Pacing::lockstep);
      m.run([&] { return m.state() == State::fault; }, 2000);
      EXPECT_EQ(m.fault(), mit ? Fault::sign_test : Fault::drive_disarmed) << name(m.fault());
      EXPECT_EQ(m.torque, (std::array{0.0, 0.0}));
      m.wait(100);
      EXPECT_TRUE(m.zero_unknown());
    });
  }
}

/// At rest a drive in MIT mode says half a step of its speed; what is said in whole units is 0 below one.
TEST(HomingSpeed, IsNotBelowWhatTheDriveCanSay) {
  const auto refused = [](const char* protocol, const char* speed, const char* more = "control.lambda=10.0") {
    const Case c{"", protocol, Pacing::lockstep};
    try {
      (void)scene_of<RrTraits>(c, {speed, more});
      return false;
    } catch (const InputError& e) {
      EXPECT_NE(std::string(e.what()).find("homing_speed"), std::string::npos) << e.what();
      return true;
    }
  };
  constexpr const char *slow = "drives.homing_speed=[0.2, -0.12]",
                       *enough = "drives.homing_speed=[0.2, -0.123]";
  EXPECT_TRUE(refused("protocol=mit", slow));  // 5 x 2 x 50 / 4095
  EXPECT_FALSE(refused("protocol=mit", enough));
  EXPECT_FALSE(refused("protocol=mit", slow, "drives.velocity_range=45.0"));
  EXPECT_FALSE(refused("protocol=moteus", slow));
  EXPECT_FALSE(refused("protocol=odrive", slow));
  EXPECT_FALSE(refused("protocol=cia402", slow));
  EXPECT_TRUE(refused("protocol=cia402", slow, "drives.velocity_unit=0.025"));
  EXPECT_FALSE(refused("protocol=cia402", enough, "drives.velocity_unit=0.0245"));
}

}  // namespace
}  // namespace esmc::host
