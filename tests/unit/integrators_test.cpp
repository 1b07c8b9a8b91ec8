/// Orders, tables and step-wise behaviour of the integrators, against closed forms.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <vector>

#include "host_sim/integrate/dopri5.hpp"
#include "host_sim/integrate/dopri8.hpp"
#include "host_sim/integrate/fixed_step.hpp"
#include "host_sim/integrate/radau5.hpp"
#include "tests/support/systems.hpp"

namespace esmc::test {
namespace {

using host::Dopri5, host::Dopri8, host::Radau5, host::Rk4, host::SemiImplicitEuler;

/// Slope of the regression line through log2 of the errors, per halving of the step.
double slope_of(const std::vector<double>& errors) {
  const double n = static_cast<double>(errors.size());
  double sx = 0.0, sy = 0.0, sxx = 0.0, sxy = 0.0;
  for (std::size_t i = 0; i < errors.size(); ++i) {
    const double x = static_cast<double>(i), y = -std::log2(errors[i]);
    sx += x, sy += y, sxx += x * x, sxy += x * y;
  }
  return (n * sxy - sx * sy) / (n * sxx - sx * sx);
}

template <class M>
double measured_order(double e, int coarsest, int halvings) {
  Kepler kepler;
  kepler.e = e;
  std::vector<double> errors;
  for (int j = 0, n = coarsest; j <= halvings; ++j, n *= 2) {
    M method(kepler);
    auto y = kepler.start();
    const double h = 5.0 / n;
    for (int i = 0; i < n; ++i) method.step(i * h, h, y);
    errors.push_back(kepler.error(5.0, y));
    EXPECT_EQ(y[4], mark);
  }
  const double order = slope_of(errors);
  std::printf("%s: measured order %.2f, errors %.1e to %.1e\n", M::name, order, errors.front(),
              errors.back());
  return order;
}

TEST(Integrators, OrderOnKeplerIsAsNamed) {
  // Order 8 is at rounding before an eccentric orbit comes to its limit, hence a rounder one.
  EXPECT_NEAR(measured_order<SemiImplicitEuler<Kepler>>(0.2, 1000, 4), SemiImplicitEuler<Kepler>::order, 0.2);
  EXPECT_NEAR(measured_order<Rk4<Kepler>>(0.2, 100, 4), Rk4<Kepler>::order, 0.2);
  EXPECT_NEAR(measured_order<Dopri5<Kepler>>(0.2, 60, 4), Dopri5<Kepler>::order, 0.2);
  EXPECT_NEAR(measured_order<Dopri8<Kepler>>(0.05, 16, 2), Dopri8<Kepler>::order, 0.2);
  EXPECT_NEAR(measured_order<Radau5<Kepler>>(0.2, 40, 3), Radau5<Kepler>::order, 0.2);
}

/// Bushy trees and the first of the others; a wrong digit in any coefficient breaks one of them.
template <class A, class B, class C>
void expect_order(const A& a, const B& b, const C& c, std::size_t stages, int order) {
  for (std::size_t i = 0; i < stages; ++i) {
    double row = 0.0;
    for (std::size_t j = 0; j < i; ++j) row += a[i][j];
    EXPECT_NEAR(row, c[i], 2e-14) << "row " << i;
  }
  for (int k = 0; k < order; ++k) {
    double sum = 0.0;
    for (std::size_t i = 0; i < stages; ++i) sum += b[i] * std::pow(c[i], k);
    EXPECT_NEAR(sum, 1.0 / (k + 1), 1e-14) << "power " << k;
  }
  for (int p = 0; p < order; ++p) {
    for (int q = 1; p + q + 2 <= order; ++q) {  // sum b_i c_i^p a_ij c_j^q = 1 / ((q + 1)(p + q + 2))
      double sum = 0.0;
      for (std::size_t i = 0; i < stages; ++i) {
        for (std::size_t j = 0; j < i; ++j) sum += b[i] * std::pow(c[i], p) * a[i][j] * std::pow(c[j], q);
      }
      EXPECT_NEAR(sum, 1.0 / ((q + 1) * (p + q + 2)), 1e-14) << p << ' ' << q;
    }
  }
}

TEST(Integrators, TablesMeetTheOrderConditions) {
  expect_order(host::dopri5::a, host::dopri5::a[6], host::dopri5::c, 7, 5);
  expect_order(host::dopri8::a, host::dopri8::a[12], host::dopri8::c, host::dopri8::stages, 8);
}

/// Error estimators are differences of two quadratures: 0 on polynomials up to the lower order and not above.
TEST(Integrators, EstimatorsSeeTheOrderTheyShould) {
  const auto moment = [](const auto& e, const auto& c, int k) {
    double sum = 0.0;
    for (std::size_t i = 0; i < e.size(); ++i) sum += e[i] * std::pow(c[i], k);
    return std::abs(sum);
  };
  for (int k = 0; k < 4; ++k) EXPECT_LT(moment(host::dopri5::error, host::dopri5::c, k), 1e-15) << k;
  EXPECT_GT(moment(host::dopri5::error, host::dopri5::c, 4), 1e-4);
  for (int k = 0; k < 5; ++k) EXPECT_LT(moment(host::dopri8::error5, host::dopri8::c, k), 1e-15) << k;
  EXPECT_GT(moment(host::dopri8::error5, host::dopri8::c, 5), 1e-6);
  for (int k = 0; k < 3; ++k) {
    double sum = 0.0;
    for (std::size_t i = 0; i < 3; ++i)
      sum += host::dopri8::third[i] * std::pow(host::dopri8::c[std::array<std::size_t, 3>{0, 8, 11}[i]], k);
    EXPECT_NEAR(sum, 1.0 / (k + 1), 1e-15) << k;
  }
}

/// The collocation conditions C(3), written with the inverse of the matrix: inverse c^k = k c^(k-1).
TEST(Integrators, RadauMatrixIsCollocation) {
  for (int k = 1; k <= 3; ++k) {
    for (std::size_t i = 0; i < 3; ++i) {
      double sum = 0.0;
      for (std::size_t j = 0; j < 3; ++j)
        sum += host::radau5::inverse[i][j] * std::pow(host::radau5::c[j], k);
      EXPECT_NEAR(sum, k * std::pow(host::radau5::c[i], k - 1), 1e-14) << i << ' ' << k;
    }
  }
}

/// Where events look for a dip inside a step: the cubic through both ends and their slopes.
template <class M>
void expect_the_middle_of_a_step() {
  const Kepler kepler;
  M method(kepler);
  auto y = kepler.start();
  for (int i = 0; i < 3; ++i) {
    const double h = 0.02;
    auto middle = y;
    method.step(i * h, h, y);
    const auto bend = method.bend();
    for (std::size_t k = 0; k < 4; ++k) middle[k] = 0.5 * (middle[k] + y[k]) + 0.125 * h * bend[k];
    EXPECT_LT(kepler.error((i + 0.5) * h, middle), 1e-6) << M::name << ' ' << i;
  }
}
TEST(Integrators, BendGivesTheMiddleOfAStep) {
  expect_the_middle_of_a_step<Rk4<Kepler>>();
  expect_the_middle_of_a_step<Dopri5<Kepler>>();
  expect_the_middle_of_a_step<Dopri8<Kepler>>();
}

TEST(Integrators, StepsBackUndoStepsForward) {
  const Kepler kepler;
  Dopri8<Kepler> method(kepler);
  auto y = kepler.start();
  for (int i = 0; i < 100; ++i) method.step(0.02 * i, 0.02, y);
  for (int i = 100; i > 0; --i) method.step(0.02 * i, -0.02, y);
  EXPECT_LT(kepler.error(0.0, y), 1e-12);
}

/// A symplectic method keeps the energy of a pendulum within a band; the same steps explicitly do not.
TEST(Integrators, SemiImplicitEulerDoesNotDrift) {
  const Pendulum pendulum;
  SemiImplicitEuler<Pendulum> method(pendulum);
  Pendulum::State y{2.0, 0.0};
  const auto energy = [&] { return 0.5 * y[1] * y[1] - std::cos(y[0]); };
  const double start = energy();
  double worst_early = 0.0, worst_late = 0.0;
  for (int i = 0; i < 200000; ++i) {
    method.step(0.01 * i, 0.01, y);
    double& worst = i < 2000 ? worst_early : worst_late;
    worst = std::max(worst, std::abs(energy() - start));
  }
  EXPECT_LT(worst_early, 0.02);
  EXPECT_LT(worst_late, 1.01 * worst_early);
}

template <class M>
double worst_drift() {
  const RodPendulum rod;
  M method(rod);
  RodPendulum::State y{std::sin(2.0), -std::cos(2.0), 0.0, 0.0};
  double worst = 0.0;
  for (int i = 0; i < 2000; ++i) {
    method.step(0.01 * i, 0.01, y);
    worst = std::max(worst, RodPendulum::drift(y));
  }
  return worst;
}

TEST(Integrators, ClosureHoldsAfterEveryStep) {
  EXPECT_LE(worst_drift<SemiImplicitEuler<RodPendulum>>(), 1e-15);
  EXPECT_LE(worst_drift<Rk4<RodPendulum>>(), 1e-15);
  EXPECT_LE(worst_drift<Dopri5<RodPendulum>>(), 1e-15);
  EXPECT_LE(worst_drift<Dopri8<RodPendulum>>(), 1e-15);
  EXPECT_LE(worst_drift<Radau5<RodPendulum>>(), 1e-15);
}

}  // namespace
}  // namespace esmc::test
