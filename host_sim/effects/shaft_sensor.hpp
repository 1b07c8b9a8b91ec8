#pragma once
/// The drive's reading of its shaft, with encoder, noise, bias and delay.

#include <array>
#include <cmath>
#include <deque>
#include <numbers>
#include <optional>

#include "host_sim/effects/effects.hpp"
#include "host_sim/effects/random.hpp"

namespace esmc::host {

/// Reading of a shaft, in turns and turns per second.
struct ShaftReading {
  double position_rev, velocity_rev_s;
};

/// The sensor effects of a scene.
struct SensorEffects {
  std::optional<Encoder> encoder;
  std::optional<SensorNoise> noise;
  std::optional<SensorBias> bias;
  std::optional<SensorDelay> delay;

  explicit SensorEffects(const std::vector<Effect>& effects)
      : encoder(find_effect<Encoder>(effects)),
        noise(find_effect<SensorNoise>(effects)),
        bias(find_effect<SensorBias>(effects)),
        delay(find_effect<SensorDelay>(effects)) {}
  [[nodiscard]] bool none() const { return !encoder && !noise && !bias && !delay; }  ///< the scene has none
};

/// The sensor of one shaft: turns its true motion into the drive's readings, once per period.
class ShaftSensor {
 public:
  /// `period` between readings, s; `rev_per_rad`: turns of the shaft per radian of the joint, signed; `joint`
  /// in the order of the model: each has its own noise.
  ShaftSensor(const SensorEffects& effects, double period, double rev_per_rad, int joint, std::uint64_t seed)
      : observed_(effects.encoder || effects.noise), random_(seed, static_cast<std::uint64_t>(joint)) {
    step_ = period / samples_per_reading;
    if (effects.encoder) counts_per_rev_ = std::ldexp(1.0, effects.encoder->bits);
    if (effects.noise) sigma_rev_ = std::abs(rev_per_rad) * effects.noise->sigma;
    if (effects.bias) bias_rev_ = rev_per_rad * effects.bias->angle[static_cast<std::size_t>(joint)];
    if (effects.delay) delay_ = static_cast<std::size_t>(effects.delay->ticks);
    if (observed_) bandwidth_ = effects.encoder ? effects.encoder->bandwidth : effects.noise->bandwidth;
    decay_ = std::exp(-bandwidth_ * step_);
  }

  /// Resets as after a long motion at constant speed that has reached `truth`. Call before the first read().
  void settle(const ShaftReading& truth) {
    previous_ = truth;
    position_ = raw_sample(truth.position_rev);
    velocity_ = truth.velocity_rev_s;
    ShaftReading last{observed_ ? position_ : truth.position_rev + bias_rev_, velocity_};
    waiting_.clear();
    for (std::size_t i = 0; i < delay_; ++i) {
      waiting_.push_front(last);
      last.position_rev -= velocity_ * step_ * samples_per_reading;
    }
  }

  /// Returns the reading at the end of a period that began at the last reading; call once per period. Between
  /// them the shaft angle is the cubic through both ends, sampled eight times per period.
  ShaftReading read(const ShaftReading& truth) {
    ShaftReading now{truth.position_rev + bias_rev_, truth.velocity_rev_s};
    if (observed_) now = observe(truth);
    if (delay_ == 0) return now;
    waiting_.push_back(now);
    now = waiting_.front();
    waiting_.pop_front();
    return now;
  }

  /// The states of the sensor without its delay, in turns and turns/s, for a linearisation.
  [[nodiscard]] std::array<double*, 4> states() {
    return {&previous_.position_rev, &previous_.velocity_rev_s, &position_, &velocity_};
  }

 private:
  static constexpr int samples_per_reading = 8;

  ShaftReading observe(const ShaftReading& truth) {
    const double period = step_ * samples_per_reading;
    for (int k = 1; k <= samples_per_reading; ++k) {
      const double u = static_cast<double>(k) / samples_per_reading, w = 1.0 - u;
      const double angle = previous_.position_rev * w * w * (1.0 + 2.0 * u) +
                           truth.position_rev * u * u * (1.0 + 2.0 * w) +
                           period * u * w * (w * previous_.velocity_rev_s - u * truth.velocity_rev_s);
      track(raw_sample(angle));
    }
    previous_ = truth;
    return {position_, velocity_};
  }
  /// One sample at the true angle `rev`, turns: bias, noise (a new draw per call), rounded to counts. Without
  /// the tracking loop and the delay.
  [[nodiscard]] double raw_sample(double rev) {
    rev += bias_rev_;
    if (sigma_rev_ > 0.0) rev += sigma_rev_ * random_();
    return counts_per_rev_ > 0.0 ? std::round(rev * counts_per_rev_) / counts_per_rev_ : rev;
  }

  /// The drive's tracking loop, critically damped with both poles at e^{-bandwidth T}; exact at constant
  /// speed.
  void track(double y) {
    const double ahead = position_ + step_ * velocity_, miss = y - ahead, quick = 1.0 - decay_;
    position_ = ahead + (1.0 - decay_ * decay_) * miss;
    velocity_ += quick * quick / step_ * miss;
  }

  bool observed_;
  Normal random_;
  ShaftReading previous_{};
  std::deque<ShaftReading> waiting_;
  std::size_t delay_ = 0;
  double step_ = 0.0, counts_per_rev_ = 0.0, sigma_rev_ = 0.0, bias_rev_ = 0.0, bandwidth_ = 0.0,
         decay_ = 0.0;
  double position_ = 0.0, velocity_ = 0.0;
};

}  // namespace esmc::host
