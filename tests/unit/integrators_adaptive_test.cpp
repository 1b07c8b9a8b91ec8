/// Step control, closure and failures of the adaptive integrators, against closed forms.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "host_sim/integrate/dopri5.hpp"
#include "host_sim/integrate/dopri8.hpp"
#include "host_sim/integrate/radau5.hpp"
#include "tests/support/systems.hpp"

namespace esmc::test {
namespace {

using host::Advance, host::Dopri5, host::Dopri8, host::Radau5, host::Tolerance;

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

struct Dopri5Of {
  template <class S>
  using Method = Dopri5<S>;
};
struct Dopri8Of {
  template <class S>
  using Method = Dopri8<S>;
};
struct Radau5Of {
  template <class S>
  using Method = Radau5<S>;
};

template <class Which>
class Adaptive : public ::testing::Test {
 public:
  template <class S>
  using Method = typename Which::template Method<S>;
};
using Methods = ::testing::Types<Dopri5Of, Dopri8Of, Radau5Of>;
TYPED_TEST_SUITE(Adaptive, Methods);

/// The tolerance is one of each step. Phase errors of an orbit grow with the square of time, hence the
/// factor; a tolerance that is a hundred times smaller must buy an error at least ten times smaller.
TYPED_TEST(Adaptive, ErrorFollowsTheTolerance) {
  const Kepler kepler;
  double before = std::numeric_limits<double>::infinity();
  for (const double tol : {1e-5, 1e-7, 1e-9}) {
    typename TestFixture::template Method<Kepler> method(kepler);
    auto y = kepler.start();
    const Advance a = method.advance(0.0, 20.0, y, {tol, tol});
    ASSERT_TRUE(a.ok);
    const double error = kepler.error(20.0, y);
    EXPECT_LT(error, 2000.0 * tol);
    EXPECT_LT(error, 0.1 * before);
    EXPECT_EQ(y[4], mark);
    EXPECT_EQ(y[5], mark);
    before = error;
  }
}

/// Ticks of 1 ms must not hold the step at 1 ms of bookkeeping: what was learned stays.
TYPED_TEST(Adaptive, RemembersItsStepAcrossCalls) {
  const Pendulum pendulum;
  typename TestFixture::template Method<Pendulum> method(pendulum);
  Pendulum::State y{1.0, 0.0};
  ASSERT_TRUE(method.advance(0.0, 5.0, y, {1e-8, 1e-8}).ok);
  for (int i = 0; i < 100; ++i) {
    const Advance a = method.advance(5.0 + 1e-3 * i, 5.0 + 1e-3 * (i + 1), y, {1e-8, 1e-8});
    ASSERT_TRUE(a.ok);
    EXPECT_EQ(a.steps, 1);
  }
}

TYPED_TEST(Adaptive, ClosureHolds) {
  const RodPendulum rod;
  typename TestFixture::template Method<RodPendulum> method(rod);
  const double amplitude = 2.0, period = Pendulum::period(amplitude);
  RodPendulum::State y{std::sin(amplitude), -std::cos(amplitude), 0.0, 0.0};
  const auto start = y;
  for (int i = 0; i < 100; ++i) {
    ASSERT_TRUE(method.advance(period * i / 100, period * (i + 1) / 100, y, {1e-10, 1e-10}).ok);
    EXPECT_LE(RodPendulum::drift(y), 1e-15);
  }
  for (std::size_t i = 0; i < 4; ++i) EXPECT_NEAR(y[i], start[i], 2e-8) << i;
}

/// y' = y + 1/2, halved by every "projection": a slope kept from before it would be far off.
struct Halved : Free<1, 0> {
  void slope(double, const State& y, State& dy) const { dy[0] = 0.5 + y[0]; }
  void project(State& y) const { y[0] *= 0.5; }
};

TYPED_TEST(Adaptive, SlopeIsTakenAfterTheProjection) {
  const Halved halved;
  typename TestFixture::template Method<Halved> method(halved);
  Halved::State y{1.0};
  double expected = 1.0;
  const auto follow = [&](double, double h, const Halved::State&) {
    expected = 0.5 * ((expected + 0.5) * std::exp(h) - 0.5);
    return false;
  };
  ASSERT_TRUE(method.advance(0.0, 1.0, y, {1e-8, 1e-8}, follow).ok);
  EXPECT_NEAR(y[0], expected, 1e-6);
}

TYPED_TEST(Adaptive, LastStepsAreEqualRatherThanOneTiny) {
  const Kepler kepler;
  for (double end = 1.0; end < 2.0; end += 0.03) {
    typename TestFixture::template Method<Kepler> method(kepler);
    auto y = kepler.start();
    double last = 0.0, before = 0.0;
    const auto follow = [&](double, double h, const Kepler::State&) {
      before = std::exchange(last, h);
      return false;
    };
    ASSERT_TRUE(method.advance(0.0, end, y, {1e-6, 1e-6}, follow).ok);
    EXPECT_GT(last, 0.2 * before);
  }
}

TYPED_TEST(Adaptive, ShortestIntervalOfALongRunIsOneStep) {
  const Pendulum pendulum;
  typename TestFixture::template Method<Pendulum> method(pendulum);
  Pendulum::State y{1.0, 0.0};
  const double t0 = 86400.0, t1 = std::nextafter(t0, 1e9);
  EXPECT_TRUE(method.advance(t0, t1, y, {1e-9, 1e-9}).ok);
}

struct Wall : Free<1, 0> {  // not defined from y = 1 on
  void slope(double, const State& y, State& dy) const { dy[0] = y[0] < 1.0 ? 1.0 : nan; }
};

struct Pole : Free<1, 0> {  // y = 1 / (1 - t)
  void slope(double, const State& s, State& dy) const { dy[0] = s[0] * s[0]; }
};

TYPED_TEST(Adaptive, FailuresHaveAnEnd) {
  const Wall wall;
  typename TestFixture::template Method<Wall> at_wall(wall);
  Wall::State y{0.0};
  EXPECT_FALSE(at_wall.advance(0.0, 2.0, y, {1e-9, 1e-9}).ok);
  EXPECT_LE(y[0], 1.0);
  EXPECT_GT(y[0], 0.99);
  y[0] = 1.5;
  EXPECT_FALSE(at_wall.advance(0.0, 2.0, y, {}).ok);
  EXPECT_EQ(y[0], 1.5);

  const Pole pole;
  typename TestFixture::template Method<Pole> at_pole(pole);
  Pole::State p{1.0};
  EXPECT_FALSE(at_pole.advance(0.0, 2.0, p, {1e-9, 1e-9}).ok);

  const Pendulum pendulum;
  typename TestFixture::template Method<Pendulum> method(pendulum);
  Pendulum::State q{1.0, 0.0};
  const Advance bounded = method.advance(0.0, 1000.0, q, {1e-10, 1e-10, 5});
  EXPECT_FALSE(bounded.ok);
  EXPECT_LE(bounded.steps, 5);
  q = {1.0, 0.5};
  EXPECT_FALSE(method.advance(0.0, 10.0, q, {1e-300, 0.0, 2000}).ok);
}

/// Steps go with tolerance^(-1/8), so 1e8 in tolerance is a factor of 10; by an estimate of order 5 it would
/// be 21.
TEST(AdaptiveOrbit, Dopri8EstimatesWithItsFullOrder) {
  const Kepler kepler;
  const auto steps = [&](double tol) {
    Dopri8<Kepler> method(kepler);
    auto y = kepler.start();
    return static_cast<double>(method.advance(0.0, 20.0, y, {tol, tol}).steps);
  };
  EXPECT_LT(steps(1e-13) / steps(1e-5), 12.0);
}

/// HNW (II.0.1), (II.0.2): the orbit closes after the period they give.
template <class M, class S>
double arenstorf_gap(const S& system, double tol) {
  M method(system);
  typename S::State y{0.994, 0.0, 0.0, -2.00158510637908252240537862224};
  const auto start = y;
  EXPECT_TRUE(method.advance(0.0, 17.0652165601579625588917206249, y, {tol, tol}).ok);
  double gap = 0.0;
  for (std::size_t i = 0; i < 4; ++i) gap = std::max(gap, std::abs(y[i] - start[i]));
  return gap;
}

TEST(AdaptiveOrbit, ArenstorfCloses) {
  struct Arenstorf : Free<4, 2> {
    void slope(double, const State& y, State& dy) const {
      const double mu = 0.012277471, nu = 1.0 - mu;
      const double d1 = std::pow(std::hypot(y[0] + mu, y[1]), 3),
                   d2 = std::pow(std::hypot(y[0] - nu, y[1]), 3);
      dy[0] = y[2];
      dy[1] = y[3];
      dy[2] = y[0] + 2.0 * y[3] - nu * (y[0] + mu) / d1 - mu * (y[0] - nu) / d2;
      dy[3] = y[1] - 2.0 * y[2] - nu * y[1] / d1 - mu * y[1] / d2;
    }
  };
  const Arenstorf orbit;
  EXPECT_LT(arenstorf_gap<Dopri5<Arenstorf>>(orbit, 1e-10), 1e-5);
  EXPECT_LT(arenstorf_gap<Dopri5<Arenstorf>>(orbit, 1e-13), 1e-8);
  EXPECT_LT(arenstorf_gap<Dopri8<Arenstorf>>(orbit, 1e-10), 1e-5);
  EXPECT_LT(arenstorf_gap<Dopri8<Arenstorf>>(orbit, 1e-13), 1e-8);
}

}  // namespace
}  // namespace esmc::test
