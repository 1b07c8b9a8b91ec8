// Dynamics of both mechanisms against the Lagrange oracle of tests/support/lagrange.hpp, in every working and
// assembly mode, with legs that differ. Printed closed forms: printed_forms_test.cpp; kinematics:
// kinematics_test.cpp.
//
// Bounds are multiples of epsilon. At |sin theta_j2|, |D2| >= 0.2 one division by the sine costs a factor 5,
// H and what is solved with it two, and lengths and masses that differ by up to 4 and 20 the rest; the
// multiples are 3 to 10 times the worst error of 800 cases.

#include <gtest/gtest.h>

#include <Eigen/LU>

#include "firmware/mechanism/matrices.hpp"
#include "tests/support/random_mechanism.hpp"

namespace esmc::test {
namespace {

constexpr std::uint64_t kCases = 800;

template <class S>
class Dynamics : public testing::Test {};
TYPED_TEST_SUITE(Dynamics, Scalars, ScalarName);

template <class S>
struct Moving {
  FiveBar<S> m;
  typename FiveBar<S>::Pose pose;
  typename FiveBar<S>::Rates rates;
};

/// Pose and rates as the firmware finds them: from the exact inputs, or from all four rounded joint angles.
template <class S>
Moving<S> move(const FiveBarCase<S>& c, bool by_angles = false) {
  Moving<S> out{c.mechanism(), {}, {}};
  const auto inverse = out.m.inverse(c.position, c.mode);
  EXPECT_TRUE(inverse) << "seed " << c.seed;
  if (!inverse) return out;
  out.pose = by_angles ? out.m.pose(c.theta) : *inverse;
  out.rates = out.m.chain_rates(out.pose, c.velocity);
  return out;
}
template <class S>
Moving<S> move_base(const FiveBarCase<S>& c) {
  Moving<S> out{c.mechanism(), {}, {}};
  const auto forward = out.m.forward(c.base, c.mode.assembly);
  EXPECT_TRUE(forward) << "seed " << c.seed;
  if (!forward) return out;
  out.pose = *forward;
  out.rates = out.m.base_rates(out.pose, c.base_rate);
  return out;
}

template <class S>
Mat<Real, 2, 2> quadratic(const Mat<Real, 18, 2>& C, const FiveBarCase<S>& c) {
  return C.transpose() * c.mass().asDiagonal() * C;
}
template <class S>
List<Vec2<S>, 2> by_leg(const Vec<S, 4>& tau) {
  return {{tau.template head<2>(), tau.template tail<2>()}};
}

TYPED_TEST(Dynamics, RatesAndBiasAreTheDerivativesOfThePositions) {
  using S = TypeParam;
  const Real eps = kEpsilon<S>;
  Accuracy C("C"), C_base("C_base"), p("rates"), bias_c("bias"), pdot("accelerations"), zero("AC"), Ap("A_p"),
      b("b"), adot("A_pdot_minus_b");
  for (std::uint64_t seed = 0; seed < kCases; ++seed) {
    const auto c = random_five_bar<S>(seed);
    const Moving<S> s = move(c, (seed & 8U) != 0U);
    Random r(~seed);
    const Mat<S, 18, 2> Cs = matrix_C(s.m, s.pose);
    C.compare(seed, Cs, c.C());
    C_base.compare(seed, matrix_C_base(s.m, s.pose), c.C(FiveBarModel::by_base));
    p.compare(seed, s.m.channel_rates(s.pose, s.rates), c.rates());
    const auto rest = c.oracle.accelerations(c.q, c.qd, c.qd, FiveBarModel::by_effector, 0, 0);
    bias_c.compare(seed, bias(s.m, s.pose, s.rates), c.accelerations(rest));
    const Vec2<S> a = r.vector<S, 2>(10);
    const Vec<Real, 18> want = c.accelerations(
        c.oracle.accelerations(c.q, c.qd, c.qd, FiveBarModel::by_effector, Real(a[0]), Real(a[1])));
    pdot.compare(
        seed, s.m.channel_accelerations(s.pose, s.rates, s.m.chain_accelerations(s.pose, s.rates, a)), want);
    // A in the firmware's scalar, what it multiplies from the oracle: nothing can cancel a common error.
    const Mat<Real, 16, 18> A = matrix_A(s.m, s.pose).template cast<Real>();
    const Vec<Real, 16> bs = vector_b(s.m, s.pose, s.rates).template cast<Real>();
    const Mat<Real, 18, 2> Co = c.C();
    zero.take(seed, (A * Co).cwiseAbs().maxCoeff() / Co.cwiseAbs().maxCoeff());
    Ap.take(seed, (A * c.rates()).cwiseAbs().maxCoeff() / c.rates().cwiseAbs().maxCoeff());
    const Vec<Real, 16> product = A * want;
    b.compare(seed, bs, product, want.cwiseAbs().maxCoeff());
    adot.take(seed, (A * c.accelerations(rest) - bs).cwiseAbs().maxCoeff() / bs.cwiseAbs().maxCoeff());
  }
  for (const Accuracy* x : {&C, &C_base, &p}) x->expect_below(200 * eps);
  for (const Accuracy* x : {&bias_c, &pdot, &b, &adot}) x->expect_below(1000 * eps);
  zero.expect_below(20 * eps);
  Ap.expect_below(20 * eps);
}

TYPED_TEST(Dynamics, InertiaAndForcesAgreeInAllForms) {
  using S = TypeParam;
  const Real eps = kEpsilon<S>;
  Accuracy H("H"), legwise("H_legwise"), based("H_base"), congruent("H_base_congruent"), h("h"),
      h_based("h_base");
  for (std::uint64_t seed = 0; seed < kCases; ++seed) {
    const auto c = random_five_bar<S>(seed);
    const Moving<S> s = move(c);
    const Mat<S, 18, 2> C = matrix_C(s.m, s.pose), Ca = matrix_C_base(s.m, s.pose);
    const Mat<S, 2, 2> Hs = mass_matrix(s.m, C), Ha = mass_matrix(s.m, Ca);
    const Mat<Real, 2, 2> want = quadratic(c.C(), c);
    H.compare(seed, Hs, want);
    based.compare(seed, Ha, quadratic(c.C(FiveBarModel::by_base), c));

    // [F21] leg by leg: H_j of [F6], J_j^-1 of [F8], all written out here.
    Mat<S, 2, 2> H_sum = Mat<S, 2, 2>::Identity() * c.params.m0;
    Mat<S, 2, 2> B;
    for (int j = 0; j < 2; ++j) {
      const LegParams<S>& l = c.params.legs[static_cast<unsigned>(j)];
      const S t1 = c.theta[2 * j], t2 = c.theta[2 * j + 1], c12 = std::cos(t1 + t2), s12 = std::sin(t1 + t2);
      const S beta = l.m2 * l.l1 * l.lg2, delta = l.J2 + l.m2 * l.lg2 * l.lg2;
      const S alpha = l.J1 + l.m1 * l.lg1 * l.lg1 + l.J2 + l.m2 * (l.l1 * l.l1 + l.lg2 * l.lg2);
      Mat<S, 2, 2> Hj, Ji;
      Hj << alpha + 2 * beta * std::cos(t2), delta + beta * std::cos(t2), delta + beta * std::cos(t2), delta;
      Ji << l.l2 * c12, l.l2 * s12, -(l.l1 * std::cos(t1) + l.l2 * c12), -(l.l1 * std::sin(t1) + l.l2 * s12);
      Ji /= l.l1 * l.l2 * std::sin(t2);
      if (j == 1) Ji.col(0) = -Ji.col(0).eval();
      H_sum += Ji.transpose() * Hj * Ji;
      B.row(j) = Ji.row(0);
    }
    legwise.compare(seed, H_sum, want);
    const Mat<Real, 2, 2> Bi = B.template cast<Real>().inverse();
    congruent.compare(seed, Ha, (Bi.transpose() * want * Bi).eval());

    // h = C^T (M c + f + g): what the motors must hold at xdd = 0, so h = H a of an oracle at rest of force:
    // accelerating by a under no torque means H a + h = 0.
    const auto free = c.oracle.accelerate(c.q, c.qd, {});
    const Vec<Real, 2> a(free[0], free[1]);
    const Vec2<S> hs = gather<FiveBar<S>>(C, s.m.force(bias(s.m, s.pose, s.rates), s.rates));
    h.compare(seed, hs, (-(want * a)).eval());
    const auto c_base =
        s.m.channel_accelerations(s.pose, s.rates, s.m.base_accelerations(s.pose, s.rates, Vec2<S>::Zero()));
    const Vec2<S> ha = gather<FiveBar<S>>(Ca, s.m.force(c_base, s.rates));
    const Vec<Real, 2> aa(free[2], -free[4]);
    h_based.compare(seed, ha, (-(quadratic(c.C(FiveBarModel::by_base), c) * aa)).eval());
    // The recursions that form no matrix give the same.
    EXPECT_LE(
        static_cast<double>(Accuracy::relative(s.m.base_torque(s.pose, s.m.force(c_base, s.rates)), ha)),
        300 * eps)
        << "seed " << seed;
    EXPECT_LE(static_cast<double>(Accuracy::relative(
                  s.m.platform_force(s.pose, s.m.force(bias(s.m, s.pose, s.rates), s.rates)), hs)),
              300 * eps)
        << "seed " << seed;
  }
  H.expect_below(200 * eps);
  legwise.expect_below(1000 * eps);
  based.expect_below(200 * eps);
  congruent.expect_below(1000 * eps);
  h.expect_below(5000 * eps);  // h may cancel
  h_based.expect_below(5000 * eps);
}

/// Forward dynamics in one form: accelerations of all channels under torques at all joints.
template <class S>
Vec<S, 18> forward_dynamics(const Moving<S>& s, const Vec<S, 4>& tau, bool base_form) {
  if (base_form) {
    const auto c =
        s.m.channel_accelerations(s.pose, s.rates, s.m.base_accelerations(s.pose, s.rates, Vec2<S>::Zero()));
    const Vec2<S> F = s.m.gather_on_base(s.pose, Vec2<S>::Zero(), by_leg(tau)) -
                      s.m.base_torque(s.pose, s.m.force(c, s.rates));
    const Vec2<S> a = solve_spd<S>(mass_matrix(s.m, matrix_C_base(s.m, s.pose)), F);
    return s.m.channel_accelerations(s.pose, s.rates, s.m.base_accelerations(s.pose, s.rates, a));
  }
  const Vec<S, 18> c = bias(s.m, s.pose, s.rates);
  const Vec2<S> F =
      s.m.gather(s.pose, Vec2<S>::Zero(), by_leg(tau)) - s.m.platform_force(s.pose, s.m.force(c, s.rates));
  const Vec2<S> a = solve_spd<S>(mass_matrix(s.m, matrix_C(s.m, s.pose)), F);
  return s.m.channel_accelerations(s.pose, s.rates, s.m.chain_accelerations(s.pose, s.rates, a));
}

TYPED_TEST(Dynamics, ForwardDynamicsIsLagrangeAndInverseDynamicsUndoesIt) {
  using S = TypeParam;
  Accuracy xy("forward_xy"), base("forward_base"), torque2("inverse_2"), force4("inverse_4");
  for (std::uint64_t seed = 0; seed < kCases; ++seed) {
    const auto c = random_five_bar<S>(seed);
    const Moving<S> s = move(c);
    Random r(~seed);
    Vec<S, 4> tau = r.vector<S, 4>(3);
    const Vec<Real, 18> want = c.accelerations(c.accelerate(tau));
    const Real free = c.accelerations(c.accelerate(Vec<S, 4>::Zero())).cwiseAbs().maxCoeff();
    xy.compare(seed, forward_dynamics(s, tau, false), want, free);
    base.compare(seed, forward_dynamics(s, tau, true), want, free);

    // Inverse of what the oracle did.
    const Vec<S, 18> pdot = want.template cast<S>();
    force4.compare(seed, s.m.platform_force(s.pose, s.m.force(pdot, s.rates)),
                   s.m.gather(s.pose, Vec2<S>::Zero(), by_leg(tau)));
    tau[1] = tau[3] = S(0);
    const Vec<S, 18> driven = c.accelerations(c.accelerate(tau)).template cast<S>();
    torque2.compare(seed, s.m.base_torque(s.pose, s.m.force(driven, s.rates)), Vec2<S>(tau[0], tau[2]));
  }
  for (const Accuracy* a : {&xy, &base}) a->expect_below(800 * kEpsilon<S>);
  for (const Accuracy* a : {&torque2, &force4})
    a->expect_below(4000 * kEpsilon<S>);  // the given torque may be small
}

/// Distances to a singularity: 0.1 down to 1e-6, a decade of cases each.
double distance_of(std::uint64_t seed) { return std::pow(10.0, -1.0 - static_cast<double>((seed / 8) % 6)); }

TYPED_TEST(Dynamics, BaseJointFormIsRegularNextToType1) {
  using S = TypeParam;
  Accuracy C("C_base"), H("H_base"), forward("forward"), torque("inverse_2"), rate("rates");
  for (std::uint64_t seed = 0; seed < kCases; ++seed) {
    const auto c = random_five_bar<S>(
        seed, {.min_sin1 = 0.2, .min_sin2 = 0.2, .sin1 = distance_of(seed), .from_base = true});
    const Moving<S> s = move_base(c);
    Random r(~seed);
    const Mat<Real, 18, 2> Ca = c.C(FiveBarModel::by_base);
    C.compare(seed, matrix_C_base(s.m, s.pose), Ca);
    H.compare(seed, mass_matrix(s.m, matrix_C_base(s.m, s.pose)), quadratic(Ca, c));
    rate.compare(seed, s.m.channel_rates(s.pose, s.rates), c.rates());
    Vec<S, 4> tau = r.vector<S, 4>(3);
    const Real free = c.accelerations(c.accelerate(Vec<S, 4>::Zero())).cwiseAbs().maxCoeff();
    forward.compare(seed, forward_dynamics(s, tau, true), c.accelerations(c.accelerate(tau)), free);
    tau[1] = tau[3] = S(0);
    const Vec<S, 18> driven = c.accelerations(c.accelerate(tau)).template cast<S>();
    torque.compare(seed, s.m.base_torque(s.pose, s.m.force(driven, s.rates)), Vec2<S>(tau[0], tau[2]));
  }
  for (const Accuracy* a : {&C, &H, &rate}) a->expect_below(500 * kEpsilon<S>);
  forward.expect_below(1000 * kEpsilon<S>);
  torque.expect_below(8000 * kEpsilon<S>);
}

TYPED_TEST(Dynamics, EffectorFormIsRegularNextToType2) {
  using S = TypeParam;
  Accuracy C("C"), H("H"), forward("forward"), force("inverse_4");
  for (std::uint64_t seed = 0; seed < kCases; ++seed) {
    const auto c = random_five_bar<S>(seed, {.min_sin1 = 0.3, .sin2 = distance_of(seed)});
    const Moving<S> s = move(c);
    Random r(~seed);
    C.compare(seed, matrix_C(s.m, s.pose), c.C());
    H.compare(seed, mass_matrix(s.m, matrix_C(s.m, s.pose)), quadratic(c.C(), c));
    const Vec<S, 4> tau = r.vector<S, 4>(3);
    const Vec<Real, 18> want = c.accelerations(c.accelerate(tau));
    const Real free = c.accelerations(c.accelerate(Vec<S, 4>::Zero())).cwiseAbs().maxCoeff();
    forward.compare(seed, forward_dynamics(s, tau, false), want, free);
    const Vec<S, 18> pdot = want.template cast<S>();
    force.compare(seed, s.m.platform_force(s.pose, s.m.force(pdot, s.rates)),
                  s.m.gather(s.pose, Vec2<S>::Zero(), by_leg(tau)));
  }
  for (const Accuracy* a : {&C, &H}) a->expect_below(500 * kEpsilon<S>);
  for (const Accuracy* a : {&forward, &force}) a->expect_below(2000 * kEpsilon<S>);
}

TYPED_TEST(Dynamics, RrArmIsLagrange) {
  using S = TypeParam;
  Accuracy C("C"), c("bias"), H("H"), h("h"), forward("forward"), inverse("inverse");
  for (std::uint64_t seed = 0; seed < kCases; ++seed) {
    const auto k = random_rr<S>(seed, 0.0);
    const Rr<S> m = k.mechanism();
    const auto pose = m.pose(k.theta);
    Random r(~seed);
    Mat<Real, 8, 2> Co;
    for (int i = 0; i < 2; ++i)
      Co.col(i) = eigen(channel_rates(k.oracle, k.q, Row<2>{i == 0 ? 1.0L : 0.0L, i == 0 ? 0.0L : 1.0L}));
    C.compare(seed, matrix_C(m, pose), Co);
    c.compare(seed, bias(m, pose, k.rate), eigen(channel_accelerations(k.oracle, k.q, k.qd, k.qd, {})));
    const auto eq = lagrange(k.oracle, k.q, k.qd);
    Mat<Real, 2, 2> Ho;
    Ho << eq.mass[0][0], eq.mass[0][1], eq.mass[1][0], eq.mass[1][1];
    const Mat<S, 2, 2> Hs = mass_matrix(m, matrix_C(m, pose));
    H.compare(seed, Hs, Ho);
    Vec<Real, 2> ho = eigen(eq.rest);
    for (int i = 0; i < 2; ++i)
      ho[i] += resist(k.oracle.bar[static_cast<unsigned>(i)], k.qd[static_cast<unsigned>(i)]);
    const Vec2<S> hs = m.base_torque(pose, m.force(bias(m, pose, k.rate), k.rate));
    h.compare(seed, hs, ho);
    const Vec2<S> tau = r.vector<S, 2>(3);
    const Row<2> want = k.oracle.accelerate(k.q, k.qd, {Real(tau[0]), Real(tau[1])});
    const Vec2<S> a = solve_spd<S>(Hs, tau - hs);
    forward.compare(seed, a, eigen(want), eigen(k.oracle.accelerate(k.q, k.qd, {})).cwiseAbs().maxCoeff());
    const Vec<S, 8> pdot = eigen(channel_accelerations(k.oracle, k.q, k.qd, k.qd, want)).template cast<S>();
    inverse.compare(seed, m.base_torque(pose, m.force(pdot, k.rate)), tau);
  }
  for (const Accuracy* a : {&C, &c, &H}) a->expect_below(30 * kEpsilon<S>);
  for (const Accuracy* a : {&h, &forward, &inverse}) a->expect_below(500 * kEpsilon<S>);
}

/// check() accepts every legal mechanism drawn here and refuses each single defect, NaN and infinity among
/// them.
TYPED_TEST(Dynamics, ParametersAreCheckedOneByOne) {
  using S = TypeParam;
  using L = LegParams<S>;
  using Limits = std::numeric_limits<S>;
  for (std::uint64_t seed = 0; seed < kCases; ++seed) {
    Random r(seed);
    const FiveBarParams<S> good = random_five_bar_params<S>(r);
    ASSERT_EQ(check(good), ParamError::none) << "seed " << seed;
    ASSERT_EQ(check(RrParams<S>{good.legs[0], good.g}), ParamError::none) << "seed " << seed;
    const auto refused = [&](S L::*field, S value, ParamError why) {
      for (const unsigned leg : {0U, 1U}) {
        auto bad = good;
        bad.legs[leg].*field = value;
        EXPECT_EQ(check(bad), why) << "seed " << seed << " leg " << leg << " value " << value;
        EXPECT_EQ(check(RrParams<S>{bad.legs[leg], good.g}), why) << "seed " << seed << " value " << value;
      }
    };
    for (const S v : {Limits::quiet_NaN(), Limits::infinity(), -Limits::infinity(), Limits::max()}) {
      for (const auto field : {&L::l1, &L::l2}) refused(field, v, ParamError::link_length);
      for (const auto field : {&L::m1, &L::m2}) refused(field, v, ParamError::mass);
      for (const auto field : {&L::J1, &L::J2}) refused(field, v, ParamError::inertia);
      for (const auto field : {&L::lg1, &L::lg2}) refused(field, v, ParamError::mass_centre);
      for (const auto field : {&L::d1, &L::d2, &L::gamma1, &L::gamma2})
        refused(field, v, ParamError::friction);
      auto bad = good;
      bad.l0 = v;
      EXPECT_EQ(check(bad), ParamError::link_length);
      bad = good;
      bad.m0 = v;
      EXPECT_EQ(check(bad), ParamError::mass);
      bad = good;
      bad.g = v;
      EXPECT_EQ(check(bad), ParamError::gravity);
    }
    for (const S v : {S(0), S(-0.1)}) refused(&L::l1, v, ParamError::link_length);
    for (const auto field : {&L::m1, &L::m2}) refused(field, S(-1e-6), ParamError::mass);
    for (const auto field : {&L::J1, &L::J2}) refused(field, S(-1e-6), ParamError::inertia);
    auto weightless = good;  // an outer bar that nothing keeps from turning
    weightless.legs[1].m2 = weightless.legs[1].J2 = S(0);
    EXPECT_EQ(check(weightless), ParamError::no_inertia);
  }
}

}  // namespace
}  // namespace esmc::test
