/// A mechanism that the library does not have: a carriage on a horizontal rail, and hanging from it an arm of
/// two bars. Three joints, all driven. docs/extending.md explains it.

#include <Eigen/LU>
#include <cmath>
#include <cstdio>

#include "firmware/control/reaching.hpp"
#include "firmware/mechanism/serial.hpp"

using Slide = esmc::Link<esmc::Joint::prismatic>;
using Hinge = esmc::Link<esmc::Joint::revolute>;
using Gantry = esmc::Serial<double, Slide, Hinge, Hinge>;
using Joints = Gantry::Joints;      // m, rad, rad
using Channels = Gantry::Channels;  // joint rates; bar rates; velocities of the mass centres

using Body = esmc::Body<double>;  // m, kg, kg m2, N s/m or N m s/rad
const Gantry gantry({{Body{.length = 0.0, .centre = 0.0, .mass = 2.0, .inertia = 0.0, .viscous = 4.0},
                      Body{.length = 0.3, .centre = 0.15, .mass = 0.8, .inertia = 0.006, .viscous = 0.02},
                      Body{.length = 0.25, .centre = 0.11, .mass = 0.5, .inertia = 0.003, .viscous = 0.02}}},
                    9.81);

struct Motion {
  Joints q, qd, qdd;
};

/// ESMC, [F29], for whatever the mechanism is: an error, a surface and a switching term in every channel.
Joints esmc_law(const Motion& desired, const Joints& q, const Joints& qd) {
  constexpr double lambda = 20.0, k = 60.0, layer = 0.5;
  const Gantry::Pose now = Gantry::pose(q), want = Gantry::pose(desired.q);
  const Channels e = gantry.error(want, now);
  const Channels ed = gantry.rates(want, desired.qd) - gantry.rates(now, qd);
  const Channels sw = (ed + lambda * e).unaryExpr([](double s) { return esmc::saturated(s, layer); });
  const Channels reference = gantry.rates(want, desired.qdd) + gantry.bias(want, desired.qd, desired.qd);
  return gantry.joint_torques(now, gantry.force(reference + lambda * ed + k * sw, qd));
}

/// Accelerations under joint forces, from the same parts: H column by column. A plant of its own right is
/// written independently, as host_sim/plant is; here it only closes the loop.
Joints acceleration(const Joints& q, const Joints& qd, const Joints& tau) {
  const Gantry::Pose p = Gantry::pose(q);
  const auto forces = [&](const Channels& v, const Joints& rates) -> Joints {
    return gantry.joint_torques(p, gantry.force(v, rates));
  };
  const Joints weight = forces(Channels::Zero(), Joints::Zero());
  esmc::Mat<double, 3, 3> H;
  for (int i = 0; i < 3; ++i) H.col(i) = forces(gantry.rates(p, Joints::Unit(i)), Joints::Zero()) - weight;
  return H.inverse() * (tau - forces(gantry.bias(p, qd, qd), qd));
}

Motion reference(double t) {
  const Joints amplitude(0.2, 0.6, 0.8), omega(2.0, 3.0, 5.0), middle(0.0, -1.6, 0.4);
  Motion m;
  for (int i = 0; i < 3; ++i) {
    m.q[i] = middle[i] + amplitude[i] * std::sin(omega[i] * t);
    m.qd[i] = amplitude[i] * omega[i] * std::cos(omega[i] * t);
    m.qdd[i] = -amplitude[i] * omega[i] * omega[i] * std::sin(omega[i] * t);
  }
  return m;
}

int main() {
  constexpr double step = 1e-3;
  Joints q = reference(0.0).q + Joints(0.05, -0.1, 0.1), qd = Joints::Zero();
  double worst = 0.0;
  for (int tick = 0; tick < 3000; ++tick) {
    const Joints tau = esmc_law(reference(tick * step), q, qd);
    for (int i = 0; i < 10; ++i) {  // semi-implicit Euler, ten steps per tick
      qd += acceleration(q, qd, tau) * (step / 10);
      q += qd * (step / 10);
    }
    if (tick >= 1000) worst = std::fmax(worst, (q - reference((tick + 1) * step).q).cwiseAbs().maxCoeff());
  }
  std::printf("largest error from 1 s on: %.2e m or rad\n", worst);
  return worst < 1e-3 ? 0 : 1;
}
