#include "host_sim/problems/problems.hpp"

#include <cmath>

namespace esmc::host {

namespace {

constexpr double quarter = 1.57079632679489661923;  // pi / 2

Body<double> body(double length, double centre, double across, double mass, double inertia) {
  return {length, centre, across, mass, inertia, 0.0, 0.0};
}
Body<double> rod() { return body(1.0, 0.5, 0.0, 1.0, 1.0 / 12.0); }

}  // namespace

Andrews::Andrews()
    : ChainSystem([] {
        const Serial<double, Bar, Bar> crank_and_rod(  // the rod points backwards
            {{body(0.007, 0.00092, 0.0, 0.04325, 2.194e-6), body(-0.028, -0.0115, 0.0, 0.00365, 4.410e-7)}},
            0.0);
        const Serial<double, Plate> k3({{body(0.035, 0.01874, 0.01043, 0.02373, 5.255e-6)}}, 0.0);
        const Serial<double, Plate, Bar> k5_k4({{body(0.04, 0.02308, 0.00916, 0.07050, 1.169e-5),
                                                 body(0.02, 0.02 - 0.01421, 0.0, 0.00706, 5.667e-7)}},
                                               0.0);
        const Serial<double, Plate, Bar> k7_k6({{body(0.04, 0.01228, -0.00449, 0.05498, 1.912e-5),
                                                 body(0.02, 0.02 - 0.01421, 0.0, 0.00706, 5.667e-7)}},
                                               0.0);
        AndrewsChains::Mounting m;
        const Vec2<double> a(-0.06934, -0.00227);
        m.base = {{Vec2<double>::Zero(), Vec2<double>(-0.03635, 0.03273), a, a}};
        // The literature counts these angles from another axis of the body.
        m.zero[gamma] = m.zero[phi] = m.zero[epsilon] = -quarter;
        m.zero[omega] = quarter;
        return AndrewsChains(crank_and_rod, k3, k5_k4, k7_k6, m);
      }()) {}

Andrews::State Andrews::start() const {
  State y{};
  y[beta] = -0.0617138900142764496358948458001;
  y[theta] = 0.0;
  y[gamma] = 0.455279819163070380255912382449;
  y[phi] = 0.222668390165885884674473185609;
  y[delta] = 0.487364979543842550225598953530;
  y[omega] = -0.222668390165885884674473185609;
  y[epsilon] = 1.23054744454982119249735015568;
  return y;
}

TwoFourBars::TwoFourBars()
    : ChainSystem([] {
        const Serial<double, Bar, Bar> pair({{rod(), rod()}}, 9.81);
        const Serial<double, Bar> single({{rod()}}, 9.81);
        FourBarChain::Mounting m;
        m.base = {{Vec2<double>(0.0, 0.0), Vec2<double>(1.0, 0.0), Vec2<double>(2.0, 0.0)}};
        return FourBarChain(pair, single, pair, m);
      }()) {}

TwoFourBars::State TwoFourBars::start() const { return parallelogram(quarter, -1.0); }

TwoFourBars::State TwoFourBars::parallelogram(double angle, double rate) {
  return {angle, -angle, angle, angle, 2.0 * quarter - angle, rate, -rate, rate, rate, -rate};
}

void Pendulum::slope(double, const State& y, State& dy) {
  constexpr double g = 9.81;
  // Tension per mass and length: what the radial part of the acceleration has too much.
  const double pull = (y[2] * y[2] + y[3] * y[3] - g * y[1]) / (y[0] * y[0] + y[1] * y[1]);
  dy = {y[2], y[3], -pull * y[0], -g - pull * y[1]};
}

void Pendulum::project(State& y) {
  const double length = std::hypot(y[0], y[1]);
  y[0] /= length;
  y[1] /= length;
  const double outwards = y[0] * y[2] + y[1] * y[3];
  y[2] -= outwards * y[0];
  y[3] -= outwards * y[1];
}

}  // namespace esmc::host
