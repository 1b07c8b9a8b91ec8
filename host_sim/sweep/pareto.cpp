#include "host_sim/sweep/pareto.hpp"

#include <algorithm>
#include <cmath>

namespace esmc::host {

std::vector<std::size_t> pareto_front(const std::vector<std::vector<double>>& points) {
  std::vector<std::size_t> order;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (std::all_of(points[i].begin(), points[i].end(), [](double v) { return std::isfinite(v); }))
      order.push_back(i);
  }
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return points[a] != points[b] ? points[a] < points[b] : a < b;
  });
  // In this order nothing that comes later dominates what came before.
  std::vector<std::size_t> front;
  for (const std::size_t i : order) {
    const auto no_better = [&](std::size_t f) {
      return std::equal(points[f].begin(), points[f].end(), points[i].begin(),
                        [](double a, double b) { return a <= b; });
    };
    // The last one of a front of two objectives has the smallest second.
    if (std::none_of(front.rbegin(), front.rend(), no_better)) front.push_back(i);
  }
  return front;
}

}  // namespace esmc::host
