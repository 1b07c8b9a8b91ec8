// Programs of moves: blends, timing against closed forms and dynamic programming, the table that the firmware
// reads.

#include <gtest/gtest.h>

#include "host_sim/plan/inertia.hpp"
#include "host_sim/plan/piece.hpp"
#include "tests/support/program_problem.hpp"
#include "tests/support/sampled_loop.hpp"

namespace esmc::test {
namespace {

using host::MoveKind;
using host::plan::Plan;
using host::plan::Problem;
using host::plan::Refused;

Reference<double> reference_of(const Plan& plan) {
  Reference<double> r;
  r.kind = ReferenceKind::path;
  r.path = plan.path;
  return r;
}

/// Torques that two RR joints need, from the printed form [F6], [F7]; the arm's joints at an effector motion.
struct ArmByHand {
  RrParams<double> p = rr_example();

  [[nodiscard]] std::array<double, 2> torque(const Vec2<double>& x, const Vec2<double>& v,
                                             const Vec2<double>& a) const {
    const auto& l = p.arm;
    const double r2 = x.squaredNorm(), c2 = (r2 - l.l1 * l.l1 - l.l2 * l.l2) / (2.0 * l.l1 * l.l2),
                 q2 = std::acos(c2);
    const double q1 = std::atan2(x.y(), x.x()) - std::atan2(l.l2 * std::sin(q2), l.l1 + l.l2 * c2);
    const double s1 = std::sin(q1), c1 = std::cos(q1), s12 = std::sin(q1 + q2), c12 = std::cos(q1 + q2),
                 s2 = std::sin(q2);
    const auto inverse = [&](const Vec2<double>& w) {  // [F8]
      const double k = 1.0 / (l.l1 * l.l2 * s2);
      return Vec2<double>(k * (l.l2 * c12 * w.x() + l.l2 * s12 * w.y()),
                          -k * ((l.l1 * c1 + l.l2 * c12) * w.x() + (l.l1 * s1 + l.l2 * s12) * w.y()));
    };
    const Vec2<double> w = inverse(v);
    const double both = w[0] + w[1];
    const Vec2<double> bias(-(l.l1 * c1 * w[0] * w[0] + l.l2 * c12 * both * both),
                            -(l.l1 * s1 * w[0] * w[0] + l.l2 * s12 * both * both));
    const Vec2<double> q = inverse(a - bias);
    const double alpha = l.J1 + l.m1 * l.lg1 * l.lg1 + l.J2 + l.m2 * (l.l1 * l.l1 + l.lg2 * l.lg2),
                 beta = l.m2 * l.l1 * l.lg2, delta = l.J2 + l.m2 * l.lg2 * l.lg2;
    return {(alpha + 2.0 * beta * c2) * q[0] + (delta + beta * c2) * q[1] -
                beta * s2 * (2.0 * w[0] * w[1] + w[1] * w[1]) +
                p.g * ((l.m1 * l.lg1 + l.m2 * l.l1) * c1 + l.m2 * l.lg2 * c12),
            (delta + beta * c2) * q[0] + delta * q[1] + beta * s2 * w[0] * w[0] + p.g * l.m2 * l.lg2 * c12};
  }
};

/// Shortest time along a straight line by dynamic programming: squares of speed on a grid, every transition
/// tried, torques in the middle of each from the printed form. most: largest square that is looked at.
double by_dynamic_programming(const Vec2<double>& from, const Vec2<double>& to, double limit, double most,
                              int levels) {
  constexpr int cells = 80;
  const ArmByHand arm;
  const double length = (to - from).norm();
  // Points and levels are dense at rest.
  const auto point = [&](std::size_t i) {
    const double x = static_cast<double>(i) / cells;
    return length * (x - 0.9 * std::sin(2.0 * std::numbers::pi * x) / (2.0 * std::numbers::pi));
  };
  const auto level = [&](std::size_t k) { return most * std::pow(static_cast<double>(k) / levels, 2); };
  const Vec2<double> along = (to - from) / length;
  struct Share {
    std::array<double, 2> a, b, c;
  };
  std::vector<Share> at;
  const Vec2<double> none(0, 0);
  for (std::size_t i = 0; i < cells; ++i) {
    const Vec2<double> x = from + along * (0.5 * (point(i) + point(i + 1)));
    const auto weight = arm.torque(x, none, none), push = arm.torque(x, none, along),
               bend = arm.torque(x, along, none);
    Share s{};
    for (std::size_t k = 0; k < 2; ++k)
      s.a[k] = push[k] - weight[k], s.b[k] = bend[k] - weight[k], s.c[k] = weight[k];
    at.push_back(s);
  }
  /// The accelerations that both torques allow, a little narrower by rounding.
  const auto range = [&](const Share& s, double x, double width) {
    std::array<double, 2> out{-1e300, 1e300};
    for (std::size_t m = 0; m < 2; ++m) {
      const double rest = s.b[m] * x + s.c[m], a = s.a[m] + s.b[m] * width, u = (limit - rest) / a,
                   v = (-limit - rest) / a;
      out = {std::max(out[0], std::min(u, v)), std::min(out[1], std::max(u, v))};
    }
    return out;
  };
  const auto count = static_cast<std::size_t>(levels) + 1;
  std::vector<double> cost(count, 1e300), next;
  cost[0] = 0.0;
  for (std::size_t i = at.size(); i-- > 0;) {
    next.assign(count, 1e300);
    const double width = point(i + 1) - point(i);
    for (std::size_t j = 0; j < count; ++j) {
      const double x = level(j);
      const auto [least, largest] = range(at[i], x, width);
      const double low = std::max(0.0, x + 2.0 * width * least),
                   high = std::min(most, x + 2.0 * width * largest);
      for (auto k = static_cast<std::size_t>(std::ceil(levels * std::sqrt(low / most)));
           k < count && level(k) <= high; ++k) {
        const double y = level(k);
        if (cost[k] > 1e299 || j + k == 0) continue;
        next[j] = std::min(next[j], cost[k] + 2.0 * width / (std::sqrt(x) + std::sqrt(y)));
      }
    }
    cost = next;
  }
  return cost[0];
}

/// Forces of the closed form against those of the algorithm by way of all channels, at one motion of the
/// effector.
template <class M>
void compare_inertia(M m, const typename M::Mode& mode, const Vec2<double>& x) {
  Desired<M> d;
  ASSERT_TRUE(desired_at_effector(m, mode, x, Vec2<double>(0.7, -0.4), Vec2<double>(-3.0, 8.0), d.pose,
                                  d.rates, d.acceleration));
  auto a = m.channel_accelerations(d.pose, d.rates, d.acceleration);
  m.add_rotors(a);
  const auto w = m.force(a, M::Rates::Zero());
  const host::plan::Inertia<M> closed(m);
  const auto still = closed.weight(d.pose), push = closed.push(d.pose, d.rates, d.acceleration);
  if constexpr (M::joints == 4) {
    const auto torque = m.leg_torques(d.pose, w);
    EXPECT_LT((w.template head<2>() - still.effector - push.effector).norm(), 1e-13);
    for (int j = 0; j < 2; ++j) EXPECT_LT((torque[j] - still.leg[j] - push.leg[j]).norm(), 1e-13);
  } else {
    EXPECT_LT((m.base_torque(d.pose, w) - still.leg[0] - push.leg[0]).norm(), 1e-13);
  }
}

TEST(Plan, ItsClosedFormTakesTheForcesOfTheAlgorithm) {
  auto five = five_bar_example();
  five.legs[0].rotor2 = 3e-4;
  five.legs[1].m1 = 0.17;
  compare_inertia(FiveBar<double>(five), {{{1, 1}}, -1}, {0.03, 0.17});
  auto arm = rr_example();
  arm.arm.rotor2 = 2e-3;
  compare_inertia(Rr<double>(arm), {1}, {0.3, 0.2});
}

TEST(Plan, TimesOfTorqueLimitedLinesAgreeWithDynamicProgramming) {
  const std::array<std::array<double, 5>, 4> cases{{{0.40, -0.10, 0.20, 0.25, 9.0},
                                                    {0.35, 0.10, 0.35, -0.25, 8.0},
                                                    {0.20, 0.30, 0.45, 0.10, 10.0},
                                                    {0.30, -0.20, 0.10, 0.30, 12.0}}};
  for (const auto& [x0, y0, x1, y1, limit] : cases) {
    auto p = at_rest<Rr<double>>(x0, y0, limit);
    p.moves = {move(MoveKind::line, x1, y1)};
    const double length = std::hypot(x1 - x0, y1 - y0);
    double oracle =
        by_dynamic_programming({x0, y0}, {x1, y1}, limit, 100.0, 2000);  // coarse: for the range of speeds
    oracle =
        by_dynamic_programming({x0, y0}, {x1, y1}, limit, 9.0 * length * length / (oracle * oracle), 6000);
    const double time = host::plan::plan(p).duration;
    EXPECT_LE(time, oracle * 1.005) << x0 << " " << y0;
    EXPECT_GE(time, oracle * 0.995) << x0 << " " << y0;
  }
}

/// From rest to rest with constant acceleration, then the same slowing down.
TEST(Plan, LineUnderConstantAccelerationTakesTheClosedFormsTime) {
  auto p = at_rest<FiveBar<double>>(-0.1, 0.17, 100.0);
  p.moves = {move(MoveKind::line, 0.1, 0.17)};
  p.moves[0].acceleration = 3.0;
  const double exact = 2.0 * std::sqrt(0.2 / 3.0);
  for (std::size_t grid = 20; grid < 1300;
       grid += 1 + grid / 20) {  // the switch falls anywhere in an interval
    p.grid = grid;
    const double error = host::plan::plan(p).duration / exact - 1.0;
    EXPECT_GE(error, -1e-9) << grid;
    EXPECT_LE(error, std::max(1e-8, 8.0 / static_cast<double>(grid * grid))) << grid;
  }
  p.grid = 2001;
  EXPECT_NEAR(host::plan::plan(p).duration, exact, 1e-6 * exact);
  p.moves[0].speed = 0.5;  // reached after v / a, kept, and given up again
  EXPECT_NEAR(host::plan::plan(p).duration, 0.2 / 0.5 + 0.5 / 3.0, 2e-5);
}

/// On a circle some acceleration along the path is left up to v^2 / r = a.
TEST(Plan, LimitCurveOfAnArcIsItsCentripetalLimit) {
  auto p = at_rest<FiveBar<double>>(-0.04, 0.17, 100.0);
  p.moves = {move(MoveKind::arc, 0.04, 0.17)};
  p.moves[0].via = {0.0, 0.21};
  p.moves[0].acceleration = 5.0;
  p.bound = true;
  const Plan plan = host::plan::plan(p);
  ASSERT_GT(plan.limit_curve.size(), 50U);
  for (const auto& [t, v] : plan.limit_curve) EXPECT_NEAR(v, std::sqrt(5.0 * 0.04), 0.005 * v) << t;
  const Reference<double> r = reference_of(plan);
  for (std::uint32_t n = 0; n <= plan.ticks; ++n)
    EXPECT_LE(r.at(n, 1e-3).velocity.norm(), 1.005 * std::sqrt(5.0 * 0.04));
}

TEST(Plan, JointMoveUnderLimitsOfItsJointsTakesTheClosedFormsTime) {
  auto p = at_rest<Rr<double>>(0.40, -0.10, 100.0);
  const auto start = p.controller.mechanism.inverse(Vec2<double>(0.40, -0.10), p.controller.mode);
  ASSERT_TRUE(start);
  const Vec2<double> q = Rr<double>::base_angles(*start);
  p.start_base = q;
  p.moves = {move(MoveKind::joint, q[0] + 0.8, q[1] - 0.4)};
  p.moves[0].acceleration = 10.0;
  p.grid = 1000;
  EXPECT_NEAR(host::plan::plan(p).duration, 2.0 * std::sqrt(0.8 / 10.0), 2e-4);
}

/// Up, across with rounded corners, and down.
template <class M>
Problem<M> hook(bool all_motors = false) {
  auto p = at_rest<M>(M::joints == 4 ? -0.1 : 0.25, M::joints == 4 ? 0.15 : 0.1, M::joints == 4 ? 1.5 : 14.0,
                      all_motors);
  const double x = p.start.x(), y = p.start.y(), across = M::joints == 4 ? 0.2 : 0.15;
  p.moves = {move(MoveKind::line, x, y + 0.05), move(MoveKind::line, x + across, y + 0.05),
             move(MoveKind::line, x + across, y)};
  p.moves[0].blend = p.moves[1].blend = 0.008;
  return p;
}

template <class M>
void expect_smooth(const Problem<M>& p, double deviation) {
  const Plan plan = host::plan::plan(p);
  EXPECT_LE(plan.deviation, deviation);
  for (const auto& kind : plan.use) {
    for (const auto& use : kind) EXPECT_LE(use.share, 1.0 + 1e-6);
  }
  const Reference<double> r = reference_of(plan);
  Motion2<double> last = r.at(0, 1e-3);
  EXPECT_NEAR((last.position - p.start).norm(), 0.0, 1e-12);
  EXPECT_EQ(last.velocity.norm(), 0.0);
  double fastest = 0.0, largest = 0.0;
  for (std::uint32_t n = 0; n <= plan.ticks; ++n) {
    fastest = std::max(fastest, r.at(n, 1e-3).velocity.norm());
    largest = std::max(largest, r.at(n, 1e-3).acceleration.norm());
  }
  for (std::uint32_t n = 1; n <= plan.ticks + 2; ++n) {
    const Motion2<double> now = r.at(n, 1e-3);
    EXPECT_LE((now.position - last.position).norm(), 1.1e-3 * fastest) << n;
    EXPECT_LE((now.velocity - last.velocity).norm(), 1.1e-3 * largest) << n;
    last = now;
  }
  EXPECT_NEAR((last.position - Vec2<double>(p.moves.back().to[0], p.moves.back().to[1])).norm(), 0.0, 1e-9);
  EXPECT_EQ(last.velocity.norm(), 0.0);
}

TEST(Plan, RoundedCornersKeepTheirDeviationAndNothingJumps) {
  expect_smooth(hook<FiveBar<double>>(), 0.008);
  expect_smooth(hook<FiveBar<double>>(true), 0.008);
  expect_smooth(hook<Rr<double>>(), 0.008);
}

struct Tracked {
  double worst = 0.0;  // m
  int saturated = 0;   // ticks
};
Tracked tracked(const Problem<FiveBar<double>>& p, const Plan& plan) {
  const auto& c = p.controller;
  const host::FiveBarPlant plant(five_bar_example());
  const auto q = host::reach(five_bar_example(), {p.start.x(), p.start.y()}, {1, 1});
  host::FiveBarPlant::State s = host::FiveBarPlant::from_joints(*q, {0.0, 0.0, 0.0, 0.0});
  const Gains<FiveBar<double>> gains = usual_gains(p.tick);
  const Reference<double> r = reference_of(plan);
  Tracked out;
  for (std::uint32_t n = 0; n < plan.ticks + 50; ++n) {
    const auto t = track(c.mechanism, c.mode, plant.output(s), r.from(n, p.tick));
    out.worst = std::max(out.worst, Vec2<double>(t.desired_pose.effector - t.pose.effector).norm());
    const auto asked = demand(LawKind::esmc, c.mechanism, gains, Reaching::implicit, t).acceleration;
    Vec2<double> tau = c.mechanism.base_torque(t.pose, c.mechanism.force(asked, t.rates));
    const double most = c.torque_limit[0];
    if (tau.cwiseAbs().maxCoeff() > most) ++out.saturated;
    tau = tau.cwiseMax(-most).cwiseMin(most);
    advance(plant, s, tau, p.tick);
  }
  return out;
}

/// A torque holds for a tick, and the reference gives the mean acceleration of it: so all of the torque
/// tracks like a time 5 % longer.
TEST(Plan, OptimalTimesAreTrackedLikeLongerOnes) {
  const auto p = hook<FiveBar<double>>();
  const Plan plan = host::plan::plan(p);
  const Tracked shortest = tracked(p, plan);
  EXPECT_LE(shortest.saturated, 12);
  auto less = p;
  less.controller.torque_limit *= 0.91;
  const Plan longer = host::plan::plan(less);
  EXPECT_NEAR(longer.duration, 1.05 * plan.duration, 0.003 * plan.duration);
  EXPECT_LE(shortest.worst, 2.0 * tracked(p, longer).worst);
  less.controller.torque_limit = 0.99 * p.controller.torque_limit;
  EXPECT_EQ(tracked(p, host::plan::plan(less)).saturated, 0);
}

TEST(Plan, FourMotorsAreFasterThanTwo) {
  EXPECT_LT(host::plan::plan(hook<FiveBar<double>>(true)).duration,
            host::plan::plan(hook<FiveBar<double>>()).duration);
}

TEST(Plan, MoreTorqueIsFasterAndFrictionSlower) {
  auto p = hook<FiveBar<double>>();
  const double time = host::plan::plan(p).duration;
  p.friction.viscous = {0.01, 0.0, 0.01, 0.0};
  const double slow = host::plan::plan(p).duration;
  p.friction.dry = {0.05, 0.0, 0.05, 0.0};
  const double slower = host::plan::plan(p).duration;
  EXPECT_LT(time, slow);
  EXPECT_LT(slow, slower);
  p = hook<FiveBar<double>>();
  p.controller.torque_limit *= 1.5;
  EXPECT_LT(host::plan::plan(p).duration, time);
}

TEST(Plan, JerkIsKept) {
  auto p = at_rest<FiveBar<double>>(-0.1, 0.17, 100.0);
  p.moves = {move(MoveKind::line, 0.1, 0.17)};
  p.moves[0].acceleration = 5.0;
  p.moves[0].jerk = 100.0;
  const Plan plan = host::plan::plan(p);
  const Reference<double> r = reference_of(plan);
  for (std::uint32_t n = 1; n <= plan.ticks; ++n) {
    const double change = (r.at(n, 1e-3).acceleration - r.at(n - 1, 1e-3).acceleration).norm();
    EXPECT_LE(change, 1.02e-3 * 100.0) << n;
  }
  // The shortest time of a triple integrator from rest to rest with this jerk and acceleration.
  const double ramp = 5.0 / 100.0, flat = -1.5 * ramp + std::sqrt(0.25 * ramp * ramp + 0.2 / 5.0);
  EXPECT_GE(plan.duration, 4.0 * ramp + 2.0 * flat);
  EXPECT_LE(plan.duration, 1.15 * (4.0 * ramp + 2.0 * flat));
}

TEST(Plan, ArcsAndSplinesGoThroughTheirPoints) {
  host::plan::Piece circle;
  ASSERT_TRUE(host::plan::arc({1, 0}, {0, 1}, {-1, 0}, circle));
  EXPECT_NEAR(circle.length(), std::numbers::pi, 1e-12);
  EXPECT_NEAR((circle.point(0.5 * circle.end).p - Vec2<double>(0, 1)).norm(), 0.0, 1e-12);
  ASSERT_TRUE(host::plan::arc({1, 0}, {0, -1}, {0, 1}, circle));
  EXPECT_NEAR(circle.length(), 1.5 * std::numbers::pi, 1e-12);
  EXPECT_FALSE(host::plan::arc({0, 0}, {1, 1}, {2, 2}, circle));
  const std::vector<Vec2<double>> points{{0, 0}, {1, 0.5}, {1.5, -1}, {3, 0}};
  const auto pieces = host::plan::spline(points);
  for (std::size_t i = 0; i < pieces.size(); ++i) {
    EXPECT_NEAR((pieces[i].point(0.0).p - points[i]).norm(), 0.0, 1e-12);
    EXPECT_NEAR((pieces[i].point(pieces[i].end).p - points[i + 1]).norm(), 0.0, 1e-12);
    if (i == 0) continue;
    const auto before = pieces[i - 1].point(pieces[i - 1].end), after = pieces[i].point(0.0);
    EXPECT_NEAR((before.d1 - after.d1).norm() + (before.d2 - after.d2).norm(), 0.0, 1e-9);
  }
}

TEST(Plan, BlendsMeetTheirNeighboursWithThreeDerivatives) {
  const host::plan::CurvePoint a{{0, 0}, {1, 0}, {0, 0.3}, {0.1, 0}}, b{{1, 1}, {0.2, 1.1}, {-1, 0}, {0, 2}};
  const auto blend = host::plan::blend_between(a, b);
  const auto begin = blend.point(0.0), end = blend.point(blend.end);
  EXPECT_NEAR(
      (begin.p - a.p).norm() + (begin.d1 - a.d1).norm() + (begin.d2 - a.d2).norm() + (begin.d3 - a.d3).norm(),
      0.0, 1e-10);
  EXPECT_NEAR((end.p - b.p).norm() + (end.d1 - b.d1).norm() + (end.d2 - b.d2).norm() + (end.d3 - b.d3).norm(),
              0.0, 1e-8);
}

TEST(Plan, MixedMovesOfAllKindsAreOneMotion) {
  auto p = at_rest<FiveBar<double>>(-0.08, 0.16, 1.5);
  const auto target = p.controller.mechanism.inverse(Vec2<double>(0.05, 0.2), p.controller.mode);
  ASSERT_TRUE(target);
  const Vec2<double> q = FiveBar<double>::base_angles(*target);
  auto arc = move(MoveKind::arc, 0.0, 0.17);
  arc.via = {0.04, 0.17};
  auto spline = move(MoveKind::spline, -0.08, 0.16);
  spline.through = {{-0.02, 0.19}, {-0.05, 0.15}};
  p.moves = {move(MoveKind::joint, q[0], q[1]), arc, spline};
  const auto start = p.controller.mechanism.inverse(p.start, p.controller.mode);
  p.start_base = FiveBar<double>::base_angles(*start);
  p.moves[0].blend = p.moves[1].blend = 0.004;
  expect_smooth(p, 0.004);
}

TEST(Plan, ASinglePoseThatCannotBeHeldIsNamed) {
  auto p = at_rest<Rr<double>>(0.2, 0.3, 9.0);
  p.controller.torque_limit[0] = 4.0;
  p.moves = {move(MoveKind::line, 0.5, 0.1)};
  try {
    (void)host::plan::plan(p);
    FAIL() << "planned";
  } catch (const Refused& e) {
    EXPECT_EQ(e.move(), 0U);
    EXPECT_NE(std::string(e.what()).find("motor 1"), std::string::npos) << e.what();
  }
}

}  // namespace
}  // namespace esmc::test
