// The modular algorithm on mechanisms of the literature, against published or separately computed values
// (tests/reference/benchmarks.md). The integrator is the tests' own: RK4, closed after every step,
// extrapolated once.

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "host_sim/problems/problems.hpp"

namespace esmc::host {
namespace {

static_assert(System<Andrews> && System<TwoFourBars> && System<Pendulum> && System<FallingFiveBar>);

template <System P>
typename P::State rk4(const P& p, double end, int steps) {
  using State = typename P::State;
  State y = p.start(), a{}, b{}, c{}, d{}, s{};
  const double h = end / steps;
  const auto shift = [&](double k, const State& slope) {
    for (std::size_t i = 0; i < p.size(); ++i) s[i] = y[i] + k * slope[i];
    return s;
  };
  for (int n = 0; n < steps; ++n) {
    const double t = n * h;
    p.slope(t, y, a);
    p.slope(t + h / 2, shift(h / 2, a), b);
    p.slope(t + h / 2, shift(h / 2, b), c);
    p.slope(t + h, shift(h, c), d);
    for (std::size_t i = 0; i < p.size(); ++i) y[i] += h / 6 * (a[i] + 2 * (b[i] + c[i]) + d[i]);
    p.project(y);
  }
  return y;
}
template <System P>
typename P::State extrapolated(const P& p, double end, int steps) {
  const auto rough = rk4(p, end, steps);
  auto fine = rk4(p, end, 2 * steps);
  for (std::size_t i = 0; i < p.size(); ++i) fine[i] += (fine[i] - rough[i]) / 15;
  return fine;
}

TEST(Andrews, StartsClosedAndReachesThePublishedState) {
  const Andrews p;
  const auto y0 = p.start();
  EXPECT_LE(p.mechanism().gap(Andrews::position(y0)).cwiseAbs().maxCoeff(), 1e-16);
  EXPECT_EQ(p.mechanism().rank(Andrews::position(y0)), 6);
  const auto y = extrapolated(p, 0.03, 3000);
  const double phi = -0.5347301163420795937701850, phi_rate = 19.29337410503204083162756;
  const auto expect = [&](Andrews::Angle angle, double want, double want_rate) {
    EXPECT_NEAR(y[angle], want, 1e-12 * std::fmax(1, std::abs(want))) << angle;
    EXPECT_NEAR(y[7U + angle], want_rate, 1e-12 * 1424.0)
        << angle;  // of the fastest: they depend on each other
  };
  expect(Andrews::beta, 15.81077119515370709711938, 1139.920302259106064198097);
  expect(Andrews::theta, -15.75637105841183946972777, -1424.379295177540073196026);
  expect(Andrews::gamma, 0.04082224011964580485828232, 11.03291191061859374532731);
  expect(Andrews::phi, phi, phi_rate);
  expect(Andrews::delta, 0.5244099658799540693716557, 0.5735699148295024538176879);
  expect(Andrews::omega, -phi, -phi_rate);
  expect(Andrews::epsilon, 1.048080741041937873068515, 0.3231791492491308749907484);
}

TEST(Andrews, ProjectionIsTheShortestInTheMassMetric) {
  const Andrews p;
  const auto& m = p.mechanism();
  auto y = rk4(p, 0.013, 400);
  const auto q = Andrews::position(y), v = Andrews::rate(y);
  auto moved = y;
  for (std::size_t i = 0; i < 7; ++i) {
    moved[i] += 1e-6 * std::cos(3.0 * static_cast<double>(i));
    moved[7 + i] += 10.0 * std::sin(2.0 * static_cast<double>(i));
  }
  auto back = moved;
  p.project(back);
  const auto q1 = Andrews::position(back), v1 = Andrews::rate(back), off = Andrews::rate(moved);
  EXPECT_LE(m.gap(q1).cwiseAbs().maxCoeff(), 1e-16);
  EXPECT_LE(m.gap_rate(q1, v1).cwiseAbs().maxCoeff(), 1e-13);
  // Pythagoras: what is taken off is orthogonal to what is left, and to every closed motion.
  const double whole = m.kinetic_energy(q1, off), kept = m.kinetic_energy(q1, v1),
               lost = m.kinetic_energy(q1, off - v1);
  EXPECT_GT(lost, 1e-6 * whole);
  EXPECT_NEAR(whole, kept + lost, 1e-13 * whole);
  const Andrews::Coordinates step = Andrews::position(moved) - q1;
  EXPECT_NEAR(m.kinetic_energy(q1, step + 1e-9 * v1), m.kinetic_energy(q1, step - 1e-9 * v1),
              1e-4 * m.kinetic_energy(q1, step));
  // What is closed stays where it is.
  auto again = back;
  p.project(again);
  for (std::size_t i = 0; i < 14; ++i)
    EXPECT_NEAR(again[i], back[i], 1e-14 * std::fmax(1, std::abs(back[i])));
  EXPECT_LE((q1 - q).cwiseAbs().maxCoeff(), 2e-6);
  EXPECT_GT((v1 - v).cwiseAbs().maxCoeff(), 1.0);  // along the closed motion nothing is taken
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

TEST(TwoFourBars, LossOfRankIsReported) {
  const TwoFourBars p;
  EXPECT_EQ(p.rank(p.start()), 4);
  EXPECT_EQ(p.rank(TwoFourBars::parallelogram(1e-3, 1)), 4);
  EXPECT_EQ(p.rank(TwoFourBars::parallelogram(0, 1)), 2);  // one lost per four-bar
  EXPECT_EQ(p.rank(TwoFourBars::parallelogram(3.14159265358979323846, 1)), 2);
}

TEST(TwoFourBars, ReachesTheComputedStatesThroughTheFlatOnes) {
  const TwoFourBars p;
  struct {
    double t, x, y;
  } const want[]{{4, 0.117616102376808611714883, 0.993059138451325100960125},
                 {10, 0.328458111540815378652164, 0.944518538178600962161285},
                 {20, 0.839746574306843546539995, 0.542978536352884661594965}};
  for (const auto& w : want) {
    const auto at = TwoFourBars::b0(extrapolated(p, w.t, static_cast<int>(350 * w.t)));
    EXPECT_NEAR(at.x(), w.x, 5e-10) << w.t;
    EXPECT_NEAR(at.y(), w.y, 5e-10) << w.t;
  }
}

/// Steps that put a stage right into the flat configuration, and many that surround it.
TEST(TwoFourBars, StepsMayFallOnTheLossOfRank) {
  const TwoFourBars p;
  struct Flat : TwoFourBars {
    [[nodiscard]] static State start() { return parallelogram(0.0, -3.0); }
  };
  const auto y = extrapolated(Flat{}, 2.0, 500), fine = rk4(Flat{}, 2.0, 8000);
  const auto energy = [](const auto& s) { return 1.5 * s[5] * s[5] + 3.5 * 9.81 * std::sin(s[0]); };
  EXPECT_NEAR(energy(y), energy(Flat::start()), 1e-9);
  EXPECT_NEAR(energy(fine), energy(Flat::start()), 1e-9);
  EXPECT_NEAR(y[0], fine[0], 1e-9);
}

TEST(Pendulum, ReachesTheComputedState) {
  const auto y = extrapolated(Pendulum{}, 10.0, 8000);
  EXPECT_NEAR(y[0], -0.275087462576116860054391, 1e-11);
  EXPECT_NEAR(y[1], -0.961419205099125064265135, 1e-11);
  Pendulum::State off{0.6, 0.9, 1.0, 2.0};
  Pendulum::project(off);
  EXPECT_NEAR(off[0] * off[0] + off[1] * off[1], 1.0, 1e-15);
  EXPECT_NEAR(off[0] * off[2] + off[1] * off[3], 0.0, 1e-15);
}

TEST(FallingFiveBar, ReachesTheComputedStates) {
  const FallingFiveBar p;
  struct {
    double t;
    std::array<double, 6> q;
  } const want[]{{0.1,
                  {0.06887825556525778529, 0.11717533868109767343, -0.05823106245863909644,
                   2.31153344847598241818, 1.22156822750497371736, 1.89240288417611479595}},
                 {0.2,
                  {0.01883455025601987053, 0.03416531028089134011, -1.44685540035930355357,
                   3.30926937445084740931, 0.81891337813247981822, 2.66350970888592171653}},
                 {0.25,
                  {-0.01349935527164578566, 0.06458494073116901118, -2.22637410112360593504,
                   3.73679171077824686325, 0.18873371917602579560, 2.68678616236967082441}}};
  for (const auto& w : want) {
    const auto got = p.output(extrapolated(p, w.t, 2000));
    for (std::size_t i = 0; i < 6; ++i) EXPECT_NEAR(got.q[i], w.q[i], 1e-12) << w.t << " s, " << i;
  }
}

}  // namespace
}  // namespace esmc::host
