#pragma once
/// What may move a mechanism beside its identified parameters: found in what these leave unexplained.

#include <optional>
#include <vector>

#include "host_sim/identify/equations.hpp"

namespace esmc::host {

/// Columns of a defect for the equations at a solution: their unknowns are the defect's amounts. Weights of
/// rows are not in them.
[[nodiscard]] Matrix columns_of(const Defect& d, const Equations& e, const IdentifyProblem& p,
                                const Identification& at);

/// A weighted solution: A x = b less the residual. x: base parameters, then the step of the delay, then the
/// shifts of the reversals.
struct Solution {
  Matrix A;
  Vector x, residual;
  std::array<double, 2> weight{1.0, 1.0};  ///< of rows, by base joint
};

/// A log, with a share of the observers' lag taken back, and its solution.
struct Explained {
  IdentifyProblem problem;
  Solution solution;
};

/// The defect that the residual of `views` speaks for most, if it does so clearly in all of them and if it
/// shifts a parameter or the delay of the first, whose result is `at`, by half of its usual interval.
[[nodiscard]] std::optional<Defect> find_defect(const std::vector<Explained>& views,
                                                const Identification& at);

}  // namespace esmc::host
