/// The reference problems B1 to B4 to the digits that were computed elsewhere in quadruple precision.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "host_sim/integrate/dopri8.hpp"
#include "host_sim/integrate/radau5.hpp"
#include "host_sim/problems/problems.hpp"

namespace esmc::host {
namespace {

template <class Method, class Sys>
typename Sys::State solve(const Sys& system, double end, double tolerance) {
  Method m(system);
  Tolerance t;
  t.absolute = t.relative = tolerance;
  typename Sys::State y = system.start();
  const Advance a = m.advance(0.0, end, y, t);
  EXPECT_TRUE(a.ok);
  return y;
}

TEST(ReferenceProblems, B1AndrewsSqueezingMechanism) {
  const double angle[] = {15.81077119515370709711938,   -15.75637105841183946972777,
                          0.04082224011964580485828232, 0.5244099658799540693716556,
                          -0.5347301163420795937701850, 1.048080741041937873068515,
                          0.5347301163420795937701850};
  const double rate[] = {1139.920302259106064198097, -1424.379295177540073196026,
                         11.03291191061859374532731, 0.5735699148295024538176879,
                         19.29337410503204083162756, 0.3231791492491308749907484,
                         -19.29337410503204083162756};
  const auto y = solve<Dopri8<Andrews>>(Andrews(), 0.03, 1e-12);
  for (std::size_t i = 0; i < 7; ++i) {
    EXPECT_NEAR(y[i], angle[i], 1e-11 * std::abs(angle[i])) << i;
    EXPECT_NEAR(y[7 + i], rate[i], 1e-9 * std::abs(rate[i])) << i;
  }
}

TEST(ReferenceProblems, B2TwoFourBarsThroughTheLossOfRank) {
  const TwoFourBars system;
  Dopri8<TwoFourBars> m(system);
  Tolerance t;
  t.absolute = t.relative = 1e-13;
  auto y = system.start();
  struct Known {
    double t, x, y, allowed;
  };
  double now = 0.0;
  for (const Known& k : {Known{4, 0.117616102376808611714883, 0.993059138451325100960125, 1e-10},
                         Known{10, 0.328458111540815378652164, 0.944518538178600962161285, 1e-9},
                         Known{20, 0.839746574306843546539995, 0.542978536352884661594965, 1e-9}}) {
    ASSERT_TRUE(m.advance(now, k.t, y, t).ok);
    now = k.t;
    EXPECT_NEAR(TwoFourBars::b0(y).x(), k.x, k.allowed);
    EXPECT_NEAR(TwoFourBars::b0(y).y(), k.y, k.allowed);
  }
  EXPECT_EQ(system.rank(system.start()), 4);
  EXPECT_LT(system.rank(TwoFourBars::parallelogram(0.0, 1.0)), 4)
      << "lying flat, the closures lose rank, and it is noticed";
}

TEST(ReferenceProblems, B3Pendulum) {
  const auto y = solve<Dopri8<Pendulum>>(Pendulum(), 10.0, 1e-14);
  EXPECT_NEAR(y[0], -0.275087462576116860054391, 1e-12);
  EXPECT_NEAR(y[1], -0.961419205099125064265135, 1e-12);
}

TEST(ReferenceProblems, B4FallsThroughItsSingularities) {
  const FallingFiveBar system;
  const auto q = system.output(solve<Dopri8<FallingFiveBar>>(system, 0.25, 1e-14)).q;
  const double known[] = {-0.01349935527164578566, 0.06458494073116901118, -2.22637410112360593504,
                          3.73679171077824686325,  0.18873371917602579560, 2.68678616236967082441};
  for (std::size_t i = 0; i < 6; ++i) EXPECT_NEAR(q[i], known[i], 1e-12) << i;
  // At 1 s, past type 2: two methods of different families, and two tolerances.
  const auto explicit_ = solve<Dopri8<FallingFiveBar>>(system, 1.0, 1e-14);
  const auto finer = solve<Dopri8<FallingFiveBar>>(system, 1.0, 3e-15);
  const auto implicit_ = solve<Radau5<FallingFiveBar>>(system, 1.0, 1e-13);
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_NEAR(explicit_[i], finer[i], 1e-11) << i;
    EXPECT_NEAR(explicit_[i], implicit_[i], 1e-11) << i;
  }
}

}  // namespace
}  // namespace esmc::host
