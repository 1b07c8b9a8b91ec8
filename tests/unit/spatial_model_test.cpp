// The serial and the coupling algorithm in space. Oracles: for chains, positions and rotation matrices
// differentiated twice (Lagrange, tests/support/lagrange.hpp); for the platform on legs, the plant's
// Newton-Euler equations body by body.

#include <gtest/gtest.h>

#include "tests/support/spatial_case.hpp"

namespace esmc::test {
namespace {

constexpr std::uint64_t kCases = 100;

/// Positions only: mass centre and the nine entries of the rotation matrix of every body, in N. An inertia is
/// a spread of mass along the body's axes: I_x = e_y + e_z and so on.
template <std::size_t N>
struct SpatialChain {
  static constexpr std::size_t n = N, rows = 12 * N;
  struct Part {
    std::array<Real, 3> offset{}, axis{}, centre{}, spread{};
    std::array<std::array<Real, 3>, 3> mount{};
    Real mass = 0, viscous = 0;
    bool slides = false;
  };
  std::array<Part, N> part{};
  Real gravity = 0;

  template <class T>
  using M3 = std::array<std::array<T, 3>, 3>;

  template <class T>
  std::array<T, rows> inertial(const std::array<T, N>& q) const {
    std::array<T, rows> out;
    M3<T> R{};
    for (std::size_t i = 0; i < 3; ++i)
      for (std::size_t j = 0; j < 3; ++j) R[i][j] = T(Real(i == j ? 1 : 0));
    std::array<T, 3> x{T(Real(0)), T(Real(0)), T(Real(0))};
    const auto shift = [&](const std::array<Real, 3>& by, const T& factor) {
      for (std::size_t i = 0; i < 3; ++i)
        for (std::size_t j = 0; j < 3; ++j) x[i] += R[i][j] * T(by[j]) * factor;
    };
    const auto turn = [&](const M3<T>& by) {
      M3<T> next{};
      for (std::size_t i = 0; i < 3; ++i)
        for (std::size_t j = 0; j < 3; ++j) {
          next[i][j] = T(Real(0));
          for (std::size_t k = 0; k < 3; ++k) next[i][j] += R[i][k] * by[k][j];
        }
      R = next;
    };
    for (std::size_t b = 0; b < N; ++b) {
      const Part& p = part[b];
      shift(p.offset, T(Real(1)));
      M3<T> fixed{};
      for (std::size_t i = 0; i < 3; ++i)
        for (std::size_t j = 0; j < 3; ++j) fixed[i][j] = T(p.mount[i][j]);
      turn(fixed);
      if (p.slides) {
        shift(p.axis, q[b]);
      } else {  // Rodrigues
        const T c = cosine(q[b]), s = sine(q[b]);
        const Real u[3][3] = {
            {0, -p.axis[2], p.axis[1]}, {p.axis[2], 0, -p.axis[0]}, {-p.axis[1], p.axis[0], 0}};
        M3<T> joint{};
        for (std::size_t i = 0; i < 3; ++i)
          for (std::size_t j = 0; j < 3; ++j)
            joint[i][j] =
                T(Real(i == j ? 1 : 0)) * c + T(u[i][j]) * s + T(p.axis[i] * p.axis[j]) * (T(Real(1)) - c);
        turn(joint);
      }
      const std::array<T, 3> origin = x;
      shift(p.centre, T(Real(1)));
      for (std::size_t i = 0; i < 3; ++i) {
        out[12 * b + i] = x[i];
        for (std::size_t j = 0; j < 3; ++j) out[12 * b + 3 + 3 * i + j] = R[i][j];
      }
      x = origin;
    }
    return out;
  }
  [[nodiscard]] std::array<Real, rows> weight() const {
    std::array<Real, rows> w{};
    for (std::size_t b = 0; b < N; ++b)
      for (std::size_t i = 0; i < 3; ++i) {
        w[12 * b + i] = part[b].mass;
        for (std::size_t j = 0; j < 3; ++j) w[12 * b + 3 + 3 * i + j] = part[b].spread[j];
      }
    return w;
  }
  template <class T>
  T potential(const std::array<T, N>& q) const {
    const auto c = inertial(q);
    T sum = T(Real(0));
    for (std::size_t b = 0; b < N; ++b) sum += T(gravity * part[b].mass) * c[12 * b + 2];
    return sum;
  }
  template <class T>
  std::array<T, rows> channels(const std::array<T, N>& q) const {
    return inertial(q);
  }
  /// omega of body b in its frame from R^T Rdot.
  static Vec<Real, 3> omega(const std::array<Real, rows>& x, const std::array<Real, rows>& rate,
                            std::size_t b) {
    const auto entry = [&](std::size_t i, std::size_t j) {
      Real sum = 0;
      for (std::size_t k = 0; k < 3; ++k) sum += x[12 * b + 3 + 3 * k + i] * rate[12 * b + 3 + 3 * k + j];
      return sum;
    };
    return {entry(2, 1), entry(0, 2), entry(1, 0)};
  }
};

template <class S, Joint... Kinds>
struct ChainCase {
  static constexpr std::size_t n = sizeof...(Kinds);
  using Firmware = SpatialSerial<S, Kinds...>;
  Firmware chain;
  SpatialChain<n> oracle;
  Vec<S, static_cast<int>(n)> q, qd, qdd;

