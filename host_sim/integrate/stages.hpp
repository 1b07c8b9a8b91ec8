#pragma once
/// Sums over stages of explicit Runge-Kutta methods.

#include <cstddef>
#include <utility>

#include "host_sim/integrate/system.hpp"

namespace esmc::host {

/// out = start + h sum of weight[j] k[j] over the weights that are not 0, in the order of the stages.
template <class Weights, class Stages, class State>
void weighted(std::size_t n, const Weights& weight, const Stages& k, double h, const State& start,
              State& out) {
  for (std::size_t i = 0; i < n; ++i) {
    double sum = 0.0;
    for (std::size_t j = 0; j < weight.size(); ++j) {
      if (weight[j] != 0.0) sum += weight[j] * k[j][i];
    }
    out[i] = start[i] + h * sum;
  }
}

/// The same with row `row` of a table known to the compiler: zeros are gone, the rest is straight-line code.
/// Order 8 on the five-bar spent more on the loop above than on the mechanism.
template <const auto& table, std::size_t row, class Stages, class State>
void weighted_row(std::size_t n, const Stages& k, double h, const State& start, State& out) {
  [&]<std::size_t... J>(std::index_sequence<J...>) {
    for (std::size_t i = 0; i < n; ++i) {
      double sum = 0.0;
      const auto term = [&]<std::size_t j>(std::integral_constant<std::size_t, j>) {
        if constexpr (table[row][j] != 0.0) sum += table[row][j] * k[j][i];
      };
      (term(std::integral_constant<std::size_t, J>{}), ...);
      out[i] = start[i] + h * sum;
    }
  }
  (std::make_index_sequence<table[row].size()>{});
}

/// f(std::integral_constant<std::size_t, s>) for s = first .. last - 1.
template <std::size_t first, std::size_t last, class F>
void each_stage(const F& f) {
  [&]<std::size_t... S>(std::index_sequence<S...>) {
    (f(std::integral_constant<std::size_t, first + S>{}), ...);
  }
  (std::make_index_sequence<last - first>{});
}

}  // namespace esmc::host
