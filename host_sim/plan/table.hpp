#pragma once
/// A timed stretch as quintics.

#include <algorithm>
#include <utility>
#include <vector>

#include "firmware/control/reference.hpp"
#include "host_sim/plan/timing.hpp"

namespace esmc::host::plan {

/// A quintic from `begin`, s after the beginning of its stretch.
struct TimedPiece {
  double begin = 0.0;
  Quintic<double> curve;
  bool joins = false;  ///< begins with the motion with which the one before ends
};

/// Motion at a time: acceleration before it and after it.
struct Knot {
  Motion2<double> before, after;
};

/// As of Quintic::at(), but t, s, must be in [0, duration]: it is not clamped. The velocity is left zero,
/// because fit_quintics() does not compare it.
[[nodiscard]] inline Motion2<double> motion_at(const Quintic<double>& q, double t) {
  const double pace = 1.0 / q.duration, u = t * pace;
  const auto& c = q.c;
  return {c[0] + (c[1] + (c[2] + (c[3] + (c[4] + c[5] * u) * u) * u) * u) * u,
          {},
          (c[2] * 2.0 + (c[3] * 6.0 + (c[4] * 12.0 + c[5] * (20.0 * u)) * u) * u) * (pace * pace)};
}

/// As few quintics as meet `knot(time)` at the breaks of a timing, and `motion(time)` halfway between them,
/// within 2e-3 of its largest acceleration and a micrometre. Their ends are its breaks, where they meet it
/// with speed and acceleration.
template <class K, class F>
[[nodiscard]] std::vector<TimedPiece> fit_quintics(const std::vector<double>& breaks, const K& knot,
                                                   const F& motion) {
  struct Node {
    double t;
    Knot at{};
    Motion2<double> middle;  // halfway to the next
    bool jumps = false;      // acceleration, there
  };
  constexpr double share = 2e-3, near = 1e-6;  // of acceleration; m
  std::vector<Node> nodes;
  nodes.reserve(breaks.size());
  double most = 0.0;
  for (std::size_t i = 0; i < breaks.size(); ++i) {
    const double t = breaks[i];
    nodes.push_back({t, knot(t), {}});
    if (i + 1 < breaks.size()) nodes.back().middle = motion(0.5 * (t + breaks[i + 1]));
    most = std::max(most, nodes.back().at.after.acceleration.norm());
  }
  const double acceleration_scale = 1.0 / std::pow(share * most, 2), position_scale = 1.0 / (near * near);
  const auto error = [&](const Motion2<double>& a, const Motion2<double>& b) {
    return std::max((a.acceleration - b.acceleration).squaredNorm() * acceleration_scale,
                    (a.position - b.position).squaredNorm() * position_scale);
  };
  std::vector<TimedPiece> out;
  std::vector<std::pair<std::size_t, std::size_t>> open;
  std::size_t end = nodes.size() - 1;
  for (std::size_t k = end; k-- > 0;) {  // a jump of acceleration is between two quintics
    Knot& at = nodes[k].at;
    if (k > 0 && !(error(at.before, at.after) > 1.0)) {
      at.before.acceleration = at.after.acceleration = 0.5 * (at.before.acceleration + at.after.acceleration);
      continue;
    }
    nodes[k].jumps = true;
    open.emplace_back(k, std::exchange(end, k));
  }
  while (!open.empty()) {
    const auto [i, j] = open.back();
    open.pop_back();
    const double begin = nodes[i].t;
    const auto q = Quintic<double>::between(nodes[i].at.after, nodes[j].at.before, nodes[j].t - begin);
    double worst = 1.0;
    std::size_t split = i;
    for (std::size_t k = i; k < j; ++k) {
      double here = error(motion_at(q, 0.5 * (nodes[k].t + nodes[k + 1].t) - begin), nodes[k].middle);
      if (k > i) here = std::max(here, error(motion_at(q, nodes[k].t - begin), nodes[k].at.after));
      if (here > worst) {
        worst = here;
        split = std::clamp(k, i + 1, std::max(i + 1, j - 1));
      }
    }
    if (split == i || j - i < 2) {
      out.push_back({begin, q, !nodes[i].jumps});
    } else {
      open.emplace_back(split, j);
      open.emplace_back(i, split);
    }
  }
  return out;
}

}  // namespace esmc::host::plan
