/// The motion that a supervisor computer asks for: limits, continuity, samples.

#include "firmware/cycle/setpoint_generator.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

namespace {

using namespace esmc;
using V = Vec2<double>;

constexpr double h = 1e-3;

/// The largest speed and acceleration of a coordinate in the positions themselves, by differences, and of the
/// two coordinates' own words; and how far the words are from the differences.
struct Seen {
  double speed = 0, acceleration = 0, told_speed = 0, told_acceleration = 0, lie = 0;
  V end{0, 0};
};
template <class Each>
Seen watch(SetpointGenerator<double>& g, int ticks, const Each& each) {
  Seen s;
  V before[3];
  V velocity_before{0, 0};
  for (int i = 0; i < ticks; ++i) {
    each(i);
    const Motion2<double> m = g.at();
    for (int k = 0; k < 2; ++k) {
      s.told_speed = std::max(s.told_speed, std::abs(m.velocity[k]));
      s.told_acceleration = std::max(s.told_acceleration, std::abs(m.acceleration[k]));
      if (i >= 1) {
        const double v = (m.position[k] - before[0][k]) / h;
        s.speed = std::max(s.speed, std::abs(v));
        s.lie = std::max(s.lie, std::abs(v - 0.5 * (m.velocity[k] + velocity_before[k])));
      }
      if (i >= 2) {
        s.acceleration =
            std::max(s.acceleration, std::abs(m.position[k] - 2 * before[0][k] + before[1][k]) / (h * h));
      }
    }
    before[1] = before[0];
    before[0] = m.position;
    velocity_before = m.velocity;
    s.end = m.position;
    g.advance();
  }
  return s;
}

/// Already active, without a filter unless told.
SetpointGenerator<double> generator(double speed, double acceleration, unsigned jerk = 0) {
  SetpointGenerator<double> g(speed, acceleration, h, {false, false}, jerk);
  g.activate(true);
  return g;
}

TEST(SetpointGenerator, StartsToRestWhereItIs) {
  for (const unsigned jerk : {0U, 1U, 2U, 40U, 64U, 1000U}) {
    SetpointGenerator<double> g(1.0, 10.0, h, {false, false}, jerk);
    EXPECT_FALSE(g.active());
    g.activate(true);
    g.start(V(0.1, 0.2), V(0, 0));
    const Seen s = watch(g, 100, [](int) {});
    EXPECT_LT((s.end - V(0.1, 0.2)).norm(), 1e-15);
    EXPECT_EQ(s.told_speed, 0.0);
    // With a speed: without a jump of position or speed, straight on, half of speed times time ahead; the
    // filter adds half of its length.
    g.start(V(0.1, 0.2), V(0.8, -0.4));
    EXPECT_LT((g.at().position - V(0.1, 0.2)).norm(), 1e-15);
    EXPECT_LT((g.at().velocity - V(0.8, -0.4)).norm(), 1e-15);
    const Seen r = watch(g, 400, [](int) {});
    const double time = 0.8 / 10.0 + (std::clamp(jerk, 1U, 64U) - 1) * h;
    EXPECT_NEAR(r.end[0], 0.1 + 0.4 * time, 1e-12);
    EXPECT_NEAR(r.end[1], 0.2 - 0.2 * time, 1e-12);
    EXPECT_LE(r.told_acceleration, 10.0 * (1 + 1e-12));
    EXPECT_LE(r.told_speed, 0.8 * (1 + 1e-12));
    EXPECT_LE(r.lie, 10.0 * h);
    EXPECT_EQ(g.at().velocity, V(0, 0));
  }
}

/// Samples that come late, all at once or after a gap, far from where the motion went on: it goes there with
/// speed and acceleration, and never jumps.
TEST(SetpointGenerator, ALateSampleIsJoined) {
  for (const int gap : {1, 2, 60}) {
    for (const unsigned jerk : {0U, 20U}) {
      auto g = generator(0.5, 5.0, jerk);
      g.start(V(0, 0), V(0, 0));
      g.follow(V(0, 0), V(0.3, 0));
      V before = g.at().position;
      double most = 0.0;
      for (int n = 1; n < 900; ++n) {
        g.advance();
        if (n < 300 || n == 300 + gap) g.follow(V(3e-4 * n - (n > 300 ? 0.05 : 0.0), 0), V(0.3, 0));
        if (n > 300 + gap) g.follow(V(3e-4 * n - 0.05, 0), V(0.3, 0));
        const V now = g.at().position;
        most = std::max(most, (now - before).norm() / h);
        before = now;
      }
      EXPECT_LT(most, 0.3 + 0.6) << gap << ' ' << jerk;
      EXPECT_NEAR(before[0], 3e-4 * 899 - 0.05, 1e-9);
    }
  }
}

TEST(SetpointGenerator, ASampleFarOffIsJoinedInAnyDirection) {
  for (const V& away : {V(5e-3, 0), V(-5e-3, 0), V(0, 5e-3), V(0, -5e-3)}) {
    auto g = generator(0.5, 5.0);
    g.start(V(0, 0), V(0, 0));
    for (int n = 0; n < 3; ++n) {
      g.follow(V(0, 0), V(0, 0));
      g.advance();
    }
    for (int n = 0; n < 200; ++n) {
      const V before = g.at().position;
      g.follow(away, V(0, 0));
      EXPECT_LT((g.at().position - before).norm(), 1e-15);
      g.advance();
      EXPECT_LT((g.at().position - before).norm(), 0.5 * h);
    }
    EXPECT_LT((g.at().position - away).norm(), 1e-12);
  }
}

/// Ticks until rest.
int ticks_to_rest(SetpointGenerator<double>& g) {
  int n = 0;
  for (; n < 100'000 && (g.at().velocity.norm() > 0 || g.at().acceleration.norm() > 0); ++n) g.advance();
  return n;
}

/// From rest: d / v + v / a, or 2 sqrt(d / a) where the speed is not reached; the filter adds its length.
TEST(SetpointGenerator, ASetPointTakesAsLongAsTheLimitsSay) {
  for (const unsigned jerk : {0U, 20U}) {
    for (const double distance : {1e-4, 0.01, 0.1, 1.0, 5.0}) {
      auto g = generator(1.0, 10.0, jerk);
      g.start(V(0, 0), V(0, 0));
      g.go_to(V(distance, -0.3 * distance));
      auto copy = g;
      const double time = distance > 0.1 ? distance + 0.1 : 2 * std::sqrt(distance / 10.0);
      EXPECT_NEAR(ticks_to_rest(copy) * h, time + (jerk > 0 ? jerk - 1 : 0) * h, 2 * h);
      bool straight = true;
      const Seen s = watch(g, static_cast<int>(time / h) + 70, [&](int) {
        const V p = g.at().position;
        straight = straight && std::abs(p[1] + 0.3 * p[0]) < 1e-14 * (1 + distance);
      });
      EXPECT_TRUE(straight) << "from rest the path is a line";
      EXPECT_EQ(s.end, V(distance, -0.3 * distance));
      EXPECT_LE(s.told_speed, 1.0 + 1e-12);
      EXPECT_LE(s.told_acceleration, 10.0 * (1 + 1e-12));
      EXPECT_LE(s.lie, 10.0 * h);
    }
  }
}

/// The least time of one coordinate from `rate` to rest `way` further on: of all cruises in a fine grid.
double least_time(double way, double rate, double speed, double acceleration) {
  double best = 1e9;
  constexpr int n = 4000;
  for (int i = -n; i <= n; ++i) {
    const double c = speed * i / n, change = std::abs(c - rate) / acceleration,
                 stop = std::abs(c) / acceleration;
    const double rest = way - 0.5 * (rate + c) * change - 0.5 * c * stop;
    if (c == 0.0 ? std::abs(rest) < 1e-12 : rest / c >= 0.0)
      best = std::min(best, change + stop + (c == 0.0 ? 0.0 : rest / c));
  }
  return best;
}

/// From any speed within the limit: both arrive together, in the least time of the slower one.
TEST(SetpointGenerator, ArrivesInTheLeastTimeOfTheSlowerCoordinate) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> unit(-1, 1);
  for (int trial = 0; trial < 200; ++trial) {
    const double speed = 0.5 + 0.4 * unit(random), acceleration = std::exp(2 + 1.5 * unit(random));
    const V rate(speed * unit(random), trial % 3 == 0 ? 0.0 : speed * unit(random));
    const V way(0.3 * unit(random), trial % 5 == 0 ? 0.0 : 0.05 * unit(random));
    MotionProfile<double> p(1e-5);
    p.plan(V(0, 0), rate, way, speed, acceleration);
    const double want = std::max(least_time(way[0], rate[0], speed, acceleration),
                                 least_time(way[1], rate[1], speed, acceleration));
    const double time = p.ticks() * 1e-5;
    EXPECT_LE(time, want + 2e-5) << trial;
    EXPECT_GE(time, want * (1 - 2e-3) - 2e-5) << trial;
    EXPECT_LT((p.at(p.ticks() - 1).position - way).norm(), acceleration * 1e-9);
    EXPECT_EQ(p.at(p.ticks()).position, way);
  }
}

/// Ways that a coordinate has no room for, or that are none: braking exactly to the point, already there.
TEST(SetpointGenerator, CornersOfTheProfile) {
  const auto ends = [](const V& rate, const V& way, double speed) {
    MotionProfile<double> p(h);
    p.plan(V(0, 0), rate, way, speed, 8.0);
    double jump = 0;
    for (unsigned i = 0; i < p.ticks(); ++i) {
      const auto a = p.at(i), b = p.at(i + 1);
      jump = std::max(jump, (b.position - a.position - (a.velocity + b.velocity) * (0.5 * h)).norm());
      EXPECT_LE(a.acceleration.cwiseAbs().maxCoeff(), 8.0 * (1 + 1e-12));
    }
    EXPECT_LT(jump, 8.0 * h * h);
    EXPECT_EQ(p.at(p.ticks()).position, way);
    return p.ticks() - 1;
  };
  EXPECT_EQ(ends(V(0, 0), V(0, 0), 1.0), 0U);
  EXPECT_EQ(ends(V(0.8, 0), V(0.04, 0), 1.0), 100U) << "brakes exactly to the point";
  EXPECT_EQ(ends(V(0.8, 0.8), V(0.04, 0.04), 1.0), 100U);
  EXPECT_EQ(ends(V(0.8, -0.4), V(0.04, -0.01), 1.0), 100U) << "the other one has to wait";
  EXPECT_EQ(ends(V(0.5, 0), V(1.0, 0.001), 0.5), 2031U) << "the slower one is at its speed already";
  EXPECT_EQ(ends(V(2.0, 0), V(1.0, 0), 0.5), 1750U) << "above the speed: down to it first";
}

/// A new set point at any instant of the way to another one: speed and acceleration stay within their limits,
/// and position and speed do not jump. tests/studies/setpoints.cpp has more of them.
TEST(SetpointGenerator, SetPointsAtAnyTimeKeepTheLimits) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> place(-0.3, 0.3), share(0, 1);
  for (int trial = 0; trial < 300; ++trial) {
    const double speed = 0.2 + 2 * share(random), acceleration = 1 + 30 * share(random);
    const auto jerk = static_cast<unsigned>(trial % 4 * 20);
    auto g = generator(speed, acceleration, jerk);
    g.start(V(place(random), place(random)), V(0, 0));
    V last{0, 0};
    double change = 0;
    const Seen s = watch(g, 3000, [&](int i) {
      if (i < 2000 && share(random) < 0.01) {
        if (share(random) < 0.2) {
          g.hold();
        } else {
          g.go_to(V(place(random), place(random)));
        }
      }
      change = std::max(change, (g.at().acceleration - last).cwiseAbs().maxCoeff());
      last = g.at().acceleration;
    });
    EXPECT_LE(s.told_speed, speed * (1 + 1e-12)) << trial;
    EXPECT_LE(s.told_acceleration, acceleration * (1 + 1e-12)) << trial;
    EXPECT_LE(s.speed, speed * (1 + 1e-9));
    EXPECT_LE(s.acceleration, acceleration * (1 + 1e-6)) << "differences of positions";
    EXPECT_LE(change, 2 * acceleration / std::max(1U, jerk) * (1 + 1e-9));
  }
}

