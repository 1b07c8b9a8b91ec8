#include "host_sim/plant/plant.hpp"

#include <cstddef>

namespace esmc::host {

/// The closure Jacobian A = [a0 a1 a2 a3] (2 x 4, tip 1 minus tip 2), Z = M^-1 A^T by legs, and (A Z)^-1.
struct FiveBarPlant::Frame {
  std::array<LegDynamics::Terms, 2> t;
  std::array<V2, 4> a;       // columns of A
  std::array<V2, 4> z;       // row i: what a unit multiplier in x, in y accelerates psi_i by
  double inv_xx, inv_xy, inv_yy;

  [[nodiscard]] V2 multiplier(V2 r) const { return {inv_xx * r.x + inv_xy * r.y, inv_xy * r.x + inv_yy * r.y}; }
  [[nodiscard]] V2 times_a(const Angles& v) const {
    V2 out;
    for (std::size_t i = 0; i < 4; ++i) out = out + v[i] * a[i];
    return out;
  }
  void subtract(Angles& v, V2 lambda) const {
    for (std::size_t i = 0; i < 4; ++i) v[i] -= z[i].x * lambda.x + z[i].y * lambda.y;
  }
};

FiveBarPlant::Frame FiveBarPlant::frame(const State& s) const {
  Frame f{};
  double xx = 0.0, xy = 0.0, yy = 0.0;
  for (std::size_t j = 0; j < 2; ++j) {
    const std::size_t i = 2 * j;
    f.t[j] = leg_[j].terms(s.angle[i], s.angle[i + 1], s.rate[i], s.rate[i + 1]);
    const double sign = j == 0 ? 1.0 : -1.0;
    f.a[i] = sign * leg_[j].column1(f.t[j]);
    f.a[i + 1] = sign * leg_[j].column2(f.t[j]);
    const V2 zx = leg_[j].solve(f.t[j], f.a[i].x, f.a[i + 1].x);
    const V2 zy = leg_[j].solve(f.t[j], f.a[i].y, f.a[i + 1].y);
    f.z[i] = {zx.x, zy.x};
    f.z[i + 1] = {zx.y, zy.y};
    xx += f.a[i].x * zx.x + f.a[i + 1].x * zx.y;
    xy += f.a[i].y * zx.x + f.a[i + 1].y * zx.y;
    yy += f.a[i].y * zy.x + f.a[i + 1].y * zy.y;
  }
  const double inverse = 1.0 / (xx * yy - xy * xy);
  f.inv_xx = yy * inverse;
  f.inv_xy = -xy * inverse;
  f.inv_yy = xx * inverse;
  return f;
}

FiveBarPlant::Angles FiveBarPlant::acceleration(const State& s, const Joints& torque) const {
  Frame f = frame(s);
  Angles a{};
  for (std::size_t j = 0; j < 2; ++j) {
    leg_[j].add_torque(f.t[j], torque[2 * j], torque[2 * j + 1]);
    const V2 free = leg_[j].solve(f.t[j], f.t[j].q1, f.t[j].q2);
    a[2 * j] = free.x;
    a[2 * j + 1] = free.y;
  }
  // A a = -(tip 1 acceleration at constant rates - that of tip 2)
  const V2 gap = f.times_a(a) + (f.t[0].along - f.t[1].along);
  f.subtract(a, f.multiplier(gap));
  return a;
}

void FiveBarPlant::project(State& s) const {
  // One Newton step: an integrator leaves a gap of its own local error e, and this one leaves e^2. Repeated only
  // where that is not yet nothing.
  constexpr double nothing = 4e-17;
  for (int round = 0; round < 4; ++round) {
    const Frame f = frame(s);
    const V2 gap = leg_[0].tip(f.t[0]) - leg_[1].tip(f.t[1]);
    f.subtract(s.rate, f.multiplier(f.times_a(s.rate)));
    const double size = std::abs(gap.x) + std::abs(gap.y);
    if (size <= nothing) return;
    f.subtract(s.angle, f.multiplier(gap));
    if (size < 1e-9) return;
  }
}

double FiveBarPlant::closure(const State& s) const {
  const V2 gap = leg_[0].tip(leg_[0].terms(s.angle[0], s.angle[1], 0, 0)) -
                 leg_[1].tip(leg_[1].terms(s.angle[2], s.angle[3], 0, 0));
  return std::hypot(gap.x, gap.y);
}

FiveBarPlant::Output FiveBarPlant::output(const State& s) const {
  std::array<V2, 2> tip, rate;
  for (std::size_t j = 0; j < 2; ++j) {
    const auto t = leg_[j].terms(s.angle[2 * j], s.angle[2 * j + 1], 0, 0);
    tip[j] = leg_[j].tip(t);
    rate[j] = s.rate[2 * j] * leg_[j].column1(t) + s.rate[2 * j + 1] * leg_[j].column2(t);
  }
  const V2 x = 0.5 * (tip[0] + tip[1]), v = 0.5 * (rate[0] + rate[1]);
  const Joints theta = joint_angles(s.angle), w = joint_rates(s.rate);
  return {{x.x, x.y, theta[0], theta[1], theta[2], theta[3]}, {v.x, v.y, w[0], w[1], w[2], w[3]}};
}

double FiveBarPlant::kinetic_energy(const State& s) const {
  double e = 0.0;
  for (std::size_t j = 0; j < 2; ++j) {
    const auto t = leg_[j].terms(s.angle[2 * j], s.angle[2 * j + 1], 0, 0);
    e += leg_[j].kinetic(t, s.rate[2 * j], s.rate[2 * j + 1]);
  }
  return e;
}

double FiveBarPlant::potential_energy(const State& s) const {
  double e = 0.0;
  for (std::size_t j = 0; j < 2; ++j) e += leg_[j].potential(leg_[j].terms(s.angle[2 * j], s.angle[2 * j + 1], 0, 0));
  return e;
}

}  // namespace esmc::host
