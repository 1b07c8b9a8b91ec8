#pragma once
/// Dormand-Prince 8(5,3), known as DOP853: HNW II.5 and II.10, continuous extension of order 7.

#include "host_sim/integrate/adaptive.hpp"
#include "host_sim/integrate/dopri8_table.hpp"
#include "host_sim/integrate/stages.hpp"

namespace esmc::host {

template <System S>
class Dopri8 : public Adaptive<Dopri8<S>, S> {
  using Base = Adaptive<Dopri8<S>, S>;
  friend Base;

 public:
  using State = typename S::State;
  static constexpr int order = 8;
  static constexpr int dense_order = 7;
  static constexpr const char* name = "dopri8";

  explicit Dopri8(const S& system) : Base(system) {}
  explicit Dopri8(S&&) = delete;

 private:
  static constexpr double error_order = 8.0;
  static constexpr double memory = 0.0;

  void begin(double t, const State& y) { this->evaluate(t, y, this->first_); }

  /// HNW (II.10.17): error of order 5, damped by that of order 3.
  double attempt(double t, double h, const State& y, const Tolerance& tol) {
    const std::size_t n = this->size();
    inner_stages(t, h, y);
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
    copy_entries(this->size(), k_[12], this->first_);
    end_slope_ = true;
    move(y);
  }

  void compute(double t, double h, State& y) {
    inner_stages(t, h, y);
    this->system_->project(this->next_);
    end_slope_ = false;
    move(y);
  }

  void interpolate(double theta, State& out) {
    const std::size_t n = this->size();
    if (!interpolant_) prepare();
    const double back = 1.0 - theta;
    for (std::size_t i = 0; i < n; ++i) {
      const double beyond = p_[3][i] + theta * (p_[4][i] + back * (p_[5][i] + theta * p_[6][i]));
      out[i] =
          this->previous_[i] + theta * (p_[0][i] + back * (p_[1][i] + theta * (p_[2][i] + back * beyond)));
    }
  }

  /// Three more slopes, once per step that is asked for.
  void prepare() {
    const std::size_t n = this->size();
    const double h = this->length_;
    if (!end_slope_) this->evaluate(this->end_, this->next_, k_[12]);
    end_slope_ = true;
    for (std::size_t s = 13; s < dopri8::stages; ++s) {
      weighted(n, dopri8::a[s], k_, h, this->previous_, work_);
      this->evaluate(this->begin_ + dopri8::c[s] * h, work_, k_[s]);
    }
    for (std::size_t i = 0; i < n; ++i) {
      p_[0][i] = this->next_[i] - this->previous_[i];
      p_[1][i] = h * k_[0][i] - p_[0][i];
      p_[2][i] = p_[0][i] - h * k_[12][i] - p_[1][i];
    }
    for (std::size_t j = 0; j < 4; ++j) weighted(n, dopri8::dense[j], k_, h, State{}, p_[3 + j]);
    interpolant_ = true;
  }

  void inner_stages(double t, double h, const State& y) {
    const std::size_t n = this->size();
    interpolant_ = false;
    copy_entries(n, this->first_, k_[0]);
    each_stage<1, dopri8::main_stages>([&](auto s) {
      weighted_row<dopri8::a, s.value>(n, k_, h, y, work_);
      this->evaluate(t + dopri8::c[s.value] * h, work_, k_[s.value]);
    });
    weighted_row<dopri8::a, 12>(n, k_, h, y, this->next_);
  }

  void move(State& y) {
    copy_entries(this->size(), y, this->previous_);
    copy_entries(this->size(), this->next_, y);
  }

  std::array<State, dopri8::stages> k_{};
  std::array<State, 7> p_{};  // interpolant, once prepared
  State work_{};
  bool end_slope_ = false, interpolant_ = false;
};

}  // namespace esmc::host
