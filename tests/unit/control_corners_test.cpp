// Corners of references that ordinary motions never meet: what nobody set, one-tick rounds, the sign of zero.
// Each was found as a change of the code that no other test noticed.

#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "firmware/control/reference.hpp"

namespace esmc::test {
namespace {

template <class S>
class ControlCorners : public testing::Test {};
using Scalars = testing::Types<float, double>;
TYPED_TEST_SUITE(ControlCorners, Scalars);

TYPED_TEST(ControlCorners, UnsetReferenceStandsStill) {
  using S = TypeParam;
  const PhaseClock clock;
  for (const std::uint32_t tick : {0U, 1U, 12345U, 0xFFFF'FFFFU})
    EXPECT_EQ(clock.angle<S>(tick), S(0)) << tick;
  EXPECT_EQ(Quintic<S>{}.duration, S(1));
  EXPECT_EQ(PathSegment<S>{}.start_tick, 0U);
  EXPECT_EQ(PathSegment<S>{}.offset, S(0));
  const Reference<S> r;
  EXPECT_EQ(r.kind, ReferenceKind::hold_start);
  EXPECT_EQ(r.space, ReferenceSpace::effector);
  EXPECT_EQ(r.repeat_ticks, 0U);
}

TYPED_TEST(ControlCorners, HoldingIsNoCircleWhateverElseIsSet) {
  using S = TypeParam;
  Reference<S> r;
  r.centre = Vec2<S>(S(0.25), S(-0.5));
  r.amplitude = Vec2<S>(S(1), S(2));
  r.speed = Vec2<S>(S(3), S(4));
  r.phase[0].per_tick = r.phase[1].per_tick = 1ULL << 60U;
  for (const std::uint32_t tick : {0U, 1U, 7U}) {
    const Motion2<S> m = r.at(tick, S(0.001));
    EXPECT_EQ(m.position, r.centre);
    EXPECT_EQ(m.velocity, Vec2<S>(S(0), S(0)));
    EXPECT_EQ(m.acceleration, Vec2<S>(S(0), S(0)));
  }
}

/// At phase 0: position (r, 0), velocity (0, r w), acceleration (-r w^2, 0).
TYPED_TEST(ControlCorners, ACircleHasTheFirstRadiusAndTheFirstSpeed) {
  using S = TypeParam;
  Reference<S> r;
  r.kind = ReferenceKind::circle;
  r.amplitude = Vec2<S>(S(0.5), S(64));
  r.speed = Vec2<S>(S(4), S(128));
  const Motion2<S> m = r.at(0, S(0.001));
  EXPECT_EQ(m.position, Vec2<S>(S(0.5), S(0)));
  EXPECT_EQ(m.velocity, Vec2<S>(S(0), S(2)));
  EXPECT_EQ(m.acceleration, Vec2<S>(S(-8), S(0)));
}

TYPED_TEST(ControlCorners, ARoundOfOneTickIsItsFirstTick) {
  using S = TypeParam;
  PathSegment<S> s;
  s.curve = Quintic<S>::between({}, {Vec2<S>(S(1), S(2)), Vec2<S>(S(0), S(0)), Vec2<S>(S(0), S(0))}, S(10));
  Reference<S> r;
  r.kind = ReferenceKind::path;
  r.path = {&s, 1};
  ASSERT_NE(r.at(5, S(1)).position, r.at(0, S(1)).position);
  r.repeat_ticks = 1;
  for (std::uint32_t tick = 0; tick < 12; ++tick)
    EXPECT_EQ(r.at(tick, S(1)).position, r.at(0, S(1)).position) << tick;
}

/// The second piece begins in its start tick and not one later: here it begins elsewhere.
TYPED_TEST(ControlCorners, APieceOfAPathBeginsInItsTick) {
  using S = TypeParam;
  const Vec2<S> nothing(S(0), S(0));
  const auto resting = [&](S where) {
    const Motion2<S> m{Vec2<S>(where, where), nothing, nothing};
    return Quintic<S>::between(m, m, S(4));
  };
  const std::array<PathSegment<S>, 3> path{
      {{0, S(0), resting(S(1))}, {4, S(0), resting(S(2))}, {8, S(0), resting(S(3))}}};
  Reference<S> r;
  r.kind = ReferenceKind::path;
  r.path = path;
  for (std::uint32_t tick = 0; tick < 12; ++tick) {
    EXPECT_EQ(r.at(tick, S(1)).position[0], tick < 4 ? S(1) : (tick < 8 ? S(2) : S(3))) << tick;
  }
}

/// The shortest join: in its only tick it is where the mechanism is.
TYPED_TEST(ControlCorners, AJoinOfOneTickStartsAtThePresent) {
  using S = TypeParam;
  Reference<S> r;
  r.kind = ReferenceKind::circle;
  r.centre = Vec2<S>(S(2), S(4));
  JoinedReference<S> j(r, 1, S(0.5));
  j.start(Vec2<S>(S(1), S(8)), Vec2<S>(S(0.25), S(-1)));
  EXPECT_EQ(j.at(0).position, Vec2<S>(S(1), S(8)));
  EXPECT_EQ(j.at(0).velocity, Vec2<S>(S(0.25), S(-1)));
  EXPECT_EQ(j.at(1).position, r.centre);
}

/// A time is clamped to [0, duration], and -0 is 0: nothing of the curve turns its sign.
TYPED_TEST(ControlCorners, ANegativeZeroOfTimeIsZero) {
  using S = TypeParam;
  const Vec2<S> nothing(S(0), S(0));
  const auto curve = Quintic<S>::between({Vec2<S>(S(-0.0), S(-0.0)), nothing, nothing},
                                         {Vec2<S>(S(1), S(1)), nothing, nothing}, S(2));
  ASSERT_TRUE(std::signbit(curve.c[0][0]));
  EXPECT_FALSE(std::signbit(curve.at(S(0)).position[0]));
  EXPECT_FALSE(std::signbit(curve.at(S(-0.0)).position[0]));
}

TYPED_TEST(ControlCorners, UnsetReferenceIsNotJoined) {
  using S = TypeParam;
  JoinedReference<S> j;
  const Vec2<S> here(S(0.5), S(0.25));
  j.start(here, Vec2<S>(S(3), S(-2)));
  for (const std::uint32_t tick : {0U, 1U, 2U}) {
    const Motion2<S> m = j.at(tick);
    EXPECT_EQ(m.position, here) << tick;
    EXPECT_EQ(m.velocity, Vec2<S>(S(0), S(0))) << tick;
  }
}

}  // namespace
}  // namespace esmc::test
