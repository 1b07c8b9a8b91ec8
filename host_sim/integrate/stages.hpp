#pragma once
/// Sums over stages of explicit Runge-Kutta methods.

#include <cstddef>

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

}  // namespace esmc::host
