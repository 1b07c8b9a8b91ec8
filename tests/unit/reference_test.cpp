// Reference motions: velocities and accelerations are the derivatives of positions for every kind, joins and
// ends are smooth, and the clock neither drifts nor loses digits after a billion ticks.
//
// Derivatives are taken by sixth-order central differences of what `at` returns at seven neighbouring ticks.
// Their error is step^6 / 140 of the seventh derivative, and 2 epsilon / step from rounding, in units of the
// motion.

#include "firmware/control/reference.hpp"

#include <gtest/gtest.h>

#include <vector>

#include "firmware/cycle/tick_result.hpp"
#include "tests/support/random_mechanism.hpp"

namespace esmc::test {
namespace {

template <class S>
class References : public testing::Test {};
TYPED_TEST_SUITE(References, Scalars, ScalarName);

constexpr Real kTurn = 2 * std::numbers::pi_v<long double>;

/// The clock of a phase that advances by `step` rad a tick from `start`, in 2^-64 turns.
PhaseClock clock_of(Real start, Real step) {
  const auto turns = [](Real angle) {
    const Real t = angle / kTurn;
    return static_cast<std::uint64_t>(std::llrint((t - std::floor(t)) * 0x1p62L)) * 4U;
  };
  return {turns(start), turns(step)};
}

/// Errors of velocity and acceleration against differences of position and velocity around `tick`.
template <class S, class Motion>
Vec<Real, 2> derivative_errors(const Motion& at, std::uint32_t tick, Real dt) {
  constexpr std::array<Real, 3> weight{45.0L / 60, -9.0L / 60, 1.0L / 60};
  Vec<Real, 2> velocity = Vec<Real, 2>::Zero(), acceleration = velocity;
  for (std::uint32_t k = 1; k <= 3; ++k) {
    const Motion2<S> next = at(tick + k), last = at(tick - k);
    velocity +=
        weight[k - 1] / dt * (next.position.template cast<Real>() - last.position.template cast<Real>());
    acceleration +=
        weight[k - 1] / dt * (next.velocity.template cast<Real>() - last.velocity.template cast<Real>());
  }
  const Motion2<S> now = at(tick);
  return {(now.velocity.template cast<Real>() - velocity).cwiseAbs().maxCoeff(),
          (now.acceleration.template cast<Real>() - acceleration).cwiseAbs().maxCoeff()};
}

TYPED_TEST(References, CircleAndSineMoveAsTheySay) {
  using S = TypeParam;
  const bool single = std::is_same_v<S, float>;
  const Real step = single ? 0.2L : 0.02L;  // rad per tick
  Accuracy velocity("velocity"), acceleration("acceleration"), place("position");
  for (std::uint64_t seed = 0; seed < 400; ++seed) {
    Random r(seed);
    const Real dt = r.between(1e-4, 1e-2), turn = step * (r.sign() > 0 ? 1 : -1), start = r.between(-3, 3);
    const S speed = static_cast<S>(turn / dt);
    Reference<S> ref;
    ref.kind = seed % 2 == 0 ? ReferenceKind::circle : ReferenceKind::sine;
    ref.centre = r.vector<S, 2>(0.3);
    ref.amplitude = Vec2<S>(r.in<S>(0.05, 0.3), r.in<S>(0.05, 0.3));
    ref.speed = Vec2<S>(speed, speed);
    const Real other = r.between(-3, 3);
    ref.phase = {{clock_of(start, turn), clock_of(other, turn)}};
    const auto at = [&](std::uint32_t tick) { return ref.at(tick, static_cast<S>(dt)); };
    for (const std::uint32_t tick : {3U, 1000U, 1'000'000'000U, 4'294'967'000U}) {
      const Vec<Real, 2> e = derivative_errors<S>(at, tick, dt);
      const Real size = Real(ref.amplitude.maxCoeff()) * std::fabs(Real(speed));
      velocity.take(seed, e[0] / size);
      acceleration.take(seed, e[1] / (size * std::fabs(Real(speed))));
    }
    // The shape itself, at tick 0.
    const Motion2<S> m = at(0);
    const Real a0 = Real(ref.amplitude[0]), a1 = Real(ref.amplitude[1]);
    const Vec<Real, 2> want = ref.kind == ReferenceKind::circle
                                  ? Vec<Real, 2>(a0 * std::cos(start), a0 * std::sin(start))
                                  : Vec<Real, 2>(a0 * std::sin(start), a1 * std::sin(other));
    place.compare(seed, m.position, (want + ref.centre.template cast<Real>()).eval(), 0.3L);
  }
  velocity.expect_below(single ? 3e-6 : 3e-12);
  acceleration.expect_below(single ? 3e-6 : 3e-12);
  place.expect_below(4 * kEpsilon<S>);
}

/// start + per_tick * tick in long double by halves, no 64-bit wrap-around involved.
Real exact_angle(const PhaseClock& c, std::uint32_t tick) {
  const Real high = static_cast<Real>(c.per_tick >> 32U) * static_cast<Real>(tick);  // 2^-32 turn, exact
  const Real low =
      static_cast<Real>(c.per_tick & 0xFFFFFFFFU) * static_cast<Real>(tick);  // 2^-64 turn, exact
  const Real turns =
      std::fmod(high, 0x1p32L) * 0x1p-32L + low * 0x1p-64L + static_cast<Real>(c.start) * 0x1p-64L;
  return detail::wrap((turns - std::floor(turns)) * kTurn);
}

TYPED_TEST(References, PhaseClockIsAsExactAfterABillionTicks) {
  using S = TypeParam;
  const Real pi = kTurn / 2;
  Accuracy angle("angle");
  for (std::uint64_t seed = 0; seed < 5000; ++seed) {
    Random r(seed);
    const PhaseClock c = clock_of(r.between(-3.1, 3.1), r.between(-0.5, 0.5));
    for (const std::uint32_t tick : {0U, 1U, 999U, 1'000'000'000U, 1'000'000'001U, 4'294'967'295U}) {
      const S got = c.template angle<S>(tick);
      // One rounding to S; in float the 2^-32 turn that 32 bits drop are below it.
      angle.take(seed, std::fabs(detail::wrap(Real(got) - exact_angle(c, tick))));
      EXPECT_LE(std::fabs(Real(got)), Real(static_cast<S>(pi))) << "seed " << seed;
    }
  }
  angle.expect_below(3.2L * kEpsilon<S>);
  // A whole number of ticks per turn comes back to the same bits for ever.
  const PhaseClock eighth{12345U << 12U, std::uint64_t{1} << 61U};
  EXPECT_EQ(eighth.template angle<S>(3), eighth.template angle<S>(1'000'000'003U));
  const PhaseClock backward{0, ~std::uint64_t{0} - (std::uint64_t{1} << 61U) + 1};
  EXPECT_EQ(backward.template angle<S>(1'000'000'001U), static_cast<S>(-pi / 4));
  EXPECT_EQ((PhaseClock{std::uint64_t{1} << 63U, 0}.template angle<S>(7)), static_cast<S>(-pi));
}

template <class S>
Motion2<S> random_motion(Random& r) {
  return {r.vector<S, 2>(0.5), r.vector<S, 2>(1), r.vector<S, 2>(10)};
}
template <class S>
Real motion_error(const Motion2<S>& a, const Motion2<S>& b, Real time) {
  return std::fmax(
      Accuracy::relative(a.position, b.position, 0.5L),
      std::fmax(Accuracy::relative(Vec2<S>(a.velocity * S(time)), Vec2<S>(b.velocity * S(time)), 0.5L),
                Accuracy::relative(Vec2<S>(a.acceleration * S(time * time)),
                                   Vec2<S>(b.acceleration * S(time * time)), 0.5L)));
}

/// Six end conditions, and a vanishing sixth difference: there is one such polynomial.
TYPED_TEST(References, QuinticIsThePolynomialOfItsEnds) {
  using S = TypeParam;
  Accuracy begin("begin"), ends("ends"), sixth("sixth_difference"), velocity("velocity"),
      acceleration("acceleration");
  for (std::uint64_t seed = 0; seed < 1000; ++seed) {
    Random r(seed);
    const S duration = r.in<S>(0.2, 1.5);
    const auto a = random_motion<S>(r), b = random_motion<S>(r);
    const auto q = Quintic<S>::between(a, b, duration);
    const Real d = Real(duration);
    const Real size = 0.5L + d + 10 * d * d;  // what the coefficients are made of
    begin.take(seed, motion_error(q.at(S(0)), a, d));
    ends.take(seed, motion_error(q.at(duration), b, d) / size);
    // Positions at eight points, 1/8 apart; the points are exact fractions of the duration up to its
    // rounding.
    Vec<Real, 2> difference = Vec<Real, 2>::Zero();
    constexpr std::array<Real, 7> binomial{1, -6, 15, -20, 15, -6, 1};
    for (int k = 0; k <= 6; ++k) {
      difference +=
          binomial[static_cast<unsigned>(k)] * q.at(duration * S(k) / S(8)).position.template cast<Real>();
    }
    sixth.take(seed, difference.cwiseAbs().maxCoeff() / size);
    const Real h = d / 16;
    const auto at = [&](std::uint32_t tick) { return q.at(duration * S(tick) / S(16)); };
    for (std::uint32_t tick = 3; tick <= 13; ++tick) {
      const Vec<Real, 2> e = derivative_errors<S>(at, tick, h);
      velocity.take(seed, e[0] * d / size);
      acceleration.take(seed, e[1] * d * d / size);
    }
  }
  begin.expect_below(5 * kEpsilon<S>);
  ends.expect_below(1000 * kEpsilon<S>);  // of the acceleration, 20 c5 with c5 up to 15 times the size
  for (const Accuracy* x : {&sixth, &velocity, &acceleration}) x->expect_below(1000 * kEpsilon<S>);
}

/// A path of quintics through random motions, each taking a whole number of ticks, twice continuously
/// differentiable.
template <class S>
struct Path {
  std::vector<PathSegment<S>> segments;
  std::vector<std::uint32_t> start;
  std::vector<Motion2<S>> motion;
  S dt{};
  std::uint32_t end = 0;

  explicit Path(std::uint64_t seed, bool ends_at_rest) {
    Random r(seed);
    dt = r.in<S>(0.005, 0.02);
    const int n = 1 + static_cast<int>(seed % 6);
    motion.push_back(random_motion<S>(r));
    for (int i = 0; i < n; ++i) {
      const auto ticks = static_cast<std::uint32_t>(20 + r.between(0, 40));
      Motion2<S> next = random_motion<S>(r);
      if (i + 1 == n && ends_at_rest) next.velocity = next.acceleration = Vec2<S>::Zero();
      segments.push_back({end, S(0), Quintic<S>::between(motion.back(), next, S(ticks) * dt)});
      start.push_back(end);
      motion.push_back(next);
      end += ticks;
    }
  }
  [[nodiscard]] Reference<S> reference() const {
    Reference<S> ref;
    ref.kind = ReferenceKind::path;
    ref.path = segments;
    return ref;
  }
};

TYPED_TEST(References, PathPassesThroughItsPointsSmoothly) {
  using S = TypeParam;
  Accuracy points("points"), velocity("velocity"), acceleration("acceleration");
  for (std::uint64_t seed = 0; seed < 300; ++seed) {
    const Path<S> p(seed, false);
    const auto ref = p.reference();
    const auto at = [&](std::uint32_t tick) { return ref.at(tick, p.dt); };
    for (std::size_t i = 0; i < p.segments.size(); ++i) {
      const std::uint32_t next = i + 1 < p.segments.size() ? p.start[i + 1] : p.end;
      points.take(seed, motion_error(at(p.start[i]), p.motion[i], 1));
      points.take(seed, motion_error(at(next), p.motion[i + 1], 1));
      for (std::uint32_t tick = p.start[i] + 3; tick + 3 <= next; ++tick) {
        const Vec<Real, 2> e = derivative_errors<S>(at, tick, Real(p.dt));
        velocity.take(seed, e[0] * Real(p.dt));
        acceleration.take(seed, e[1] * Real(p.dt) * Real(p.dt));
      }
    }
  }
  points.expect_below(3000 * kEpsilon<S>);
  for (const Accuracy* x : {&velocity, &acceleration}) x->expect_below(20 * kEpsilon<S>);  // of half a metre
}

/// A torque holds for a tick: what is followed changes the velocity in a tick as much as the path does, in
/// every round, before its beginning and after its end too; of other shapes it is the motion itself.
TYPED_TEST(References, FollowedAccelerationIsTheMeanOfTheTick) {
  using S = TypeParam;
  Accuracy mean("mean"), half("between ticks");
  for (std::uint64_t seed = 0; seed < 100; ++seed) {
    const Path<S> p(seed, true);
    for (const bool repeats : {false, true}) {
      auto ref = p.reference();
      if (repeats) ref.repeat_ticks = p.end;
      for (std::uint32_t tick = 0; tick < 2 * p.end; ++tick) {
        const Motion2<S> m = ref.from(tick, p.dt), now = ref.at(tick, p.dt);
        EXPECT_EQ(m.position, now.position);
        EXPECT_EQ(m.velocity, now.velocity);
        const Vec2<S> gained = ref.at(tick + 1, p.dt).velocity - now.velocity;
        mean.take(seed, Accuracy::relative(Vec2<S>(m.acceleration * p.dt), gained, 0.5L));
        const TickTime t{tick, 1U << (TickTime::bits - 1)};
        const Vec2<S> later =
            ref.at(TickTime{tick + 1, t.fraction}, p.dt).velocity - ref.at(t, p.dt).velocity;
        half.take(seed, Accuracy::relative(Vec2<S>(ref.from(t, p.dt).acceleration * p.dt), later, 0.5L));
      }
    }
    Reference<S> circle;
    circle.kind = ReferenceKind::circle;
    circle.amplitude = Vec2<S>(S(0.1), S(0.1));
    circle.speed = Vec2<S>(S(3), S(3));
    circle.phase = {{clock_of(0, 3 * Real(p.dt)), clock_of(1, 3 * Real(p.dt))}};
    EXPECT_EQ(circle.from(seed, p.dt).acceleration, circle.at(seed, p.dt).acceleration);
  }
  mean.expect_below(4 * kEpsilon<S>);
  half.expect_below(4 * kEpsilon<S>);
}

/// "then rest at the end": whatever the last segment ends with, a position that no longer changes has no
/// velocity.
TYPED_TEST(References, PathRestsAfterItsEnd) {
  using S = TypeParam;
  for (const bool ends_at_rest : {true, false}) {
    Accuracy place("position"), velocity("velocity"), acceleration("acceleration");
    for (std::uint64_t seed = 0; seed < 12; ++seed) {
      const Path<S> p(seed, ends_at_rest);
      const auto ref = p.reference();
      for (const std::uint32_t after : {1U, 2U, 1000U, 4'000'000'000U}) {
        const Motion2<S> m = ref.at(p.end + after, p.dt);
        place.compare(seed, m.position, p.motion.back().position, 0.5L);
        velocity.take(seed, Real(m.velocity.cwiseAbs().maxCoeff()));
        acceleration.take(seed, Real(m.acceleration.cwiseAbs().maxCoeff()));
      }
    }
    SCOPED_TRACE(ends_at_rest ? "ends at rest" : "ends in motion");
    place.expect_below(1000 * kEpsilon<S>);
    velocity.expect_below(1000 * kEpsilon<S>);
    acceleration.expect_below(10000 * kEpsilon<S>);
  }
}

/// A path that begins later than tick 0 waits at its first point; waiting is not moving.
TYPED_TEST(References, PathRestsBeforeItsBeginning) {
  using S = TypeParam;
  Accuracy place("position"), velocity("velocity");
  for (std::uint64_t seed = 0; seed < 12; ++seed) {
    Path<S> late(seed, true);
    for (auto& s : late.segments) s.start_tick += 50;
    const Motion2<S> m = late.reference().at(10, late.dt);
    place.compare(seed, m.position, late.motion.front().position);
    velocity.take(seed, Real(m.velocity.cwiseAbs().maxCoeff()));
  }
  place.expect_below(0);
  velocity.expect_below(0);
}

TYPED_TEST(References, RepeatOffsetAndEmptyPath) {
  using S = TypeParam;
  for (std::uint64_t seed = 0; seed < 100; ++seed) {
    Path<S> p(seed, true);
    auto ref = p.reference();
    const auto once = ref;
    ref.repeat_ticks = p.end;
    for (std::uint32_t tick = 0; tick < p.end; ++tick) {
      const Motion2<S> want = once.at(tick, p.dt);
      for (const std::uint32_t rounds : {0U, 1U, 2U, 10'000'000U}) {
        const Motion2<S> got = ref.at(tick + rounds * p.end, p.dt);
        EXPECT_EQ(got.position, want.position) << "seed " << seed << " tick " << tick;
        EXPECT_EQ(got.velocity, want.velocity) << "seed " << seed << " tick " << tick;
        EXPECT_EQ(got.acceleration, want.acceleration) << "seed " << seed << " tick " << tick;
      }
    }
    // A segment that started `offset` seconds before its tick is that much further on.
    const auto before = p.segments.front().curve.at(S(7) * p.dt);
    p.segments.resize(1);
    p.segments.front().offset = S(7) * p.dt;
    EXPECT_EQ(p.reference().at(0, p.dt).position, before.position) << "seed " << seed;
    Reference<S> empty;
    empty.centre = p.motion.front().position;
    for (const ReferenceKind kind : {ReferenceKind::path, ReferenceKind::hold_start}) {
      empty.kind = kind;
      const Motion2<S> m = empty.at(123456789, p.dt);
      EXPECT_EQ(m.position, empty.centre);
      EXPECT_EQ(m.velocity, Vec2<S>(S(0), S(0)));
      EXPECT_EQ(m.acceleration, Vec2<S>(S(0), S(0)));
    }
  }
}

/// 50 days at 1 kHz are 2^32 ticks: nothing begins anew.
TYPED_TEST(References, GoOnAfterFourThousandMillionTicks) {
  using S = TypeParam;
  constexpr std::uint64_t round = std::uint64_t{1} << 32U;
  static_assert(std::is_same_v<decltype(TickResult<FiveBar<S>>::running_tick), std::uint64_t>);
  const PhaseClock slow{0, std::uint64_t{1} << 28U};  // a turn in 2^36 ticks
  EXPECT_EQ(slow.template angle<S>(round * 4), static_cast<S>(kTurn / 4));
  EXPECT_EQ(slow.template angle<S>(round * 20), static_cast<S>(kTurn / 4));
  const Path<S> p(1, true);
  auto ref = p.reference();
  EXPECT_EQ(ref.at(round + 1, p.dt).position, ref.at(round - 1, p.dt).position) << "the path's end";
  ref.repeat_ticks = p.end;
  for (const std::uint64_t tick : {round - 1, round, round + 1}) {
    EXPECT_EQ(ref.at(tick, p.dt).position, ref.at(tick % p.end, p.dt).position) << tick;
  }
  ref.repeat_ticks = 0;
  JoinedReference<S> joined(ref, p.end, p.dt);
  joined.start(ref.at(0, p.dt).position + Vec2<S>(S(1), S(1)), Vec2<S>::Zero());
  EXPECT_EQ(joined.at(round).position, ref.at(round, p.dt).position) << "joins anew";
}

/// From where the mechanism is, at its velocity and without acceleration, onto any reference, smoothly to the
/// end.
TYPED_TEST(References, JoinStartsAtThePresentAndEndsOnTheReference) {
  using S = TypeParam;
  Accuracy begin("begin"), velocity("velocity"), acceleration("acceleration"), landing("landing");
  for (std::uint64_t seed = 0; seed < 300; ++seed) {
    Random r(seed);
    const Path<S> p(seed, true);
    Reference<S> ref = p.reference();
    ref.kind = static_cast<ReferenceKind>(seed % 4);
    const bool joints = (seed / 4) % 2 == 1;
    ref.space = joints ? ReferenceSpace::base_joints : ReferenceSpace::effector;
    ref.centre = r.vector<S, 2>(joints ? 3 : 0.3);
    ref.amplitude = Vec2<S>(S(0.2), S(0.1));
    const S dt = p.dt;
    const Real step = 0.05L;
    ref.speed = Vec2<S>(static_cast<S>(step / Real(dt)), static_cast<S>(step / Real(dt)));
    ref.phase = {{clock_of(0.3L, step), clock_of(2, step)}};
    const auto ticks = static_cast<std::uint32_t>(r.between(20, 200));
    JoinedReference<S> joined(ref, ticks, dt);
    const Vec2<S> position = r.vector<S, 2>(joints ? 3.1 : 0.4), speed = r.vector<S, 2>(1);
    joined.start(r.vector<S, 2>(1), r.vector<S, 2>(1));  // an earlier run must leave no trace
    joined.start(position, speed);

    const Motion2<S> first = joined.at(0);
    Motion2<S> want{position, speed, Vec2<S>::Zero()};
    if (joints) {  // the short way round, and the same direction
      for (int i = 0; i < 2; ++i) {
        const Real turns = std::round((Real(first.position[i]) - Real(position[i])) / kTurn);
        want.position[i] = static_cast<S>(Real(position[i]) + turns * kTurn);
        const Real away = Real(first.position[i]) - Real(joined.reference().at(0, dt).position[i]);
        EXPECT_LE(std::fabs(away), kTurn / 2 + 1e-5L) << "seed " << seed;
      }
    }
    const Real scale = 1 + std::fabs(Real(ref.speed[0])) + std::pow(Real(ref.speed[0]), 2);
    begin.take(seed, motion_error(first, want, 1) / scale);
    const auto at = [&](std::uint32_t tick) { return joined.at(tick); };
    if (ref.kind != ReferenceKind::path) {  // its corners are only twice differentiable
      for (std::uint32_t tick = 3; tick + 3 < ticks; ++tick) {
        const Vec<Real, 2> e = derivative_errors<S>(at, tick, Real(dt));
        velocity.take(seed, e[0] * Real(dt));
        acceleration.take(seed, e[1] * Real(dt) * Real(dt));
      }
    }
    for (const std::uint32_t tick : {ticks, ticks + 1, ticks + 1000}) {
      const Motion2<S> a = joined.at(tick), b = joined.reference().from(tick, dt);
      EXPECT_EQ(a.position, b.position) << "seed " << seed;
      EXPECT_EQ(a.velocity, b.velocity) << "seed " << seed;
      EXPECT_EQ(a.acceleration, b.acceleration) << "seed " << seed;
    }
    // One tick before, the offset is the quintic's end: its cube of what is left, 10 u^3 of the ends' size.
    const Motion2<S> a = joined.at(ticks - 1), b = joined.reference().at(ticks - 1, dt);
    const Real u = Real(1) / ticks, T = Real(ticks) * Real(dt);
    const Real size = 7 + 2 * T * scale * (1 + T);
    landing.take(seed, ((a.position - b.position).template cast<Real>().cwiseAbs().maxCoeff() -
                        20 * kEpsilon<S> * size) /
                           (10 * u * u * u * size));
  }
  begin.expect_below(20 * kEpsilon<S>);
  // step^6 / 140 for the sine, and rounding; of positions of up to 6 rad.
  velocity.expect_below(1e-11L + 50 * kEpsilon<S>);
  acceleration.expect_below(1e-11L + 50 * kEpsilon<S>);
  landing.expect_below(1);
}

TYPED_TEST(References, HoldStartHoldsWhereItStarted) {
  using S = TypeParam;
  Reference<S> hold;
  JoinedReference<S> joined(hold, 0, S(0.001));
  joined.start(Vec2<S>(S(0.1), S(0.2)), Vec2<S>(S(5), S(5)));
  EXPECT_EQ(joined.at(0).position, Vec2<S>(S(0.1), S(0.2)));
  EXPECT_EQ(joined.at(4'000'000'000U).position, Vec2<S>(S(0.1), S(0.2)));
  EXPECT_EQ(joined.at(0).velocity, Vec2<S>(S(0), S(0)));
  joined.start(Vec2<S>(S(0.3), S(0.4)), Vec2<S>(S(0), S(0)));
  EXPECT_EQ(joined.at(0).position, Vec2<S>(S(0.3), S(0.4)));
}

/// The float controller follows the same reference as the double one, after a billion ticks as after one.
TEST(ReferencesInFloat, AreTheDoubleOnes) {
  Accuracy position("position"), velocity("velocity");
  for (std::uint64_t seed = 0; seed < 200; ++seed) {
    Random r(seed);
    Reference<float> f;
    Reference<double> d;
    f.kind = d.kind = seed % 2 == 0 ? ReferenceKind::circle : ReferenceKind::sine;
    f.centre = r.vector<float, 2>(0.3);
    f.amplitude = Vec2<float>(0.25F, 0.125F);
    f.speed = Vec2<float>(10.0F, 10.0F);
    d.centre = f.centre.cast<double>();
    d.amplitude = f.amplitude.cast<double>();
    d.speed = f.speed.cast<double>();
    f.phase = d.phase = {{clock_of(r.between(-3, 3), 0.01L), clock_of(r.between(-3, 3), 0.01L)}};
    for (const std::uint32_t tick : {0U, 1U, 12345U, 1'000'000'000U, 4'294'967'295U}) {
      const auto a = f.at(tick, 0.001F);
      const auto b = d.at(tick, 0.001);
      position.compare(seed, a.position, b.position, 0.3L);
      velocity.compare(seed, a.velocity, b.velocity, 2.5L);
    }
  }
  position.expect_below(4 * kEpsilon<float>);
  velocity.expect_below(5 * kEpsilon<float>);
}

}  // namespace
}  // namespace esmc::test
