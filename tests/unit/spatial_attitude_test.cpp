// What is particular to a unit quaternion: two signs for one attitude, turns by 180 degrees, a norm that may
// drift, and no singularity where minimal coordinates have one.

#include <gtest/gtest.h>

#include "tests/support/spatial_loop.hpp"

namespace esmc::test {
namespace {

using D = double;

template <class S>
class Attitude : public testing::Test {};
TYPED_TEST_SUITE(Attitude, Scalars, ScalarName);

template <class M>
SpatialReference<typename M::Scalar> tumbling(const Vec3<D>& at) {
  using S = typename M::Scalar;
  SpatialReference<S> r;
  r.kind = SpatialReferenceKind::tumble;
  r.position = at.cast<S>();
  r.axis = Vec3<S>(S(0.6), S(0), S(0.8));
  r.rate = S(2 * 3.14159265358979 * 1.5);
  r.second_rate = S(2 * 3.14159265358979 * 0.5);
  r.phase.per_tick = static_cast<std::uint64_t>(1.5e-3 * 18446744073709551616.0);
  r.second_phase.per_tick = static_cast<std::uint64_t>(0.5e-3 * 18446744073709551616.0);
  return r;
}

/// A sensor and a reference that jump between q and -q as they like change not one bit, in any law.
TYPED_TEST(Attitude, SignsThatComeInDoNotMatter) {
  using S = TypeParam;
  using M = FreeBody<S>;
  for (const SpatialLaw law : {SpatialLaw::esmc, SpatialLaw::esmc_projected, SpatialLaw::smc_euler}) {
    auto config = body_config<S>();
    config.law = law;
    auto reference = tumbling<M>({0, 0, 0});
    if (law == SpatialLaw::smc_euler) reference.kind = SpatialReferenceKind::hold;
    SpatialLoop<M> plain{SpatialController<M>(config), reference, body_plant()}, flipped = plain;
    plain.state.attitude << 0.1, 0.7, -0.3, 0.64;  // more than 90 degrees off
    plain.state.attitude.normalize();
    plain.state.turning = {1, -2, 3};
    flipped.state = plain.state;
    Random r(7);
    int flips = 0;
    for (int n = 0; n < 2000; ++n) {
      plain.step();
      flipped.step([&](auto& sample, auto& wanted) {
        if (r.chance(0.5)) sample.attitude = sample.attitude.negative(), ++flips;
        if (r.chance(0.5)) wanted.attitude = wanted.attitude.negative();
      });
      ASSERT_EQ(plain.result.fault, SpatialFault::none) << n;
      ASSERT_TRUE((plain.result.input.array() == flipped.result.input.array()).all()) << n;
    }
    EXPECT_GT(flips, 800);
    EXPECT_LT(plain.angle(), 1e-3);
  }
}

/// By exactly 180 degrees about any axis: finite, in full strength, the same way for both signs, and it
/// arrives.
TYPED_TEST(Attitude, HalfATurnIsDefined) {
  using S = TypeParam;
  using M = FreeBody<S>;
  const Vec3<D> axes[] = {{1, 0, 0},  {0, 1, 0},  {0, 0, 1},      {-1, 0, 0},
                          {0, -1, 0}, {0, 0, -1}, {0.6, -0.8, 0}, {0, -0.6, 0.8}};
  for (const Vec3<D>& axis : axes) {
    Vec<S, 6> input[2];
    for (int sign = 0; sign < 2; ++sign) {
      SpatialLoop<M> loop{SpatialController<M>(body_config<S>()), {}, body_plant()};
      const D s = sign == 0 ? 1 : -1;
      loop.state.attitude << 0, s * axis;
      input[sign] = loop.step().input;
      ASSERT_EQ(loop.result.fault, SpatialFault::none);
      EXPECT_GT(input[sign].norm(), S(0.99 * 0.02 * 60))
          << "as strong as anywhere: k times the least inertia";
      for (int n = 0; n < 1500; ++n) loop.step();
      EXPECT_LT(loop.angle(), 1e-3);
    }
    EXPECT_TRUE((input[0].array() == input[1].array()).all()) << axis.transpose();
  }
}

/// Changes of the moment's direction about the axis of a half turn, under noise of 0.01 rad.
int dithers(D hysteresis) {
  using M = FreeBody<D>;
  auto config = body_config<D>();
  config.hysteresis = hysteresis;
  SpatialLoop<M> loop{SpatialController<M>(config), {}, body_plant()};
  Random r(3);
  int changes = 0;
  D last = 0;
  for (int n = 0; n < 300; ++n) {
    loop.state = {};  // held at the half turn, as by a hand
    loop.state.attitude << 0, 0, 0, 1;
    loop.step(
        [&](auto& sample, auto&) { sample.attitude = sample.attitude * exponential(r.vector<D, 3>(0.01)); });
    const D now = loop.result.input[5];
    if (n > 0 && (now > 0) != (last > 0)) ++changes;
    last = now;
  }
  return changes;
}

TEST(HalfATurn, HysteresisKeepsNoiseFromDithering) {
  EXPECT_GT(dithers(0), 100);
  EXPECT_EQ(dithers(0.1), 0);
}

/// A body that comes past the half turn is turned on, not back all the way it came: no unwinding. And the
/// long way is taken up to the margin alone.
TEST(HalfATurn, TheWayChangesOnceAndNotBack) {
  AttitudeChoice<D> choice(0.1);
  int changes = 0;
  D side = 1;
  for (D angle = 0; angle < 6.28; angle += 0.01) {
    const Quaternion<D> q = choice.choose(about(Vec3<D>(0, 0, 1), angle));
    if ((q.v.z() < 0) != (side < 0) && angle > 0.005) {
      ++changes;
      side = -side;
      EXPECT_NEAR(angle, 3.14159265 + 2 * std::asin(0.1), 0.02);
    }
  }
  EXPECT_EQ(changes, 1);
  for (D angle = 6.28; angle > 3.2; angle -= 0.01) {  // back past the margin of the other side
    EXPECT_LT(choice.choose(about(Vec3<D>(0, 0, 1), angle)).v.z(), 0);
  }
}

/// At the margin itself the way is kept; a reset forgets it; and a sample as far from the last one as its
/// negative is taken without a look at its sign.
TEST(HalfATurn, TheEdgesOfTheChoice) {
  const Quaternion<D> beyond{-0.5, Vec3<D>(0, 0, std::sqrt(0.75))}, before{0.0, Vec3<D>(0, 0, 1)};
  for (const D margin : {0.5, 0.49}) {
    AttitudeChoice<D> choice(margin);
    EXPECT_EQ(choice.choose(before).v.z(), 1);
    EXPECT_EQ(choice.choose(beyond).w, margin < 0.5 ? 0.5 : -0.5);
    choice.reset();
    EXPECT_EQ(choice.choose(beyond).w, 0.5);
  }
  for (const D sign : {1.0, -1.0}) {
    AttitudeChoice<D> choice(0.1);
    (void)choice.choose({0.0, Vec3<D>(1, 0, 0)});
    EXPECT_EQ(choice.choose({0.0, Vec3<D>(0, sign, 0)}).v.y(), 1);
  }
}

/// 90 degrees of pitch: the Euler law ends with the fault of its name, the quaternion laws do what they do
/// elsewhere. The same motion in a frame of reference in which nothing is singular gives the same moments.
TEST(Singularity, OfEulerAnglesIsNoneOfTheQuaternion) {
  using M = FreeBody<D>;
  SpatialReference<D> over;
  over.kind = SpatialReferenceKind::turn;
  over.axis = {0, 1, 0};
  over.angle = 3.0;
  over.duration = 1.5;
  for (const SpatialLaw law : {SpatialLaw::esmc, SpatialLaw::esmc_projected, SpatialLaw::smc_euler}) {
    auto config = body_config<D>();
    config.law = law;
    SpatialReference<D> elsewhere = over;
    elsewhere.attitude =
        about(Vec3<D>(1, 0, 0), 1.5707963267948966);  // its y axis is N's z: the turn is all yaw
    SpatialLoop<M> here{SpatialController<M>(config), over, body_plant()},
        there{SpatialController<M>(config), elsewhere, body_plant()};
    there.state.attitude << elsewhere.attitude.w, elsewhere.attitude.v;
    D most = 0, error = 0, apart = 0;
    for (int n = 0; n < 2000; ++n) {
      here.step();
      there.step();
      ASSERT_EQ(there.result.fault, SpatialFault::none);
      if (here.result.fault != SpatialFault::none) break;
      most = std::fmax(most, here.result.input.tail<3>().cwiseAbs().maxCoeff());
      error = std::fmax(error, here.angle());
      apart = std::fmax(apart, (here.result.input - there.result.input).tail<3>().cwiseAbs().maxCoeff());
    }
    if (law == SpatialLaw::smc_euler) {
      EXPECT_EQ(here.result.fault, SpatialFault::euler_singular);
      EXPECT_LT(here.n, 1000U);
    } else {
      EXPECT_EQ(here.result.fault, SpatialFault::none);
      EXPECT_LT(error, 1e-5);
      EXPECT_GT(most, 0.2);
      EXPECT_LT(apart, 1e-7 * most);
    }
  }
}

/// The norm of an attitude stays 1: of the reference of a spin, which is a function of the tick and
/// integrates nothing; of the plant, scaled every step.
TEST(AttitudeOfLongRuns, StaysOnTheSphere) {
  auto spin = tumbling<FreeBody<float>>({0, 0, 0});
  Real worst = 0;
  for (std::uint32_t n = 0; n < 1000000; ++n) {
    const auto m = spin.at(n * 37U, 1e-3F);
    worst = std::fmax(worst, std::fabs(Real(m.attitude.squared_norm()) - 1));
  }
  EXPECT_LT(worst, 8 * kEpsilon<float>);
  const auto plant = body_plant();
  SpatialState s;
  s.turning = {3, -1, 2};
  const V3d momentum = plant.angular_momentum(s);
  D work = 0, drift = 0;
  for (int n = 0; n < 1000000; ++n) drift = std::fmax(drift, plant.step(s, {}, 1e-3, work));
  EXPECT_LT(drift, 1e-12);
  EXPECT_LT(std::fabs(s.attitude.norm() - 1), 1e-15);
  EXPECT_LT((plant.angular_momentum(s) - momentum).norm(), 1e-7 * momentum.norm());
}

/// NaN and infinity anywhere: a named fault, latched, and no force.
TYPED_TEST(Attitude, WhatIsNotANumberIsAFault) {
  using S = TypeParam;
  using M = FreeBody<S>;
  for (const S bad : {std::numeric_limits<S>::quiet_NaN(), std::numeric_limits<S>::infinity()}) {
    for (int entry = 0; entry < 13; ++entry) {
      SpatialLoop<M> loop{SpatialController<M>(body_config<S>(S(9))), {}, body_plant(9.0)};
      EXPECT_NE(loop.step().input.norm(), S(0));
      loop.step([&](SpatialSample<S>& x, auto&) {
        S* const entries[] = {&x.attitude.w,  &x.attitude.v[0], &x.attitude.v[1], &x.attitude.v[2],
                              &x.position[0], &x.position[1],   &x.position[2],   &x.velocity[0],
                              &x.velocity[1], &x.velocity[2],   &x.turning[0],    &x.turning[1],
                              &x.turning[2]};
        *entries[entry] = bad;
      });
      EXPECT_EQ(loop.result.fault, SpatialFault::not_finite) << entry;
      EXPECT_EQ(loop.result.input.norm(), S(0));
      EXPECT_EQ(loop.step().fault, SpatialFault::not_finite) << "latched";
      EXPECT_EQ(loop.result.input.norm(), S(0));
    }
  }
  SpatialLoop<M> loop{SpatialController<M>(body_config<S>()), {}, body_plant()};
  loop.step([](SpatialSample<S>& x, auto&) { x.attitude = {S(0.5), Vec3<S>::Zero()}; });
  EXPECT_EQ(loop.result.fault, SpatialFault::not_unit);
}

SpatialConfig<Hexapod<D>> platform_config(const HexapodParams<D>& p) {
  SpatialConfig<Hexapod<D>> c;
  c.mechanism = make_hexapod(p);
  c.gains = gains<D>(20, 40, 0.04);
  c.force_limit = 1e4;
  c.length = 0.2;
  return c;
}

/// Both singularities of the platform are faults of their name.
TEST(Singularity, OfThePlatformIsNamed) {
  Random r(5);
  auto p = random_hexapod<D>(r);
  using M = Hexapod<D>;
  SpatialReference<D> reference;
  reference.position = p.home;
  SpatialLoop<M> loop{SpatialController<M>(platform_config(p)), reference, SpatialPlant(p)};
  loop.state.position = p.home;
  EXPECT_EQ(loop.step().fault, SpatialFault::none);
  SpatialLoop<M> at_joint = loop;
  at_joint.step([&](auto&, auto& wanted) { wanted.position = p.base[2] - p.joint[2]; });
  EXPECT_EQ(at_joint.result.fault, SpatialFault::type1);
  // Similar hexagons, one turned by 90 degrees: the legs lie in one linear complex, the motors cannot hold
  // the platform.
  for (int j = 0; j < 6; ++j) {
    p.joint[j] = p.base[j] * 0.5;
    p.joint[j].z() = 0;
    p.base[j].z() = 0;
  }
  p.home = {0, 0, 0.5};
  loop.controller = SpatialController<M>(platform_config(p));
  loop.step([&](auto& sample, auto& wanted) {
    sample.position = wanted.position = p.home;
    sample.attitude = wanted.attitude = about(Vec3<D>(0, 0, 1), 1.5707963267948966);
  });
  EXPECT_EQ(loop.result.fault, SpatialFault::type2);
  EXPECT_EQ(loop.result.input.norm(), 0);
}

}  // namespace
}  // namespace esmc::test
