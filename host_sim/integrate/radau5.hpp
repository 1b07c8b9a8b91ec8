#pragma once
/// Radau IIA of order 5 for stiff systems: three stages, L-stable, stiffly accurate; HW table IV.5.6 and
/// IV.8. The equations of all stages at once (real, 3 n unknowns) by simplified Newton, with a
/// Jacobian by forward differences.

#include "host_sim/integrate/adaptive.hpp"
#include "host_sim/integrate/lu.hpp"

namespace esmc::host {

/// Coefficients, HW table IV.5.6 and IV.8.
namespace radau5 {
inline constexpr double r6 = 2.449489742783178098197284074705891391966;  // sqrt 6
inline constexpr std::array<double, 3> c{(4.0 - r6) / 10.0, (4.0 + r6) / 10.0, 1.0};
/// Inverse of the Runge-Kutta matrix.
inline constexpr std::array<std::array<double, 3>, 3> inverse{{
    {2.0 + r6 / 2.0, -1.2 + 29.0 * r6 / 30.0, 0.4 - 4.0 * r6 / 15.0},
    {-1.2 - 29.0 * r6 / 30.0, 2.0 - r6 / 2.0, 0.4 + 4.0 * r6 / 15.0},
    {-1.0 + 8.0 * r6 / 3.0, -1.0 - 8.0 * r6 / 3.0, 5.0},
}};
/// Its real eigenvalue, and the weights of the stages in the error: HW (IV.8.18) times that eigenvalue.
inline constexpr double eigenvalue = 3.637834252744495732208418513577775;
inline constexpr std::array<double, 3> error{(-13.0 - 7.0 * r6) / 3.0, (-13.0 + 7.0 * r6) / 3.0, -1.0 / 3.0};
}  // namespace radau5

/// Storage goes with 9 capacity^2 doubles, time of a step with 18 size^3. capacity <= 32.
template <System S>
class Radau5 : public Adaptive<Radau5<S>, S> {
  using Base = Adaptive<Radau5<S>, S>;
  friend Base;
  static_assert(S::capacity <= 32);

 public:
  using State = typename S::State;
  static constexpr int order = 5;
  static constexpr const char* name = "radau5";
  using Base::Base;

 private:
  static constexpr double error_order = 4.0;
  static constexpr double memory = 0.0;
  static constexpr double nan = std::numeric_limits<double>::quiet_NaN();
  static constexpr double infinity = std::numeric_limits<double>::infinity();
  using Stages = std::array<State, 3>;  // Z of HW (IV.8.2): what a stage has beyond y

  enum class Newton { solved, diverged, not_finite };

  void begin(double t, const State& y) {
    this->system_->slope(t, y, this->first_);
    jacobian_known_ = predictable_ = false;
    eagerness_ = 1.0;
  }

  double attempt(double t, double h, const State& y, const Tolerance& tol) {
    const bool old = jacobian_known_ && !jacobian_current_;
    Newton newton = solve(t, h, y, &tol);
    if (newton != Newton::solved && old) {  // an old Jacobian is no reason for a shorter step
      jacobian_known_ = false;
      newton = solve(t, h, y, &tol);
    }
    if (newton != Newton::solved) return newton == Newton::diverged ? infinity : nan;
    return error(t, h, y, tol);
  }

  void accept(double t, double h, State& y) {
    finish(y);
    this->system_->slope(t + h, this->next_, this->first_);
    jacobian_known_ = jacobian_known_ && contraction_ < 1e-3;
    jacobian_current_ = false;
    predictable_ = true;
  }

  void compute(double t, double h, State& y) {
    const std::size_t n = this->size();
    if (solve(t, h, y, nullptr) == Newton::solved) return finish(y);
    std::fill_n(this->next_.begin(), n, nan);
    for (State& z : last_) std::fill_n(z.begin(), n, nan);
    copy_entries(n, this->next_, y);
  }

  void finish(State& y) {
    const std::size_t n = this->size();
    this->system_->project(this->next_);
    last_ = z_;
    for (std::size_t i = 0; i < n; ++i) last_[2][i] = this->next_[i] - y[i];
    copy_entries(n, this->next_, y);
  }

