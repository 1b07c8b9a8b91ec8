/// Optional parts on an arm whose equations of motion are written out here: two bars, inertia, gravity and
/// viscous friction, without the channels of the controller.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "firmware/cycle/closure_projection.hpp"
#include "firmware/cycle/part_implicit_coupled.hpp"
#include "firmware/cycle/part_momentum_observer.hpp"
#include "firmware/cycle/part_motor_map.hpp"
#include "firmware/cycle/part_predictor.hpp"
#include "firmware/cycle/part_super_twisting.hpp"
#include "firmware/mechanism/rr.hpp"

namespace {

using namespace esmc;
using Arm = Rr<double>;
using V = Vec2<double>;
using Memory = PartMemory<Arm>;

constexpr double l1 = 0.2, c1 = 0.09, c2 = 0.07, m1 = 0.4, m2 = 0.3, J1 = 2e-3, J2 = 1e-3, g = 9.8;
const V viscous(0.01, 0.02);

/// H q'' + coriolis + gravity + friction = torque.
struct Equations {
  double h11, h12, h22;
  V coriolis, drift;  ///< of the momentum H q', besides torque
  V weight;
  Equations(const V& q, const V& r) {
    const double a = q[0], b = q[1], k = m2 * l1 * c2;
    h22 = J2 + m2 * c2 * c2;
    h12 = h22 + k * std::cos(b);
    h11 = J1 + m1 * c1 * c1 + h22 + m2 * l1 * l1 + 2 * k * std::cos(b);
    const double by_b = -k * std::sin(b);  // derivative of h12, half that of h11
    coriolis = {by_b * (2 * r[0] * r[1] + r[1] * r[1]), -by_b * r[0] * r[0]};
    weight = {g * ((m1 * c1 + m2 * l1) * std::cos(a) + m2 * c2 * std::cos(a + b)),
              g * m2 * c2 * std::cos(a + b)};
    const V friction = viscous.cwiseProduct(r);
    // Lagrange: what changes the momentum is the derivative of the kinetic energy by the angles.
    drift = V(0, by_b * (r[0] * r[0] + r[0] * r[1])) - weight - friction;
    coriolis += friction;
  }
  [[nodiscard]] V times(const V& v) const { return {h11 * v[0] + h12 * v[1], h12 * v[0] + h22 * v[1]}; }
  [[nodiscard]] V solve(const V& f) const {
    return V(h22 * f[0] - h12 * f[1], h11 * f[1] - h12 * f[0]) / (h11 * h22 - h12 * h12);
  }
  [[nodiscard]] V acceleration(const V& torque) const { return solve(torque - coriolis - weight); }
};

ControllerConfig<Arm> config_of_arm(double sample_time) {
  ControllerConfig<Arm> c;
  c.mechanism = Arm({{l1, 0.15, c1, c2, m1, m2, J1, J2, viscous[0], viscous[1]}, g});
  c.mode = {1};
  c.gains.lambda.setConstant(20);
  c.gains.k.setConstant(8);
  c.gains.layer.setConstant(0.5);
  c.gains.independent = {20, 8, 0.5, 90, 15};
  c.torque_limit.setConstant(3);
  c.sample_time = sample_time;
  return c;
}
Tracking<Arm> moving(const Arm& arm, const V& angle, const V& rate) {
  Tracking<Arm> t{};
  t.pose = arm.pose(angle);
  t.rates = rate;
  t.desired_pose = arm.pose(angle + V(0.1, -0.2));
  t.desired_rates = V(0.5, 0.25);
  t.desired_acceleration = V(1, -2);
  return t;
}
const V angle(0.4, 0.9), rate(1.5, -2.5);

// ---- the predictor

TEST(PredictorEdges, GoesThroughTheTorquesUnderWay) {
  const double h = 0.01;
  for (const int delay : {0, 1, 3}) {
    for (const int kept : {0, 1, 2, 6}) {
      ControllerConfig<Arm> c = config_of_arm(h);
      c.delay_ticks = delay;
      Memory memory;
      memory.disturbance = {0.3, -0.2};
      std::array<V, 6> sent;
      for (int i = 0; i < kept; ++i) {
        sent[static_cast<unsigned>(i)] = {0.1 * (i + 1), 0.3 - 0.07 * i * i};
        memory.keep(sent[static_cast<unsigned>(i)], true);
      }
      Tracking<Arm> t = moving(c.mechanism, angle, rate);
      part::predictor(c, memory, t);
      V q = angle, r = rate;
      for (int ago = delay; ago > 0; --ago) {  // the oldest first
        const V torque = ago <= kept ? sent[static_cast<unsigned>(kept - ago)] : V(0, 0);
        const V a = Equations(q, r).acceleration(torque + V(0.3, -0.2));
        q += r * h + a * h * h / 2;
        r += a * h;
      }
      EXPECT_LT((Arm::angles(t.pose) - q).norm(), 1e-12) << delay << ' ' << kept;
      EXPECT_LT((t.rates - r).norm(), 1e-11) << delay << ' ' << kept;
      EXPECT_EQ(t.desired_rates, V(0.5, 0.25));
    }
  }
}

// ---- the observer

TEST(ObserverEdges, ComparesTheMomentumWithThatOfTheLastTick) {
  const double h = 0.01, bandwidth = 30;
  ControllerConfig<Arm> c = config_of_arm(h);
  c.observer_bandwidth = bandwidth;
  c.delay_ticks = 1;
  const V next_angle(0.45, 0.8), next_rate(0.75, -3);
  const Equations now(angle, rate), next(next_angle, next_rate);
  for (const int kept : {0, 1, 2}) {
    Memory memory;
    for (int i = 0; i < kept; ++i) memory.keep(i == 0 ? V(0.5, -0.25) : V(9, 9), true);
    memory.momentum = V(7, 7);  // of no tick
    memory.disturbance = V(0, 0);
    if (kept == 0) {
      part::momentum_observer(c, moving(c.mechanism, angle, rate), memory);
      EXPECT_EQ(memory.disturbance, V(0, 0)) << "there is nothing to compare with";
    }
    memory.momentum = now.times(rate) + now.drift * (h / 2);
    const V before(0.125, 0.25);
    memory.disturbance = before;
    part::momentum_observer(c, moving(c.mechanism, next_angle, next_rate), memory);
    const V change = next.times(next_rate) - now.times(rate) - (next.drift + now.drift) * (h / 2);
    const V acted = kept == 2 ? V(0.5, -0.25) : V(0, 0);
    const V expected =
        kept == 0 ? before : V((before + (change - acted * h) * bandwidth) / (1 + bandwidth * h));
    EXPECT_LT((memory.disturbance - expected).norm(), 1e-12) << kept;
    EXPECT_LT((memory.momentum - next.times(next_rate) - next.drift * (h / 2)).norm(), 1e-13) << kept;
  }
}

TEST(ObserverEdges, LimitsTheDisturbanceAndNothingBehindIt) {
  struct {
    Memory memory;
    double behind = 1e300;
  } fenced;
  ControllerConfig<Arm> c = config_of_arm(1e-3);
  c.observer_bandwidth = 100;
  for (const double sign : {1.0, -1.0}) {
    fenced.memory.keep(V(0, 0), true);
    fenced.memory.momentum = V(-100, 100) * sign;
    part::momentum_observer(c, moving(c.mechanism, angle, rate), fenced.memory);
    EXPECT_EQ(fenced.memory.disturbance, V(6, -6) * sign) << "all motors together";
    EXPECT_EQ(fenced.behind, 1e300);
  }
}

// ---- the motor map

TEST(MotorMapEdges, AnyAmplitudeCountsAndOnlyMotorsAreMapped) {
  ControllerConfig<Arm> c = config_of_arm(1e-3);
  c.motor_map.amplitude = {1, 0};
  c.motor_map.per_turn = {1, 1};
  c.motor_map.factor = {2, 4};
  c.motor_map.phase = {1, 0};
  Sample<Arm> measured;
  measured.angle = {0.5, std::numeric_limits<double>::quiet_NaN()};
  measured.rate = {0.3, 0.7};
  struct {
    V torque{3, 8};
    double behind = 7;
  } fenced;
  part::motor_map(c, measured, MotorTorque::given_to_asked, fenced.torque);
  EXPECT_NEAR(fenced.torque[0], (3 - std::sin(0.5 + 1)) / 2, 1e-15);
  EXPECT_EQ(fenced.torque[1], 2) << "without an amplitude the angle does not matter";
  EXPECT_EQ(fenced.behind, 7);
}

// ---- the super-twisting law

/// What the law adds to v', as accelerations of the joints: its rows of the bars' angles are those of the
/// joints and their sums.
TEST(SuperTwistingEdges, KnowsItsSlidingVariablesAndWhatWasLost) {
  const double h = 1e-3;
  struct Case {
    bool whole;
    int kept;
  };
  for (const LawKind law : {LawKind::esmc, LawKind::esmc_projected}) {
    for (const auto& [whole, kept] : {Case{true, 0}, Case{false, 0}, Case{true, 2}, Case{false, 2}}) {
      ControllerConfig<Arm> c = config_of_arm(h);
      c.law = law;
      const Tracking<Arm> t = moving(c.mechanism, angle, rate);
      Arm::Channels without, acceleration, sliding;
      part::without_switching(c, t, without, sliding);

      const Equations now(angle, rate);
      V s = sliding.head<2>();
      if (law == LawKind::esmc) {  // the rates of the joints whose momenta are those of all channels
        V momenta(0, 0);
        for (int k = 0; k < 2; ++k) {
          const Arm::Channels unit = c.mechanism.channel_rates(t.pose, V::Unit(k));
          for (int i = 0; i < Arm::channels; ++i)
            if (Arm::has_mass(i)) momenta[k] += unit[i] * c.mechanism.mass()[i] * sliding[i];
        }
        s = now.solve(momenta);
      }
      Memory memory;
      SuperTwisting<double> alone;
      const V asked(2.5, 0.25), sent(0.5, -0.125);
      for (int n = 0; n < 3; ++n) {
        for (int i = 0; i < kept; ++i) memory.keep(i == 0 ? V(-9, 9) : sent, whole);
        memory.whole = whole;
        memory.asked = asked;
        part::super_twisting(c, t, memory, acceleration, sliding);
        const V lost = whole || kept == 0 ? V(0, 0) : now.solve(asked - sent);
        const V w = alone.step(s, lost, c.gains.independent.k, h, {});
        const Arm::Channels expected = c.mechanism.channel_rates(t.pose, w);
        for (int i = 0; i < Arm::channels; ++i) {
          if (!Arm::has_mass(i)) continue;
          EXPECT_NEAR(acceleration[i] - without[i], expected[i], 1e-8 * (1 + std::abs(expected[i])))
              << static_cast<int>(law) << whole << kept << ' ' << n << ' ' << i;
        }
      }
    }
  }
}

// ---- what they share

TEST(PartLawEdges, WithoutSwitchingNoGainOfItActs) {
  for (const LawKind law : {LawKind::esmc, LawKind::esmc_projected, LawKind::smc}) {
    ControllerConfig<Arm> c = config_of_arm(1e-3);
    c.law = law;
    const Tracking<Arm> t = moving(c.mechanism, angle, rate);
    Gains<Arm> plain = c.gains;
    plain.k.setZero();
    plain.independent.k = 0;
    const auto expected = demand(law, c.mechanism, plain, Reaching::sign, t);
    Arm::Channels acceleration, sliding;
    acceleration.setConstant(1e9);
    part::without_switching(c, t, acceleration, sliding);
    for (int i = 0; i < Arm::channels; ++i) {
      if (!Arm::has_mass(i)) continue;
      EXPECT_NEAR(acceleration[i], expected.acceleration[i], 1e-11) << i;
    }
    EXPECT_GT(acceleration.norm(), 1);
  }
}

TEST(PartLawEdges, APredictedStateIsNotLate) {
  ControllerConfig<Arm> c = config_of_arm(1e-3);
  c.delay_ticks = 3;
  EXPECT_EQ(part::reaching_delay(c), 3);
  c.predict = &part::predictor<Arm>;
  EXPECT_EQ(part::reaching_delay(c), 0);
}

/// A single channel with a gain: the force that takes it to zero at the end of the step, or as much of it as
/// the gain allows.
TEST(ImplicitEdges, OneChannelIsTakenToZeroOrAsFarAsItsGainAllows) {
  const double h = 1e-3, T = (1 + 2 + 0.5) * h;  // with the known delays
  const Equations now(angle, rate);
  for (int row = 0; row < Arm::channels; ++row) {
    if (!Arm::has_mass(row)) continue;
    for (const double share : {0.25, 0.75, 1.5, 8.0}) {
      ControllerConfig<Arm> c = config_of_arm(h);
      c.law = LawKind::esmc;
      c.delay_ticks = 2;
      c.lag_ticks = 0.5;
      const Tracking<Arm> t = moving(c.mechanism, angle, rate);
      Arm::Channels without, acceleration, sliding, one[2];
      part::without_switching(c, t, without, sliding);
      for (int k = 0; k < 2; ++k) one[k] = c.mechanism.channel_rates(t.pose, V::Unit(k));
      const V column(one[0][row], one[1][row]);
      const double needed = sliding[row] / column.dot(now.solve(column));
      c.gains.k.setZero();
      c.gains.k[row] = share * std::abs(needed) / (T * c.mechanism.mass()[row]);
      Memory memory;
      part::implicit_coupled(c, t, memory, acceleration, sliding);
      const V added = now.solve(column) * (needed * std::min(share, 1.0) / T);
      for (int i = 0; i < Arm::channels; ++i) {
        if (!Arm::has_mass(i)) continue;
        const double expected = one[0][i] * added[0] + one[1][i] * added[1];
        EXPECT_NEAR(acceleration[i] - without[i], expected, 1e-8 * (1 + std::abs(expected)))
            << row << ' ' << share;
      }
    }
  }
}

/// Without a solution for all channels together, here for one of them that is no number, each has its clamp.
TEST(ImplicitEdges, WithoutASolutionEachChannelIsClampedByItself) {
  ControllerConfig<Arm> c = config_of_arm(1e-3);
  c.law = LawKind::esmc;
  Tracking<Arm> t = moving(c.mechanism, angle, rate);
  t.desired_rates[1] = std::numeric_limits<double>::quiet_NaN();  // the first bar knows nothing of it
  Arm::Channels without, acceleration, sliding;
  part::without_switching(c, t, without, sliding);
  int finite = 0;
  for (const double layers : {2.0, 0.5}) {  // of the sliding variable
    for (int i = 0; i < Arm::channels; ++i) {
      const bool known = Arm::has_mass(i) && std::isfinite(sliding[i]) && sliding[i] != 0;
      if (!known) continue;
      ++finite;
      c.gains.layer[i] = layers * std::abs(sliding[i]);
      Memory memory;
      Arm::Channels s;
      part::implicit_coupled(c, t, memory, acceleration, s);
      EXPECT_NEAR(acceleration[i] - without[i],
                  c.gains.k[i] * std::copysign(layers > 1 ? 0.5 : 1.0, sliding[i]), 1e-9)
          << i;
    }
  }
  EXPECT_GT(finite, 0);
}

// ---- on five bars

using Five = FiveBar<double>;
Five five_bar(double gravity = g, double outer = 0.2, double rotor = 0) {
  LegParams<double> one{0.1, outer, 0.04, 0.09, 0.1, 0.15, 2e-4, 5e-4, 0.01, 0.02},
      two{0.11, outer - 0.01, 0.05, 0.08, 0.12, 0.14, 3e-4, 4e-4, 0.02, 0.01};
  one.rotor2 = two.rotor2 = rotor;
  return Five({0.05, 0.1, gravity, {{one, two}}});
}
const V base(1.2, 1.9), base_rate(2, -3);

TEST(PartsOnFiveBars, TheMomentumChangesByItsDriftAndTheTorque) {
  const Five m = five_bar();
  const auto momentum = [&m](const Five::Pose& p, const Five::Rates& r) {
    return m.mass().cwiseProduct(m.channel_rates(p, r)).eval();
  };
  const V acceleration(5, 7);
  const auto at = [&](double time, Five::Pose& pose) {
    const V q = base + base_rate * time + acceleration * (time * time / 2);
    if (!m.forward(q, 1, pose)) ADD_FAILURE() << "not closed";
    return m.base_rates(pose, base_rate + acceleration * time);
  };
  Five::Pose pose, other;
  const double step = 1e-5;
  V change(0, 0);
  for (const double sign : {1.0, -1.0}) {
    const Five::Rates r = at(sign * step, other);
    change += m.base_torque(other, momentum(other, r)) * (sign / (2 * step));
  }
  const Five::Rates r = at(0, pose);
  const V torque = m.base_torque(
      pose, m.force(m.channel_accelerations(pose, r, m.base_accelerations(pose, r, acceleration)), r));
  EXPECT_LT((part::drift(m, pose, r, momentum(pose, r)) + torque - change).norm(), 1e-6 * change.norm());
}

TEST(PartsOnFiveBars, TorquesOnTheBaseHaveThePowerOfAllJoints) {
  const Five m = five_bar();
  Five::Pose pose;
  ASSERT_TRUE(m.forward(base, 1, pose));
  const Vec<double, 4> torque(0.5, -0.25, 0.75, 1.5);
  for (int k = 0; k < 2; ++k) {
    const Five::Rates r = m.base_rates(pose, V::Unit(k));
    double power = 0;
    for (int leg = 0; leg < 2; ++leg)
      for (int j = 0; j < 2; ++j) power += torque[2 * leg + j] * r.leg[leg][j];
    EXPECT_NEAR(part::on_base(m, pose, torque)[k], power, 1e-12) << k;
  }
}

/// Elbows that move apart: no mechanism has the predicted angles.
TEST(PartsOnFiveBars, APredictionThatCannotBeClosedIsNone) {
  ControllerConfig<Five> c;
  c.mechanism = five_bar(0, 0.13);
  c.mode = {{1, 1}, 1};
  c.sample_time = 0.05;
  c.delay_ticks = 1;
  Tracking<Five> t{};
  ASSERT_TRUE(c.mechanism.forward(V(0.9, 2.2), 1, t.pose));
  bool some = false, none = false;
  for (int n = 0; n < 160; ++n) {
    const double speed = 1 + n / 4 * 0.5;
    const V away(n % 2 == 0 ? speed : -speed, n % 4 < 2 ? speed : -speed);
    t.rates = c.mechanism.base_rates(t.pose, away);
    Tracking<Five> predicted = t;
    PartMemory<Five> memory;
    part::predictor(c, memory, predicted);
    const bool same =
        predicted.pose.effector == t.pose.effector && Five::base(predicted.rates) == Five::base(t.rates);
    EXPECT_TRUE(same || c.mechanism.closure_residual(predicted.pose).norm() < 1e-9) << speed;
    (same ? none : some) = true;
  }
  EXPECT_TRUE(some && none);
}

/// What changes the speed of rotors at the elbows is taken from the torque on the base joints.
TEST(PartsOnFiveBars, ThePredictorKnowsTheRotorsAtTheElbows) {
  const double h = 1e-3, rotor = 4e-4;
  V after[2];
  Tracking<Five> t{};
  for (const int with : {0, 1}) {
    ControllerConfig<Five> c;
    c.mechanism = five_bar(g, 0.2, with * rotor);
    c.mode = {{1, 1}, 1};
    c.sample_time = h;
    c.delay_ticks = 1;
    ASSERT_TRUE(c.mechanism.forward(base, 1, t.pose));
    t.rates = c.mechanism.base_rates(t.pose, base_rate);
    Tracking<Five> predicted = t;
    PartMemory<Five> memory;
    part::predictor(c, memory, predicted);
    after[with] = Five::base(predicted.rates);
  }
  const Five m = five_bar();
  const V without = (after[0] - base_rate) / h, with = (after[1] - base_rate) / h;
  const Five::Rates elbows = m.base_accelerations(t.pose, t.rates, with);
  V torque(0, 0);  // of the rotors on the base joints
  for (int k = 0; k < 2; ++k) {
    const Five::Rates unit = m.base_rates(t.pose, V::Unit(k));
    for (int leg = 0; leg < 2; ++leg) torque[k] += rotor * elbows.leg[leg][1] * unit.leg[leg][1];
  }
  const V rest = Reduced<Five>(m, t.pose).times(without - with);
  EXPECT_GT(torque.norm(), 1e-3);
  EXPECT_LT((rest - torque).norm(), 1e-9);
}

/// The first channel is the effector's x: with a gain for it alone, it is taken to zero.
TEST(PartsOnFiveBars, TheCoupledStepKnowsTheEffector) {
  ControllerConfig<Five> c;
  c.mechanism = five_bar();
  c.mode = {{1, 1}, 1};
  c.law = LawKind::esmc;
  c.sample_time = 1e-3;
  c.gains.lambda.setConstant(20);
  c.gains.layer.setConstant(1);
  for (const double share : {0.5, 2.0}) {
    Tracking<Five> t{};
    ASSERT_TRUE(c.mechanism.forward(base, 1, t.pose));
    ASSERT_TRUE(c.mechanism.forward(base + V(0.1, -0.05), 1, t.desired_pose));
    t.rates = c.mechanism.base_rates(t.pose, base_rate);
    t.desired_rates = c.mechanism.base_rates(t.desired_pose, V(1, 1));
    t.desired_acceleration = c.mechanism.base_accelerations(t.desired_pose, t.desired_rates, V(0, 0));
    Five::Channels without, acceleration, sliding;
    part::without_switching(c, t, without, sliding);
    const V column(c.mechanism.base_rates(t.pose, V::Unit(0)).platform[0],
                   c.mechanism.base_rates(t.pose, V::Unit(1)).platform[0]);
    const V answer = Reduced<Five>(c.mechanism, t.pose).solve(column);
    const double needed = sliding[0] / column.dot(answer);
    c.gains.k.setZero();
    c.gains.k[0] = share * std::abs(needed) / (c.sample_time * c.mechanism.mass()[0]);
    PartMemory<Five> memory;
    part::implicit_coupled(c, t, memory, acceleration, sliding);
    const double expected = column.dot(answer) * needed * std::min(share, 1.0) / c.sample_time;
    EXPECT_NEAR(acceleration[0] - without[0], expected, 1e-8 * (1 + std::abs(expected))) << share;
  }
}

// ---- four encoders

/// Legs on the line through their bases, away from each other. All lengths are exact in binary.
struct Stretched {
  std::array<double, 4> bar;
  [[nodiscard]] int odd_encoder(double allowed) const {
    ControllerConfig<Five> c;
    c.mechanism = Five({0.25, 0, 0, {{{bar[0], bar[1]}, {bar[2], bar[3]}}}});
    c.limits.closure = allowed;
    const Vec<double, 4> zero = Vec<double, 4>::Zero();
    Estimate<Five> e;
    const int joint = part::closure_projection(c, zero, zero, e);
    EXPECT_EQ(e.closure, 0.5 + bar[0] + bar[1] + bar[2] + bar[3]);
    return joint;
  }
};

/// The first joint alone closes it to 1/16; the third one, to 15/16, comes the nearest after it.
TEST(FusionEdges, WhoClosesToAQuarterIsBlamedIfAllOthersLeaveMoreThanHalf) {
  const Stretched s{{1.0, 1.0, 0.5, 1.0625}};
  EXPECT_EQ(s.odd_encoder(0.24), 0) << "not close enough";
  EXPECT_EQ(s.odd_encoder(0.25), 1) << "just a quarter";
  EXPECT_EQ(s.odd_encoder(1.874), 1);
  EXPECT_EQ(s.odd_encoder(1.875), 0) << "just half";
}

TEST(FusionEdges, AnAllowedGapNamesNoEncoder) {
  const Stretched s{{0.75, 0.25, 0.125, 0.125}};
  EXPECT_EQ(s.odd_encoder(1.74), 1);
  EXPECT_EQ(s.odd_encoder(1.75), 0) << "just the limit";
}

Vec<double, 4> angles_of(const Five::Pose& p) {
  Vec<double, 4> out;
  for (int j = 0; j < 2; ++j) {
    const V inner = p.leg[j].axis[0], outer = p.leg[j].axis[1];
    out[2 * j] = std::atan2(inner[1], inner[0]);
    out[2 * j + 1] = std::atan2(outer[1], outer[0]) - out[2 * j];
  }
  return out;
}

/// That is far below the step of an encoder: a third one would cost its time for nothing.
TEST(FusionEdges, TwoStepsCloseFiveMillimetresToLessThanAMicrometre) {
  ControllerConfig<Five> c;
  c.mechanism = five_bar();
  c.limits.closure = 0.01;
  Five::Pose p;
  ASSERT_TRUE(c.mechanism.forward(base, 1, p));
  const Vec<double, 4> readings = angles_of(p) + Vec<double, 4>(0.016, -0.032, 0.024, 0.032);
  Estimate<Five> e;
  EXPECT_EQ(part::closure_projection(c, readings, Vec<double, 4>::Zero().eval(), e), 0);
  EXPECT_NEAR(e.closure, 5e-3, 5e-4);
  const double left = c.mechanism.closure_residual(e.pose).norm();
  EXPECT_LT(left, 1e-6);
  EXPECT_GT(left, 1e-9);
}

/// To first order. What lies in memory behind the variances plays no part.
TEST(FusionEdges, TheTurnsOfFourJointsCloseTheGap) {
  const Five m = five_bar();
  Five::Pose p;
  ASSERT_TRUE(m.forward(base, 1, p));
  const struct {
    Vec<double, 4> variance{1.0, 2.0, 0.5, 1.5};
    double behind = std::numeric_limits<double>::quiet_NaN();
  } memory;
  const part::Closure<double> closure(m, p, memory.variance);
  const V gap(3e-3, -2e-3);
  EXPECT_LT((closure.rate(closure.correction(gap)) + gap).norm(), 1e-15);
  for (int i = 0; i < 4; ++i) {
    const Vec<double, 4> turn = Vec<double, 4>::Unit(i), angles = angles_of(p);
    const V change =
        m.closure_residual(m.pose(angles + 1e-6 * turn)) - m.closure_residual(m.pose(angles - 1e-6 * turn));
    EXPECT_LT((closure.rate(turn) - change / 2e-6).norm(), 1e-9) << i;
  }
}

}  // namespace
