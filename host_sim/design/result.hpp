#pragma once
/// Switching gains from stated uncertainty: docs/robust-design.md. `esmc design` and gain = "robust" call the
/// same function.

#include <cmath>
#include <numbers>
#include <optional>
#include <string>
#include <vector>

#include "host_sim/design/extremes.hpp"

namespace esmc::host::design {

/// Factor of every gain over what the search found, which looks at points only.
inline constexpr double margin = 1.05;

/// Of one channel. Units of the channel (m or rad) per s2.
template <class M>
struct Row {
  double need = 0.0;          ///< |delta| / believed mass or inertia: [F35] without eta
  double eta = 0.0;           ///< decrease of s
  double linear = 0.0;        ///< with which the layer of the implicit step holds the disturbance
  double k = 0.0;             ///< the gain: margin (largest of need and linear, + eta)
  Place place{};              ///< where `need` is largest
  Cause cause = Cause::mass;  ///< which uncertainty alone needs most there
};

/// Band in which the error stays.
struct Band {
  double error = 0.0;    ///< m or rad, of the independent coordinates
  double sliding = 0.0;  ///< the same per s
};

/// Shares of a force and of their preload that four motors give together within their limits.
struct Shares {
  double force = 1.0, preload = 1.0;
};

template <class M>
struct Design {
  std::string refused;                ///< why no gain is given; empty: there is one
  std::vector<std::string> warnings;  ///< what the promise does not reach
  std::array<Row<M>, M::channels> row{};
  double k_independent = 0.0;    ///< smc: of the independent coordinates
  double eta_independent = 0.0;  ///< smc: m/s2 or rad/s2
  double tube = 0.0;             ///< E: |e| <= E and |e' + lambda e| <= lambda E, m or rad
  bool tube_given = false;
  double inside = 0.0;         ///< share of the tube that is never left again
  double start = 0.0;          ///< size of the tube that would hold the start, m or rad
  double reaching_time = 0.0;  ///< s at most from `inside` to the surface, in continuous time without a layer
  double reach_margin = 0.0;  ///< decrease promised: V' <= -sum M eta |s|; here the least of it per sqrt(2 V)
  std::optional<Band> layer;  ///< [F38]: in continuous time; none for `sign`: s = 0
  std::optional<Band> sampled;  ///< linear zone, sampled, delayed; none where nothing is promised
  double ahead = 0.0;           ///< part of `sampled`: motion during the delay of measurements, m or rad
  double mismatch = 0.0;  ///< largest |H^-1 H_believed - 1|, in the metric of H_believed; smc: maximum norm
  double disturbance = 0.0;  ///< largest |H^-1 C^T delta|, m/s2 or rad/s2
  double beyond_range =
      0.0;  ///< esmc: largest share of s outside the range of C ([F32] r), in the metric of M
  std::array<double, M::joints> hold{};  ///< N m: the worst plant's torque on the motion itself
  std::array<double, M::joints> peak{};  ///< N m: the law's largest torque in the tube
  Place hold_place{}, peak_place{};
  Shares hold_shares{}, peak_shares{};  ///< four motors: least shares
  double stiffness = 0.0;  ///< 1/s, saturation and tanh: largest decay rate within the layer, lambda included
  std::size_t states = 0;  ///< number of states that the search looked at
};

/// Largest stiffness * tick (1) that a design accepts for a layer whose torque acts `delay` ticks late: half
/// of the bound at which the loop becomes unstable [F39].
[[nodiscard]] inline double steepest(double delay) {
  return std::sin(std::numbers::pi / (4.0 * delay + 2.0));
}

/// Sets the gains of a design that is not refused, and layers of the implicit law. All else must be set.
template <class M>
void apply(const Problem<M>& p, const Design<M>& d, Gains<M>& g) {
  const auto& c = p.controller;
  const bool implicit = c.reaching == Reaching::implicit;
  for (int i = 0; i < M::channels; ++i) {
    g.k[i] = d.row[static_cast<std::size_t>(i)].k;
    if (implicit && g.k[i] > 0.0) g.layer[i] = implicit_layer(g.k[i], c.sample_time, p.told_ticks);
  }
  g.independent.k = d.k_independent;
  if (implicit && g.independent.k > 0.0)
    g.independent.layer = implicit_layer(g.independent.k, c.sample_time, p.told_ticks);
}

/// Designs gains. A problem without points or with impossible numbers is refused in the result; no exception.
template <class M>
[[nodiscard]] Design<M> design(const Problem<M>& p);

}  // namespace esmc::host::design
