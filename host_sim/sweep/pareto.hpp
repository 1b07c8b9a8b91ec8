#pragma once
/// Pareto fronts: points that no other point dominates.

#include <cstddef>
#include <vector>

namespace esmc::host {

/// Rows of `points` (all of one length, smaller is better) that no other row dominates, in the order of the
/// first column, then the second, ... Of equal rows the first one stands for all. Rows with a number that is
/// not finite are left out.
[[nodiscard]] std::vector<std::size_t> pareto_front(const std::vector<std::vector<double>>& points);

}  // namespace esmc::host
