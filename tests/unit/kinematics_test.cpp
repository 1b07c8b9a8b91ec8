// Inverse and forward kinematics in all modes, what lies outside them, singularity measures, and the
// estimates built on them, against closures solved by Newton's method in long double
// (tests/support/lagrange.hpp).
//
// Bounds: IK divides rounding errors by sin^2 theta_2 / 4 or so (0.2 -> 100), FK by D2; a few hundred epsilon
// follow.

#include <gtest/gtest.h>

#include "firmware/control/esmc.hpp"
#include "firmware/cycle/estimate.hpp"
#include "firmware/mechanism/matrices.hpp"
#include "tests/support/random_mechanism.hpp"

namespace esmc::test {
namespace {

constexpr std::uint64_t kCases = 2000;
template <class S>
class Kinematics : public testing::Test {};
TYPED_TEST_SUITE(Kinematics, Scalars, ScalarName);

/// Difference of two angles, wrapped: -pi and pi are the same direction.
Real apart(Real a, Real b) { return std::fabs(detail::wrap(a - b)); }

template <class S>
Real angle_error(const Vec<S, 4>& got, const FiveBarCase<S>& c) {
  const auto q = c.oracle.channels(c.q);
  Real worst = 0;
  const std::array<std::size_t, 4> row{2, 3, 10, 11};
  for (int i = 0; i < 4; ++i) {
    const Real e = apart(Real(got[i]), q[row[static_cast<unsigned>(i)]]);
    if (!(e <= worst)) worst = e;
    EXPECT_LE(std::fabs(Real(got[i])), Real(std::numbers::pi_v<S>)) << "seed " << c.seed;
  }
  return worst;
}
template <class P>
Real unit_error(const P& pose) {
  Real worst = 0;
  for (int j = 0; j < 2; ++j) {
    for (int i = 0; i < 2; ++i) {
      worst = std::fmax(worst, std::fabs(pose.leg[j].axis[i].template cast<Real>().norm() - 1));
      worst = std::fmax(worst, std::fabs(pose.leg[j].turn[i].template cast<Real>().norm() - 1));
    }
  }
  return worst;
}

TYPED_TEST(Kinematics, InverseAndForwardAgreeWithTheClosedLoopInEveryMode) {
  using S = TypeParam;
  Accuracy inverse("inverse"), forward("forward"), there("inverse_then_forward"),
      back("forward_then_inverse"), unit("unit_vectors"), type1("sin_type1"), type2("sin_type2"),
      closure("closure"), effector("effector");
  for (std::uint64_t seed = 0; seed < kCases; ++seed) {
    for (const bool from_base : {false, true}) {
      const auto c = random_five_bar<S>(seed, {.from_base = from_base});
      const FiveBar<S> m = c.mechanism();
      // Exactly one of the two inputs is exact; the other is as good as its rounding, times the same
      // condition.
      const auto i = m.inverse(c.position, c.mode);
      const auto f = m.forward(c.base, c.mode.assembly);
      ASSERT_TRUE(i && f) << "seed " << seed;
      inverse.take(seed, angle_error(m.angles(*i), c));
      forward.take(seed, angle_error(m.angles(*f), c));
      effector.compare(seed, f->effector, c.position, 0.1L);
      for (const auto* p : {&*i, &*f}) {
        unit.take(seed, unit_error(*p));
        for (int leg = 0; leg < 2; ++leg) {
          type1.take(seed, std::fabs(Real(m.sin_type1(*p, leg)) - FiveBarModel::sin_type1(c.q, leg)));
        }
        const Real s1 =
            std::fmin(std::fabs(FiveBarModel::sin_type1(c.q, 0)), std::fabs(FiveBarModel::sin_type1(c.q, 1)));
        type1.take(seed, std::fabs(Real(m.min_abs_sin_type1(*p)) - s1));
        type2.take(seed, std::fabs(Real(p->sin_type2) - FiveBarModel::sin_type2(c.q)));
        EXPECT_EQ(m.abs_sin_type2(*p), std::fabs(p->sin_type2)) << "seed " << seed;
        closure.take(seed, m.closure_residual(*p).template cast<Real>().norm());
        for (int other = 0; other < 4; ++other) {
          const typename FiveBar<S>::Mode mode{{{(other & 1) != 0 ? 1 : -1, (other & 2) != 0 ? 1 : -1}}, 1};
          const bool same = mode.working[0] == c.mode.working[0] && mode.working[1] == c.mode.working[1];
          EXPECT_EQ(m.in_working_mode(*p, mode), same) << "seed " << seed;
        }
        EXPECT_EQ(p->sin_type2 > S(0), c.mode.assembly > 0) << "seed " << seed;
      }
      const auto again = m.forward(m.base_angles(*i), c.mode.assembly);
      const auto once_more = m.inverse(f->effector, c.mode);
      ASSERT_TRUE(again && once_more) << "seed " << seed;
      there.compare(seed, again->effector, i->effector, 0.1L);
      back.take(seed, angle_error(m.angles(*once_more), c));
    }
  }
  for (const Accuracy* a : {&inverse, &forward, &there, &back, &type1, &type2, &closure, &effector, &unit}) {
    a->expect_below(400 * kEpsilon<S>);
  }
}

/// The other assembly mode is the mirror image of the effector in the line of the elbows, with D2 reversed.
TYPED_TEST(Kinematics, TheTwoAssemblyModesAreMirrorImages) {
  using S = TypeParam;
  for (std::uint64_t seed = 0; seed < kCases; ++seed) {
    const auto c = random_five_bar<S>(seed);
    const FiveBar<S> m = c.mechanism();
    const auto a = m.forward(c.base, 1), b = m.forward(c.base, -1);
    ASSERT_TRUE(a && b) << "seed " << seed;
    EXPECT_EQ(a->sin_type2, -b->sin_type2) << "seed " << seed;
    EXPECT_GT(a->sin_type2, S(0)) << "seed " << seed;
    // Both close: the same distal lengths from both elbows.
    for (const auto* p : {&*a, &*b}) {
      EXPECT_LE(static_cast<double>(m.closure_residual(*p).norm()), 100 * kEpsilon<S>) << "seed " << seed;
    }
    const Vec2<S> e1 = m.frame(0).point_from_leg(a->leg[0].axis[0] * m.leg(0).body(0).length);
    const Vec2<S> e2 = m.frame(1).point_from_leg(a->leg[1].axis[0] * m.leg(1).body(0).length);
    const Vec2<S> w = e1 - e2;
    EXPECT_NEAR(static_cast<double>(dot(w, Vec2<S>(a->effector - b->effector))), 0.0, 100 * kEpsilon<S>)
        << "seed " << seed;
  }
}

TYPED_TEST(Kinematics, DeterminantsAreTheSingularityMeasures) {
  using S = TypeParam;
  Accuracy B("det_B"), products("base_times_B");
  for (std::uint64_t seed = 0; seed < kCases; ++seed) {
    const auto c = random_five_bar<S>(seed, {.min_sin1 = 0.1, .min_sin2 = 0.1});
    const FiveBar<S> m = c.mechanism();
    const auto pose = *m.inverse(c.position, c.mode);
    const Mat<S, 6, 2> Chat = matrix_Chat(m, pose);
    const Real det = Real(Chat(2, 0)) * Real(Chat(4, 1)) - Real(Chat(2, 1)) * Real(Chat(4, 0));
    const Real want = FiveBarModel::sin_type2(c.q) /
                      (Real(c.params.legs[0].l1) * Real(c.params.legs[1].l1) *
                       FiveBarModel::sin_type1(c.q, 0) * FiveBarModel::sin_type1(c.q, 1));  // [F19]
    B.take(seed, std::fabs(det / want - 1));
    // Base rates there and back: C_a B = C.
    const auto rates = m.base_rates(pose, m.base(m.chain_rates(pose, c.velocity)));
    products.compare(seed, m.channel_rates(pose, rates),
                     m.channel_rates(pose, m.chain_rates(pose, c.velocity)));
  }
  B.expect_below(3000 * kEpsilon<S>);
  products.expect_below(1000 * kEpsilon<S>);
}

TYPED_TEST(Kinematics, RrArmInBothModes) {
  using S = TypeParam;
  Accuracy tip("tip"), angles("angles"), sine("sin_type1");
  for (std::uint64_t seed = 0; seed < kCases; ++seed) {
    const auto c = random_rr<S>(seed);
    const Rr<S> m = c.mechanism();
    const auto pose = m.pose(c.theta);
    const auto want = c.oracle.tip(c.q);
    tip.compare(seed, pose.effector, Vec<Real, 2>(want[0], want[1]), 0.1L);
    sine.take(seed, std::fabs(Real(m.sin_type1(pose)) - std::sin(c.q[1])));
    const int sigma = c.q[1] > 0 ? 1 : -1;
    EXPECT_TRUE(m.in_working_mode(pose, {sigma}));
    EXPECT_FALSE(m.in_working_mode(pose, {-sigma}));
    const auto inverse = m.inverse(pose.effector, {sigma}), other = m.inverse(pose.effector, {-sigma});
    ASSERT_TRUE(inverse && other) << "seed " << seed;
    for (int i = 0; i < 2; ++i)
      angles.take(seed, apart(Real(m.angles(*inverse)[i]), c.q[static_cast<unsigned>(i)]));
    EXPECT_TRUE(m.in_working_mode(*other, {-sigma}));
    tip.compare(seed, m.pose(m.angles(*other)).effector, pose.effector, 0.1L);
  }
  tip.expect_below(30 * kEpsilon<S>);
  sine.expect_below(2 * kEpsilon<S>);
  angles.expect_below(400 * kEpsilon<S>);
}

/// Reachable or not, decided in long double; within rounding of the boundary either answer will do, never a
/// NaN.
TYPED_TEST(Kinematics, OutOfReachIsEmptyAndTheRestIsNot) {
  using S = TypeParam;
  int reached = 0, missed = 0;
  for (std::uint64_t seed = 0; seed < 20 * kCases; ++seed) {
    Random r(seed);
    const FiveBarParams<S> p = random_five_bar_params<S>(r);
    const FiveBar<S> m(p);
    const Vec2<S> x = r.vector<S, 2>(1.0);
    const typename FiveBar<S>::Mode mode{{{r.sign(), r.sign()}}, 1};
    bool inside = true, near = false;
    for (int j = 0; j < 2; ++j) {
      const LegParams<S>& l = p.legs[static_cast<unsigned>(j)];
      const Real d = std::hypot(Real(x[0]) - (j == 0 ? 1 : -1) * Real(p.l0), Real(x[1]));
      const Real far = Real(l.l1) + Real(l.l2), close = std::fabs(Real(l.l1) - Real(l.l2));
      inside = inside && d <= far && d >= close;
      near = near || std::fabs(d - far) < 10 * kEpsilon<S> || std::fabs(d - close) < 10 * kEpsilon<S>;
    }
    const auto got = m.inverse(x, mode);
    EXPECT_TRUE(near || got.has_value() == inside) << "seed " << seed;
    EXPECT_TRUE(!got || unit_error(*got) < 1e-3L) << "seed " << seed;

    const Vec2<S> base = r.vector<S, 2>(3.14);
    const Real ex = 2 * Real(p.l0) + Real(p.legs[0].l1) * std::cos(Real(base[0])) +
                    Real(p.legs[1].l1) * std::cos(Real(base[1]));
    const Real ey =
        Real(p.legs[0].l1) * std::sin(Real(base[0])) - Real(p.legs[1].l1) * std::sin(Real(base[1]));
    const Real d = std::hypot(ex, ey), far = Real(p.legs[0].l2) + Real(p.legs[1].l2);
    const Real close = std::fabs(Real(p.legs[0].l2) - Real(p.legs[1].l2));
    const auto closed = m.forward(base, r.sign());
    if (std::fabs(d - far) > 10 * kEpsilon<S> && std::fabs(d - close) > 10 * kEpsilon<S>) {
      EXPECT_EQ(closed.has_value(), d <= far && d >= close) << "seed " << seed;
    }
    EXPECT_TRUE(!closed || unit_error(*closed) < 1e-3L) << "seed " << seed;
    reached += got ? 1 : 0;
    missed += closed ? 0 : 1;
  }
  EXPECT_GT(reached, 1000);
  EXPECT_GT(missed, 1000);
}

TYPED_TEST(Kinematics, DegeneratePointsAndNonNumbersAreEmpty) {
  using S = TypeParam;
  using Limits = std::numeric_limits<S>;
  Random r(1);
  FiveBarParams<S> p = random_five_bar_params<S>(r);
  for (const bool equal : {true, false}) {  // r = 0: no direction if the bars are equal, out of reach if not
    p.legs[0].l1 = p.legs[0].l2 = p.legs[1].l1 = S(0.25);
    p.legs[1].l2 = p.l0 * S(2) + S(0.25);
    if (!equal) p.legs[0].l2 = S(0.3);
    const FiveBar<S> m(p);
    EXPECT_FALSE(m.inverse(Vec2<S>(p.l0, S(0)), {{{1, 1}}, 1}));
    typename Dyad<S>::Pose pose;
    EXPECT_FALSE(dyad_inverse(m.leg(0), Vec2<S>(S(0), -S(0)), 1, pose));
    const bool tiny = dyad_inverse(m.leg(0), Vec2<S>(Limits::denorm_min(), S(0)), 1, pose);
    EXPECT_FALSE(tiny);  // its square is 0: no direction either
  }
  // d = 0: both elbows in one point, exactly: l0 - l1 cos 0 on both sides.
  p.legs[0].l1 = p.legs[1].l1 = p.l0 = S(0.25);
  p.legs[0].l2 = p.legs[1].l2 = S(0.3);
  const S pi = std::numbers::pi_v<S>;
  EXPECT_FALSE(FiveBar<S>(p).forward(Vec2<S>(pi, pi), 1));
  EXPECT_TRUE(FiveBar<S>(p).forward(Vec2<S>(S(1.8), S(1.8)), 1));
  const FiveBar<S> m(p);
  const Rr<S> rr(RrParams<S>{p.legs[0], S(9.8)});
  for (const S bad : {Limits::quiet_NaN(), Limits::infinity(), -Limits::infinity(), Limits::max()}) {
    for (int i = 0; i < 2; ++i) {
      Vec2<S> x(S(0.1), S(0.2));
      x[i] = bad;
      EXPECT_FALSE(m.inverse(x, {{{1, 1}}, 1})) << bad;
      EXPECT_FALSE(m.forward(x, 1)) << bad;
      EXPECT_FALSE(rr.inverse(x, {1})) << bad;
      EXPECT_FALSE(estimate_from_base(m, {{{1, 1}}, 1}, x, Vec2<S>(S(0), S(0)))) << bad;
    }
  }
}

/// From all four encoders: the mean of two tips, whose distance is told; nothing is hidden when they
/// disagree.
TYPED_TEST(Kinematics, EstimateFromAllEncodersTellsTheGap) {
  using S = TypeParam;
  Accuracy gap("gap"), place("effector"), speed("velocity"), closed("closed_rates");
  for (std::uint64_t seed = 0; seed < kCases; ++seed) {
    auto c = random_five_bar<S>(seed);
    const FiveBar<S> m = c.mechanism();
    const auto whole = estimate_from_all(m, c.theta, c.theta_rate);
    closed.compare(seed, m.channel_rates(whole.pose, whole.rates), c.rates());
    EXPECT_LE(static_cast<double>(whole.closure), 20 * kEpsilon<S>) << "seed " << seed;
    Random r(~seed);
    const Vec<S, 4> angle = c.theta + r.vector<S, 4>(0.1), rate = c.theta_rate + r.vector<S, 4>(0.5);
    const auto e = estimate_from_all(m, angle, rate);
    // The two tips with those angles, positions only.
    const auto& bar = c.oracle.bar;
    const auto tip = [&](int leg, const auto& t) {
      const auto& first = bar[leg == 0 ? 0 : 2];
      const auto& second = bar[leg == 0 ? 1 : 3];
      const auto x = first.length * cosine(t[0]) + second.length * cosine(t[0] + t[1]);
      const auto y = first.length * sine(t[0]) + second.length * sine(t[0] + t[1]);
      return std::array{leg == 0 ? x + c.oracle.half_base : -x - c.oracle.half_base, y};
    };
    Vec<Real, 2> mean = Vec<Real, 2>::Zero(), mean_rate = mean, between = mean;
    for (int leg = 0; leg < 2; ++leg) {
      const auto t = tip(leg, along(Row<2>{Real(angle[2 * leg]), Real(angle[2 * leg + 1])},
                                    Row<2>{Real(rate[2 * leg]), Real(rate[2 * leg + 1])}));
      mean += Vec<Real, 2>(t[0].v, t[1].v) / 2;
      mean_rate += Vec<Real, 2>(t[0].d, t[1].d) / 2;
      between += Vec<Real, 2>(t[0].v, t[1].v) * (leg == 0 ? 1 : -1);
    }
    place.compare(seed, e.pose.effector, mean, 0.1L);
    speed.compare(seed, e.rates.platform, mean_rate, 1.0L);
    gap.take(seed, std::fabs(Real(e.closure) - between.norm()));
  }
  for (const Accuracy* a : {&gap, &place, &speed}) a->expect_below(30 * kEpsilon<S>);
  closed.expect_below(300 * kEpsilon<S>);
}

/// The reference in either space, carried to all channels, has the oracle's rates and accelerations.
TYPED_TEST(Kinematics, DesiredMotionFromEffectorAndFromBaseIsTheSame) {
  using S = TypeParam;
  Accuracy effector("at_effector"), base("at_base");
  for (std::uint64_t seed = 0; seed < kCases; ++seed) {
    for (const bool from_base : {false, true}) {
      const auto c = random_five_bar<S>(seed, {.from_base = from_base});
      const FiveBar<S> m = c.mechanism();
      Random r(~seed);
      const Vec2<S> a = r.vector<S, 2>(from_base ? 30.0 : 5.0);
      const auto& by = from_base ? FiveBarModel::by_base : FiveBarModel::by_effector;
      const auto d = from_base ? desired_at_base(m, c.mode, c.base, c.base_rate, a)
                               : desired_at_effector(m, c.mode, c.position, c.velocity, a);
      ASSERT_TRUE(d) << "seed " << seed;
      const Vec<Real, 18> want = c.accelerations(
          c.oracle.accelerations(c.q, c.qd, c.qd, by, Real(a[0]), from_base ? -Real(a[1]) : Real(a[1])));
      (from_base ? base : effector)
          .compare(seed, m.channel_accelerations(d->pose, d->rates, d->acceleration), want);
      EXPECT_LE(static_cast<double>(Accuracy::relative(m.channel_rates(d->pose, d->rates), c.rates())),
                400 * kEpsilon<S>)
          << "seed " << seed;
      EXPECT_LE(angle_error(m.angles(d->pose), c), 400 * kEpsilon<S>) << "seed " << seed;
    }
  }
  for (const Accuracy* a : {&effector, &base}) a->expect_below(1500 * kEpsilon<S>);
}

/// Errors between poses are differences of coordinates, angles the short way round.
TYPED_TEST(Kinematics, ChannelErrorsAreDifferencesOfCoordinates) {
  using S = TypeParam;
  Accuracy error("error"), base("base_error");
  for (std::uint64_t seed = 0; seed < kCases; ++seed) {
    const auto c = random_five_bar<S>(seed);
    Random r(~seed);  // any other place: poses from angles need no closed loop to have coordinates
    const FiveBar<S> m = c.mechanism();
    const Vec<S, 4> t = r.vector<S, 4>(3.14);
    auto from = m.pose(c.theta), to = m.pose(t);
    const auto at = [&](const Vec<S, 4>& th, const Vec2<S>& x) {
      const Real a = Real(th[0]), b = detail::kPi - Real(th[2]);
      return c.oracle.channels(
          FiveBarModel::Q{Real(x[0]), Real(x[1]), a, a + Real(th[1]), b, b - Real(th[3])});
    };
    const auto qd = at(t, to.effector), q = at(c.theta, from.effector);
    const auto still = FiveBar<S>::Rates::Zero();
    const Vec<S, 18> got = channel_errors(m, Tracking<FiveBar<S>>{from, to, still, still, still}).e;
    for (int i = 0; i < 18; ++i) {
      const Real want = qd[static_cast<unsigned>(i)] - q[static_cast<unsigned>(i)];
      error.take(seed, m.is_angle(i) ? apart(Real(got[i]), want) : std::fabs(Real(got[i]) - want));
      EXPECT_TRUE(!m.is_angle(i) || std::fabs(got[i]) <= std::numbers::pi_v<S>) << "seed " << seed;
    }
    for (int i = 0; i < 2; ++i) {
      base.take(seed, apart(Real(m.base_error(to, from)[i]), Real(t[2 * i]) - Real(c.theta[2 * i])));
    }
  }
  error.expect_below(20 * kEpsilon<S>);
  base.expect_below(5 * kEpsilon<S>);
}

}  // namespace
}  // namespace esmc::test
