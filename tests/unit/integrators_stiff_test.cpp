/// Stiff problems with published solutions.

#include <gtest/gtest.h>

#include <cmath>

#include "host_sim/integrate/radau5.hpp"
#include "tests/support/systems.hpp"

namespace esmc::test {
namespace {

using host::Advance, host::Radau5;

/// Test Set for IVP Solvers (Mazzia, Magherini), problem vdpol: its reference solution at t = 2.
TEST(Radau5, VanDerPolAsPublished) {
  const VanDerPol system;
  for (const double tol : {1e-4, 1e-6, 1e-8, 1e-10}) {
    Radau5<VanDerPol> method(system);
    VanDerPol::State y{2.0, 0.0, mark, mark};
    const Advance a = method.advance(0.0, 2.0, y, {tol, tol});
    ASSERT_TRUE(a.ok);
    EXPECT_NEAR(y[0], 0.1706167732170483e1, 0.1 * tol);
    EXPECT_NEAR(y[1], -0.8928097010247975, 0.1 * tol);
    EXPECT_EQ(y[2], mark);
    // An explicit method could not take steps longer than 3.3 epsilon: 600 000 of them.
    EXPECT_LT(a.steps, 20000);
  }
}

/// The method is stiffly accurate: with lambda -> -infinity the error at fixed h falls like 1 / lambda, where
/// methods that are only A-stable keep an error of h^(order of a stage).
TEST(Radau5, ProtheroRobinsonErrorFallsWithStiffness) {
  double before = 0.0;
  for (const double lambda : {-1e4, -1e6, -1e8}) {
    ProtheroRobinson system;
    system.lambda = lambda;
    Radau5<ProtheroRobinson> method(system);
    ProtheroRobinson::State y{1.0};
    for (int i = 0; i < 10; ++i) method.step(0.4 * i, 0.4, y);
    const double error = std::abs(y[0] - std::cos(4.0));
    EXPECT_LT(error, -1e-3 / lambda);
    if (before > 0.0) {
      EXPECT_NEAR(before / error, 100.0, 5.0);
    }
    before = error;
  }
}

/// R(infinity) = 0. A step much longer than the time constant leaves R(z) ~ 3 / z of a deviation; the
/// implicit midpoint rule and Gauss methods would leave all of it, with the other sign.
TEST(Radau5, StiffDeviationIsGoneInOneStep) {
  for (const double z : {-1e2, -1e4, -1e8}) {
    struct Linear : Free<1, 0> {
      double lambda = -1.0;
      void slope(double, const State& y, State& dy) const { dy[0] = lambda * y[0]; }
    };
    Linear system;
    system.lambda = z;
    Radau5<Linear> method(system);
    Linear::State y{1.0};
    method.step(0.0, 1.0, y);
    // Stability function: the Pade approximation (2, 3) of exp, HW theorem IV.3.11.
    const double r = (1.0 + 0.4 * z + z * z / 20.0) / (1.0 - 0.6 * z + 3.0 * z * z / 20.0 - z * z * z / 60.0);
    EXPECT_NEAR(y[0], r, 1e-6 * std::abs(r) + 1e-15);
    EXPECT_LT(std::abs(y[0]), 4.0 / std::abs(z));
  }
}

/// A disturbance that decays at once is no reason for short steps: HW (IV.8.20) against (IV.8.19).
TEST(Radau5, StiffDisturbanceDoesNotShortenTheStep) {
  const ProtheroRobinson system;
  Radau5<ProtheroRobinson> method(system);
  ProtheroRobinson::State y{1.0};
  ASSERT_TRUE(method.advance(0.0, 2.0, y, {1e-6, 1e-6}).ok);
  y[0] += 1e-3;
  const Advance a = method.advance(2.0, 4.0, y, {1e-6, 1e-6});
  EXPECT_LT(a.steps, 20);
  EXPECT_NEAR(y[0], std::cos(4.0), 1e-6);
}

/// A fixed step whose equations have no solution must not look like a result.
TEST(Radau5, UnsolvableFixedStepGivesNan) {
  struct Pole : Free<1, 0> {
    void slope(double, const State& y, State& dy) const { dy[0] = y[0] * y[0]; }
  };
  const Pole system;
  Radau5<Pole> method(system);
  Pole::State y{1.0, mark, mark};
  method.step(0.0, 50.0, y);
  EXPECT_TRUE(std::isnan(y[0]));
  EXPECT_EQ(y[1], mark);
}

}  // namespace
}  // namespace esmc::test
