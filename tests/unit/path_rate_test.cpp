/// Feed-rate override: references between ticks, and a path time that gets slower, stops and goes on.

#include "firmware/cycle/path_rate.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

namespace {

using namespace esmc;
using V = Vec2<double>;

constexpr double h = 1e-3, turn = 6.283185307179586;
constexpr std::uint32_t whole = 1U << TickTime::bits;

Reference<double> circle(double radius, double speed) {
  Reference<double> r;
  r.kind = ReferenceKind::circle;
  r.centre = V(0.1, -0.2);
  r.amplitude = V(radius, radius);
  r.speed = V(speed, speed);
  const auto turns = static_cast<std::int64_t>(std::ldexp(speed * h / turn, 62)) * 4;
  r.phase[0] = r.phase[1] = {0, static_cast<std::uint64_t>(turns)};
  return r;
}

/// Pieces of random length, none of whole ticks, through random motions.
std::vector<PathSegment<double>> random_path(std::mt19937& random, std::vector<double>& begin) {
  std::uniform_real_distribution<double> unit(-1, 1);
  const auto motion = [&] {
    return Motion2<double>{V(unit(random), unit(random)), V(unit(random), unit(random)),
                           V(unit(random), unit(random))};
  };
  std::vector<PathSegment<double>> out;
  double t = 0.0;
  Motion2<double> from = motion();
  for (int i = 0; i < 8; ++i) {
    const double duration = h * (6.5 + 4.0 * unit(random));
    const Motion2<double> to = motion();
    const auto start = static_cast<std::uint32_t>(std::ceil(t / h));
    out.push_back({start, start * h - t, Quintic<double>::between(from, to, duration)});
    begin.push_back(t);
    t += duration;
    from = to;
  }
  begin.push_back(t);
  return out;
}

TEST(PathRate, PathsBetweenTicksAreTheirPieces) {
  std::mt19937 random(5);
  std::uniform_int_distribution<std::uint32_t> fraction(0, whole - 1);
  for (int trial = 0; trial < 50; ++trial) {
    std::vector<double> begin;
    const auto path = random_path(random, begin);
    Reference<double> r;
    r.kind = ReferenceKind::path;
    r.path = path;
    const auto ticks = static_cast<std::uint32_t>(std::ceil(begin.back() / h)) + 2;
    if (trial % 2 == 1) r.repeat_ticks = ticks;
    for (std::uint64_t tick = 0; tick < 3 * ticks; ++tick) {
      const TickTime at{tick, tick % 5 == 0 ? 0U : fraction(random)};
      const double round = r.repeat_ticks > 0 ? double(tick % ticks) : double(tick);
      const double t = (round + double(at.fraction) / whole) * h;
      const auto next = std::upper_bound(begin.begin(), begin.end() - 1, t + 1e-15);
      const auto i = static_cast<std::size_t>(next - begin.begin()) - 1;
      Motion2<double> want = path[i].curve.at(t - begin[i]);
      if (t > begin.back()) want.velocity = want.acceleration = V(0, 0);
      const Motion2<double> got = r.at(at, h);
      ASSERT_LT((got.position - want.position).norm(), 1e-11) << trial << ' ' << tick;
      ASSERT_LT((got.velocity - want.velocity).norm() * h, 1e-9) << trial << ' ' << tick;
    }
  }
}

/// A plan leaves out pieces that no tick sees: between ticks the motion goes on there.
TEST(PathRate, PathsGoOnWhereAPieceIsLeftOut) {
  const auto motion = [](double t) {
    const V along(std::cos(20 * t), -std::sin(20 * t)), across(std::sin(20 * t), std::cos(20 * t));
    return Motion2<double>{across, along * 20.0, across * -400.0};
  };
  const auto piece = [&](double from, double to) {
    const double start = std::ceil(from);
    return PathSegment<double>{static_cast<std::uint32_t>(start), (start - from) * h,
                               Quintic<double>::between(motion(from * h), motion(to * h), (to - from) * h)};
  };
  const std::vector<PathSegment<double>> path{piece(0.0, 5.3), piece(5.7, 12.0)};
  Reference<double> r;
  r.kind = ReferenceKind::path;
  r.path = path;
  for (int k = 0; k < 1200; ++k) {
    const TickTime at{static_cast<std::uint64_t>(k / 100),
                      static_cast<std::uint32_t>(k % 100) * (whole / 100)};
    const auto want = motion((double(at.tick) + double(at.fraction) / whole) * h), got = r.at(at, h);
    ASSERT_LT((got.position - want.position).norm(), 1e-7) << k;
    ASSERT_LT((got.velocity - want.velocity).norm(), 1e-3) << k;
  }
}

TEST(PathRate, BeforeItsFirstPieceAPathRests) {
  const std::vector<PathSegment<double>> path{
      {5, 0.0, Quintic<double>::between({V(1, 2), V(3, 0), V(0, 0)}, {V(2, 2), V(0, 0), V(0, 0)}, 0.01)}};
  Reference<double> r;
  r.kind = ReferenceKind::path;
  r.path = path;
  for (const std::uint32_t tick : {2U, 4U}) {
    const auto m = r.at(TickTime{tick, whole / 2}, h);
    EXPECT_EQ(m.position, V(1, 2));
    EXPECT_EQ(m.velocity, V(0, 0));
  }
  EXPECT_GT(r.at(TickTime{5, whole / 2}, h).velocity[0], 3.0);
}

TEST(PathRate, PhasesBetweenTicksAreBetweenThem) {
  for (const double speed : {10.0, -7.0}) {
    const auto r = circle(0.05, speed);
    for (const std::uint64_t tick : {0ULL, 999ULL, 1'000'000'000ULL}) {
      const auto a = r.at(TickTime{tick, 0}, h), b = r.at(tick, h);
      EXPECT_EQ(a.position, b.position);
      // Halfway: in the middle of both neighbours' arc.
      const V from = b.position - r.centre, to = r.at(tick + 1, h).position - r.centre;
      const V middle = r.at(TickTime{tick, whole / 2}, h).position - r.centre;
      EXPECT_LT((middle - (from + to).normalized() * 0.05).norm(), 1e-12);
    }
  }
}

/// What a random operator makes of a reference, tick by tick.
struct Seen {
  double off = 0, jump = 0, velocity_jump = 0, along = 0, speed = 0;
};
template <class Off, class Wish>
Seen watch(PathRate<double>& rate, const JoinedReference<double>& reference, int ticks, const Off& off,
           const Wish& wish, bool feasible = true) {
  Seen s;
  Motion2<double> last;
  for (int i = 0; i < ticks; ++i) {
    wish(i);
    const auto m = rate.active() ? rate.step(reference, static_cast<std::uint64_t>(i), 0,
                                             [&](const Motion2<double>&) { return feasible; })
                                 : reference.at(static_cast<std::uint64_t>(i));
    s.off = std::max(s.off, off(m.position));
    s.speed = std::max(s.speed, m.velocity.norm());
    if (m.velocity.norm() > 1e-6)
      s.along = std::max(s.along, std::abs(m.acceleration.dot(m.velocity.normalized())));
    if (i > 0) {
      s.jump =
          std::max(s.jump, (m.position - last.position - (m.velocity + last.velocity) * (0.5 * h)).norm());
      s.velocity_jump =
          std::max(s.velocity_jump, (m.velocity - last.velocity - last.acceleration * h).norm());
    }
    last = m;
  }
  return s;
}

TEST(PathRate, ACircleIsNeverLeft) {
  std::mt19937 random(1);
  std::uniform_int_distribution<int> one_in(0, 99), percent(0, 100);
  const double radius = 0.05, speed = 8.0, limit = 1.5;  // 0.4 m/s
  const auto r = circle(radius, speed);
  const JoinedReference<double> joined(r, 0, h);
  PathRate<double> rate(limit, h);
  EXPECT_FALSE(rate.active());
  EXPECT_EQ(rate.begin(), 1.0);
  const Seen s = watch(
      rate, joined, 100'000, [&](const V& p) { return std::abs((p - r.centre).norm() - radius); },
      [&](int) {
        if (one_in(random) == 0) rate.want(static_cast<unsigned>(percent(random)));
      });
  EXPECT_TRUE(rate.active());
  EXPECT_LT(s.off, 1e-15);
  EXPECT_LE(s.speed, radius * speed * (1 + 1e-12));
  EXPECT_LE(s.along, limit * std::sqrt(2.0) * (1 + 1e-9)) << "1.5 in each coordinate";
  EXPECT_GT(s.along, limit);
  EXPECT_LT(s.jump, 0.25 * h * h * 6.0) << "accelerations of 3.2 across and 2.1 along";
  EXPECT_LT(s.velocity_jump, h * h * (25.6 + 3 * 10 * 3.2));
}

/// From and to rest in each corner; on the way at any rate.
TEST(PathRate, CornersOfAPolylineAreNotCut) {
  const std::vector<V> corner{V(0, 0), V(0.1, 0), V(0.1, 0.08), V(-0.02, 0.01)};
  std::vector<PathSegment<double>> path;
  for (std::uint32_t i = 0; i < 3; ++i)
    path.push_back({i * 200, 0.0,
                    Quintic<double>::between({corner[i], V(0, 0), V(0, 0)}, {corner[i + 1], V(0, 0), V(0, 0)},
                                             200 * h)});
  Reference<double> r;
  r.kind = ReferenceKind::path;
  r.path = path;
  const JoinedReference<double> joined(r, 0, h);
  const auto off = [&](const V& p) {
    double best = 1.0;
    for (std::size_t i = 0; i < 3; ++i) {
      const V side = corner[i + 1] - corner[i];
      const double u = std::clamp((p - corner[i]).dot(side) / side.squaredNorm(), 0.0, 1.0);
      best = std::min(best, (p - corner[i] - u * side).norm());
    }
    return best;
  };
  std::mt19937 random(2);
  std::uniform_int_distribution<int> one_in(0, 49), percent(0, 100);
  for (const bool feasible : {true, false}) {
    PathRate<double> rate(4.0, h);
    rate.begin();
    V end{0, 0};
    const Seen s = watch(
        rate, joined, 6000, [&](const V& p) { return end = p, off(p); },
        [&](int i) {
          if (i < 3000 && one_in(random) == 0) rate.want(static_cast<unsigned>(percent(random)));
          if (i == 3000) rate.want(100);
        },
        feasible);
    EXPECT_LT(s.off, 1e-15);
    EXPECT_LT(s.jump, 0.25 * h * h * 40.0);
    EXPECT_LT((end - corner.back()).norm(), 1e-15);
  }
}

/// A hold from full speed: at rest after v / a, or in eight times that, after a pause, where the motors can
/// none of it.
TEST(PathRate, HoldEndsInRestAndResumeGoesOnWhereItWas) {
  const double radius = 0.05, speed = 8.0;
  const auto r = circle(radius, speed);
  const JoinedReference<double> joined(r, 0, h);
  for (const bool feasible : {true, false}) {
    PathRate<double> rate(1.0, h);
    rate.begin();
    const auto go = [&](std::uint64_t i) {
      return rate.active() ? rate.step(joined, i, 0, [&](const Motion2<double>&) { return feasible; })
                           : joined.at(i);
    };
    const double longest = radius * speed / 1.0 * (feasible ? 1.0 : 8.0), wait = feasible ? 0.0 : 256 * h;
    std::uint64_t i = 0;
    Motion2<double> m;
    for (; i < 300; ++i) m = go(i);
    rate.want(0);
    double way = 0.0;
    std::uint64_t n = 0;
    for (V last = m.position; n < 10'000 && m.velocity.norm() > 0; ++n, ++i) {
      m = go(i);
      way += (m.position - last).norm();
      last = m.position;
    }
    EXPECT_LE(double(n) * h - wait, longest + 3 * h);
    EXPECT_GE(double(n) * h - wait, longest / 1.5);
    EXPECT_NEAR(way, radius * speed * (0.5 * (double(n) * h - wait) + wait), 0.2 * way);
    const V rest = m.position;
    EXPECT_EQ(m.acceleration, V(0, 0));
    for (int k = 0; k < 500; ++k) m = go(i++);
    EXPECT_EQ(m.position, rest);
    // On from there: full speed again, as if the time between had not been.
    rate.want(100);
    EXPECT_LT((go(i++).position - rest).norm(), 1e-7);
    for (int k = 0; k < 8000; ++k) m = go(i++);
    EXPECT_NEAR(m.velocity.norm(), radius * speed, 1e-12);
    const V next = go(i++).position;
    EXPECT_NEAR((next - m.position).norm(), 2 * radius * std::sin(0.5 * speed * h), 1e-12);
  }
}

/// Angles along the circle against the sum of the speeds.
TEST(PathRate, PathTimeIsTheSumOfTheRates) {
  const auto r = circle(1.0, 1.0);
  const JoinedReference<double> joined(r, 0, h);
  PathRate<double> rate(0.5, h);
  rate.begin();
  rate.want(37);
  double angle = 0.0, last = 1.0;
  V at{0, 0};
  for (std::uint64_t i = 0; i < 4000; ++i) {
    const auto m = rate.step(joined, i, 0, [](const Motion2<double>&) { return true; });
    if (i > 0) angle += 0.5 * h * (last + m.velocity.norm());
    last = m.velocity.norm();
    at = m.position - r.centre;
  }
  EXPECT_NEAR(last, 0.37, 1e-6);
  EXPECT_NEAR(std::atan2(at[1], at[0]), angle, 1e-9);
  // A predictor's motion is ahead by as much path time.
  auto copy = rate;
  const auto now = rate.step(joined, 4000, 0, [](const Motion2<double>&) { return true; });
  const auto ahead = copy.step(joined, 4000, 10, [](const Motion2<double>&) { return true; });
  EXPECT_NEAR((ahead.position - now.position).norm(), 10 * h * 0.37, 1e-6);
}

TEST(PathRate, BeginsAtTheWantedRateWithoutAJump) {
  for (const unsigned percent : {100U, 250U, 40U, 1U, 0U}) {
    PathRate<double> rate(100.0, h);
    rate.want(percent);
    EXPECT_EQ(rate.active(), percent < 100);
    const double share = percent == 0 || percent > 100 ? 1.0 : percent / 100.0;
    const double begun = rate.begin();
    EXPECT_NEAR(begun, share, 1e-6);
    const V velocity(0.05, -0.02);
    JoinedReference<double> joined(circle(0.05, 8.0), 500, h);
    if (rate.active()) {
      joined.start_slowly(V(0.2, -0.2), velocity, begun);
    } else {
      joined.start(V(0.2, -0.2), velocity);
    }
    const auto m = rate.active() ? rate.step(joined, 0, 0, [](const Motion2<double>&) { return true; })
                                 : joined.at(std::uint64_t{0});
    EXPECT_LT((m.position - V(0.2, -0.2)).norm(), 1e-15);
    EXPECT_LT((m.velocity - velocity).norm(), 1e-12);
  }
}

/// The noise of a measured velocity stays a velocity: the way of a slow join is that of a fast one.
TEST(PathRate, ASlowJoinDoesNotTurnNoiseIntoDistance) {
  double beside[2] = {};
  for (const unsigned percent : {100U, 5U}) {
    PathRate<double> rate(100.0, h);
    rate.want(percent);
    const double begun = rate.begin();
    Reference<double> rest;
    rest.kind = ReferenceKind::hold_start;
    JoinedReference<double> joined(rest, 1000, h);
    if (rate.active()) {
      joined.start_slowly(V(0.2, 0.1), V(0.05, -0.02), begun);
    } else {
      joined.start(V(0.2, 0.1), V(0.05, -0.02));
    }
    for (std::uint64_t n = 0; n < 25'000; ++n) {
      const auto m =
          rate.active() ? rate.step(joined, n, 0, [](const Motion2<double>&) { return true; }) : joined.at(n);
      beside[percent == 5] = std::max(beside[percent == 5], (m.position - V(0.2, 0.1)).norm());
    }
  }
  EXPECT_GT(beside[0], 5e-3);
  EXPECT_LT(beside[1], 1.5 * beside[0]);
}

/// However slow: it gets there.
TEST(PathRate, ChangesByAtLeastTheSmallestStep) {
  const JoinedReference<float> joined(Reference<float>{}, 0, 1e-3F);
  Reference<float> fast;
  fast.kind = ReferenceKind::circle;
  fast.amplitude = {1.0F, 1.0F};
  fast.speed = {1e6F, 1e6F};
  const JoinedReference<float> racing(fast, 0, 1e-3F);
  PathRate<float> rate(1e-6F, 1e-3F);
  rate.begin();
  rate.want(0);
  const auto yes = [](const Motion2<float>&) { return true; };
  const float first = rate.step(racing, 0, 0, yes).velocity.norm();
  for (std::uint64_t i = 1; i < 1000; ++i) (void)rate.step(racing, i, 0, yes);
  EXPECT_LT(rate.step(racing, 1000, 0, yes).velocity.norm(), first);
  // And with a tick as long as all of the change.
  PathRate<float> slow(1.0F, 1.0F);
  slow.begin();
  slow.want(0);
  (void)slow.step(joined, 0, 0, yes);
  const auto at_rest = slow.step(racing, 1, 0, yes), later = slow.step(racing, 2, 0, yes);
  EXPECT_EQ(at_rest.velocity.norm(), 0.0F);
  EXPECT_EQ(at_rest.position, later.position);
}

/// A path on which path time is the position, in ticks; it counts the calls of feasible().
struct Ruler {
  double speed = 1.0;
  [[nodiscard]] Motion2<double> at(const TickTime& t) const {
    Motion2<double> m;
    m.position = {static_cast<double>(t.tick) + static_cast<double>(t.fraction) * 0x1p-24, 0.0};
    m.velocity = {0.0, speed};
    return m;
  }
};
/// A rate on the ruler, in ticks of 1 / 1024 s: what it changes by, in 2^-23, is exact.
struct Along {
  PathRate<double> rate;
  Ruler ruler;
  std::uint64_t tick = 0;
  bool can = true;
  std::vector<double> asked;  // changes of the rate, 2^-23, in the last tick
  explicit Along(double acceleration = 10.0) : rate(acceleration, 1.0 / 1024) { rate.begin(); }
  Motion2<double> step(std::uint32_t lead = 0) {
    asked.clear();
    return rate.step(ruler, tick++, lead, [&](const Motion2<double>& m) {
      asked.push_back(m.acceleration[1] / ruler.speed / 1024 * 0x1p23);
      return can;
    });
  }
};

TEST(PathRateAlone, LeadIsInTimeOfThePath) {
  Along a;
  a.rate.want(50);
  a.rate.begin();
  EXPECT_NEAR(a.step(4).position[0], 2.0, 1e-5);
  EXPECT_NEAR(a.step(4).position[0], 2.5, 1e-5);
}

TEST(PathRateAlone, BeginForgetsWhatWasLate) {
  Along a;
  a.rate.want(50);
  for (int n = 0; n < 2000; ++n) a.step();
  a.rate.begin();
  a.tick = 0;
  EXPECT_EQ(a.step().position[0], 0.0);
  a.rate.want(100);
  EXPECT_TRUE(a.rate.active());
  a.rate.begin();
  EXPECT_FALSE(a.rate.active());
}

TEST(PathRateAlone, FourSharesOfAChangeAreTriedAndThenTheRateStays) {
  Along a(5.5 * 1024 * 0x1p-23);  // at a speed of 1: five and a half units in a tick
  a.can = false;
  a.rate.want(0);
  const Motion2<double> m = a.step();
  EXPECT_EQ(a.asked, (std::vector{-5.0, -3.0, -2.0, -1.0}));
  EXPECT_EQ(m.acceleration[1], 0.0);
  EXPECT_EQ(a.step().velocity[1], 1.0);
  Along slow(0.5 * 1024 * 0x1p-23);
  slow.rate.want(0);
  slow.step();
  EXPECT_EQ(slow.asked, std::vector{-1.0}) << "at least one unit";
}

TEST(PathRateAlone, TheTimeOfThePathIsKeptToItsLastBit) {
  Along a(0.5 * 1024 * 0x1p-23);  // one unit in a tick: late by half a unit of the rate
  a.rate.want(0);
  a.step();
  EXPECT_NEAR(a.step().position[0], 1.0 - 0x1p-24, 0x1p-26);
}

TEST(PathRateAlone, TheLastChangeIsTheRest) {
  Along a(1e6);
  a.rate.want(99);
  a.step();
  EXPECT_NEAR(a.step().velocity[1], 0.99023, 1e-4);  // 10/s
  for (int n = 0; n < 3; ++n) EXPECT_NEAR(a.step().velocity[1], 0.99, 1e-5);
  a.rate.want(100);
  for (int n = 0; n < 5; ++n) a.step();
  EXPECT_EQ(a.step().velocity[1], 1.0);
}

/// 256 ticks without a change that the motors can, counted anew after one that they can and after a wish that
/// is fulfilled.
TEST(PathRateAlone, PatienceIsCountedFromTheLastChange) {
  const auto forced_after = [](Along& a) {
    for (int n = 1; n < 2000; ++n) {
      if (a.step().acceleration[1] != 0.0) return n;
    }
    return 0;
  };
  Along a;
  a.can = false;
  a.rate.want(0);
  EXPECT_EQ(forced_after(a), 257);
  Along b;
  b.can = false;
  b.rate.want(0);
  for (int n = 0; n < 200; ++n) b.step();
  b.can = true;
  b.step();
  b.can = false;
  EXPECT_EQ(forced_after(b), 257);
  Along c;
  c.can = false;
  c.rate.want(0);
  for (int n = 0; n < 200; ++n) c.step();
  c.rate.want(100);
  c.step();
  c.rate.want(0);
  EXPECT_EQ(forced_after(c), 257);
}

}  // namespace
