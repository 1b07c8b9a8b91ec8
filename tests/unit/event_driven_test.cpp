/// event_driven on plants whose answer is known in closed form: two bars without coupling, so that joint 1 is
/// a single inertia; and a five-bar that four joints hold.

#include <gtest/gtest.h>

#include <cmath>

#include "host_sim/plant/motion.hpp"

namespace esmc::host {
namespace {

constexpr double inertia = 1e-3;  // kg m2, of bar 1

Motion<RrPlant> wheel(const std::vector<Effect>& effects, double angle, double rate,
                      const Resolution& resolution = {}) {
  const RrPlant plant(RrParams<double>{{0.1, 0.1, 0, 0, 0, 0, inertia, 2e-3}, 0.0});
  return {{plant, plant, effects, {0}, Method::event_driven, resolution},
          RrPlant::from_joints({angle, 1.0}, {rate, -rate})};
}
MotorTorques<RrPlant::Joints> torque(double tau) { return {{tau, 0.0}, nullptr}; }

TEST(EventDriven, FrictionStopsWhereItShouldWhateverTheStep) {
  for (const Between between :
       {Between::midpoint, Between::heun3, Between::rk4, Between::dopri5, Between::dopri8, Between::radau5}) {
    for (const int steps : {3, 70, 1000}) {
      auto m = wheel({CoulombFriction{{0.05, 0.0}}}, 0.0, 10.0, {between});
      EXPECT_EQ(m.method(), Method::event_driven);
      m.advance(0.0, 0.3, steps, torque(0.0));
      EXPECT_EQ(m.state().rate[0], 0.0);
      EXPECT_NEAR(m.state().angle[0], 1.0, 1e-11);  // v^2 / (2 a)
      EXPECT_EQ(m.effort().events.stick, 1);
      EXPECT_LT(m.energy_error(), 1e-11);
    }
  }
}

TEST(EventDriven, AHeldJointRestsUntilItsTickBreaksItAway) {
  auto m = wheel({CoulombFriction{{0.05, 0.1}}}, 0.3, 0.0);
  for (int s = 0; s < 1000; ++s) m.advance(s, 1.0, 10, torque(0.0499999));
  EXPECT_EQ(m.state().angle[0], 0.3);
  EXPECT_EQ(m.state().rate[0], 0.0);
  m.advance(1000, 0.1, 10, torque(0.0501));  // joint 2 stays held, so both bars turn
  EXPECT_NEAR(m.state().rate[0], 1e-4 / (inertia + 2e-3) * 0.1, 1e-12);
  EXPECT_EQ(m.state().rate[1], m.state().rate[0]);
}

TEST(EventDriven, ARigidStopReturnsItsPartOfTheSpeed) {
  auto m = wheel({EndStops{{-1, -9}, {0.5, 9}, {}, 0.6}}, 0.0, 5.0);
  m.advance(0.0, 0.3, 7, torque(0.0));
  EXPECT_NEAR(m.state().rate[0], -3.0, 1e-12);
  EXPECT_NEAR(m.state().angle[0], 0.5 - 3.0 * (0.3 - 0.1), 1e-12);
  EXPECT_EQ(m.effort().events.impact, 1);
}

TEST(EventDriven, ACrowdOfImpactsIsSteppedAndThenLocatedAgain) {
  constexpr double half = 1e-3;  // between two stops that lose nothing: an impact every 0.4 ms
  auto m = wheel({EndStops{{-half, -9}, {half, 9}, {}, 1.0}}, 0.0, 5.0);
  m.advance(0.0, 0.3, 1, torque(0.0));
  EXPECT_EQ(m.effort().events.crowded, 1);
  EXPECT_EQ(m.effort().events.impact, 200);  // which make a crowd
  EXPECT_LE(std::abs(m.state().angle[0]), half + 1e-9);
  EXPECT_NEAR(std::abs(m.state().rate[0]), 5.0, 1e-9);
  m.advance(0.3, 0.01, 1, torque(0.0));
  EXPECT_EQ(m.effort().events.crowded, 1);
  EXPECT_NEAR(static_cast<double>(m.effort().events.impact), 200 + 0.01 * 5.0 / (2 * half), 1.0);
}

TEST(EventDriven, BouncesWithoutEndComeToRestInTime) {
  Resolution r;
  r.rebound_min = 1e-10;
  auto m = wheel({EndStops{{-1, -9}, {0.5, 9}, {}, 0.5}}, 0.5, -1.0, r);
  // Under a = 10 rad/s2 the flights take 2 v / a with v = 1, 1/2, 1/4 ...: 0.4 s in all.
  m.advance(0.0, 0.399, 399, torque(0.01));
  EXPECT_EQ(m.effort().events.accumulated, 0);
  m.advance(0.399, 0.011, 11, torque(0.01));
  EXPECT_EQ(m.effort().events.accumulated, 1);
  EXPECT_EQ(m.state().rate[0], 0.0);
  EXPECT_NEAR(m.state().angle[0], 0.5, 1e-12);
  m.advance(0.410, 0.1, 1, torque(-0.01));  // and it is let go
  EXPECT_NEAR(m.state().angle[0], 0.5 - 0.5 * 10.0 * 0.01, 1e-12);
}

TEST(EventDriven, ASoftStopThatReturnsNothingHoldsAtItsDepth) {
  auto m = wheel({EndStops{{-1, -9}, {0.5, 9}, 100.0, 0.0}}, 0.45, 2.0);
  m.advance(0.0, 1.0, 4000, torque(0.2));
  EXPECT_EQ(m.state().rate[0], 0.0);
  // I v^2 / 2 + tau (0.05 + x) = k x^2 / 2
  const double energy = 0.5 * inertia * 4.0 + 0.2 * 0.05,
               x = (0.2 + std::sqrt(0.04 + 200.0 * energy)) / 100.0;
  EXPECT_NEAR(m.state().angle[0], 0.5 + x, 1e-8);
}

TEST(EventDriven, FourStuckJointsHoldAFiveBarAndAPayload) {
  const LegParams<double> leg{0.12, 0.16, 0.06, 0.068, 0.1, 0.1, 2e-4, 7e-4};
  const FiveBarParams<double> p{0.05, 0.1, 9.8, {{leg, leg}}};
  const FiveBarPlant plant(p), loaded(p, 0.2);
  const FiveBarPlant::State start = FiveBarPlant::from_joints({0.8, 1.2, 0.8, 1.2}, {});
  Motion<FiveBarPlant> m({plant,
                          loaded,
                          {CoulombFriction{{1.0, 0.2, 1.0, 0.2}}, Payload{0.2, 0.25, 0.75}},
                          {0, 2},
                          Method::event_driven},
                         start);
  const auto held = m.state().angle;
  for (int n = 0; n < 1000; ++n) m.advance(n * 1e-3, 1e-3, 1, {});
  EXPECT_EQ(m.state().angle, held);
  for (const double w : m.state().rate) EXPECT_EQ(w, 0.0);
  m.advance(1.0, 1e-3, 1, {{5.0, 0.0, 0.0, 0.0}, nullptr});  // more than all of them can hold
  EXPECT_GT(m.state().rate[0], 0.1);
}

}  // namespace
}  // namespace esmc::host
