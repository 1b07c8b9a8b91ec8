#pragma once
/// Derivatives of equidistant samples: of the cubic through 2 n + 1 points by least squares, at its middle,
/// so without delay.

#include <cmath>
#include <cstddef>
#include <vector>

namespace esmc::host {

inline constexpr std::size_t derivative_half = 4;  ///< n, rows

/// Weights of the first derivative on the rows -n..n, per row.
inline std::vector<double> slope_weights() {
  // On an odd grid 1 and x^2 are orthogonal to x and x^3: two unknowns, s2 = sum x^2, s4, s6.
  const auto n = static_cast<int>(derivative_half);
  double s2 = 0.0, s4 = 0.0, s6 = 0.0;
  for (int x = -n; x <= n; ++x) {
    const double y = static_cast<double>(x) * x;
    s2 += y;
    s4 += y * y;
    s6 += y * y * y;
  }
  std::vector<double> w;
  for (int x = -n; x <= n; ++x) w.push_back((s6 * x - s4 * x * x * x) / (s2 * s6 - s4 * s4));
  return w;
}

/// Weights of the second derivative on the rows -n..n, per row squared.
inline std::vector<double> curvature_weights() {
  const auto n = static_cast<int>(derivative_half);
  double s0 = 0.0, s2 = 0.0, s4 = 0.0;
  for (int x = -n; x <= n; ++x) {
    const double y = static_cast<double>(x) * x;
    s0 += 1.0;
    s2 += y;
    s4 += y * y;
  }
  std::vector<double> w;
  for (int x = -n; x <= n; ++x) w.push_back(2.0 * (s0 * x * x - s2) / (s0 * s4 - s2 * s2));
  return w;
}

/// Second derivative of `at(row)` per row squared, rows 0 .. rows-1; 0 where there are not n rows on either
/// side.
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
