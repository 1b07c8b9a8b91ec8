// Four encoders on the closure manifold: against the nearest closed configuration, found over the effector's
// position by the inverse kinematics of tests/support/lagrange.hpp, of which the code under test has nothing.

#include <gtest/gtest.h>

#include <array>

#include "firmware/cycle/instances.hpp"
#include "firmware/cycle/linked.hpp"
#include "tests/support/random_mechanism.hpp"

namespace esmc::test {
namespace {

constexpr std::uint64_t kCases = 300;

template <class S>
class Fusion : public testing::Test {};
TYPED_TEST_SUITE(Fusion, Scalars, ScalarName);

template <class S>
ControllerConfig<FiveBar<S>> config_of(const FiveBarCase<S>& c, const Vec<S, 4>& sigma) {
  ControllerConfig<FiveBar<S>> config;
  config.mechanism = c.mechanism();
  config.mode = c.mode;
  config.encoder_variance = sigma.cwiseAbs2();
  config.limits.closure = S(1e-3);
  return config;
}

Vec<Real, 4> joints_at(const FiveBarModel& oracle, FiveBarModel::Q q, Real x, Real y) {
  q[0] = x;
  q[1] = y;
  const auto channels = oracle.channels(oracle.close(q, FiveBarModel::by_effector));
  return {channels[2], channels[3], channels[10], channels[11]};
}

/// Joint angles and, per m of x and of y, their derivatives, by central differences.
struct Tangent {
  Vec<Real, 4> theta;
  Mat<Real, 4, 2> by_effector;
};
Tangent tangent_at(const FiveBarModel& oracle, const FiveBarModel::Q& q, const Vec2<Real>& x) {
  constexpr Real h = 1e-7L;
  Tangent t;
  t.theta = joints_at(oracle, q, x[0], x[1]);
  for (int k = 0; k < 2; ++k) {
    Vec2<Real> up = x, down = x;
    up[k] += h;
    down[k] -= h;
    t.by_effector.col(k) =
        (joints_at(oracle, q, up[0], up[1]) - joints_at(oracle, q, down[0], down[1])) / (2 * h);
  }
  return t;
}

Vec2<Real> normal_solve(const Mat<Real, 4, 2>& T, const Vec<Real, 4>& w, const Vec<Real, 4>& e) {
  const Mat<Real, 2, 2> N = T.transpose() * w.asDiagonal() * T;
  const Vec2<Real> b = T.transpose() * w.asDiagonal() * e;
  const Real det = N(0, 0) * N(1, 1) - N(0, 1) * N(1, 0);
  return {(N(1, 1) * b[0] - N(0, 1) * b[1]) / det, (N(0, 0) * b[1] - N(1, 0) * b[0]) / det};
}

/// Where the effector is in the closed configuration nearest to the readings.
Vec2<Real> nearest(const FiveBarModel& oracle, const FiveBarModel::Q& q, const Vec<Real, 4>& measured,
                   const Vec<Real, 4>& weight) {
  Vec2<Real> x(q[0], q[1]);
  for (int i = 0; i < 30; ++i) {
    const Tangent t = tangent_at(oracle, q, x);
    Vec<Real, 4> e;
    for (int k = 0; k < 4; ++k) e[k] = detail::wrap(measured[k] - t.theta[k]);
    const Vec2<Real> step = normal_solve(t.by_effector, weight, e);
    x += step;
    if (std::fabs(step[0]) + std::fabs(step[1]) < 1e-16L) break;
  }
  return x;
}

TYPED_TEST(Fusion, IsTheNearestClosedConfigurationByTheEncodersOwnMeasure) {
  using S = TypeParam;
  const Real noise = std::is_same_v<S, float> ? 2e-3L : 3e-4L;
  Accuracy place("effector"), speed("joint rates"), gap("gap"), tip("effector's velocity");
  for (std::uint64_t seed = 0; seed < kCases; ++seed) {
    Random r(~seed);
    const auto c = random_five_bar<S>(seed, {.min_sin1 = 0.3, .min_sin2 = 0.0});
    Vec<S, 4> sigma;
    for (int i = 0; i < 4; ++i) sigma[i] = r.in<S>(0.3, 3.0);
    Vec<S, 4> angle = c.theta, rate = c.theta_rate;
    for (int i = 0; i < 4; ++i) {
      angle[i] += S(noise) * sigma[i] * r.in<S>(-1, 1);
      rate[i] += S(0.1) * r.in<S>(-1, 1);
    }
    Estimate<FiveBar<S>> e;
    (void)part::closure_projection(config_of(c, sigma), angle, rate, e);
    const Vec<Real, 4> weight = sigma.template cast<Real>().cwiseAbs2().cwiseInverse();
    const Vec2<Real> want = nearest(c.oracle, c.q, angle.template cast<Real>(), weight);
    place.compare(seed, e.pose.effector, want, 0.1L);
    gap.take(seed, Real(std::hypot(static_cast<double>(c.mechanism().closure_residual(e.pose).x()),
                                   static_cast<double>(c.mechanism().closure_residual(e.pose).y()))));
    // Rates: the nearest ones on the tangent there.
    const Tangent t = tangent_at(c.oracle, c.q, want);
    const Vec2<Real> velocity = normal_solve(t.by_effector, weight, rate.template cast<Real>());
    const Vec<Real, 4> turning = t.by_effector * velocity;
    Vec<S, 4> got;
    got << e.rates.leg[0], e.rates.leg[1];
    speed.compare(seed, got, turning, 1.0L);
    tip.compare(seed, e.rates.platform, velocity, 1.0L);
  }
  // Two steps leave the cube of the noise; the distance to singularities is down to 0.3 (type 1), so that it
  // is amplified.
  place.expect_below(std::is_same_v<S, float> ? 2e-4 : 1e-7);
  gap.expect_below(std::is_same_v<S, float> ? 1e-6 : 1e-10);
  speed.expect_below(std::is_same_v<S, float> ? 1e-3 : 1e-6);
  tip.expect_below(std::is_same_v<S, float> ? 1e-3 : 1e-6);
}

TYPED_TEST(Fusion, LeavesReadingsThatCloseAsTheyAre) {
  using S = TypeParam;
  Accuracy place("effector"), rates("channels"), singular("rates at type 2");
  for (std::uint64_t seed = 0; seed < kCases; ++seed) {
    const auto c = random_five_bar<S>(seed);
    Estimate<FiveBar<S>> e;
    EXPECT_EQ(
        part::closure_projection(config_of(c, Vec<S, 4>(S(1), S(2), S(0.5), S(1))), c.theta, c.theta_rate, e),
        0);
    place.compare(seed, e.pose.effector, c.position, 0.1L);
    rates.compare(seed, c.mechanism().channel_rates(e.pose, e.rates), c.rates());
    const auto at = random_five_bar<S>(seed, {.sin2 = 1e-6});  // base encoders alone say nothing there
    (void)part::closure_projection(config_of(at, Vec<S, 4>::Ones().eval()), at.theta, at.theta_rate, e);
    singular.compare(seed, at.mechanism().channel_rates(e.pose, e.rates), at.rates());
  }
  place.expect_below(100 * kEpsilon<S>);
  rates.expect_below(200 * kEpsilon<S>);
  singular.expect_below(1000 * kEpsilon<S>);
}

/// How small the gap gets by turning joint i alone, by search over the tips of plain trigonometry.
template <class S>
Real best_without(const FiveBarCase<S>& c, Vec<Real, 4> angle, int i) {
  const auto& bar = c.oracle.bar;
  const auto gap = [&](Real turn) {
    Vec<Real, 4> a = angle;
    a[i] += turn;
    const Real x = 2 * c.oracle.half_base + bar[0].length * std::cos(a[0]) +
                   bar[1].length * std::cos(a[0] + a[1]) + bar[2].length * std::cos(a[2]) +
                   bar[3].length * std::cos(a[2] + a[3]);
    const Real y = bar[0].length * std::sin(a[0]) + bar[1].length * std::sin(a[0] + a[1]) -
                   bar[2].length * std::sin(a[2]) - bar[3].length * std::sin(a[2] + a[3]);
    return std::hypot(x, y);
  };
  // One least over a full turn: the square of the gap is a constant and a sine of the turn.
  constexpr Real step = detail::kPi / 4;
  Real near = 0, least = gap(0);
  for (int k = 1; k < 8; ++k) {
    const Real there = gap(step * k);
    if (there < least) near = step * k;
    least = std::fmin(least, there);
  }
  Real lower = near - step, upper = near + step;
  for (int k = 0; k < 40; ++k) {
    const Real a = lower + (upper - lower) * 0.382L, b = lower + (upper - lower) * 0.618L;
    const bool left = gap(a) < gap(b);
    (left ? upper : lower) = left ? b : a;
  }
  return gap((lower + upper) / 2);
}

constexpr Real kAllowed = 1e-3L;  // limits.closure of config_of

/// Slipped couplings and lost teeth are far from small. The right encoder is named, or none, and none only
/// where another joint closes the loop to half the limit as well: one case in eight at 0.02 rad, one in a
/// hundred from 0.3 rad on.
TYPED_TEST(Fusion, NamesTheEncoderThatAloneIsOffAndNoOtherHoweverFar) {
  using S = TypeParam;
  constexpr std::array<Real, 7> size{0.02L, 0.05L, 0.1L, 0.2L, 0.3L, 0.5L, 1.0L},
      open_at_most{0.15L, 0.06L, 0.03L, 0.02L, 0.02L, 0.02L, 0.02L};
  std::array<int, 7> open{}, cases{};
  for (std::uint64_t seed = 0; seed < 1000; ++seed) {
    Random r(~seed);
    const auto c = random_five_bar<S>(seed);
    const auto config = config_of(c, Vec<S, 4>::Ones().eval());
    const int odd = static_cast<int>(seed / 8 % 4);
    for (std::size_t k = 0; k < size.size(); ++k) {
      Vec<S, 4> angle = c.theta;
      angle[odd] += S(r.sign()) * static_cast<S>(size[k]);
      for (int i = 0; i < 4; ++i) angle[i] += r.in<S>(-2e-5, 2e-5);
      Estimate<FiveBar<S>> e;
      const int got = part::closure_projection(config, angle, c.theta_rate, e);
      const auto what = [&] {
        return "seed " + std::to_string(seed) + ", " + std::to_string(static_cast<double>(size[k])) + " rad";
      };
      if (!(e.closure > static_cast<S>(kAllowed))) {
        EXPECT_EQ(got, 0) << what() << ": nothing is wrong enough";
        continue;
      }
      ++cases[k];
      open[k] += got == 0 ? 1 : 0;
      EXPECT_TRUE(got == 0 || got == odd + 1) << what() << ": " << got - 1 << " instead of " << odd;
      Real other = 1;
      for (int i = 0; i < 4; ++i)
        other = i == odd ? other : std::fmin(other, best_without(c, angle.template cast<Real>(), i));
      if (other > 0.51L * kAllowed) {
        EXPECT_EQ(got, odd + 1) << what() << ": no other encoder comes near";
      }
      if (other < 0.49L * kAllowed) {
        EXPECT_EQ(got, 0) << what() << ": another closes it as well";
      }
    }
  }
  for (std::size_t k = 0; k < size.size(); ++k) {
    EXPECT_GT(cases[k], 990);
    EXPECT_LE(open[k], open_at_most[k] * cases[k]) << size[k] << " rad: left open, of " << cases[k];
  }
}

TYPED_TEST(Fusion, TwoFaultyEncodersNameNone) {
  using S = TypeParam;
  int blamed = 0;
  for (std::uint64_t seed = 0; seed < 1000; ++seed) {
    Random r(~seed);
    const auto c = random_five_bar<S>(seed);
    Vec<S, 4> angle = c.theta;
    const int first = static_cast<int>(seed % 4), second = (first + 1 + static_cast<int>(seed / 4 % 3)) % 4;
    angle[first] += S(0.03);
    angle[second] += S(0.03);
    Estimate<FiveBar<S>> e;
    const int got = part::closure_projection(config_of(c, Vec<S, 4>::Ones().eval()), angle, c.theta_rate, e);
    if (got == 0) continue;
    // The named encoder must at least explain it alone.
    EXPECT_LT(best_without(c, angle.template cast<Real>(), got - 1), 0.26L * kAllowed) << "seed " << seed;
    ++blamed;
  }
  EXPECT_LT(blamed, 150);
}

TYPED_TEST(Fusion, WithoutANumberThereIsNoState) {
  using S = TypeParam;
  const auto c = random_five_bar<S>(1);
  for (int i = 0; i < 4; ++i) {
    Vec<S, 4> angle = c.theta;
    angle[i] = std::numeric_limits<S>::quiet_NaN();
    Estimate<FiveBar<S>> e;
    EXPECT_EQ(part::closure_projection(config_of(c, Vec<S, 4>::Ones().eval()), angle, c.theta_rate, e), 0);
    EXPECT_FALSE(e.closure <= S(1));
  }
}

/// In the controller: the same fault as without, and whose.
TYPED_TEST(Fusion, TheFaultTellsWhichEncoder) {
  using S = TypeParam;
  for (int odd = 0; odd < 4; ++odd) {
    const auto c = random_five_bar<S>(24, {.min_sin1 = 0.6, .min_sin2 = 0.6});
    auto config = config_of(c, Vec<S, 4>::Ones().eval());
    config.sensors = Sensors::all;
    config.sample_time = S(1e-3);
    config.limits.joint_speed = S(100);
    config.limits.closure = S(2e-3);
    config.limits.max_age_ticks = 2;
    config.fuse = &part::closure_projection<FiveBar<S>>;
    Controller<FiveBar<S>> controller(config);
    Supervisor supervisor(controller.supervision());
    Sample<FiveBar<S>> sample;
    sample.angle = c.theta;
    (void)supervisor.begin_tick(Command::enable, {});
    (void)controller.tick(sample, supervisor);
    EXPECT_EQ(supervisor.fault(), Fault::none);
    EXPECT_EQ(controller.odd_encoder(), 0);
    sample.angle[odd] += S(0.03);
    const auto result = controller.tick(sample, supervisor);
    EXPECT_EQ(result.fault, Fault::loop_not_closed);
    EXPECT_EQ(controller.odd_encoder(), odd + 1);
    // Motors, at joints 0 and 2, are told first; then the passive encoders.
    constexpr std::array<int, 4> told{0, 2, 1, 3};
    EXPECT_EQ(report_of(controller, result, sample).encoder, told.at(static_cast<unsigned>(odd)));
    sample.angle[odd] -= S(0.03);
    (void)controller.tick(sample, supervisor);
    EXPECT_EQ(controller.odd_encoder(), odd + 1) << "it stays known";
  }
}

}  // namespace
}  // namespace esmc::test
