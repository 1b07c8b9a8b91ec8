// The optional parts of the controller, each against something that was not written with it: the two reaching
// laws against the oracle's C and M in all modes, observer and predictor against the simulator's plant, all
// of them in the closed loop.

#include <gtest/gtest.h>

#include "host_sim/plant/kinematics.hpp"
#include "tests/support/control_loop.hpp"
#include "tests/support/tracking.hpp"

namespace esmc::test {
namespace {

using M5 = FiveBar<double>;

template <class S>
ControllerConfig<FiveBar<S>> config_of(const TrackingCase<S>& c, LawKind law) {
  ControllerConfig<FiveBar<S>> out;
  out.mechanism = c.mechanism;
  out.law = law;
  out.gains = c.gain;
  out.sample_time = S(1e-3);
  for (int i = 0; i < 18; ++i) out.gains.layer[i] = implicit_layer(out.gains.k[i], S(1e-3), S(0));
  return out;
}

template <class S>
class Parts : public testing::Test {};
TYPED_TEST_SUITE(Parts, Scalars, ScalarName);

/// First tick: v' less the law without switching is C w, w from sigma = (C^T M C)^-1 C^T M s of the oracle
/// and the quadratic, solved here by bisection.
TYPED_TEST(Parts, SuperTwistingActsOnWhatTheChannelsHaveInCommon) {
  using S = TypeParam;
  Accuracy error("acceleration");
  for (std::uint64_t seed = 0; seed < 200; ++seed) {
    const auto c = random_tracking<S>(seed);
    for (const LawKind law : {LawKind::esmc, LawKind::esmc_projected, LawKind::smc}) {
      const auto config = config_of(c, law);
      PartMemory<FiveBar<S>> memory;
      memory.reset();
      typename FiveBar<S>::Channels acceleration, sliding;
      part::super_twisting(config, c.t, memory, acceleration, sliding);
      auto plain = config.gains;
      plain.k.setZero();
      plain.independent.k = S(0);
      const auto without = demand(law, c.mechanism, plain, Reaching::saturation, c.t);
      const auto C = c.now.C();
      Vec<Real, 2> sigma = c.sigma();
      if (law == LawKind::esmc) {
        const Mat<Real, 2, 2> H = c.H();
        const Vec<Real, 2> p = C.transpose() * c.now.mass().cwiseProduct(c.sliding());
        const Real det = H(0, 0) * H(1, 1) - H(0, 1) * H(1, 0);
        sigma = {(H(1, 1) * p[0] - H(0, 1) * p[1]) / det, (H(0, 0) * p[1] - H(1, 0) * p[0]) / det};
      }
      Vec<Real, 2> w;
      const Real h = Real(config.sample_time), L = Real(config.gains.independent.k), k1 = 1.5L * std::sqrt(L),
                 k2 = 1.1L * L;
      for (int i = 0; i < 2; ++i) {
        Real low = 0, high = std::fabs(sigma[i]);
        for (int n = 0; n < 200; ++n) {
          const Real x = (low + high) / 2;
          (x + h * k1 * std::sqrt(x) + h * h * k2 > std::fabs(sigma[i]) ? high : low) = x;
        }
        w[i] = (sigma[i] - std::copysign(low, sigma[i])) / h;
      }
      Channels18 got = (acceleration - without.acceleration).template cast<Real>(), want = C * w;
      for (int i = 0; i < 18; ++i)
        if (!FiveBar<S>::has_mass(i)) got[i] = want[i] = 0;  // the pass of a tick leaves these rows out
      // sigma / h: what sigma loses in cancellation is magnified by the root near zero.
      error.compare(seed, got, want,
                    Real(without.acceleration.cwiseAbs().maxCoeff()) + want.cwiseAbs().maxCoeff());
    }
  }
  error.expect_below(4e4L * kEpsilon<S>);
}

/// The force of the coupled step is C^T M K sw with every sw_i in Sgn s_i+, s+ = s + C q: complementarity,
/// from the oracle.
TYPED_TEST(Parts, CoupledStepIsTheComplementarityProblem) {
  using S = TypeParam;
  int bound = 0;
  for (std::uint64_t seed = 0; seed < 200; ++seed) {
    const auto c = random_tracking<S>(seed);
    auto config = config_of(c, LawKind::esmc);
    const S T = config.sample_time;
    PartMemory<FiveBar<S>> memory;
    typename FiveBar<S>::Channels acceleration, sliding;
    Random r(seed);
    const Channels18 sliding_now = c.sliding();
    for (int i = 0; i < 18; ++i) {  // some channels inside their layers, some far outside
      config.gains.k[i] =
          static_cast<S>(std::fabs(sliding_now[i]) / Real(T) * std::pow(10.0L, r.between(-1.5, 1)));
    }
    part::implicit_coupled(config, c.t, memory, acceleration, sliding);
    auto plain = config.gains;
    plain.k.setZero();
    const auto without = demand(LawKind::esmc, c.mechanism, plain, Reaching::saturation, c.t);
    const Channels18 s = c.sliding(), mass = c.now.mass(), gain = config.gains.k.template cast<Real>();
    const Channels18 added = (acceleration - without.acceleration).template cast<Real>();
    const Channels18 after = s - Real(T) * added;  // s+ of the model, for what is added is -C q / T
    const auto C = c.now.C();
    // F less what the channels away from zero give must come from those at zero: it is in their zonotope,
    // seen from every direction.
    Vec<Real, 2> rest = C.transpose() * mass.cwiseProduct(added);
    Real size = 0;
    std::vector<Vec<Real, 2>> held;
    for (int i = 0; i < 18; ++i) {
      const Vec<Real, 2> force = C.row(i).transpose() * (mass[i] * gain[i]);
      size += force.norm();
      if (std::fabs(after[i]) > 1e3L * kEpsilon<S> * (std::fabs(s[i]) + Real(T) * gain[i])) {
        rest -= after[i] > 0 ? force : Vec<Real, 2>(-force);
        ++bound;
      } else {
        held.push_back(force);
      }
    }
    for (int a = 0; a < 360; ++a) {
      const Vec<Real, 2> u(std::cos(a * std::numbers::pi_v<Real> / 180),
                           std::sin(a * std::numbers::pi_v<Real> / 180));
      Real reach = 0;
      for (const auto& force : held) reach += std::fabs(force.dot(u));
      ASSERT_LE(rest.dot(u), reach + 2e4L * kEpsilon<S> * size) << "seed " << seed << " angle " << a;
    }
  }
  EXPECT_GT(bound, 200);
}

// ---- on the plant

struct Score {
  double rms = 0.0, chatter = 0.0;
  bool fine = true;
};
Score follow(const LoopSetup& s, int ticks = 800, int from = 400) {
  ControlLoop loop(s);
  Score out;
  Vec<double, 4> last = Vec<double, 4>::Zero();
  double square = 0.0;
  for (int n = 0; n < ticks; ++n) {
    const Vec2<double> at = loop.effector();
    const double phase = s.speed * s.tick * n;
    const Vec2<double> miss =
        at - Vec2<double>(s.radius * std::cos(phase), 0.17 + s.radius * std::sin(phase));
    const auto& r = loop.tick();
    out.fine = out.fine && r.fault == Fault::none;
    if (n >= from) {
      square += dot(miss, miss);
      out.chatter += (r.torque - last).cwiseAbs().sum() / (ticks - from);
    }
    last = r.torque;
  }
  out.rms = std::sqrt(square / (ticks - from));
  return out;
}
LoopSetup heavier(LawKind law) {
  LoopSetup s;
  s.law = law;
  s.believed = scaled_bars(s.truth, 1.0 / 1.2);
  return s;
}
using Config = ControllerConfig<M5>;

TEST(PartsOnThePlant, SuperTwistingLeavesAThirtiethOfTheClampsErrorAndNoMoreChatter) {
  for (const LawKind law : {LawKind::esmc, LawKind::esmc_projected, LawKind::smc}) {
    LoopSetup s = heavier(law);
    const Score clamp = follow(s);
    s.adjust = [](Config& c) { c.reach = &part::super_twisting<M5>; };
    const Score twist = follow(s);
    EXPECT_TRUE(clamp.fine && twist.fine);
    EXPECT_LT(twist.rms, clamp.rms / 30) << int(law);
    EXPECT_LT(twist.chatter, 1.02 * clamp.chatter) << int(law);
  }
}

TEST(PartsOnThePlant, FourMotorsAndSaturationAreKnownToTheIntegral) {
  LoopSetup s = heavier(LawKind::esmc);
  s.motors = Motors::all;
  s.adjust = [](Config& c) { c.reach = &part::super_twisting<M5>; };
  EXPECT_LT(follow(s).rms, 2e-5);
  s.motors = Motors::base;
  s.torque_limit = 0.7;  // saturates on the way onto the circle
  const Score clipped = follow(s);
  EXPECT_TRUE(clipped.fine);
  EXPECT_LT(clipped.rms, 2e-5);
}

TEST(PartsOnThePlant, CoupledStepFollowsAsWellAsTheClamp) {
  for (const LawKind law : {LawKind::esmc, LawKind::esmc_projected}) {
    LoopSetup s = heavier(law);
    const Score clamp = follow(s);
    s.adjust = [](Config& c) { c.reach = &part::implicit_coupled<M5>; };
    const Score coupled = follow(s);
    EXPECT_TRUE(coupled.fine);
    EXPECT_NEAR(coupled.rms, clamp.rms, 0.05 * clamp.rms);
    EXPECT_LT(coupled.chatter, 1.02 * clamp.chatter);
  }
}

TEST(PartsOnThePlant, ObserverTakesATenthAndThePredictorBridgesTheDelay) {
  LoopSetup s = heavier(LawKind::esmc);
  const double plain = follow(s).rms;
  s.adjust = [](Config& c) {
    c.observer = &part::momentum_observer<M5>;
    c.observer_bandwidth = 100.0;
  };
  EXPECT_LT(follow(s).rms, plain / 8);

  // A delay of 2 ms, an exact model and lambda = 300: the law that bears it rings, the one that has it
  // bridged does not.
  LoopSetup late;
  late.lambda = 300.0;
  late.effects = {host::ComputeDelay{0.002}};
  late.told_delay = 2.0;
  const Score borne = follow(late);
  late.told_delay = 0.0;
  late.adjust = [](Config& c) {
    c.delay_ticks = 2.0;
    c.predict = &part::predictor<M5>;
  };
  const Score bridged = follow(late);
  EXPECT_TRUE(bridged.fine);
  EXPECT_LT(bridged.rms, borne.rms / 5);
  EXPECT_LT(bridged.chatter, borne.chatter / 5);
}

/// Given torques that were not sent: what the cables add on one base joint is what the observer finds there,
/// to its sign.
TEST(PartsOnThePlant, ObserverFindsTheTorqueThatIsThere) {
  LoopSetup s;
  const Vec2<double> extra(0.11, -0.07);
  s.wiring = [&](Vec<double, 4>& tau) {
    tau[0] += extra[0];
    tau[2] += extra[1];
  };
  ControlLoop loop(s);
  Config config = controller_of(s);
  config.observer_bandwidth = 200.0;
  PartMemory<M5> memory;
  memory.reset();
  for (int n = 0; n < 600; ++n) {
    const auto& r = loop.tick();
    Tracking<M5> t;
    const Vec2<double> angle(loop.sample().angle[0], loop.sample().angle[2]),
        rate(loop.sample().rate[0], loop.sample().rate[2]);
    ASSERT_TRUE(estimate_from_base(config.mechanism, config.mode, angle, rate, t.pose, t.rates));
    part::momentum_observer(config, t, memory);
    memory.keep(r.torque, true);
    if (n < 60) continue;
    EXPECT_NEAR(memory.disturbance[0], extra[0], 2e-4) << n;
    EXPECT_NEAR(memory.disturbance[1], extra[1], 2e-4) << n;
  }
}

/// The state of the plant d ticks on, from the state now and the torques sent.
TEST(PartsOnThePlant, PredictorSaysWhereThePlantWillBe) {
  for (int delay = 1; delay <= 4; ++delay) {
    LoopSetup s;
    s.effects = {host::ComputeDelay{delay * 1e-3}};
    s.told_delay = delay;
    ControlLoop loop(s);
    Config config = controller_of(s);
    config.delay_ticks = delay;
    PartMemory<M5> memory;
    memory.reset();
    std::vector<Vec<double, 4>> predicted;  // base angles, base rates
    std::vector<Vec2<double>> held;         // rates when that was said
    double worst_angle = 0.0, worst_rate = 0.0, worst_without = 0.0;
    for (int n = 0; n < 300; ++n) {
      const auto& r = loop.tick();
      Tracking<M5> t;
      const Vec2<double> angle(loop.sample().angle[0], loop.sample().angle[2]),
          rate(loop.sample().rate[0], loop.sample().rate[2]);
      ASSERT_TRUE(estimate_from_base(config.mechanism, config.mode, angle, rate, t.pose, t.rates));
      if (n >= 100 + delay) {
        const auto& then = predicted[static_cast<std::size_t>(n - delay)];
        for (int i = 0; i < 2; ++i) {
          worst_angle = std::max(worst_angle, std::abs(wrap_to_pi(angle[i] - then[i])));
          worst_rate = std::max(worst_rate, std::abs(rate[i] - then[2 + i]));
          worst_without =
              std::max(worst_without, std::abs(rate[i] - held[static_cast<std::size_t>(n - delay)][i]));
        }
      }
      held.push_back(rate);
      part::predictor(config, memory, t);
      const Vec2<double> a = M5::base_angles(t.pose), b = M5::base(t.rates);
      predicted.emplace_back(a[0], a[1], b[0], b[1]);
      memory.keep(r.torque, true);
    }
    EXPECT_LT(worst_angle, 2e-6 * delay * delay) << delay;
    EXPECT_LT(worst_rate, worst_without / 30) << delay;
  }
}

/// Disabled and enabled again a controller with parts does what a new one does; a NaN is a fault and no
/// torque.
TEST(PartsInTheController, ForgetAndFault) {
  LoopSetup s;
  s.adjust = [](Config& c) {
    c.reach = &part::super_twisting<M5>;
    c.observer = &part::momentum_observer<M5>;
    c.observer_bandwidth = 100.0;
    c.delay_ticks = 2.0;
    c.predict = &part::predictor<M5>;
  };
  Controller<M5> controller(controller_of(s));
  const auto theta = ControlLoop::start_angles(s);
  Sample<M5> sample;
  for (int i = 0; i < 4; ++i) sample.angle[i] = theta[static_cast<std::size_t>(i)];
  std::vector<Vec<double, 4>> first;
  for (const bool again : {false, true}) {
    Supervisor supervisor(controller.supervision());
    supervisor.begin_tick(Command::enable, {});
    (void)controller.tick(sample, supervisor);
    for (int n = 0; n < 20; ++n) {
      supervisor.begin_tick(Command::none, {true, false});
      const auto r = controller.tick(sample, supervisor);
      ASSERT_EQ(r.state, State::running);
      if (again) {
        EXPECT_EQ(r.torque, first[static_cast<std::size_t>(n)]) << n;
      } else {
        first.push_back(r.torque);
      }
    }
    supervisor.begin_tick(Command::none, {true, false});
    Sample<M5> bad = sample;
    bad.rate[2] = std::numeric_limits<double>::quiet_NaN();
    const auto r = controller.tick(bad, supervisor);
    EXPECT_EQ(r.fault, Fault::feedback_not_finite);
    EXPECT_EQ(r.torque, (Vec<double, 4>::Zero().eval()));
  }
}

/// A NaN in the state comes out of every part, so that the check of the torque finds it.
TEST(PartsInTheController, NanComesOutAgain) {
  const auto c = random_tracking<double>(5);
  for (const LawKind law : {LawKind::esmc, LawKind::esmc_projected}) {
    auto config = config_of(c, law);
    config.observer_bandwidth = 100.0;
    config.delay_ticks = 1.0;
    config.mode = c.now.mode;
    config.torque_limit.setConstant(2.0);
    auto t = c.t;
    t.rates.platform[0] = t.rates.leg[0][0] = std::numeric_limits<double>::quiet_NaN();
    PartMemory<M5> memory;
    memory.reset();
    memory.keep(Vec<double, 4>::Zero(), true);
    M5::Channels acceleration, sliding;
    const auto broken = [&] {
      const Vec2<double> tau =
          config.mechanism.base_torque(c.t.pose, config.mechanism.force(acceleration, t.rates));
      return std::isnan(tau[0]) || std::isnan(tau[1]);
    };
    part::super_twisting(config, t, memory, acceleration, sliding);
    EXPECT_TRUE(broken());
    part::implicit_coupled(config, t, memory, acceleration, sliding);
    EXPECT_TRUE(broken());
    part::momentum_observer(config, t, memory);
    EXPECT_TRUE(std::isnan(memory.disturbance[0]));
    memory.disturbance.setZero();
    part::predictor(config, memory, t);
    EXPECT_TRUE(std::isnan(M5::base(t.rates)[0]));
  }
}

}  // namespace
}  // namespace esmc::test
