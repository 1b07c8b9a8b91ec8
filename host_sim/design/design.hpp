#pragma once
/// Switching gains from stated uncertainty: docs/robust-design.md. One function for `esmc design` and for
/// gain = "robust".

#include <cmath>
#include <numbers>
#include <optional>
#include <string>
#include <vector>

#include "host_sim/design/extremes.hpp"

namespace esmc::host::design {

/// By how much every gain exceeds what the search has found: it looks at points, not at every place between
/// them.
inline constexpr double margin = 1.05;

/// Of one channel. Units of the channel (m or rad) per s2.
template <class M>
struct Row {
  double need = 0.0;          ///< |delta| / believed mass or inertia: [F35] without eta
  double eta = 0.0;           ///< what makes s fall
  double linear = 0.0;        ///< that the layer of the implicit step holds the disturbance
  double k = 0.0;             ///< the gain: margin (largest of need and linear, + eta)
  Place place{};              ///< where `need` is largest
  Cause cause = Cause::mass;  ///< which uncertainty alone needs most there
};

/// Band in which the error stays.
struct Band {
  double error = 0.0;    ///< m or rad, of the independent coordinates
  double sliding = 0.0;  ///< the same per s
};

/// Of four motors within their limits: how much of a force they give together, and what is left of their
/// preload.
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
  double inside = 0.0;  ///< share of the tube that is never left again
  double start = 0.0;   ///< size of the tube that would hold the start, m or rad
  double reaching_time =
      0.0;  ///< s, from `inside` to the surface at most: in continuous time, without a layer
  double reach_margin = 0.0;  ///< decrease promised: V' <= -sum M eta |s|; here the least of it per sqrt(2 V)
  std::optional<Band> layer;  ///< [F38]: in continuous time; none for `sign`: s = 0
  std::optional<Band> sampled;  ///< linear zone, sampled, delayed; none where nothing is promised
  double ahead =
      0.0;  ///< part of `sampled`: how far the motion goes while what is measured is late, m or rad
  double mismatch =
      0.0;  ///< largest |H^-1 H_believed - 1|, in the metric of H_believed; smc: its maximum norm
  double disturbance = 0.0;  ///< largest |H^-1 C^T delta|, m/s2 or rad/s2
  double beyond_range =
      0.0;  ///< esmc: largest share of s that no motion follows (r of [F32]), in the metric of M
  std::array<double, M::joints> hold{};  ///< N m: what the worst plant takes on the motion itself
  std::array<double, M::joints> peak{};  ///< N m: what the law asks for at worst in the tube
  Place hold_place{}, peak_place{};
  Shares hold_shares{}, peak_shares{};  ///< four motors: the least of what they give together
  double stiffness =
      0.0;  ///< 1/s, saturation and tanh: the fastest that anything dies within the layer, lambda included
  std::size_t states = 0;  ///< that the search has looked at
};

/// Throws nothing; a problem without points, or one whose numbers are impossible, is refused.
template <class M>
[[nodiscard]] Design<M> design(const Problem<M>& p);

/// Largest stiffness * tick of a layer whose torque acts `delay` ticks late: half of what makes the loop ring
/// by itself [F39].
[[nodiscard]] inline double steepest(double delay) {
  return std::sin(std::numbers::pi / (4.0 * delay + 2.0));
}

/// The gains of a design, with layers as the controller has them. p.controller.gains.lambda and layer must be
/// set.
template <class M>
void apply(const Problem<M>& p, const Design<M>& d, Gains<M>& g);

extern template Design<FiveBar<double>> design(const Problem<FiveBar<double>>&);
extern template Design<Rr<double>> design(const Problem<Rr<double>>&);
extern template void apply(const Problem<FiveBar<double>>&, const Design<FiveBar<double>>&,
                           Gains<FiveBar<double>>&);
extern template void apply(const Problem<Rr<double>>&, const Design<Rr<double>>&, Gains<Rr<double>>&);

}  // namespace esmc::host::design
