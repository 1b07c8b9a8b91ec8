#pragma once
/// The system, tolerances and results of the methods in host_sim/integrate.
///
/// HNW = Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, 2nd ed.; HW = Hairer, Wanner,
/// II, 2nd ed. No method allocates; a method holds a pointer to its system, which must outlive it.

#include <algorithm>
#include <array>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <limits>

namespace esmc::host {

/// y' = slope(t, y) on a manifold that project restores.
///
/// State is std::array<double, capacity>, or of a type that is several numbers where a method allows that.
/// size() <= capacity entries are in use; y[0, positions) are positions, y[positions, 2 positions) their
/// rates in the same order, the rest other states. slope is smooth in t and y during one call of a method;
/// it may give NaN or infinity and must not throw. project is called after each step and restores closure in
/// position and velocity.
template <class S>
concept System = requires(const S& s, double t, const typename S::State& y, typename S::State& out) {
  requires std::same_as<typename S::State, std::array<typename S::State::value_type, S::capacity>>;
  requires 2 * S::positions <= S::capacity;
  { s.size() } -> std::convertible_to<std::size_t>;
  s.slope(t, y, out);
  s.project(out);
};

/// The error of each step is kept below 1 in the root mean square over the entries in use of
/// error / (absolute + relative max(|y before|, |y after|)), HNW (II.4.11).
struct Tolerance {
  double absolute = 1e-9;         ///< > 0, in the units of y
  double relative = 1e-9;         ///< >= 0. Below some 1e-14 rounding keeps every step from being accepted
  long max_attempts = 1'000'000;  ///< > 0; steps, rejected ones included, in one advance
};

struct Advance {
  long steps = 0;   ///< accepted
  bool ok = false;  ///< else stopped by the caller, or a slope is not finite or the tolerance not met
};

/// Copies the first n entries; the others of `to` stay.
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

}  // namespace esmc::host
