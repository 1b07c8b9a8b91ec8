/// What emulated drives can be made to do wrong, one by one, each against a drive without it; and the shaft
/// of a drive that has no mechanism, against closed forms.

#include "host_sim/scene/drive_defects.hpp"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "host_sim/drives/cia402_axis.hpp"
#include "host_sim/drives/emulated_axis.hpp"
#include "host_sim/drives/mit_axis.hpp"
#include "host_sim/drives/odrive_axis.hpp"
#include "host_sim/drives/placed_axes.hpp"
#include "tests/support/canopen_bytes.hpp"
#include "tests/support/mit_bytes.hpp"
#include "tests/support/odrive_bytes.hpp"

namespace esmc::host {
namespace {

constexpr unsigned node = 3;

/// An armed axis: 1 kHz, watchdog of 10 periods.
class Bench {
 public:
  explicit Bench(const Defects& d = {})
      : axis({.node = static_cast<int>(node)}, {.torque_max = 7.0, .defects = d}, SensorEffects({}), 0, 1) {
    tell(test::message(node, test::cmd_mode, 1, 1));
    tell(test::message(node, test::cmd_axis_state, 8, 0));
  }
  void tell(const hal::CanFrame& f) {
    (void)axis.receive(f, [](const hal::CanFrame&) {});
  }
  void torque(float t) { tell(test::message(node, test::cmd_torque, std::bit_cast<std::uint32_t>(t), 0)); }
  /// Periods at this angle and rate; the last encoder frame.
  hal::CanFrame pass(int periods, double angle = 0.0, double rate = 0.0) {
    hal::CanFrame last;
    for (int i = 0; i < periods; ++i) {
      axis.publish(angle, rate, [&](const hal::CanFrame& f) {
        if (test::command_of(f) == test::cmd_encoder) last = f;
      });
    }
    return last;
  }
  OdriveAxis axis;
};

TEST(DriveDefects, WithoutOneTheWatchdogDisarmsAndIsCleared) {
  Bench b;
  b.torque(1.5F);
  EXPECT_EQ(b.axis.joint_torque(), 1.5);
  b.pass(10);
  EXPECT_TRUE(b.axis.closed_loop());
  b.pass(1);
  EXPECT_FALSE(b.axis.closed_loop());
  EXPECT_EQ(b.axis.error(), 0x01000000U);
  EXPECT_EQ(b.axis.joint_torque(), 0.0);
  b.tell(test::message(node, test::cmd_clear_errors, 0, 0, 1));
  b.tell(test::message(node, test::cmd_axis_state, 8, 0));
  EXPECT_TRUE(b.axis.closed_loop());
}

TEST(DriveDefects, WatchdogOff) {
  Bench b({.watchdog_off = true});
  b.torque(1.5F);
  b.pass(100000);
  EXPECT_EQ(b.axis.joint_torque(), 1.5);
}

TEST(DriveDefects, WatchdogAnyFrame) {
  hal::CanFrame request = test::message(node, test::cmd_encoder, 0, 0);
  request.remote = true;
  for (const bool defect : {false, true}) {
    Bench b({.watchdog_any_frame = defect});
    b.torque(1.5F);
    for (int i = 0; i < 20; ++i) {
      b.pass(5);
      b.tell(request);
    }
    EXPECT_EQ(b.axis.closed_loop(), defect);
  }
}

TEST(DriveDefects, ShortFramesStale) {
  for (const bool defect : {false, true}) {
    Bench b({.short_frames_stale = defect});
    b.torque(1.5F);                                          // 00 00 C0 3F
    b.tell(test::message(node, test::cmd_torque, 0, 0, 3));  // 00 00 00, and 3F of before: 0.5
    EXPECT_EQ(b.axis.joint_torque(), defect ? 0.5 : 1.5);
  }
}

TEST(DriveDefects, ClearsBothAxes) {
  for (const bool defect : {false, true}) {
    for (const unsigned cleared : {node, node ^ 1U, node + 2U}) {
      OdriveAxis axis({.node = static_cast<int>(node)},
                      {.version = OdriveAxis::Version::v0_5_6,
                       .partner = static_cast<int>(node ^ 1U),
                       .defects = {.clears_both_axes = defect}},
                      SensorEffects({}), 0, 1);
      const auto drop = [](const hal::CanFrame&) {};
      (void)axis.receive(test::message(node, 0x02, 0, 0, 0), drop);
      ASSERT_EQ(axis.error(), 0x4000U) << "stopped";
      (void)axis.receive(test::message(cleared, test::cmd_clear_errors, 0, 0, 0), drop);
      EXPECT_EQ(axis.error() == 0, cleared == node || (defect && cleared == (node ^ 1U)));
    }
  }
}

TEST(DriveDefects, NoNanCheck) {
  constexpr float nan = std::numeric_limits<float>::quiet_NaN(), inf = std::numeric_limits<float>::infinity();
  for (const float bad : {nan, inf, -inf}) {
    Bench good, b({.no_nan_check = true});
    good.torque(bad);
    EXPECT_FALSE(good.axis.closed_loop());
    EXPECT_EQ(good.axis.joint_torque(), 0.0);
    b.torque(bad);
    EXPECT_TRUE(b.axis.closed_loop());
    EXPECT_EQ(b.axis.joint_torque(), bad < 0.0F ? -7.0 : 7.0);
  }
}

/// At constant speed w the angle lags by w times the age of the sample, which grows by 1e-4 of a period per
/// period.
TEST(DriveDefects, Unsynchronised) {
  Bench b({.unsynchronised = true});
  const double w = 2.0 * std::numbers::pi * 10.0;  // 10 rev/s
  const double first = 0.25 - static_cast<double>(test::real(b.pass(1, std::numbers::pi / 2, w), 0));
  EXPECT_GT(first, 0.0);
  EXPECT_LT(first, 0.01) << "a period";
  const double later = 0.25 - static_cast<double>(test::real(b.pass(2000, std::numbers::pi / 2, w), 0));
  EXPECT_NEAR(later - first, 2000 * 1e-4 * 1e-3 * 10.0, 1e-6);
  double least = 1.0, most = 0.0;
  for (int i = 0; i < 20000; ++i) {
    const double lag = 0.25 - static_cast<double>(test::real(b.pass(1, std::numbers::pi / 2, w), 0));
    least = std::min(least, lag);
    most = std::max(most, lag);
  }
  EXPECT_NEAR(least, 0.0, 2e-6);
  EXPECT_NEAR(most, 0.01, 2e-6);
}

/// (limit - speed) gain and (-limit - speed) gain, 2 rev/s and 1/6 N m s/rev: 0.33 N m at rest, 0.12 at 1.3
/// rev/s.
TEST(DriveDefects, TorqueModeLimit) {
  constexpr double turn = 2.0 * std::numbers::pi;
  for (const double speed : {0.0, 1.3, -1.3, 1.9, 2.5}) {
    for (const float asked : {5.0F, -5.0F, 0.05F}) {
      Bench b({.torque_mode_limit = true});
      b.pass(1, 0.0, speed * turn);
      b.torque(asked);
      const double upper = (2.0 - speed) / 6.0, lower = (-2.0 - speed) / 6.0;
      EXPECT_NEAR(b.axis.joint_torque(), std::fmin(std::fmax(static_cast<double>(asked), lower), upper), 1e-9)
          << speed;
    }
  }
}

TEST(DriveDefects, FullTorqueIsAllThatADriveGives) {
  for (const bool cut : {false, true}) {
    Bench b({.torque_mode_limit = cut});
    b.pass(1, 0.0,
           cut ? 2.0 * std::numbers::pi * 1000.0 : 0.0);  // the limiter alone would brake with 166 N m
    b.torque(3e38F);
    EXPECT_EQ(b.axis.joint_torque(), cut ? -7.0 : 7.0);
    b.torque(-3e38F);
    EXPECT_EQ(b.axis.joint_torque(), -7.0);
  }
}

TEST(DriveDefects, OfASceneADriveGivesWhatTheControllerMayAskFor) {
  Scene s;
  s.drives.nodes = {3, 4};
  s.drives.direction = {-1.0, 1.0};
  s.drives.gear_ratio = {2.0, 2.0};
  s.drives.offset = {0.0, 0.0};
  s.torque_limit = {40.0, 40.0};
  s.rate_hz = 1000.0;
  s.drives.watchdog_timeout = 0.01;
  const auto axis = make_axis(s, placed_axes(s).at(0));
  const auto tell = [&](const hal::CanFrame& f) { (void)axis->receive(f, [](const hal::CanFrame&) {}); };
  tell(test::message(node, test::cmd_mode, 1, 1));
  tell(test::message(node, test::cmd_axis_state, 8, 0));
  tell(test::message(node, test::cmd_torque, std::bit_cast<std::uint32_t>(20.0F), 0));
  EXPECT_EQ(axis->joint_torque(), -40.0);
}

TEST(DriveDefects, AnswersToRequestsOf06AndNotOf05) {
  const auto requests = [](OdriveAxis::Version v) {
    OdriveAxis::Settings s{.version = v};
    s.endpoints = {{0, 6, 10}, {{OdriveValue::watchdog_timeout, 0x1234, drive::odrive::ValueType::f32}}};
    OdriveAxis a({.node = static_cast<int>(node)}, s, SensorEffects({}), 0, 1);
    std::vector<hal::CanFrame> sent;
    for (const unsigned command : {0x00U, 0x03U}) {
      hal::CanFrame f = test::message(node, command, 0, 0);
      f.remote = true;
      (void)a.receive(f, [&](const hal::CanFrame& r) { sent.push_back(r); });
    }
    for (const unsigned endpoint : {0x1234U, 0x1235U}) {
      (void)a.receive(test::message(node, 0x04, endpoint * 256, 0),
                      [&](const hal::CanFrame& r) { sent.push_back(r); });
    }
    (void)a.receive(test::message(node, 0x04, 0x1234 * 256 + 1, 0),
                    [&](const hal::CanFrame& r) { sent.push_back(r); });
    return sent;
  };
  const auto now = requests(OdriveAxis::Version::v0_6);
  ASSERT_EQ(now.size(), 3U);
  EXPECT_EQ(now[0], test::message(node, 0x00, 2, 0x000A0600)) << "0.6.10";
  EXPECT_EQ(now[1], test::message(node, 0x03, 0, 0));
  EXPECT_EQ(now[2], test::message(node, 0x05, 0x123400, std::bit_cast<std::uint32_t>(0.01F)));
  EXPECT_TRUE(requests(OdriveAxis::Version::v0_5_6).empty());
}

TEST(DriveDefects, TimeoutStaysEnabled) {
  Bench b({.timeout_stays_enabled = true});
  b.torque(1.5F);
  b.pass(20);
  EXPECT_TRUE(b.axis.closed_loop());
  EXPECT_EQ(b.axis.error(), 0U);
  EXPECT_EQ(b.axis.joint_torque(), 0.0);
  b.torque(1.5F);
  EXPECT_EQ(b.axis.joint_torque(), 1.5) << "the next command acts at once";
}

TEST(DriveDefects, LatchedTimeout) {
  Bench b({.latched_timeout = true});
  b.torque(1.5F);
  b.pass(20);
  for (int i = 0; i < 5; ++i) {
    b.tell(test::message(node, test::cmd_clear_errors, 0, 0, 1));
    b.tell(test::message(node, test::cmd_axis_state, 8, 0));
    EXPECT_FALSE(b.axis.closed_loop());
    EXPECT_EQ(b.axis.error(), 0x01000000U);
  }
}

TEST(DriveDefects, OfMitDrives) {
  const auto make = [](const Defects& d) {
    return MitAxis({.node = static_cast<int>(node)}, {.timeout_cycles = 400, .defects = d}, SensorEffects({}),
                   0, 1);
  };
  const auto tell = [](MitAxis& a, const hal::CanFrame& f) {
    (void)a.receive(f, [](const hal::CanFrame&) {});
  };
  const auto pass = [](MitAxis& a, int n) {
    for (int i = 0; i < n; ++i) a.publish(0.0, 0.0, [](const hal::CanFrame&) {});
  };
  const auto full = test::mit_command(node, 0x8000, 0x800, 0, 0, 0xFFF);
  for (const Defects& d : {Defects{}, Defects{.watchdog_off = true}, Defects{.latched_timeout = true},
                           Defects{.timeout_stays_enabled = true}}) {
    MitAxis a = make(d);
    tell(a, test::mit_special(node, 0xFC));
    tell(a, full);
    pass(a, 20);
    EXPECT_TRUE(a.closed_loop());
    EXPECT_NEAR(a.joint_torque(), d.watchdog_off ? 18.0 : 0.0, 1e-9);
    tell(a, full);
    EXPECT_NEAR(a.joint_torque(), d.latched_timeout ? 0.0 : 18.0, 1e-9);
    tell(a, test::mit_special(node, 0xFC));
    tell(a, full);
    EXPECT_NEAR(a.joint_torque(), 18.0, 1e-9) << "motor mode entered anew";
  }
  for (const bool defect : {false, true}) {
    MitAxis a = make({.short_frames_stale = defect});
    tell(a, test::mit_special(node, 0xFC));
    tell(a, full);
    hal::CanFrame cut = test::mit_command(node, 0x8000, 0x800, 0, 0, 0);
    cut.size = 7;  // the high bits of the torque become 0, the low ones stay FF: 255 of 4095
    tell(a, cut);
    EXPECT_NEAR(a.joint_torque(), defect ? 255 * 36.0 / 4095 - 18 : 18.0, 1e-9);
  }
}

/// RPDO1 {6040, 6071}, a master of 5 ms at node 100 that has been heard once, enabled at half its rated
/// torque.
class CanopenBench {
 public:
  explicit CanopenBench(const Defects& d)
      : axis({.node = static_cast<int>(node)}, settings(d), SensorEffects({}), 0, 1) {
    write(test::entry(0x1016, 1), 0x0064'0005, 4);
    write(test::entry(0x6007, 0), 1, 2);
    write(test::entry(0x6060, 0), 10, 1);
    write(test::entry(0x1400, 1), 0x8000'0200 + node, 4);
    write(test::entry(0x1600, 0), 0, 1);
    write(test::entry(0x1600, 1), 0x6040'0010, 4);
    write(test::entry(0x1600, 2), 0x6071'0010, 4);
    write(test::entry(0x1600, 0), 2, 1);
    write(test::entry(0x1400, 1), 0x0000'0200 + node, 4);
    tell(test::nmt(1, node));
    tell(test::can(0x764, {5}));
    for (const int word : {0x06, 0x07, 0x0F}) tell(test::can(0x200 + node, {word, 0, 0xF4, 0x01}));
    EXPECT_EQ(axis.joint_torque(), 0.5);
  }
  void tell(const hal::CanFrame& f) {
    (void)axis.receive(f, [](const hal::CanFrame&) {});
  }
  void write(std::uint32_t object, std::uint32_t value, unsigned bytes) {
    const int command = bytes == 1 ? 0x2F : (bytes == 2 ? 0x2B : 0x23);
    tell(test::sdo(0x600 + node, command, object >> 8U, object & 0xFFU, value));
  }
  void pass(int n) {
    for (int i = 0; i < n; ++i) axis.publish(0.0, 0.0, [](const hal::CanFrame&) {});
  }
  Cia402Axis axis;

 private:
  static Cia402Axis::Settings settings(const Defects& d) {
    Cia402Axis::Settings s;
    s.lockstep = false;
    s.defects = d;
    return s;
  }
};

TEST(DriveDefects, OfCia402Drives) {
  for (const bool defect : {false, true}) {
    CanopenBench off({.watchdog_off = defect});
    off.pass(5);
    EXPECT_EQ(off.axis.joint_torque(), 0.5);
    off.pass(1000);
    EXPECT_EQ(off.axis.joint_torque(), defect ? 0.5 : 0.0);
    EXPECT_EQ(off.axis.value(0x1016, 1), 0x0064'0005U) << "reads back all the same";
    CanopenBench stale({.short_frames_stale = defect});
    stale.tell(test::can(0x200 + node, {0x0F, 0, 0x64}));
    EXPECT_EQ(stale.axis.joint_torque(), defect ? 0.356 : 0.5) << "0164h thousandths; else it is not used";
    CanopenBench keeps({.pre_operational_keeps_torque = defect});
    keeps.tell(test::nmt(0x80, node));
    EXPECT_EQ(keeps.axis.joint_torque(), defect ? 0.5 : 0.0);
    EXPECT_EQ(keeps.axis.error(), defect ? 0U : 0x8130U);
    keeps.tell(test::can(0x200 + node, {0, 0, 0, 0}));
    EXPECT_EQ(keeps.axis.joint_torque(), defect ? 0.5 : 0.0) << "PDOs are off";
    keeps.tell(test::nmt(0x02, node));
    EXPECT_EQ(keeps.axis.joint_torque(), 0.0);
    EXPECT_EQ(keeps.axis.error(), 0x8130U);
  }
}

TEST(LoneShaft, SpeedsUpAndRunsDownAsTheClosedFormSays) {
  for (const double friction : {0.0, 1e-12, 0.02, 5.0}) {
    for (const double step : {1e-3, 0.05}) {
      LoneShaft s{.inertia = 0.01, .friction = friction, .load = 0.3, .angle = 1.0, .rate = 2.0};
      for (double t = step; t < 0.5; t += step) {
        s.advance(0.8, step);
        const double a = friction / 0.01, last = friction > 0 ? 0.5 / friction : 0.0;
        const bool free = friction < 1e-9;
        const double w = free ? 2.0 + 50.0 * t : last + (2.0 - last) * std::exp(-a * t);
        const double q = free ? 1.0 + 2.0 * t + 25.0 * t * t
                              : 1.0 + last * t + (2.0 - last) * (1.0 - std::exp(-a * t)) / a;
        ASSERT_NEAR(s.rate, w, 1e-9);
        ASSERT_NEAR(s.angle, q, 1e-9);
      }
    }
  }
}

}  // namespace
}  // namespace esmc::host
