#pragma once
/// Semi-implicit (symplectic) Euler: rates and other states with the slope at the beginning, then positions
/// with the new rates. HNW (II.16.2). Needs positions' = rates, which the other methods do not.

#include "host_sim/integrate/system.hpp"

namespace esmc::host {

template <System S>
class SemiImplicitEuler {
 public:
  using State = typename S::State;
  static constexpr int order = 1;
  static constexpr const char* name = "semi_implicit_euler";

  explicit SemiImplicitEuler(const S& system) : system_(&system) {}
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

}  // namespace esmc::host
