#include "host_sim/plant/plant.hpp"

namespace esmc::host {

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
