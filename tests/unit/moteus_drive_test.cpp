/// The emulated moteus against the vendor's rules. Frames are written by hand.

#include "host_sim/drives/moteus_axis.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "tests/support/moteus_bytes.hpp"

namespace esmc::host {
namespace {

using test::digits_of;
using test::fd_frame;
using test::float_digits;

class MoteusDrive : public testing::Test {
 protected:
  static MoteusAxis make(const MoteusAxis::Settings& s = {.realtime = true},
                         const AxisMount& m = {.node = 3}) {
    return MoteusAxis(m, s, SensorEffects({}), 0, 1);
  }
  static std::vector<hal::CanFrame> publish(MoteusAxis& a, double angle = 0.0, double rate = 0.0) {
    std::vector<hal::CanFrame> sent;
    a.publish(angle, rate, [&](const hal::CanFrame& f) { sent.push_back(f); });
    return sent;
  }
  std::string tell(MoteusAxis& a, const std::string& digits, std::uint32_t id = 0x8003) {
    std::string said;
    completes_ = a.receive(fd_frame(id, digits), [&](const hal::CanFrame& r) {
      EXPECT_EQ(r.id, 0x300U | (id >> 8U & 0x7FU));
      said += digits_of(r);
    });
    return said;
  }
  /// Position mode without gains, a torque, and more registers.
  static std::string torque(float nm, const std::string& more = "") {
    return "01000a 0220 8000 0d22" + float_digits(nm) + "0223 0000" + more;
  }
  bool completes_ = false;
};

TEST_F(MoteusDrive, ReadsWhatIsAskedInItsTypes) {
  MoteusAxis a = make({.realtime = true}, {.node = 3, .gear_ratio = 2.0});
  publish(a, 0.5 * 3.14159265358979, -3.14159265358979);  // a half turn of the shaft, one turn/s back
  EXPECT_EQ(tell(a, "1100 1f01 110f"),
            "2100002f01" + float_digits(0.5F) + float_digits(-1.0F) + float_digits(0.0F) + "210f00");
  EXPECT_FALSE(completes_) << "no command";
  EXPECT_EQ(tell(a, "1601"), "2601881360f0");
  EXPECT_EQ(tell(a, "1101 1902"), "21013229026079feff505050");
  EXPECT_EQ(tell(a, "118202 110c"), "21820205210c02");
  EXPECT_EQ(tell(a, "11 7f"), "317f01") << "no such register";
  EXPECT_EQ(tell(a, "1100", 0x0003), "") << "no reply wanted";
  EXPECT_EQ(tell(a, "1100", 0x8503), "210000");
  EXPECT_EQ(tell(a, "1100", 0x8004), "") << "of another node";
}

TEST_F(MoteusDrive, HasTorqueInPositionModeOnlyWithinItsLimits) {
  MoteusAxis a =
      make({.torque_max = 4.0, .realtime = true}, {.node = 3, .direction = -1.0, .gear_ratio = 2.0});
  publish(a, 1.0);
  EXPECT_EQ(tell(a, torque(1.5F, "1100")), "210000") << "the mode before the frame acts";
  EXPECT_TRUE(completes_ && a.closed_loop());
  EXPECT_EQ(a.joint_torque(), -3.0);
  EXPECT_EQ(tell(a, "1100"), "21000a");
  tell(a, torque(1.5F, "0525 6400"));
  EXPECT_EQ(a.joint_torque(), -2.0) << "1 N m at most";
  tell(a, torque(9.0F));
  EXPECT_EQ(a.joint_torque(), -8.0) << "its own limit";
  tell(a, torque(std::nanf("")));
  EXPECT_EQ(a.joint_torque(), 0.0);
  tell(a, "0d22" + float_digits(2.0F));
  EXPECT_EQ(a.joint_torque(), 0.0) << "registers without a mode in front";
  EXPECT_FALSE(completes_);
  tell(a, torque(1.0F));
  tell(a, "010000");
  EXPECT_FALSE(a.closed_loop());
  EXPECT_EQ(a.joint_torque(), 0.0);
}

TEST_F(MoteusDrive, GainsActUnlessTheyAreScaledAway) {
  MoteusAxis a = make();
  publish(a, 0.0, 2.0 * 3.14159265358979);
  tell(a, "01000a 0d20" + float_digits(0.25F));
  EXPECT_NEAR(a.joint_torque(), 4.0 * 0.25 - 0.05, 1e-9) << "unspecified scales are 1";
  tell(a, "01000a 0120 80 0223 7f00");
  EXPECT_NEAR(a.joint_torque(), 0.0, 1e-9) << "the present position";
}

TEST_F(MoteusDrive, ATimeOutIsLatchedUntilAStop) {
  MoteusAxis a = make();
  publish(a);
  tell(a, torque(1.0F, "0527 0a00"));
  for (int n = 0; n < 10; ++n) publish(a);
  EXPECT_TRUE(a.closed_loop()) << "10 ms";
  publish(a, 0.0, 4.0 * 3.14159265358979);
  EXPECT_FALSE(a.closed_loop());
  EXPECT_EQ(a.error(), 11U);
  EXPECT_EQ(a.joint_torque(), 0.0);
  tell(a, torque(1.0F, "0527 0a00"));
  EXPECT_EQ(tell(a, "1100"), "21000b");
  tell(a, "010000");
  EXPECT_EQ(a.error(), 0U);
  tell(a, torque(1.0F, "0127 80"));
  for (int n = 0; n < 2000; ++n) publish(a);
  EXPECT_TRUE(a.closed_loop()) << "NaN: none";
  tell(a, torque(1.0F));
  for (int n = 0; n < 101; ++n) publish(a);
  EXPECT_FALSE(a.closed_loop()) << "its own of 0.1 s";
}

TEST_F(MoteusDrive, AFaultIsClearedByAStop) {
  MoteusAxis a = make();
  tell(a, "01000a 0126 00 0128 01");
  EXPECT_EQ(a.error(), 45U);
  tell(a, torque(1.0F));
  EXPECT_EQ(tell(a, "1100 110f"), "210001210f2d");
  EXPECT_EQ(a.joint_torque(), 0.0);
  tell(a, "010000");
  tell(a, torque(1.0F));
  EXPECT_EQ(a.joint_torque(), 1.0);
}

TEST_F(MoteusDrive, RepliesOncePerPeriodInLockstep) {
  MoteusAxis a = make({});
  EXPECT_EQ(digits_of(publish(a).at(0)).substr(0, 6), "210000") << "unasked at first";
  EXPECT_EQ(tell(a, torque(1.0F, "1100 2200")), "");
  EXPECT_EQ(digits_of(publish(a).at(0)), "21000a");
  EXPECT_EQ(a.confirmations(), 1);
  tell(a, "010000", 0x0003);
  EXPECT_EQ(digits_of(publish(a).at(0)), "210000");
  EXPECT_EQ(a.confirmations(), 0);
  EXPECT_TRUE(a.commanded_by(fd_frame(0x8003, "1100")));
  EXPECT_FALSE(a.commanded_by(fd_frame(0x0300, "1100")));
}

TEST_F(MoteusDrive, DefectsShow) {
  const auto with = [](bool Defects::*defect) {
    MoteusAxis::Settings s{.realtime = true};
    s.defects.*defect = true;
    return make(s);
  };
  MoteusAxis a = with(&Defects::position_invalid);
  publish(a, 1.0, 1.0);
  EXPECT_EQ(tell(a, "1201"), "22018080");
  a = with(&Defects::relative_position);
  EXPECT_EQ(tell(a, "110c"), "210c00");
  a = with(&Defects::other_registers);
  EXPECT_EQ(tell(a, "118202"), "21820204");
  a = with(&Defects::refuses_watchdog);
  EXPECT_EQ(tell(a, torque(1.0F, "0527 0a00 1527")), "302701312701");
  for (int n = 0; n < 50; ++n) publish(a);
  EXPECT_TRUE(a.closed_loop());
  a = with(&Defects::watchdog_off);
  tell(a, torque(1.0F, "0527 0a00"));
  for (int n = 0; n < 500; ++n) publish(a);
  EXPECT_EQ(a.joint_torque(), 1.0);
  a = with(&Defects::low_max_torque);
  tell(a, torque(1.0F));
  EXPECT_EQ(a.joint_torque(), 0.05);
  a = with(&Defects::timeout_damps);
  tell(a, torque(1.0F, "0527 0a00"));
  for (int n = 0; n < 12; ++n) publish(a, 0.0, 4.0 * 3.14159265358979);
  EXPECT_NEAR(a.joint_torque(), -0.1, 1e-9);
  a = with(&Defects::classic_replies);
  hal::CanFrame said;
  (void)a.receive(fd_frame(0x8003, "1100 1f01"), [&](const hal::CanFrame& f) { said = f; });
  EXPECT_TRUE(!said.fd && !said.bit_rate_switch && said.size == 8);
}

// What is asked may be more than a frame holds.
TEST_F(MoteusDrive, AnyFrameIsSurvived) {
  MoteusAxis a = make();
  unsigned draw = 1;
  const auto next = [&] { return draw = draw * 1664525U + 1013904223U, draw >> 16U; };
  for (int n = 0; n < 100'000; ++n) {
    hal::CanFrame f = fd_frame(0x8003, "1c4000");
    f.size = static_cast<std::uint8_t>(next() % 65);
    for (unsigned i = 0; i < f.size; ++i) {
      if (n % 2 == 0 || next() % 8 == 0)
        f.data[i] = static_cast<std::uint8_t>(next() % (n % 3 == 0 ? 64 : 256));
    }
    (void)a.receive(f, [](const hal::CanFrame& r) { ASSERT_TRUE(hal::well_formed(r)); });
    ASSERT_TRUE(std::abs(a.joint_torque()) <= 10.0);
  }
}

}  // namespace
}  // namespace esmc::host
