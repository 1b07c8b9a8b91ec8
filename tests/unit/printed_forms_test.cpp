// The closed forms of model.md typed in cell by cell, [F3]-[F9] and [F12]-[F16], against what the modular
// algorithm yields. Bounds: the forms divide by l sin theta_2 with |sin theta_2| >= 0.1, and the closed forms
// cancel by themselves (l2 s1 c12 - lg2 c1 s12), so a few hundred epsilon relative to the largest entry.

#include <gtest/gtest.h>

#include <Eigen/LU>

#include "firmware/mechanism/matrices.hpp"
#include "tests/support/random_mechanism.hpp"

namespace esmc::test {
namespace {

constexpr std::uint64_t kCases = 800;
template <class S>
class PrintedForms : public testing::Test {};
TYPED_TEST_SUITE(PrintedForms, Scalars, ScalarName);

/// Sines and cosines of one leg, and its rates, under the names of model.md section 0.
template <class S>
struct Leg {
  LegParams<S> p;
  S c1, s1, c2, s2, c12, s12, w1, W;
  Leg(const LegParams<S>& params, S t1, S t2, S td1, S td2)
      : p(params),
        c1(std::cos(t1)),
        s1(std::sin(t1)),
        c2(std::cos(t2)),
        s2(std::sin(t2)),
        c12(std::cos(t1 + t2)),
        s12(std::sin(t1 + t2)),
        w1(td1),
        W(td1 + td2) {}

