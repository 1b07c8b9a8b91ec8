#pragma once
/// The scalar loop that all laws are in their linear zone [F28]: a double integrator, e'' = w - u, with u =
/// (lambda + kappa) e' + lambda kappa e, sampled, held and delayed. Its peak gains from the worst
/// acceleration with |w| <= 1 in every tick: sums of the absolute impulse response.

#include <cmath>
#include <vector>

namespace esmc::host::design {

/// Largest |e| (s2), |e' + lambda e| (s) and |u| per |w|.
struct PeakGains {
  double error = 0.0, sliding = 0.0, command = 0.0;
  bool stable = true;
};

/// Peak gains of the sampled loop in its layer. `kappa` = K / layer and `lambda`, 1/s; `tick` in s, > 0;
/// `delay` in ticks and parts of ticks, >= 0.
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

}  // namespace esmc::host::design
