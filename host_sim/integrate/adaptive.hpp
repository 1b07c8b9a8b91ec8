#pragma once
/// Step control of the adaptive methods. A method derives from
/// Adaptive<Method, System> and supplies
///   error_order            the error of a step goes with h^error_order
///   memory                 weight of the previous error in the step control, HW (IV.2.43) beta
///   begin(t, y)            slope at y into first_, nothing remembered of earlier steps
///   attempt(t, h, y, tol)  next_ after h from y. Returns the error in the norm of Tolerance; NaN if
///                          something was not finite, infinity if equations were not solved
///   accept(t, h, y)        y becomes next_, projected, and first_ the slope there
///   compute(t, h, y)       as attempt and accept, without an error

#include "host_sim/integrate/system.hpp"

namespace esmc::host {

struct NeverStop {
  template <class State>
  constexpr bool operator()(double, double, const State&) const {
    return false;
  }
};

template <class Method, System S>
class Adaptive {
 public:
  using State = typename S::State;

  explicit Adaptive(const S& system) : system_(&system) {}  ///< `system` must outlive this
  explicit Adaptive(S&&) = delete;

  /// One step of h seconds, of either sign, from time t, whatever its error; not solvable: y becomes NaN.
  void step(double t, double h, State& y) {
    method().begin(t, y);
    method().compute(t, h, y);
    length_ = h;
  }

  /// Change of slope over the last accepted step of advance(), of Dormand and Prince also of step(), from its
  /// end to its beginning.
  [[nodiscard]] State bend() const {
    State out{};
    for (std::size_t i = 0; i < size(); ++i) out[i] = before_[i] - first_[i];
    return out;
  }

  /// Integrates from t to t1 > t (s) with steps as the tolerance needs. Only the length of the next step is
  /// kept for the next call, so inputs of the system may jump between calls. y: the last accepted state in
  /// any case. `stop(t, h, y)` sees each accepted step, of h from t to y; true: the integration ends there.
  template <class Stop = NeverStop>
  Advance advance(double t, double t1, State& y, const Tolerance& tol, const Stop& stop = {}) {
    Advance done;
    const double length = t1 - t;
    method().begin(t, y);
    if (!all_finite(size(), first_)) return done;
    if (!(next_step_ > 0.0)) next_step_ = first_step(t, t1, y, tol);

    bool shrunk = false;  // since the last accepted step
    for (long attempts = 0; t < t1; ++attempts) {
      if (attempts >= tol.max_attempts) return done;
      const double rest = t1 - t, wanted = next_step_;
      // Two equal steps instead of a long and a tiny one.
      const double h = rest <= 1.01 * wanted ? rest : std::min(wanted, 0.5 * rest);
      const bool last = h == rest;
      const double error = method().attempt(t, h, y, tol);
      if (!(error <= 1.0)) {
        shrunk = true;
        next_step_ = h * shrinking(error);
        if (0.1 * next_step_ > epsilon * std::abs(t) && next_step_ > epsilon * epsilon * length) continue;
        next_step_ = 0.0;
        return done;
      }
      copy_entries(size(), first_, before_);
      method().accept(t, h, y);
      ++done.steps;
      next_step_ = h * growth(error, shrunk);
      if (h < wanted) next_step_ = std::max(wanted, next_step_);  // a step cut short says little
      shrunk = false;
      length_ = h;
      const double from = t;
      t = last ? t1 : t + h;
      if (!all_finite(size(), y) || !all_finite(size(), first_) || stop(from, h, y)) return done;
    }
    done.ok = true;
    return done;
  }

 protected:
  [[nodiscard]] std::size_t size() const { return system_->size(); }

  const S* system_;
  State first_{};        ///< slope at the current state
  State before_{};       ///< slope at the beginning of the step of bend()
  State next_{};         ///< state after the step in hand
  double length_ = 0.0;  ///< of the last accepted step

 private:
  static constexpr double epsilon = std::numeric_limits<double>::epsilon();

  Method& method() { return static_cast<Method&>(*this); }

  /// HNW (II.4), starting step size algorithm.
  double first_step(double t0, double t1, const State& y, const Tolerance& tol) {
    const std::size_t n = size();
    const double d0 = scaled_norm(n, y, y, y, tol), d1 = scaled_norm(n, first_, y, y, tol);
    const double h0 = std::min(t1 - t0, d0 < 1e-5 || d1 < 1e-5 ? 1e-6 : 0.01 * d0 / d1);
    for (std::size_t i = 0; i < n; ++i) next_[i] = y[i] + h0 * first_[i];
    State change{};
    system_->slope(t0 + h0, next_, change);
    for (std::size_t i = 0; i < n; ++i) change[i] -= first_[i];
    const double d2 = scaled_norm(n, change, y, y, tol) / h0, largest = std::max(d1, d2);
    const double h1 =
        largest <= 1e-15 ? std::max(1e-6, 1e-3 * h0) : std::pow(0.01 / largest, 1.0 / Method::error_order);
    const double h = std::min(100.0 * h0, h1);
    return h > 0.0 ? h : 1e-6 * (t1 - t0);  // NaN here is judged where it matters, in the step itself
  }

  static double shrinking(double error) {
    return std::isfinite(error) ? std::max(0.2, 0.9 * std::pow(error, -1.0 / Method::error_order)) : 0.25;
  }
  /// Proportional and integral, HW (IV.2.43c).
  double growth(double error, bool shrunk) {
    constexpr double alpha = 1.0 / Method::error_order - 0.75 * Method::memory;
    const double e = std::max(error, 1e-10);
    const double factor = 0.9 * std::pow(e, -alpha) * std::pow(error_before_, Method::memory);
    error_before_ = std::max(error, 1e-4);
    return std::clamp(factor, 0.2, shrunk ? 1.0 : 8.0);
  }

  double next_step_ = 0.0;  // 0: not known yet
  double error_before_ = 1e-4;
};

}  // namespace esmc::host
