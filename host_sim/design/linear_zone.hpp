#pragma once
/// The sampled loop while no row of the switching term is saturated: with the implicit step K_i / layer_i is
/// the same 1 / (1 + d) h in all rows, so that C^T M K sw(C sigma) = H_believed sigma / ((1 + d) h) [F28],
/// which leaves a scalar loop with the disturbance H^-1 C^T delta and the gain error H^-1 H_believed - 1:
/// small gain, with peak gains. To first order: the metric of H_believed is constant over the memory of the
/// loop, about 1 / lambda.

#include <cmath>
#include <vector>

#include "host_sim/design/result.hpp"
#include "host_sim/design/worst.hpp"

namespace esmc::host::design {

// The scalar loop that all laws are in their linear zone [F28]: a double integrator, e'' = w - u, with u =
// (lambda + kappa) e' + lambda kappa e, sampled, held and delayed. Its peak gains from the worst
// acceleration with |w| <= 1 in every tick: sums of the absolute impulse response.

/// Largest |e| (s2), |e' + lambda e| (s) and |u| per |w|.
struct PeakGains {
  double error = 0.0, sliding = 0.0, command = 0.0;
  bool stable = true;
};

/// `kappa` = K / layer and `lambda` in 1/s; `tick` in s, > 0; `delay` in ticks and parts of ticks, >= 0. An
/// unstable loop has `stable` = false and no meaningful gains.
[[nodiscard]] inline PeakGains peak_gains(double lambda, double kappa, double tick, double delay) {
  PeakGains out;
  const int whole = static_cast<int>(std::floor(delay)), oldest = whole + 1;
  const double part = delay - whole;  // of a tick, in which the command before still acts
  std::vector<double> held(static_cast<std::size_t>(oldest) + 1, 0.0);
  double e = 0.0, rate = 0.0;
  constexpr int longest = 2'000'000;
  double recent = 0.0;
  int quiet = 0;
  for (int n = 0; n < longest; ++n) {
    const double u = (lambda + kappa) * rate + lambda * kappa * e;
    const auto slot = [&](int ago) {
      return static_cast<std::size_t>((n - ago + oldest + 1) % (oldest + 1));
    };
    held[slot(0)] = u;
    out.command += std::abs(u);
    const auto advance = [&](double share, double acting) {
      const double a = (n == 0 ? 1.0 : 0.0) - acting, t = share * tick;
      e += t * (rate + 0.5 * t * a);
      rate += t * a;
    };
    advance(part, held[slot(oldest)]);
    advance(1.0 - part, held[slot(whole)]);
    out.error += std::abs(e);
    out.sliding += std::abs(rate + lambda * e);
    recent = std::abs(rate) + lambda * std::abs(e);
    if (!(recent < 1e6 * tick)) return {0, 0, 0, false};
    quiet = recent < 1e-12 * tick ? quiet + 1 : 0;
    if (quiet > 2 * oldest + 2) return out;
  }
  out.stable = false;
  return out;
}

template <class M>
struct LinearZone {
  double disturbance = 0.0;                ///< largest |H^-1 C^T delta|, m/s2 or rad/s2
  double mismatch = 0.0;                   ///< largest |H^-1 H_believed - 1|, in the metric of H_believed
  PeakGains peak;                          ///< worst of all delays up to the assumed one
  bool holds = false;                      ///< the small-gain condition
  Band band;                               ///< of the measured error
  double speed = 0.0, acceleration = 0.0;  ///< largest of the motion, of the independent coordinates
  typename M::Channels gain = M::Channels::Zero();  ///< with which no row saturates
  double gain_independent = 0.0;
};

/// Acceleration error, m/s2 or rad/s2, of a torque that was computed for an earlier instant of the motion; 0
/// where the reference was out of reach then. `H`: believed inertia.
template <class M>
[[nodiscard]] Vec2<double> stale_acceleration(const Problem<M>& p, const Place& at, const State<M>& s,
                                              const Mat<double, 2, 2>& H) {
  State<M> old;
  if (!desired(p, motion_before(p, at), old.track)) return Vec2<double>::Zero();
  old.track.pose = old.track.desired_pose;
  old.track.rates = old.track.desired_rates;
  ask(p, old);
  const auto& m = p.controller.mechanism;
  const Vec2<double> miss = m.base_torque(s.track.pose, m.force(s.wanted, s.track.rates)) -
                            m.base_torque(old.track.pose, m.force(old.wanted, old.track.rates));
  Vec2<double> f;
  for (int k = 0; k < 2; ++k) {
    const Vec2<double> unit(k == 0 ? 1.0 : 0.0, k == 0 ? 0.0 : 1.0);
    f[k] = dot(M::base(m.chain_rates(s.track.pose, unit)), miss);
  }
  return inverse(H) * f;
}

/// The linear zone at `places` of the motion, for small errors; places out of reach are left out. For other
/// laws than the implicit one `holds` is false: disturbance, mismatch, speed and acceleration alone are set.
template <class M>
[[nodiscard]] LinearZone<M> linear_zone_of(const Problem<M>& p, const Uncertain<M>& u, double swing,
                                           const std::vector<Place>& places) {
  LinearZone<M> out;
  double worst = 0.0, smallest = std::numeric_limits<double>::infinity(), reach_independent = 0.0;
  typename M::Channels reach = M::Channels::Zero();  // |c_i| in the metric of H_believed
  State<M> s;
  for (const Place& at : places) {
    if (!state_at(p, at, 0.0, s)) continue;
    const Vec2<double> velocity = M::independent(s.track.desired_rates),
                       acceleration = M::independent(s.track.desired_acceleration);
    out.speed = std::max(out.speed, std::sqrt(dot(velocity, velocity)));
    out.acceleration = std::max(out.acceleration, std::sqrt(dot(acceleration, acceleration)));
    const Worst<M> w(u, s, swing);
    const Mat<double, 2, 2> R = root(w.believed()), back = inverse(R), inv = inverse(w.believed());
    const auto length = [&](const Vec2<double>& v) {
      const Vec2<double> r = R * v;
      return std::sqrt(dot(r, r));
    };
    const double stale = length(stale_acceleration(p, at, s, w.believed()));
    worst = std::max(worst,
                     stale + w.largest([&](const auto& H, const auto& F) { return length(inverse(H) * F); }));
    out.disturbance = std::max(out.disturbance, w.largest([&](const auto& H, const auto& F) {
      const Vec2<double> d = inverse(H) * F;
      return std::sqrt(dot(d, d));
    }));
    out.mismatch = std::max(out.mismatch, w.largest([&](const auto& H, const auto&) {
      const Vec2<double> mu = eigenvalues(back.transpose() * H * back);
      return mu[0] > 0.0 ? std::max(std::abs(1.0 / mu[0] - 1.0), std::abs(1.0 / mu[1] - 1.0)) : 1e300;
    }));
    smallest = std::min(smallest, eigenvalues(w.believed())[0]);
    for (int i = 0; i < M::channels; ++i) {
      const Vec2<double> c(s.column[0][i], s.column[1][i]);
      reach[i] = std::max(reach[i], std::sqrt(dot(c, Vec2<double>(inv * c))));
    }
    for (int i = 0; i < 2; ++i) reach_independent = std::max(reach_independent, std::sqrt(inv(i, i)));
  }
  if (p.controller.reaching != Reaching::implicit) return out;
  const double h = p.controller.sample_time, layer_time = (1.0 + p.told_ticks) * h;
  const int latest = static_cast<int>(std::ceil(p.told_ticks));
  for (int late = 0; late <= latest; ++late) {
    const PeakGains now = peak_gains(p.controller.gains.independent.lambda, 1.0 / layer_time, h,
                                     std::min<double>(late, p.told_ticks));
    out.peak = {std::max(out.peak.error, now.error), std::max(out.peak.sliding, now.sliding),
                std::max(out.peak.command, now.command), out.peak.stable && now.stable};
  }
  constexpr double least = 0.05;  // of 1 that the small gain must leave
  const double left = 1.0 - out.peak.command * out.mismatch;
  out.holds = out.peak.stable && left > least;
  if (!out.holds) return out;
  const double metric = worst / left;
  out.gain = reach * (out.peak.sliding * metric / layer_time);
  out.gain_independent = reach_independent * out.peak.sliding * metric / layer_time;
  out.band = {out.peak.error * metric / std::sqrt(smallest), out.peak.sliding * metric / std::sqrt(smallest)};
  return out;
}

}  // namespace esmc::host::design
