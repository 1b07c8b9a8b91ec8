/// Hard cases of the plant, each against a reference from elsewhere or against its own convergence.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "host_sim/plant/kinematics.hpp"
#include "host_sim/plant/motion.hpp"

namespace esmc::host {
namespace {

constexpr LegParams<double> leg{0.12, 0.16, 0.06, 0.068, 0.1, 0.1, 2e-4, 7e-4};
constexpr FiveBarParams<double> five_bar{0.05, 0.0, 9.8, {{leg, leg}}};

Motion<FiveBarPlant> fall(Method method) {  // B4
  const FiveBarPlant plant(five_bar);
  return {{plant, plant, {}, {0, 2}, method},
          FiveBarPlant::from_joints({0.33914579427821183820, 1.85318013531281830819, 1.31276054418215195822,
                                     1.48475269532538599760},
                                    {0, 0, 0, 0})};
}

struct Instant {
  double t;
  std::array<double, 6> q;
};
/// Computed in quadruple precision (reference problem B4 of the project's golden data).
constexpr Instant golden_fall[] = {
    {0.1,
     {0.06887825556525778529, 0.11717533868109767343, -0.05823106245863909644, 2.31153344847598241818,
      1.22156822750497371736, 1.89240288417611479595}},
    {0.2,
     {0.01883455025601987053, 0.03416531028089134011, -1.44685540035930355357, 3.30926937445084740931,
      0.81891337813247981822, 2.66350970888592171653}},
    {0.25,
     {-0.01349935527164578566, 0.06458494073116901118, -2.22637410112360593504, 3.73679171077824686325,
      0.18873371917602579560, 2.68678616236967082441}}};

TEST(HardPlant, FallsThroughBothSingularitiesOntoTheReference) {
  auto m = fall(Method::rk4);
  double t = 0.0;
  for (const Instant& i : golden_fall) {
    m.advance(t, i.t - t, static_cast<int>(std::lround((i.t - t) / 1e-5)), {});
    t = i.t;
    for (std::size_t k = 0; k < 6; ++k)
      EXPECT_NEAR(m.output().q[k], i.q[k], 2e-11) << "t " << t << " entry " << k;
    EXPECT_LT(m.output().closure, 1e-15);
  }
}

TEST(HardPlant, CrossingSingularitiesChangesModesWithoutAJump) {
  auto m = fall(Method::rk4);
  auto angle = m.output().q;
  int type1 = 0, type2 = 0;
  for (int n = 0; n < 10000; ++n) {
    m.advance(n * 1e-4, 1e-4, 1, {});
    const auto next = m.output().q;
    const auto modes = [](const std::array<double, 6>& q) {
      return std::array<bool, 3>{std::sin(q[3]) > 0.0, std::sin(q[5]) > 0.0,
                                 type2_sine({q[2], q[3], q[4], q[5]}) > 0.0};
    };
    const auto before = modes(angle), after = modes(next);
    type1 += static_cast<int>(before[0] != after[0]) + static_cast<int>(before[1] != after[1]);
    type2 += static_cast<int>(before[2] != after[2]);
    for (std::size_t k = 0; k < 6; ++k) {
      const double moved = std::abs(next[k] - angle[k]);
      EXPECT_LT(moved, 1e-4 * (1.0 + 2.0 * std::abs(m.output().qd[k])) + 1e-2)
          << "entry " << k << " at step " << n;
    }
    angle = next;
    ASSERT_LT(m.output().closure, 1e-13);
  }
  EXPECT_GE(type1, 1) << "leg 1 passes type 1 near 0.2 s";
  EXPECT_GE(type2, 1) << "the mechanism passes type 2 before 1 s";
  EXPECT_LT(m.energy_error(), 1e-4);
}

/// Free motion with a step of h and its halves: the classical method must show its order, or rounding.
struct Extreme {
  const char* name;
  FiveBarParams<double> p;
  double duration;
  double step;
};

std::vector<Extreme> extremes() {
  const auto with = [](double m1, double m2, double scale1, double scale2, double g) {
    LegParams<double> l = leg;
    l.m1 *= m1;
    l.J1 *= m1;
    l.m2 *= m2;
    l.J2 *= m2;
    l.l1 *= scale1;
    l.lg1 *= scale1;
    l.J1 *= scale1 * scale1;
    l.l2 *= scale2;
    l.lg2 *= scale2;
    l.J2 *= scale2 * scale2;
    return FiveBarParams<double>{0.05, 0.0, g, {{l, l}}};
  };
  return {{"heavy distal bars, 1e6", with(1.0, 1e6, 1.0, 1.0, 9.8), 0.2, 1e-3},
          {"heavy proximal bars, 1e6", with(1e6, 1.0, 1.0, 1.0, 9.8), 0.05, 1e-3},
          {"no gravity", with(1.0, 1.0, 1.0, 1.0, 0.0), 0.2, 1e-3},
          {"a leg of length ratio 1e-3", with(1.0, 1.0, 1e-3, 1.0, 9.8), 2e-3, 2e-6}};
}

TEST(HardPlant, ExtremeMechanismsConvergeAtTheOrderOfTheMethod) {
  for (const Extreme& e : extremes()) {
    SCOPED_TRACE(e.name);
    const auto q = reach(e.p, {0.03, 0.15}, {1, 1});
    ASSERT_TRUE(q || e.p.legs[0].l1 < 1e-3);
    // With a crank of 0.12 mm the tips meet only near where they are: right above the middle of the base.
    const auto start = q ? q : reach(e.p, {0.0, std::sqrt(0.16 * 0.16 - 0.05 * 0.05)}, {1, 1});
    ASSERT_TRUE(start);
    const FiveBarPlant plant(e.p);
    std::vector<std::array<double, 4>> end;
    for (int halving = 0; halving < 4; ++halving) {
      Motion<FiveBarPlant> m({plant, plant, {}, {0, 2}, Method::rk4},
                             FiveBarPlant::from_joints(*start, {1.0, 0.0, -0.5, 0.0}));
      m.advance(0.0, e.duration, static_cast<int>(std::lround(e.duration / e.step)) << halving, {});
      end.push_back(m.state().angle);
      EXPECT_LT(m.output().closure, 1e-13);
    }
    const auto difference = [&](std::size_t i) {
      double d = 0.0;
      for (std::size_t k = 0; k < 4; ++k) d = std::max(d, std::abs(end[i][k] - end[i + 1][k]));
      return d;
    };
    for (std::size_t i = 0; i + 2 < end.size(); ++i) {
      const double coarse = difference(i), fine = difference(i + 1);
      if (coarse < 1e-11) continue;
      EXPECT_GT(std::log2(coarse / fine), 3.6) << "halving " << i << ": " << coarse << " -> " << fine;
    }
  }
}

TEST(HardPlant, FourDecadesOfStepsAgree) {
  const FiveBarPlant plant(five_bar);
  const auto q = reach(five_bar, {0.03, 0.15}, {1, 1});
  std::vector<std::array<double, 4>> end;
  for (const int steps : {10, 100, 1000, 100000}) {  // 1e-2 .. 1e-6 s
    Motion<FiveBarPlant> m({plant, plant, {}, {0, 2}, Method::rk4},
                           FiveBarPlant::from_joints(*q, {1.0, 0.0, -0.5, 0.0}));
    m.advance(0.0, 0.1, steps, {});
    end.push_back(m.state().angle);
  }
  const double allowed[] = {2e-3, 2e-7, 2e-11};
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t k = 0; k < 4; ++k) EXPECT_NEAR(end[i][k], end[3][k], allowed[i]) << "steps " << i;
  }
}

