#pragma once
/// The classical Runge-Kutta method of order 4, in equal steps.

#include <cstddef>

namespace esmc::host {

template <class System>
class Rk4 {
 public:
  using State = typename System::State;
  static constexpr int order = 4;
  static constexpr const char* name = "rk4";

  explicit Rk4(const System& system) : system_(&system) {}

  void step(double t, double h, State& y) {
    const System& s = *system_;
    State a, b, c, d, mid;
    s.slope(t, y, a);
    shift(y, 0.5 * h, a, mid);
    s.slope(t + 0.5 * h, mid, b);
    shift(y, 0.5 * h, b, mid);
    s.slope(t + 0.5 * h, mid, c);
    shift(y, h, c, mid);
    s.slope(t + h, mid, d);
    const double sixth = h / 6.0;
    for (std::size_t i = 0; i < s.size(); ++i) y[i] += sixth * (a[i] + 2.0 * (b[i] + c[i]) + d[i]);
    s.project(y);
  }

 private:
  void shift(const State& y, double h, const State& slope, State& out) const {
    for (std::size_t i = 0; i < system_->size(); ++i) out[i] = y[i] + h * slope[i];
  }
  const System* system_;
};

}  // namespace esmc::host
