#pragma once
/// The motion that a supervisor computer requests instead of the reference: rest, set points, a stream of
/// samples. Limits per coordinate: |velocity| <= speed, |acceleration| <= acceleration, and the acceleration
/// changes by at most 2 acceleration / jerk_ticks per tick.

#include <array>
#include <cstdint>

#include "firmware/control/reference.hpp"
#include "firmware/cycle/motion_profile.hpp"

namespace esmc {

/// Mean of the motions of the last `length` ticks. It keeps every limit that each of them keeps, limits jerk,
/// and its velocity is the derivative of its position. Sums begin anew with every round of the memory, so
/// that a float does not drift.
template <class S>
class MovingAverage {
 public:
  static constexpr unsigned length_max = 64;  ///< ticks

  MovingAverage() = default;
  /// `length`: ticks, clamped to 1 .. length_max; 1: no averaging.
  explicit MovingAverage(std::uint32_t length)
      : length_(length < 1 ? 1U : (length > length_max ? length_max : length)) {}

  [[nodiscard]] std::uint32_t length() const { return length_; }  ///< ticks, 1 .. length_max
  /// Fills the memory with a motion at constant velocity with this mean; returns its present position.
  Vec2<S> begin(const Vec2<S>& mean, const Vec2<S>& velocity, S sample_time) {
    const Vec2<S> step = velocity * sample_time;
    const Vec2<S> now = mean + step * (S(length_ - 1) * S(0.5));
    sum_ = {};
    S back = S(length_);
    for (next_ = 0; next_ < length_; ++next_, back -= S(1)) {
      sum_.position += now - step * back;
      sum_.velocity += velocity;
      sums_[next_] = sum_;
    }
    end_round();
    return now;
  }
  /// The mean of the memory with `now` in place of its oldest motion; changes nothing.
  [[nodiscard]] Motion2<S> with(const Motion2<S>& now) const {
    if (length_ == 1) return now;
    const Motion2<S>& gone = sums_[next_];
    const S share = S(1) / S(length_);
    return {(round_.position - gone.position + sum_.position + now.position) * share,
            (round_.velocity - gone.velocity + sum_.velocity + now.velocity) * share,
            (round_.acceleration - gone.acceleration + sum_.acceleration + now.acceleration) * share};
  }
  /// Adds the motion of a tick to the memory, whose oldest one is dropped.
  void add(const Motion2<S>& now) {
    if (length_ == 1) return;
    sum_.position += now.position;
    sum_.velocity += now.velocity;
    sum_.acceleration += now.acceleration;
    sums_[next_] = sum_;
    if (++next_ == length_) end_round();
  }

 private:
  void end_round() {
    round_ = sum_;
    sum_ = {};
    next_ = 0;
  }

  std::uint32_t length_ = 1, next_ = 0;
  Motion2<S> sum_{}, round_{};  // of the present round so far, of the last one
  std::array<Motion2<S>, length_max>
      sums_{};  // from the beginning of a round; this round's, then the last one's
};

/// Generates a motion to rest, to set points, or along a stream of samples: a MotionProfile through a
/// MovingAverage, added to the last sample of a stream. Not inlined, so that it stays out of the ticks
/// without it and of a board's fast memory.
template <class S>
class SetpointGenerator {
 public:
  SetpointGenerator() = default;
  /// Limits `speed` (m/s or rad/s) and `acceleration` (m/s2 or rad/s2), > 0; `sample_time` in s, > 0.
  /// `wraps`: differences of that coordinate are wrapped to (-pi, pi]. `jerk_ticks`: length of the moving
  /// average.
  SetpointGenerator(S speed, S acceleration, S sample_time, std::array<bool, 2> wraps,
                    std::uint32_t jerk_ticks)
      : speed_(speed),
        acceleration_(acceleration),
        sample_time_(sample_time),
        wraps_(wraps),
        profile_(sample_time),
        average_(jerk_ticks) {}

  /// True if the caller must use at() in place of the reference.
  [[nodiscard]] bool active() const { return active_; }
  void activate(bool yes) { active_ = yes; }  ///< sets active(), and nothing else