  /// Lagrange polynomials to the stages; the one to theta = 0 has the value 0.
  static std::array<double, 3> collocation(double x) {
    constexpr double a = radau5::c[0], b = radau5::c[1];
    return {x * (x - b) * (x - 1.0) / (a * (a - b) * (a - 1.0)),
            x * (x - a) * (x - 1.0) / (b * (b - a) * (b - 1.0)),
            x * (x - a) * (x - b) / ((1.0 - a) * (1.0 - b))};
  }

  /// Start of the iteration: the last polynomial continued, HW (IV.8.5), or 0.
  void predict(double h) {
    const std::size_t n = this->size();
    for (std::size_t s = 0; s < 3; ++s) {
      if (!predictable_) {
        std::fill_n(z_[s].begin(), n, 0.0);
        continue;
      }
      const auto weight = collocation(1.0 + radau5::c[s] * h / this->length_);
      for (std::size_t i = 0; i < n; ++i) {
        z_[s][i] = weight[0] * last_[0][i] + weight[1] * last_[1][i] + (weight[2] - 1.0) * last_[2][i];
      }
    }
  }

  /// next_ and z_. Without a tolerance: to rounding.
  Newton solve(double t, double h, const State& y, const Tolerance* tol) {
    if (!jacobian_known_) differentiate(t, y);
    for (std::size_t i = 0; i < this->size(); ++i) {
      if (!all_finite(this->size(), jacobian_[i])) return Newton::not_finite;
    }
    if (!prepare(h)) return Newton::diverged;
    predict(h);
    const int most = tol != nullptr ? 10 : 60;
    const double enough = tol == nullptr ? 0.0
                                         : std::max(1e-15 / std::max(tol->relative, 1e-14),
                                                    std::min(0.03, std::sqrt(tol->relative)));
    double before = 0.0;
    contraction_ = 0.0;
    for (int k = 0; k < most; ++k) {
      const double change = iterate(t, h, y, tol);
      if (std::isnan(change)) return Newton::not_finite;
      const double ratio = k == 0 ? 0.0 : change / before;
      contraction_ = std::max(contraction_, ratio);
      if (tol == nullptr) {
        // To rounding: small and no longer getting smaller.
        if (change <= 1e-16 || (k > 0 && change < 1e-10 && ratio > 0.3)) return reached(y);
        if (k > 2 && ratio > 2.0) return Newton::diverged;
      } else {
        if (k > 0 && !(ratio < 1.0)) return change <= 1e-6 * enough ? reached(y) : Newton::diverged;
        eagerness_ = k == 0 ? std::pow(std::max(eagerness_, 1e-16), 0.8) : ratio / (1.0 - ratio);
        if (eagerness_ * change <= enough) return reached(y);
        if (k > 0 && std::pow(ratio, most - 1 - k) / (1.0 - ratio) * change > enough) break;
      }
      before = change;
    }
    eagerness_ = 1.0;
    return Newton::diverged;
  }

  Newton reached(const State& y) {
    for (std::size_t i = 0; i < this->size(); ++i) this->next_[i] = y[i] + z_[2][i];
    return all_finite(this->size(), this->next_) ? Newton::solved : Newton::not_finite;
  }

