#pragma once
/// Random problems of robust design: any mechanism, mode and motion, friction and payload or none, narrow or
/// wide intervals.

#include "tests/support/robust_condition.hpp"

namespace esmc::test {

inline host::Interval random_interval(Random& r, double centre, double half) {
  return {centre - half * r.in<double>(0, 1), centre + half * r.in<double>(0, 1)};
}

/// Every second seed of one cause alone, the six in turn: where others are as large, a term could be missing
/// and nobody would see.
inline host::UncertaintyScene random_uncertainty(std::uint64_t seed, Random& r, double size, bool friction) {
  using host::design::Cause;
  const auto alone = static_cast<Cause>((seed / 2) % static_cast<std::uint64_t>(Cause::count));
  const auto has = [&](Cause c, double chance) { return seed % 2 == 1 ? c == alone : r.chance(chance); };
  host::UncertaintyScene u;
  if (has(Cause::mass, 1.0)) {
    u.m1 = random_interval(r, 1.0, size);
    u.m2 = random_interval(r, 1.0, size);
  }
  if (has(Cause::inertia, 1.0)) {
    u.J1 = random_interval(r, 1.0, size);
    u.J2 = random_interval(r, 1.0, size);
  }
  if (has(Cause::gravity, 0.3)) u.gravity = random_interval(r, 1.0, 0.05);
  if (has(Cause::mass_centre, 0.7)) {
    u.lg1 = random_interval(r, 0.0, 0.1 * size);
    u.lg2 = random_interval(r, 0.0, 0.1 * size);
  }
  if (has(Cause::payload, 0.5)) u.payload = {0.0, r.in<double>(0.0, 0.5 * size)};
  if (has(Cause::friction, friction ? 1.0 : 0.0)) {
    u.viscous.emplace();
    u.coulomb.emplace();
    for (auto& i : *u.viscous) i = {0.0, r.in<double>(0.0, 0.03)};
    for (auto& i : *u.coulomb) i = {0.0, r.in<double>(0.0, 0.05)};
  }
  u.reaching_time = r.in<double>(0.1, 1.0);
  u.tube = r.in<double>(0.001, 0.006);
  return u;
}

/// An ellipse around a random state.
template <class M>
host::design::Problem<M> around(Random& r, const Vec2<double>& centre, double size, ReferenceSpace space) {
  host::design::Problem<M> p;
  auto& c = p.controller;
  c.reaching = Reaching::sign;
  c.sample_time = 1e-3;
  c.torque_limit.setConstant(1e6);
  c.limits.min_abs_sin_type1 = 0.02;
  c.limits.min_abs_sin_type2 = M::has_type2 ? 0.02 : 0.0;
  c.limits.joint_speed = 1e3;
  const double lambda = r.in<double>(10, 60);
  c.gains.lambda.setConstant(lambda);
  c.gains.layer.setConstant(0.05);
  c.gains.independent = {lambda, 0.0, 0.05, 0.0, 0.0};
  c.reference.space = space;
  const double speed = r.in<double>(0, 8), tilt = r.in<double>(0, 3.1);
  constexpr int points = 96;
  for (int n = 0; n < points; ++n) {
    const double a = 6.283185307179586 * n / points;
    const Vec2<double> x(std::cos(a), 0.6 * std::sin(a + tilt)), v(-std::sin(a), 0.6 * std::cos(a + tilt));
    const Motion2<double> m{centre + x * size, v * (size * speed), x * (-size * speed * speed)};
    p.points.push_back({a / std::max(speed, 0.1), m, m});
  }
  p.start = p.points.front().now;
  return p;
}

/// `law` esmc, esmc_projected or smc. Eight seeds in a row have all modes of the five-bar.
inline host::design::Problem<FiveBar<double>> random_problem(std::uint64_t seed, LawKind law,
                                                             const FiveBar<double>*) {
  const auto of = random_five_bar<double>(seed, {.min_sin1 = 0.4, .min_sin2 = 0.4});
  Random r(seed ^ 0xd5U);
  auto p = around<FiveBar<double>>(r, of.position, 0.015, ReferenceSpace::effector);
  p.believed = of.params;
  const bool known_friction = r.chance(0.3);
  for (auto& leg : p.believed.legs) {
    if (!known_friction) leg.d1 = leg.d2 = leg.gamma1 = leg.gamma2 = 0.0;
  }
  p.controller.mechanism = FiveBar<double>(p.believed);
  p.controller.mode = of.mode;
  p.controller.law = law;
  p.uncertainty = random_uncertainty(seed, r, law == LawKind::smc ? 0.06 : 0.3, r.chance(0.6));
  return p;
}
inline host::design::Problem<Rr<double>> random_problem(std::uint64_t seed, LawKind law, const Rr<double>*) {
  const auto of = random_rr<double>(seed, 0.4);
  Random r(seed ^ 0xd5U);
  auto p = around<Rr<double>>(r, of.theta, 0.1, ReferenceSpace::base_joints);
  p.believed.legs = {of.params.arm, of.params.arm};
  p.believed.g = of.params.g;
  const bool known_friction = r.chance(0.3);
  for (auto& leg : p.believed.legs) {
    if (!known_friction) leg.d1 = leg.d2 = leg.gamma1 = leg.gamma2 = 0.0;
  }
  p.controller.mechanism = Rr<double>({p.believed.legs[0], p.believed.g});
  p.controller.mode.working = std::sin(of.theta[1]) > 0 ? 1 : -1;
  p.controller.law = law;
  p.uncertainty = random_uncertainty(seed, r, law == LawKind::smc ? 0.06 : 0.3, r.chance(0.6));
  p.uncertainty.tube = r.in<double>(0.005, 0.03);
  return p;
}

}  // namespace esmc::test
