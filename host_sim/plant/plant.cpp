#include "host_sim/plant/plant.hpp"

#include <cstddef>

namespace esmc::host {
namespace {

using Pair = LegDynamics::Pair;

/// Solves S x = r. Where closure has lost its rank, S is singular and x not finite.
V2 solve(const LegDynamics::Symmetric& s, V2 r) {
  const double inverse = 1.0 / (s.xx * s.yy - s.xy * s.xy);
  return {(s.yy * r.x - s.xy * r.y) * inverse, (s.xx * r.y - s.xy * r.x) * inverse};
}

}  // namespace

/// Both legs' poses. Leg 1 closes with +, leg 2 with -.
struct FiveBarPlant::Poses {
  std::array<LegDynamics::Pose, 2> leg;
};

FiveBarPlant::Poses FiveBarPlant::poses(const Angles& angle) const {
  const auto d = directions(angle);
  return {{leg_[0].pose(d.cos[0], d.sin[0], d.cos[1], d.sin[1]),
           leg_[1].pose(d.cos[2], d.sin[2], d.cos[3], d.sin[3])}};
}

FiveBarPlant::Angles FiveBarPlant::acceleration(const Angles& angle, const Angles& rate,
                                                const Joints& torque) const {
  const Poses p = poses(angle);
  const Pair f1 = leg_[0].force(p.leg[0], rate[0], rate[1], torque[0], torque[1]);
  const Pair f2 = leg_[1].force(p.leg[1], rate[2], rate[3], torque[2], torque[3]);
  const Pair a1 = LegDynamics::solve(p.leg[0], f1), a2 = LegDynamics::solve(p.leg[1], f2);
  // How far the tips would part, and the force between them that keeps them together.
  const V2 gap = (leg_[0].tip_rate(p.leg[0], a1) + leg_[0].tip_bias(p.leg[0], rate[0], rate[1])) -
                 (leg_[1].tip_rate(p.leg[1], a2) + leg_[1].tip_bias(p.leg[1], rate[2], rate[3]));
  const V2 lambda = solve(leg_[0].tip_mobility(p.leg[0]) + leg_[1].tip_mobility(p.leg[1]), gap);
  const Pair b1 = LegDynamics::solve(p.leg[0], leg_[0].tip_force(p.leg[0], lambda));
  const Pair b2 = LegDynamics::solve(p.leg[1], leg_[1].tip_force(p.leg[1], lambda));
  return {a1.first - b1.first, a1.second - b1.second, a2.first + b2.first, a2.second + b2.second};
}

FiveBarPlant::Angles FiveBarPlant::response(const Angles& angle, const Joints& torque) const {
  const Poses p = poses(angle);
  const Pair a1 = LegDynamics::solve(p.leg[0], {torque[0] - torque[1], torque[1]});
  const Pair a2 = LegDynamics::solve(p.leg[1], {torque[3] - torque[2], -torque[3]});
  const V2 gap = leg_[0].tip_rate(p.leg[0], a1) - leg_[1].tip_rate(p.leg[1], a2);
  const V2 lambda = solve(leg_[0].tip_mobility(p.leg[0]) + leg_[1].tip_mobility(p.leg[1]), gap);
  const Pair b1 = LegDynamics::solve(p.leg[0], leg_[0].tip_force(p.leg[0], lambda));
  const Pair b2 = LegDynamics::solve(p.leg[1], leg_[1].tip_force(p.leg[1], lambda));
  return {a1.first - b1.first, a1.second - b1.second, a2.first + b2.first, a2.second + b2.second};
}

void FiveBarPlant::project(Angles& angle, Angles& rate) const {
  // One Newton step: an integrator leaves a gap of its own local error e, and this one leaves e^2. Repeated
  // only where that is not yet nothing.
  constexpr double nothing = 4e-17;
  for (int round = 0; round < 4; ++round) {
    const Poses p = poses(angle);
    const auto mobility = leg_[0].tip_mobility(p.leg[0]) + leg_[1].tip_mobility(p.leg[1]);
    const auto subtract = [&](Angles& from, V2 gap) {
      const V2 lambda = solve(mobility, gap);
      const Pair b1 = LegDynamics::solve(p.leg[0], leg_[0].tip_force(p.leg[0], lambda));
      const Pair b2 = LegDynamics::solve(p.leg[1], leg_[1].tip_force(p.leg[1], lambda));
      from = {from[0] - b1.first, from[1] - b1.second, from[2] + b2.first, from[3] + b2.second};
    };
    subtract(rate,
             leg_[0].tip_rate(p.leg[0], {rate[0], rate[1]}) - leg_[1].tip_rate(p.leg[1], {rate[2], rate[3]}));
    const V2 gap = leg_[0].tip(p.leg[0].e1, p.leg[0].e2) - leg_[1].tip(p.leg[1].e1, p.leg[1].e2);
    const double size = std::abs(gap.x) + std::abs(gap.y);
    if (size <= nothing) return;
    subtract(angle, gap);
    if (size < 1e-9) return;
  }
}

EffectorPoint FiveBarPlant::effector_point(const Angles& angle, const Angles& rate) const {
  const auto d = directions(std::array<double, 2>{angle[0], angle[1]});
  const LegDynamics::Pose p = leg_[0].pose(d.cos[0], d.sin[0], d.cos[1], d.sin[1]);
  return {leg_[0].tip(p.e1, p.e2), leg_[0].tip_rate(p, {rate[0], rate[1]}), leg_[0].torque_per_force(p)};
}

FiveBarPlant::Output FiveBarPlant::output(const State& s) const {
  const Poses p = poses(s.angle);
  const V2 tip1 = leg_[0].tip(p.leg[0].e1, p.leg[0].e2), tip2 = leg_[1].tip(p.leg[1].e1, p.leg[1].e2),
           gap = tip1 - tip2;
  const V2 x = 0.5 * (tip1 + tip2);
  const V2 v = 0.5 * (leg_[0].tip_rate(p.leg[0], {s.rate[0], s.rate[1]}) +
                      leg_[1].tip_rate(p.leg[1], {s.rate[2], s.rate[3]}));
  const Joints theta = joint_angles(s.angle), w = joint_rates(s.rate);
  return {{x.x, x.y, theta[0], theta[1], theta[2], theta[3]},
          {v.x, v.y, w[0], w[1], w[2], w[3]},
          x,
          v,
          std::sqrt(dot(gap, gap))};
}

V2 FiveBarPlant::effector(const Angles& angle) const {
  const Poses p = poses(angle);
  return 0.5 * (leg_[0].tip(p.leg[0].e1, p.leg[0].e2) + leg_[1].tip(p.leg[1].e1, p.leg[1].e2));
}

V2 FiveBarPlant::effector_rate(const Angles& angle, const Angles& rate) const {
  const Poses p = poses(angle);
  return 0.5 *
         (leg_[0].tip_rate(p.leg[0], {rate[0], rate[1]}) + leg_[1].tip_rate(p.leg[1], {rate[2], rate[3]}));
}

double FiveBarPlant::kinetic_energy(const State& s) const {
  const auto d = directions(s.angle);
  return leg_[0].kinetic({d.cos[0], d.sin[0]}, {d.cos[1], d.sin[1]}, s.rate[0], s.rate[1]) +
         leg_[1].kinetic({d.cos[2], d.sin[2]}, {d.cos[3], d.sin[3]}, s.rate[2], s.rate[3]);
}

double FiveBarPlant::potential_energy(const State& s) const {
  const auto d = directions(s.angle);
  return leg_[0].potential({d.cos[0], d.sin[0]}, {d.cos[1], d.sin[1]}) +
         leg_[1].potential({d.cos[2], d.sin[2]}, {d.cos[3], d.sin[3]});
}

LegDynamics::Pose RrPlant::pose(const Angles& angle) const {
  const auto d = directions(angle);
  return leg_.pose(d.cos[0], d.sin[0], d.cos[1], d.sin[1]);
}

RrPlant::Angles RrPlant::acceleration(const Angles& angle, const Angles& rate, const Joints& torque) const {
  const LegDynamics::Pose p = pose(angle);
  const Pair a = LegDynamics::solve(p, leg_.force(p, rate[0], rate[1], torque[0], torque[1]));
  return {a.first, a.second};
}

RrPlant::Angles RrPlant::response(const Angles& angle, const Joints& torque) const {
  const Pair a = LegDynamics::solve(pose(angle), {torque[0] - torque[1], torque[1]});
  return {a.first, a.second};
}

EffectorPoint RrPlant::effector_point(const Angles& angle, const Angles& rate) const {
  const LegDynamics::Pose p = pose(angle);
  return {leg_.tip(p.e1, p.e2), leg_.tip_rate(p, {rate[0], rate[1]}), leg_.torque_per_force(p)};
}

RrPlant::Output RrPlant::output(const State& s) const {
  const LegDynamics::Pose p = pose(s.angle);
  return {joint_angles(s.angle), joint_rates(s.rate), leg_.tip(p.e1, p.e2),
          leg_.tip_rate(p, {s.rate[0], s.rate[1]}), 0.0};
}

V2 RrPlant::effector(const Angles& angle) const {
  const LegDynamics::Pose p = pose(angle);
  return leg_.tip(p.e1, p.e2);
}

V2 RrPlant::effector_rate(const Angles& angle, const Angles& rate) const {
  return leg_.tip_rate(pose(angle), {rate[0], rate[1]});
}

double RrPlant::kinetic_energy(const State& s) const {
  const auto d = directions(s.angle);
  return leg_.kinetic({d.cos[0], d.sin[0]}, {d.cos[1], d.sin[1]}, s.rate[0], s.rate[1]);
}

double RrPlant::potential_energy(const State& s) const {
  const auto d = directions(s.angle);
  return leg_.potential({d.cos[0], d.sin[0]}, {d.cos[1], d.sin[1]});
}

}  // namespace esmc::host
