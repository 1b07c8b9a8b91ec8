/// The motion that a supervisor computer asks for: limits, continuity, samples.

#include "firmware/cycle/setpoint_generator.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
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

TEST(SetpointGenerator, StartsToRestWhereItIs) {
  SetpointGenerator<double> g(1.0, 10.0, h, false);
  EXPECT_FALSE(g.active());
  g.start(V(0.1, 0.2), V(0, 0));
  const Seen s = watch(g, 100, [](int) {});
  EXPECT_EQ(s.end, V(0.1, 0.2));
  EXPECT_EQ(s.told_speed, 0.0);
  // With a speed: half of it over the time that 15/8 v / a gives.
  g.start(V(0.1, 0.2), V(0.8, -0.4));
  const Seen t = watch(g, 400, [](int) {});
  const double time = 1.875 * 0.8 / 10.0;
  EXPECT_NEAR(t.end[0], 0.1 + 0.4 * time, 1e-12);
  EXPECT_NEAR(t.end[1], 0.2 - 0.2 * time, 1e-12);
  EXPECT_LE(t.told_acceleration, 10.0 * (1 + 1e-9));
  EXPECT_LE(t.told_speed, 0.8 * (1 + 1e-9));
  EXPECT_EQ(g.at().velocity, V(0, 0));
}

/// From rest: 15/8 d / T is the speed, 10/sqrt(3) d / T^2 the acceleration, and one of the two is reached.
TEST(SetpointGenerator, ASetPointTakesAsLongAsTheLimitsSay) {
  for (const double distance : {1e-4, 0.01, 0.1, 1.0, 5.0}) {
    SetpointGenerator<double> g(1.0, 10.0, h, false);
    g.start(V(0, 0), V(0, 0));
    g.go_to(V(distance, -0.5 * distance));
    const double time = std::max(1.875 * distance, std::sqrt(10 / std::sqrt(3.0) * distance / 10.0));
    const Seen s = watch(g, static_cast<int>(time / h) + 3, [](int) {});
    EXPECT_EQ(s.end, V(distance, -0.5 * distance));
    EXPECT_LE(s.told_speed, 1.0 + 1e-9);
    EXPECT_LE(s.told_acceleration, 10.0 + 1e-6);
    EXPECT_LT(s.lie, 2e-2);
    EXPECT_TRUE(s.told_speed > 0.99 || s.told_acceleration > 9.8 || distance < 1e-3) << distance;
  }
}

/// A new set point at any instant of the way to another one: speed and acceleration stay within their limits,
/// and position and speed do not jump.
TEST(SetpointGenerator, SetPointsAtAnyTimeKeepTheLimits) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> place(-0.3, 0.3), share(0, 1);
  for (int trial = 0; trial < 300; ++trial) {
    const double speed = 0.2 + 2 * share(random), acceleration = 1 + 30 * share(random);
    SetpointGenerator<double> g(speed, acceleration, h, false);
    g.start(V(place(random), place(random)), V(0, 0));
    V target{0, 0};
    const Seen s = watch(g, 3000, [&](int i) {
      if (i < 2000 && share(random) < 0.01) {
        if (share(random) < 0.2) {
          g.hold();
        } else {
          target = V(place(random), place(random));
          g.go_to(target);
        }
      }
    });
    EXPECT_LE(s.told_speed, speed * (1 + 1e-6)) << trial;
    EXPECT_LE(s.told_acceleration, acceleration * (1 + 1e-3)) << trial;
    EXPECT_LE(s.speed, speed * (1 + 1e-3));
    EXPECT_LE(s.acceleration, 2 * acceleration) << "it may change its sign between two ticks";
    EXPECT_LE(s.lie, acceleration * h);
  }
}

TEST(SetpointGenerator, AnglesGoTheShortWay) {
  SetpointGenerator<double> g(5.0, 100.0, h, true);
  g.start(V(3.0, -3.0), V(0, 0));
  g.go_to(V(-3.0, 3.0));
  const Seen s = watch(g, 2000, [](int) {});
  EXPECT_NEAR(s.end[0], 2 * std::numbers::pi - 3.0, 1e-12);
  EXPECT_NEAR(s.end[1], 3.0 - 2 * std::numbers::pi, 1e-12);
}

/// A circle that is joined while it turns: afterwards every tick is the sample of that tick, with the
/// acceleration that the samples have half a tick before.
TEST(SetpointGenerator, FollowsSamplesAndFadesTheOffset) {
  const double r = 0.05, w = 10.0;
  const auto p = [&](int i) { return V(r * std::cos(w * i * h), r * std::sin(w * i * h)); };
  const auto v = [&](int i) { return V(-r * w * std::sin(w * i * h), r * w * std::cos(w * i * h)); };
  SetpointGenerator<double> g(1.0, 20.0, h, false);
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

TEST(SetpointGenerator, GoesStraightOnWhereSamplesAreMissing) {
  SetpointGenerator<double> g(1.0, 20.0, h, false);
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
  EXPECT_EQ(g.at().acceleration, V(0, 0)) << "two ticks apart: no rate of change";
  g.follow(V(2e-3, 0), V(0.5, 0));
  EXPECT_EQ(g.at().acceleration, V(0, 0)) << "two in a tick";
}

}  // namespace
