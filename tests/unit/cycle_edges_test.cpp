/// Parts of the cycle by themselves, exactly at their bounds: jumps of a sample, reported torques, the zero,
/// the sign test, the way to rest, the wait for drives. Expected values are those of the formulas in words.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "firmware/cycle/enabling_wait.hpp"
#include "firmware/cycle/plausibility.hpp"
#include "firmware/cycle/sign_test.hpp"
#include "firmware/cycle/stop_trajectory.hpp"

namespace {

using esmc::Vec2;

// ---- samples

struct FourJoints {
  using Scalar = double;
  static constexpr int joints = 4;
};
using Sample = esmc::Sample<FourJoints>;
using Jump = esmc::SampleJumpCheck<FourJoints>;

Sample sample(int joint, double angle, double rate = 0, std::uint32_t age = 0) {
  Sample s;
  s.angle[joint] = angle;
  s.rate[joint] = rate;
  s.age_ticks[static_cast<unsigned>(joint)] = age;
  return s;
}

TEST(SampleJumpEdges, ASampleMayDifferByTheJumpItselfPerTickBetween) {
  // Kept at the end of tick 0 with age `kept`; then `missed` ticks without a sample; the new one has age
  // `age`.
  struct Case {
    std::uint32_t kept, missed, age;
    double ticks;
  };
  for (const int joint : {0, 3}) {
    for (const auto& [kept, missed, age, ticks] :
         {Case{0, 0, 0, 1}, Case{0, 1, 0, 2}, Case{0, 3, 0, 4}, Case{0, 3, 2, 2}, Case{2, 0, 0, 3},
          Case{2, 0, 2, 1}, Case{1, 2, 1, 3}}) {
      for (const double sign : {1.0, -1.0}) {
        Jump j;
        j.keep(sample(joint, 0.5, 0, kept), 1);
        for (std::uint32_t i = 0; i < missed; ++i) j.keep(sample(joint, 9, 0, kept + 1 + i), 1);
        const double predicted = 0.5 + 8 * (0.125 * ticks), most = 0.25 * ticks;
        EXPECT_TRUE(j.plausible(joint, sample(joint, predicted + sign * most, 8, age), 0.25, 0.125));
        EXPECT_FALSE(j.plausible(joint, sample(joint, predicted + sign * (most + 1e-9), 8, age), 0.25, 0.125))
            << kept << missed << age;
      }
    }
  }
}

TEST(SampleJumpEdges, WithoutAnEarlierSampleOrAJumpEverythingIsPlausible) {
  Jump j;
  EXPECT_TRUE(j.plausible(1, sample(1, 100), 0.1, 1)) << "nothing is kept";
  j.keep(sample(1, 0), 1);
  EXPECT_FALSE(j.plausible(1, sample(1, 100), 0.1, 1));
  EXPECT_TRUE(j.plausible(1, sample(1, 100), 0, 1)) << "not asked for";
  EXPECT_TRUE(j.plausible(1, sample(1, 100, 0, 1), 0.1, 1)) << "no new sample";
  Jump every_other;
  every_other.keep(Sample{}, 2);
  for (const int joint : {0, 1, 2, 3})
    EXPECT_EQ(every_other.plausible(joint, sample(joint, 100), 0.1, 1), joint % 2 == 1) << joint;
}

TEST(SampleJumpEdges, AfterAThousandTicksASampleIsForgotten) {
  for (const std::uint32_t silent : {999U, 1000U, 1001U, 1500U}) {
    Jump j;
    j.keep(sample(0, 0), 1);
    for (std::uint32_t i = 1; i <= silent; ++i) j.keep(sample(0, 0, 0, 5000 + i), 1);
    EXPECT_EQ(j.plausible(0, sample(0, 5000), 1, 1), silent > 1000) << silent;
    EXPECT_EQ(j.plausible(0, sample(0, -5000), 1, 1), silent > 1000) << silent;
    j.keep(sample(0, 7), 1);
    EXPECT_TRUE(j.plausible(0, sample(0, 8), 1, 1)) << "counts from the new one";
    EXPECT_FALSE(j.plausible(0, sample(0, 8.01), 1, 1));
  }
  for (const std::uint32_t age : {1000U, 1001U}) {
    Jump j;
    j.keep(sample(0, 0, 0, age), 1);
    EXPECT_EQ(j.plausible(0, sample(0, 5000), 1, 1), age > 1000) << "already too old";
  }
}

// ---- reported torques

using Echo = esmc::TorqueFeedbackCheck<FourJoints>;

TEST(TorqueFeedbackEdges, TheExpectedTorqueFollowsTheCommandByItsShareOfATick) {
  // Lag 3 ticks: a quarter of the way in every tick.
  Echo echo(0.5, 3, 1);
  EXPECT_TRUE(echo.compares());
  EXPECT_FALSE(Echo{}.compares() || Echo(0, 3, 1).compares());
  echo.commanded({0, 0, 8, 0});
  for (const auto& [reported, fits] : {std::pair{2.0F, true},
                                       {2.5F, true},
                                       {1.5F, true},
                                       {2.51F, false},
                                       {1.49F, false},
                                       {std::nanf(""), false}}) {
    Echo e = echo;
    for (int n = 1; n <= 6; ++n) EXPECT_EQ(e.plausible(2, reported), fits || n < 5) << reported << ' ' << n;
  }
  echo.commanded({0, 0, 8, 0});
  for (int n = 1; n <= 6; ++n) EXPECT_TRUE(echo.plausible(2, 3.5F));
  for (int n = 1; n <= 6; ++n) EXPECT_EQ(echo.plausible(1, 3.5F), n < 5) << "of another joint";
}

TEST(TorqueFeedbackEdges, FiveReportsInARowCount) {
  const auto off = [](Echo& e, int n) {
    bool good = true;
    for (int i = 0; i < n; ++i) good = e.plausible(1, 1.0F) && e.plausible(1, std::nullopt) && good;
    return good;
  };
  for (const bool forget : {false, true}) {
    Echo e(0.5, 0, 1);
    EXPECT_TRUE(off(e, 4));
    if (forget) {
      e.forget();
    } else {
      EXPECT_TRUE(e.plausible(1, 0.0F));
    }
    EXPECT_TRUE(off(e, 4)) << "begins anew";
    EXPECT_FALSE(off(e, 1));
  }
  Echo none(0, 0, 1);
  EXPECT_TRUE(off(none, 20)) << "nothing is compared";
}

// ---- zero

TEST(ZeroPoseEdges, TheShiftTakesTheEncodersToThePose) {
  using Zero = esmc::ZeroPose<FourJoints>;
  const esmc::Vec<double, 4> pose(1, 2, 3, 4), read(0.5, 2.25, 3, -4);
  Zero z(false, pose);
  EXPECT_FALSE(z.confirmed());
  EXPECT_EQ(z.shift(0), 0);
  z.confirm(read);
  EXPECT_TRUE(z.confirmed());
  for (int j = 0; j < 4; ++j) EXPECT_EQ(z.shift(j), pose[j] - read[j]);
  z.confirm(pose);  // read with the shift: already there
  for (int j = 0; j < 4; ++j) EXPECT_EQ(z.shift(j), pose[j] - read[j]);
  z.forget();
  EXPECT_FALSE(z.confirmed());
  for (Zero absolute : {Zero(true, pose), Zero{}}) {
    absolute.confirm(read);
    EXPECT_EQ(absolute.shift(1), 0);
    absolute.forget();
    EXPECT_TRUE(absolute.confirmed());
  }
}

// ---- sign test

/// Two joints with a constant inertia {a, b; d, c}, and the rotors on top of it. No mechanism has b != d, but
/// then no entry can stand for another.
struct Joints {
  using Scalar = double;
  using Pose = int;
  using Rates = Vec2<double>;
  using Channels = Vec2<double>;
  double a = 1, b = 0, c = 1, d = 0, rotors = 0;
  Vec2<double> weight = {0, 0};
  [[nodiscard]] Rates base_accelerations(Pose, const Rates&, const Vec2<double>& q) const { return q; }
  [[nodiscard]] Channels channel_accelerations(Pose, const Rates&, const Rates& q) const { return q; }
  void add_rotors(Channels& q) const { q *= 1 + rotors; }
  [[nodiscard]] Channels force(const Channels& q, const Rates&) const { return q; }
  [[nodiscard]] Vec2<double> base_torque(Pose, const Channels& f) const {
    return {a * f[0] + b * f[1] + weight[0], d * f[0] + c * f[1] + weight[1]};
  }
  /// Accelerations of a torque on one motor, by Cramer's rule.
  [[nodiscard]] Vec2<double> answer(int motor, double torque) const {
    const double k = torque / ((a * c - b * d) * (1 + rotors));
    return motor == 0 ? Vec2<double>(c * k, -d * k) : Vec2<double>(-b * k, a * k);
  }
};
using Signs = esmc::SignTest<Joints>;
using Verdict = Signs::Verdict;
constexpr double share = static_cast<double>(0.05F);  // as the float of the code

/// Runs a test whose joints move as told: `motion(motor, u)` from the start of a motor's test, u = time in
/// halves; returns the pulses that were given.
struct Trial {
  Joints m;
  double move = 1e-4, sample_time = 0x1p-10;
  Vec2<double> limit = {2, 3}, rate = {0, 0}, from = {0.25, -0.5};
  int half[2] = {0, 0};
  Trial() = default;
  void measure() {
    for (int i = 0; i < 2; ++i) {
      const double own = m.answer(i, limit[i] * share)[i];
      half[i] = 1;
      while (half[i] < 300 && 0.5 * own * std::pow(half[i] * sample_time, 2) < move) ++half[i];
    }
  }
  /// Displacement after the first half, as the model expects it.
  [[nodiscard]] Vec2<double> expected(int motor) const {
    const double t = half[motor] * sample_time;
    return m.answer(motor, limit[motor] * share) * (t * t * 0.5);
  }
  template <class Motion>
  Verdict run(const Motion& motion, std::vector<Vec2<double>>* pulses = nullptr) {
    measure();
    Signs test(move, sample_time);
    return run(test, motion, pulses);
  }
  template <class Motion>
  Verdict run(Signs& test, const Motion& motion, std::vector<Vec2<double>>* pulses = nullptr) {
    for (int motor = 0; motor < 2; ++motor) {
      for (int k = 0; k < 2 * half[motor]; ++k) {
        const Vec2<double> angle = from + rate * (k * sample_time) + motion(motor, 1.0 * k / half[motor]);
        Vec2<double> torque = m.weight;
        const Verdict v = test.step(m, 0, angle, rate, limit, torque);
        if (v != Verdict::going_on) return v;
        if (pulses != nullptr) pulses->push_back(torque - m.weight);
      }
    }
    Vec2<double> torque = m.weight;
    return test.step(m, 0, from, rate, limit, torque);
  }
  /// The model's own motion: as the square of time, then braked as fast, times a factor.
  [[nodiscard]] auto model(double factor) const {
    return [this, factor](int motor, double u) {
      return Vec2<double>(expected(motor) * (factor * (u <= 1 ? u * u : 2 - (2 - u) * (2 - u))));
    };
  }
};

Trial coupled() {
  Trial t;
  t.m = {.a = 2, .b = 0.5, .c = 1, .d = 0.625, .rotors = 0.25, .weight = {5, -7}};
  t.rate = {0.125, -0.25};
  return t;
}

TEST(SignTestEdges, EachMotorGetsItsPulseForAHalfAndTheOppositeForTheOther) {
  Trial t = coupled();
  std::vector<Vec2<double>> pulses;
  EXPECT_EQ(t.run(t.model(1), &pulses), Verdict::passed);
  ASSERT_EQ(pulses.size(), static_cast<std::size_t>(2 * t.half[0] + 2 * t.half[1]));
  EXPECT_NE(t.half[0], t.half[1]);
  std::size_t at = 0;
  for (int motor = 0; motor < 2; ++motor) {
    for (int k = 0; k < 2 * t.half[motor]; ++k, ++at) {
      const double p = (k < t.half[motor] ? 1 : -1) * t.limit[motor] * share;
      EXPECT_NEAR(pulses[at][motor], p, 1e-14) << motor << ' ' << k;
      EXPECT_EQ(pulses[at][1 - motor], 0) << motor << ' ' << k;
    }
  }
}

TEST(SignTestEdges, PassedIsKeptUntilReset) {
  Trial t = coupled();
  t.measure();
  Signs test(t.move, t.sample_time);
  for (int round = 0; round < 3; ++round) {
    std::vector<Vec2<double>> pulses;
    EXPECT_EQ(t.run(test, t.model(1), &pulses), Verdict::passed);
    EXPECT_EQ(pulses.size(), static_cast<std::size_t>(2 * t.half[0] + 2 * t.half[1]));
    for (int i = 0; i < 5; ++i) {
      Vec2<double> torque = t.m.weight;
      EXPECT_EQ(test.step(t.m, 0, {9, 9}, {0, 0}, t.limit, torque), Verdict::passed);
      EXPECT_EQ(torque, t.m.weight);
    }
    test.reset();
    for (int i = 0; i < 7 * round; ++i) {  // and in the midst of a half
      Vec2<double> torque = t.m.weight;
      (void)test.step(t.m, 0, t.from, {0, 0}, t.limit, torque);
    }
    test.reset();
  }
}

/// A quarter to four times as far, each bound included; exact, as all factors are powers of two.
TEST(SignTestEdges, AQuarterToFourTimesTheMotionIsAllowed) {
  struct Case {
    double own;
    bool passes;
  };
  for (const auto& [own, passes] :
       {Case{1, true}, Case{0.25, true}, Case{0.2499, false}, Case{4, true}, Case{4.001, false},
        Case{-1, false}, Case{0, false}, Case{std::numeric_limits<double>::quiet_NaN(), false}}) {
    for (const int bad : {0, 1}) {
      Trial t;
      t.from = {0, 0};
      const auto motion = [&, factor = own](int motor, double u) -> Vec2<double> {
        if (motor != bad) return t.model(1)(motor, u);
        return t.expected(motor) * (u < 1 ? 0 : factor);
      };
      EXPECT_EQ(t.run(motion), passes ? Verdict::passed : Verdict::failed) << own << ' ' << bad;
    }
  }
}

TEST(SignTestEdges, TheOtherJointCountsTooButNotInsteadOfTheOwn) {
  // In shares of the expected own motion, of which -1/2 is expected of the other joint: at the end of the
  // first half, at least 1/4 of the way along (1, -1/2), as own motion too, and at most four times as far.
  struct Case {
    double own, other;
    bool passes;
  };
  for (const auto& [own, other, passes] :
       {Case{1, -0.5, true}, Case{0.31, 0, false}, Case{0.315, 0, true}, Case{0.24, -1, false},
        Case{0.26, -0.2, true}, Case{3.99, 0, true}, Case{4.01, 0, false}, Case{3.99, -1.99, true},
        Case{3.99, -2.1, false}, Case{1, 1.37, true}, Case{1, 1.38, false}}) {
    for (const int tested : {0, 1}) {
      Trial t;
      // -1/2 as much of the other joint, for either motor.
      t.m = tested == 0 ? Joints{.a = 2, .b = 0.75, .c = 1, .d = 0.5}
                        : Joints{.a = 1, .b = 0.5, .c = 2, .d = 0.75};
      t.rate = {0.5, 0.25};
      const auto motion = [&, own_ = own, other_ = other](int motor, double u) -> Vec2<double> {
        if (motor != tested) return t.model(1)(motor, u);
        const double unit = u < 1 ? 0 : t.expected(motor)[motor];
        return motor == 0 ? Vec2<double>(own_ * unit, other_ * unit)
                          : Vec2<double>(other_ * unit, own_ * unit);
      };
      EXPECT_EQ(t.run(motion), passes ? Verdict::passed : Verdict::failed) << own << ' ' << other << tested;
    }
  }
}

TEST(SignTestEdges, AJointThatRunsAwayEndsTheTestAtOnce) {
  for (const double start : {0.25, 1.5}) {  // in the first half, in the second
    for (const auto& [factor, passes] : {std::pair{3.99, true}, {4.01, false}}) {
      Trial t = coupled();
      const auto motion = [&, far = factor](int motor, double u) -> Vec2<double> {
        const bool away = motor == 0 && u >= start && u < start + 0.125;
        return away ? Vec2<double>(t.expected(0) * far) : t.model(1)(motor, u);
      };
      EXPECT_EQ(t.run(motion), passes ? Verdict::passed : Verdict::failed) << start << ' ' << factor;
    }
  }
}

TEST(SignTestEdges, AHalfIsAsLongAsTheMotionNeedsAndNotTooLong) {
  // own = 0.1 rad/s2 and 1/8 s a tick: n ticks move 0.1 / 128 n^2.
  const double unit = 2 * share / 128;
  struct Case {
    double move;
    int half;  ///< 0: the joint cannot be tested
  };
  for (const auto& [move, half] :
       {Case{unit * 0.5, 1}, Case{unit, 1}, Case{unit * 1.01, 2}, Case{unit * 3.99, 2}, Case{unit * 4.01, 3},
        Case{unit * 198.9 * 198.9, 199}, Case{unit * 199.1 * 199.1, 0}, Case{unit * 1e6, 0}}) {
    Trial t;
    t.sample_time = 0.125;
    t.move = move;
    t.limit = {2, 2};
    std::vector<Vec2<double>> pulses;
    const Verdict v = t.run(t.model(1), &pulses);
    EXPECT_EQ(v, half > 0 ? Verdict::passed : Verdict::failed) << move / unit;
    EXPECT_EQ(pulses.size(), static_cast<std::size_t>(4 * half)) << move / unit;
  }
}

/// A motion of an eighth of a second, at any rate; one of more than 0.2 s only where that is 199 ticks.
TEST(SignTestEdges, AFastLoopAllowsTheSameTime) {
  for (const double rate : {256.0, 1024.0, 8192.0, 131072.0}) {
    for (const double time : {0.125, 0.1999, 0.2001, 0.75}) {
      Trial t;
      t.sample_time = 1.0 / rate;
      t.limit = {2, 2};
      t.move = 0.5 * 2 * share * time * time;
      const int half = static_cast<int>(std::ceil(time * rate));
      t.half[0] = t.half[1] = half;
      Signs test(t.move, t.sample_time);
      std::vector<Vec2<double>> pulses;
      const bool passes = time < 0.2 || half <= 199;
      EXPECT_EQ(t.run(test, t.model(1), &pulses), passes ? Verdict::passed : Verdict::failed)
          << rate << ' ' << time;
      EXPECT_EQ(pulses.size(), passes ? static_cast<std::size_t>(4 * half) : 0U) << rate << ' ' << time;
    }
  }
}

TEST(SignTestEdges, AMotorThatTheModelCannotTurnFailsAtOnce) {
  for (const int motor : {0, 1}) {
    for (const double inertia : {-1.0, std::numeric_limits<double>::quiet_NaN()}) {
      Trial t;
      (motor == 0 ? t.m.a : t.m.c) = inertia;
      std::vector<Vec2<double>> pulses;
      EXPECT_EQ(t.run(t.model(1), &pulses), Verdict::failed);
      EXPECT_EQ(pulses.size(), inertia < 0 && motor == 1 ? static_cast<std::size_t>(2 * t.half[0]) : 0U);
    }
    for (const double limit : {0.0, 1e-300}) {
      Trial t;
      t.limit[motor] = limit;
      std::vector<Vec2<double>> pulses;
      EXPECT_EQ(t.run(t.model(1), &pulses), Verdict::failed) << "no torque to speak of";
      EXPECT_EQ(pulses.size(), static_cast<std::size_t>(motor == 1 ? 2 * t.half[0] : 0));
    }
  }
}

// ---- the way to rest

TEST(StopTrajectoryEdges, IsTheQuinticOfItsFormula) {
  constexpr std::uint32_t ticks = 8;
  constexpr double T = 0.5, duration = ticks * T;
  esmc::StopTrajectory<double> stop(ticks, T);
  EXPECT_FALSE(stop.begun());
  stop.advance();
  const Vec2<double> q(1, -2), v(0.5, 3);
  for (int round = 0; round < 2; ++round) {
    stop.begin(q, v);
    EXPECT_TRUE(stop.begun());
    for (std::uint32_t k = 0; k < 50; ++k, stop.advance()) {
      const double u = std::min(k * T / duration, 1.0);
      const auto m = stop.at();
      const Vec2<double> way = v * (duration * (u - u * u * u + u * u * u * u / 2)),
                         speed = v * (1 - 3 * u * u + 2 * u * u * u),
                         brake = v * (6 * (u * u - u) / duration);
      EXPECT_LT((m.position - q - way).norm(), 1e-12) << k;
      EXPECT_LT((m.velocity - speed).norm(), 1e-12) << k;
      EXPECT_LT((m.acceleration - brake).norm(), 1e-12) << k;
      EXPECT_EQ(stop.over(), k >= ticks) << k;
      EXPECT_EQ(stop.overdue(), k >= 4 * ticks) << k;
    }
    stop.end();
    EXPECT_FALSE(stop.begun());
    const auto rest = stop.at();
    stop.advance();
    EXPECT_EQ(stop.at().position, rest.position);
  }
  esmc::StopTrajectory<double> idle(3, T);
  for (int i = 0; i < 20; ++i) idle.advance();
  EXPECT_FALSE(idle.over()) << "no time passes before it has begun";
  EXPECT_FALSE(esmc::StopTrajectory<double>(1, T).over());
  EXPECT_TRUE(esmc::StopTrajectory<double>{}.over()) << "no duration";
}

// ---- the wait for drives

struct Waited {
  std::vector<std::uint32_t> silent;
  std::vector<bool> setting_up;
  esmc::EnablingWait<3> wait;
  bool expired(std::uint32_t passed, std::uint32_t most) {
    const int n = static_cast<int>(silent.size());
    const auto known = [n](int i) {
      EXPECT_LT(i, n) << "an axis that there is not";
      return static_cast<unsigned>(i < n ? i : 0);
    };
    return wait.expired(
        n, passed, most, [&](int i) { return silent[known(i)]; },
        [&](int i) { return setting_up[known(i)]; });
  }
};

TEST(EnablingWaitEdges, CountsTicksWithoutProgress) {
  Waited w{{9, 9}, {false, false}, {}};
  EXPECT_FALSE(w.wait.waits || w.wait.all || w.wait.heard[0]);
  for (int i = 1; i <= 4; ++i) EXPECT_FALSE(w.expired(2, 10)) << i;
  EXPECT_TRUE(w.wait.waits);
  EXPECT_TRUE(w.expired(2, 10)) << "silent for ten ticks";
  w.silent = {0, 1};
  EXPECT_TRUE(w.expired(1, 10)) << "one alone is not enough";
  Waited last{{9, 0}, {false, false}, {}};
  EXPECT_FALSE(last.expired(1, 10) || last.wait.all) << "nor is the last one";
  w.silent = {5, 0};
  EXPECT_FALSE(w.expired(1, 10)) << "each has been heard: counts anew";
  EXPECT_EQ(w.wait.ticks, 1U);
  w.setting_up = {true, false};
  for (int i = 0; i < 100; ++i) EXPECT_FALSE(w.expired(1, 10)) << "a set-up goes on";
  w.setting_up = {false, false};
  for (int i = 2; i < 10; ++i) EXPECT_FALSE(w.expired(1, 10)) << i;
  EXPECT_TRUE(w.expired(1, 10)) << "heard once is heard: the count goes on";
  Waited half{{0, 9, 9}, {true, true, true}, {}};
  for (int i = 1; i < 10; ++i) EXPECT_FALSE(half.expired(1, 10));
  EXPECT_TRUE(half.expired(1, 10)) << "a set-up does not make up for a silent drive";
}

}  // namespace
