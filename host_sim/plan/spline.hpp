#pragma once
/// Natural cubic splines through points.

#include <vector>

#include "firmware/types.hpp"

namespace esmc::host::plan {

/// Second derivatives at the points of a natural cubic spline, zero at both ends; span: parameter from each
/// point to the next, > 0. Three points or more.
[[nodiscard]] inline std::vector<Vec2<double>> second_derivatives(const std::vector<Vec2<double>>& point,
                                                                  const std::vector<double>& span) {
  const std::size_t n = point.size();
  std::vector<Vec2<double>> m(n, Vec2<double>::Zero()), rhs(n, Vec2<double>::Zero());
  std::vector<double> upper(n, 0.0);
  for (std::size_t i = 1; i + 1 < n; ++i) {  // Thomas algorithm
    const double a = span[i - 1], c = span[i], b = 2.0 * (a + c) - a * upper[i - 1];
    const Vec2<double> d = 6.0 * ((point[i + 1] - point[i]) / c - (point[i] - point[i - 1]) / a);
    upper[i] = c / b;
    rhs[i] = (d - a * rhs[i - 1]) / b;
  }
  for (std::size_t i = n - 1; i-- > 1;) m[i] = rhs[i] - upper[i] * m[i + 1];
  return m;
}

}  // namespace esmc::host::plan
