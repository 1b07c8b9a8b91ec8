#pragma once
/// Feed-rate override: the reference as a function of a path time that passes at a rate from 0 to 1, so that
/// the mechanism gets slower and stops on its path. With s' the rate: velocity s' p', acceleration s'^2 p'' +
/// s'' p'.

#include <cstdint>

#include "firmware/control/reference.hpp"

namespace esmc {

/// Path time and its rate, 0 to 1, both as integers: nothing drifts, and at rate 0 the motion rests.
template <class S>
class PathRate {
 public:
  static constexpr unsigned percent_max = 100;

  PathRate() = default;
  /// Limits the change of rate: |s'' p'| <= `acceleration` (m/s2 or rad/s2, > 0) in each coordinate, and
  /// |s''| <= 10/s; see step() for exceptions. `sample_time`: s, > 0.
  PathRate(S acceleration, S sample_time) : acceleration_(acceleration), sample_time_(sample_time) {}

  /// True if the caller must use step() in place of the reference: since begin() a rate below 1 was wanted.
  [[nodiscard]] bool active() const { return active_; }
  /// Sets the rate, percent, clamped to 100, which begin() starts with and step() approaches.
  void want(unsigned percent) {
    wanted_ = percent < percent_max ? percent * (one / percent_max) : one;
    active_ = active_ || wanted_ != one;
  }
  /// Starts path time at 0 with the wanted rate, or 1 where that is 0. Returns the rate, 0 < rate <= 1.
  S begin() {
    delay_ = 0;
    rate_ = wanted_ > 0 ? wanted_ : one;
    active_ = wanted_ != one;
    return as_real(rate_);
  }

  /// Motion in a tick since begin(); call it once in each while active(). `lead`: ticks that the motion is
  /// ahead of the path time. `feasible(motion)`: whether the motors have the torque for it. Of the full
  /// change of rate, its half, quarter and eighth, the first feasible one is made. If none is feasible, the
  /// rate stays, for 256 ticks at most: then the eighth is made in any case, so that a hold always ends in
  /// rest.
  template <class Reference, class Feasible>
  Motion2<S> step(const Reference& reference, std::uint64_t tick, std::uint32_t lead,
                  const Feasible& feasible) {
    Motion2<S> m = reference.at(at((tick << TickTime::bits) - delay_ + lead * std::uint64_t{rate_} * 2));
    const Vec2<S> along = m.velocity;  // per second of path time
    const S rate = as_real(rate_);
    m.velocity *= rate;
    m.acceleration *= rate * rate;
    const std::uint32_t before = rate_;
    if (rate_ == wanted_) waited_ = 0;
    if (rate_ != wanted_) {
      std::uint32_t change = change_within(along);
      const Motion2<S> steady = m;
      for (int tries = 0;; ++tries) {
        const std::uint32_t next = changed(change);
        const auto by = static_cast<std::int32_t>(next) - static_cast<std::int32_t>(rate_);
        m.acceleration = steady.acceleration + along * (S(by) * (S(1) / S(one)) / sample_time_);
        const bool can = feasible(m);
        if (can) waited_ = 0;
        if (can || (tries == 3 && waited_ >= patience)) {
          rate_ = next;
          break;
        }
        if (tries == 3) {
          ++waited_;
          m = steady;
          break;
        }
        change = (change + 1) / 2;
      }
    }
    delay_ += 2 * std::uint64_t{one} - before - rate_;  // the mean of both, in units of a fraction
    return m;
  }

 private:
  static constexpr std::uint32_t one = 1U << (TickTime::bits - 1);  // so that a sum of two has no halves
  static constexpr std::uint32_t patience = 256;                    // ticks
  static constexpr S fastest = S(10);                               // 1/s

  static S as_real(std::uint32_t rate) { return S(rate) * (S(1) / S(one)); }
  static TickTime at(std::uint64_t fractions) {
    constexpr std::uint32_t mask = (1U << TickTime::bits) - 1;
    return {fractions >> TickTime::bits, static_cast<std::uint32_t>(fractions) & mask};
  }
  /// Largest change of the rate in a tick, > 0.
  [[nodiscard]] std::uint32_t change_within(const Vec2<S>& along) const {
    const S a = magnitude(along[0]), b = magnitude(along[1]);
    const S speed = a > b ? a : b;
    const S limit = speed * fastest > acceleration_ ? acceleration_ / speed : fastest;
    const S change = limit * sample_time_ * S(one);
    return change >= S(one) ? one : (change >= S(1) ? static_cast<std::uint32_t>(change) : 1U);
  }
  /// The rate after a change towards the wanted one.
  [[nodiscard]] std::uint32_t changed(std::uint32_t by) const {
    if (rate_ < wanted_) return wanted_ - rate_ > by ? rate_ + by : wanted_;
    return rate_ - wanted_ > by ? rate_ - by : wanted_;
  }

  S acceleration_{1}, sample_time_{1};
  std::uint64_t delay_ = 0;  // of path time, unit 2^-24 tick
  std::uint32_t rate_ = one, wanted_ = one;
  std::uint32_t waited_ = 0;  // ticks without a change that the motors can
  bool active_ = false;
};

}  // namespace esmc
