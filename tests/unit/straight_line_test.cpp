// The generated five-bar (tests/symbolic/straight_line.cpp) against the plant, which is Lagrange's equations
// with multipliers in other coordinates; the generated laws against those they are yardsticks of.

#include <gtest/gtest.h>

#include "host_sim/plant/plant.hpp"
#include "tests/benchmarks/hand_written.hpp"
#include "tests/benchmarks/straight_line.hpp"
#include "tests/support/random_mechanism.hpp"
#include "tests/support/tracking.hpp"

namespace esmc::test {
namespace {

TEST(StraightLine, IsThePlant) {
  Accuracy acceleration("acceleration");
  for (std::uint64_t seed = 0; seed < 2000; ++seed) {
    const auto c = random_five_bar<double>(seed, {.min_sin1 = 0.0, .min_sin2 = 0.2});
    Random r(~seed);
    const StraightLine straight(c.params);
    const host::FiveBarPlant plant(c.params);
    std::array<double, 4> theta{}, rate{}, torque{};
    for (std::size_t i = 0; i < 4; ++i) {
      theta[i] = c.theta[static_cast<int>(i)];
      rate[i] = c.theta_rate[static_cast<int>(i)];
      torque[i] = r.in<double>(-3, 3);
    }
    const auto s = host::FiveBarPlant::from_joints(theta, rate);
    const auto a = plant.acceleration(s.angle, s.rate, torque);
    const Vec<double, 4> want(a[0], a[1] - a[0], -a[2], a[2] - a[3]);
    const auto got = straight(theta, {rate[0], rate[2]}, torque);
    // At rest and without torque the weight alone: what a difference is measured against when forces cancel.
    acceleration.compare(seed, Vec<double, 4>(got[0], got[1], got[2], got[3]), want, 1);
  }
  acceleration.expect_below(1e-12);
}

TEST(StraightLine, LawsAreTheLaws) {
  Accuracy five_bar("five_bar"), arm("arm"), by_hand("by_hand");
  for (std::uint64_t seed = 0; seed < 500; ++seed) {
    auto c = random_tracking<double>(seed);
    auto p = c.now.params;
    for (auto& leg : p.legs) leg.d1 = leg.d2 = leg.gamma1 = leg.gamma2 = 0;
    const FiveBar<double> m(p);
    const auto want = [&](LawKind law) {
      return m
          .base_torque(c.t.pose,
                       m.force(demand(law, m, c.gain, Reaching::implicit, c.t).acceleration, c.t.rates))
          .eval();
    };
    const auto full = StraightEsmc(p, c.gain)(c.t), projected = StraightProjected(p, c.gain)(c.t);
    const Vec2<double> a = want(LawKind::esmc), b = want(LawKind::esmc_projected);
    five_bar.compare(seed, Vec<double, 4>(full[0], full[1], projected[0], projected[1]),
                     Vec<double, 4>(a[0], a[1], b[0], b[1]), 1);

    const RrParams<double> q{p.legs[0], p.g};
    const Rr<double> rr(q);
    Random r(seed);
    Tracking<Rr<double>> t{rr.pose(r.vector<double, 2>(3)),
                           {},
                           r.vector<double, 2>(5),
                           r.vector<double, 2>(5),
                           r.vector<double, 2>(50)};
    t.desired_pose = rr.pose(Rr<double>::angles(t.pose) + r.vector<double, 2>(0.5));
    Gains<Rr<double>> g;
    for (int i = 0; i < Rr<double>::channels; ++i) {
      g.lambda[i] = c.gain.lambda[i];
      g.k[i] = c.gain.k[i];
      g.layer[i] = c.gain.layer[i];
    }
    const auto got = StraightArm(q, g)(t);
    const Vec2<double> of_law = rr.base_torque(
        t.pose, rr.force(demand(LawKind::esmc, rr, g, Reaching::implicit, t).acceleration, t.rates));
    arm.compare(seed, Vec2<double>(got[0], got[1]), of_law, 1);
    const RrParams<double> rough{c.now.params.legs[0], p.g};  // with friction
    const Rr<double> whole(rough);
    std::array<double, 8> s{};
    const auto asked = demand<Rr<double>>(LawKind::esmc, whole, g, Reaching::implicit, t);
    Rr<double>::Channels acceleration, sliding;
    fused_acceleration(LawKind::esmc, whole, g, Reaching::implicit, t, acceleration, sliding);
    by_hand.compare(seed, HandWrittenArm(rough, g)(t, s),
                    whole.base_torque(t.pose, whole.force(asked.acceleration, t.rates)), 1);
    for (int i = 0; i < 8; ++i)
      EXPECT_NEAR(s[static_cast<std::size_t>(i)], sliding[i], 1e-11 * (1.0 + std::abs(sliding[i])))
          << seed << ' ' << i;
  }
  five_bar.expect_below(1e-11);
  arm.expect_below(1e-11);
  by_hand.expect_below(1e-11);
}

}  // namespace
}  // namespace esmc::test
