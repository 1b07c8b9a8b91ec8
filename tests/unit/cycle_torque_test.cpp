/// The torque that leaves the cycle is the one the law functions give for the state that the frames describe.
/// The path from frames to state and from law to frames is written again here.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <string>

#include "firmware/control/allocation.hpp"
#include "firmware/control/law.hpp"
#include "tests/support/cycle_rig.hpp"

namespace {

using namespace esmc;
using test::Rig;
using test::Setup;
using test::setup;

using Five = FiveBar<double>;
using Arm = Rr<float>;

/// What an encoder frame of the rig says about its joint, after the float of the frame.
struct Said {
  double angle, rate;
};
template <class M>
Said said(const Rig<M>& rig, std::size_t axis) {
  const auto& m = test::mountings[axis];
  const double per_turn = m.direction * m.gear / test::turn;
  const std::size_t joint = rig.joint_of(axis);
  return {
      static_cast<double>(static_cast<float>((rig.angle[joint] - m.offset) * per_turn)) / per_turn + m.offset,
      static_cast<double>(static_cast<float>(rig.rate[joint] * per_turn)) / per_turn};
}

/// Law and allocation for a tracking state; all motors of the mechanism, zero where there is none.
template <class M>
Vec<typename M::Scalar, M::joints> by_law(const ControllerConfig<M>& c, const Tracking<M>& t) {
  using S = typename M::Scalar;
  Vec<S, M::joints> torque = Vec<S, M::joints>::Zero();
  Vec2<S> base;
  if (c.law == LawKind::pd) {
    base = torque_pd<M>(c.gains, t);
  } else {
    const Demand<M> d = demand(c.law, c.mechanism, c.gains, c.reaching, t);
    const typename M::Channels w = c.mechanism.force(d.acceleration, t.rates);
    if constexpr (M::joints == 4) {
      if (c.motors == Motors::all) return allocate_all(c.mechanism, t.pose, w, c.torque_weight);
    }
    base = c.mechanism.base_torque(t.pose, w);
  }
  torque[0] = base[0];
  torque[M::joints / 2] = base[1];
  return torque;
}

/// The tracking state of a tick: measured state as in the last sample of the cycle, reference at `tick`.
Tracking<Five> tracking(const ControllerConfig<Five>& c, const Sample<Five>& s, std::uint32_t tick) {
  const Five& m = c.mechanism;
  Tracking<Five> t{};
  const double dt = c.sample_time;
  Vec<double, 4> q = s.angle;
  for (int i = 0; i < 4; ++i) q[i] += s.rate[i] * (s.age_ticks[static_cast<unsigned>(i)] * dt);
  if (c.sensors == Sensors::base) {
    t.pose = *m.forward({q[0], q[2]}, c.mode.assembly);
    t.rates = m.base_rates(t.pose, {s.rate[0], s.rate[2]});
  } else {
    t.pose = m.pose(q);
    t.rates.leg[0] = {s.rate[0], s.rate[1]};
    t.rates.leg[1] = {s.rate[2], s.rate[3]};
    const auto v1 = m.frame(0).from_leg(m.leg(0).tip_rate(t.pose.leg[0], t.rates.leg[0]));
    const auto v2 = m.frame(1).from_leg(m.leg(1).tip_rate(t.pose.leg[1], t.rates.leg[1]));
    t.rates.platform = Vec2<double>(v1 * 0.5 + v2 * 0.5);
  }
  const Motion2<double> d = c.reference.at(tick, dt);
  t.desired_pose = *m.inverse(d.position, c.mode);
  t.desired_rates = m.rates_of_effector(t.desired_pose, d.velocity);
  t.desired_acceleration = m.accelerations_of_effector(t.desired_pose, t.desired_rates, d.acceleration);
  return t;
}
Tracking<Arm> tracking(const ControllerConfig<Arm>& c, const Sample<Arm>& s, std::uint32_t tick) {
  Tracking<Arm> t{};
  Vec2<float> q = s.angle;
  for (int i = 0; i < 2; ++i) {
    q[i] += s.rate[i] * (static_cast<float>(s.age_ticks[static_cast<unsigned>(i)]) * c.sample_time);
  }
  t.pose = c.mechanism.pose(q);
  t.rates = s.rate;
  const Motion2<float> d = c.reference.at(tick, c.sample_time);
  t.desired_pose = c.mechanism.pose(d.position);
  t.desired_rates = d.velocity;
  t.desired_acceleration = d.acceleration;
  return t;
}

template <class M>
void expect_the_law(const Setup<M>& s, const std::string& what) {
  SCOPED_TRACE(what);
  using S = typename M::Scalar;
  Rig<M> rig(s);
  ASSERT_TRUE(rig.start());
  const auto& c = rig.controller();
  double largest = 0;
  std::array<std::uint32_t, Rig<M>::axes_max> age{};
  for (std::uint32_t tick = 1; tick <= 40; ++tick) {
    for (std::size_t i = 0; i < rig.axis_count(); ++i) {
      rig.sends_encoder[i] = (tick + i) % 5 < 3;
      age[i] = rig.sends_encoder[i] ? 0 : age[i] + 1;
    }
    const auto r = rig.tick();
    ASSERT_EQ(r.state, State::running) << name(r.fault);
    ASSERT_EQ(r.running_tick, tick);
    const auto& sample = rig.cycle.sample();
    for (std::size_t i = 0; i < rig.axis_count(); ++i) {
      const auto joint = static_cast<int>(rig.joint_of(i));
      if (c.sensors == Sensors::base && joint % (M::joints / 2) != 0) continue;
      const double tolerance = static_cast<double>(std::numeric_limits<S>::epsilon()) * 8;
      ASSERT_NEAR(static_cast<double>(sample.angle[joint]), said(rig, i).angle, tolerance);
      ASSERT_NEAR(static_cast<double>(sample.rate[joint]), said(rig, i).rate, tolerance);
      ASSERT_EQ(sample.age_ticks[static_cast<std::size_t>(joint)], age[i]);
    }
    const Tracking<M> t = tracking(c, sample, tick);
    const Vec<S, M::joints> want = by_law(c, t);
    ASSERT_FALSE(r.saturated);
    for (int joint = 0; joint < M::joints; ++joint) ASSERT_EQ(r.torque[joint], want[joint]) << joint;
    for (std::size_t i = 0; i < rig.motors(); ++i) {
      const std::size_t axis = rig.axis_of_motor(i);
      const auto& m = test::mountings[axis];
      const auto joint = static_cast<int>(rig.joint_of(axis));
      const double shaft = static_cast<double>(want[joint]) * m.direction / m.gear;
      ASSERT_NEAR(static_cast<double>(rig.shaft_torque(axis)), shaft, std::abs(shaft) * 3e-7);
      largest = std::max(largest, std::abs(shaft));
    }
    ASSERT_EQ(r.effector, t.pose.effector);
    ASSERT_EQ(r.desired_effector, t.desired_pose.effector);
  }
  EXPECT_GT(largest, 1e-3);
}

constexpr LawKind laws[] = {LawKind::esmc, LawKind::esmc_projected, LawKind::smc, LawKind::ctc, LawKind::pd};
constexpr Reaching reachings[] = {Reaching::sign, Reaching::saturation, Reaching::tanh, Reaching::implicit};

std::string label(LawKind l, Reaching r) {
  return "law " + std::to_string(static_cast<int>(l)) + " reaching " + std::to_string(static_cast<int>(r));
}

/// Motors on the passive joints of a 5R stay unasked for when only the base is driven.
TEST(CycleTorque, JointsWithoutMotorGetNone) {
  auto s = setup<Five>();
  s.controller.sensors = Sensors::all;
  Rig<Five> rig(s);
  ASSERT_TRUE(rig.start());
  const auto r = rig.tick();
  EXPECT_EQ(r.torque[1], 0.0);
  EXPECT_EQ(r.torque[3], 0.0);
  EXPECT_NE(r.torque[0], 0.0);
  EXPECT_NE(r.torque[2], 0.0);
  EXPECT_EQ(rig.torque_frames(), 2);
  EXPECT_EQ(rig.torque_frames(1), 0);
  EXPECT_EQ(rig.torque_frames(3), 0);
}

/// A passive encoder that contradicts the base by more than the limit, and one that fails: both end the run.
TEST(CycleTorque, PassiveEncodersAreCheckedLikeTheOthers) {
  auto s = setup<Five>();
  s.controller.sensors = Sensors::all;
  for (const std::size_t axis : {1U, 3U}) {
    Rig<Five> rig(s);
    ASSERT_TRUE(rig.start());
    rig.angle[axis] += 1e-3 / 0.16 * 0.9;
    EXPECT_EQ(rig.tick().state, State::running);
    rig.angle[axis] += 1e-3 / 0.16 * 0.2;
    EXPECT_EQ(rig.tick().fault, Fault::loop_not_closed);
    EXPECT_TRUE(rig.all_zero());
    Rig<Five> silent(s);
    ASSERT_TRUE(silent.start());
    silent.sends_encoder[axis] = false;
    silent.tick();
    EXPECT_EQ(silent.tick().state, State::running);
    EXPECT_EQ(silent.tick().fault, Fault::stale_feedback);
    Rig<Five> broken(s);
    ASSERT_TRUE(broken.start());
    broken.bus.push(test::encoder(broken.node(axis), 0, NAN));
    EXPECT_EQ(broken.bare_tick().fault, Fault::feedback_not_finite);
  }
}

/// Only four motors with four encoders may pass type 2: two motors cannot hold it, two encoders cannot see
/// it.
TEST(CycleTorque, Type2IsGuardedUnlessAllJointsHaveMotorAndEncoder) {
  for (const Motors motors : {Motors::base, Motors::all}) {
    for (const Sensors sensors : {Sensors::base, Sensors::all}) {
      auto s = setup<Five>();
      s.controller.motors = motors;
      s.controller.sensors = sensors;
      s.controller.torque_limit.setConstant(100.0);
      Rig<Five> rig(s);
      ASSERT_TRUE(rig.start());
      const double second = 179 * test::turn / 360 - 0.4115;
      const double base = std::acos((0.16 * std::cos(1 * test::turn / 360) - 0.05) / 0.12);
      rig.angle = {base, 179 * test::turn / 360 - base, base, 179 * test::turn / 360 - base};
      ASSERT_NEAR(base + second, 179 * test::turn / 360, 1e-3);
      const Fault fault = rig.tick().fault;
      const bool regular = motors == Motors::all && sensors == Sensors::all;
      EXPECT_EQ(fault, regular ? Fault::none : Fault::type2_singularity) << name(fault);
    }
  }
}

// ---- limits

template <class M>
class CycleLimit : public testing::Test {};
using Machines = testing::Types<Five, Arm>;
TYPED_TEST_SUITE(CycleLimit, Machines);

TYPED_TEST(CycleLimit, TorqueIsWhatTheLawGives) {
  constexpr std::array rate{0.3, -0.2, 0.1, 0.25};
  for (const LawKind law : laws) {
    for (const Reaching reaching : reachings) {
      for (const Motors motors : {Motors::base, Motors::all}) {
        for (const Sensors sensors : {Sensors::base, Sensors::all}) {
          auto s = setup<TypeParam>();
          s.controller.law = law;
          s.controller.reaching = reaching;
          s.controller.motors = motors;
          s.controller.sensors = sensors;
          s.controller.torque_limit.setConstant(50);
          std::copy_n(rate.begin(), s.rate.size(), s.rate.begin());
          expect_the_law(s, label(law, reaching) + (motors == Motors::all ? " all motors" : "") +
                                (sensors == Sensors::all ? " all encoders" : ""));
        }
      }
    }
  }
}

TYPED_TEST(CycleLimit, TorqueIsClampedPerJointAndFlagged) {
  using S = typename TypeParam::Scalar;
  auto free = setup<TypeParam>();
  free.controller.torque_limit.setConstant(S(1000));
  free.controller.gains.k.setConstant(S(300));
  Rig<TypeParam> open(free);
  ASSERT_TRUE(open.start());
  const auto unlimited = open.tick();
  ASSERT_FALSE(unlimited.saturated);
  constexpr int joint1 = TypeParam::joints / 2;
  for (const S part : {S(0), S(0.25), S(1), S(4)}) {
    for (const int limited : {0, joint1}) {
      auto s = free;
      s.controller.torque_limit[limited] = std::abs(unlimited.torque[limited]) * part;
      Rig<TypeParam> rig(s);
      ASSERT_TRUE(rig.start());
      const auto r = rig.tick();
      EXPECT_EQ(r.state, State::running);
      EXPECT_EQ(r.saturated, part < S(1));
      const S most = s.controller.torque_limit[limited];
      EXPECT_EQ(r.torque[limited],
                part < S(1) ? std::copysign(most, unlimited.torque[limited]) : unlimited.torque[limited]);
      EXPECT_EQ(r.torque[joint1 - limited], unlimited.torque[joint1 - limited]) << "the other is not touched";
    }
  }
}

/// Four motors: what one may not give the others do, and what the effector feels is what it was. Where they
/// cannot, it is less of the same.
TEST(CycleTorque, FourMotorsShareWhatOneMayNotGive) {
  auto free = setup<Five>();
  free.controller.motors = Motors::all;
  free.controller.sensors = Sensors::all;
  free.controller.torque_limit.setConstant(1000.0);
  Rig<Five> open(free);
  ASSERT_TRUE(open.start());
  const auto unlimited = open.tick();
  const auto& m = open.controller().mechanism;
  const auto pose = tracking(open.controller(), open.cycle.sample(), 0).pose;
  const auto felt = [&](const Vec<double, 4>& torque) {  // power at unit rates of the base joints
    Vec2<double> out;
    for (int k = 0; k < 2; ++k) {
      const auto r = m.base_rates(pose, Vec2<double>::Unit(k));
      out[k] = torque[0] * r.leg[0][0] + torque[1] * r.leg[0][1] + torque[2] * r.leg[1][0] +
               torque[3] * r.leg[1][1];
    }
    return out;
  };
  const Vec2<double> want = felt(unlimited.torque);
  int met = 0, short_of_it = 0;
  for (int limited = 0; limited < 4; ++limited) {
    for (const double part : {0.9, 0.5, 0.0}) {
      for (const double others : {1000.0, 0.5 * unlimited.torque.cwiseAbs().maxCoeff()}) {
        auto s = free;
        s.controller.torque_limit.setConstant(others);
        s.controller.torque_limit[limited] = std::abs(unlimited.torque[limited]) * part;
        Rig<Five> rig(s);
        ASSERT_TRUE(rig.start());
        const auto r = rig.tick();
        const Vec2<double> got = felt(r.torque);
        const double share = got.dot(want) / want.squaredNorm();
        EXPECT_LT((got - want * share).norm(), 1e-9 * want.norm()) << "another direction";
        EXPECT_EQ(r.saturated, share < 1.0 - 1e-9);
        if (others == 1000.0) {
          EXPECT_NEAR(share, 1.0, 1e-9);
        }
        ++(share < 1.0 - 1e-9 ? short_of_it : met);
        for (int i = 0; i < 4; ++i) EXPECT_LE(std::abs(r.torque[i]), s.controller.torque_limit[i]);
      }
    }
  }
  EXPECT_GE(met, 12);
  EXPECT_GT(short_of_it, 0);
}

/// A preload is there from the first tick on, and the effector feels nothing of it.
TEST(CycleTorque, APreloadKeepsTheSigns) {
  auto s = setup<Five>();
  s.controller.motors = Motors::all;
  s.controller.sensors = Sensors::all;
  s.controller.torque_limit.setConstant(1000.0);
  Rig<Five> plain(s);
  ASSERT_TRUE(plain.start());
  const auto without = plain.tick();
  const double most = 2.0 * without.torque.cwiseAbs().maxCoeff();
  const auto pose = tracking(plain.controller(), plain.cycle.sample(), 0).pose;
  int kept = 0;
  for (unsigned signs = 0; signs < 16; ++signs) {
    for (int i = 0; i < 4; ++i)
      s.controller.preload[i] = (signs >> static_cast<unsigned>(i) & 1U) != 0 ? most : -most;
    Rig<Five> rig(s);
    ASSERT_TRUE(rig.start());
    const auto r = rig.tick();
    bool all = true;
    for (int i = 0; i < 4; ++i)
      all = all && r.torque[i] * s.controller.preload[i] >= most * most * (1.0 - 1e-12);
    kept += all ? 1 : 0;
    for (int k = 0; k < 2; ++k) {
      const auto rate = plain.controller().mechanism.base_rates(pose, Vec2<double>::Unit(k));
      const Vec<double, 4> rates(rate.leg[0][0], rate.leg[0][1], rate.leg[1][0], rate.leg[1][1]);
      EXPECT_NEAR(r.torque.dot(rates), without.torque.dot(rates), 1e-9 * r.torque.cwiseAbs().maxCoeff());
    }
    EXPECT_FALSE(r.saturated);
  }
  EXPECT_EQ(kept, 8) << "of sixteen patterns a plane of torques has eight, opposite ones together";
}

// ---- joining

TYPED_TEST(CycleLimit, JoinEndsOnTheReferenceAndStartsAnewAfterAReset) {
  auto s = setup<TypeParam>();
  s.controller.join_ticks = 200;
  Rig<TypeParam> rig(s);
  ASSERT_TRUE(rig.start());
  const auto& c = rig.controller();
  TickResult<TypeParam> r{};
  for (int n = 0; n < 200; ++n) r = rig.tick();
  ASSERT_EQ(r.running_tick, 200U);
  const auto want = tracking(c, rig.cycle.sample(), 200);
  EXPECT_EQ(r.desired_effector, want.desired_pose.effector);
  rig.error[0] = 4;
  r = rig.tick();
  EXPECT_EQ(r.state, State::fault);
  rig.error[0] = 0;
  for (int i = 0; i < 3; ++i) rig.tick();
  rig.tick(Command::reset);
  rig.angle[0] += 0.02;
  rig.tick(Command::enable);
  for (int i = 0; i < 20 && r.state != State::running; ++i) r = rig.tick();
  ASSERT_EQ(r.state, State::running) << name(r.fault);
  ASSERT_EQ(r.running_tick, 0U);
  EXPECT_LT((r.desired_effector - r.effector).norm(), 1e-6) << "from where it is now";
}

/// The robot that holds: the centre is the pose of the tick that started it, not of an earlier run.
TYPED_TEST(CycleLimit, HoldStartHoldsThePoseOfEachStart) {
  auto s = setup<TypeParam>();
  s.controller.reference = {};
  Rig<TypeParam> rig(s);
  ASSERT_TRUE(rig.start());
  const auto first = rig.tick();
  EXPECT_LT((first.desired_effector - first.effector).norm(), 1e-6);
  rig.tick(Command::stop);
  ASSERT_TRUE(rig.until(State::disabled));
  rig.angle[0] += 0.05;
  ASSERT_TRUE(rig.start());
  const auto second = rig.tick();
  EXPECT_LT((second.desired_effector - second.effector).norm(), 1e-6);
  EXPECT_GT((second.effector - first.effector).norm(), 1e-3);
}

}  // namespace
