#pragma once
/// The motion that a supervisor computer requests instead of the reference: rest, set points, a stream of
/// samples. Limits per coordinate: |velocity| <= speed, |acceleration| <= acceleration.

#include <cstdint>

#include "firmware/control/reference.hpp"

namespace esmc {

/// Duration T (s) of a quintic that takes an offset and its rate to zero, starting without acceleration,
/// within both limits if |rate| <= speed. With r = |offset| / T the velocity towards zero is (1 - u)^2 (rate
/// (1 + 2 u) + u^2 (30 r - 15 rate)): at most `speed` if 30 r <= 16 speed for a rate towards zero, if 30 r +
/// 15 |rate| <= 16 speed for a rate away from it. The acceleration is at most (10/sqrt(3) r + 3.941 |rate|) /
/// T, the sum of the extrema of both polynomials.
template <class S>
[[nodiscard]] S fading_time(S offset, S rate, S speed, S acceleration) {
  const bool away = (offset > S(0)) == (rate > S(0));
  const S distance = offset < S(0) ? -offset : offset, w = rate < S(0) ? -rate : rate;
  const S room = S(16) * speed - (away ? S(15) * w : S(0));
  const S by_speed = S(30) * distance / (room > speed ? room : speed);
  const S b = S(3.941L) * w, c = S(4) * acceleration * S(5.7735027L) * distance;
  const S by_acceleration = (b + square_root(b * b + c)) / (S(2) * acceleration);
  return by_speed > by_acceleration ? by_speed : by_acceleration;
}

/// Generates a motion to rest, to set points, or along a stream.
template <class S>
class SetpointGenerator {
 public:
  SetpointGenerator() = default;
  /// Limits `speed` (m/s or rad/s) and `acceleration` (m/s2 or rad/s2), > 0; `sample_time` in s, > 0.
  /// `angles`: differences are wrapped to (-pi, pi].
  SetpointGenerator(S speed, S acceleration, S sample_time, bool angles)
      : speed_(speed), acceleration_(acceleration), sample_time_(sample_time), angles_(angles) {}

  /// True if the caller is to follow this motion instead of the reference.
  [[nodiscard]] bool active() const { return active_; }
  void activate(bool yes) { active_ = yes; }  ///< sets active(), and nothing else

  /// Plans the way to rest from the measured state of the first tick (m and m/s, or rad and rad/s).
  void start(const Vec2<S>& position, const Vec2<S>& velocity) {
    following_ = false;
    brake({position, velocity, Vec2<S>::Zero()});
  }
  /// Plans the way from the present motion to rest, half of velocity * braking time ahead; ends a stream.
  void hold() { brake(at()); }
  /// Plans the way from the present motion to rest at `target`, m or rad. The caller checks that the target
  /// is in reach; nothing checks the way to it here.
  void go_to(const Vec2<S>& target) {
    const Motion2<S> now = at();
    const Vec2<S> offset = apart(now.position, target);
    const S time = longest(offset, now.velocity);
    following_ = false;
    plan(offset, now.velocity, time);
    base_ = {now.position - offset, Vec2<S>::Zero(), Vec2<S>::Zero()};
  }
  /// Follows samples (m, m/s or rad, rad/s), one per tick; the first one's offset from the motion fades away.
  void follow(const Vec2<S>& position, const Vec2<S>& velocity) {
    if (!following_) {
      const Motion2<S> now = at();
      const Vec2<S> offset = apart(now.position, position), rate = now.velocity - velocity;
      plan(offset, rate, longest(offset, rate));
      base_ = {position, velocity, Vec2<S>::Zero()};
    } else {
      // The acceleration is known only from samples of consecutive ticks.
      const S by = age_ == 1 ? S(1) / sample_time_ : S(0);
      base_ = {position, velocity, Vec2<S>((velocity - base_.velocity) * by)};
    }
    following_ = true;
    age_ = 0;
  }

  /// Motion of the present tick, m or rad, and per s, s2.
  [[nodiscard]] Motion2<S> at() const {
    Motion2<S> m = base_;
    if (following_ && age_ > 0) {  // a sample is missing: constant velocity
      m.position += m.velocity * (S(age_) * sample_time_);
      m.acceleration.setZero();
    }
    const S t = S(ticks_) * sample_time_;
    if (t < fading_.duration) {
      const Motion2<S> offset = fading_.at(t);
      m.position += offset.position;
      m.velocity += offset.velocity;
      m.acceleration += offset.acceleration;
    }
    return m;
  }
  /// Moves on to the next tick.
  void advance() {
    if (ticks_ < ticks_max) ++ticks_;
    if (age_ < ticks_max) ++age_;
  }

 private:
  static constexpr std::uint32_t ticks_max = 0xFFFF'FFFF;

  [[nodiscard]] Vec2<S> apart(const Vec2<S>& a, const Vec2<S>& b) const {
    const Vec2<S> d = a - b;
    return angles_ ? Vec2<S>(wrap_to_pi(d[0]), wrap_to_pi(d[1])) : d;
  }
  [[nodiscard]] S longest(const Vec2<S>& offset, const Vec2<S>& rate) const {
    const S a = fading_time(offset[0], rate[0], speed_, acceleration_);
    const S b = fading_time(offset[1], rate[1], speed_, acceleration_);
    return a > b ? a : b;
  }
  /// Stops half of velocity * time ahead, by a smooth step: |acceleration| <= 15/8 |velocity| / time.
  void brake(const Motion2<S>& now) {
    const auto size = [](S v) { return v < S(0) ? -v : v; };
    const S a = size(now.velocity[0]), b = size(now.velocity[1]);
    const S time = (a > b ? a : b) * S(1.875L) / acceleration_;
    const Vec2<S> way = now.velocity * (time * S(0.5));
    following_ = false;
    plan(-way, now.velocity, time);
    base_ = {now.position + way, Vec2<S>::Zero(), Vec2<S>::Zero()};
  }
  void plan(const Vec2<S>& offset, const Vec2<S>& rate, S time) {
    ticks_ = 0;
    const S duration = time > sample_time_ ? time : sample_time_;
    fading_ = Quintic<S>::between({offset, rate, Vec2<S>::Zero()}, {}, duration);
  }

  S speed_{1}, acceleration_{1}, sample_time_{1};
  bool angles_ = false;
  bool active_ = false;
  bool following_ = false;
  Motion2<S> base_{};        // final motion: rest, or the sample
  Quintic<S> fading_{};      // offset from it
  std::uint32_t ticks_ = 0;  // since the beginning of fading_
  std::uint32_t age_ = 0;    // of the sample
};

}  // namespace esmc
