// The coupling algorithm on a mechanism that no product of this project uses: 3-RRR, a rigid platform (x, y,
// phi) on three RR legs, one of them mirrored. Oracle: positions in nine redundant inertial coordinates,
// Lagrange's equations with multipliers (tests/support/lagrange.hpp).
//
// Bounds: multiples of epsilon as in mechanism_test.cpp; every leg has |sin theta_2| >= 0.25, and H of the
// platform a condition of some 100.

#include <gtest/gtest.h>

#include <Eigen/LU>

#include "tests/support/random_mechanism.hpp"

namespace esmc::test {
namespace {

constexpr std::uint64_t kCases = 100;
constexpr std::size_t kLegs = 3;

/// q0 = (x, y, phi): mass centre and angle. Leg j holds the point `at[j]`, in the frame of the platform.
template <class S>
struct RigidPlatform {
  static constexpr int dof = 3;
  static constexpr int channels = 3;
  static constexpr bool turns = true;
  struct Pose {
    Vec2<S> centre = Vec2<S>::Zero(), axis = Vec2<S>(S(1), S(0));
  };
  S mass{}, inertia{}, gravity{};
  List<Vec2<S>, kLegs> at{};

  [[nodiscard]] Vec2<S> arm(const Pose& p, int j) const {
    return p.axis * at[j].x() + perp(p.axis) * at[j].y();
  }
  [[nodiscard]] Vec2<S> attachment_rate(const Pose& p, int j, const Vec<S, 3>& v) const {
    return Vec2<S>(v[0], v[1]) + perp(arm(p, j)) * v[2];
  }
  [[nodiscard]] Vec2<S> attachment_bias(const Pose& p, int j, const Vec<S, 3>& a, const Vec<S, 3>& b) const {
    return -arm(p, j) * (a[2] * b[2]);
  }
  [[nodiscard]] Vec<S, 3> attachment_force(const Pose& p, int j, const Vec2<S>& f) const {
    return {f.x(), f.y(), cross(arm(p, j), f)};
  }
  [[nodiscard]] Vec<S, 3> force(const Vec<S, 3>& v) const {
    return {mass * v[0], mass * (v[1] + gravity), inertia * v[2]};
  }
  [[nodiscard]] Vec<S, 3> weight() const { return {mass, mass, inertia}; }
};

/// Coordinates: x, y, phi, and the absolute angles of the six bars, all in N and counter-clockwise.
struct ThreeRrrModel {
  static constexpr std::size_t n = 9, rows = 27, closures = 6;
  std::array<Bar, 6> bar{};
  std::array<Row<2>, kLegs> base{}, at{};
  std::array<Real, kLegs> mirror{};
  Real mass = 0, inertia = 0, gravity = 0;

  template <class T>
  std::array<T, 21> inertial(const std::array<T, n>& q) const {
    std::array<T, 21> out;
    for (std::size_t i = 0; i < 3; ++i) out[i] = q[i];
    for (std::size_t j = 0; j < kLegs; ++j) {
      T x = base[j][0], y = base[j][1];
      for (std::size_t k = 2 * j; k < 2 * j + 2; ++k) {
        const T c = cosine(q[3 + k]), s = sine(q[3 + k]);
        out[3 + 3 * k] = x + T(bar[k].centre) * c;
        out[4 + 3 * k] = y + T(bar[k].centre) * s;
        out[5 + 3 * k] = q[3 + k];
        x += T(bar[k].length) * c;
        y += T(bar[k].length) * s;
      }
    }
    return out;
  }
  [[nodiscard]] std::array<Real, 21> weight() const {
    std::array<Real, 21> w{mass, mass, inertia};
    for (std::size_t k = 0; k < 6; ++k) {
      w[3 + 3 * k] = w[4 + 3 * k] = bar[k].mass;
      w[5 + 3 * k] = bar[k].inertia;
    }
    return w;
  }
  template <class T>
  T potential(const std::array<T, n>& q) const {
    const auto c = inertial(q);
    T sum = T(gravity * mass) * c[1];
    for (std::size_t k = 0; k < 6; ++k) sum += T(gravity * bar[k].mass) * c[4 + 3 * k];
    return sum;
  }
  /// Tip of each leg less its point of the platform.
  template <class T>
  std::array<T, closures> closure(const std::array<T, n>& q) const {
    std::array<T, closures> out;
    const T c = cosine(q[2]), s = sine(q[2]);
    for (std::size_t j = 0; j < kLegs; ++j) {
      T x = base[j][0], y = base[j][1];
      for (std::size_t k = 2 * j; k < 2 * j + 2; ++k) {
        x += T(bar[k].length) * cosine(q[3 + k]);
        y += T(bar[k].length) * sine(q[3 + k]);
      }
      out[2 * j] = x - q[0] - T(at[j][0]) * c + T(at[j][1]) * s;
      out[2 * j + 1] = y - q[1] - T(at[j][0]) * s - T(at[j][1]) * c;
    }
    return out;
  }
  /// The channels of the firmware: platform, then each leg in its own frame.
  template <class T>
  std::array<T, rows> channels(const std::array<T, n>& q) const {
    std::array<T, rows> out;
    const auto c = inertial(q);
    for (std::size_t i = 0; i < 3; ++i) out[i] = q[i];
    for (std::size_t j = 0; j < kLegs; ++j) {
      const std::size_t to = 3 + 8 * j;
      const T m = mirror[j];
      for (std::size_t k = 0; k < 2; ++k) {
        const std::size_t b = 2 * j + k;
        out[to + 2 + k] = m * q[3 + b];  // but for a constant
        out[to + 4 + 2 * k] = m * (c[3 + 3 * b] - T(base[j][0]));
        out[to + 5 + 2 * k] = c[4 + 3 * b] - T(base[j][1]);
      }
      out[to] = out[to + 2];
      out[to + 1] = out[to + 3] - out[to + 2];
    }
    return out;
  }

