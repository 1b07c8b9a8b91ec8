// The coupled implicit step against a solver that knows nothing of it (nested ternary search in long double),
// and what backward Euler promises: s^T M s falls, the surface in one step where the gains reach it, no
// chatter, any gain.

#include "firmware/control/coupled.hpp"

#include <gtest/gtest.h>

#include "tests/support/tracking.hpp"

namespace esmc::test {
namespace {

template <class S>
class Coupled : public testing::Test {};
TYPED_TEST_SUITE(Coupled, Scalars, ScalarName);

/// 1/2 q^T H q + sum w |s + C q|, its least value and where, from the oracle's C_a and M alone.
struct Objective {
  Mat<Real, 18, 2> C;
  Vec<Real, 18> mass, s, weight;

  [[nodiscard]] Real at(Real q0, Real q1) const {
    Real sum = 0;
    for (int i = 0; i < 18; ++i) {
      const Real moved = C(i, 0) * q0 + C(i, 1) * q1;
      sum += mass[i] * moved * moved / 2 + weight[i] * std::fabs(s[i] + moved);
    }
    return sum;
  }
  template <class F>
  static Real least(Real low, Real high, const F& f) {
    for (int i = 0; i < 80; ++i) {
      const Real a = low + (high - low) / 3, b = high - (high - low) / 3;
      (f(a) < f(b) ? high : low) = f(a) < f(b) ? b : a;
    }
    return (low + high) / 2;
  }
  [[nodiscard]] Vec2<Real> search(Real size) const {
    const auto inner = [&](Real q0) { return least(-size, size, [&](Real q1) { return at(q0, q1); }); };
    const Real q0 = least(-size, size, [&](Real x) { return at(x, inner(x)); });
    return {q0, inner(q0)};
  }
};

template <class S>
struct Case {
  TrackingCase<S> c;
  Reduced<FiveBar<S>> reduced;
  Vec<S, 18> s, weight;
  Objective objective;

  /// `size`: of T K against s. Projected: s has no part that the mechanism cannot move along.
  Case(std::uint64_t seed, Real size, bool projected)
      : c(random_tracking<S>(seed)), reduced(c.mechanism, c.t.pose) {
    Random r(seed ^ 0xc0ffeeU);
    const Channels18 full = c.sliding();
    objective.C = c.now.C(FiveBarModel::by_base);
    objective.mass = c.now.mass();
    s = full.template cast<S>();
    if (projected) s = reduced.channels(reduced.nearest(s));
    for (int i = 0; i < 18; ++i) {
      const Real k = Real(std::fabs(full[i])) * size * std::pow(10.0L, r.between(-1, 1));
      weight[i] = reduced.mass()[i] * static_cast<S>(k);
    }
    objective.s = s.template cast<Real>();
    objective.weight = weight.template cast<Real>();
  }
};

TYPED_TEST(Coupled, FindsWhatASearchFinds) {
  using S = TypeParam;
  int solved = 0, cases = 0;
  for (const bool projected : {false, true}) {
    for (std::uint64_t seed = 0; seed < 10; ++seed) {
      for (const Real size : {0.1L, 1.0L, 10.0L}) {
        const Case<S> k(seed, size, projected);
        CoupledStep<FiveBar<S>> step(k.reduced, k.s, k.weight);
        Vec2<S> q;
        ++cases;
        if (!step.solve(q)) continue;
        ++solved;
        const Vec2<Real> far = k.reduced.nearest(k.s).template cast<Real>();
        const Vec2<Real> best = k.objective.search(4 * (std::fabs(far[0]) + std::fabs(far[1])) + 1e-3L);
        const Real got = k.objective.at(Real(q[0]), Real(q[1])), want = k.objective.at(best[0], best[1]);
        const Real scale = k.objective.weight.dot(k.objective.s.cwiseAbs());
        EXPECT_LE(got - want, 200 * kEpsilon<S> * scale)
            << "seed " << seed << " size " << double(size) << projected;
      }
    }
  }
  EXPECT_EQ(solved, cases);
}

/// V = s^T M s / 2 of what can be reached falls by the dissipation of the gains, step after step, until s is
/// zero.
TYPED_TEST(Coupled, ProjectedVFallsToZeroInFinitelyManyStepsAndStays) {
  using S = TypeParam;
  for (std::uint64_t seed = 0; seed < 40; ++seed) {
    const Case<S> k(seed, 0.05L, true);
    Vec<S, 18> s = k.s;
    const auto V = [&] {
      return (k.objective.mass.array() * s.template cast<Real>().array().square()).sum() / 2;
    };
    const Real first = V();
    bool zero = false;
    int steps = 0;
    for (; steps < 2000 && !zero; ++steps) {
      const Real before = V();
      CoupledStep<FiveBar<S>> step(k.reduced, s, k.weight);
      Vec2<S> q;
      ASSERT_TRUE(step.solve(q)) << "seed " << seed << " step " << steps;
      s += k.reduced.channels(q);
      const Real lost = k.objective.weight.dot(s.template cast<Real>().cwiseAbs());  // sum T M K |s+|
      ASSERT_LE(V(), before - lost + 400 * kEpsilon<S> * first) << "seed " << seed << " step " << steps;
      zero = V() <= 1e4L * kEpsilon<S> * kEpsilon<S> * first;
    }
    EXPECT_TRUE(zero) << "seed " << seed << " V " << double(V() / first);
    EXPECT_GT(steps, 1) << "seed " << seed;
  }
}

/// Inside: in one step, however large the gains. The clamp does that too, but only where no channel is at its
/// bound.
TYPED_TEST(Coupled, InsideItIsZeroAfterOneStepWithAnyGain) {
  using S = TypeParam;
  int more = 0;
  for (std::uint64_t seed = 0; seed < 400; ++seed) {
    Case<S> k(seed, 1.0L, true);
    CoupledStep<FiveBar<S>> step(k.reduced, k.s, k.weight);
    Vec2<S> q;
    ASSERT_TRUE(step.solve(q)) << "seed " << seed;
    const Vec<S, 18> after = k.s + k.reduced.channels(q);
    const S size = k.s.cwiseAbs().maxCoeff();
    const bool reached = after.cwiseAbs().maxCoeff() <= S(1e3) * std::numeric_limits<S>::epsilon() * size;
    bool clamp = true;  // s_i M_i <= w_i in every channel
    for (int i = 0; i < 18; ++i) clamp = clamp && std::fabs(k.s[i]) * k.reduced.mass()[i] <= k.weight[i];
    EXPECT_TRUE(reached || !clamp) << "seed " << seed;
    if (reached && !clamp) ++more;
    k.weight *= S(1000);
    S large = size;  // and T K, whose rounding is all that may be left
    for (int i = 0; i < 18; ++i) {
      if (k.weight[i] > S(0)) large = std::max(large, k.weight[i] / k.reduced.mass()[i]);
    }
    ASSERT_TRUE(step.solve(q)) << "seed " << seed;
    EXPECT_LE((k.s + k.reduced.channels(q)).cwiseAbs().maxCoeff(),
              S(200) * std::numeric_limits<S>::epsilon() * large)
        << "seed " << seed;
  }
  EXPECT_GE(more, 20);  // cases in which other channels do what one at its bound cannot
}

TYPED_TEST(Coupled, NanIsNotSolved) {
  using S = TypeParam;
  Case<S> k(3, 1.0L, false);
  k.s[4] = std::numeric_limits<S>::quiet_NaN();
  Vec2<S> q;
  EXPECT_FALSE(CoupledStep<FiveBar<S>>(k.reduced, k.s, k.weight).solve(q));
}

}  // namespace
}  // namespace esmc::test
