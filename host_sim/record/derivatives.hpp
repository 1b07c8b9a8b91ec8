#pragma once
/// Derivatives of equidistant samples: of the cubic through 2 n + 1 points by least squares, at its middle.

#include <cmath>
#include <cstddef>
#include <vector>

namespace esmc::host {

inline constexpr std::size_t derivative_half = 4;  ///< n, rows

/// Sum of x^power over the rows x = -n..n.
inline double power_sum(int power) {
  double sum = 0.0;
  for (int x = -static_cast<int>(derivative_half); x <= static_cast<int>(derivative_half); ++x)
    sum += std::pow(x, power);
  return sum;
}

/// Weights of the first derivative on the rows -n..n, per row.
inline std::vector<double> slope_weights() {
  // On an odd grid 1 and x^2 are orthogonal to x and x^3: two unknowns.
  const auto n = static_cast<int>(derivative_half);
  const double s2 = power_sum(2), s4 = power_sum(4), s6 = power_sum(6);
  std::vector<double> w;
  for (int x = -n; x <= n; ++x) w.push_back((s6 * x - s4 * x * x * x) / (s2 * s6 - s4 * s4));
  return w;
}

/// Weights of the second derivative on the rows -n..n, per row squared.
inline std::vector<double> curvature_weights() {
  const auto n = static_cast<int>(derivative_half);
  const double s0 = power_sum(0), s2 = power_sum(2), s4 = power_sum(4);
  std::vector<double> w;
  for (int x = -n; x <= n; ++x) w.push_back(2.0 * (s0 * x * x - s2) / (s0 * s4 - s2 * s2));
  return w;
}

/// Second derivative of `at` at `row`, per row squared. `weights`: curvature_weights(), not checked. `at` has
/// the rows 0 .. rows-1; 0 with less than n = derivative_half rows on a side.
template <class At>
double curvature(const std::vector<double>& weights, std::size_t rows, std::size_t row, At&& at) {
  if (row < derivative_half || row + derivative_half >= rows) return 0.0;
  double sum = 0.0;
  for (std::size_t k = 0; k < weights.size(); ++k) sum += weights[k] * at(row + k - derivative_half);
  return sum;
}

/// Angles before a critically damped observer followed them, which is late by acceleration / bandwidth^2:
/// `share` of that lag is taken back. `bandwidth`: rad per row, > 0.
inline std::vector<double> before_observer(const std::vector<double>& angle, double bandwidth, double share) {
  const std::vector<double> weights = curvature_weights();
  std::vector<double> out = angle;
  for (std::size_t i = 0; i < angle.size(); ++i)
    out[i] += share / std::pow(bandwidth, 2) *
              curvature(weights, angle.size(), i, [&](std::size_t row) { return angle[row]; });
  return out;
}

}  // namespace esmc::host