/// With a set point in every tick the mechanism still gets on.
TEST(SetpointGenerator, ASetPointInEveryTickIsFollowed) {
  auto g = generator(1.0, 10.0, 10);
  g.start(V(0, 0), V(0, 0));
  for (int i = 0; i < 1000; ++i) {
    g.go_to(V(0.5 * i * h, 0));
    g.advance();
  }
  EXPECT_NEAR(g.at().velocity[0], 0.5, 0.1);
  EXPECT_NEAR(g.at().position[0], 0.5, 0.05);
}

TEST(SetpointGenerator, CountsNothingWhileTheReferenceLeads) {
  SetpointGenerator<double> g(1.0, 10.0, h, {false, false}, 10);
  g.start(V(0, 0), V(0.5, 0));
  const auto before = g.at();
  g.advance();
  EXPECT_EQ(g.at().position, before.position);
}

/// A circle that is joined while it turns: afterwards every tick is the sample of that tick, with the
/// acceleration that the samples have half a tick before.
TEST(SetpointGenerator, FollowsSamplesAndFadesTheOffset) {
  const double r = 0.05, w = 10.0;
  const auto p = [&](int i) { return V(r * std::cos(w * i * h), r * std::sin(w * i * h)); };
  const auto v = [&](int i) { return V(-r * w * std::sin(w * i * h), r * w * std::cos(w * i * h)); };
  auto g = generator(1.0, 20.0);
  g.start(V(0, 0), V(0, 0));
  const Seen s = watch(g, 1000, [&](int i) { g.follow(p(i), v(i)); });
  EXPECT_LT(s.speed, 1.0 + r * w);
  EXPECT_LT(s.lie, 2e-2);
  for (int i = 1000; i < 1100; ++i) {
    g.follow(p(i), v(i));
    const auto m = g.at();
    EXPECT_EQ(m.position, p(i));
    EXPECT_EQ(m.velocity, v(i));
    const double t = w * (i - 0.5) * h;
    EXPECT_NEAR(m.acceleration[0], -r * w * w * std::cos(t), 1e-4);
    EXPECT_NEAR(m.acceleration[1], -r * w * w * std::sin(t), 1e-4);
    g.advance();
  }
}