  [[nodiscard]] std::array<Row<n>, closures> jacobian(const Row<n>& q) const {
    std::array<Row<n>, closures> J{};
    for (std::size_t j = 0; j < n; ++j) {
      Row<n> unit{};
      unit[j] = 1;
      const auto c = closure(along(q, unit));
      for (std::size_t i = 0; i < closures; ++i) J[i][j] = c[i].d;
    }
    return J;
  }
  /// The bars' part of x so that jacobian x = right, given the platform's.
  [[nodiscard]] Row<n> complete(const Row<n>& q, Row<n> x, Row<closures> right) const {
    const auto J = jacobian(q);
    Square<closures> A{};
    for (std::size_t i = 0; i < closures; ++i) {
      for (std::size_t j = 0; j < 3; ++j) right[i] -= J[i][j] * x[j];
      for (std::size_t j = 3; j < n; ++j) A[i][j - 3] = J[i][j];
    }
    const auto y = eliminate(A, right);
    for (std::size_t j = 3; j < n; ++j) x[j] = y[j - 3];
    return x;
  }
  [[nodiscard]] Row<n> close(Row<n> q) const {
    for (int step = 0; step < 6; ++step) {
      auto c = closure(q);
      for (Real& v : c) v = -v;
      const Row<n> move = complete(q, {}, c);
      for (std::size_t j = 3; j < n; ++j) q[j] += move[j];
    }
    return q;
  }
  /// Second derivative of the closure along a and b, negative.
  [[nodiscard]] Row<closures> gamma(const Row<n>& q, const Row<n>& a, const Row<n>& b) const {
    const auto c = closure(along(q, a, b, Row<n>{}));
    Row<closures> out{};
    for (std::size_t i = 0; i < closures; ++i) out[i] = -c[i].d.d;
    return out;
  }
  /// Accelerations under joint torques, leg by leg in the sense of its frame, with friction and gravity.
  [[nodiscard]] Row<n> accelerate(const Row<n>& q, const Row<n>& qd, const Row<6>& tau) const {
    const auto eq = lagrange(*this, q, qd);
    const auto J = jacobian(q);
    const auto g = gamma(q, qd, qd);
    Square<n + closures> A{};
    Row<n + closures> b{};
    for (std::size_t i = 0; i < n; ++i) {
      for (std::size_t j = 0; j < n; ++j) A[i][j] = eq.mass[i][j];
      for (std::size_t c = 0; c < closures; ++c) A[i][n + c] = A[n + c][i] = J[c][i];
      b[i] = -eq.rest[i];
    }
    for (std::size_t j = 0; j < kLegs; ++j) {
      const std::size_t i = 3 + 2 * j;
      const Real first = tau[2 * j] - resist(bar[2 * j], mirror[j] * qd[i]),
                 second = tau[2 * j + 1] - resist(bar[2 * j + 1], mirror[j] * (qd[i + 1] - qd[i]));
      b[i] += mirror[j] * (first - second);
      b[i + 1] += mirror[j] * second;
    }
    for (std::size_t c = 0; c < closures; ++c) b[n + c] = g[c];
    const auto x = eliminate(A, b);
    Row<n> out{};
    for (std::size_t i = 0; i < n; ++i) out[i] = x[i];
    return out;
  }
};

template <class S>
struct Case {
  using Mechanism = Coupling<S, RigidPlatform<S>, Dyad<S>, kLegs>;
  Mechanism m;
  typename Mechanism::LegPoses pose;
  ThreeRrrModel oracle;
  Row<9> q{}, qd{};
  Vec<S, 3> rate;

