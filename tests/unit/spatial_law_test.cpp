// ESMC in space: what the closed loop does, from the plant's accelerations and difference quotients along its
// motion.

#include <gtest/gtest.h>

#include <Eigen/LU>

#include "tests/support/spatial_loop.hpp"

namespace esmc::test {
namespace {

using D = double;

/// A motion of the reference whose derivatives are known at any time, not only at ticks.
struct Wanted {
  Vec3<D> position, velocity, acceleration;
  Quaternion<D> attitude;
  Vec3<D> axis;
  D rate, change;

  Wanted(const Vec3<D>& home, const Quaternion<D>& start, Random& r)
      : position(home + r.vector<D, 3>(0.02)),
        velocity(r.vector<D, 3>(0.5)),
        acceleration(r.vector<D, 3>(2)),
        attitude(start),
        axis(r.vector<D, 3>(1).normalized()),
        rate(r.in<D>(-2, 2)),
        change(r.in<D>(-5, 5)) {}
  [[nodiscard]] SpatialMotion<D> at(D t) const {
    SpatialMotion<D> m;
    m.position = position + velocity * t + acceleration * (0.5 * t * t);
    m.velocity = velocity + acceleration * t;
    m.acceleration = acceleration;
    m.attitude = attitude * about(axis, rate * t + 0.5 * change * t * t);
    m.turning = axis * (rate + change * t);
    m.turning_rate = axis * change;
    return m;
  }
};

template <class M>
SpatialTracking<M> tracking(const M& m, const SpatialState& s, const SpatialMotion<D>& d) {
  SpatialTracking<M> t;
  const auto x = sample_of<D>(s);
  EXPECT_TRUE(m.pose(x.position, normalised(x.attitude), t.pose) &&
              m.pose(d.position, d.attitude, t.desired_pose));
  t.rates = m.chain_rates(t.pose, M::joined(x.velocity, x.turning));
  t.desired_rates = m.chain_rates(t.desired_pose, M::joined(d.velocity, d.turning));
  t.desired_acceleration =
      m.chain_accelerations(t.desired_pose, t.desired_rates, M::joined(d.acceleration, d.turning_rate));
  t.turn = shortest(x.attitude.conjugate() * d.attitude);
  return t;
}

/// What a law asks for, as inputs of the plant.
template <class M>
SpatialPlant::Input input(const M& m, const SpatialTracking<M>& t, const SpatialDemand<M>& demand) {
  Vec<D, 6> u = m.gather(t.pose, m.force(demand.acceleration, m.channel_rates(t.pose, t.rates)));
  if constexpr (M::legs > 0) {
    const Vec<D, 6> F = u;
    EXPECT_GT(m.template motor_forces<UpsLeg<D>::slide>(t.pose, F, 0.2, u), 0.01);
  }
  return {u[0], u[1], u[2], u[3], u[4], u[5]};
}

/// d/dt at t = 0 of f(state, wanted motion), the input held.
template <class F>
auto derivative(const SpatialPlant& plant, const SpatialState& s, const Wanted& wanted,
                const SpatialPlant::Input& u, F&& f) {
  const auto at = [&](D t) {
    SpatialState moved = s;
    D work = 0;
    plant.step(moved, u, t, work);
    return f(moved, wanted.at(t));
  };
  const D h = 2e-4;
  using V = decltype(at(h));
  const V near = at(h) - at(-h), far = at(2 * h) - at(-2 * h);
  return V((near * 8.0 - far) / (12 * h));
}

struct Body {
  using M = FreeBody<D>;
  RigidBodyParams<D> p;
  M m;
  SpatialPlant plant;
  SpatialState s;
  Wanted wanted;
  explicit Body(Random& r)
      : p(random_body<D>(r)),
        m(make_free_body(p, 9.0)),
        plant(p, 9.0),
        s(PlatformState<D>{r.vector<D, 3>(1), random_attitude<D>(r), r.vector<D, 6>(3)}.plant()),
        wanted(s.position, random_attitude<D>(r), r) {}
};
struct Six {
  using M = Hexapod<D>;
  HexapodParams<D> p;
  M m;
  SpatialPlant plant;
  SpatialState s;
  Wanted wanted;
  explicit Six(Random& r)
      : p(random_hexapod<D>(r)),
        m(make_hexapod(p)),
        plant(p),
        s(PlatformState<D>::near_home(p, r).plant()),
        wanted(p.home, exponential(r.vector<D, 3>(0.3)), r) {}
};

TEST(AttitudeErrorInSpace, RatesAreDerivatives) {
  Accuracy rate("e'"), feed("d/dt R_e w_d");
  for (std::uint64_t seed = 0; seed < 100; ++seed) {
    Random r(seed);
    const Body b(r);
    const auto error = [&](const SpatialState& s, const SpatialMotion<D>& d) {
      const auto x = sample_of<D>(s);
      return attitude_error(x.attitude.conjugate() * d.attitude, d.turning, d.turning_rate, x.turning);
    };
    const auto a = error(b.s, b.wanted.at(0));
    rate.compare(
        seed, a.e_rate,
        derivative(b.plant, b.s, b.wanted, {}, [&](const auto& s, const auto& d) { return error(s, d).e; }),
        1);
    // What is left of d/dt w~ when the body's own angular acceleration is taken out.
    const Vec3<D> own = independent_acceleration(b.s, b.plant.acceleration(b.s, {})).tail<3>();
    const Vec3<D> change = derivative(b.plant, b.s, b.wanted, {},
                                      [&](const auto& s, const auto& d) { return error(s, d).rate; });
    feed.compare(seed, a.of_reference, Vec3<D>(change + own), 10);
  }
  rate.expect_below(1e-9);
  feed.expect_below(1e-9);
}

/// s' + K sgn s = 0 in every one of six channels: as many as degrees of freedom, so nothing is left over.
TEST(EsmcInSpace, FreeBodySlidesRowByRow) {
  Accuracy rows("s' + K sgn s");
  const auto g = gains<D>(15, 7, 1);
  for (std::uint64_t seed = 0; seed < 100; ++seed) {
    Random r(seed);
    const Body b(r);
    const auto t = tracking(b.m, b.s, b.wanted.at(0));
    for (const bool projected : {false, true}) {
      const auto law = [&](const auto& at) {
        return projected ? projected_acceleration(b.m, g, Reaching::sign, at)
                         : esmc_acceleration(b.m, g, Reaching::sign, at);
      };
      const auto now = law(t);
      const Vec<D, 6> rate =
          derivative(b.plant, b.s, b.wanted, input(b.m, t, now),
                     [&](const auto& s, const auto& d) { return law(tracking(b.m, s, d)).sliding; });
      rows.compare(seed, rate, Vec<D, 6>(now.sliding.unaryExpr([](D s) { return s > 0 ? -7.0 : 7.0; })));
    }
  }
  rows.expect_below(1e-7);
}

/// The law in Euler angles does so in its own six coordinates, moving as it likes.
TEST(EsmcInSpace, MinimalCoordinatesSlideRowByRow) {
  Accuracy rows("s' + K sgn s");
  const auto g = gains<D>(15, 7, 1);
  int taken = 0;
  for (std::uint64_t seed = 0; seed < 100; ++seed) {
    Random r(seed);
    const Body b(r);
    const auto t = tracking(b.m, b.s, b.wanted.at(0));
    const auto far_from_pole = [](const Quaternion<D>& q) { return EulerChart<D>::at(q).pitch.cos > 0.5; };
    if (!far_from_pole(t.pose.attitude) || !far_from_pole(t.desired_pose.attitude)) continue;
    ++taken;
    SpatialDemand<Body::M> now;
    ASSERT_TRUE(euler_acceleration(b.m, g, Reaching::sign, t, now));
    const auto sliding = [&](const auto& s, const auto& d) {
      SpatialDemand<Body::M> there;
      EXPECT_TRUE(euler_acceleration(b.m, g, Reaching::sign, tracking(b.m, s, d), there));
      return there.sliding;
    };
    const Vec<D, 6> rate = derivative(b.plant, b.s, b.wanted, input(b.m, t, now), sliding);
    rows.compare(seed, rate, Vec<D, 6>(now.sliding.unaryExpr([](D s) { return s > 0 ? -7.0 : 7.0; })));
  }
  EXPECT_GT(taken, 30);
  rows.expect_below(1e-6);
}

template <class M>
Mat<D, 6, 6> mass_matrix(const M& m, const typename M::Pose& p) {
  Mat<D, 6, 6> H;
  for (int k = 0; k < 6; ++k) {
    const typename M::Channels column = m.channel_rates(p, m.chain_rates(p, Vec<D, 6>::Unit(k)));
    H.col(k) = m.gather(p, typename M::Channels(column.cwiseProduct(mass_of(m))));
  }
  return H;
}

/// C^T M (s' + K sgn s) = 0 [F31] and V' of [F32] for the platform on legs: 132 channels, six degrees of
/// freedom.
TEST(EsmcInSpace, PlatformObeysTheIdentitiesOfTheClosedLoop) {
  Accuracy identity("F31"), fall("F32");
  const auto g = gains<D>(15, 7, 1);
  for (std::uint64_t seed = 0; seed < 40; ++seed) {
    Random r(seed);
    const Six b(r);
    using M = Six::M;
    const auto t = tracking(b.m, b.s, b.wanted.at(0));
    const auto now = esmc_acceleration(b.m, g, Reaching::sign, t);
    const auto sliding = [&](const SpatialState& s, const SpatialMotion<D>& d) {
      return esmc_acceleration(b.m, g, Reaching::sign, tracking(b.m, s, d)).sliding;
    };
    const M::Channels rate = derivative(b.plant, b.s, b.wanted, input(b.m, t, now), sliding),
                      M0 = mass_of(b.m);
    M::Channels left = rate;
    D reaching = 0;
    for (int i = 0; i < M::channels; ++i) {
      left[i] += now.sliding[i] > 0 ? 7.0 : (now.sliding[i] < 0 ? -7.0 : 0.0);
      reaching += M0[i] * 7.0 * std::fabs(now.sliding[i]);
    }
    const Vec<D, 6> zero = b.m.gather(t.pose, M::Channels(left.cwiseProduct(M0)));
    identity.compare(seed, zero, Vec<D, 6>(Vec<D, 6>::Zero()),
                     Real(b.m.gather(t.pose, M::Channels(rate.cwiseProduct(M0))).norm()));
    const Vec<D, 6> sigma =
        mass_matrix(b.m, t.pose).inverse() * b.m.gather(t.pose, M::Channels(now.sliding.cwiseProduct(M0)));
    const M::Channels rest = now.sliding - b.m.channel_rates(t.pose, b.m.chain_rates(t.pose, sigma));
    Vec<D, 1> got, want;
    got << (now.sliding.cwiseProduct(M0)).dot(rate);
    want << -reaching + rest.cwiseProduct(M0).dot(left);
    EXPECT_GT(std::fabs(rest.cwiseProduct(M0).dot(left)), 1e-6)
        << "nothing left over: the identity is not put to the test";
    fall.compare(seed, got, want);
  }
  identity.expect_below(1e-7);
  fall.expect_below(1e-6);
}

/// The projected law: V = 1/2 sigma^T H sigma falls by V' = -sum M K |C sigma|, whatever the errors [F33].
TEST(EsmcInSpace, ProjectedPlatformFallsWithoutRemainder) {
  Accuracy fall("F33");
  const auto g = gains<D>(15, 7, 1);
  for (std::uint64_t seed = 0; seed < 40; ++seed) {
    Random r(seed);
    const Six b(r);
    const auto t = tracking(b.m, b.s, b.wanted.at(0));
    const auto now = projected_acceleration(b.m, g, Reaching::sign, t);
    const auto V = [&](const SpatialState& s, const SpatialMotion<D>& d) {
      const auto x = tracking(b.m, s, d);
      const Vec<D, 6> sigma = projected_acceleration(b.m, g, Reaching::sign, x).sliding.head<6>();
      Vec<D, 1> v;
      v << 0.5 * sigma.dot(mass_matrix(b.m, x.pose) * sigma);
      return v;
    };
    Vec<D, 1> want;
    want << -7.0 * mass_of(b.m).cwiseProduct(now.sliding.cwiseAbs()).sum();
    fall.compare(seed, derivative(b.plant, b.s, b.wanted, input(b.m, t, now), V), want);
  }
  fall.expect_below(1e-6);
}

/// Chart of Euler angles: both ways, and its drift by differences.
TEST(EulerAnglesInSpace, RatesTurningAndDriftBelongTogether) {
  Accuracy there("B"), back("B^-1"), drift("Bdot");
  for (std::uint64_t seed = 0; seed < 200; ++seed) {
    Random r(seed);
    const Vec3<D> a = r.vector<D, 3>(1.4), d = r.vector<D, 3>(2), dd = r.vector<D, 3>(3);
    const auto attitude = [&](D t) {
      const Vec3<D> x = a + d * t + dd * (0.5 * t * t);
      return Quaternion<D>(about(Vec3<D>::UnitZ().eval(), x[2]) * about(Vec3<D>::UnitY().eval(), x[1]) *
                           about(Vec3<D>::UnitX().eval(), x[0]));
    };
    const auto chart = EulerChart<D>::at(attitude(0));
    back.compare(seed, chart.angle, a, 1);
    const auto omega = [&](D t) {
      const D h = 1e-4;
      const Quaternion<D> q = attitude(t).conjugate();
      const auto log = [&](D by) { return logarithm(Quaternion<D>(q * attitude(t + by))); };
      return Vec3<D>(((log(h) - log(-h)) * 8 - (log(2 * h) - log(-2 * h))) / (12 * h));
    };
    there.compare(seed, chart.turning(d), omega(0), 1);
    const auto inverse = chart.rates(chart.turning(d));
    back.compare(seed, inverse, d, 1);
    const D h = 1e-3;
    const Vec3<D> change = ((omega(h) - omega(-h)) * 8 - (omega(2 * h) - omega(-2 * h))) / (12 * h);
    drift.compare(seed, Vec3<D>(chart.turning(dd) + chart.drift(d)), change, 10);
  }
  there.expect_below(1e-9);
  back.expect_below(1e-13);
  drift.expect_below(1e-8);
}

/// About a reference at rest and inside the layer the three laws are one, to first order in the error: what
/// they differ by falls with its square.
template <class Case>
void same_to_first_order(std::uint64_t seed) {
  Random r(seed);
  Case b(r);
  const Quaternion<D> level = exponential(r.vector<D, 3>(0.2));
  const Vec3<D> offset = r.vector<D, 3>(0.05), turn = r.vector<D, 3>(0.3);
  const Vec<D, 6> rate = r.vector<D, 6>(0.5);
  SpatialMotion<D> rest;
  rest.position = b.wanted.position;
  rest.attitude = level;
  const auto g = gains<D>(15, 30, 60);  // kappa = 0.5 1/s in every row
  const auto differences = [&](D size) {
    const PlatformState<D> x{rest.position + offset * size,
                             Quaternion<D>(level * exponential(Vec3<D>(turn * size))), rate * size};
    const auto t = tracking(b.m, x.plant(), rest);
    const auto force = [&](const auto& demand) {
      const auto u = input(b.m, t, demand);
      return Vec<D, 6>(u.data());
    };
    SpatialDemand<typename Case::M> euler;
    EXPECT_TRUE(euler_acceleration(b.m, g, Reaching::saturation, t, euler));
    SpatialTracking<typename Case::M> still = t;  // what holds it there: nothing of the error in it
    still.desired_pose = still.pose;
    still.turn = {};
    still.rates = still.desired_rates;
    const Vec<D, 6> full = force(esmc_acceleration(b.m, g, Reaching::saturation, t)), minimal = force(euler),
                    projected = force(projected_acceleration(b.m, g, Reaching::saturation, t)),
                    hold = force(esmc_acceleration(b.m, g, Reaching::saturation, still));
    return Vec3<D>((full - hold).norm(), (full - minimal).norm(), (projected - minimal).norm());
  };
  const Vec3<D> one = differences(1e-3), half = differences(5e-4);
  EXPECT_NEAR(one[0] / half[0], 2.0, 0.02) << seed << ": the law itself is of first order";
  EXPECT_NEAR(one[1] / half[1], 4.0, 0.2) << seed;
  EXPECT_NEAR(one[2] / half[2], 4.0, 0.2) << seed;
  EXPECT_LT(one[1], 0.02 * one[0]) << seed;
}

TEST(EsmcInSpace, IsTheMinimalLawToFirstOrder) {
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    same_to_first_order<Body>(seed);
    same_to_first_order<Six>(seed);
  }
}

/// With the sampled, implicit law every s falls by K h per tick until it is inside its step, and stays there.
TEST(EsmcInSpace, ReachesInTheTimeItSays) {
  SpatialLoop<FreeBody<D>> loop{SpatialController<FreeBody<D>>(body_config<D>(9.8)), {}, body_plant(9.8), {}};
  loop.state.attitude << std::cos(1.2), std::sin(1.2) * Vec3<D>(0.6, 0.0, 0.8);
  loop.state.position = {0.1, -0.05, 0.02};
  const Vec<D, 6> first = loop.step().sliding;
  const D k = 60, h = 1e-3;
  for (int i = 0; i < 6; ++i)
    EXPECT_GT(std::fabs(first[i]), i == 4 ? -1.0 : 0.3) << i;  // the axis of the turn has no y
  int reached = 0;
  for (int n = 1; n < 1000; ++n) {
    const Vec<D, 6> s = loop.step().sliding;
    for (int i = 0; i < 6; ++i) {
      const D left = std::fabs(first[i]) - k * h * n;
      if (left > k * h) {
        ASSERT_NEAR(std::fabs(s[i]), left, 0.02 * std::fabs(first[i])) << i << " at tick " << n;
      } else if (left < -3 * k * h) {
        ASSERT_LT(std::fabs(s[i]), 0.05 * k * h) << i << " at tick " << n;
        ++reached;
      }
    }
  }
  EXPECT_GT(reached, 1000);
  EXPECT_LT(loop.angle(), 1e-4);  // 20 time constants of 50 ms less what reaching took
}

}  // namespace
}  // namespace esmc::test