/// From a set point to a stream and back, in motion, with the filter: no jump of position or speed, and the
/// filter does not delay the stream.
TEST(SetpointGenerator, StreamsAndSetPointsTakeOverInMotion) {
  for (const bool holds : {false, true}) {
    auto g = generator(1.0, 20.0, 30);
    g.start(V(0, 0), V(0, 0));
    Motion2<double> last = g.at();
    for (int i = 0; i < 1200; ++i) {
      const V sample(0.1 * i * h, 0.02);
      if (i == 20) g.go_to(V(0.3, 0.1));
      if (i >= 100 && i < 700) g.follow(sample, V(0.1, 0));
      if (i == 700) holds ? g.hold() : g.go_to(V(-0.1, 0.1));
      const auto m = g.at();
      EXPECT_LT((m.position - last.position - (m.velocity + last.velocity) * (0.5 * h)).norm(), 40.0 * h * h);
      EXPECT_LT((m.velocity - last.velocity).norm(), 30.0 * h) << i;
      if (i >= 600 && i < 700) {
        EXPECT_EQ(m.position, sample);
      }
      last = m;
      g.advance();
    }
    if (holds) {
      EXPECT_LT((last.position - V(0.1 * 700 * h + 0.05 * (0.1 / 20 + 29 * h), 0.02)).norm(), 1e-12);
    } else {
      EXPECT_EQ(last.position, V(-0.1, 0.1));
    }
  }
}

