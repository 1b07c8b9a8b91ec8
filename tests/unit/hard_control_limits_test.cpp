/// What the loop does at its limits: saturated motors, type 2, the wrong assembly mode.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/support/control_loop.hpp"

namespace esmc::test {
namespace {

constexpr std::array all_laws{LawKind::esmc, LawKind::esmc_projected, LawKind::smc, LawKind::ctc};

/// B7 with the gains of one loop for all laws: computed torque gets kappa = 1 / h of the implicit law [F28].
LoopSetup b7(LawKind law) { return {.law = law, .kp = 40.0 * 1000.0, .kd = 40.0 + 1000.0}; }

double distance(const TickResult<FiveBar<double>>& r, const Vec2<double>& at) {
  return (r.desired_effector - at).norm();
}

// ---- 7: saturation

/// What the circle itself needs, N m: the largest torque once it is followed.
double circle_torque() {
  ControlLoop loop(b7(LawKind::smc));
  double need = 0.0;
  for (int n = 0; n < 1500; ++n) {
    const double now = loop.tick().torque.cwiseAbs().maxCoeff();
    if (n >= 500) need = std::max(need, now);
  }
  return need;
}

struct Recovery {
  int saturated = 0;       ///< ticks
  double rate = 0.0;       ///< of the decay after the last of them, 1/s
  double overshoot = 0.0;  ///< farthest past the reference, seen from where saturation ended, m
  double final = 0.0;      ///< distance in the last round, m
};

Recovery recover(const LoopSetup& s) {
  ControlLoop loop(s);
  std::vector<Vec2<double>> error;
  int last = 0;
  Recovery out;
  constexpr int end = 2500, round = 628;
  for (int n = 0; n < end; ++n) {
    const Vec2<double> at = loop.effector();
    const auto& r = loop.tick();
    EXPECT_EQ(r.state, State::running) << "tick " << n << ": " << name(r.fault);
    error.emplace_back(r.desired_effector - at);
    if (!r.saturated) continue;
    last = n;
    ++out.saturated;
  }
  // From ten ticks after saturation, when s has met its band, over one and a half time constants.
  const auto from = static_cast<std::size_t>(last + 10), to = from + 40;
  out.rate = std::log(error[from].norm() / error[to].norm()) / (40 * s.tick);
  const Vec2<double> way = error[from].normalized();
  for (std::size_t n = from; n < error.size(); ++n)
    out.overshoot = std::max(out.overshoot, -error[n].dot(way));
  for (std::size_t n = end - round; n < end; ++n) out.final = std::max(out.final, error[n].norm());
  return out;
}

/// No law has an integrator, so saturation must leave no trace: once it is over, s is inside its band (h K =
/// 0.15 m/s) and gone a tick later, having moved the error by less than 2 h (h K); from there e falls at
/// lambda.
TEST(Saturation, IsLeftAtRateLambdaWithoutOvershoot) {
  const double need = circle_torque();
  EXPECT_GT(need, 0.1);
  for (const LawKind law : all_laws) {
    LoopSetup s = b7(law);
    s.torque_limit = 100.0;
    const double unsaturated = recover(s).final;
    for (const double factor : {1.2, 2.0}) {
      s.torque_limit = factor * need;
      for (const host::V2 start : {host::V2{0.07, 0.17}, host::V2{0.0, 0.17}, host::V2{-0.03, 0.13}}) {
        s.start = start;
        SCOPED_TRACE("law " + std::to_string(int(law)) + ", limit x " + std::to_string(factor) + ", from x " +
                     std::to_string(start.x));
        const Recovery r = recover(s);
        EXPECT_GT(r.saturated, 20);
        EXPECT_NEAR(r.rate, s.lambda, 0.1 * s.lambda);
        EXPECT_LT(r.overshoot, 2.0 * s.tick * (s.tick * s.gain));
        EXPECT_NEAR(r.final, unsaturated, 0.01 * unsaturated);
      }
    }
  }
}

/// Nothing is remembered: after hundreds of saturated ticks the controller answers a sample as a new one
/// does.
TEST(Saturation, LeavesNoStateInTheController) {
  for (const LawKind law : all_laws) {
    LoopSetup s = b7(law);
    s.hold = host::V2{0.02, 0.2};
    s.start = host::V2{-0.04, 0.16};
    LoopSetup still = s;
    still.start.reset();
    s.torque_limit =
        2.0 * ControlLoop(still).tick().torque.cwiseAbs().maxCoeff();  // twice what holds it there
    ControlLoop loop(s);
    int saturated = 0;
    double off = 0.0;
    for (int n = 0; n < 1500; ++n) {
      const Vec2<double> at = loop.effector();
      const auto& r = loop.tick();
      saturated += r.saturated ? 1 : 0;
      off = distance(r, at);
      if (n % 50 != 0) continue;
      Controller<FiveBar<double>> fresh(controller_of(s));
      Supervisor supervisor;
      supervisor.begin_tick(Command::enable, {});
      supervisor.begin_tick(Command::none, {true, false});
      EXPECT_EQ(fresh.tick(loop.sample(), supervisor).torque, r.torque)
          << "law " << int(law) << ", tick " << n;
    }
    EXPECT_GT(saturated, 50);
    EXPECT_LT(off, 1e-9) << "law " << int(law);
  }
}

// ---- 8: type 2 and assembly modes

/// Straight down from (0, 0.17). With both elbows out the distal bars are in line at y = sqrt(0.12^2 -
/// 0.11^2): their elbows then lie 2 x 0.16 apart, 0.11 beyond the base joints.
const double level = std::sqrt(0.12 * 0.12 - 0.11 * 0.11);  // 0.048 m

struct Descent {
  std::vector<PathSegment<double>> path;
  LoopSetup setup;
  Descent(LawKind law, double seconds, Sensors sensors, Motors motors) : setup(b7(law)) {
    path.push_back(
        {0, 0.0,
         Quintic<double>::between({{0.0, 0.17}, {0, 0}, {0, 0}}, {{0.0, 0.03}, {0, 0}, {0, 0}}, seconds)});
    setup.reference = Reference<double>{.kind = ReferenceKind::path, .path = path};
    setup.start = host::V2{0.0, 0.17};
    setup.sensors = sensors;
    setup.motors = motors;
  }
};

double type2_sine(const ControlLoop& loop) {
  const auto q = loop.truth().q;
  return host::type2_sine({q[2], q[3], q[4], q[5]});
}

/// With two motors: named in the first tick that is too near, while the torque (it grows as 1 / D2) is still
/// within its limit, and nothing is asked of the motors from then on.
TEST(Type2, IsNamedBeforeTheTorqueMeetsItsLimit) {
  for (const LawKind law : all_laws) {
    for (const double seconds : {0.3, 1.0, 3.0}) {
      for (const Sensors sensors : {Sensors::base, Sensors::all}) {
        SCOPED_TRACE("law " + std::to_string(int(law)) + ", " + std::to_string(seconds) + " s");
        const Descent d(law, seconds, sensors, Motors::base);
        ControlLoop loop(d.setup);
        bool faulted = false;
        for (int n = 0; n < 1000.0 * seconds; ++n) {
          const double near = std::abs(type2_sine(loop));
          const auto& r = loop.tick();
          if (!faulted) {
            EXPECT_FALSE(r.saturated) << "tick " << n << ", D2 " << near;
            EXPECT_EQ(r.fault == Fault::type2_singularity, near < d.setup.min_type2) << "tick " << n;
            faulted = r.fault != Fault::none;
          }
          if (faulted) {
            EXPECT_EQ(r.fault, Fault::type2_singularity);
            EXPECT_EQ(r.torque, (Vec<double, 4>::Zero().eval()));
          }
        }
        EXPECT_TRUE(faulted);
      }
    }
  }
}

/// With four motors and four encoders type 2 is a pose like any other: through it, followed, with ordinary
/// torques.
TEST(Type2, IsCrossedWithFourMotors) {
  for (const LawKind law : all_laws) {
    const Descent d(law, 0.5, Sensors::all, Motors::all);
    ControlLoop loop(d.setup);
    double worst = 0.0, torque = 0.0;
    for (int n = 0; n < 1000; ++n) {
      const Vec2<double> at = loop.effector();
      const auto& r = loop.tick();
      EXPECT_EQ(r.state, State::running) << name(r.fault);
      worst = std::max(worst, distance(r, at));
      torque = std::max(torque, r.torque.cwiseAbs().maxCoeff());
    }
    EXPECT_GT(type2_sine(loop), 0.2) << "it never crossed";
    EXPECT_LT(worst, 2e-5) << int(law);
    EXPECT_LT(torque, 1.0);  // 0.4 kg, 9.8 m/s2, 0.16 m, and some for the motion
  }
}

/// At type 2 two motors have no torque to answer with, and base encoders no pose: refused, not guessed.
TEST(Type2, IsRefusedAtTheStart) {
  for (const Sensors sensors : {Sensors::base, Sensors::all}) {
    for (const double offset : {0.0, 1e-12, 1e-6, 1e-4}) {
      LoopSetup s = b7(LawKind::esmc);
      s.hold = host::V2{0.0, level + offset};
      s.sensors = sensors;
      ControlLoop loop(s);
      for (int n = 0; n < 3; ++n) EXPECT_EQ(loop.tick().torque, (Vec<double, 4>::Zero().eval()));
      const Fault f = loop.supervisor().fault();
      EXPECT_TRUE(f == Fault::type2_singularity || (sensors == Sensors::base && f == Fault::loop_not_closed))
          << name(f) << " at " << offset;
    }
  }
}

/// The same base angles, the mechanism assembled the other way: passive encoders show it. Before it was
/// guarded, the full law ran here without a fault and came to rest 17 cm off: its eighteen errors balance on
/// that side.
TEST(AssemblyMode, TheOtherOneIsNoticedByPassiveEncoders) {
  for (const LawKind law : all_laws) {
    for (const host::V2 at :
         {host::V2{0.02, 0.17}, host::V2{-0.03, 0.15}, host::V2{0.0, 0.1}, host::V2{0.0, 0.2}}) {
      LoopSetup s = b7(law);
      s.hold = at;
      s.sensors = Sensors::all;
      const auto q = ControlLoop::start_angles(s);
      const auto other = host::close(s.truth, {q[0], q[2]}, 1);
      ASSERT_TRUE(other);
      ControlLoop loop(s, *other);
      for (int n = 0; n < 5; ++n) {
        const auto& r = loop.tick();
        EXPECT_EQ(r.fault, Fault::type2_singularity) << "law " << int(law) << ": " << name(r.fault);
        EXPECT_EQ(r.torque, (Vec<double, 4>::Zero().eval()));
      }
    }
  }
}

/// A zone of type 2 so thin that the mechanism is on one side in one tick and on the other in the next: not
/// jumped.
TEST(AssemblyMode, AThinZoneIsNotJumped) {
  for (const LawKind law : all_laws) {
    Descent d(law, 0.3, Sensors::all, Motors::base);
    d.setup.min_type2 = 1e-5;
    ControlLoop loop(d.setup);
    bool crossed = false;
    for (int n = 0; n < 600 && !crossed; ++n) {
      crossed = type2_sine(loop) > 0.0;
      const auto& r = loop.tick();
      EXPECT_EQ(r.state == State::running, !crossed)
          << "law " << int(law) << ", tick " << n << ' ' << name(r.fault);
    }
    EXPECT_TRUE(crossed);
    EXPECT_EQ(loop.supervisor().fault(), Fault::type2_singularity);
  }
}

}  // namespace
}  // namespace esmc::test
