#pragma once
/// A plant in motion: state, work done, and classical RK4 in equal steps with the closure restored after each.

#include <algorithm>
#include <array>
#include <cmath>

#include "host_sim/effects/effects.hpp"
#include "host_sim/plant/plant.hpp"

namespace esmc::host {

template <class Plant>
class Motion {
 public:
  using State = typename Plant::State;
  using Angles = typename Plant::Angles;
  using Joints = typename Plant::Joints;
  static constexpr int order = 4;
  static constexpr int state_dimension = 2 * Plant::coordinates;

  Motion(const Plant& plant, const std::vector<Effect>& effects, const State& initial)
      : plant_(plant), loads_(effects), state_(initial) {
    plant_.project(state_);
    energy_start_ = energy();
    kinetic_start_ = plant_.kinetic_energy(state_);
  }

  [[nodiscard]] const Plant& plant() const { return plant_; }
  [[nodiscard]] const State& state() const { return state_; }

  /// Advances from t by `steps` equal steps of `step` seconds. `torque(t)` gives motor torques at the joints,
  /// N m; it is evaluated at every stage.
  template <class Torque>
  void advance(double t, double step, int steps, const Torque& torque) {
    for (int i = 0; i < steps; ++i) {
      rk4(t + i * step, step, torque);
      plant_.project(state_);
    }
  }

  /// Change of energy that the work of motors and friction does not account for, relative to the largest
  /// exchange seen so far (kinetic energy, change of potential energy, work).
  [[nodiscard]] double energy_error() {
    const double kinetic = plant_.kinetic_energy(state_), total = energy();
    energy_scale_ = std::max({energy_scale_, kinetic, std::abs(total - kinetic - potential_start()), std::abs(work_)});
    const double gap = std::abs(total - energy_start_ - work_);
    // At rest nothing is exchanged: rounding is then measured against the weight's own energy.
    return gap / std::max({energy_scale_, 1e-9 * std::abs(total), 1e-12});
  }
  [[nodiscard]] double energy() const { return plant_.kinetic_energy(state_) + plant_.potential_energy(state_); }
  [[nodiscard]] double work() const { return work_; }

 private:
  struct Slope {
    Angles rate, acceleration;
    double power;
  };

  [[nodiscard]] double potential_start() const { return energy_start_ - kinetic_start_; }

  template <class Torque>
  [[nodiscard]] Slope slope(double t, const State& s, const Torque& torque) const {
    Joints load = torque(t);
    const Joints w = Plant::joint_rates(s.rate);
    loads_.add(w, load);
    double power = 0.0;
    for (std::size_t i = 0; i < w.size(); ++i) power += load[i] * w[i];
    return {s.rate, plant_.acceleration(s, load), power};
  }
  [[nodiscard]] static State shifted(const State& s, double h, const Slope& k) {
    State out;
    for (std::size_t i = 0; i < s.angle.size(); ++i) {
      out.angle[i] = s.angle[i] + h * k.rate[i];
      out.rate[i] = s.rate[i] + h * k.acceleration[i];
    }
    return out;
  }
  template <class Torque>
  void rk4(double t, double h, const Torque& torque) {
    const Slope a = slope(t, state_, torque);
    const Slope b = slope(t + 0.5 * h, shifted(state_, 0.5 * h, a), torque);
    const Slope c = slope(t + 0.5 * h, shifted(state_, 0.5 * h, b), torque);
    const Slope d = slope(t + h, shifted(state_, h, c), torque);
    const double sixth = h / 6.0;
    for (std::size_t i = 0; i < a.rate.size(); ++i) {
      state_.angle[i] += sixth * (a.rate[i] + 2.0 * (b.rate[i] + c.rate[i]) + d.rate[i]);
      state_.rate[i] +=
          sixth * (a.acceleration[i] + 2.0 * (b.acceleration[i] + c.acceleration[i]) + d.acceleration[i]);
    }
    work_ += sixth * (a.power + 2.0 * (b.power + c.power) + d.power);
  }

  Plant plant_;
  JointLoads loads_;
  State state_;
  double work_ = 0.0;
  double energy_start_ = 0.0, kinetic_start_ = 0.0, energy_scale_ = 0.0;
};

}  // namespace esmc::host
