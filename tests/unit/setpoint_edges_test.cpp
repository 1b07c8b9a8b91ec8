/// The generator of requested motions and what it is made of, each by itself and exactly at its bounds: the
/// moving average, the profile, streams. Numbers are sums of powers of two wherever a bound is met exactly.

#include "firmware/cycle/setpoint_generator.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

namespace {

using V = esmc::Vec2<double>;
using Motion = esmc::Motion2<double>;
using Average = esmc::MovingAverage<double>;
using Profile = esmc::MotionProfile<double>;
using Generator = esmc::SetpointGenerator<double>;

// ---- the moving average

TEST(MovingAverageEdges, IsTheMeanOfTheLastMotions) {
  for (const unsigned length : {2U, 3U, 5U, 64U}) {
    Average average(length);
    ASSERT_EQ(average.length(), length);
    // A past at constant velocity whose mean is now at (1, 2).
    constexpr double h = 0.25;
    const V velocity(0.5, -0.125), now = average.begin(V(1, 2), velocity, h);
    std::vector<Motion> all;
    for (unsigned i = length; i > 0; --i) all.push_back({now - velocity * (h * i), velocity, V(0, 0)});
    for (unsigned n = 0; n < 5 * length; ++n) {
      const double x = n;
      all.push_back({now + V(x * x, 3 * x), V(2 * x, x * x), V(x - 7, 0.5 * x * x)});
      Motion mean;
      for (std::size_t i = all.size() - length; i < all.size(); ++i) {
        mean.position += all[i].position / length;
        mean.velocity += all[i].velocity / length;
        mean.acceleration += all[i].acceleration / length;
      }
      const Motion told = average.with(all.back());
      const double most = 1e-12 * (1 + x * x);
      EXPECT_LT((told.position - mean.position).norm(), most) << length << ' ' << n;
      EXPECT_LT((told.velocity - mean.velocity).norm(), most) << length << ' ' << n;
      EXPECT_LT((told.acceleration - mean.acceleration).norm(), most) << length << ' ' << n;
      average.add(all.back());
    }
  }
}

TEST(MovingAverageEdges, OfOneMotionIsThatMotionToTheBit) {
  for (Average none : {Average{}, Average(0), Average(1)}) {
    EXPECT_EQ(none.length(), 1U);
    EXPECT_EQ(none.begin(V(0.1, 0.2), V(3, 4), 0.1), V(0.1, 0.2));
    for (int i = 0; i < 3; ++i) {
      const Motion m = none.with({V(-0.0, 0.3), V(-0.0, 0.7), V(-0.0, 1e300)});
      EXPECT_TRUE(std::signbit(m.position[0]) && std::signbit(m.velocity[0]) &&
                  std::signbit(m.acceleration[0]));
      EXPECT_EQ(m.position[1], 0.3);
      EXPECT_EQ(m.velocity[1], 0.7);
      EXPECT_EQ(m.acceleration[1], 1e300);
      none.add(m);
    }
  }
}

TEST(MovingAverageEdges, BeginsAnewWithoutTheRoundingOfWhatWas) {
  Average average(8);
  (void)average.begin(V(0x1p60, 0x1p60), V(0, 0), 1);
  for (int i = 0; i < 3; ++i) average.add({V(0x1p60, 0x1p60), V(0, 0), V(0, 0)});
  (void)average.begin(V(0.5, 0.25), V(0, 0), 1);
  for (int i = 0; i < 20; ++i) {
    const Motion rest{V(0.5, 0.25), V(0, 0), V(0, 0)};
    EXPECT_EQ(average.with(rest).position, rest.position) << i;
    average.add(rest);
  }
}

// ---- the profile

/// A motion by its pieces: accelerates for `first`, is steady until `second`, brakes until `time`, s.
struct Pieces {
  double rate, cruise, first, second, time;
  [[nodiscard]] Motion at(int k, double from, double t) const {
    const double begin = first > 0 ? (cruise - rate) / first : 0, tail = time - second;
    Motion m;
    double& position = m.position[k];
    position = from;
    if (t < first) {
      position += rate * t + begin * t * t / 2;
      m.velocity[k] = rate + begin * t;
      m.acceleration[k] = begin;
      return m;
    }
    position += (rate + cruise) / 2 * first;
    if (t < second) {
      position += cruise * (t - first);
      m.velocity[k] = cruise;
      return m;
    }
    position += cruise * (second - first);
    const double u = std::min(t, time) - second;
    if (tail > 0) position += cruise * u - cruise / tail * u * u / 2;
    if (t < time) {
      m.velocity[k] = cruise - cruise / tail * u;
      m.acceleration[k] = -cruise / tail;
    }
    return m;
  }
};
void expect_pieces(const Profile& profile, const V& from, const Pieces (&pieces)[2], double h, int ticks) {
  for (int tick = 0; tick < ticks; ++tick) {
    const Motion m = profile.at(static_cast<std::uint32_t>(tick));
    for (int k = 0; k < 2; ++k) {
      const Motion e = pieces[k].at(k, from[k], tick * h);
      EXPECT_NEAR(m.position[k], e.position[k], 1e-14) << k << ' ' << tick * h;
      EXPECT_NEAR(m.velocity[k], e.velocity[k], 1e-14) << k << ' ' << tick * h;
      EXPECT_NEAR(m.acceleration[k], e.acceleration[k], 1e-14) << k << ' ' << tick * h;
    }
  }
}

/// The slow coordinate goes 3 from rest, at a speed and an acceleration of 1: 1 s, 2 s, 1 s. The other one
/// shares its instants up to its own limits, each of them included.
TEST(MotionProfileEdges, TheOtherCoordinateSharesTheInstantsWithinItsLimits) {
  const double h = 0.125;
  const Pieces slow{0, 1, 1, 3, 4};
  struct Case {
    double rate, cruise;  ///< of the other one
  };
  for (const auto& [rate, cruise] : {Case{0, 0.5}, Case{0.5, 1}, Case{-0.5, 0.5}}) {
    for (const double sign : {1.0, -1.0}) {
      for (const int other : {0, 1}) {
        const double way = (rate + cruise) / 2 + 2 * cruise + cruise / 2;
        V from(5, 6), rates(0, 0), to = from + V(3, 3);
        rates[other] = sign * rate;
        to[other] = from[other] + sign * way;
        Profile profile(h);
        profile.plan(from, rates, to, 1, 1);
        const Pieces with{sign * rate, sign * cruise, 1, 3, 4};
        if (other == 0) expect_pieces(profile, from, {with, slow}, h, 40);
        if (other == 1) expect_pieces(profile, from, {slow, with}, h, 40);
        EXPECT_EQ(profile.ticks(), 33U) << "4 s and the tick after";
        EXPECT_EQ(profile.at(32).position, to);
      }
    }
  }
}

/// The first coordinate only brakes, 1 s. The other one has to brake for half of that, and stays where it is.
TEST(MotionProfileEdges, ACoordinateThatHasBrakedWaitsForTheOther) {
  const double h = 0.125;
  for (const double rate : {0.5, -0.5}) {
    Profile profile(h);
    profile.plan(V(0, 0), V(1, rate), V(0.5, 0.25 * rate), 10, 1);
    expect_pieces(profile, V(0, 0), {{1, 1, 0, 0, 1}, {rate, 0, 0.5, 1, 1}}, h, 12);
  }
}

TEST(MotionProfileEdges, BrakesFromTheFirstTickOn) {
  Profile profile(0.125);
  profile.brake(V(1, 2), V(-1, 0.5), 0.5);
  expect_pieces(profile, V(1, 2), {{-1, -1, 0, 0, 2}, {0.5, 0.5, 0, 0, 2}}, 0.125, 30);
}

/// Targets where a brake ends but for the last digits: both coordinates brake, and nothing else.
TEST(MotionProfileEdges, ATargetAtTheEndOfTheBrakeIsBrakedTo) {
  const double h = 1e-3;
  const auto nudged = [](double v, int digits) {
    for (int i = 0; i < std::abs(digits); ++i) v = std::nextafter(v, digits > 0 ? 10.0 : -10.0);
    return v;
  };
  for (const double acceleration : {0.3, 1.0, 3.0, 7.1}) {
    for (int n = 1; n <= 60; ++n) {
      for (const double sign : {1.0, -1.0}) {
        for (int digits = 0; digits < 25; ++digits) {
          const double speed = 0.1 * n, way = speed * speed * 0.5 / acceleration;
          const V rate(speed, sign * speed);
          const V to(nudged(way, digits % 5 - 2), nudged(sign * way, digits / 5 - 2));
          Profile profile(h);
          profile.plan(V(0, 0), rate, to, 10, acceleration);
          ASSERT_LE(profile.ticks(), speed / acceleration / h + 3);
          const auto half = profile.ticks() / 2;
          for (int k = 0; k < 2; ++k) {
            const double expected = (k == 0 ? 1 : sign) * (speed - acceleration * (half * h));
            ASSERT_NEAR(profile.at(half).velocity[k], expected, 1e-6) << speed << ' ' << acceleration;
          }
          ASSERT_EQ(profile.at(profile.ticks()).position, to);
        }
      }
    }
  }
}

TEST(MotionProfileEdges, CountsAThousandMillionTicksAtMost) {
  Profile profile(0.5);
  profile.plan(V(0, 0), V(0, 0), V(1e30, 0), 1, 1);
  EXPECT_EQ(profile.ticks(), 1'000'000'001U);
  EXPECT_EQ(profile.at(1).velocity, V(0.5, 0));
}

TEST(MotionProfileEdges, HasTicksOfOneSecondUnlessTold) {
  Profile profile;
  EXPECT_EQ(profile.ticks(), 1U) << "at rest";
  EXPECT_EQ(profile.at(0).position, V(0, 0));
  profile.plan(V(0, 0), V(0, 0), V(3, 0), 1, 1);
  expect_pieces(profile, V(0, 0), {{0, 1, 1, 3, 4}, {0, 0, 1, 3, 4}}, 1, 9);
  EXPECT_EQ(profile.ticks(), 5U);
}

// ---- the generator

constexpr double tick = 0x1p-10;

Generator resting(std::uint32_t average = 1) {
  Generator g(1, 1, tick, {false, false}, average);
  g.activate(true);
  g.start(V(0, 0), V(0, 0));
  return g;
}

/// A sample half a tick's way off is nothing new in a stream, but the first one of a stream is joined: the
/// motion does not jump, and gets there.
void expect_joins(Generator g, const V& sample, const char* when) {
  const V before = g.at().position;
  g.follow(sample, V(0, 0));
  EXPECT_LT((g.at().position - before).norm(), 1e-12) << when;
  for (int i = 0; i < 4000; ++i) {
    g.advance();
    g.follow(sample, V(0, 0));
  }
  EXPECT_LT((g.at().position - sample).norm(), 1e-12) << when;
}
TEST(SetpointEdges, TheFirstSampleOfAStreamIsJoined) {
  const V sample(0.5 * tick, 0.5 * tick);
  Generator unset(1, 1, tick, {false, false}, 1);
  unset.activate(true);
  expect_joins(unset, sample, "before any order");
  expect_joins(resting(), sample, "after the start");
  for (const int between : {0, 1}) {
    Generator g = resting();
    g.follow(V(0, 0), V(0, 0));
    if (between == 1) g.advance();
    Generator started = g, held = g, sent = g;
    started.start(V(0, 0), V(0, 0));
    expect_joins(started, sample, "started within a stream");
    started.start(V(0.25, 0), V(0, 0));
    expect_joins(started, sample, "started elsewhere");
    held.hold();
    expect_joins(held, sample, "after a hold");
    sent.go_to(V(0.25, 0));
    expect_joins(sent, sample, "after a set point");
  }
}

TEST(SetpointEdges, ASampleMayBeOffByTheWayOfATickItself) {
  for (const int k : {0, 1}) {
    for (const double sign : {1.0, -1.0}) {
      for (const bool beyond : {false, true}) {
        Generator g = resting();
        g.follow(V(0, 0), V(0, 0));
        g.advance();
        V sample(0, 0);
        sample[k] = sign * tick * (beyond ? 1 + 0x1p-40 : 1);
        g.follow(sample, V(0, 0));
        EXPECT_NEAR(g.at().position[k], beyond ? 0 : sample[k], 1e-15) << k << sign << beyond;
      }
    }
  }
}

TEST(SetpointEdges, OnlySamplesOfConsecutiveTicksHaveAnAcceleration) {
  Generator g = resting();
  g.follow(V(0, 0), V(0, 0));
  EXPECT_EQ(g.at().acceleration, V(0, 0));
  g.advance();
  g.follow(V(0, 0), V(tick, -2 * tick));
  EXPECT_EQ(g.at().acceleration, V(1, -2)) << "change of the velocity per tick";
  g.follow(V(0, 0), V(3 * tick, tick));
  EXPECT_EQ(g.at().acceleration, V(0, 0)) << "again in the same tick";
}

TEST(SetpointEdges, RestsExactlyOnceTheWholeAverageDoes) {
  for (const std::uint32_t length : {3U, 7U, 11U, 64U}) {
    for (int n = 1; n < 40; ++n) {
      Generator g = resting(length);
      const V to(0.1 * n, -0.07 * n);
      g.go_to(to);
      // The longer way: it reaches the speed of 1 if it is longer than 1.
      const double way = 0.1 * n, time = way < 1 ? 2 * std::sqrt(way) : 1 + way;
      const auto ticks = static_cast<std::uint32_t>(time / tick) + 1 + length;
      for (std::uint32_t i = 0; i < ticks; ++i) g.advance();
      EXPECT_EQ(g.at().position, to) << length << ' ' << n;
      EXPECT_EQ(g.at().velocity, V(0, 0)) << length << ' ' << n;
    }
  }
}

TEST(SetpointEdges, EachCoordinateIsAnAngleOrNot) {
  for (const int angle : {0, 1}) {
    Generator g(100, 1000, tick, {angle == 0, angle == 1}, 1);
    g.activate(true);
    g.start(V(-3, -3), V(0, 0));
    g.go_to(V(3, 3));
    for (int i = 0; i < 1000; ++i) g.advance();
    EXPECT_NEAR(g.at().position[angle], 3 - 2 * std::acos(-1.0), 1e-12) << "the short way";
    EXPECT_NEAR(g.at().position[1 - angle], 3, 1e-12);
  }
}

/// Nobody asks for its motion before its limits are set; it is one that divides by nothing.
TEST(SetpointEdges, HasLimitsOfOneUnlessTold) {
  Generator g;
  EXPECT_FALSE(g.active());
  g.activate(true);
  EXPECT_EQ(g.at().position, V(0, 0));
  g.go_to(V(3, 0));
  for (const double position : {0.0, 0.5, 1.5, 2.5, 3.0, 3.0}) {
    EXPECT_NEAR(g.at().position[0], position, 1e-15);
    g.advance();
  }
  g.hold();
  g.follow(V(3, 0), V(0, 0));  // of a stream that begins where it is
  for (int i = 0; i < 5; ++i, g.advance()) g.follow(V(3, 0), V(0, 0));
  g.follow(V(4, 0), V(0.5, 0));
  EXPECT_EQ(g.at().position, V(4, 0)) << "1 m in a tick is allowed";
  EXPECT_EQ(g.at().acceleration, V(0.5, 0)) << "in a tick of 1 s";
  g.advance();
  g.follow(V(5.625, 0), V(0.5, 0));
  EXPECT_EQ(g.at().position, V(4.5, 0)) << "1.125 m off is not";
}

}  // namespace
