#pragma once
/// The super-twisting law, discretised implicitly (Brogliato, Polyakov, Efimov: The implicit discretization
/// of the super-twisting sliding-mode control algorithm, IEEE Transactions on Automatic Control 65, 2020),
/// for the two degrees of freedom of the mechanism: an integrator in every redundant channel would wind up in
/// directions in which the mechanism cannot move. docs/reaching.md.

#include <cstdint>

#include "firmware/numeric/elementary.hpp"
#include "firmware/types.hpp"

namespace esmc {

/// One backward-Euler step of s' = -k1 |s|^1/2 sgn s - zeta, zeta' = k2 sgn s, where zeta = z - phi is the
/// error of the integral z as an estimate of the disturbance phi. ahead: s + T (phi - z); T: horizon of the
/// step, s, equal to the sample time h if nothing is late; k1, k2 >= 0. Advances z by h seconds and returns
/// w = k1 |s+|^1/2 sgn s+ + z+. NaN stays NaN.
///
/// s+ solves: s+ + T k1 |s+|^1/2 sgn s+ + T h k2 Sgn s+ contains `ahead`. Within T h k2 that is s+ = 0,
/// outside a quadratic in |s+|^1/2.
template <class S>
[[nodiscard]] S super_twisting_step(S ahead, S T, S h, S k1, S k2, S& z) {
  const S zone = T * h * k2;
  const S beyond = ahead > zone ? ahead - zone : (ahead < -zone ? -ahead - zone : S(0));
  if (!(beyond > S(0))) return z += ahead / T;  // on the surface after this step
  const S side = ahead > S(0) ? S(1) : S(-1), damp = T * k1;
  // The positive root of x^2 + damp x - beyond = 0, without its cancellation.
  const S root = S(2) * beyond / (damp + square_root(damp * damp + S(4) * beyond));
  z += side * h * k2;
  return side * k1 * root + z;
}

/// Known delays of the loop, in ticks.
template <class S>
struct Lateness {
  int delay = 0;  ///< of the torque, 0 .. SuperTwisting::most_delay
  S lag{};        ///< of the measurement, >= 0
};

/// The law on the two independent coordinates; s in m/s or rad/s. It estimates the disturbance up to the last
/// tick: the change of s less that by the w that acted. A torque delay is bridged by the w that are under
/// way; a sensor lag lengthens the step as in [F39] and low-passes the estimate.
template <class S>
class SuperTwisting {
 public:
  static constexpr int most_delay = 8;  ///< ticks

  /// Returns to the state of the first tick: integral zero, no w under way.
  void reset() { ticks_ = 0; }

  /// Acceleration w (unit of s / s) that lowers s by w per second. rate: bound L >= 0 of the disturbance's
  /// rate of change, unit of s / s2; h: sample time, s; lost: the part of the last w that did not become
  /// torque; while it is not zero, the integral stays.
  [[nodiscard]] Vec2<S> step(const Vec2<S>& s, const Vec2<S>& lost, S rate, S h, Lateness<S> late) {
    const int delay = late.delay;
    const S slower = S(1) + late.lag, T = h * slower, trust = S(1) / (slower * slower);
    if (ticks_ == 0) {
      z_.setZero();
      phi_.setZero();
    } else {
      if (!(lost[0] == S(0) && lost[1] == S(0))) z_ = before_;
      acted_[0] -= lost;
    }
    const int under_way = ticks_ < delay ? ticks_ : delay;
    const S k1 = S(1.5) * square_root(rate), k2 = S(1.1) * rate;
    before_ = z_;
    Vec2<S> w;
    for (int i = 0; i < 2; ++i) {
      if (ticks_ > delay) phi_[i] += trust * ((s[i] - last_[i]) / h + acted_[delay][i] - phi_[i]);
      S ahead = s[i] + T * (phi_[i] - z_[i]);
      for (int k = 0; k < under_way; ++k) ahead += h * (phi_[i] - acted_[k][i]);
      w[i] = super_twisting_step(ahead, T, h, k1, k2, z_[i]);
    }
    last_ = s;
    for (int k = delay; k > 0; --k) acted_[k] = acted_[k - 1];
    acted_[0] = w;
    if (ticks_ <= most_delay) ++ticks_;
    return w;
  }

  /// Calls f on each vector that a later step reads, to linearise the law.
  template <class F>
  void each_state(const F& f) {
    for (Vec2<S>* v : {&z_, &before_, &last_, &phi_}) f(*v);
    for (int k = 0; k <= most_delay; ++k) f(acted_[k]);
  }

  /// The integral: disturbance that is compensated, unit of s / s. Undefined from reset() to the next step().
  [[nodiscard]] const Vec2<S>& integral() const { return z_; }

 private:
  Vec2<S> z_, before_, last_, phi_;
  List<Vec2<S>, most_delay + 1> acted_;  ///< w of the last tick first
  int ticks_ = 0;                        ///< number of valid entries
};

}  // namespace esmc
