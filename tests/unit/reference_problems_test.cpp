/// The reference problems B1 to B4 to the digits that were computed elsewhere in quadruple precision
/// (tests/reference/benchmarks.md).

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "host_sim/integrate/dopri8.hpp"
#include "host_sim/integrate/fixed_step.hpp"
#include "host_sim/integrate/radau5.hpp"
#include "host_sim/plant/system.hpp"
#include "host_sim/problems/problems.hpp"

namespace esmc::host {
namespace {

static_assert(System<Andrews> && System<TwoFourBars> && System<Pendulum>);

template <class Method, class Sys>
typename Sys::State solve(const Sys& system, const typename Sys::State& start, double end, double tolerance) {
  Method m(system);
  Tolerance t;
  t.absolute = t.relative = tolerance;
  typename Sys::State y = start;
  EXPECT_TRUE(m.advance(0.0, end, y, t).ok);
  return y;
}

TEST(ReferenceProblems, B1AndrewsSqueezingMechanism) {
  const Andrews system;
  EXPECT_LE(system.mechanism().gap(Andrews::position(system.start())).cwiseAbs().maxCoeff(), 1e-16);
  EXPECT_EQ(system.mechanism().rank(Andrews::position(system.start())), 6);
  const double angle[] = {15.81077119515370709711938,   -15.75637105841183946972777,
                          0.04082224011964580485828232, 0.5244099658799540693716556,
                          -0.5347301163420795937701850, 1.048080741041937873068515,
                          0.5347301163420795937701850};
  const double rate[] = {1139.920302259106064198097, -1424.379295177540073196026,
                         11.03291191061859374532731, 0.5735699148295024538176879,
                         19.29337410503204083162756, 0.3231791492491308749907484,
                         -19.29337410503204083162756};
  const auto y = solve<Dopri8<Andrews>>(system, system.start(), 0.03, 1e-12);
  for (std::size_t i = 0; i < 7; ++i) {
    EXPECT_NEAR(y[i], angle[i], 1e-11 * std::abs(angle[i])) << i;
    EXPECT_NEAR(y[7 + i], rate[i], 1e-9 * std::abs(rate[i])) << i;
  }
}

TEST(ReferenceProblems, ProjectionClosesAndLeavesWhatIsClosed) {
  const Andrews system;
  const auto y = solve<Dopri8<Andrews>>(system, system.start(), 0.013, 1e-9);
  auto moved = y;
  for (std::size_t i = 0; i < 7; ++i) {
    moved[i] += 1e-6 * std::cos(3.0 * static_cast<double>(i));
    moved[7 + i] += 10.0 * std::sin(2.0 * static_cast<double>(i));
  }
  system.project(moved);
  EXPECT_LE(system.mechanism().gap(Andrews::position(moved)).cwiseAbs().maxCoeff(), 1e-16);
  for (std::size_t i = 0; i < 7; ++i) EXPECT_NEAR(moved[i], y[i], 2e-6);
  auto again = moved;
  system.project(again);
  for (std::size_t i = 0; i < 14; ++i)
    EXPECT_NEAR(again[i], moved[i], 1e-14 * std::fmax(1, std::abs(moved[i])));
}

/// The parallelogram is one pendulum: rods 3 / 3, couplers 2 x 1 kg at 1 m.
double parallelogram_acceleration(double angle) {
  return -(3 * 0.5 + 2.0) / (3 / 3.0 + 2.0) * 9.81 * std::cos(angle);
}

TEST(TwoFourBars, AccelerationsAreThoseOfOnePendulumAlsoWhereClosureLosesRank) {
  const TwoFourBars p;
  constexpr double pi = 3.14159265358979323846;
  for (const double flat : {0.0, pi}) {
    for (const double away :
         {0.0, 1e-12, 1e-9, 1e-7, -1e-6, 1e-5, 1e-4, -1e-3, 0.005, 0.01, 0.015, 0.02, 0.3, 1.5}) {
      for (const double rate : {-3.0, 0.1, 7.0}) {
        const auto y = TwoFourBars::parallelogram(flat + away, rate);
        TwoFourBars::State dy{};
        p.slope(0, y, dy);
        const double want = parallelogram_acceleration(flat + away);
        for (const auto& [i, sign] : {std::pair{5U, 1.0}, {6U, -1.0}, {7U, 1.0}, {8U, 1.0}, {9U, -1.0}}) {
          EXPECT_EQ(dy[i - 5], y[i]);
          EXPECT_NEAR(dy[i], sign * want, 1e-10) << flat << " + " << away << " at " << rate << ", row " << i;
        }
      }
    }
  }
}

/// Steps that put a stage right into the flat configuration.
TEST(TwoFourBars, StepsMayFallOnTheLossOfRank) {
  const TwoFourBars p;
  auto y = TwoFourBars::parallelogram(0.0, -3.0);
  const auto energy = [&] { return 1.5 * y[5] * y[5] + 3.5 * 9.81 * std::sin(y[0]); };
  const double before = energy();
  Rk4<TwoFourBars> m(p);
  for (int n = 0; n < 2000; ++n) m.step(n * 1e-3, 1e-3, y);
  EXPECT_NEAR(energy(), before, 1e-9);
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
    EXPECT_NEAR(std::cos(y[0]), k.x, k.allowed);  // B0
    EXPECT_NEAR(std::sin(y[0]), k.y, k.allowed);
  }
  const auto rank = [&](const TwoFourBars::State& s) {
    return system.mechanism().rank(TwoFourBars::position(s));
  };
  EXPECT_EQ(rank(system.start()), 4);
  EXPECT_EQ(rank(TwoFourBars::parallelogram(1e-3, 1.0)), 4);
  EXPECT_EQ(rank(TwoFourBars::parallelogram(0.0, 1.0)), 2) << "lying flat, one is lost per four-bar";
}

TEST(ReferenceProblems, B3Pendulum) {
  const auto y = solve<Dopri8<Pendulum>>(Pendulum(), Pendulum::start(), 10.0, 1e-14);
  EXPECT_NEAR(y[0], -0.275087462576116860054391, 1e-12);
  EXPECT_NEAR(y[1], -0.961419205099125064265135, 1e-12);
}

TEST(ReferenceProblems, B4FallsThroughItsSingularities) {
  using Fall = BareSystem<FiveBarPlant>;
  const LegParams<double> leg{0.12, 0.16, 0.06, 0.068, 0.1, 0.1, 2e-4, 7e-4};
  const FiveBarPlant plant(FiveBarParams<double>{0.05, 0.0, 9.8, {{leg, leg}}});
  const Fall system(plant);
  const auto at = FiveBarPlant::from_joints(
      {0.33914579427821183820, 1.85318013531281830819, 1.31276054418215195822, 1.48475269532538599760}, {});
  Fall::State start{};
  Fall::put(start, at.angle, at.rate);
  const auto y = solve<Dopri8<Fall>>(system, start, 0.25, 1e-14);
  const auto q = plant.output({Fall::angles(y), Fall::rates(y)}).q;
  const double known[] = {-0.01349935527164578566, 0.06458494073116901118, -2.22637410112360593504,
                          3.73679171077824686325,  0.18873371917602579560, 2.68678616236967082441};
  for (std::size_t i = 0; i < 6; ++i) EXPECT_NEAR(q[i], known[i], 1e-12) << i;
  // At 1 s, past type 2: two methods of different families, and two tolerances.
  const auto explicit_ = solve<Dopri8<Fall>>(system, start, 1.0, 1e-14);
  const auto finer = solve<Dopri8<Fall>>(system, start, 1.0, 3e-15);
  const auto implicit_ = solve<Radau5<Fall>>(system, start, 1.0, 1e-13);
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_NEAR(explicit_[i], finer[i], 1e-11) << i;
    EXPECT_NEAR(explicit_[i], implicit_[i], 1e-11) << i;
  }
}

}  // namespace
}  // namespace esmc::host
