/// Homing by itself: its ticks, bounds and torques, without a cycle around it.

#include "firmware/cycle/homing.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <utility>

namespace {

using namespace esmc;

/// By itself, of joints that move at their speed under the whole torque and stand otherwise.
struct ByItself {
  ByItself() {
    HomingConfig<double> c;
    c.speed = {-0.4, 0.4};
    c.torque = {0.3, 0.3};
    c.damping = {0.08, 0.08};
    c.travel = 2.0;
    c.back_off = 0.02;
    c.share = 0.01;
    homing = esmc::Homing<double>(c, 1e-3, 100);
  }
  Fault step() {
    for (int j = 0; j < 2; ++j) {
      rate[j] = std::abs(torque[j]) > 0.299 ? std::copysign(0.4, torque[j]) : 0.0;
      const double to = angle[j] + rate[j] * 1e-3;
      if (j == 0 ? to < stop[0] : to > stop[1]) rate[j] = 0.0;
    }
    angle += rate * 1e-3;
    ++ticks;
    return homing.step(angle, rate, torque);
  }
  esmc::Homing<double> homing;
  Vec2<double> angle = Vec2<double>::Zero(), rate = angle, torque = angle, stop{-0.1, 0.1};
  int ticks = 0;
};

TEST(HomingByItself, MeetsBothStopsForOneTickAndLeavesThem) {
  ByItself h;
  while (!h.homing.met()) {
    ASSERT_EQ(h.step(), Fault::none) << h.ticks;
    ASSERT_LT(h.ticks, 5000);
    ASSERT_FALSE(h.homing.done());
  }
  EXPECT_LT((h.angle - h.stop).norm(), 1e-3);
  EXPECT_LT(h.torque[0], -0.29);
  EXPECT_GT(h.torque[1], 0.29);
  while (!h.homing.done()) {
    ASSERT_EQ(h.step(), Fault::none) << h.ticks;
    ASSERT_LT(h.ticks, 5000);
    ASSERT_FALSE(h.homing.met());
  }
  EXPECT_GT(h.angle[0] - h.stop[0], 0.02);
  EXPECT_GT(h.stop[1] - h.angle[1], 0.02);
  h.homing.reset();
  EXPECT_FALSE(h.homing.done() || h.homing.met());
}

TEST(HomingByItself, ABrakeJudgesTheSpeed) {
  ByItself h;
  EXPECT_EQ(h.homing.brake({1.6, -1.6}, h.torque), Fault::none);
  EXPECT_EQ(h.homing.brake({1.61, 0.0}, h.torque), Fault::joint_speed);
  EXPECT_EQ(h.homing.brake({0.0, -1.61}, h.torque), Fault::joint_speed);
}

/// In powers of two, so that ticks can be counted.
HomingConfig<double> binary() {
  HomingConfig<double> c;
  c.speed = {-0.5, 0.25};
  c.torque = {0.5, 0.5};
  c.damping = {0.125, 0.125};
  c.travel = 2.0;
  c.back_off = 0.0625;
  c.share = 1.0 / 64;
  return c;
}
constexpr double binary_tick = 1.0 / 1024;
const Vec2<double> none = Vec2<double>::Zero(), begin(5.0, -7.0);

TEST(HomingByItself, ExistsWithATravel) {
  HomingConfig<double> c;
  EXPECT_FALSE(esmc::Homing<double>(c, binary_tick, 100).available());
  c.travel = 0.5;
  EXPECT_TRUE(esmc::Homing<double>(c, binary_tick, 100).available());
}

/// 64 ticks up to the whole torque, 64 under it.
TEST(HomingByItself, AJointThatStandsTurnsWhenItsTimeIsOver) {
  esmc::Homing<double> h(binary(), binary_tick, 100);
  Vec2<double> torque;
  for (int n = 1; n <= 127; ++n) ASSERT_EQ(h.step(begin, none, torque), Fault::none);
  EXPECT_EQ(torque[0], -0.5);
  ASSERT_EQ(h.step(begin, none, torque), Fault::none);
  EXPECT_EQ(torque[0], -0.5 + 0.5 / 64 + 0.125 * 0.5);
  // 126 ticks take the torque to the other side, and 64 more are the end of what does not move.
  for (int n = 1; n <= 127 + 63; ++n) ASSERT_EQ(h.step(begin, none, torque), Fault::none) << n;
  EXPECT_EQ(h.step(begin, none, torque), Fault::sign_test);
}

/// Twice the travel at its speed, and ten times the 64 ticks of the integral.
TEST(HomingByItself, AWayHasATimeLimit) {
  const Vec2<double> creeps(-0.069, 0.0);
  Vec2<double> torque;
  esmc::Homing<double> h(binary(), binary_tick, 100);
  for (int n = 0; n <= 8192 + 640; ++n) ASSERT_EQ(h.step(begin, creeps, torque), Fault::none) << n;
  EXPECT_EQ(h.step(begin, creeps, torque), Fault::home_no_stop);
  // The way off a stop has its own, and the way back.
  h.reset();
  for (int n = 0; n < 128; ++n) ASSERT_EQ(h.step(begin, none, torque), Fault::none);
  for (int n = 0; n <= 8192 + 640; ++n) ASSERT_EQ(h.step(begin, -creeps, torque), Fault::none) << n;
  EXPECT_EQ(h.step(begin, -creeps, torque), Fault::home_no_stop);
}

TEST(HomingByItself, TheWaitingJointIsDamped) {
  esmc::Homing<double> h(binary(), binary_tick, 100);
  Vec2<double> torque;
  ASSERT_EQ(h.step(begin, {0.0, 0.5}, torque), Fault::none);
  EXPECT_EQ(torque[1], -0.0625);
}

TEST(HomingByItself, FourTimesTheLargerSpeedIsTooFast) {
  for (const bool swapped : {false, true}) {
    HomingConfig<double> c = binary();
    c.speed = swapped ? Vec2<double>(-0.125, 0.25) : Vec2<double>(-0.25, 0.125);
    esmc::Homing<double> h(c, binary_tick, 100);
    Vec2<double> torque;
    EXPECT_EQ(h.step(begin, {1.0, -1.0}, torque), Fault::none);
    EXPECT_EQ(h.step(begin, {1.01, 0.0}, torque), Fault::joint_speed);
    EXPECT_EQ(h.step(begin, {0.0, -1.01}, torque), Fault::joint_speed);
  }
}

/// Two joints that go where the torque pushes, between their stops at `begin` and 0.07 rad off them.
struct Pushed {
  Vec2<double> torque = none, angle = begin, rate = none;
  double dislodged = 0.0;  // rad, of joint 1, once joint 2 moves
  Fault step(esmc::Homing<double>& h) {
    const bool second = torque[1] != 0.0;
    const Fault f = h.step(angle + Vec2<double>(second ? dislodged : 0.0, 0.0), rate, torque);
    for (int j = 0; j < 2; ++j) {
      if (torque[j] == 0.0) continue;
      const double off = j == 0 ? 1.0 : -1.0,
                   next = off * (angle[j] - begin[j]) + std::copysign(0.1, off * torque[j]) * binary_tick,
                   at = std::clamp(next, 0.0, 0.07);
      rate[j] = at == next ? std::copysign(0.1, torque[j]) : 0.0;
      angle[j] = begin[j] + off * at;
    }
    return f;
  }
};
/// Homing on both stops.
esmc::Homing<double> on_stops(const HomingConfig<double>& c = binary()) {
  esmc::Homing<double> h(c, binary_tick, 100);
  Pushed joints;
  for (int n = 0; n < 6000 && !h.met(); ++n) EXPECT_EQ(joints.step(h), Fault::none) << n;
  EXPECT_TRUE(h.met());
  return h;
}

/// Its place is a part of the zero: 0.045 rad are within the back-off, but not where the stop was met.
TEST(HomingByItself, JointOneHasToBeOnItsStopWhenJointTwoIs) {
  esmc::Homing<double> h(binary(), binary_tick, 100);
  Pushed joints;
  joints.dislodged = 0.045;
  for (int n = 0; n < 6000; ++n) ASSERT_EQ(joints.step(h), Fault::none) << n;
  EXPECT_FALSE(h.met());
  joints.dislodged = 0.019;
  ASSERT_EQ(joints.step(h), Fault::none);
  EXPECT_TRUE(h.met());
}

TEST(HomingByItself, RatesThatDoNotFitTheAnglesAreAFaultOnTheWayOffTheStops) {
  for (const int j : {0, 1}) {
    esmc::Homing<double> h = on_stops();
    Vec2<double> torque, at = begin, rate(0.1, -0.1);
    rate[j] *= 2.5;  // only the other one moves
    Fault f = Fault::none;
    for (int n = 0; n < 1000 && f == Fault::none; ++n) {
      at[1 - j] += rate[1 - j] * binary_tick;
      f = h.step(at, rate, torque);
    }
    EXPECT_EQ(f, Fault::feedback_jump);
  }
}

TEST(HomingByItself, ItHasLeftWhenBothAreOffAndSlow) {
  Vec2<double> torque;
  esmc::Homing<double> h = on_stops();
  const Vec2<double> off = begin + Vec2<double>(0.063, -0.063);
  const auto done = [&](const Vec2<double>& at, const Vec2<double>& rate) {
    EXPECT_EQ(h.step(at, rate, torque), Fault::none);
    EXPECT_FALSE(h.met());
    return h.done();
  };
  for (int n = 0; n < 64; ++n) EXPECT_FALSE(done(begin, none));
  EXPECT_FALSE(done({off[0], begin[1]}, none));
  EXPECT_FALSE(done({begin[0], off[1]}, none));
  EXPECT_FALSE(done(off, {0.126, 0.0}));
  EXPECT_FALSE(done(off, {0.0, -0.063}));
  EXPECT_TRUE(done(off, {0.125, -0.0625}));
  EXPECT_TRUE(done(off, none));
  const Vec2<double> holds = torque;
  EXPECT_TRUE(done(off, none));
  EXPECT_EQ(torque, holds) << "at rest it needs no more";
}

TEST(HomingByItself, LeavingHasTheTimeOfTheSlowerJoint) {
  for (const bool swapped : {false, true}) {
    HomingConfig<double> c = binary();
    if (swapped) c.speed = {-0.25, 0.5};
    Vec2<double> torque;
    esmc::Homing<double> h = on_stops(c);
    const Vec2<double> creeps = -0.126 * c.speed;  // just not standing
    for (int n = 0; n <= 16384 + 640; ++n) ASSERT_EQ(h.step(begin, creeps, torque), Fault::none) << n;
    EXPECT_EQ(h.step(begin, creeps, torque), Fault::home_no_stop);
  }
}

TEST(HomingByItself, AJointThatStandsOnItsStopUnderTheWholeTorqueIsAFault) {
  for (const Vec2<double>& stuck : {begin, Vec2<double>(begin + Vec2<double>(0.063, 0.0)),
                                    Vec2<double>(begin + Vec2<double>(0.0, -0.063))}) {
    esmc::Homing<double> h = on_stops();
    Vec2<double> torque;
    for (int n = 0; n < 64; ++n) ASSERT_EQ(h.step(begin, none, torque), Fault::none);
    Fault f = Fault::none;
    for (int n = 0; n < 1000 && f == Fault::none; ++n) f = h.step(stuck, none, torque);
    EXPECT_EQ(f, Fault::sign_test);
  }
}

/// Further into a stop than it is left by, and further off it than a joint needs to come to rest that another
/// one has pushed to twice the larger speed.
TEST(HomingByItself, AStopThatGivesWayOrAJointThatRunsAwayIsAFault) {
  for (const int j : {0, 1}) {
    for (const double way : {-1.0, 1.0}) {
      esmc::Homing<double> h = on_stops();
      Vec2<double> torque, at = begin;
      Fault f = Fault::none;
      for (double t = 0.0; f == Fault::none && t < 10.0;
           t += binary_tick) {  // the other one leaves and rests
        Vec2<double> rate(t < 0.7 ? 0.1 : 0.0, t < 0.7 ? -0.1 : 0.0);
        rate[j] = std::copysign(0.25, j == 0 ? way : -way);
        at += rate * binary_tick;
        f = h.step(at, rate, torque);
      }
      EXPECT_NEAR(std::abs(at[j] - begin[j]), way < 0.0 ? 0.0625 : 0.125, 0.001);
      EXPECT_EQ(f, Fault::home_no_stop) << j << ' ' << way;
    }
  }
}

/// Rates that do not fit the angles: dead, a tenth, the wrong sign, and of a frame that is repeated.
TEST(HomingByItself, RatesThatDoNotFitTheAnglesAreAFault) {
  for (const auto& [moves, says] : {std::pair{1.0, 0.0}, {1.0, 0.1}, {1.0, -1.0}, {0.0, 1.0}, {1.0, 2.0}}) {
    esmc::Homing<double> h(binary(), binary_tick, 100);
    Vec2<double> torque, at = begin;
    Fault f = Fault::none;
    for (int n = 0; n < 20 * 64 && f == Fault::none; ++n) {
      at[0] += moves * binary().speed[0] * binary_tick;
      f = h.step(at, {says * binary().speed[0], 0.0}, torque);
    }
    EXPECT_EQ(f, Fault::feedback_jump) << moves << ' ' << says;
  }
  esmc::Homing<double> h(binary(), binary_tick, 100);  // a tenth off passes
  Vec2<double> torque, at = begin;
  for (int n = 0; n < 64; ++n) {
    at[0] += binary().speed[0] * binary_tick;
    ASSERT_EQ(h.step(at, {0.9 * binary().speed[0], 0.0}, torque), Fault::none) << n;
  }
}

TEST(HomingByItself, TheWaitingJointHasTheSameTravel) {
  esmc::Homing<double> h(binary(), binary_tick, 100);
  Vec2<double> torque, at = begin;
  ASSERT_EQ(h.step(at, none, torque), Fault::none);
  at[1] += 0.999 * binary().travel;
  EXPECT_EQ(h.step(at, none, torque), Fault::none);
  at[1] += 0.002 * binary().travel;
  EXPECT_EQ(h.step(at, none, torque), Fault::home_no_stop);
}

/// A fifth of the speed in a tick, and a twentieth of that for what stays.
TEST(HomingByItself, ABrakeKeepsWhatCarriesAndLetsFrictionGo) {
  esmc::Homing<double> h(binary(), binary_tick, 100);
  Vec2<double> torque;
  const double damping = 0.125 * 0.05 * 64;
  const auto brake = [&](double rate) {
    EXPECT_EQ(h.brake({rate, -rate / 2}, torque), Fault::none);
    EXPECT_NEAR(torque[1], -torque[0] / 2, 1e-9);
    return torque[0] / damping;
  };
  EXPECT_NEAR(brake(0.2), -0.2 - 0.01, 1e-7);
  EXPECT_NEAR(brake(0.2), -0.2 - 0.02, 1e-7);
  EXPECT_NEAR(brake(-0.2), 0.2 - 0.016 + 0.01, 1e-7);
  EXPECT_NEAR(brake(0.0), -0.006, 1e-7);
  EXPECT_NEAR(h.brake({-0.06, 0.0}, torque) == Fault::none ? torque[0] / damping : 9.0, 0.06 - 0.006 + 0.003,
              1e-7)
      << "slow: a weight";
}

TEST(HomingByItself, ABrakeEndsAtRestOrFails) {
  Vec2<double> torque;
  esmc::Homing<double> h(binary(), binary_tick, 100);
  EXPECT_FALSE(h.at_rest());
  for (const auto& [rate, rests] : {std::pair{Vec2<double>(0.125, -0.0625), true},
                                    {Vec2<double>(0.126, 0.0), false},
                                    {Vec2<double>(0.0, 0.0626), false}}) {
    EXPECT_EQ(h.brake(rate, torque), Fault::none);
    EXPECT_EQ(h.at_rest(), rests) << rate;
  }
  for (const auto& [halt_ticks, most] : {std::pair{100U, 400}, {5U, 40}}) {
    h = esmc::Homing<double>(binary(), binary_tick, halt_ticks);
    for (int n = 0; n < 1000; ++n) ASSERT_EQ(h.brake(none, torque), Fault::none);
    for (int n = 0; n < most; ++n) ASSERT_EQ(h.brake({0.2, 0.0}, torque), Fault::none) << n;
    EXPECT_EQ(h.brake({0.2, 0.0}, torque), Fault::halt_failed);
  }
}

// ---- exactly at their bounds

/// On the way off the stops: joint `j` moves at `rate`, the other one creeps on its stop.
Fault leave_by(esmc::Homing<double>& h, int j, double rate, int ticks) {
  Vec2<double> torque, at = begin, rates = -0.126 * binary().speed;
  rates[j] = j == 0 ? rate : -rate;
  Fault f = Fault::none;
  for (int n = 0; n < ticks && f == Fault::none; ++n) {
    at[j] += rates[j] * binary_tick;
    f = h.step(at, rates, torque);
  }
  return f;
}
TEST(HomingByItself, AStopIsLeftByTheBoundsThemselves) {
  for (const int j : {0, 1}) {
    // Half a rad/s: 128 ticks are the back-off, 256 the farthest.
    esmc::Homing<double> into = on_stops(), off = on_stops();
    EXPECT_EQ(leave_by(into, j, -0.5, 128), Fault::none) << j;
    EXPECT_EQ(leave_by(off, j, 0.5, 256), Fault::none) << j;
    into = off = on_stops();
    EXPECT_EQ(leave_by(into, j, -0.5, 129), Fault::home_no_stop) << j;
    EXPECT_EQ(leave_by(off, j, 0.5, 257), Fault::home_no_stop) << j;
  }
  esmc::Homing<double> h = on_stops();
  Vec2<double> torque;
  EXPECT_EQ(h.step(begin + Vec2<double>(0.0625, -0.0625), none, torque), Fault::none);
  EXPECT_FALSE(h.done()) << "by the back-off, not by more";
}

/// A joint that is off may stand with what torque it has: it waits for the other one.
TEST(HomingByItself, AJointOffItsStopMayStand) {
  for (const int j : {0, 1}) {
    esmc::Homing<double> h = on_stops();
    Vec2<double> torque, at = begin, rate = -0.126 * binary().speed;
    rate[j] = 0.0;
    const auto off = [j](double v) { return j == 0 ? v : -v; };
    torque = none;
    for (int n = 0; n < 300 && off(torque[j]) < 0.5; ++n)
      ASSERT_EQ(h.step(at, rate, torque), Fault::none) << n;
    for (int n = 0; n < 12; ++n) ASSERT_EQ(h.step(at, rate, torque), Fault::none) << "the integral, too";
    at[j] += off(0.063);
    for (int n = 0; n < 200; ++n) ASSERT_EQ(h.step(at, rate, torque), Fault::none) << n;
    EXPECT_EQ(off(torque[j]), 0.5);
  }
}

TEST(HomingByItself, TurnsBackBeyondTheBackOff) {
  esmc::Homing<double> h(binary(), binary_tick, 100);
  Vec2<double> torque;
  for (int n = 0; n < 128; ++n) ASSERT_EQ(h.step(begin, none, torque), Fault::none);
  const auto torque_at = [&](double off) {
    esmc::Homing<double> copy = h;
    EXPECT_EQ(copy.step(begin + Vec2<double>(off, 0.0), none, torque), Fault::none);
    return torque[0];
  };
  const double away = torque_at(0.03125);
  EXPECT_EQ(torque_at(0.0625), away);
  EXPECT_LT(torque_at(0.0625 + 0x1p-30), away);
}

/// While it waits for all three ways of the first one, and no longer.
TEST(HomingByItself, TheWaitingJointHasOneTravelForAllWays) {
  Vec2<double> torque;
  esmc::Homing<double> h(binary(), binary_tick, 100);
  for (int n = 0; n < 64; ++n) ASSERT_EQ(h.step(begin, none, torque), Fault::none);
  const Vec2<double> most = begin + Vec2<double>(0.0, binary().travel),
                     more = most + Vec2<double>(0.0, 0x1p-20);
  for (int n = 64; n < 130; ++n) ASSERT_EQ(h.step(most, none, torque), Fault::none);
  EXPECT_GT(torque[0], -0.5) << "on its way off";
  EXPECT_EQ(h.step(more, none, torque), Fault::home_no_stop);

  h.reset();
  for (Pushed joints, next;; joints = next) {
    esmc::Homing<double> after = h;
    ASSERT_EQ(next.step(after), Fault::none);
    if (next.torque[1] != 0.0) {  // in this tick joint 1 meets its stop again
      EXPECT_EQ(h.step(joints.angle + Vec2<double>(0.0, 2.5), joints.rate, torque), Fault::none);
      break;
    }
    h = after;
  }
}

/// Where ten times the torque of the speed's error is less than the whole torque.
TEST(HomingByItself, ATorqueBeginsWithAShareOfTenTimesThatOfTheSpeed) {
  HomingConfig<double> c = binary();
  c.torque = {4.0, 4.0};
  esmc::Homing<double> h(c, binary_tick, 100);
  Vec2<double> torque;
  const double error = 0.125 * 0.5;
  double integral = 0.0;
  for (int n = 0; n < 240; ++n) {
    ASSERT_EQ(h.step(begin, none, torque), Fault::none);
    integral = std::min(integral + std::max(10 * error, integral) / 64, 4.0);
    EXPECT_NEAR(torque[0], -std::min(integral + error, 4.0), 1e-12) << n;
  }
  EXPECT_EQ(torque[0], -4.0);
}

TEST(HomingByItself, AnAngleMayJumpByFourTimesTheSpeedOrByWhatAnEncoderResolves) {
  HomingConfig<double> c = binary();
  EXPECT_FLOAT_EQ(static_cast<float>(esmc::Homing<double>(c, binary_tick, 100).feedback_jump()), 0.002F);
  for (const Vec2<double>& speed : {Vec2<double>(-1.0, 0.25), Vec2<double>(0.25, 1.0)}) {
    c.speed = speed;
    EXPECT_EQ(esmc::Homing<double>(c, binary_tick, 100).feedback_jump(), 4.0 * binary_tick);
  }
}

}  // namespace
