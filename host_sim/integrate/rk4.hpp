#pragma once
/// The classical Runge-Kutta method of order 4, HNW table II.1.2.

#include "host_sim/integrate/system.hpp"

namespace esmc::host {

template <System S>
class Rk4 {
 public:
  using State = typename S::State;
  static constexpr int order = 4;
  static constexpr const char* name = "rk4";

  explicit Rk4(const S& system) : system_(&system) {}
  explicit Rk4(S&&) = delete;

  /// One step of h seconds, of either sign, from time t.
  void step(double t, double h, State& y) {
    const std::size_t n = system_->size();
    system_->slope(t, y, k1_);
    shift(n, y, 0.5 * h, k1_);
    system_->slope(t + 0.5 * h, stage_, k2_);
    shift(n, y, 0.5 * h, k2_);
    system_->slope(t + 0.5 * h, stage_, k3_);
    shift(n, y, h, k3_);
    system_->slope(t + h, stage_, k4_);
    for (std::size_t i = 0; i < n; ++i) y[i] += h / 6.0 * (k1_[i] + 2.0 * (k2_[i] + k3_[i]) + k4_[i]);
    system_->project(y);
  }

 private:
  void shift(std::size_t n, const State& y, double h, const State& k) {
    for (std::size_t i = 0; i < n; ++i) stage_[i] = y[i] + h * k[i];
  }

  const S* system_;
  State stage_{}, k1_{}, k2_{}, k3_{}, k4_{};
};

}  // namespace esmc::host
