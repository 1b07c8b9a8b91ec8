// Four motors with limits and preload. Two judges that know nothing of polygons in a plane: all sets of
// motors that may stand at a bound, each solved as the linear system of its optimality conditions in long
// double, multipliers' signs checked (81 systems); and the convex hull of the forces that the sixteen corners
// of the box make.

#include "firmware/control/box_allocation.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <optional>
#include <vector>

#include "tests/support/random_mechanism.hpp"
#include "tests/support/tracking.hpp"

namespace esmc::test {
namespace {

template <class S>
class BoxAllocated : public testing::Test {};
TYPED_TEST_SUITE(BoxAllocated, Scalars, ScalarName);

using Rows = Mat<Real, 4, 2>;
using Four = Vec<Real, 4>;
using Two = Vec<Real, 2>;

/// A problem, exactly as the firmware's scalar has it.
struct Problem {
  Rows R;
  Two F;
  Four W, lower, upper;
};

/// Least tau^T W tau, R^T tau = F, motors of `state` != 0 at the lower (-1) or upper (+1) bound. None where
/// the system is singular, a bound is left, or a multiplier has the wrong sign, by more than `slack`.
std::optional<Four> at_bounds(const Problem& p, const std::array<int, 4>& state, Real slack) {
  Square<6> A{};
  Row<6> b{};
  for (std::size_t i = 0; i < 4; ++i) {
    const int r = static_cast<int>(i);
    if (state[i] == 0) {  // W tau + R y = 0
      A[i][i] = p.W[r];
      A[i][4] = p.R(r, 0);
      A[i][5] = p.R(r, 1);
    } else {
      A[i][i] = 1;
      b[i] = state[i] < 0 ? p.lower[r] : p.upper[r];
    }
    A[4][i] = p.R(r, 0);
    A[5][i] = p.R(r, 1);
  }
  b[4] = p.F[0];
  b[5] = p.F[1];
  const Row<6> x = eliminate(A, b);
  for (const Real v : x) {
    if (!std::isfinite(v)) return std::nullopt;
  }
  const Four tau(x[0], x[1], x[2],
                 x[3]);  // with three at bounds there is mostly none, whatever elimination says
  if (!((p.R.transpose() * tau - p.F).cwiseAbs().maxCoeff() <= slack)) return std::nullopt;
  for (std::size_t i = 0; i < 4; ++i) {
    const int r = static_cast<int>(i);
    const Real gradient =
        p.W[r] * x[i] + p.R(r, 0) * x[4] + p.R(r, 1) * x[5];  // = multiplier, <= 0 at the upper bound
    if (!(x[i] >= p.lower[r] - slack && x[i] <= p.upper[r] + slack)) return std::nullopt;
    if (state[i] != 0 && !(gradient * state[i] <= slack * p.W[r])) return std::nullopt;
  }
  return tau;
}

/// By all 81 sets; the cheapest that fulfils its conditions.
std::optional<Four> by_enumeration(const Problem& p) {
  std::optional<Four> best;
  Real cost = 0;
  for (int n = 0; n < 81; ++n) {
    const std::array<int, 4> state{n % 3 - 1, n / 3 % 3 - 1, n / 9 % 3 - 1, n / 27 - 1};
    const auto tau = at_bounds(p, state, 1e-12L);
    if (!tau) continue;
    const Real its = tau->cwiseProduct(p.W).dot(*tau);
    if (best && its >= cost) continue;
    best = tau;
    cost = its;
  }
  return best;
}

/// The largest share s <= 1 of F such that s F is in the hull of what the corners of the box make: along F's
/// direction, the hull's boundary is crossed by the segment between two corners that lies farthest out.
Real share_in_hull(const Problem& p) {
  std::vector<Two> corner;
  for (unsigned bits = 0; bits < 16; ++bits) {
    Four tau;
    for (int i = 0; i < 4; ++i)
      tau[i] = (bits >> static_cast<unsigned>(i) & 1U) != 0 ? p.upper[i] : p.lower[i];
    corner.push_back(p.R.transpose() * tau);
  }
  const auto cross = [](const Two& a, const Two& b) { return a[0] * b[1] - a[1] * b[0]; };
  Real farthest = 0;
  for (const Two& a : corner) {
    for (const Two& b : corner) {
      const Real det = cross(p.F, b - a);
      if (det == 0) continue;
      const Real s = cross(a, b - a) / det, along = cross(a, p.F) / det;
      if (along >= -1e-15L && along <= 1 + 1e-15L) farthest = std::max(farthest, s);
    }
  }
  return std::min(farthest, Real(1));
}

template <class S>
Problem problem(const Mat<S, 4, 2>& R, const Vec2<S>& F, const Vec<S, 4>& W, const Vec<S, 4>& limit,
                const Vec<S, 4>& preload) {
  Problem p{R.template cast<Real>(), F.template cast<Real>(), W.template cast<Real>(),
            -limit.template cast<Real>(), limit.template cast<Real>()};
  for (int i = 0; i < 4; ++i) {
    if (preload[i] > S(0)) p.lower[i] = Real(preload[i]);
    if (preload[i] < S(0)) p.upper[i] = Real(preload[i]);
  }
  return p;
}

template <class S>
Vec<S, 4> positive(Random& r, double low, double high) {
  Vec<S, 4> v;
  for (int i = 0; i < 4; ++i) v[i] = static_cast<S>(std::pow(10.0L, r.between(low, high)));
  return v;
}

/// How well two of the rows span the plane: the condition of what is left when two motors stand at a bound.
Real worst_span(const Rows& R) {
  Real worst = 1;
  for (int i = 0; i < 4; ++i) {
    for (int j = 0; j < i; ++j) {
      const Real c = std::fabs(R(i, 0) * R(j, 1) - R(i, 1) * R(j, 0)) / (R.row(i).norm() * R.row(j).norm());
      worst = std::min(worst, c);
    }
  }
  return worst;
}

struct Judged {
  int inside = 0, bounded = 0, saturated = 0, yielding = 0;
};

/// One problem, by both judges. Errors are relative to the largest limit and divided by the span.
template <class S>
void judge(std::uint64_t seed, const Mat<S, 4, 2>& R, const Vec2<S>& F, const Vec<S, 4>& W,
           const Vec<S, 4>& limit, const Vec<S, 4>& preload, Accuracy& torque, Accuracy& share, Accuracy& met,
           Judged& seen) {
  const BoxAllocation<S> a = allocate_within(R, F, W, limit, preload);
  const Problem limits = problem(R, F, W, limit, Vec<S, 4>(Vec<S, 4>::Zero()));
  Problem p = problem(R, F, W, limit, preload);
  const Real span = worst_span(p.R), most = p.upper.cwiseAbs().cwiseMax(p.lower.cwiseAbs()).maxCoeff();
  for (int i = 0; i < 4; ++i) ASSERT_LE(std::fabs(a.torque[i]), limit[i]) << "seed " << seed;
  share.take(seed, std::fabs(Real(a.force) - share_in_hull(limits)) * span);
  p.F *= Real(a.force);
  const Two made = p.R.transpose() * a.torque.template cast<Real>();
  met.take(seed, (made - p.F).cwiseAbs().maxCoeff() / (p.R.cwiseAbs().maxCoeff() * most) * span);
  // The judge's box, widened as the firmware says it is: is less of it enough, is so much of it enough?
  const Real wide = 1 - Real(a.preload);
  const auto widened = [&](Real share_of_it) {
    Problem q = p;
    for (int i = 0; i < 4; ++i) {
      q.lower[i] -= share_of_it * (p.lower[i] + Real(limit[i]));
      q.upper[i] += share_of_it * (Real(limit[i]) - p.upper[i]);
    }
    return q;
  };
  if (a.force < S(1)) {  // one torque makes this force: it is met, and within the box that is said
    ++seen.saturated;
    const Problem q = widened(wide);
    for (int i = 0; i < 4; ++i) {
      EXPECT_GE(Real(a.torque[i]), q.lower[i] - 1000 * kEpsilon<S> * most / span) << "seed " << seed;
      EXPECT_LE(Real(a.torque[i]), q.upper[i] + 1000 * kEpsilon<S> * most / span) << "seed " << seed;
    }
    return;
  }
  const Real step = 1000 * kEpsilon<S> / span + 1e-8L;
  ASSERT_TRUE(by_enumeration(widened(std::min(wide + step, Real(1)))))
      << "seed " << seed << ": preload yields too little";
  if (wide > 0) ++seen.yielding;
  if (wide > step) {
    EXPECT_FALSE(by_enumeration(widened(wide - step)))
        << "seed " << seed << ": preload yields more than it must";
  }
  const auto want = by_enumeration(widened(wide > 0 ? std::min(wide + 8 * kEpsilon<S>, Real(1)) : Real(0)));
  if (!want) return;  // where preload just yields, the point may be lost in rounding: judged above
  torque.take(seed, (a.torque.template cast<Real>() - *want).cwiseAbs().maxCoeff() / most * span *
                        (wide > 0 ? span : Real(1)));
  const bool plain = a.torque == minimum_norm(R, F, W);
  ++(plain ? seen.inside : seen.bounded);
}

TYPED_TEST(BoxAllocated, FulfilsTheOptimalityConditionsForAnyRows) {
  using S = TypeParam;
  Accuracy torque("torque"), share("share"), met("met");
  Judged seen;
  for (std::uint64_t seed = 0; seed < 3000; ++seed) {
    Random r(seed);
    Mat<S, 4, 2> R;
    R << r.vector<S, 4>(1), r.vector<S, 4>(1);
    const Vec2<S> F = r.vector<S, 2>(std::pow(10.0L, r.between(-1, 1)));
    const Vec<S, 4> W = positive<S>(r, -1, 1), limit = positive<S>(r, -0.5, 0.5);
    Vec<S, 4> preload = Vec<S, 4>::Zero();
    if (seed % 2 == 1) {
      for (int i = 0; i < 4; ++i)
        preload[i] = r.chance(0.3) ? S(0) : static_cast<S>(r.sign() * r.between(0, 0.5) * Real(limit[i]));
    }
    if (worst_span(R.template cast<Real>()) < 0.01L) continue;
    judge(seed, R, F, W, limit, preload, torque, share, met, seen);
  }
  torque.expect_below(300 * kEpsilon<S>);
  share.expect_below(100 * kEpsilon<S>);
  met.expect_below(300 * kEpsilon<S>);
  for (const int n : {seen.inside, seen.bounded, seen.saturated, seen.yielding}) EXPECT_GT(n, 200);
}

/// Both forms, both singularities, all modes, legs that are not alike.
TYPED_TEST(BoxAllocated, FulfilsThemOnTheMechanismInAllPlaces) {
  using S = TypeParam;
  for (const int place : {0, 1, 2}) {
    Accuracy torque("torque"), share("share"), met("met");
    Judged seen;
    for (std::uint64_t seed = 0; seed < 1000; ++seed) {
      const double distance = std::pow(10.0, -1.0 - static_cast<double>((seed / 8) % 6));
      const auto c = place == 0   ? random_five_bar<S>(seed)
                     : place == 1 ? random_five_bar<S>(seed, {.sin1 = distance, .from_base = true})
                                  : random_five_bar<S>(seed, {.min_sin1 = 0.3, .sin2 = distance});
      const FiveBar<S> m = c.mechanism();
      const auto pose = place == 1 ? m.forward(c.base, c.mode.assembly) : m.inverse(c.position, c.mode);
      ASSERT_TRUE(pose) << "seed " << seed;
      Random r(~seed);
      const Vec<S, 18> w = r.vector<S, 18>(std::pow(10.0L, r.between(-1, 1)));
      const FourMotors<S> four = four_motors(m, *pose, w);
      if (worst_span(four.rows.template cast<Real>()) < 0.01L) continue;
      const Vec<S, 4> W = positive<S>(r, -1, 1), limit = positive<S>(r, -0.5, 0.5);
      Vec<S, 4> preload = Vec<S, 4>::Zero();
      if (seed % 2 == 1) {
        for (int i = 0; i < 4; ++i)
          preload[i] = static_cast<S>(r.sign() * r.between(0, 0.5) * Real(limit[i]));
      }
      judge(seed, four.rows, four.F, W, limit, preload, torque, share, met, seen);
      EXPECT_EQ(allocate_all_within(m, *pose, w, W, limit, preload).torque,
                allocate_within(four.rows, four.F, W, limit, preload).torque);
    }
    SCOPED_TRACE(place);
    torque.expect_below(300 * kEpsilon<S>);
    share.expect_below(100 * kEpsilon<S>);
    met.expect_below(300 * kEpsilon<S>);
    for (const int n : {seen.inside, seen.bounded, seen.saturated}) EXPECT_GT(n, 20);
  }
}

/// Next to the singularities rows are nearly parallel, and what the judges say is less exact than what is
/// asked: within limits, and the force that is met is the one that is said.
TYPED_TEST(BoxAllocated, NearSingularitiesTheForceIsMetWithinTheLimits) {
  using S = TypeParam;
  for (const int place : {1, 2}) {
    Accuracy met("met");
    for (std::uint64_t seed = 0; seed < 2000; ++seed) {
      const double distance = std::pow(10.0, -1.0 - static_cast<double>((seed / 8) % 6));
      const auto c = place == 1 ? random_five_bar<S>(seed, {.sin1 = distance, .from_base = true})
                                : random_five_bar<S>(seed, {.min_sin1 = 0.3, .sin2 = distance});
      const FiveBar<S> m = c.mechanism();
      const auto pose = place == 1 ? m.forward(c.base, c.mode.assembly) : m.inverse(c.position, c.mode);
      ASSERT_TRUE(pose) << "seed " << seed;
      Random r(~seed);
      const FourMotors<S> four = four_motors(m, *pose, Vec<S, 18>(r.vector<S, 18>(2)));
      const Vec<S, 4> limit = positive<S>(r, -0.5, 0.5);
      Vec<S, 4> preload = Vec<S, 4>::Zero();
      if (seed % 2 == 1) {
        for (int i = 0; i < 4; ++i)
          preload[i] = static_cast<S>(r.sign() * r.between(0, 0.5) * Real(limit[i]));
      }
      const auto a = allocate_within(four.rows, four.F, Vec<S, 4>(positive<S>(r, -1, 1)), limit, preload);
      for (int i = 0; i < 4; ++i) ASSERT_LE(std::fabs(a.torque[i]), limit[i]);
      const Two want = four.F.template cast<Real>() * Real(a.force);
      const Two made = four.rows.template cast<Real>().transpose() * a.torque.template cast<Real>();
      met.take(seed, (made - want).cwiseAbs().maxCoeff() /
                         (Real(four.rows.cwiseAbs().maxCoeff()) * Real(limit.maxCoeff())));
    }
    SCOPED_TRACE(place);
    met.expect_below(2000 * kEpsilon<S>);
  }
}

/// The sign is kept, whatever the force does, as long as the preload is there; and the force is that without
/// it.
TYPED_TEST(BoxAllocated, PreloadKeepsItsSideAndMovesNothing) {
  using S = TypeParam;
  int kept = 0;
  for (std::uint64_t seed = 0; seed < 2000; ++seed) {
    Random r(seed);
    Mat<S, 4, 2> R;
    R << r.vector<S, 4>(1), r.vector<S, 4>(1);
    if (worst_span(R.template cast<Real>()) < 0.05L) continue;
    const Vec2<S> F = r.vector<S, 2>(0.5);
    const Vec<S, 4> limit = Vec<S, 4>::Constant(S(5)), even = Vec<S, 4>::Ones();
    // A torque that moves nothing has these signs: they can be had.
    const Mat<S, 4, 2> n = box::null_space(R, even);
    const Vec<S, 4> still = n * r.vector<S, 2>(1);
    Vec<S, 4> preload;
    for (int i = 0; i < 4; ++i) preload[i] = still[i] > S(0) ? S(0.1) : S(-0.1);
    if (still.cwiseAbs().minCoeff() < S(0.05)) continue;
    const auto a = allocate_within(R, F, even, limit, preload);
    if (a.preload < S(1)) continue;
    ++kept;
    for (int i = 0; i < 4; ++i)
      EXPECT_GE(a.torque[i] * (preload[i] > S(0) ? S(1) : S(-1)),
                S(0.1) - S(64) * std::numeric_limits<S>::epsilon() * limit[i]);
    const Vec2<S> made = R.transpose() * a.torque, without = R.transpose() * minimum_norm(R, F, even);
    EXPECT_LT((made - without).cwiseAbs().maxCoeff(), S(500) * std::numeric_limits<S>::epsilon());
  }
  EXPECT_GT(kept, 500);
}

/// Where a bound begins to hold, nothing jumps: neighbouring forces have neighbouring torques, through all of
/// what may happen.
TYPED_TEST(BoxAllocated, TorquesAreContinuousInTheForce) {
  using S = TypeParam;
  constexpr int steps = 4000;
  for (std::uint64_t seed = 0; seed < 60; ++seed) {
    Random r(seed);
    Mat<S, 4, 2> R;
    R << r.vector<S, 4>(1), r.vector<S, 4>(1);
    const Real span = worst_span(R.template cast<Real>());
    if (span < 0.1L) continue;
    const Vec<S, 4> limit = positive<S>(r, -0.3, 0.3), W = positive<S>(r, -0.5, 0.5);
    Vec<S, 4> preload;
    for (int i = 0; i < 4; ++i) preload[i] = static_cast<S>(r.sign() * r.between(0, 0.4) * Real(limit[i]));
    const Vec2<S> from = r.vector<S, 2>(5), to = r.vector<S, 2>(5);
    Vec<S, 4> last = allocate_within(R, from, W, limit, preload).torque;
    Real jump = 0;
    for (int k = 1; k <= steps; ++k) {
      const Vec2<S> F = from + (to - from) * (S(k) / S(steps));
      const Vec<S, 4> tau = allocate_within(R, F, W, limit, preload).torque;
      jump = std::max(jump, Real((tau - last).cwiseAbs().maxCoeff()));
      last = tau;
    }
    EXPECT_LT(jump, 60 / span / steps * 10) << "seed " << seed;
  }
}

TYPED_TEST(BoxAllocated, WhatIsNotFiniteStaysSo) {
  using S = TypeParam;
  Mat<S, 4, 2> R;
  R << S(1), S(0), S(0), S(1), S(1), S(1), S(1), S(-1);
  const Vec<S, 4> even = Vec<S, 4>::Ones(), none = Vec<S, 4>::Zero();
  constexpr S nan = std::numeric_limits<S>::quiet_NaN(), infinite = std::numeric_limits<S>::infinity();
  for (const S bad : {nan, infinite, -infinite}) {
    const auto a = allocate_within(R, Vec2<S>(bad, S(1)), even, even, none);
    EXPECT_FALSE(a.torque.allFinite());
  }
  const auto none_left = allocate_within(R, Vec2<S>(S(1), S(1)), even, none, none);
  EXPECT_EQ(none_left.torque, none);
  EXPECT_EQ(none_left.force, S(0));
}

}  // namespace
}  // namespace esmc::test
