// The generated five-bar (tests/symbolic/straight_line.cpp) against the plant, which is Lagrange's equations
// with multipliers in other coordinates.

#include <gtest/gtest.h>

#include "host_sim/plant/plant.hpp"
#include "tests/benchmarks/straight_line.hpp"
#include "tests/support/random_mechanism.hpp"

namespace esmc::test {
namespace {

TEST(StraightLine, IsThePlant) {
  Accuracy acceleration("acceleration");
  for (std::uint64_t seed = 0; seed < 2000; ++seed) {
    const auto c = random_five_bar<double>(seed, {.min_sin1 = 0.0, .min_sin2 = 0.2});
    Random r(~seed);
    const StraightLine straight(c.params);
    const host::FiveBarPlant plant(c.params);
    std::array<double, 4> theta{}, rate{}, torque{};
    for (std::size_t i = 0; i < 4; ++i) {
      theta[i] = c.theta[static_cast<int>(i)];
      rate[i] = c.theta_rate[static_cast<int>(i)];
      torque[i] = r.in<double>(-3, 3);
    }
    const auto s = host::FiveBarPlant::from_joints(theta, rate);
    const auto a = plant.acceleration(s.angle, s.rate, torque);
    const Vec<double, 4> want(a[0], a[1] - a[0], -a[2], a[2] - a[3]);
    const auto got = straight(theta, {rate[0], rate[2]}, torque);
    // At rest and without torque the weight alone: what a difference is measured against when forces cancel.
    acceleration.compare(seed, Vec<double, 4>(got[0], got[1], got[2], got[3]), want, 1);
  }
  acceleration.expect_below(1e-12);
}

}  // namespace
}  // namespace esmc::test
