#pragma once
/// What the explicit methods of Dormand and Prince share: their stages, and the step without an error.

#include <cstddef>
#include <utility>

#include "host_sim/integrate/adaptive.hpp"

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

/// As weighted(), with row `row` of a table known to the compiler: no zeros, straight-line code. Order 8 on
/// the five-bar spent more on the loop of weighted() than on the mechanism.
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

/// a, c: the tables of the method. Row `end` of a is the solution: stage `end` is the slope after the step.
template <class Method, System S, const auto& a, const auto& c, std::size_t end>
class DormandPrince : public Adaptive<Method, S> {
 public:
  using State = typename S::State;
  using Adaptive<Method, S>::Adaptive;

 protected:
  void begin(double t, const State& y) { this->system_->slope(t, y, this->first_); }

  void compute(double t, double h, State& y) {
    static_assert(c[end - 1] == 1.0);
    stages(t, h, y);
    copy_entries(this->size(), k_[0], this->before_);
    copy_entries(this->size(), k_[end - 1], this->first_);  // c = 1, too: near enough for bend()
    this->system_->project(this->next_);
    copy_entries(this->size(), this->next_, y);
  }

  /// All stages but the last, and next_.
  void stages(double t, double h, const State& y) {
    const std::size_t n = this->size();
    copy_entries(n, this->first_, k_[0]);
    [&]<std::size_t... S0>(std::index_sequence<S0...>) { (stage<S0 + 1>(n, t, h, y), ...); }
    (std::make_index_sequence<end - 1>{});
    weighted_row<a, end>(n, k_, h, y, this->next_);
  }
  /// y becomes next_, whose slope is the last stage.
  void accept_with_slope(State& y) {
    copy_entries(this->size(), k_[end], this->first_);
    copy_entries(this->size(), this->next_, y);
  }

  std::array<State, a.size()> k_{};
  State work_{};

 private:
  template <std::size_t s>
  void stage(std::size_t n, double t, double h, const State& y) {
    weighted_row<a, s>(n, k_, h, y, work_);
    this->system_->slope(t + c[s] * h, work_, k_[s]);
  }
};

}  // namespace esmc::host