TEST(SetpointGenerator, GoesStraightOnWhereSamplesAreMissing) {
  auto g = generator(1.0, 20.0);
  g.start(V(0, 0), V(0, 0));
  for (int i = 0; i < 500; ++i) {
    g.follow(V(0, 0), V(0, 0));
    g.advance();
  }
  g.follow(V(1e-3, 0), V(0.3, -0.2));
  g.advance();
  g.advance();
  const auto m = g.at();
  EXPECT_NEAR(m.position[0], 1e-3 + 2 * h * 0.3, 1e-15);
  EXPECT_NEAR(m.position[1], -2 * h * 0.2, 1e-15);
  EXPECT_EQ(m.acceleration, V(0, 0));
  g.follow(V(2e-3, 0), V(0.4, 0));
  const auto joined = g.at();  // two ticks apart: no rate of change, and no jump
  EXPECT_LT((joined.position - m.position).norm(), 1e-15);
  EXPECT_LT((joined.velocity - m.velocity).norm(), 1e-15);
  EXPECT_LE(joined.acceleration.cwiseAbs().maxCoeff(), 20.0);
  g.follow(V(2e-3, 0), V(0.4, 0));
  EXPECT_EQ(g.at().acceleration, joined.acceleration) << "two in a tick";
}

}  // namespace
