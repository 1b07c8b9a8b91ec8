// Torque allocation [F26] against its optimality conditions solved in long double.
//
// Bounds: least-norm by QR loses the condition of W^-1/2 R, not its square: a bound of `condition x 50
// epsilon` fails for the normal equations as soon as the condition exceeds 50. On the mechanism, whose form
// is chosen to be regular, no condition but that of IK or FK at 0.2 appears: a few hundred epsilon, down to
// 1e-6 from either singularity.

#include "firmware/control/allocation.hpp"

#include <gtest/gtest.h>

#include "tests/support/tracking.hpp"

namespace esmc::test {
namespace {

constexpr std::uint64_t kCases = 1600;
template <class S>
class Allocation : public testing::Test {};
TYPED_TEST_SUITE(Allocation, Scalars, ScalarName);

/// Stationarity and constraint of min tau^T W tau, R^T tau = F: [W R; R^T 0] [tau; mu] = [0; F]. Rows and
/// columns are scaled by W^-1/2 and by the lengths of R's columns, so that elimination does not choose its
/// pivots by units.
Vec<Real, 4> kkt(const Mat<Real, 4, 2>& R, const Vec<Real, 2>& F, const Vec<Real, 4>& W) {
  const Vec<Real, 4> root = W.cwiseSqrt().cwiseInverse();
  const Mat<Real, 4, 2> scaled = root.asDiagonal() * R;
  const Vec<Real, 2> length(scaled.col(0).norm(), scaled.col(1).norm());
  Square<6> A{};
  Row<6> b{};
  for (std::size_t i = 0; i < 4; ++i) {
    A[i][i] = 1;
    for (std::size_t j = 0; j < 2; ++j) {
      const int r = static_cast<int>(i), c = static_cast<int>(j);
      A[i][4 + j] = A[4 + j][i] = scaled(r, c) / length[c];
      b[4 + j] = F[c] / length[c];
    }
  }
  const Row<6> x = eliminate(A, b);
  return root.cwiseProduct(Vec<Real, 4>(x[0], x[1], x[2], x[3]));
}
template <class S>
Vec<Real, 4> kkt(const Mat<S, 4, 2>& R, const Vec2<S>& F, const Vec<S, 4>& W) {
  return kkt(Mat<Real, 4, 2>(R.template cast<Real>()), Vec<Real, 2>(F.template cast<Real>()),
             Vec<Real, 4>(W.template cast<Real>()));
}

template <class S>
Vec<S, 4> random_weight(Random& r, double decades) {
  Vec<S, 4> w;
  for (int i = 0; i < 4; ++i) w[i] = static_cast<S>(std::pow(10.0L, r.between(-decades, decades)));
  return w;
}

/// Any R: general columns, columns of very different size, and columns nearly parallel.
TYPED_TEST(Allocation, MinimumNormSolvesItsOptimalityConditions) {
  using S = TypeParam;
  Accuracy general("general"), sized("unequal_columns"), parallel("parallel_over_condition"),
      met("constraint");
  for (std::uint64_t seed = 0; seed < kCases; ++seed) {
    Random r(seed);
    const Vec<S, 4> u = r.vector<S, 4>(1), v = r.vector<S, 4>(1), w = random_weight<S>(r, 1);
    const Vec2<S> F = r.vector<S, 2>(5);
    const auto check = [&](Accuracy& a, const Mat<S, 4, 2>& R, Real condition) {
      const Vec<S, 4> tau = minimum_norm(R, F, w);
      a.take(seed, Accuracy::relative(tau, kkt(R, F, w)) / condition);
      const Vec<Real, 2> left = R.template cast<Real>().transpose() * tau.template cast<Real>();
      const Vec<Real, 2> size =
          R.template cast<Real>().cwiseAbs().transpose() * tau.template cast<Real>().cwiseAbs();
      met.take(seed, (left - F.template cast<Real>()).cwiseAbs().cwiseQuotient(size).maxCoeff());
    };
    // The condition that counts is that of W^-1/2 R with columns of unit length: 1 / sin of their angle, or
    // less.
    const auto condition_of = [&](const Mat<S, 4, 2>& R) {
      const Vec<Real, 4> root = w.template cast<Real>().cwiseSqrt().cwiseInverse();
      const Vec<Real, 4> a = root.cwiseProduct(R.col(0).template cast<Real>()).normalized();
      const Vec<Real, 4> b = root.cwiseProduct(R.col(1).template cast<Real>()).normalized();
      return 1 / (b - a * a.dot(b)).norm();
    };
    Mat<S, 4, 2> R;
    R << u, v;
    check(general, R, condition_of(R));
    const S big = static_cast<S>(std::pow(10.0L, r.between(-6, 6)));
    R << u, v * big;
    check(sized, R, condition_of(R));
    const S angle = static_cast<S>(
        std::pow(10.0L, r.between(std::is_same_v<S, float> ? -3 : -4, -1)));  // the oracle squares this
    R << u, u * S(r.sign()) * big + v * (angle * big);
    check(parallel, R, condition_of(R));
  }
  for (const Accuracy* a : {&general, &sized, &parallel}) a->expect_below(50 * kEpsilon<S>);
  met.expect_below(50 * kEpsilon<S>);
}

/// A long column that one motor has almost to itself: that motor must give next to nothing, and the small
/// difference of large terms would not meet the force of this column. Bound: products and sums of four terms
/// in three steps.
TYPED_TEST(Allocation, ALongColumnOfOneMotorMeetsItsForceToo) {
  using S = TypeParam;
  Accuracy met("constraint");
  for (std::uint64_t seed = 0; seed < kCases; ++seed) {
    Random r(seed);
    const int one = static_cast<int>(seed % 4);
    Vec<S, 4> lonely = r.vector<S, 4>(1e-3), other = r.vector<S, 4>(1);
    lonely[one] = S(r.sign());
    other[one] = static_cast<S>(r.sign() * r.between(0.5, 1));
    lonely *= static_cast<S>(std::pow(10.0L, r.between(2, 6)));
    const Vec2<S> F = r.vector<S, 2>(5);
    for (const bool first : {true, false}) {
      Mat<S, 4, 2> R;
      R << (first ? lonely : other), (first ? other : lonely);
      const Vec<S, 4> tau = minimum_norm(R, F, Vec<S, 4>(Vec<S, 4>::Ones()));
      const Vec<Real, 2> left = R.template cast<Real>().transpose() * tau.template cast<Real>();
      const Vec<Real, 2> size =
          R.template cast<Real>().cwiseAbs().transpose() * tau.template cast<Real>().cwiseAbs();
      met.take(seed, (left - F.template cast<Real>()).cwiseAbs().cwiseQuotient(size).maxCoeff());
    }
  }
  met.expect_below(12 * kEpsilon<S>);
}

/// Of columns of the same length the first counts as the longer one: twice as long, with twice the force, it
/// gives the same bits; the second gives others.
TYPED_TEST(Allocation, OfEqualColumnsTheFirstIsTheLonger) {
  using S = TypeParam;
  const Vec<S, 4> a(1, 2, 3, 4), b(-4, 1, 3, 2), even = Vec<S, 4>::Ones();  // both are sqrt(30) long
  int different = 0;
  for (std::uint64_t seed = 0; seed < 32; ++seed) {
    Random r(seed);
    const Vec2<S> F = r.vector<S, 2>(5);
    Mat<S, 4, 2> equal, first, second;
    equal << a, b;
    first << a * S(2), b;
    second << a, b * S(2);
    const Vec<S, 4> tau = minimum_norm(equal, F, even);
    EXPECT_EQ(tau, minimum_norm(first, Vec2<S>(S(2) * F[0], F[1]), even)) << "seed " << seed;
    different += tau != minimum_norm(second, Vec2<S>(F[0], S(2) * F[1]), even) ? 1 : 0;
  }
  EXPECT_GT(different, 0) << "the order does not show";
}

/// W and 4^n W have the same minimum, to the bit, down to the smallest normal number.
TYPED_TEST(Allocation, OnlyRatiosOfWeightsCount) {
  using S = TypeParam;
  Mat<S, 4, 2> R;
  R << S(1), S(-0.5), S(0.5), S(1), S(-0.25), S(0.25), S(0.125), S(0.5);
  const Vec2<S> F(300, -200);
  const Vec<S, 4> weight(S(1), S(1.5), S(2), S(1.25)), want = minimum_norm(R, F, weight);
  ASSERT_TRUE(want.allFinite());
  constexpr int lowest = std::numeric_limits<S>::min_exponent - 1;
  static_assert(lowest % 2 == 0);
  for (int exponent = lowest; exponent <= 0; exponent += 2) {
    EXPECT_EQ(minimum_norm(R, F, Vec<S, 4>(weight * std::ldexp(S(1), exponent))), want) << exponent;
  }
}

/// One, two or three motors all but forbidden by their weight: the others do the work, as accurately.
TYPED_TEST(Allocation, ExtremeWeights) {
  using S = TypeParam;
  const double top = std::is_same_v<S, float> ? 12 : 20;
  Accuracy error("error"), met("constraint"), unused("unused");
  for (std::uint64_t seed = 0; seed < kCases; ++seed) {
    Random r(seed);
    Mat<S, 4, 2> R;
    R << r.vector<S, 4>(1), r.vector<S, 4>(1);
    const Vec2<S> F = r.vector<S, 2>(5);
    Vec<S, 4> w = random_weight<S>(r, 0.5);
    const int heavy = 1 + static_cast<int>(seed % 2);
    for (int i = 0; i < heavy; ++i)
      w[(static_cast<int>(seed / 2) + i) % 4] *= static_cast<S>(std::pow(10.0L, r.between(4, top)));
    // Two motors are left, at least: judge by how well these two span the plane.
    int a = -1, b = -1;
    for (int i = 0; i < 4; ++i) {
      if (w[i] < S(100)) (a < 0 ? a : b) = i;
    }
    const Real span = std::fabs(Real(R(a, 0)) * Real(R(b, 1)) - Real(R(a, 1)) * Real(R(b, 0)));
    if (span < 0.1L) continue;
    const Vec<S, 4> tau = minimum_norm(R, F, w);
    error.compare(seed, tau, kkt(R, F, w));
    const Vec<Real, 2> left = R.template cast<Real>().transpose() * tau.template cast<Real>();
    met.take(seed, (left - F.template cast<Real>()).cwiseAbs().maxCoeff());
    for (int i = 0; i < 4; ++i) {
      if (w[i] > S(1e10)) unused.take(seed, std::fabs(Real(tau[i])));
    }
  }
  error.expect_below(500 * kEpsilon<S>);
  met.expect_below(500 * kEpsilon<S>);
  unused.expect_below(1e-6);
}

/// Three heavy motors: the last one alone cannot make two forces, so the heavy ones must help, however dear.
/// This is where the rows of W^-1/2 R are scaled worst, and Gram-Schmidt has no pivoting of rows.
TYPED_TEST(Allocation, ThreeHeavyMotorsStillMeetTheForce) {
  using S = TypeParam;
  Accuracy met("constraint");
  for (std::uint64_t seed = 0; seed < kCases; ++seed) {
    Random r(seed);
    Mat<S, 4, 2> R;
    R << r.vector<S, 4>(1), r.vector<S, 4>(1);
    const Vec2<S> F = r.vector<S, 2>(5);
    Vec<S, 4> w = random_weight<S>(r, 0.5);
    const S ratio = static_cast<S>(std::pow(10.0L, r.between(0, 4)));
    for (int i = 0; i < 3; ++i) w[(static_cast<int>(seed) + i) % 4] *= ratio;
    const Vec<S, 4> tau = minimum_norm(R, F, w);
    const Vec<Real, 2> left = R.template cast<Real>().transpose() * tau.template cast<Real>();
    const Real size = tau.template cast<Real>().cwiseAbs().maxCoeff() * std::sqrt(Real(ratio));
    met.take(seed, (left - F.template cast<Real>()).cwiseAbs().maxCoeff() / size);
  }
  met.expect_below(50 * kEpsilon<S>);
}

/// Joint rows of C^ or C^_a of the oracle.
template <class S>
Mat<Real, 4, 2> joint_rows(const FiveBarCase<S>& c, std::array<std::size_t, 2> known) {
  const auto C = c.C(known);
  Mat<Real, 4, 2> R;
  R << C.row(2), C.row(3), C.row(10), C.row(11);
  return R;
}

enum class Place { regular, near_type1, near_type2 };
template <class S>
FiveBarCase<S> case_at(Place place, std::uint64_t seed) {
  const double distance = std::pow(10.0, -1.0 - static_cast<double>((seed / 8) % 6));
  if (place == Place::near_type1) return random_five_bar<S>(seed, {.sin1 = distance, .from_base = true});
  if (place == Place::near_type2) return random_five_bar<S>(seed, {.min_sin1 = 0.3, .sin2 = distance});
  return random_five_bar<S>(seed);
}

TYPED_TEST(Allocation, AllMotorsOfAFiveBarInAllPlaces) {
  using S = TypeParam;
  using M = FiveBar<S>;
  for (const Place place : {Place::regular, Place::near_type1, Place::near_type2}) {
    const std::string name = place == Place::regular      ? "regular"
                             : place == Place::near_type1 ? "type1"
                                                          : "type2";
    Accuracy even(name + "_even"), weighted(name + "_weighted"), extreme(name + "_extreme");
    for (std::uint64_t seed = 0; seed < kCases; ++seed) {
      const auto c = case_at<S>(place, seed);
      const M m = c.mechanism();
      const auto pose =
          place == Place::near_type1 ? m.forward(c.base, c.mode.assembly) : m.inverse(c.position, c.mode);
      ASSERT_TRUE(pose) << "seed " << seed;
      Random r(~seed);
      const Vec<S, 18> w = r.vector<S, 18>(2);
      // Next to type 1 the base joints are the regular coordinates, elsewhere x and y are.
      const auto& by = place == Place::near_type1 ? FiveBarModel::by_base : FiveBarModel::by_effector;
      const Vec<Real, 2> F = c.C(by).transpose() * w.template cast<Real>();
      const auto R = joint_rows(c, by);
      const auto check = [&](Accuracy& a, const Vec<S, 4>& weight) {
        const Vec<S, 4> tau = allocate_all(m, *pose, w, weight);
        a.compare(seed, tau, kkt(R, F, Vec<Real, 4>(weight.template cast<Real>())));
      };
      check(even, Vec<S, 4>::Ones());
      check(weighted, random_weight<S>(r, 1));
      Vec<S, 4> some = random_weight<S>(r, 0.5);  // one motor as good as absent
      some[static_cast<int>(seed % 4)] *= S(1e8);
      if (place == Place::regular) check(extreme, some);
    }
    even.expect_below(1000 * kEpsilon<S>);
    weighted.expect_below(2000 * kEpsilon<S>);
    extreme.expect_below(5000 * kEpsilon<S>);
  }
}

/// Both forms are as well conditioned where |D2| is the smaller |sin theta_j2|; the documented one is taken,
/// so that the bits are. A pose by hand: bars 1 and 2 of leg 1 along x and y, those of leg 2 along y and x.
TYPED_TEST(Allocation, ATieIsWorkedOutInTheBaseJoints) {
  using S = TypeParam;
  using M = FiveBar<S>;
  typename M::Params params{};
  params.l0 = S(0.125);
  params.legs[0].l1 = S(0.25);
  params.legs[0].l2 = params.legs[1].l1 = S(0.375);
  params.legs[1].l2 = S(0.5);
  const M m(params);
  typename M::Pose p{};
  p.leg[0].axis[0] = p.leg[0].turn[0] = Vec2<S>(1, 0);
  p.leg[0].axis[1] = p.leg[0].turn[1] = Vec2<S>(0, 1);
  p.leg[1].axis[0] = p.leg[1].turn[0] = Vec2<S>(0, 1);
  p.leg[1].axis[1] = Vec2<S>(-1, 0);  // in the mirrored frame
  p.leg[1].turn[1] = Vec2<S>(0, 1);
  p.effector = Vec2<S>(S(0.375), S(0.375));
  p.sin_type2 = S(-1);
  ASSERT_TRUE((m.closure_residual(p).array() == S(0)).all());
  ASSERT_EQ(M::abs_sin_type2(p), M::min_abs_sin_type1(p));
  Mat<S, 4, 2> base, effector;
  for (int k = 0; k < 2; ++k) {
    const auto b = m.base_rates(p, Vec2<S>::Unit(k)), e = m.chain_rates(p, Vec2<S>::Unit(k));
    base.col(k) << b.leg[0], b.leg[1];
    effector.col(k) << e.leg[0], e.leg[1];
  }
  int different = 0;
  for (std::uint64_t seed = 0; seed < 32; ++seed) {
    Random r(seed);
    const Vec<S, 18> w = r.vector<S, 18>(2);
    const Vec<S, 4> weight = random_weight<S>(r, 1), tau = allocate_all(m, p, w, weight);
    EXPECT_EQ(tau, minimum_norm(base, m.base_torque(p, w), weight)) << "seed " << seed;
    different += tau != minimum_norm(effector, m.platform_force(p, w), weight) ? 1 : 0;
  }
  EXPECT_GT(different, 0) << "the two forms round alike: this pose shows nothing";
}

/// Two motors and four do the same to the mechanism, and four never cost more.
TYPED_TEST(Allocation, TwoAndFourMotorsMoveTheMechanismAlike) {
  using S = TypeParam;
  Accuracy same("acceleration"), force("force");
  for (std::uint64_t seed = 0; seed < 640; ++seed) {
    const auto c = random_tracking<S>(seed);
    const auto d = demand(LawKind::esmc, c.mechanism, c.gain, c.reaching, c.t);
    Random r(~seed);
    const Vec<S, 4> weight = random_weight<S>(r, 1);
    const Vec<S, 4> two = c.torque(d, false), four = c.torque(d, true, weight);
    const auto a = eigen(c.now.accelerate(two)), b = eigen(c.now.accelerate(four));
    const Real free = eigen(c.now.accelerate(Vec<S, 4>::Zero())).cwiseAbs().maxCoeff();
    same.compare(seed, b, a, free);
    const Mat<Real, 4, 2> R = joint_rows(c.now, FiveBarModel::by_effector);
    const Vec<Real, 2> f2 = R.transpose() * two.template cast<Real>(),
                       f4 = R.transpose() * four.template cast<Real>();
    force.compare(seed, f4, f2, (R.cwiseAbs().transpose() * two.template cast<Real>().cwiseAbs()).maxCoeff());
    const auto cost = [&](const Vec<S, 4>& tau) { return (tau.array().square() * weight.array()).sum(); };
    EXPECT_LE(cost(four), cost(two) * (1 + S(1000) * std::numeric_limits<S>::epsilon())) << "seed " << seed;
  }
  same.expect_below(2000 * kEpsilon<S>);
  force.expect_below(1000 * kEpsilon<S>);
}

}  // namespace
}  // namespace esmc::test
