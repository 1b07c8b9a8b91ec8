/// Torques of a CiA 402 drive at the end of what its frame can hold.

#include <gtest/gtest.h>

#include "tests/support/cia402_bench.hpp"

namespace esmc::test {
namespace {

TEST(Cia402TorqueEdges, ATorqueIsSentInThousandthsUpToTheEndOfTheFrame) {
  Bench b;
  ASSERT_TRUE(b.make_ready());
  struct Case {
    float thousandths;
    int sent;
  };
  for (const auto& [thousandths, sent] : {Case{32'500, 32'500}, Case{32'700, 32'700}, Case{32'900, 32'767},
                                          Case{33'000, 32'767}, Case{70'000, 32'767}}) {
    for (const int sign : {1, -1}) {
      const float torque = static_cast<float>(sign) * thousandths * 1e-3F * settings().rated_torque;
      const CanFrame f = torque_frame(b.axis, torque);
      EXPECT_NEAR(static_cast<std::int16_t>(little(f, 2, 2)), sign * sent, sent < 32'767 ? 1 : 0)
          << thousandths;
    }
  }
}

}  // namespace
}  // namespace esmc::test
