/// An ODrive at its edges: positions exactly near zero, an angle that comes after torque control, errors that
/// come back.

#include <gtest/gtest.h>

#include "tests/support/odrive_bench.hpp"

namespace esmc::test {
namespace {

bool told(OdriveAxis& a, float position) {
  EXPECT_EQ(a.receive(encoder(node, position, 0.0F)), Received::accepted);
  return a.brought_sample();
}

TEST(OdriveEdges, ZeroAfterAPositionNearbyIsAnAngle) {
  for (const float side : {1.0F, -1.0F}) {
    for (const auto& [distance, near] : {std::pair{1e-3F, true}, {1.001e-3F, false}}) {
      OdriveAxis a = axis(Version::v0_5_6);
      a.begin_tick();
      EXPECT_TRUE(told(a, side * distance));
      EXPECT_EQ(told(a, 0.0F), near) << side * distance;
    }
  }
}

TEST(OdriveEdges, TheFirstAngleAfterTorqueControlMayBeZero) {
  OdriveAxis a = axis(Version::v0_5_6);
  arm(a);
  EXPECT_TRUE(told(a, 0.0F));
  EXPECT_TRUE(a.ready());
}

/// Known, and never fresh: the wait for fresh ones begins anew after every clearing.
TEST(OdriveEdges, ErrorsThatComeBackWaitAsLongAsTheFirstOnes) {
  OdriveAxis a = axis(Version::v0_5_6);
  hear(a, 1, 0x200);
  EXPECT_TRUE(only(enable(a), cmd_mode));
  std::vector<int> cleared;
  for (int report = 1; report <= 110; ++report) {
    a.know_errors(true, false);
    hear(a, 1, 0x200);
    for (const CanFrame& f : enable(a)) {
      if (command_of(f) == cmd_clear_errors) cleared.push_back(report);
    }
  }
  ASSERT_GE(cleared.size(), 3U);
  EXPECT_EQ(cleared[0], 16);
  EXPECT_EQ(cleared[1] - cleared[0], 9 + 16) << "the retry time, and 16 reports";
  EXPECT_EQ(cleared[2] - cleared[1], 9 + 16);
}

}  // namespace
}  // namespace esmc::test
