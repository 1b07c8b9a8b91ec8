#pragma once
/// What a drive knows of its shaft: the truth, or with the `encoder` effect a quantised angle and an observer.

#include <cmath>
#include <numbers>
#include <optional>

#include "host_sim/effects/effects.hpp"

namespace esmc::host {

struct ShaftReading {
  double position_rev, velocity_rev_s;
};

class ShaftSensor {
 public:
  /// `period` between readings, s.
  ShaftSensor(const std::optional<Encoder>& encoder, double period) : encoder_(encoder) {
    if (!encoder_) return;
    step_ = period / samples_per_reading;
    counts_per_rev_ = std::ldexp(1.0, encoder_->bits);
    decay_ = std::exp(-encoder_->bandwidth * step_);
  }

  /// The shaft has been at rest here for long.
  void settle(const ShaftReading& truth) {
    previous_ = truth;
    position_ = quantised(truth.position_rev);
    velocity_ = 0.0;
  }

  /// Reading at the end of a period that began at the last reading. The shaft angle in between is the cubic
  /// through both ends, sampled as often as the drive's own loop does (8 kHz at 1 kHz readings).
  ShaftReading read(const ShaftReading& truth) {
    if (!encoder_) return truth;
    const double period = step_ * samples_per_reading;
    for (int k = 1; k <= samples_per_reading; ++k) {
      const double u = static_cast<double>(k) / samples_per_reading, w = 1.0 - u;
      const double angle = previous_.position_rev * w * w * (1.0 + 2.0 * u) +
                           truth.position_rev * u * u * (1.0 + 2.0 * w) +
                           period * u * w * (w * previous_.velocity_rev_s - u * truth.velocity_rev_s);
      track(quantised(angle));
    }
    previous_ = truth;
    return {position_, velocity_};
  }

 private:
  static constexpr int samples_per_reading = 8;
  [[nodiscard]] double quantised(double rev) const { return std::round(rev * counts_per_rev_) / counts_per_rev_; }

  /// p' = v + 2 b (y - p), v' = b^2 (y - p), exactly over a step with y held: e^{-bT} (1 + (A + b) T).
  void track(double y) {
    const double b = encoder_->bandwidth, e = position_ - y;
    const double e_next = decay_ * (e + step_ * (velocity_ - b * e));
    velocity_ = decay_ * (velocity_ + step_ * (b * velocity_ - b * b * e));
    position_ = y + e_next;
  }

  std::optional<Encoder> encoder_;
  ShaftReading previous_{};
  double step_ = 0.0, counts_per_rev_ = 0.0, decay_ = 0.0;
  double position_ = 0.0, velocity_ = 0.0;
};

}  // namespace esmc::host
