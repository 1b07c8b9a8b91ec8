// The serial algorithm on chains that no product of this project uses: prismatic joints, plates, one to four
// bodies. Oracle: positions of the same chain, differentiated (tests/support/lagrange.hpp).
//
// Bounds: a pass along the chain adds at most a dozen products per entry, all of the size of the largest
// entry or smaller: some ten epsilon relative to it. What is solved with the inertia matrix loses its
// condition number as well.

#include <gtest/gtest.h>

#include <limits>

#include "firmware/mechanism/serial.hpp"
#include "tests/support/random_mechanism.hpp"

namespace esmc::test {
namespace {

constexpr std::uint64_t kCases = 300;

using R = Link<Joint::revolute>;
using P = Link<Joint::prismatic>;
using Rp = Link<Joint::revolute, Shape::plate>;
using Pp = Link<Joint::prismatic, Shape::plate>;

/// A firmware chain and the oracle of the same: Links of scalar S.
template <class Scalar, class... Links>
struct Twin {
  using S = Scalar;
  using Firmware = Serial<S, Links...>;
  static constexpr std::size_t n = sizeof...(Links);
  static constexpr int joints = static_cast<int>(n);
  Firmware chain;
  Chain<n> oracle;

  explicit Twin(Random& r) {
    constexpr std::array<bool, n> plate{(Links::shape == Shape::plate)...};
    oracle.slides = {(Links::joint == Joint::prismatic)...};
    List<Body<S>, joints> body{};
    for (std::size_t i = 0; i < n; ++i) {
      Body<S>& b = body[static_cast<int>(i)];
      b = {r.in<S>(0.1, 0.5),
           r.in<S>(-0.2, 0.5),
           r.in<S>(-0.3, 0.3),
           r.in<S>(0.1, 1.0),
           r.in<S>(0.002, 0.02),
           r.in<S>(0, 0.1),
           r.chance(0.5) ? S(0) : r.in<S>(0, 0.1)};
      // Shape::bar must ignore centre_across.
      oracle.bar[i] = {Real(b.length), Real(b.centre),  plate[i] ? Real(b.centre_across) : 0,
                       Real(b.mass),   Real(b.inertia), Real(b.viscous),
                       Real(b.coulomb)};
    }
    const S gravity = r.chance(0.3) ? S(0) : r.in<S>(1, 10);
    oracle.gravity = Real(gravity);
    chain = Firmware(body, gravity);
  }
};

template <std::size_t N, class S>
Row<N> row(const Vec<S, static_cast<int>(N)>& v) {
  Row<N> out;
  for (std::size_t i = 0; i < N; ++i) out[i] = Real(v[static_cast<int>(i)]);
  return out;
}

template <class T>
class SerialChain : public testing::Test {};
struct ChainName {
  template <class T>
  static std::string GetName(int i) {
    constexpr std::array names{
        "R",        "P",          "RP",        "PR",          "RR_plates",        "PP",
        "RRR",      "RPR_plates", "PRP_plate", "RPPR_plates", "RPR_plates_float", "PR_float",
        "RRR_float"};
    return names[static_cast<unsigned>(i)];
  }
};
using Chains = testing::Types<Twin<double, R>, Twin<double, P>, Twin<double, R, P>, Twin<double, P, R>,
                              Twin<double, Rp, Rp>, Twin<double, P, P>, Twin<double, R, R, R>,
                              Twin<double, Rp, Pp, Rp>, Twin<double, P, R, Pp>, Twin<double, Rp, Pp, P, Rp>,
                              Twin<float, Rp, Pp, Rp>, Twin<float, P, R>, Twin<float, R, R, R>>;
TYPED_TEST_SUITE(SerialChain, Chains, ChainName);

TYPED_TEST(SerialChain, RatesBiasAndTransposeAreDerivatives) {
  using S = typename TypeParam::S;
  constexpr std::size_t n = TypeParam::n;
  constexpr int N = TypeParam::joints, K = 4 * N;
  Accuracy rates("rates"), bias("bias"), mixed("bias_mixed"), joint_torques("joint_torques"), tip("tip"),
      tip_rate("tip_rate"), tip_bias("tip_bias"), centres("centres"), error("error");
  for (std::uint64_t seed = 0; seed < kCases; ++seed) {
    Random r(seed);
    const TypeParam t(r);
    const auto& m = t.chain;
    const Vec<S, N> q = r.vector<S, N>(2), a = r.vector<S, N>(5), b = r.vector<S, N>(5),
                    to = r.vector<S, N>(2);
    const auto pose = m.pose(q);
    const Row<n> qo = row<n>(q), ao = row<n>(a), bo = row<n>(b);
    rates.compare(seed, m.rates(pose, a), eigen(channel_rates(t.oracle, qo, ao)));
    bias.compare(seed, m.bias(pose, a, a), eigen(channel_accelerations(t.oracle, qo, ao, ao, {})), 1);
    mixed.compare(seed, m.bias(pose, a, b), eigen(channel_accelerations(t.oracle, qo, ao, bo, {})), 1);
    const Vec<S, N> sum = a + b, difference = a - b;
    // Symmetric to the last bit is not promised; equal to its polarisation within rounding is.
    mixed.compare(seed, m.bias(pose, b, a), m.bias(pose, a, b), 1);
    mixed.compare(seed, ((m.bias(pose, sum, sum) - m.bias(pose, difference, difference)) / S(4)).eval(),
                  m.bias(pose, a, b), 10);
    mixed.compare(seed, m.bias(pose, (a * S(2) + to).eval(), b),
                  (m.bias(pose, a, b) * S(2) + m.bias(pose, to, b)).eval(), 10);
    // C^T by the oracle's columns.
    const Vec<S, K> w = r.vector<S, K>(3);
    Vec<Real, N> want;
    for (int i = 0; i < N; ++i) {
      Row<n> unit{};
      unit[static_cast<unsigned>(i)] = 1;
      want[i] = eigen(channel_rates(t.oracle, qo, unit)).dot(w.template cast<Real>());
    }
    joint_torques.compare(seed, m.joint_torques(pose, w), want, 1);

    const auto x = t.oracle.tip(qo);
    const auto v = t.oracle.tip(along(qo, ao));
    const auto acc = t.oracle.tip(along(qo, ao, bo, Row<n>{}));
    tip.compare(seed, m.tip(pose), Vec<Real, 2>(x[0], x[1]), 1);
    tip_rate.compare(seed, m.tip_rate(pose, a), Vec<Real, 2>(v[0].d, v[1].d), 1);
    tip_bias.compare(seed, m.tip_bias(pose, a, b), Vec<Real, 2>(acc[0].d.d, acc[1].d.d), 10);
    tip_bias.compare(seed, m.tip_bias(pose, b, a), Vec<Real, 2>(acc[0].d.d, acc[1].d.d), 10);

    const auto here = t.oracle.channels(qo), there = t.oracle.channels(row<n>(to));
    const auto g = m.centres(pose);
    const Vec<S, K> e = m.error(m.pose(to), pose);
    for (int i = 0; i < K; ++i) {
      const auto k = static_cast<unsigned>(i);
      const bool angle = i < 2 * N && !(i < N && t.oracle.slides[k]);
      const Real d = there[k] - here[k];
      error.take(seed, std::fabs(Real(e[i]) - (angle ? detail::wrap(d) : d)));
      if (i >= 2 * N) centres.take(seed, std::fabs(Real(g[(i - 2 * N) / 2][i % 2]) - here[k]));
    }
  }
  const Real eps = kEpsilon<S>;
  for (const Accuracy* x :
       {&rates, &bias, &mixed, &joint_torques, &tip, &tip_rate, &tip_bias, &centres, &error}) {
    x->expect_below(30 * eps);
  }
}

/// Every row is visited once.
TYPED_TEST(SerialChain, RowsAreErrorsRatesAndAccelerations) {
  using S = typename TypeParam::S;
  constexpr int N = TypeParam::joints, K = 4 * N;
  Accuracy error("error"), rates("rates"), accelerations("accelerations"), resolved("resolved"),
      pushed("pushed");
  for (std::uint64_t seed = 0; seed < kCases; ++seed) {
    Random r(seed);
    const TypeParam t(r);
    const auto& m = t.chain;
    const Vec<S, N> q = r.vector<S, N>(2), to = r.vector<S, N>(2), a = r.vector<S, N>(5),
                    b = r.vector<S, N>(5), c = r.vector<S, N>(20);
    const auto pose = m.pose(q), desired = m.pose(to);
    const auto unset = Vec<S, K>::Constant(std::numeric_limits<S>::quiet_NaN()).eval();
    Vec<S, K> e = unset, rate = unset, reference = unset, speed = unset, push = unset;
    Vec<int, K> told = Vec<int, K>::Zero();
    m.for_each_error_row(desired, a, c, pose, b, [&](auto row, S of, S its_rate, S acceleration) {
      e[row] = of;
      rate[row] = its_rate;
      reference[row] = acceleration;
      told[row] += 1;
    });
    m.for_each_reference_row(pose, a, c, a, b, [&](auto row, S its_rate, S acceleration) {
      speed[row] = its_rate;
      push[row] = acceleration;
      told[row] += 1;
    });
    EXPECT_EQ(told, (Vec<int, K>::Constant(2).eval())) << seed;
    const auto here = t.oracle.channels(row<TypeParam::n>(q)),
               there = t.oracle.channels(row<TypeParam::n>(to));
    for (int i = 0; i < K; ++i) {
      const auto k = static_cast<unsigned>(i);
      const bool angle = i < 2 * N && !(i < N && t.oracle.slides[k]);
      error.take(seed,
                 std::fabs(Real(e[i]) - (angle ? detail::wrap(there[k] - here[k]) : there[k] - here[k])));
    }
    const auto qo = row<TypeParam::n>(q), too = row<TypeParam::n>(to), ao = row<TypeParam::n>(a),
               bo = row<TypeParam::n>(b), co = row<TypeParam::n>(c);
    rates.compare(seed, rate,
                  (eigen(channel_rates(t.oracle, too, ao)) - eigen(channel_rates(t.oracle, qo, bo))).eval(),
                  1);
    accelerations.compare(seed, reference, eigen(channel_accelerations(t.oracle, too, ao, ao, co)), 1);
    resolved.compare(seed, speed, eigen(channel_rates(t.oracle, qo, ao)), 1);
    pushed.compare(seed, push, eigen(channel_accelerations(t.oracle, qo, ao, bo, co)), 1);
  }
  for (const Accuracy* x : {&error, &rates, &accelerations, &resolved, &pushed})
    x->expect_below(30 * kEpsilon<S>);
}

/// C^T M C qdd + C^T (M c + f + g) = tau is Lagrange's equation of the chain.
TYPED_TEST(SerialChain, ReducedDynamicsIsLagrange) {
  using S = typename TypeParam::S;
  constexpr std::size_t n = TypeParam::n;
  constexpr int N = TypeParam::joints;
  Accuracy H("H"), h("h"), inverse("inverse");
  for (std::uint64_t seed = 0; seed < kCases; ++seed) {
    Random r(seed);
    const TypeParam t(r);
    const auto& m = t.chain;
    const Vec<S, N> q = r.vector<S, N>(2), qd = r.vector<S, N>(5), tau = r.vector<S, N>(3);
    const auto pose = m.pose(q);
    const auto eq = lagrange(t.oracle, row<n>(q), row<n>(qd));
    Mat<Real, N, N> want;
    Mat<S, N, N> got;
    Vec<Real, N> rest;
    for (int i = 0; i < N; ++i) {
      got.col(i) =
          m.joint_torques(pose, (m.mass().array() * m.rates(pose, Vec<S, N>::Unit(i)).array()).matrix());
      const auto k = static_cast<unsigned>(i);
      for (int j = 0; j < N; ++j) want(i, j) = eq.mass[k][static_cast<unsigned>(j)];
      rest[i] = eq.rest[k] + resist(t.oracle.bar[k], Real(qd[i]));
    }
    H.compare(seed, got, want);
    h.compare(seed, m.joint_torques(pose, m.force(m.bias(pose, qd, qd), qd)), rest, 10);
    const Row<n> qdd = t.oracle.accelerate(row<n>(q), row<n>(qd), row<n>(tau));
    const Vec<S, 4 * N> pdot =
        eigen(channel_accelerations(t.oracle, row<n>(q), row<n>(qd), row<n>(qd), qdd)).template cast<S>();
    inverse.compare(seed, m.joint_torques(pose, m.force(pdot, qd)), tau,
                    pdot.template cast<Real>().cwiseAbs().maxCoeff());
  }
  for (const Accuracy* x : {&H, &h, &inverse}) x->expect_below(50 * kEpsilon<S>);
}

/// Cart and pendulum, as every textbook has it.
TEST(SerialChainByHand, CartAndPendulum) {
  Random r(0);
  Twin<double, P, R> t(r);
  const auto& cart = t.chain.body(0);
  const auto& arm = t.chain.body(1);
  const double angle = 0.7, rate = 1.3;
  const auto pose = t.chain.pose(Vec<double, 2>(0.4, angle));
  const Vec<double, 8> c = t.chain.bias(pose, Vec<double, 2>(0.9, rate), Vec<double, 2>(0.9, rate));
  Vec<double, 8> want;
  want << 0, 0, 0, 0, 0, 0, -arm.centre * std::cos(angle) * rate * rate,
      -arm.centre * std::sin(angle) * rate * rate;
  EXPECT_LE(static_cast<double>(Accuracy::relative(c, want)), 1e-15);
  EXPECT_DOUBLE_EQ(t.chain.tip(pose).x(), 0.4 + cart.length + arm.length * std::cos(angle));
}

template <class S>
class DyadTip : public testing::Test {};
TYPED_TEST_SUITE(DyadTip, Scalars, ScalarName);

TYPED_TEST(DyadTip, InverseAndForceAreInverseAndAdjoint) {
  using S = TypeParam;
  Accuracy inverse("inverse"), identity("identity"), adjoint("adjoint"), force("force"), near("near_type1");
  for (std::uint64_t seed = 0; seed < 4 * kCases; ++seed) {
    const bool close = (seed & 1U) != 0U;
    auto c = random_rr<S>(seed);
    Random r(~seed);
    if (close) {  // sin theta_2 from 0.1 to 1e-6, straight and folded; theta_2 itself is exact
      const S d = static_cast<S>(std::pow(10.0L, r.between(-6, -1)) * r.sign());
      c.theta[1] = r.chance(0.5) ? d : static_cast<S>(std::numbers::pi_v<S> - d);
      c.q[1] = Real(c.theta[1]);
    }
    const Dyad<S> m = c.mechanism().arm();
    const auto pose = m.pose(c.theta);
    const Vec2<S> v = r.vector<S, 2>(1), tau = r.vector<S, 2>(2);
    // J by differentiating the tip; its inverse by Cramer's rule with the determinant l1 l2 sin theta_2, as
    // elimination would cost 1 / sin theta_2 in the oracle as well.
    const auto j0 = c.oracle.tip(along(c.q, Row<2>{1, 0})), j1 = c.oracle.tip(along(c.q, Row<2>{0, 1}));
    const Real det = c.oracle.bar[0].length * c.oracle.bar[1].length * std::sin(c.q[1]);
    Mat<Real, 2, 2> Ji;
    Ji << j1[1].d, -j1[0].d, -j0[1].d, j0[0].d;
    Ji /= det;
    const Vec2<S> got = m.tip_inverse(pose, v), gathered = m.tip_force(pose, tau);
    // Relative to what a general v or tau would give: the one drawn may lie along a bar, or the bars carry
    // nothing.
    const Real gain =
        1 / (std::fabs(std::sin(c.q[1])) * std::fmin(c.oracle.bar[0].length, c.oracle.bar[1].length));
    (close ? near : inverse).compare(seed, got, (Ji * v.template cast<Real>()).eval(), gain);
    (close ? near : force).compare(seed, gathered, (Ji.transpose() * tau.template cast<Real>()).eval(), gain);
    if (!close) identity.compare(seed, m.tip_rate(pose, got), v);
    const Real power = Real(tau[0]) * Real(got[0]) + Real(tau[1]) * Real(got[1]);
    const Real size = std::fabs(Real(tau[0]) * Real(got[0])) + std::fabs(Real(tau[1]) * Real(got[1]));
    adjoint.take(seed,
                 std::fabs(Real(gathered[0]) * Real(v[0]) + Real(gathered[1]) * Real(v[1]) - power) / size);
  }
  const Real eps = kEpsilon<S>;
  for (const Accuracy* x : {&inverse, &force, &near}) x->expect_below(10 * eps);
  identity.expect_below(50 * eps);
  adjoint.expect_below(200 * eps);  // of the power, which may cancel
}

}  // namespace
}  // namespace esmc::test
