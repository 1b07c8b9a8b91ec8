#include "host_sim/plant/plant.hpp"

#include <cstddef>

namespace esmc::host {
namespace {

/// Solves S x = r. Where closure has lost its rank, S is singular and x not finite.
V2 solve(const LegDynamics<double>::Symmetric& s, V2 r) {
  const double inverse = 1.0 / (s.xx * s.yy - s.xy * s.xy);
  return {(s.yy * r.x - s.xy * r.y) * inverse, (s.xx * r.y - s.xy * r.x) * inverse};
}

// Both legs as one: bar k of leg 1 and of leg 2.
using Bars = LegDynamics<Two>::Pair;
Bars bars(const FiveBarPlant::Angles& a) { return {Two{a[0], a[2]}, Two{a[1], a[3]}}; }
Bars torques(const FiveBarPlant::Joints& t) { return {Two{t[0], t[2]}, Two{t[1], t[3]}}; }
FiveBarPlant::Angles angles(const Bars& b) { return {b.first[0], b.second[0], b.first[1], b.second[1]}; }
/// Leg 1 minus leg 2, their sum, and leg 1 alone.
V2 apart(const Planar<Two>& v) { return {v.x[0] - v.x[1], v.y[0] - v.y[1]}; }
V2 together(const Planar<Two>& v) { return {v.x[0] + v.x[1], v.y[0] + v.y[1]}; }
V2 first(const Planar<Two>& v) { return {v.x[0], v.y[0]}; }
double total(Two v) { return v[0] + v[1]; }

}  // namespace

LegDynamics<Two>::Pose FiveBarPlant::pose(const Angles& angle) const {
  const Bars b = bars(angle);
  return legs_.pose(direction(b.first), direction(b.second));
}

Bars FiveBarPlant::closing(const Legs::Pose& p, V2 gap) const {
  const auto m = legs_.tip_mobility(p);
  const V2 f = solve({total(m.xx), total(m.xy), total(m.yy)}, gap);
  const Bars b = Legs::solve(p, legs_.tip_force(p, {Two{f.x, f.x}, Two{f.y, f.y}}));
  constexpr Two sign{1.0, -1.0};
  return {sign * b.first, sign * b.second};
}

FiveBarPlant::Angles FiveBarPlant::acceleration(const Angles& angle, const Angles& rate,
                                                const Joints& torque) const {
  const Legs::Pose p = pose(angle);
  const Bars w = bars(rate), t = torques(torque);
  const Bars a = Legs::solve(p, legs_.force(p, w.first, w.second, t.first, t.second));
  // How far the tips would part, and the force between them that keeps them together.
  return angles(a - closing(p, apart(legs_.tip_rate(p, a) + legs_.tip_bias(p, w.first, w.second))));
}

FiveBarPlant::Angles FiveBarPlant::response(const Angles& angle, const Joints& torque) const {
  const Legs::Pose p = pose(angle);
  const Bars t = torques(torque);
  const Bars a = Legs::solve(p, legs_.on_bars(t.first, t.second));
  return angles(a - closing(p, apart(legs_.tip_rate(p, a))));
}

void FiveBarPlant::project(Angles& angle, Angles& rate) const {
  // One Newton step: an integrator leaves a gap of its own local error e, and this one leaves e^2. Repeated
  // only where that is not yet nothing.
  constexpr double nothing = 4e-17;
  for (int round = 0; round < 4; ++round) {
    const Legs::Pose p = pose(angle);
    const Bars w = bars(rate);
    rate = angles(w - closing(p, apart(legs_.tip_rate(p, w))));
    const V2 gap = apart(legs_.tip(p.e1, p.e2));
    const double size = std::abs(gap.x) + std::abs(gap.y);
    if (size <= nothing) return;
    angle = angles(bars(angle) - closing(p, gap));
    if (size < 1e-9) return;
  }
}

EffectorPoint FiveBarPlant::effector_point(const Angles& angle, const Angles& rate) const {
  const Legs::Pose p = pose(angle);
  const auto torque = legs_.torque_per_force(p);
  return {first(legs_.tip(p.e1, p.e2)), first(legs_.tip_rate(p, bars(rate))), {first(torque[0]), first(torque[1])}};
}

FiveBarPlant::Output FiveBarPlant::output(const State& s) const {
  const Legs::Pose p = pose(s.angle);
  const Planar<Two> tip = legs_.tip(p.e1, p.e2);
  const V2 gap = apart(tip), x = 0.5 * together(tip), v = 0.5 * together(legs_.tip_rate(p, bars(s.rate)));
  const Joints theta = joint_angles(s.angle), w = joint_rates(s.rate);
  return {{x.x, x.y, theta[0], theta[1], theta[2], theta[3]},
          {v.x, v.y, w[0], w[1], w[2], w[3]},
          x,
          v,
          std::sqrt(dot(gap, gap))};
}

V2 FiveBarPlant::effector(const Angles& angle) const {
  const Legs::Pose p = pose(angle);
  return 0.5 * together(legs_.tip(p.e1, p.e2));
}

V2 FiveBarPlant::effector_rate(const Angles& angle, const Angles& rate) const {
  return 0.5 * together(legs_.tip_rate(pose(angle), bars(rate)));
}

double FiveBarPlant::kinetic_energy(const State& s) const {
  const Legs::Pose p = pose(s.angle);
  const Bars w = bars(s.rate);
  return total(legs_.kinetic(p.e1, p.e2, w.first, w.second));
}

double FiveBarPlant::potential_energy(const State& s) const {
  const Legs::Pose p = pose(s.angle);
  return total(legs_.potential(p.e1, p.e2));
}

LegDynamics<double>::Pose RrPlant::pose(const Angles& angle) const {
  return leg_.pose(direction(angle[0]), direction(angle[1]));
}

RrPlant::Angles RrPlant::acceleration(const Angles& angle, const Angles& rate, const Joints& torque) const {
  const LegDynamics<double>::Pose p = pose(angle);
  const auto a = LegDynamics<double>::solve(p, leg_.force(p, rate[0], rate[1], torque[0], torque[1]));
  return {a.first, a.second};
}

RrPlant::Angles RrPlant::response(const Angles& angle, const Joints& torque) const {
  const auto a = LegDynamics<double>::solve(pose(angle), leg_.on_bars(torque[0], torque[1]));
  return {a.first, a.second};
}

EffectorPoint RrPlant::effector_point(const Angles& angle, const Angles& rate) const {
  const LegDynamics<double>::Pose p = pose(angle);
  return {leg_.tip(p.e1, p.e2), leg_.tip_rate(p, {rate[0], rate[1]}), leg_.torque_per_force(p)};
}

RrPlant::Output RrPlant::output(const State& s) const {
  const LegDynamics<double>::Pose p = pose(s.angle);
  return {joint_angles(s.angle), joint_rates(s.rate), leg_.tip(p.e1, p.e2),
          leg_.tip_rate(p, {s.rate[0], s.rate[1]}), 0.0};
}

V2 RrPlant::effector(const Angles& angle) const {
  const LegDynamics<double>::Pose p = pose(angle);
  return leg_.tip(p.e1, p.e2);
}

V2 RrPlant::effector_rate(const Angles& angle, const Angles& rate) const {
  return leg_.tip_rate(pose(angle), {rate[0], rate[1]});
}

double RrPlant::kinetic_energy(const State& s) const {
  const auto p = pose(s.angle);
  return leg_.kinetic(p.e1, p.e2, s.rate[0], s.rate[1]);
}

double RrPlant::potential_energy(const State& s) const {
  const auto p = pose(s.angle);
  return leg_.potential(p.e1, p.e2);
}

}  // namespace esmc::host