  explicit ChainCase(std::uint64_t seed) {
    Random r(seed);
    const std::array<Joint, n> kinds{Kinds...};
    List<SpatialBody<S>, static_cast<int>(n)> bodies;
    const S gravity = r.in<S>(0, 10);
    oracle.gravity = Real(gravity);
    for (std::size_t i = 0; i < n; ++i) {
      SpatialBody<S>& b = bodies[static_cast<int>(i)];
      auto& p = oracle.part[i];
      b.offset = r.vector<S, 3>(0.4);
      b.mount = random_attitude<S>(r);
      b.axis = random_attitude<S>(r).v.normalized();
      b.centre = r.vector<S, 3>(0.3);
      const RigidBodyParams<S> body = random_body<S>(r);
      b.mass = body.mass;
      b.inertia = body.inertia;
      b.viscous = r.in<S>(0, 0.1);
      const Rotation<Real> mount =
          rotation(Quaternion<Real>{Real(b.mount.w), b.mount.v.template cast<Real>()});
      const Vec<Real, 3> I = b.inertia.template cast<Real>();
      for (int k = 0; k < 3; ++k) {
        const auto u = static_cast<std::size_t>(k);
        p.offset[u] = Real(b.offset[k]);
        p.axis[u] = Real(b.axis[k]);
        p.centre[u] = Real(b.centre[k]);
        p.spread[u] = (I.sum() - 2 * I[k]) / 2;
        p.mount[u] = {mount.x[k], mount.y[k], mount.z[k]};
      }
      p.mass = Real(b.mass);
      p.viscous = Real(b.viscous);
      p.slides = kinds[i] == Joint::prismatic;
    }
    chain = Firmware(bodies, r.vector<S, 3>(0.3), gravity);
    q = r.vector<S, static_cast<int>(n)>(2);
    qd = r.vector<S, static_cast<int>(n)>(3);
    qdd = r.vector<S, static_cast<int>(n)>(5);
  }
  [[nodiscard]] static Row<n> row(const Vec<S, static_cast<int>(n)>& v) {
    Row<n> out;
    for (std::size_t i = 0; i < n; ++i) out[i] = Real(v[static_cast<int>(i)]);
    return out;
  }
};

template <class S>
class ChainInSpace : public testing::Test {};
TYPED_TEST_SUITE(ChainInSpace, Scalars, ScalarName);

template <class Case>
void rates_and_drift(std::uint64_t seed, Accuracy& rates, Accuracy& drift) {
  const Case c(seed);
  using Chain = typename Case::Firmware;
  constexpr std::size_t n = Case::n;
  const auto pose = c.chain.pose(c.q);
  const auto got = c.chain.rates(pose, c.qd), bias = c.chain.bias(pose, c.qd, c.qdd);
  const Row<n> q = Case::row(c.q), a = Case::row(c.qd), b = Case::row(c.qdd);
  const auto x = c.oracle.inertial(q);
  const auto v = channel_rates(c.oracle, q, a), vb = channel_rates(c.oracle, q, b),
             change = channel_accelerations(c.oracle, q, a, b, Row<n>{});
  for (std::size_t i = 0; i < n; ++i) {
    const auto rows = Chain::rows_of(got, static_cast<int>(i)),
               drifts = Chain::rows_of(bias, static_cast<int>(i));
    rates.compare(seed, rows.turn, c.oracle.omega(x, v, i), 1);
    rates.compare(seed, rows.centre, Vec<Real, 3>(v[12 * i], v[12 * i + 1], v[12 * i + 2]), 1);
    // d/dt along a of vee(R^T R'(b)) = vee(R^T R''(a, b) + R'(a)^T R'(b))
    const Vec<Real, 3> second = c.oracle.omega(x, change, i), first = c.oracle.omega(v, vb, i);
    drift.compare(seed, drifts.turn, Vec<Real, 3>(second + first), 10);
    drift.compare(seed, drifts.centre, Vec<Real, 3>(change[12 * i], change[12 * i + 1], change[12 * i + 2]),
                  10);
  }
}

template <class Case>
void inverse_dynamics(std::uint64_t seed, Accuracy& torque) {
  const Case c(seed);
  constexpr std::size_t n = Case::n;
  const auto pose = c.chain.pose(c.q);
  const auto rates = c.chain.rates(pose, c.qd);
  const auto acceleration = (c.chain.rates(pose, c.qdd) + c.chain.bias(pose, c.qd, c.qd)).eval();
  const auto got = c.chain.joint_torques(pose, c.chain.force(acceleration, rates));
  const auto eq = lagrange(c.oracle, Case::row(c.q), Case::row(c.qd));
  Vec<Real, static_cast<int>(n)> want;
  for (std::size_t i = 0; i < n; ++i) {
    const Real rate = Case::row(c.qd)[i];
    Real sum = eq.rest[i] + c.oracle.part[i].viscous * rate;
    for (std::size_t j = 0; j < n; ++j) sum += eq.mass[i][j] * Case::row(c.qdd)[j];
    want[static_cast<int>(i)] = sum;
  }
  torque.compare(seed, got, want, 10);
}

TYPED_TEST(ChainInSpace, RatesAndDriftAreDerivatives) {
  using enum Joint;
  Accuracy rates("rates"), drift("drift");
  for (std::uint64_t seed = 0; seed < kCases; ++seed) {
    rates_and_drift<ChainCase<TypeParam, revolute, revolute, prismatic>>(seed, rates, drift);
    rates_and_drift<ChainCase<TypeParam, prismatic, revolute, prismatic, revolute>>(seed, rates, drift);
  }
  rates.expect_below(100 * kEpsilon<TypeParam>);
  drift.expect_below(100 * kEpsilon<TypeParam>);
}

/// The gyroscopic term v of (7) included: without it this fails.
TYPED_TEST(ChainInSpace, InverseDynamicsIsLagrange) {
  using enum Joint;
  Accuracy torque("torque");
  for (std::uint64_t seed = 0; seed < kCases; ++seed) {
    inverse_dynamics<ChainCase<TypeParam, revolute>>(seed, torque);
    inverse_dynamics<ChainCase<TypeParam, revolute, revolute, prismatic>>(seed, torque);
    inverse_dynamics<ChainCase<TypeParam, revolute, revolute, revolute, revolute>>(seed, torque);
    inverse_dynamics<ChainCase<TypeParam, prismatic, revolute, prismatic, revolute>>(seed, torque);
  }
  torque.expect_below(100 * kEpsilon<TypeParam>);
}

template <class S>
class PlatformInSpace : public testing::Test {};
TYPED_TEST_SUITE(PlatformInSpace, Scalars, ScalarName);

/// The forces that the algorithm says an acceleration takes are those under which the plant has it.
TYPED_TEST(PlatformInSpace, HexapodAgreesWithNewtonAndEulerBodyByBody) {
  using S = TypeParam;
  Accuracy motors("motors");
  for (std::uint64_t seed = 0; seed < kCases; ++seed) {
    Random r(seed);
    const auto params = random_hexapod<S>(r);
    const auto m = make_hexapod(params);
    const SpatialPlant plant(in_double(params));
    const auto state = PlatformState<S>::near_home(params, r);
    typename Hexapod<S>::Pose pose;
    ASSERT_TRUE(m.pose(state.position, state.attitude, pose));
    SpatialPlant::Input u{};
    for (double& f : u) f = r.in<double>(-50, 50);
    const auto s = state.plant();
    const Vec<double, 6> acceleration = independent_acceleration(s, plant.acceleration(s, u));
    const auto rates = m.chain_rates(pose, state.rate);
    const auto dd = m.chain_accelerations(pose, rates, Vec<S, 6>(acceleration.cast<S>()));
    const auto v = m.channel_accelerations(pose, rates, rates, dd);
    const Vec<S, 6> F = m.gather(pose, m.force(v, m.channel_rates(pose, rates)));
    Vec<S, 6> got;
    EXPECT_GT(m.template motor_forces<UpsLeg<S>::slide>(pose, F, S(0.2), got), S(0.02));
    motors.compare(seed, got, Vec<double, 6>(u.data()), 100);
  }
  motors.expect_below(1000 * kEpsilon<S>);
}

TYPED_TEST(PlatformInSpace, FreeBodyObeysEuler) {
  using S = TypeParam;
  Accuracy wrench("wrench");
  for (std::uint64_t seed = 0; seed < kCases; ++seed) {
    Random r(seed);
    const auto body = random_body<S>(r);
    const auto m = make_free_body(body, S(9));
    const PlatformState<S> state{r.vector<S, 3>(2), random_attitude<S>(r), r.vector<S, 6>(5)};
    typename FreeBody<S>::Pose pose;
    ASSERT_TRUE(m.pose(state.position, state.attitude, pose));
    SpatialPlant::Input u{};
    for (double& f : u) f = r.in<double>(-1, 1);
    const SpatialPlant plant({double(body.mass), body.inertia.template cast<double>()}, 9.0);
    const auto s = state.plant();
    const auto a = independent_acceleration(s, plant.acceleration(s, u));
    const auto rates = m.chain_rates(pose, state.rate);
    const auto v = m.channel_accelerations(
        pose, rates, rates, m.chain_accelerations(pose, rates, Vec<S, 6>(a.template cast<S>())));
    Vec<S, 6> got = m.gather(pose, m.force(v, m.channel_rates(pose, rates)));
    wrench.compare(seed, got, Vec<double, 6>(u.data()), 10);
  }
  wrench.expect_below(100 * kEpsilon<S>);
}

/// M, C: energy of all bodies by the channels and by the plant.
TYPED_TEST(PlatformInSpace, KineticEnergyIsThatOfThePlant) {
  using S = TypeParam;
  Accuracy energy("energy");
  for (std::uint64_t seed = 0; seed < kCases; ++seed) {
    Random r(seed);
    const auto params = random_hexapod<S>(r);
    const auto m = make_hexapod(params);
    const auto state = PlatformState<S>::near_home(params, r);
    typename Hexapod<S>::Pose pose;
    ASSERT_TRUE(m.pose(state.position, state.attitude, pose));
    const auto p = m.channel_rates(pose, m.chain_rates(pose, state.rate));
    const auto M = mass_of(m);
    Vec<S, 1> got = Vec<S, 1>::Zero();
    for (int i = 0; i < p.size(); ++i) got[0] += S(0.5) * M[i] * p[i] * p[i];
    energy.compare(seed, got, Vec<double, 1>(SpatialPlant(in_double(params)).energy(state.plant()).kinetic));
  }
  energy.expect_below(50 * kEpsilon<S>);
}

/// Cdot(a) b of all channels: a difference quotient along the motion a, for b other than a as well.
TEST(PlatformInSpaceDrift, IsTheDerivativeOfC) {
  Accuracy drift("drift");
  for (std::uint64_t seed = 0; seed < 30; ++seed) {
    Random r(seed);
    const auto params = random_hexapod<double>(r);
    const auto m = make_hexapod(params);
    const auto state = PlatformState<double>::near_home(params, r);
    const Vec<double, 6> b = r.vector<double, 6>(2);
    Hexapod<double>::Pose pose;
    ASSERT_TRUE(m.pose(state.position, state.attitude, pose));
    const auto ra = m.chain_rates(pose, state.rate), rb = m.chain_rates(pose, b);
    const auto got = m.channel_accelerations(pose, ra, rb, m.chain_bias(pose, ra, rb));
    const auto at = [&](double t) {
      const Vec3<double> v = state.rate.head<3>(), w = state.rate.tail<3>();
      Hexapod<double>::Pose there;
      EXPECT_TRUE(m.pose(Vec3<double>(state.position + v * t),
                         Quaternion<double>(state.attitude * exponential(Vec3<double>(w * t))), there));
      return m.channel_rates(there, m.chain_rates(there, b));
    };
    const double h = 1e-4;
    const Hexapod<double>::Channels near = at(h) - at(-h), far = at(2 * h) - at(-2 * h),
                                    want = (near * 8 - far) / (12 * h);
    drift.compare(seed, got, want, 1);
  }
  drift.expect_below(1e-9);
}

/// A leg that points along the first axis of its universal joint has no joint angles; what is not a number
/// neither.
TEST(PlatformInSpaceReach, TypeOneIsRefused) {
  const StrutParams<double> strut{0.1, 1, 0.01, 0.01, 0};
  const UpsLeg<double> leg({0, 0, 0}, {0, 0, 1}, strut, strut, 9.8);
  UpsLeg<double>::Pose pose;
  EXPECT_FALSE(leg.reach({0.5, 0, 0}, pose));
  EXPECT_FALSE(leg.reach({std::nan(""), 0, 0.5}, pose));
  ASSERT_TRUE(leg.reach({0.3, -0.2, 0.5}, pose));
  EXPECT_LT((pose.tip - Vec3<double>(0.3, -0.2, 0.5)).norm(), 1e-15);
}

}  // namespace
}  // namespace esmc::test