  [[nodiscard]] Mat<S, 6, 2> J_bars() const {  // script J of [F3]
    Mat<S, 6, 2> J;
    J << 1, 0, 1, 1,                    //
        -p.lg1 * s1, 0, p.lg1 * c1, 0,  //
        -p.l1 * s1 - p.lg2 * s12, -p.lg2 * s12, p.l1 * c1 + p.lg2 * c12, p.lg2 * c12;
    return J;
  }
  [[nodiscard]] Mat<S, 8, 2> C() const {
    Mat<S, 8, 2> out;
    out << Mat<S, 2, 2>::Identity(), J_bars();
    return out;
  }
  [[nodiscard]] Mat<S, 6, 8> A() const {
    Mat<S, 6, 8> out;
    out << J_bars(), -Mat<S, 6, 6>::Identity();
    return out;
  }
  [[nodiscard]] Vec<S, 6> b() const {  // [F4]
    Vec<S, 6> out;
    out << 0, 0, p.lg1 * c1 * w1 * w1, p.lg1 * s1 * w1 * w1, p.l1 * c1 * w1 * w1 + p.lg2 * c12 * W * W,
        p.l1 * s1 * w1 * w1 + p.lg2 * s12 * W * W;
    return out;
  }
  [[nodiscard]] Mat<S, 2, 2> J() const {
    Mat<S, 2, 2> out;
    out << -p.l1 * s1 - p.l2 * s12, -p.l2 * s12, p.l1 * c1 + p.l2 * c12, p.l2 * c12;
    return out;
  }
  [[nodiscard]] Mat<S, 2, 2> J_inverse() const {  // [F8]
    Mat<S, 2, 2> out;
    out << p.l2 * c12, p.l2 * s12, -(p.l1 * c1 + p.l2 * c12), -(p.l1 * s1 + p.l2 * s12);
    return out / (p.l1 * p.l2 * s2);
  }
  [[nodiscard]] Vec2<S> J_dot_rate() const {  // [F9]
    return -Vec2<S>(p.l1 * c1 * w1 * w1 + p.l2 * c12 * W * W, p.l1 * s1 * w1 * w1 + p.l2 * s12 * W * W);
  }
  /// Rows of this leg in [F13], sigma = +1 for leg 1, -1 for leg 2.
  [[nodiscard]] Mat<S, 8, 2> C_of_five_bar(S sigma) const {
    Mat<S, 8, 2> out;
    out << sigma * c12 / (p.l1 * s2), s12 / (p.l1 * s2),  //
        -sigma * (p.l1 * c1 + p.l2 * c12) / (p.l1 * p.l2 * s2),
        -(p.l1 * s1 + p.l2 * s12) / (p.l1 * p.l2 * s2),                            //
        sigma * c12 / (p.l1 * s2), s12 / (p.l1 * s2),                              //
        -sigma * c1 / (p.l2 * s2), -s1 / (p.l2 * s2),                              //
        -sigma * p.lg1 * s1 * c12 / (p.l1 * s2), -p.lg1 * s1 * s12 / (p.l1 * s2),  //
        sigma * p.lg1 * c1 * c12 / (p.l1 * s2), p.lg1 * c1 * s12 / (p.l1 * s2),    //
        -sigma * (p.l2 * s1 * c12 - p.lg2 * c1 * s12) / (p.l2 * s2),
        -(p.l2 - p.lg2) * s1 * s12 / (p.l2 * s2),  //
        sigma * (p.l2 - p.lg2) * c1 * c12 / (p.l2 * s2), (p.l2 * c1 * s12 - p.lg2 * s1 * c12) / (p.l2 * s2);
    return out;
  }
};

TYPED_TEST(PrintedForms, RrArm) {
  using S = TypeParam;
  const Real eps = kEpsilon<S>;
  Accuracy C("C"), A("A"), b("b"), c("c"), H("H"), h("h"), J("J"), Ji("J_inverse"), Jd("J_dot"), tip("tip"),
      det("det");
  Accuracy M("M"), f("f_and_g");
  for (std::uint64_t seed = 0; seed < kCases; ++seed) {
    const auto k = random_rr<S>(seed, 0.1);
    const Rr<S> m = k.mechanism();
    const auto pose = m.pose(k.theta);
    const LegParams<S>& p = k.params.arm;
    const S td1 = k.rate[0], td2 = k.rate[1], g = k.params.g;
    const Leg<S> l(p, k.theta[0], k.theta[1], td1, td2);
    C.compare(seed, matrix_C(m, pose), l.C());
    A.compare(seed, matrix_A(m, pose), l.A());
    b.compare(seed, vector_b(m, pose, k.rate), l.b());
    Vec<S, 8> bias_want;
    bias_want << 0, 0, -l.b();
    c.compare(seed, bias(m, pose, k.rate), bias_want);
    Vec<S, 8> mass;
    mass << 0, 0, p.J1, p.J2, p.m1, p.m1, p.m2, p.m2;
    M.compare(seed, m.mass(), mass);
    Vec<S, 8> resist;
    const auto sgn = [](S v) { return S(v > 0) - S(v < 0); };
    const S f1 = p.d1 * td1 + p.gamma1 * sgn(td1), f2 = p.d2 * td2 + p.gamma2 * sgn(td2);
    resist << f1, f2, 0, 0, 0, p.m1 * g, 0, p.m2 * g;
    f.compare(seed, m.force(Vec<S, 8>::Zero(), k.rate), resist, 1e-9L);
    // [F6], [F7]
    const S beta = p.m2 * p.l1 * p.lg2, delta = p.J2 + p.m2 * p.lg2 * p.lg2;
    const S alpha = p.J1 + p.m1 * p.lg1 * p.lg1 + p.J2 + p.m2 * (p.l1 * p.l1 + p.lg2 * p.lg2);
    Mat<S, 2, 2> Hw;
    Hw << alpha + 2 * beta * l.c2, delta + beta * l.c2, delta + beta * l.c2, delta;
    H.compare(seed, mass_matrix(m, matrix_C(m, pose)), Hw);
    const Vec2<S> hw(-beta * l.s2 * (2 * td1 * td2 + td2 * td2) +
                         g * ((p.m1 * p.lg1 + p.m2 * p.l1) * l.c1 + p.m2 * p.lg2 * l.c12) + f1,
                     beta * l.s2 * td1 * td1 + g * p.m2 * p.lg2 * l.c12 + f2);
    h.compare(seed, m.base_torque(pose, m.force(bias(m, pose, k.rate), k.rate)), hw,
              std::fabs(Real(beta)) * 36);
    Mat<S, 2, 2> Jg, Jig;
    for (int i = 0; i < 2; ++i) {
      Jg.col(i) = m.tip_rate(pose, Vec2<S>::Unit(i));
      Jig.col(i) = m.rates_of_effector(pose, Vec2<S>::Unit(i));
    }
    J.compare(seed, Jg, l.J());
    Ji.compare(seed, Jig, l.J_inverse());
    det.take(seed, std::fabs(Real(Jg.determinant()) / (Real(p.l1) * Real(p.l2)) - Real(m.sin_type1(pose))));
    const Vec2<S> none = m.accelerations_of_effector(pose, k.rate, Vec2<S>::Zero());
    Jd.compare(seed, (Jg * none).eval(), (-l.J_dot_rate()).eval(), Real(none.cwiseAbs().maxCoeff()));
    tip.compare(seed, pose.effector, Vec2<S>(p.l1 * l.c1 + p.l2 * l.c12, p.l1 * l.s1 + p.l2 * l.s12), 0.1L);
  }
  for (const Accuracy* x : {&C, &A, &b, &c, &H, &h, &J, &tip, &det, &Jd}) x->expect_below(50 * eps);
  Ji.expect_below(100 * eps);
  M.expect_below(0);
  f.expect_below(0);
}

TYPED_TEST(PrintedForms, FiveBar) {
  using S = TypeParam;
  const Real eps = kEpsilon<S>;
  Accuracy Chat("Chat"), C("C"), A("A"), b("b"), c("c"), M("M"), f("f_and_g");
  for (std::uint64_t seed = 0; seed < kCases; ++seed) {
    const auto k = random_five_bar<S>(seed, {.min_sin1 = 0.1, .min_sin2 = 0.01});
    const FiveBar<S> m = k.mechanism();
    const auto pose = m.pose(k.theta);
    const auto rates = m.chain_rates(pose, k.velocity);
    const std::array<Leg<S>, 2> leg{
        Leg<S>(k.params.legs[0], k.theta[0], k.theta[1], rates.leg[0][0], rates.leg[0][1]),
        Leg<S>(k.params.legs[1], k.theta[2], k.theta[3], rates.leg[1][0], rates.leg[1][1])};
    const S g = k.params.g;
    const auto& [l1, l2] = leg;

    Mat<S, 6, 2> Chat_want;                                      // [F12]
    Chat_want << 1, 0, 0, 1,                                     //
        l1.c12 / (l1.p.l1 * l1.s2), l1.s12 / (l1.p.l1 * l1.s2),  //
        -(l1.p.l1 * l1.c1 + l1.p.l2 * l1.c12) / (l1.p.l1 * l1.p.l2 * l1.s2),
        -(l1.p.l1 * l1.s1 + l1.p.l2 * l1.s12) / (l1.p.l1 * l1.p.l2 * l1.s2),  //
        -l2.c12 / (l2.p.l1 * l2.s2), l2.s12 / (l2.p.l1 * l2.s2),              //
        (l2.p.l1 * l2.c1 + l2.p.l2 * l2.c12) / (l2.p.l1 * l2.p.l2 * l2.s2),
        -(l2.p.l1 * l2.s1 + l2.p.l2 * l2.s12) / (l2.p.l1 * l2.p.l2 * l2.s2);
    Chat.compare(seed, matrix_Chat(m, pose), Chat_want);
    Mat<S, 18, 2> C_want;  // [F13]
    C_want << Mat<S, 2, 2>::Identity(), l1.C_of_five_bar(S(1)), l2.C_of_five_bar(S(-1));
    C.compare(seed, matrix_C(m, pose), C_want);

    Mat<S, 16, 18> A_want = Mat<S, 16, 18>::Zero();  // [F14]
    A_want.template block<6, 8>(0, 2) = l1.A();
    A_want.template block<6, 8>(6, 10) = l2.A();
    A_want(12, 0) = A_want(13, 1) = A_want(14, 0) = A_want(15, 1) = 1;
    A_want(12, 2) = l1.p.l1 * l1.s1 + l1.p.l2 * l1.s12;
    A_want(12, 3) = l1.p.l2 * l1.s12;
    A_want(13, 2) = -(l1.p.l1 * l1.c1 + l1.p.l2 * l1.c12);
    A_want(13, 3) = -l1.p.l2 * l1.c12;
    A_want(14, 10) = -(l2.p.l1 * l2.s1 + l2.p.l2 * l2.s12);
    A_want(14, 11) = -l2.p.l2 * l2.s12;
    A_want(15, 10) = -(l2.p.l1 * l2.c1 + l2.p.l2 * l2.c12);
    A_want(15, 11) = -l2.p.l2 * l2.c12;
    A.compare(seed, matrix_A(m, pose), A_want);

    Vec<S, 16> b_want;         // [F15]
    b_want << l1.b(), l2.b(),  //
        -(l1.p.l1 * l1.c1 * l1.w1 * l1.w1 + l1.p.l2 * l1.c12 * l1.W * l1.W),
        -(l1.p.l1 * l1.s1 * l1.w1 * l1.w1 + l1.p.l2 * l1.s12 * l1.W * l1.W),
        l2.p.l1 * l2.c1 * l2.w1 * l2.w1 + l2.p.l2 * l2.c12 * l2.W * l2.W,
        -(l2.p.l1 * l2.s1 * l2.w1 * l2.w1 + l2.p.l2 * l2.s12 * l2.W * l2.W);
    b.compare(seed, vector_b(m, pose, rates), b_want);
    Vec<S, 18> c_want;  // [F16]
    c_want.template head<2>().setZero();
    for (int j = 0; j < 2; ++j) {
      const auto& l = leg[static_cast<unsigned>(j)];
      const Vec2<S> acceleration = -l.J_inverse() * l.J_dot_rate();
      c_want.template segment<8>(2 + 8 * j) = l.C() * acceleration;
      c_want.template segment<6>(4 + 8 * j) -= l.b();
    }
    c.compare(seed, bias(m, pose, rates), c_want, Real(b_want.cwiseAbs().maxCoeff()));

    Vec<S, 18> M_want, f_want;
    const auto sgn = [](S v) { return S(v > 0) - S(v < 0); };
    M_want << k.params.m0, k.params.m0, 0, 0, l1.p.J1, l1.p.J2, l1.p.m1, l1.p.m1, l1.p.m2, l1.p.m2,  //
        0, 0, l2.p.J1, l2.p.J2, l2.p.m1, l2.p.m1, l2.p.m2, l2.p.m2;
    M.compare(seed, m.mass(), M_want);
    f_want << 0, k.params.m0 * g, 0, 0, 0, 0, 0, l1.p.m1 * g, 0, l1.p.m2 * g, 0, 0, 0, 0, 0, l2.p.m1 * g, 0,
        l2.p.m2 * g;
    for (int j = 0; j < 2; ++j) {
      const auto& p = leg[static_cast<unsigned>(j)].p;
      const Vec2<S> r = rates.leg[j];
      f_want[2 + 8 * j] = p.d1 * r[0] + p.gamma1 * sgn(r[0]);
      f_want[3 + 8 * j] = p.d2 * r[1] + p.gamma2 * sgn(r[1]);
    }
    f.compare(seed, m.force(Vec<S, 18>::Zero(), rates), f_want, 1e-9L);
  }
  for (const Accuracy* x : {&A, &b}) x->expect_below(30 * eps);
  for (const Accuracy* x : {&Chat, &C}) x->expect_below(100 * eps);
  c.expect_below(500 * eps);
  M.expect_below(0);
  f.expect_below(0);
}

/// sign(0) = 0 in the friction, model.md section 12; a NaN rate must not become a quiet zero.
TYPED_TEST(PrintedForms, CoulombFrictionIsZeroAtRestAndNotSilentAboutNaN) {
  using S = TypeParam;
  const auto k = random_rr<S>(3);
  LegParams<S> p = k.params.arm;
  p.gamma1 = p.gamma2 = S(1);
  p.d1 = p.d2 = S(0);
  const Dyad<S> d = make_dyad(p, S(0));
  const auto friction = [&](S rate) { return d.force(Vec<S, 8>::Zero(), Vec2<S>(rate, S(0)))[0]; };
  EXPECT_EQ(friction(S(0)), S(0));
  EXPECT_EQ(friction(-S(0)), S(0));
  EXPECT_EQ(friction(std::numeric_limits<S>::denorm_min()), S(1));
  EXPECT_EQ(friction(-std::numeric_limits<S>::denorm_min()), S(-1));
  EXPECT_TRUE(std::isnan(friction(std::numeric_limits<S>::quiet_NaN())));
}

}  // namespace
}  // namespace esmc::test
