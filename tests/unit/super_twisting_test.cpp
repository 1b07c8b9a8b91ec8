// The implicit super-twisting law on s' = phi(t) - w: the inclusion of a step, V = k2 |s| + (z - phi)^2 / 2
// that falls in every step, zero in finitely many, what a disturbance of bounded rate leaves, delay, lag,
// saturation. The recursion and its bounds are written here, in long double; docs/reaching.md derives them.

#include "firmware/control/super_twisting.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <vector>

#include "tests/support/random_mechanism.hpp"

namespace esmc::test {
namespace {

template <class S>
class Twisting : public testing::Test {};
TYPED_TEST_SUITE(Twisting, Scalars, ScalarName);

/// The s+ of s+ + T k1 |s+|^1/2 sgn s+ + T h k2 Sgn s+ = b, by bisection.
Real next_by_bisection(Real b, Real T, Real h, Real k1, Real k2) {
  if (std::fabs(b) <= T * h * k2) return 0;
  Real low = 0, high = std::fabs(b);
  for (int i = 0; i < 200; ++i) {
    const Real x = (low + high) / 2;
    (x + T * k1 * std::sqrt(x) + T * h * k2 > std::fabs(b) ? high : low) = x;
  }
  return b > 0 ? low : -low;
}

TYPED_TEST(Twisting, AStepSolvesItsInclusion) {
  using S = TypeParam;
  for (std::uint64_t seed = 0; seed < 20000; ++seed) {
    Random r(seed);
    const S h = r.in<S>(1e-4, 1e-2), T = h * r.in<S>(1, 5),
            L = static_cast<S>(std::pow(10.0L, r.between(-1, 4)));
    const S k1 = S(1.5) * static_cast<S>(std::sqrt(Real(L))), k2 = S(1.1) * L, z0 = r.in<S>(-20, 20);
    const S b = static_cast<S>(Real(T * h * k2) * std::pow(10.0L, r.between(-3, 4)) * r.sign());
    S z = z0;
    const S w = super_twisting_step(b, T, h, k1, k2, z);
    const Real next = next_by_bisection(Real(b), Real(T), Real(h), Real(k1), Real(k2));
    // w = z0 + (b - s+) / T, and z moves by h k2 sgn s+, or by what makes s+ zero.
    const Real want = Real(z0) + (Real(b) - next) / Real(T),
               scale = std::fabs(Real(z0)) + std::fabs(Real(b) / Real(T));
    ASSERT_LE(std::fabs(Real(w) - want), 20 * kEpsilon<S> * scale) << "seed " << seed;
    const Real moved = next == 0 ? Real(b) / Real(T) : (b > S(0) ? 1 : -1) * Real(h) * Real(k2);
    ASSERT_LE(std::fabs(Real(z) - Real(z0) - moved), 8 * kEpsilon<S> * scale) << "seed " << seed;
  }
}

/// s' = phi - w held over each tick, the torque d ticks late, s measured `lag` ticks late; coordinates apart.
template <class S>
struct Loop {
  S h, L;
  Lateness<S> told{};
  int delay = 0, lag = 0;
  std::function<Real(int, int)> phi = [](int, int) { return Real(0); };  ///< coordinate, tick: mean over it
  S most = std::numeric_limits<S>::max();                                ///< of |w| that acts
  bool says_lost = true;
  SuperTwisting<S> law{};
  Vec2<Real> s{0, 0};
  Vec2<S> lost = Vec2<S>::Zero(), w = Vec2<S>::Zero();
  std::vector<Vec2<S>> sent{};
  std::vector<Vec2<Real>> seen{};

