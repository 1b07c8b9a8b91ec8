#pragma once
/// What an integrator needs to know of a problem.

#include <array>
#include <concepts>
#include <cstddef>

namespace esmc::host {

/// y' = slope(t, y), y on a manifold that `project` restores: y[0..positions) positions, y[positions..size())
/// their rates. Entries of an array from size() on are not touched.
template <class P>
concept System = requires(const P& p, double t, const typename P::State& y, typename P::State& out) {
  requires std::same_as<typename P::State, std::array<double, P::capacity>>;
  requires 2 * P::positions <= P::capacity;
  { p.size() } -> std::same_as<std::size_t>;
  { p.slope(t, y, out) } -> std::same_as<void>;
  { p.project(out) } -> std::same_as<void>;
  { p.start() } -> std::same_as<typename P::State>;  ///< the state at t = 0
};

}  // namespace esmc::host
