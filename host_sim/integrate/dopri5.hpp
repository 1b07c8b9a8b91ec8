#pragma once
/// Dormand-Prince 5(4), HNW table II.5.2.

#include "host_sim/integrate/dormand_prince.hpp"

namespace esmc::host {

namespace dopri5 {
inline constexpr std::size_t stages = 7;
using Row = std::array<double, stages>;
inline constexpr Row c{0.0, 1.0 / 5, 3.0 / 10, 4.0 / 5, 8.0 / 9, 1.0, 1.0};
/// The last row is the solution of order 5, so the last stage is the first one of the next step.
inline constexpr std::array<Row, stages> a{{
    {},
    {1.0 / 5},
    {3.0 / 40, 9.0 / 40},
    {44.0 / 45, -56.0 / 15, 32.0 / 9},
    {19372.0 / 6561, -25360.0 / 2187, 64448.0 / 6561, -212.0 / 729},
    {9017.0 / 3168, -355.0 / 33, 46732.0 / 5247, 49.0 / 176, -5103.0 / 18656},
    {35.0 / 384, 0.0, 500.0 / 1113, 125.0 / 192, -2187.0 / 6784, 11.0 / 84},
}};
/// Order 5 minus order 4.
inline constexpr Row error{71.0 / 57600,      0.0,        -71.0 / 16695, 71.0 / 1920,
                           -17253.0 / 339200, 22.0 / 525, -1.0 / 40};
}  // namespace dopri5

template <System S>
class Dopri5 : public DormandPrince<Dopri5<S>, S, dopri5::a, dopri5::c, 6> {
  using Base = DormandPrince<Dopri5<S>, S, dopri5::a, dopri5::c, 6>;
  friend Adaptive<Dopri5<S>, S>;

 public:
  using State = typename S::State;
  static constexpr int order = 5;
  static constexpr const char* name = "dopri5";
  using Base::Base;

 private:
  using Base::k_, Base::work_;
  static constexpr double error_order = 5.0;
  static constexpr double memory = 0.04;

  double attempt(double t, double h, const State& y, const Tolerance& tol) {
    const std::size_t n = this->size();
    this->stages(t, h, y);
    this->system_->slope(t + h, this->next_, k_[6]);
    weighted(n, dopri5::error, k_, h, State{}, work_);
    return all_finite(n, this->next_) ? scaled_norm(n, work_, y, this->next_, tol)
                                      : std::numeric_limits<double>::quiet_NaN();
  }

  void accept(double t, double h, State& y) {
    const std::size_t n = this->size();
    copy_entries(n, this->next_, work_);
    this->system_->project(this->next_);
    // The last stage is the next slope only while the projection has nothing to do.
    if (!std::equal(work_.begin(), work_.begin() + static_cast<std::ptrdiff_t>(n), this->next_.begin())) {
      this->system_->slope(t + h, this->next_, k_[6]);
    }
    this->accept_with_slope(y);
  }
};

}  // namespace esmc::host
