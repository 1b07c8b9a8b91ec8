#pragma once
/// The motion to rest after a halt.

#include <cstdint>

#include "firmware/control/reference.hpp"

namespace esmc {

/// Quintic of the base joints from the measured motion to rest, without a jump in speed.
template <class S>
class StopTrajectory {
 public:
  StopTrajectory() = default;
  /// `ticks`: duration, > 0 if begin() is called; `sample_time`: s, > 0.
  StopTrajectory(std::uint32_t ticks, S sample_time) : ticks_(ticks), sample_time_(sample_time) {}

  [[nodiscard]] bool begun() const { return begun_; }  ///< true from begin() to end()
  /// Begins at these base angles (rad) and rates v (rad/s), or at this position (m) and velocity. With the
  /// duration T = ticks * sample_time the quintic ends v T / 2 ahead and does not overshoot: with u = t / T
  /// its speed is v (1 - 3 u^2 + 2 u^3), its largest deceleration 1.5 v / T.
  void begin(const Vec2<S>& position, const Vec2<S>& velocity) {
    const S duration = S(ticks_) * sample_time_;
    Motion2<S> from, to;
    from.position = position;
    from.velocity = velocity;
    to.position = position + velocity * (duration * S(0.5));
    way_ = Quintic<S>::between(from, to, duration);
    tick_ = 0;
    begun_ = true;
  }
  void end() { begun_ = false; }  ///< ends the motion: begun() is false
  /// Moves on to the next tick; no effect unless begun().
  void advance() {
    if (begun_ && tick_ < last) ++tick_;
  }
  /// Motion `ahead` ticks after the present one, in the coordinates of begin() and per s, s2; at rest after
  /// the duration.
  [[nodiscard]] Motion2<S> at(std::uint32_t ahead = 0) const {
    return way_.at((S(tick_) + S(ahead)) * sample_time_);
  }
  [[nodiscard]] bool over() const { return tick_ >= ticks_; }  ///< the duration has passed
  /// True once four times the duration has passed.
  [[nodiscard]] bool overdue() const { return tick_ / 4 >= ticks_; }

 private:
  static constexpr std::uint32_t last = 0xFFFF'FFFF;
  std::uint32_t ticks_ = 0, tick_ = 0;
  S sample_time_{1};
  Quintic<S> way_{};
  bool begun_ = false;
};

}  // namespace esmc