/// A position loop closed on the joint's side of a gear with play: it hunts, and the cycle must be that of a
/// run ten times finer.
struct Cycle {
  double amplitude, period;
};
Cycle hunt(double step) {
  const RrPlant plant(RrParams<double>{{0.1, 0.1, 0, 0, 0, 0, 1e-3, 2e-3}, 0.0});
  Motion<RrPlant> m({plant, plant, {Backlash{0.02, 1000.0, 0.1, 1e-4}}, {0}, Method::rk4},
                    RrPlant::from_joints({0.0, 1.0}, {0.5, -0.5}));
  double highest = 0.0, integral = 0.0, last_up = 0.0, period = 0.0;
  bool below = false;
  int ups = 0;
  constexpr double tick = 1e-3;
  for (int n = 0; n < 20000; ++n) {
    const double angle = m.state().angle[0], rate = m.state().rate[0];
    integral += angle * tick;
    const double torque = -(0.5 * angle + 0.012 * rate + 0.5 * integral);
    m.advance(n * tick, tick, static_cast<int>(std::lround(tick / step)), {{torque, 0.0}, nullptr});
    if (n < 15000) continue;
    highest = std::max(highest, std::abs(angle));
    if (below && angle >= 0.0) {
      if (ups > 0) period += n * tick - last_up;
      last_up = n * tick;
      ++ups;
    }
    below = angle < 0.0;
  }
  return {highest, ups > 1 ? period / (ups - 1) : 0.0};
}

TEST(HardPlant, BacklashLimitCycleIsThatOfAFinerRun) {
  const Cycle coarse = hunt(2e-4), fine = hunt(2e-5);
  EXPECT_GT(fine.amplitude, 1e-4) << "a loop that does not hunt tests nothing";
  EXPECT_GT(fine.period, 0.0);
  EXPECT_NEAR(coarse.amplitude, fine.amplitude, 0.02 * fine.amplitude);
  EXPECT_NEAR(coarse.period, fine.period, 0.02 * fine.period);
}

}  // namespace
}  // namespace esmc::host
