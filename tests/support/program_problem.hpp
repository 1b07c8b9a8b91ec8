#pragma once
/// Programs of moves for the planner, without a scene: mechanisms of the examples, and random ones.

#include "firmware/cycle/four_motors.hpp"
#include "host_sim/plan/plan.hpp"
#include "tests/support/random_mechanism.hpp"

namespace esmc::test {

inline FiveBarParams<double> five_bar_example() {
  const LegParams<double> leg{
      .l1 = 0.12, .l2 = 0.16, .lg1 = 0.06, .lg2 = 0.068, .m1 = 0.1, .m2 = 0.1, .J1 = 2e-4, .J2 = 7e-4};
  return {.l0 = 0.05, .m0 = 0.05, .g = 9.8, .legs = {leg, leg}};
}
inline RrParams<double> rr_example() {
  return {
      .arm =
          {.l1 = 0.30, .l2 = 0.25, .lg1 = 0.15, .lg2 = 0.11, .m1 = 1.2, .m2 = 0.8, .J1 = 0.01, .J2 = 0.0045},
      .g = 9.8};
}

/// A problem of the example in its usual mode, at rest at (x, y), m.
template <class M>
host::plan::Problem<M> at_rest(double x, double y, double torque_limit, bool all_motors = false) {
  host::plan::Problem<M> p;
  auto& c = p.controller;
  if constexpr (M::joints == 4) {
    c.mechanism = M(five_bar_example());
    c.mode = {{{1, 1}}, -1};
    if (all_motors) {
      c.motors = Motors::all;
      c.allocate = allocation_for<M>(Motors::all);
    }
  } else {
    c.mechanism = M(rr_example());
    c.mode = {1};
  }
  c.torque_limit.setConstant(torque_limit);
  c.torque_weight.setOnes();
  c.limits.min_abs_sin_type1 = 0.02;
  c.limits.min_abs_sin_type2 = M::has_type2 ? 0.05 : 0.0;
  c.limits.joint_speed = 1e3;
  c.sample_time = p.tick = 1e-3;
  p.start = {x, y};
  return p;
}

inline host::MoveScene move(host::MoveKind kind, double a, double b) {
  host::MoveScene m;
  m.kind = kind;
  m.to = {a, b};
  m.where[""] = "test";
  return m;
}

}  // namespace esmc::test
