#pragma once
/// The law of the five-bar on its plant, sampled: exact measurements of all joints, a torque per tick.

#include "firmware/control/law.hpp"
#include "firmware/cycle/estimate.hpp"
#include "host_sim/plant/kinematics.hpp"
#include "host_sim/plant/plant.hpp"

namespace esmc::test {

/// Gains of the scene five_bar_pick_and_place, all rows alike.
inline Gains<FiveBar<double>> usual_gains(double tick) {
  Gains<FiveBar<double>> g;
  g.lambda.setConstant(60.0);
  g.k.setConstant(150.0);
  g.layer.setConstant(implicit_layer(150.0, tick, 0.0));
  return g;
}

/// What the law gets: the measured state and the wanted motion of the effector, which must be in reach.
template <class Output>
Tracking<FiveBar<double>> track(const FiveBar<double>& model, const FiveBar<double>::Mode& mode,
                                const Output& o, const Motion2<double>& wanted) {
  Tracking<FiveBar<double>> t;
  t.pose = model.pose({o.q[2], o.q[3], o.q[4], o.q[5]});
  t.rates.platform = {o.qd[0], o.qd[1]};
  t.rates.leg = {{Vec2<double>(o.qd[2], o.qd[3]), Vec2<double>(o.qd[4], o.qd[5])}};
  const auto d =
      desired_at_effector(model, mode, wanted.position, wanted.velocity, wanted.acceleration).value();
  t.desired_pose = d.pose;
  t.desired_rates = d.rates;
  t.desired_acceleration = d.acceleration;
  return t;
}

/// A tick of the plant, s, under the torques of the base motors, N m.
inline void advance(const host::FiveBarPlant& plant, host::FiveBarPlant::State& s, const Vec2<double>& tau,
                    double tick) {
  constexpr int parts = 4;
  const double h = tick / parts;
  for (int part = 0; part < parts; ++part) {  // midpoint rule
    host::FiveBarPlant::State middle = s;
    const auto a = plant.acceleration(s.angle, s.rate, {tau[0], 0.0, tau[1], 0.0});
    for (std::size_t i = 0; i < 4; ++i) {
      middle.angle[i] += 0.5 * h * s.rate[i];
      middle.rate[i] += 0.5 * h * a[i];
    }
    plant.project(middle.angle, middle.rate);
    const auto b = plant.acceleration(middle.angle, middle.rate, {tau[0], 0.0, tau[1], 0.0});
    for (std::size_t i = 0; i < 4; ++i) {
      s.angle[i] += h * middle.rate[i];
      s.rate[i] += h * b[i];
    }
    plant.project(s.angle, s.rate);
  }
}

}  // namespace esmc::test
