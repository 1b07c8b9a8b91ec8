#pragma once
/// The methods of fixed step: semi-implicit Euler, midpoint, Heun and the classical Runge-Kutta method.

#include "host_sim/integrate/system.hpp"

namespace esmc::host {

/// Semi-implicit (symplectic) Euler: rates and other states with the slope at the beginning, then positions
/// with the new rates. HNW (II.16.2). Needs positions' = rates, which the other methods do not.
template <System S>
class SemiImplicitEuler {
 public:
  using State = typename S::State;
  static constexpr int order = 1;
  static constexpr const char* name = "semi_implicit_euler";

  explicit SemiImplicitEuler(const S& system) : system_(&system) {}  ///< `system` must outlive this
  explicit SemiImplicitEuler(S&&) = delete;

  /// One step of h seconds, of either sign, from time t.
  void step(double t, double h, State& y) {
    constexpr std::size_t m = S::positions;
    system_->slope(t, y, slope_);
    const std::size_t n = system_->size();
    for (std::size_t i = m; i < n; ++i) y[i] += h * slope_[i];
    for (std::size_t i = 0; i < m; ++i) y[i] += h * y[m + i];
    system_->project(y);
  }

 private:
  const S* system_;
  State slope_{};
};

/// Each stage is made of the one before: the midpoint rule of order 2, HNW (II.1.4), and Heun's method of
/// order 3, HNW table II.1.1.
template <System S, int stages>
class ChainedStages {
 public:
  using State = typename S::State;

  explicit ChainedStages(const S& system) : system_(&system) {}  ///< `system` must outlive this
  explicit ChainedStages(S&&) = delete;

  /// One step of h seconds, of either sign, from time t.
  void step(double t, double h, State& y) {
    constexpr double first = stages == 2 ? 0.0 : 0.25;  // weight of the first slope
    const std::size_t n = system_->size();
    system_->slope(t, y, k1_);
    k_ = k1_;
    for (int s = 1; s < stages; ++s) {
      const double part = s * h / stages;
      for (std::size_t i = 0; i < n; ++i) stage_[i] = y[i] + part * k_[i];
      system_->slope(t + part, stage_, k_);
    }
    for (std::size_t i = 0; i < n; ++i) y[i] += h * (first * k1_[i] + (1.0 - first) * k_[i]);
    system_->project(y);
  }
  /// Change of slope over the last step, from its end to its beginning.
  [[nodiscard]] State bend() const {
    State out{};
    for (std::size_t i = 0; i < system_->size(); ++i) out[i] = (k1_[i] - k_[i]) * stages / (stages - 1.0);
    return out;
  }

 private:
  const S* system_;
  State stage_{}, k1_{}, k_{};
};

/// The classical Runge-Kutta method of order 4, HNW table II.1.2.
template <System S>
class Rk4 {
 public:
  using State = typename S::State;
  static constexpr int order = 4;
  static constexpr const char* name = "rk4";

  explicit Rk4(const S& system) : system_(&system) {}  ///< `system` must outlive this
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
  /// Change of slope over the last step, from its end to its beginning.
  [[nodiscard]] State bend() const {
    State out{};
    for (std::size_t i = 0; i < system_->size(); ++i) out[i] = k1_[i] - k4_[i];
    return out;
  }

 private:
  void shift(std::size_t n, const State& y, double h, const State& k) {
    for (std::size_t i = 0; i < n; ++i) stage_[i] = y[i] + h * k[i];
  }

  const S* system_;
  State stage_{}, k1_{}, k2_{}, k3_{}, k4_{};
};

}  // namespace esmc::host
