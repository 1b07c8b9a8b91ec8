// What the control laws promise, tested on the ORACLE's dynamics (tests/support/lagrange.hpp): the firmware
// gives torques, Lagrange's equations give the accelerations, and the promised identity must hold among
// those. A common error of law and model cannot cancel. Reaching functions alone: reaching_test.cpp.
//
// Bounds: relative to the sum of the magnitudes of the terms that cancel in an identity; torques lose the
// condition of IK and of B at |sin theta_j2|, |D2| >= 0.3, and what the oracle then accelerates loses
// cond(H): 1e3 to 1e4 epsilon, which is 1e-12 in double (asked for: 1e-9).

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "firmware/mechanism/matrices.hpp"
#include "tests/support/tracking.hpp"

namespace esmc::test {
namespace {

constexpr std::uint64_t kCases = 640;
template <class S>
class Laws : public testing::Test {};
TYPED_TEST_SUITE(Laws, Scalars, ScalarName);

template <class S>
Vec<S, 4> random_weight(std::uint64_t seed) {
  Random r(seed + 77);
  Vec<S, 4> w;
  for (int i = 0; i < 4; ++i) w[i] = static_cast<S>(std::pow(10.0L, r.between(-1, 1)));
  return w;
}

/// Layers of 1 can be divided by.
TYPED_TEST(Laws, UnsetGainsAreZeroAndLayersOne) {
  using S = TypeParam;
  const Gains<FiveBar<S>> g;
  EXPECT_TRUE((g.lambda.array() == S(0)).all() && (g.k.array() == S(0)).all() &&
              (g.layer.array() == S(1)).all());
  const auto& i = g.independent;
  EXPECT_TRUE(i.lambda == S(0) && i.k == S(0) && i.layer == S(1) && i.kp == S(0) && i.kd == S(0));
}

/// s of a joint is the difference of its bars' (model.md section 10), within their rounding.
TYPED_TEST(Laws, FusedLawEqualsTheLawInRowsWithMass) {
  using S = TypeParam;
  using M = FiveBar<S>;
  for (const LawKind law : {LawKind::esmc, LawKind::esmc_projected}) {
    Accuracy joints(law == LawKind::esmc ? "esmc" : "projected");
    for (std::uint64_t seed = 0; seed < kCases; ++seed) {
      const auto c = random_tracking<S>(seed);
      const auto whole = demand(law, c.mechanism, c.gain, c.reaching, c.t);
      typename M::Channels acceleration, sliding;
      fused_acceleration(law, c.mechanism, c.gain, c.reaching, c.t, acceleration, sliding);
      for (int i = 0; i < M::channels; ++i) {
        if (!M::has_mass(i)) continue;
        EXPECT_EQ(acceleration[i], whole.acceleration[i]) << seed << " row " << i;
        EXPECT_EQ(sliding[i], whole.sliding[i]) << seed << " row " << i;
      }
      const Channels18 s = law == LawKind::esmc ? c.sliding() : whole.sliding.template cast<Real>().eval();
      joints.compare(seed, Vec<S, 4>(sliding[2], sliding[3], sliding[10], sliding[11]),
                     Vec<Real, 4>(s[4], s[5] - s[4], s[12], s[13] - s[12]),
                     std::max({std::fabs(s[4]), std::fabs(s[5]), std::fabs(s[12]), std::fabs(s[13])}));
    }
    joints.expect_below((law == LawKind::esmc ? 1000 : 4) * kEpsilon<S>);
  }
}

/// `sign` has no layer: where s is 0, a layer of 0 is divided by nothing. And every channel is set, whatever
/// was there.
TYPED_TEST(Laws, SignNeedsNoLayerOnTheReferenceItself) {
  using S = TypeParam;
  using M = FiveBar<S>;
  for (std::uint64_t seed = 0; seed < 16; ++seed) {
    auto c = random_tracking<S>(seed);
    c.t.pose = c.t.desired_pose;
    c.t.rates = c.t.desired_rates;
    const auto want = demand(LawKind::esmc, c.mechanism, c.gain, Reaching::saturation, c.t);
    c.gain.layer.setZero();
    for (const LawKind law : {LawKind::esmc, LawKind::esmc_projected}) {
      typename M::Channels acceleration, sliding;
      acceleration.setConstant(std::numeric_limits<S>::quiet_NaN());
      sliding.setZero();
      fused_acceleration(law, c.mechanism, c.gain, Reaching::sign, c.t, acceleration, sliding);
      EXPECT_TRUE(acceleration.allFinite()) << seed;
      for (int i = 0; law == LawKind::esmc && i < M::channels; ++i) {
        if (M::has_mass(i)) {
          EXPECT_EQ(acceleration[i], want.acceleration[i]) << seed << " row " << i;
        }
      }
    }
  }
}

/// [F31]: C^T M (sdot + K sw s) = 0, with two motors and with four.
TYPED_TEST(Laws, FullEsmcReachesInTheMassWeightedSum) {
  using S = TypeParam;
  Accuracy two("two_motors"), four("four_motors"), sliding("sliding");
  for (std::uint64_t seed = 0; seed < kCases; ++seed) {
    const auto c = random_tracking<S>(seed);
    const auto d = demand(LawKind::esmc, c.mechanism, c.gain, c.reaching, c.t);
    const Channels18 s = c.sliding(), lambda = c.gain.lambda.template cast<Real>();
    sliding.compare(seed, d.sliding, s);
    for (const bool all : {false, true}) {
      const Channels18 pdot = c.now.accelerations(c.now.accelerate(c.torque(d, all, random_weight<S>(seed))));
      Channels18 terms;  // sdot + K sw(s)
      Channels18 size;
      const Channels18 wanted = c.wanted_accelerations(), rate = c.error_rate();
      for (int i = 0; i < 18; ++i) {
        const Real sw = Real(c.gain.k[i]) * exact_switching(c.reaching, s[i], Real(c.gain.layer[i]));
        terms[i] = wanted[i] - pdot[i] + lambda[i] * rate[i] + sw;
        size[i] = std::fabs(wanted[i]) + std::fabs(pdot[i]) + std::fabs(lambda[i] * rate[i]) + std::fabs(sw);
      }
      const auto C = c.now.C();
      const Vec<Real, 2> left = C.transpose() * c.now.mass().cwiseProduct(terms);
      const Vec<Real, 2> scale = C.cwiseAbs().transpose() * c.now.mass().cwiseProduct(size);
      (all ? four : two).take(seed, left.cwiseAbs().cwiseQuotient(scale).maxCoeff());
    }
  }
  sliding.expect_below(500 * kEpsilon<S>);
  two.expect_below(3000 * kEpsilon<S>);
  four.expect_below(3000 * kEpsilon<S>);
}

/// H in the place the mechanism reaches after `time` at constant effector velocity.
template <class S>
Mat<Real, 2, 2> inertia_after(FiveBarCase<S> c, Real time) {
  c.q[0] += c.qd[0] * time;
  c.q[1] += c.qd[1] * time;
  c.q = c.oracle.close(c.q, FiveBarModel::by_effector);
  const auto C = c.C();
  return C.transpose() * c.mass().asDiagonal() * C;
}

/// [F33]: V = 1/2 sigma^T H sigma falls at exactly sum M_i K_i (C sigma)_i sw((C sigma)_i), whatever the
/// reference.
TYPED_TEST(Laws, ProjectedLawHasItsLyapunovRate) {
  using S = TypeParam;
  Accuracy rate("V_dot"), sliding("sliding"), acceleration("v_prime");
  for (std::uint64_t seed = 0; seed < kCases; ++seed) {
    const auto c = random_tracking<S>(seed);
    const auto& n = c.now;
    const auto d = demand(LawKind::esmc_projected, c.mechanism, c.gain, c.reaching, c.t);
    const Vec<Real, 2> sigma = c.sigma();
    const Channels18 s = n.C() * sigma;
    sliding.compare(seed, d.sliding, s);

    // v' from its definition: C xdd_r + Cdot xd_r + K sw(C sigma), Cdot by mixed derivatives of the
    // positions.
    const Real lambda = Real(c.gain.independent.lambda);
    const Vec<Real, 2> vr = c.wanted.velocity.template cast<Real>() + lambda * c.effector_error();
    const Vec<Real, 2> ar = c.wanted_acceleration.template cast<Real>() + lambda * c.effector_error_rate();
    const auto qdr = n.oracle.rates(n.q, FiveBarModel::by_effector, vr[0], vr[1]);
    const auto mixed = n.oracle.accelerations(n.q, n.qd, qdr, FiveBarModel::by_effector, ar[0], ar[1]);
    Channels18 want = eigen(channel_accelerations(n.oracle, n.q, n.qd, qdr, mixed));
    Real fall = 0;
    for (int i = 0; i < 18; ++i) {
      const Real sw = Real(c.gain.k[i]) * exact_switching(c.reaching, s[i], Real(c.gain.layer[i]));
      want[i] += sw;
      fall += n.mass()[i] * s[i] * sw;
    }
    acceleration.compare(seed, d.acceleration, want);

    const auto qdd = n.accelerate(c.torque(d, (seed & 1U) != 0U));
    const Vec<Real, 2> sigma_rate = c.wanted_acceleration.template cast<Real>() -
                                    Vec<Real, 2>(qdd[0], qdd[1]) + lambda * c.effector_error_rate();
    const Real h = 1e-5L;  // sixth-order differences: (3 h / 3e-3 s to type 1)^6 = 1e-12 of a small part
    const Mat<Real, 2, 2> H_rate = ((inertia_after(n, h) - inertia_after(n, -h)) * 45 -
                                    (inertia_after(n, 2 * h) - inertia_after(n, -2 * h)) * 9 +
                                    (inertia_after(n, 3 * h) - inertia_after(n, -3 * h))) /
                                   (60 * h);
    const Vec<Real, 2> kinetic_part = c.H() * sigma_rate;
    const Real V_rate = sigma.dot(kinetic_part) + sigma.dot(H_rate * sigma) / 2;
    const Real scale =
        fall + sigma.cwiseAbs().dot(kinetic_part.cwiseAbs()) + std::fabs(sigma.dot(H_rate * sigma)) / 2;
    rate.take(seed, std::fabs(V_rate + fall) / scale);
    EXPECT_GT(fall, 0) << "seed " << seed;
  }
  sliding.expect_below(500 * kEpsilon<S>);
  acceleration.expect_below(1000 * kEpsilon<S>);
  rate.expect_below(5000 * kEpsilon<S>);
}

/// [F27] sdot = -k sw(s); CTC: edd + Kd ed + Kp e = 0, coordinate by coordinate.
TYPED_TEST(Laws, SmcAndCtcHaveTheErrorDynamicsTheyPromise) {
  using S = TypeParam;
  Accuracy smc("smc"), ctc("ctc"), sliding("sliding");
  for (std::uint64_t seed = 0; seed < kCases; ++seed) {
    const auto c = random_tracking<S>(seed);
    const auto& g = c.gain.independent;
    const Vec<Real, 2> e = c.effector_error(), ed = c.effector_error_rate(), s = c.sigma();
    const bool four = (seed & 1U) != 0U;
    const auto error_acceleration = [&](const Demand<FiveBar<S>>& d) {
      const auto qdd = c.now.accelerate(c.torque(d, four));
      return Vec<Real, 2>(Real(c.wanted_acceleration[0]) - qdd[0], Real(c.wanted_acceleration[1]) - qdd[1]);
    };
    const auto ds = demand(LawKind::smc, c.mechanism, c.gain, c.reaching, c.t);
    sliding.compare(seed, ds.sliding.template head<2>(), s);
    EXPECT_TRUE((ds.sliding.template tail<16>().array() == S(0)).all());
    Vec<Real, 2> want = -Real(g.lambda) * ed;
    for (int i = 0; i < 2; ++i) want[i] -= Real(g.k) * exact_switching(c.reaching, s[i], Real(g.layer));
    const auto still = c.now.accelerate(Vec<S, 4>::Zero());
    const Real scale = std::fabs(still[0]) + std::fabs(still[1]) + 100;  // what the law has to cancel
    smc.compare(seed, error_acceleration(ds), want, scale);
    const auto dc = demand(LawKind::ctc, c.mechanism, c.gain, c.reaching, c.t);
    ctc.compare(seed, error_acceleration(dc), (-Real(g.kd) * ed - Real(g.kp) * e).eval(), scale);
    EXPECT_TRUE((dc.sliding.array() == S(0)).all());
  }
  sliding.expect_below(50 * kEpsilon<S>);
  smc.expect_below(3000 * kEpsilon<S>);
  ctc.expect_below(3000 * kEpsilon<S>);
}

/// The same three promises for the RR arm, joints independent.
TYPED_TEST(Laws, RrArmKeepsThemToo) {
  using S = TypeParam;
  using M = Rr<S>;
  Accuracy full("esmc"), projected("projected_V_dot"), smc("smc"), ctc("ctc");
  for (std::uint64_t seed = 0; seed < kCases; ++seed) {
    const auto c = random_rr<S>(seed, 0.0);
    const M m = c.mechanism();
    Random r(~seed);
    // Anywhere: the joint errors reach +-pi, so the wrapping is in the loop.
    const Vec2<S> qd = r.vector<S, 2>(3.14), vd = r.vector<S, 2>(6), ad = r.vector<S, 2>(30);
    const Tracking<M> t{m.pose(c.theta), m.pose(qd), c.rate, vd, ad};
    Gains<M> gain;
    for (int i = 0; i < 8; ++i) {
      gain.lambda[i] = r.in<S>(5, 60);
      gain.k[i] = r.in<S>(1, 100);
      gain.layer[i] = r.in<S>(0.1, 5);
    }
    gain.independent = {r.in<S>(5, 60), r.in<S>(1, 100), r.in<S>(0.1, 5), r.in<S>(10, 1000), r.in<S>(5, 60)};
    const auto reaching = static_cast<Reaching>(seed % 4);
    const Row<2> qdo{Real(qd[0]), Real(qd[1])}, vdo{Real(vd[0]), Real(vd[1])}, ado{Real(ad[0]), Real(ad[1])};
    const Vec<Real, 8> wanted = eigen(channel_accelerations(c.oracle, qdo, vdo, vdo, ado));
    Vec<Real, 8> e = eigen(c.oracle.channels(qdo)) - eigen(c.oracle.channels(c.q));
    const Vec<Real, 8> ed =
        eigen(channel_rates(c.oracle, qdo, vdo)) - eigen(channel_rates(c.oracle, c.q, c.qd));
    for (int i = 0; i < 4; ++i) e[i] = detail::wrap(e[i]);
    const Vec<Real, 2> e2 = e.template head<2>(), ed2 = ed.template head<2>();
    const Vec<Real, 8> mass = eigen(c.oracle.weight());
    Mat<Real, 8, 2> C;
    for (int i = 0; i < 2; ++i)
      C.col(i) = eigen(channel_rates(c.oracle, c.q, Row<2>{i == 0 ? 1.0L : 0.0L, i == 0 ? 0.0L : 1.0L}));
    const auto accelerate = [&](LawKind law) {
      const auto d = demand(law, m, gain, reaching, t);
      const Vec2<S> tau = m.base_torque(t.pose, m.force(d.acceleration, t.rates));
      return c.oracle.accelerate(c.q, c.qd, {Real(tau[0]), Real(tau[1])});
    };
    const auto sw = [&](Real s, int i) {
      return Real(gain.k[i]) * exact_switching(reaching, s, Real(gain.layer[i]));
    };
    {
      const Vec<Real, 8> pdot =
          eigen(channel_accelerations(c.oracle, c.q, c.qd, c.qd, accelerate(LawKind::esmc)));
      Vec<Real, 8> terms, size;
      for (int i = 0; i < 8; ++i) {
        const Real l = Real(gain.lambda[i]), k = sw(ed[i] + l * e[i], i);
        terms[i] = wanted[i] - pdot[i] + l * ed[i] + k;
        size[i] = std::fabs(wanted[i]) + std::fabs(pdot[i]) + std::fabs(l * ed[i]) + std::fabs(k);
      }
      const Vec<Real, 2> left = C.transpose() * mass.cwiseProduct(terms),
                         scale = C.cwiseAbs().transpose() * mass.cwiseProduct(size);
      full.take(seed, left.cwiseAbs().cwiseQuotient(scale).maxCoeff());
    }
    const Real lambda = Real(gain.independent.lambda);
    const Vec<Real, 2> sigma = ed2 + lambda * e2;
    {
      const Row<2> a = accelerate(LawKind::esmc_projected);
      const Vec<Real, 2> sigma_rate = Vec<Real, 2>(ado[0] - a[0], ado[1] - a[1]) + lambda * ed2;
      const Mat<Real, 2, 2> H = C.transpose() * mass.asDiagonal() * C;
      // Hdot from [F6]: only cos theta_2 moves.
      const Bar &b1 = c.oracle.bar[0], &b2 = c.oracle.bar[1];
      const Real slope = -b2.mass * b1.length * b2.centre * std::sin(c.q[1]) * c.qd[1];
      Mat<Real, 2, 2> H_rate;
      H_rate << 2 * slope, slope, slope, 0;
      Real fall = 0;
      for (int i = 0; i < 8; ++i) fall += mass[i] * C.row(i).dot(sigma) * sw(C.row(i).dot(sigma), i);
      const Real scale = fall + sigma.cwiseAbs().dot((H * sigma_rate).cwiseAbs());
      projected.take(seed,
                     std::fabs(sigma.dot(H * sigma_rate) + sigma.dot(H_rate * sigma) / 2 + fall) / scale);
    }
    const auto& g = gain.independent;
    const Row<2> as = accelerate(LawKind::smc), ac = accelerate(LawKind::ctc),
                 free = c.oracle.accelerate(c.q, c.qd, {});
    for (int i = 0; i < 2; ++i) {
      const auto k = static_cast<unsigned>(i);
      const Real scale = std::fabs(free[0]) + std::fabs(free[1]) + std::fabs(as[0]) + std::fabs(as[1]) +
                         std::fabs(ac[0]) + std::fabs(ac[1]);
      const Real edd =
          -Real(g.lambda) * ed2[i] - Real(g.k) * exact_switching(reaching, sigma[i], Real(g.layer));
      smc.take(seed, std::fabs(ado[k] - as[k] - edd) / scale);
      ctc.take(seed, std::fabs(ado[k] - ac[k] + Real(g.kd) * ed2[i] + Real(g.kp) * e2[i]) / scale);
    }
  }
  for (const Accuracy* a : {&full, &projected, &smc, &ctc}) a->expect_below(500 * kEpsilon<S>);
}

/// [F28]: inside a linear layer SMC is CTC with Kd = lambda + k / eps, Kp = lambda k / eps; tanh up to its
/// cubic term.
TYPED_TEST(Laws, InsideTheLayerSmcIsComputedTorque) {
  using S = TypeParam;
  Accuracy linear("linear"), cubic("tanh");
  for (std::uint64_t seed = 0; seed < kCases; ++seed) {
    auto c = random_tracking<S>(seed);
    auto& g = c.gain.independent;
    const Real s = c.sigma().cwiseAbs().maxCoeff();
    g.layer = static_cast<S>(s * 1.01L);
    g.kd = g.lambda + g.k / g.layer;
    g.kp = g.lambda * (g.k / g.layer);
    const auto want = demand(LawKind::ctc, c.mechanism, c.gain, Reaching::sign, c.t).acceleration;
    for (const Reaching law : {Reaching::saturation, Reaching::implicit}) {
      linear.compare(seed, demand(LawKind::smc, c.mechanism, c.gain, law, c.t).acceleration, want);
    }
    g.layer = static_cast<S>(s * 100);
    g.kd = g.lambda + g.k / g.layer;
    g.kp = g.lambda * (g.k / g.layer);
    // k (z - tanh z) <= k z^3 / 3 in (x, y), and as much more in the channels as C says.
    const Real bound = Real(g.k) * 1e-6L / 3 * c.now.C().cwiseAbs().rowwise().sum().maxCoeff();
    const Channels18 difference =
        (demand(LawKind::smc, c.mechanism, c.gain, Reaching::tanh, c.t).acceleration -
         demand(LawKind::ctc, c.mechanism, c.gain, Reaching::sign, c.t).acceleration)
            .template cast<Real>();
    cubic.take(seed, difference.cwiseAbs().maxCoeff() /
                         (bound + 500 * kEpsilon<S> * want.template cast<Real>().cwiseAbs().maxCoeff()));
  }
  linear.expect_below(200 * kEpsilon<S>);
  cubic.expect_below(1.0);
}

/// At rest the full law with K_i / eps_i = kappa for all rows is that same CTC to first order in the error:
/// what is left over is quadratic (model.md section 10).
TEST(LawsNearRest, FullEsmcIsComputedTorqueToFirstOrder) {
  for (std::uint64_t seed = 0; seed < 200; ++seed) {
    auto c = random_tracking<double>(seed);
    const double lambda = 20, kappa = 30;
    c.gain.lambda.setConstant(lambda);
    c.gain.k.setConstant(kappa * 10);
    c.gain.layer.setConstant(10);
    c.gain.independent = {lambda, 0, 1, lambda * kappa, lambda + kappa};
    const auto difference = [&](double size) {
      Random r(seed);
      const Vec2<double> x = c.now.position + r.vector<double, 2>(1) * size,
                         v = r.vector<double, 2>(1) * size;
      c.t.rates = c.mechanism.rates_of_effector(c.t.pose, v);
      c.t.desired_pose = *c.mechanism.inverse(x, c.now.mode);
      c.t.desired_rates = c.mechanism.rates_of_effector(c.t.desired_pose, Vec2<double>::Zero());
      c.t.desired_acceleration = c.t.desired_rates;
      const auto full = demand(LawKind::esmc, c.mechanism, c.gain, Reaching::saturation, c.t).acceleration;
      const auto plain = demand(LawKind::ctc, c.mechanism, c.gain, Reaching::sign, c.t).acceleration;
      return c.mechanism.base_torque(c.t.pose, c.mechanism.mass().cwiseProduct(full - plain)).norm();
    };
    const double coarse = difference(1e-3), fine = difference(1e-4);
    EXPECT_GT(coarse, 50 * fine) << "seed " << seed;
    EXPECT_LT(coarse, 200 * fine) << "seed " << seed;
  }
}

/// [F30]: what the mechanism does under F is the constrained minimum (91), here by its 34 x 34 KKT system.
TEST(LawsAndTheirOptimum, AppliedForceGivesTheKktSolution) {
  Accuracy reached("v_projected"), reduced("C_a_plus_c");
  for (std::uint64_t seed = 0; seed < 160; ++seed) {
    const auto c = random_tracking<double>(seed);
    const auto d = demand(LawKind::esmc, c.mechanism, c.gain, c.reaching, c.t);
    const Channels18 v = d.acceleration.cast<Real>();
    const auto& q = c.now;
    const Mat<Real, 16, 18> A = matrix_A(c.mechanism, c.t.pose).cast<Real>();
    const Vec<Real, 16> b = vector_b(c.mechanism, c.t.pose, c.t.rates).cast<Real>();
    Square<34> K{};
    Row<34> right{};
    for (int i = 0; i < 18; ++i) {
      const auto k = static_cast<unsigned>(i);
      K[k][k] = 2 * q.mass()[i];
      right[k] = 2 * q.mass()[i] * v[i];
      for (int j = 0; j < 16; ++j)
        K[k][18 + static_cast<unsigned>(j)] = K[18 + static_cast<unsigned>(j)][k] = A(j, i);
    }
    for (int j = 0; j < 16; ++j) right[18 + static_cast<unsigned>(j)] = b[j];
    const Row<34> x = eliminate(K, right);
    Channels18 optimum;
    for (int i = 0; i < 18; ++i) optimum[i] = x[static_cast<unsigned>(i)];
    // The optimum minimises over M; friction and gravity are in F on top.
    reached.compare(seed, q.accelerations(q.accelerate(c.torque(d, false))), optimum);
    const auto C = q.C();
    const Channels18 rest =
        q.accelerations(q.oracle.accelerations(q.q, q.qd, q.qd, FiveBarModel::by_effector, 0, 0));
    const Vec<Real, 2> F = C.transpose() * q.mass().cwiseProduct(v - rest);
    const Mat<Real, 2, 2> H = c.H();
    const Row<2> a = eliminate(Square<2>{{{H(0, 0), H(0, 1)}, {H(1, 0), H(1, 1)}}}, Row<2>{F[0], F[1]});
    reduced.compare(seed, (C * Vec<Real, 2>(a[0], a[1]) + rest).eval(), optimum);
  }
  reached.expect_below(5000 * kEpsilon<double>);
  reduced.expect_below(1000 * kEpsilon<double>);  // A, b and v' are double
}

TYPED_TEST(Laws, PdIsSpringAndDamperOnTheBaseJoints) {
  using S = TypeParam;
  Accuracy torque("torque");
  for (std::uint64_t seed = 0; seed < kCases; ++seed) {
    const auto c = random_tracking<S>(seed);
    const Channels18 e = c.error(), ed = c.error_rate();
    const auto& g = c.gain.independent;
    const Vec<Real, 2> want(Real(g.kp) * e[2] + Real(g.kd) * ed[2], Real(g.kp) * e[10] + Real(g.kd) * ed[10]);
    torque.compare(seed, torque_pd<FiveBar<S>>(c.gain, c.t), want, Real(g.kp));
    const auto d = demand(LawKind::pd, c.mechanism, c.gain, c.reaching, c.t);
    EXPECT_TRUE((d.acceleration.array() == S(0)).all());
  }
  torque.expect_below(100 * kEpsilon<S>);
}

TYPED_TEST(Laws, WithoutAModelNothingIsDemanded) {
  using S = TypeParam;
  auto c = random_tracking<S>(1);
  auto v = FiveBar<S>::Channels::Ones().eval(), s = v;
  fused_acceleration(LawKind::pd, c.mechanism, c.gain, c.reaching, c.t, v, s);
  EXPECT_TRUE(v.isZero(0) && s.isZero(0));
}

[[gnu::noinline]] double leave_numbers_on_the_stack() {
  volatile double here[64];
  for (int i = 0; i < 64; ++i) here[i] = 1.0 + i;
  return here[7];
}
TYPED_TEST(Laws, AtRestNothingMoves) {
  EXPECT_EQ(leave_numbers_on_the_stack(), 8.0);
  const auto r = FiveBar<TypeParam>::Rates::Zero();
  EXPECT_TRUE(r.platform.isZero(0) && r.leg[0].isZero(0) && r.leg[1].isZero(0));
  EXPECT_EQ(leave_numbers_on_the_stack(), 8.0);
  const typename Rr<TypeParam>::Rates arm = Rr<TypeParam>::Rates::Zero();
  EXPECT_TRUE(arm.isZero(0));
}

/// A NaN anywhere in the state must come out as a NaN torque (the limiter then stops the motors), never as a
/// number.
TYPED_TEST(Laws, NotANumberIsNeverSwallowed) {
  using S = TypeParam;
  constexpr S nan = std::numeric_limits<S>::quiet_NaN();
  for (std::uint64_t seed = 0; seed < 32; ++seed) {
    for (const LawKind law : {LawKind::esmc, LawKind::esmc_projected, LawKind::smc, LawKind::ctc}) {
      for (int where = 0; where < 3; ++where) {
        auto c = random_tracking<S>(seed);
        if (where == 0) c.t.rates.leg[0][0] = nan;
        if (where == 1) c.t.desired_acceleration.platform[0] = c.t.desired_acceleration.leg[0][0] = nan;
        if (where == 2) c.t.desired_pose.effector[1] = c.t.desired_pose.leg[1].axis[0].x() = nan;
        const auto d = demand(law, c.mechanism, c.gain, c.reaching, c.t);
        EXPECT_FALSE(std::isfinite(c.torque(d, false).sum()))
            << "seed " << seed << " law " << int(law) << " " << where;
        EXPECT_FALSE(std::isfinite(c.torque(d, true).sum()))
            << "seed " << seed << " law " << int(law) << " " << where;
      }
    }
  }
}

}  // namespace
}  // namespace esmc::test