  /// Plans a motion to rest from the measured state of the first tick (m and m/s, or rad and rad/s).
  [[gnu::noinline]] void start(const Vec2<S>& position, const Vec2<S>& velocity) {
    base_ = {};
    following_ = false;
    begin(position, velocity);
  }
  /// Plans a motion from the present one to rest on a straight line; ends a stream.
  [[gnu::noinline]] void hold() {
    leave_stream();
    const Motion2<S> now = profile_.at(ticks_);
    profile_.brake(now.position, now.velocity, acceleration_);
    ticks_ = 0;
  }
  /// Plans a motion from the present one to rest at `target`, m or rad; ends a stream. The caller checks that
  /// the target is in reach; the path to it is not checked.
  [[gnu::noinline]] void go_to(const Vec2<S>& target) {
    leave_stream();
    const Motion2<S> now = profile_.at(ticks_);
    plan(now, now.position - apart(now.position, target));
  }
  /// Follows a sample (m, m/s or rad, rad/s) per tick; a missing one is extrapolated. The difference from the
  /// present motion fades if the sample is the first, follows a gap, or is farther off than `speed` allows.
  [[gnu::noinline]] void follow(const Vec2<S>& position, const Vec2<S>& velocity) {
    const Vec2<S> off = position - base_.position - base_.velocity * (S(age_) * sample_time_);
    const S most = speed_ * sample_time_;
    if (!following_ || age_ > 1 ||
        !(off[0] <= most && -off[0] <= most && off[1] <= most && -off[1] <= most)) {
      const Motion2<S> now = at();
      begin(apart(now.position, position), now.velocity - velocity);
      plan(profile_.at(0), Vec2<S>::Zero());
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
  [[nodiscard, gnu::noinline]] Motion2<S> at() const {
    Motion2<S> m = profile_.at(ticks_);
    if (!rests()) m = average_.with(m);
    m.position += base_.position;
    m.velocity += base_.velocity;
    if (following_ && age_ > 0) {  // a sample is missing: constant velocity
      m.position += base_.velocity * (S(age_) * sample_time_);
    } else {
      m.acceleration += base_.acceleration;
    }
    return m;
  }
  /// Moves on to the next tick; without effect unless active().
  void advance() {
    if (active_) step();
  }

 private:
  static constexpr std::uint32_t ticks_max = 0xFFFF'FFFF;

  [[gnu::noinline]] void step() {
    average_.add(profile_.at(ticks_));
    if (!rests()) ++ticks_;
    if (age_ < ticks_max) ++age_;
  }
  /// The whole average is at rest at the end of the profile.
  [[nodiscard]] bool rests() const { return ticks_ >= profile_.ticks() + average_.length(); }
  [[nodiscard]] Vec2<S> apart(const Vec2<S>& a, const Vec2<S>& b) const {
    const Vec2<S> d = a - b;
    return {wraps_[0] ? wrap_to_pi(d[0]) : d[0], wraps_[1] ? wrap_to_pi(d[1]) : d[1]};
  }
  /// Begins a motion at this position and velocity; the profile is set for the present tick alone.
  void begin(const Vec2<S>& position, const Vec2<S>& velocity) {
    profile_.brake(average_.begin(position, velocity, sample_time_), velocity, acceleration_);
    ticks_ = 0;
  }
  void leave_stream() {
    if (!following_) return;
    const Motion2<S> now = at();
    base_ = {};
    following_ = false;
    begin(now.position, now.velocity);
  }
  void plan(const Motion2<S>& now, const Vec2<S>& target) {
    profile_.plan(now.position, now.velocity, target, speed_, acceleration_);
    ticks_ = 0;
  }

  S speed_{1}, acceleration_{1}, sample_time_{1};
  std::array<bool, 2> wraps_{};
  bool active_ = false;
  bool following_ = false;
  Motion2<S> base_{};  // the sample of a stream; else zero
  MotionProfile<S> profile_{};
  MovingAverage<S> average_{};
  std::uint32_t ticks_ = 0;  // since the beginning of profile_
  std::uint32_t age_ = 0;    // of the sample
};

}  // namespace esmc