  explicit Case(std::uint64_t seed) {
    Random r(seed);
    while (!draw(r)) {
    }
  }

 private:
  bool draw(Random& r) {
    constexpr Real pi = std::numbers::pi_v<Real>;
    RigidPlatform<S> platform;
    platform.mass = r.in<S>(0.1, 2.0);
    platform.inertia = S(r.in<S>(0.002, 0.02) * platform.mass);
    platform.gravity = r.chance(0.3) ? S(0) : r.in<S>(1, 10);
    oracle.mass = Real(platform.mass);
    oracle.inertia = Real(platform.inertia);
    oracle.gravity = Real(platform.gravity);
    const S phi = r.in<S>(-3, 3);
    const SinCos<S> turned = sin_cos(phi);
    pose.centre = r.vector<S, 2>(0.1);
    pose.axis = Vec2<S>(turned.cos, turned.sin);
    List<Dyad<S>, kLegs> leg;
    List<LegFrame<S>, kLegs> frame;
    for (int j = 0; j < 3; ++j) {
      const auto k = static_cast<std::size_t>(j);
      const Real there = 2 * pi * j / 3 + r.between(-0.3, 0.3);
      const auto p = random_leg<S>(r);
      leg[j] = make_dyad(p, platform.gravity);
      oracle.bar[2 * k] = proximal(p);
      oracle.bar[2 * k + 1] = distal(p);
      frame[j].base =
          Vec2<S>(static_cast<S>(0.35L * std::cos(there)), static_cast<S>(0.35L * std::sin(there)));
      frame[j].mirror = S(j == 1 ? -1 : 1);
      oracle.mirror[k] = Real(frame[j].mirror);
      oracle.base[k] = {Real(frame[j].base.x()), Real(frame[j].base.y())};
      platform.at[j] = r.vector<S, 2>(0.12);
      oracle.at[k] = {Real(platform.at[j].x()), Real(platform.at[j].y())};
      const Vec2<S> point = pose.centre + platform.arm(pose, j);
      auto& reached = pose.leg[j];
      if (!dyad_inverse(leg[j], frame[j].point_to_leg(point), r.sign(), reached)) return false;
      if (std::fabs(static_cast<double>(reached.turn[1].y())) < 0.25) return false;
      for (int b = 0; b < 2; ++b) {
        const Real angle = std::atan2(Real(reached.axis[b].y()), Real(reached.axis[b].x()));
        q[3 + 2 * k + static_cast<std::size_t>(b)] = j == 1 ? pi - angle : angle;
      }
    }
    m = Mechanism(platform, leg, frame);
    rate = r.vector<S, 3>(2);
    q[0] = Real(pose.centre.x());
    q[1] = Real(pose.centre.y());
    q[2] = Real(phi);
    q = oracle.close(q);
    qd = oracle.complete(q, {Real(rate[0]), Real(rate[1]), Real(rate[2])}, {});
    return true;
  }
};

template <class S>
class RigidPlatformOnThreeLegs : public testing::Test {};
TYPED_TEST_SUITE(RigidPlatformOnThreeLegs, Scalars, ScalarName);

TYPED_TEST(RigidPlatformOnThreeLegs, RatesAndBiasAreDerivativesAndKeepClosure) {
  using S = TypeParam;
  Accuracy C("C"), bias("bias"), mixed("mixed"), closed("AC"), joint_torques("joint_torques");
  for (std::uint64_t seed = 0; seed < kCases; ++seed) {
    const Case<S> c(seed);
    Random r(~seed);
    Mat<Real, 27, 3> want;
    Mat<S, 27, 3> got;
    for (int i = 0; i < 3; ++i) {
      Row<9> unit{};
      unit[static_cast<unsigned>(i)] = 1;
      want.col(i) = eigen(channel_rates(c.oracle, c.q, c.oracle.complete(c.q, unit, {})));
      const auto rates = c.m.chain_rates(c.pose, Vec<S, 3>::Unit(i));
      got.col(i) = c.m.channel_rates(c.pose, rates);
      // A C = 0 with the oracle's A: bars in N from the joints of each leg.
      Row<9> x = unit;
      for (std::size_t j = 0; j < kLegs; ++j) {
        const auto& joint = rates.leg[static_cast<int>(j)];
        x[3 + 2 * j] = c.oracle.mirror[j] * Real(joint[0]);
        x[4 + 2 * j] = c.oracle.mirror[j] * (Real(joint[0]) + Real(joint[1]));
      }
      for (const auto& row : c.oracle.jacobian(c.q)) {
        Real sum = 0, size = 0;
        for (std::size_t k = 0; k < 9; ++k) {
          sum += row[k] * x[k];
          size = std::fmax(size, std::fabs(x[k]));
        }
        closed.take(seed, std::fabs(sum) / size);
      }
    }
    C.compare(seed, got, want);
    const auto rates = c.m.chain_rates(c.pose, c.rate);
    const Row<9> rest = c.oracle.complete(c.q, {}, c.oracle.gamma(c.q, c.qd, c.qd));
    const Vec<Real, 27> drift = eigen(channel_accelerations(c.oracle, c.q, c.qd, c.qd, rest));
    bias.compare(seed, c.m.channel_accelerations(c.pose, rates, c.m.chain_bias(c.pose, rates, rates)), drift,
                 1);
    bias.compare(
        seed,
        c.m.channel_accelerations(c.pose, rates, c.m.chain_accelerations(c.pose, rates, Vec<S, 3>::Zero())),
        drift, 1);
    const Vec<S, 3> b = r.vector<S, 3>(2);
    const auto other = c.m.chain_rates(c.pose, b);
    const Row<9> bo = c.oracle.complete(c.q, {Real(b[0]), Real(b[1]), Real(b[2])}, {});
    mixed.compare(seed, c.m.channel_accelerations(c.pose, rates, other, c.m.chain_bias(c.pose, rates, other)),
                  eigen(channel_accelerations(c.oracle, c.q, c.qd, bo,
                                              c.oracle.complete(c.q, {}, c.oracle.gamma(c.q, c.qd, bo)))),
                  1);
    const Vec<S, 27> w = r.vector<S, 27>(1);
    joint_torques.compare(seed, c.m.platform_force(c.pose, w),
                          (want.transpose() * w.template cast<Real>()).eval(), want.cwiseAbs().maxCoeff());
  }
  for (const Accuracy* x : {&C, &closed, &joint_torques}) x->expect_below(100 * kEpsilon<S>);
  for (const Accuracy* x : {&bias, &mixed}) x->expect_below(300 * kEpsilon<S>);
}

/// C^T (M (C a + c) + f + g) = C^^T tau is Lagrange's equation with multipliers, forwards and backwards.
TYPED_TEST(RigidPlatformOnThreeLegs, ReducedDynamicsIsLagrange) {
  using S = TypeParam;
  Accuracy forward("forward"), inverse("inverse");
  for (std::uint64_t seed = 0; seed < kCases; ++seed) {
    const Case<S> c(seed);
    Random r(~seed);
    const auto rates = c.m.chain_rates(c.pose, c.rate);
    Row<6> torque{};
    List<Vec2<S>, kLegs> tau;
    for (int j = 0; j < 3; ++j) {
      tau[j] = r.vector<S, 2>(3);
      for (int k = 0; k < 2; ++k) torque[static_cast<unsigned>(2 * j + k)] = Real(tau[j][k]);
    }
    const Row<9> want = c.oracle.accelerate(c.q, c.qd, torque), free = c.oracle.accelerate(c.q, c.qd, {});
    Mat<S, 3, 3> H;
    for (int i = 0; i < 3; ++i) {
      const auto column = c.m.channel_rates(c.pose, c.m.chain_rates(c.pose, Vec<S, 3>::Unit(i)));
      H.col(i) = c.m.platform_force(c.pose, column.cwiseProduct(c.m.mass()));
    }
    const auto c0 = c.m.channel_accelerations(c.pose, rates, c.m.chain_bias(c.pose, rates, rates));
    const Vec<S, 3> h = c.m.platform_force(c.pose, c.m.force(c0, rates)),
                    F = c.m.gather(c.pose, Vec<S, 3>::Zero(), tau);
    const Vec<S, 3> a = H.partialPivLu().solve(F - h);
    const Vec<Real, 3> expected(want[0], want[1], want[2]);
    forward.compare(seed, a, expected, std::fmax(1, std::fmax(std::fabs(free[0]), std::fabs(free[2]))));
    const Vec<S, 27> pdot = eigen(channel_accelerations(c.oracle, c.q, c.qd, c.qd, want)).template cast<S>();
    inverse.compare(seed, c.m.platform_force(c.pose, c.m.force(pdot, rates)), F,
                    h.template cast<Real>().norm());
  }
  forward.expect_below(500 * kEpsilon<S>);
  inverse.expect_below(300 * kEpsilon<S>);
}

}  // namespace
}  // namespace esmc::test
