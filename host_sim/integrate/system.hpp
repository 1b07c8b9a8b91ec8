#pragma once
/// What every method of host_sim/integrate/ agrees on: the system, tolerances, and how an advance ends.
///
/// Sources are HNW = Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, 2nd ed., and HW =
/// Hairer, Wanner, II, 2nd ed. Nothing here allocates; a method holds a pointer to its system, which must
/// outlive it.

#include <algorithm>
#include <array>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <limits>

namespace esmc::host {

/// y' = slope(t, y), where y lies on a manifold that project restores.
///   static constexpr std::size_t capacity;  State = std::array<double, capacity>; of several systems side by
///   side, where
///                                           a method allows it, a type that is several numbers
///   std::size_t size() const                entries in use, <= capacity; the rest are never read or written
///   static constexpr std::size_t positions  y[0, positions) are positions, y[positions, 2 positions) their
///   rates,
///                                           in that order; the rest are other states. 0: all are other
///                                           states
///   void slope(double t, const State& y, State& dy) const
///                                           smooth in t and y during one call of a method. May give NaN or
///                                           infinity, and must not throw
///   void project(State& y) const            closure restored in position and velocity; does nothing in a
///   free
///                                           system. Called after each step
/// Optional, for stiff methods: void jacobian(double t, const State& y, std::array<State, capacity>& J)
/// const, with J[i][j] the derivative of slope i by y[j].
template <class S>
concept System = requires(const S& s, double t, const typename S::State& y, typename S::State& out) {
  requires std::same_as<typename S::State, std::array<typename S::State::value_type, S::capacity>>;
  requires 2 * S::positions <= S::capacity;
  { s.size() } -> std::convertible_to<std::size_t>;
  s.slope(t, y, out);
  s.project(out);
};

template <class S>
concept HasJacobian = System<S> && requires(const S& s, double t, const typename S::State& y,
                                            std::array<typename S::State, S::capacity>& J) {
  s.jacobian(t, y, J);
};

/// The error of each step is kept below 1 in the root mean square over the entries in use of
/// error / (absolute + relative max(|y before|, |y after|)), HNW (II.4.11).
struct Tolerance {
  double absolute = 1e-9;  ///< > 0, in the units of y
  double relative = 1e-9;  ///< >= 0. Below some 1e-14 rounding keeps every step from being accepted
  double max_step = std::numeric_limits<double>::infinity();  ///< > 0, s
  long max_attempts = 1'000'000;  ///< > 0; steps, rejected ones included, in one advance

  [[nodiscard]] bool valid() const {
    return absolute > 0.0 && relative >= 0.0 && max_step > 0.0 && max_attempts > 0 &&
           std::isfinite(absolute) && std::isfinite(relative);
  }
};

/// Why an advance ended.
enum class Reason {
  reached,         ///< at t1
  event,           ///< at the first sign change
  bad_interval,    ///< t1 < t0, or not finite: nothing done
  bad_tolerance,   ///< nothing done
  non_finite,      ///< slope, error or event function not finite, however short the step
  step_underflow,  ///< tolerance not met (or implicit equations not solved) however short the step
  too_many_steps,  ///< max_attempts
};

struct Advance {
  double t =
      0.0;  ///< y is the state at this time; t1 exactly if reached, else that of the last accepted step
  long steps = 0;  ///< accepted
  long rejected = 0;
  long slopes = 0;  ///< evaluations of slope, those for a difference Jacobian and for dense output included
  Reason reason = Reason::reached;

  [[nodiscard]] bool ok() const { return reason == Reason::reached || reason == Reason::event; }
};

/// The first n entries; the others stay as they are.
template <class State>
void copy_entries(std::size_t n, const State& from, State& to) {
  std::copy_n(from.begin(), n, to.begin());
}

template <class State>
[[nodiscard]] bool all_finite(std::size_t n, const State& y) {
  return std::all_of(y.begin(), y.begin() + static_cast<std::ptrdiff_t>(n),
                     [](double v) { return std::isfinite(v); });
}

/// Root mean square of v / (absolute + relative max(|a|, |b|)); NaN if an entry is.
template <class State>
[[nodiscard]] double scaled_norm(std::size_t n, const State& v, const State& a, const State& b,
                                 const Tolerance& tol) {
  double sum = 0.0;
  for (std::size_t i = 0; i < n; ++i) {
    const double e = v[i] / (tol.absolute + tol.relative * std::max(std::abs(a[i]), std::abs(b[i])));
    sum += e * e;
  }
  return n == 0 ? 0.0 : std::sqrt(sum / static_cast<double>(n));
}

/// y += dy entry by entry. Compensated: what rounding took from a sum is kept and added to the next one
/// (Kahan), so that 10^8 steps are as good as one; the carry is below the last bit of y, so a y changed by
/// others does no harm.
template <class State, bool compensated>
class Accumulator {
 public:
  template <class Number>
  void add(Number& y, std::size_t i, const Number& dy) {
    if constexpr (compensated) {
      const Number wanted = dy + carry_[i], sum = y + wanted;
      const Number lost = wanted - (sum - y);
      carry_[i] = std::isfinite(lost) ? lost : 0.0;
      y = sum;
    } else {
      y += dy;
    }
  }

 private:
  struct Nothing {};
  [[no_unique_address]] std::conditional_t<compensated, State, Nothing> carry_{};
};

}  // namespace esmc::host