  /// One step of Newton, HW (IV.8.4) times the inverse of the Runge-Kutta matrix. Returns the size of the
  /// change: in the norm of the tolerance, or relative to the largest entry of the solution.
  double iterate(double t, double h, const State& y, const Tolerance* tol) {
    const std::size_t n = this->size();
    for (std::size_t s = 0; s < 3; ++s) {
      for (std::size_t i = 0; i < n; ++i) work_[i] = y[i] + z_[s][i];
      this->system_->slope(t + radau5::c[s] * h, work_, slope_);
      for (std::size_t i = 0; i < n; ++i) {
        const auto& row = radau5::inverse[s];
        change_[s * n + i] = h * slope_[i] - (row[0] * z_[0][i] + row[1] * z_[1][i] + row[2] * z_[2][i]);
      }
    }
    newton_matrix_.solve(3 * n, change_);
    double sum = 0.0, most = 0.0, largest = std::numeric_limits<double>::min();
    for (std::size_t s = 0; s < 3; ++s) {
      for (std::size_t i = 0; i < n; ++i) {
        const double d = change_[s * n + i];
        z_[s][i] += d;
        work_[i] = d;
        largest = std::max({largest, std::abs(y[i]), std::abs(y[i] + z_[s][i])});
        most = std::isnan(d) ? d : std::max(std::abs(d), most);
        if (std::isnan(most)) return nan;
      }
      if (tol != nullptr) sum += std::pow(scaled_norm(n, work_, y, y, *tol), 2);
    }
    return tol != nullptr ? std::sqrt(sum / 3.0) : most / largest;
  }

  /// HW (IV.8.19), and (IV.8.20) where that one finds the step too long.
  double error(double t, double h, const State& y, const Tolerance& tol) {
    const std::size_t n = this->size();
    const auto estimate = [&](const State& slope) {
      for (std::size_t i = 0; i < n; ++i) {
        work_[i] = h * slope[i] + radau5::error[0] * z_[0][i] + radau5::error[1] * z_[1][i] +
                   radau5::error[2] * z_[2][i];
      }
      error_matrix_.solve(n, work_);
      return scaled_norm(n, work_, y, this->next_, tol);
    };
    if (const double first = estimate(this->first_); !(first >= 1.0)) return first;
    for (std::size_t i = 0; i < n; ++i) work_[i] += y[i];
    this->system_->slope(t, work_, slope_);
    return estimate(slope_);
  }

  void differentiate(double t, const State& y) {
    const std::size_t n = this->size();
    copy_entries(n, y, work_);
    for (std::size_t j = 0; j < n; ++j) {
      const double wanted =
          std::sqrt(std::numeric_limits<double>::epsilon() * std::max(1e-5, std::abs(y[j])));
      work_[j] = y[j] + wanted;
      const double d = work_[j] - y[j];
      this->system_->slope(t, work_, slope_);
      for (std::size_t i = 0; i < n; ++i) jacobian_[i][j] = (slope_[i] - this->first_[i]) / d;
      work_[j] = y[j];
    }
    jacobian_known_ = jacobian_current_ = true;
    factored_for_ = 0.0;
  }

  bool prepare(double h) {
    if (h == factored_for_) return true;
    const std::size_t n = this->size();
    factored_for_ = 0.0;
    auto& small = error_matrix_.matrix();
    auto& large = newton_matrix_.matrix();
    for (std::size_t i = 0; i < n; ++i) {
      for (std::size_t j = 0; j < n; ++j) {
        const double one = i == j ? 1.0 : 0.0, hj = h * jacobian_[i][j];
        small[i][j] = radau5::eigenvalue * one - hj;
        for (std::size_t r = 0; r < 3; ++r) {
          for (std::size_t s = 0; s < 3; ++s) {
            large[r * n + i][s * n + j] = radau5::inverse[r][s] * one - (r == s ? hj : 0.0);
          }
        }
      }
    }
    if (!error_matrix_.factor(n) || !newton_matrix_.factor(3 * n)) return false;
    factored_for_ = h;
    return true;
  }

  std::array<State, S::capacity> jacobian_{};
  Lu<S::capacity> error_matrix_;
  Lu<3 * S::capacity> newton_matrix_;
  std::array<double, 3 * S::capacity> change_{};
  Stages z_{},
      last_{};  // of the attempt; of the last accepted step, where the last one is after the projection
  State work_{}, slope_{};
  double factored_for_ = 0.0;  // h of both matrices; 0: none
  double contraction_ = 0.0;   // largest ratio of two changes in the last iteration
  double eagerness_ = 1.0;     // eta of HW (IV.8.10)
  bool jacobian_known_ = false, jacobian_current_ = false, predictable_ = false;
};

}  // namespace esmc::host
