#pragma once
/// Dormand-Prince 8(5,3), known as DOP853: HNW II.5 and II.10, continuous extension of order 7.

#include "host_sim/integrate/dopri8_table.hpp"
#include "host_sim/integrate/dormand_prince.hpp"

namespace esmc::host {

template <System S>
class Dopri8 : public DormandPrince<Dopri8<S>, S, dopri8::a, dopri8::c, 12> {
  using Base = DormandPrince<Dopri8<S>, S, dopri8::a, dopri8::c, 12>;
  friend Adaptive<Dopri8<S>, S>;

 public:
  using State = typename S::State;
  static constexpr int order = 8;
  static constexpr int dense_order = 7;
  static constexpr const char* name = "dopri8";

  explicit Dopri8(const S& system) : Base(system) {}
  explicit Dopri8(S&&) = delete;

 private:
  using Base::k_, Base::work_;
  static constexpr double error_order = 8.0;
  static constexpr double memory = 0.0;

  /// HNW (II.10.17): error of order 5, damped by that of order 3.
  double attempt(double t, double h, const State& y, const Tolerance& tol) {
    const std::size_t n = this->size();
    interpolant_ = false;
    this->stages(t, h, y);
    if (!all_finite(n, this->next_)) return std::numeric_limits<double>::quiet_NaN();
    weighted(n, dopri8::error5, k_, h, State{}, work_);
    const double five = scaled_norm(n, work_, y, this->next_, tol);
    for (std::size_t i = 0; i < n; ++i) {
      double quadrature = 0.0;
      for (const std::size_t j : {0U, 8U, 11U}) quadrature += dopri8::third[j] * k_[j][i];
      work_[i] = this->next_[i] - y[i] - h * quadrature;
    }
    const double three = scaled_norm(n, work_, y, this->next_, tol);
    return five == 0.0 ? 0.0 : five * five / std::sqrt(five * five + 0.01 * three * three);
  }

  void accept(double t, double h, State& y) {
    this->system_->project(this->next_);
    this->evaluate(t + h, this->next_, k_[12]);  // after the projection: the error has no use for this stage
    this->accept_with_slope(y);
  }

  void compute(double t, double h, State& y) {
    interpolant_ = false;
    Base::compute(t, h, y);
  }

  void interpolate(double theta, State& out) {
    if (!interpolant_) prepare();
    const double back = 1.0 - theta;
    for (std::size_t i = 0; i < this->size(); ++i) {
      out[i] =
          this->continued(i, theta, p_[0][i] + theta * (p_[1][i] + back * (p_[2][i] + theta * p_[3][i])));
    }
  }

  /// Three more slopes, once per step that is asked for.
  void prepare() {
    const std::size_t n = this->size();
    const double h = this->length_;
    this->end_slope();
    for (std::size_t s = 13; s < dopri8::stages; ++s) {
      weighted(n, dopri8::a[s], k_, h, this->previous_, work_);
      this->evaluate(this->begin_ + dopri8::c[s] * h, work_, k_[s]);
    }
    for (std::size_t j = 0; j < p_.size(); ++j) weighted(n, dopri8::dense[j], k_, h, State{}, p_[j]);
    interpolant_ = true;
  }

  std::array<State, 4> p_{};  // interpolant beyond the cubic, once prepared
  bool interpolant_ = false;
};

}  // namespace esmc::host