  void tick() {
    seen.push_back(s);
    const auto n = static_cast<int>(seen.size()) - 1;
    const Vec2<S> measured = seen[static_cast<std::size_t>(std::max(0, n - lag))].template cast<S>();
    w = law.step(measured, says_lost ? lost : Vec2<S>::Zero().eval(), L, h, told);
    Vec2<S> acts;
    for (int i = 0; i < 2; ++i) acts[i] = std::clamp(w[i], S(-most), most);
    lost = w - acts;
    sent.push_back(acts);
    for (int i = 0; i < 2; ++i) {
      const Real late = n >= delay ? Real(sent[static_cast<std::size_t>(n - delay)][i]) : Real(0);
      s[i] += Real(h) * (phi(i, n) - late);
    }
  }
};

TYPED_TEST(Twisting, UndisturbedVFallsInEveryStepUntilZeroAndThereNothingChatters) {
  using S = TypeParam;
  for (std::uint64_t seed = 0; seed < 300; ++seed) {
    Random r(seed);
    Loop<S> loop{.h = r.in<S>(2e-4, 5e-3), .L = r.in<S>(20, 500)};
    const Vec2<Real> constant(r.between(-5, 5), r.between(-5, 5));
    loop.phi = [&](int i, int) { return constant[i]; };
    loop.s = Vec2<Real>(r.between(-1, 1), r.between(-1, 1));
    loop.tick();  // the disturbance is known from the second tick on
    const Real k2 = 1.1L * Real(loop.L), h = Real(loop.h);
    const auto V = [&](int i) {
      const Real zeta = Real(loop.law.integral()[i]) - constant[i];
      return k2 * std::fabs(loop.s[i]) + zeta * zeta / 2;
    };
    const Real size = std::max(V(0), V(1)) + 1,
               tiny = 40 * kEpsilon<S>;  // tiny: s that is zero but for rounding
    int reached = 0;
    for (int n = 0; n < 100000 && reached == 0; ++n) {
      const Real before[2] = {V(0), V(1)};
      loop.tick();
      bool zero = true;
      for (int i = 0; i < 2; ++i) {
        const Real fall = std::fabs(loop.s[i]) <= tiny
                              ? 0
                              : h * 1.5L * std::sqrt(Real(loop.L)) * k2 * std::sqrt(std::fabs(loop.s[i]));
        ASSERT_LE(V(i), before[i] - fall + 200 * kEpsilon<S> * size) << "seed " << seed << " tick " << n;
        zero = zero && std::fabs(loop.s[i]) <= tiny &&
               std::fabs(Real(loop.law.integral()[i]) - constant[i]) <= tiny / h;
      }
      if (zero) reached = n;
    }
    ASSERT_GT(reached, 0) << "seed " << seed << ": not in 100000 ticks";
    for (int n = 0; n < 20; ++n) loop.tick();  // on the surface: nothing moves but the last bits
    for (int n = 0; n < 100; ++n) {
      const Vec2<S> last = loop.w;
      loop.tick();
      for (int i = 0; i < 2; ++i) {
        ASSERT_LE(std::fabs(loop.s[i]), 100 * kEpsilon<S>) << "seed " << seed;
        ASSERT_LE(std::fabs(Real(loop.w[i]) - Real(last[i])), 200 * kEpsilon<S> / h) << "seed " << seed;
        ASSERT_NEAR(double(loop.w[i]), double(constant[i]), double(200 * kEpsilon<S> / h)) << "seed " << seed;
      }
    }
  }
}

/// Largest |s| of the ticks from one half on; infinite where one is no number.
template <class S>
Real most_of(Loop<S>& loop, int ticks) {
  Real most = 0;
  for (int n = 0; n < ticks; ++n) {
    loop.tick();
    for (int i = 0; i < 2; ++i) {
      if (std::isnan(loop.s[i])) return std::numeric_limits<Real>::infinity();
      if (n > ticks / 2) most = std::max(most, std::fabs(loop.s[i]));
    }
  }
  return most;
}
/// Largest |s| once reached, under a disturbance whose rate is at most 1/3 of L. Per tick phi may move by h L
/// / 3: a worst one, up and down at the bound, and a slow sine.
template <class S>
Real left(Loop<S>& loop, int pattern, int ticks = 4000) {
  const Real step = Real(loop.h) * Real(loop.L) / 3;
  loop.phi = [=](int i, int n) {
    if (pattern == 0) return 40 * step * std::sin((n + 7 * i) / 40.0L);
    const int period = pattern == 1 ? 2 : 31, at = (n + 3 * i) % (2 * period);  // triangle
    return step * Real(at < period ? at : 2 * period - at);
  };
  return most_of(loop, ticks);
}

/// |s| <= h^2 |phi'|: each step takes s to zero but for what phi changed meanwhile; the clamp leaves h |phi|.
TYPED_TEST(Twisting, ADisturbanceLeavesTheSquareOfTheTick) {
  using S = TypeParam;
  for (const int pattern : {0, 1, 2}) {
    for (const S h : {S(1e-3), S(4e-3)}) {
      Loop<S> loop{.h = h, .L = S(150)};
      loop.s = {0.1L, -0.2L};
      const Real bound = Real(h) * Real(h) * Real(150) / 3;
      EXPECT_LE(left(loop, pattern), 1.001L * bound + 100 * kEpsilon<S>) << pattern << ' ' << h;
    }
  }
}

TYPED_TEST(Twisting, MoreGainThanNeededChangesNothingOnTheSurface) {
  using S = TypeParam;
  for (const int pattern : {0, 2}) {
    Loop<S> exact{.h = S(1e-3), .L = S(150)};
    const Real a = left(exact, pattern);
    Loop<S> other{.h = S(1e-3), .L = S(15000)};
    other.phi = exact.phi;
    EXPECT_NEAR(double(most_of(other, 4000)), double(a), double(200 * kEpsilon<S>)) << pattern;
  }
}

/// A torque d ticks late, told: s at the instant at which it acts is zero but for what phi did since. Not
/// told it rings.
TYPED_TEST(Twisting, AToldDelayIsBridged) {
  using S = TypeParam;
  for (int delay = 1; delay <= SuperTwisting<S>::most_delay; ++delay) {
    Loop<S> told{.h = S(1e-3), .L = S(150), .told = {delay, S(0)}, .delay = delay};
    const Real step = 1e-3L * 50, bound = 1e-3L * step * (delay + 1) * (delay + 2) / 2;
    const Real with = left(told, 0);
    EXPECT_LE(with, 1.01L * bound + 500 * kEpsilon<S>) << delay;
    Loop<S> untold{.h = S(1e-3), .L = S(150), .told = {}, .delay = delay};
    EXPECT_GE(left(untold, 0), 1.3L * with) << delay;
  }
}

/// What is measured l ticks late, told: the linear zone is stable, a constant disturbance leaves nothing. Not
/// told: it rings.
TYPED_TEST(Twisting, AToldLagDoesNotRing) {
  using S = TypeParam;
  for (int lag = 1; lag <= 4; ++lag) {
    for (const bool told : {true, false}) {
      Loop<S> loop{.h = S(1e-3), .L = S(1e4), .told = {0, told ? S(lag) : S(0)}, .lag = lag};
      loop.phi = [](int i, int) { return i == 0 ? 2.0L : -1.0L; };
      Real change = 0;
      for (int n = 0; n < 3000; ++n) {
        const Vec2<S> last = loop.w;
        loop.tick();
        if (n > 2500) change = std::max(change, std::fabs(Real(loop.w[0]) - Real(last[0])));
      }
      if (told) {
        EXPECT_LE(change, 1e-2L) << lag;
        EXPECT_LE(std::fabs(loop.s[0]), 1e-4L) << lag;
      } else {
        EXPECT_GE(change, 1.0L) << lag;
      }
    }
  }
}

/// While the torque is at its limit the integral stands still: the way back does not go past zero by what it
/// would have wound up.
TYPED_TEST(Twisting, TheIntegralDoesNotWindUp) {
  using S = TypeParam;
  Real past[2] = {0, 0};
  for (const bool told : {false, true}) {
    Loop<S> loop{.h = S(1e-3), .L = S(100), .most = S(2), .says_lost = told};
    loop.s = {1.0L, 1.0L};
    for (int n = 0; n < 3000; ++n) {
      loop.tick();
      past[told ? 1 : 0] = std::max(past[told ? 1 : 0], -loop.s[0]);
    }
    EXPECT_LE(std::fabs(loop.s[0]), 1e-3L);
  }
  EXPECT_GE(past[0], 0.05L);
  EXPECT_LE(past[1], past[0] / 5);
}

/// What went out counts, not what was asked: the disturbance is computed from it. In the linear zone of a
/// large gain both steps are written out.
TYPED_TEST(Twisting, WhatWasLostIsNotTakenForDone) {
  using S = TypeParam;
  const S h = S(0.0078125), s0 = S(0.5), s1 = S(0.25), lost = S(3);  // numbers that do not round
  SuperTwisting<S> law;
  EXPECT_EQ(law.step({s0, s0}, Vec2<S>::Zero(), S(1e7), h, {})[0], s0 / h);
  const Vec2<S> w = law.step({s1, s1}, {lost, S(0)}, S(1e7), h, {});
  const S disturbance = (s1 - s0) / h + s0 / h;
  EXPECT_EQ(w[0], s1 / h + disturbance - lost);
  EXPECT_EQ(w[1], s1 / h + disturbance);
}

/// Where one coordinate loses something the integral of both stands still: of the second step z has nothing,
/// of w h k2 is missing.
TYPED_TEST(Twisting, OneLossStopsBothIntegrals) {
  using S = TypeParam;
  const S h = S(1e-3), part = h * S(110);
  for (const int loser : {0, 1}) {
    SuperTwisting<S> law, free;
    const Vec2<S> s(S(1), S(1)), none = Vec2<S>::Zero();
    Vec2<S> lost = none;
    lost[loser] = S(0.5);
    EXPECT_EQ(law.step(s, none, S(100), h, {}), free.step(s, none, S(100), h, {}));
    const int other = 1 - loser;
    const S w = law.step(s, lost, S(100), h, {})[other], whole = free.step(s, none, S(100), h, {})[other];
    EXPECT_NEAR(double(whole - w), double(part), 0.05 * double(part)) << loser;
  }
}

/// [F40] in figures, far from the surface: what a first step asks is 1.5 root(L) root(s+) + 1.1 h L with s+ =
/// s - h w.
TYPED_TEST(Twisting, ItsConstantsAreThoseOfTheLaw) {
  using S = TypeParam;
  EXPECT_EQ(SuperTwisting<S>::most_delay, 8);
  for (const Real L : {4.0L, 150.0L, 1e4L}) {
    const Real h = 0.0078125L, s = 50.0L;
    SuperTwisting<S> law;
    const Vec2<S> w = law.step({S(s), S(-s)}, Vec2<S>::Zero(), S(L), S(h), {});
    const Real want = 1.5L * std::sqrt(L) * std::sqrt(s - h * Real(w[0])) + 1.1L * h * L;
    EXPECT_NEAR(double(w[0]), double(want), double(20 * kEpsilon<S> * want)) << double(L);
    EXPECT_EQ(w[1], -w[0]);
  }
}

TYPED_TEST(Twisting, NanStaysNanAndAResetForgetsIt) {
  using S = TypeParam;
  constexpr S nan = std::numeric_limits<S>::quiet_NaN();
  SuperTwisting<S> law;
  const Vec2<S> zero = Vec2<S>::Zero(), s(S(0.1), S(-0.1));
  const Vec2<S> first = law.step(s, zero, S(100), S(1e-3), {});
  EXPECT_TRUE(std::isnan(law.step({nan, S(0)}, zero, S(100), S(1e-3), {})[0]));
  EXPECT_TRUE(std::isnan(law.step(s, zero, S(100), S(1e-3), {})[0]));
  law.reset();
  EXPECT_EQ(law.step(s, zero, S(100), S(1e-3), {}), first);
}

TYPED_TEST(Twisting, WithoutGainItAsksForNothingAtZero) {
  using S = TypeParam;
  SuperTwisting<S> law;
  const Vec2<S> zero = Vec2<S>::Zero();
  for (int n = 0; n < 3; ++n) EXPECT_EQ(law.step(zero, zero, S(0), S(1e-3), {}), zero);
}

}  // namespace
}  // namespace esmc::test
