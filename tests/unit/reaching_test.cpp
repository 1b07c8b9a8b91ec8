// The reaching functions: shape, edges, and what the implicit one promises on sdot = -K sw(s) [F38], [F39].

#include "firmware/control/reaching.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "tests/support/random_mechanism.hpp"

namespace esmc::test {
namespace {

constexpr std::array kAll{Reaching::sign, Reaching::saturation, Reaching::tanh, Reaching::implicit};
template <class S>
class ReachingLaw : public testing::Test {};
TYPED_TEST_SUITE(ReachingLaw, Scalars, ScalarName);

/// sw of every channel is that of the channel alone.
TYPED_TEST(ReachingLaw, OfAllChannelsIsThatOfEach) {
  using S = TypeParam;
  const Vec<S, 3> s(S(1), S(-0.25), S(0)), layer(S(1), S(2), S(0.5));
  for (const Reaching law : kAll) {
    const Vec<S, 3> sw = switching(law, s, layer);
    for (int i = 0; i < 3; ++i) EXPECT_EQ(sw[i], switching(law, s[i], layer[i]));
  }
}

TYPED_TEST(ReachingLaw, IsOddBoundedMonotoneAndZeroAtZero) {
  using S = TypeParam;
  using Limits = std::numeric_limits<S>;
  for (const Reaching law : kAll) {
    for (const S layer : {Limits::min(), S(1e-3), S(1), S(1e6), Limits::max()}) {
      EXPECT_EQ(switching(law, S(0), layer), S(0));
      EXPECT_EQ(switching(law, -S(0), layer), S(0));
      S last = S(-1);
      Random r(static_cast<std::uint64_t>(layer > S(1)));
      std::vector<S> points{Limits::denorm_min(), Limits::min(), layer, Limits::max(), Limits::infinity()};
      points.push_back(std::nextafter(layer, S(0)));
      points.push_back(std::nextafter(layer, Limits::infinity()));
      for (int i = 0; i < 1000; ++i) points.push_back(static_cast<S>(std::pow(10.0L, r.between(-12, 12))));
      std::sort(points.begin(), points.end());
      for (const S s : points) {
        const S up = switching(law, s, layer), down = switching(law, S(-s), layer);
        EXPECT_EQ(down, -up) << s << ' ' << layer;
        EXPECT_TRUE(up >= S(0) && up <= S(1)) << s << ' ' << layer;
        // tanh is exact to two units in the last place and may fall by as much where it is flat.
        EXPECT_GE(up, last - S(4) * Limits::epsilon()) << s << ' ' << layer;
        last = up;
      }
    }
  }
}

TYPED_TEST(ReachingLaw, HasTheValuesOfItsDefinition) {
  using S = TypeParam;
  for (std::uint64_t seed = 0; seed < 20000; ++seed) {
    Random r(seed);
    const S layer = static_cast<S>(std::pow(10.0L, r.between(-4, 2))),
            s = static_cast<S>(Real(layer) * r.between(-3, 3));
    EXPECT_EQ(switching(Reaching::sign, s, layer), S(s > 0) - S(s < 0));
    const Real z = Real(s) / Real(layer);
    for (const Reaching law : {Reaching::saturation, Reaching::implicit}) {
      const Real want = std::fmin(std::fmax(z, Real(-1)), Real(1));
      EXPECT_LE(std::fabs(Real(switching(law, s, layer)) - want), kEpsilon<S>) << "seed " << seed;
    }
    EXPECT_LE(std::fabs(Real(switching(Reaching::tanh, s, layer)) - std::tanh(z)), 4 * kEpsilon<S>)
        << "seed " << seed;
  }
  // Exactly one at the edge of the layer, exactly linear inside.
  EXPECT_EQ(switching(Reaching::saturation, S(0.5), S(0.5)), S(1));
  EXPECT_EQ(switching(Reaching::saturation, S(0.25), S(0.5)), S(0.5));
}

TYPED_TEST(ReachingLaw, NanStaysNan) {
  using S = TypeParam;
  constexpr S nan = std::numeric_limits<S>::quiet_NaN();
  for (const Reaching law : kAll) EXPECT_TRUE(std::isnan(switching(law, nan, S(1)))) << int(law);
  for (const Reaching law : {Reaching::saturation, Reaching::tanh, Reaching::implicit}) {
    EXPECT_TRUE(std::isnan(switching(law, S(1), nan))) << int(law);
  }
  EXPECT_EQ(switching(Reaching::sign, S(1), nan), S(1));  // has no layer
}

TYPED_TEST(ReachingLaw, ImplicitLayerIsTheOneOfF39) {
  using S = TypeParam;
  EXPECT_EQ(implicit_layer(S(8), S(0.25), S(0)), S(2));
  EXPECT_EQ(implicit_layer(S(8), S(0.25), S(2)), S(6));
}

/// All channels at once: to + K sw(s), each with its own gain and layer; on the surface, nothing is added to
/// the bit.
TYPED_TEST(ReachingLaw, IsAddedChannelByChannel) {
  using S = TypeParam;
  const Vec<S, 5> s(S(-3), S(-0.25), S(0), S(0.5), S(2)), k(S(7), S(5), S(3), S(2), S(11)),
      layer(S(0.5), S(0.75), S(0.25), S(4), S(1)), before(S(1), S(-2), S(0.1), S(-4), S(8));
  for (const Reaching law : kAll) {
    Vec<S, 5> to = before;
    to += k.cwiseProduct(switching(law, s, layer));
    for (int i = 0; i < 5; ++i) {
      const Real z = Real(s[i]) / Real(layer[i]);
      const Real sw = law == Reaching::sign   ? Real(z > 0) - Real(z < 0)
                      : law == Reaching::tanh ? std::tanh(z)
                                              : std::fmin(std::fmax(z, Real(-1)), Real(1));
      const Real want = Real(before[i]) + Real(k[i]) * sw;
      EXPECT_LE(std::fabs(Real(to[i]) - want), 20 * kEpsilon<S>) << int(law) << ' ' << i;
    }
    EXPECT_EQ(to[2], before[2]) << int(law);
  }
}

/// A channel may have K = 0 (Gains: k >= 0). At s = 0, where a mechanism at rest on its reference starts, K
/// sw(s) must be 0 and not 0 * NaN: its implicit layer is not 0.
TYPED_TEST(ReachingLaw, AChannelWithoutGainAsksForNothing) {
  using S = TypeParam;
  for (const S k : {S(0), std::numeric_limits<S>::denorm_min()}) {  // the layer of the second would be 0, too
    const S layer = implicit_layer(k, S(0.001), S(0));
    EXPECT_GT(layer, S(0));
    for (const S s : {S(0), S(1), S(-1)})
      EXPECT_LE(std::fabs(k * switching(Reaching::implicit, s, layer)), k) << s;
    for (const S s : {S(0), S(-0.0)})
      EXPECT_EQ(switching(Reaching::implicit, s, layer), S(0)) << "on the surface";
  }
}

/// Backward Euler on sdot = -K sw(s): s falls by K h a step and lands on zero, to the last bit of it, at step
/// N = ceil(|s0| / (K h)), never on the other side.
TYPED_TEST(ReachingLaw, ImplicitReachesInTheStepsItPromisesAndStays) {
  using S = TypeParam;
  for (std::uint64_t seed = 0; seed < 2000; ++seed) {
    Random r(seed);
    const S K = r.in<S>(1, 200), h = r.in<S>(1e-4, 1e-2),
            s0 = static_cast<S>(Real(K) * Real(h) * r.between(-60, 60));
    const Real ratio = std::fabs(Real(s0)) / (Real(K) * Real(h));
    const int steps = static_cast<int>(std::ceil(ratio));
    const S layer = implicit_layer(K, h, S(0));
    // Sixty subtractions of rounded K h: skip what is that close to a whole number of steps.
    if (std::fabs(ratio - std::round(ratio)) < 200 * kEpsilon<S>) continue;
    const Real tiny = 4 * kEpsilon<S> * Real(K) * Real(h);
    S s = s0;
    for (int n = 0; n < steps; ++n) {
      EXPECT_GT(std::fabs(Real(s)), tiny) << "seed " << seed << ": too early, step " << n;
      s -= K * h * switching(Reaching::implicit, s, layer);
      EXPECT_GE(Real(s) * Real(s0) >= 0 ? Real(0) : tiny - std::fabs(Real(s)), Real(0))
          << "seed " << seed << ": overshoot";
    }
    EXPECT_LE(std::fabs(Real(s)), tiny) << "seed " << seed << ": not reached in " << steps;
    for (int n = 0; n < 10; ++n) s -= K * h * switching(Reaching::implicit, s, layer);
    EXPECT_LE(std::fabs(Real(s)), tiny) << "seed " << seed << ": left again";
  }
}

/// Told its delay of d ticks, the linear zone does not ring: s[n+1] = s[n] - K h sw(s[n-d]) shrinks for d =
/// 1, 2, 3, and untold it does not (the poles of z^(d+1) - z^d + 1 lie on or outside the unit circle).
TYPED_TEST(ReachingLaw, TheDelayMustBeTold) {
  using S = TypeParam;
  const S K = S(100), h = S(0.001);
  for (int delay = 1; delay <= 3; ++delay) {
    for (const bool told : {true, false}) {
      const S layer = implicit_layer(K, h, told ? S(delay) : S(0));
      std::array<S, 4> past{};  // past[0] newest
      past.fill(S(0.05) * layer);
      for (int n = 0; n < 200; ++n) {
        const S next =
            past[0] - K * h * switching(Reaching::implicit, past[static_cast<unsigned>(delay)], layer);
        past = {next, past[0], past[1], past[2]};
      }
      const Real left = std::fabs(Real(past[0])) + std::fabs(Real(past[1])) + std::fabs(Real(past[2]));
      if (told) {
        EXPECT_LT(left, 1e-3L * Real(layer)) << delay;
      } else {
        EXPECT_GT(left, 0.05L * Real(layer)) << delay;
      }
    }
  }
}

/// [F38]: 0 <= |s| - s sat(s / eps) <= eps / 4, the same with tanh and 0.2785 eps; both constants are
/// attained.
TYPED_TEST(ReachingLaw, CostsNoMoreThanTheConstantsOfF38) {
  using S = TypeParam;
  for (const S layer : {S(0.01), S(1), S(30)}) {
    for (const auto& [law, constant] :
         {std::pair{Reaching::saturation, 0.25L}, std::pair{Reaching::implicit, 0.25L},
          std::pair{Reaching::tanh, 0.2785L}}) {
      Real most = 0, least = 1;
      for (int i = -5000; i <= 5000; ++i) {
        const S s = static_cast<S>(Real(layer) * i / 1000);
        const Real gap = (std::fabs(Real(s)) - Real(s) * Real(switching(law, s, layer))) / Real(layer);
        most = std::fmax(most, gap);
        least = std::fmin(least, gap);
      }
      EXPECT_GE(least, -5 * kEpsilon<S>);
      EXPECT_LE(most, constant + kEpsilon<S>);
      EXPECT_GE(most, constant - 1e-4L);
    }
  }
}

}  // namespace
}  // namespace esmc::test
