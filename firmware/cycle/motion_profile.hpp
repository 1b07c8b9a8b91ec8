#pragma once
/// From any position and velocity of two coordinates to rest at a point, both arriving together: constant
/// acceleration, constant velocity, constant deceleration.

#include <cstdint>

#include "firmware/control/reference.hpp"

namespace esmc {

/// Motion of two coordinates (m or rad, s) within the limits of plan(). A velocity above them is first
/// reduced.
template <class S>
class MotionProfile {
 public:
  MotionProfile() = default;
  explicit MotionProfile(S sample_time) : sample_time_(sample_time) {}  ///< s, > 0

  /// Plans the motion from `from` with `rate` to rest at `to`, within `speed` and `acceleration` of each
  /// coordinate (> 0), in the least time of the slower coordinate. The other one shares its instants of
  /// switching where its limits allow (always from rest: the path is then straight), else it has its own.
  /// Finite input.
  void plan(const Vec2<S>& from, const Vec2<S>& rate, const Vec2<S>& to, S speed, S acceleration) {
    const Vec2<S> way = to - from;
    const Shape a = fastest(way[0], rate[0], speed, acceleration);
    const Shape b = fastest(way[1], rate[1], speed, acceleration);
    const int slow = a.duration() < b.duration() ? 1 : 0, other = 1 - slow;
    const Shape& lead = slow == 0 ? a : b;
    const S time = lead.duration();
    last_for(time);
    set(slow, from[slow], rate[slow], to[slow], lead);
    Shape with = lead;
    with.cruise = (S(2) * way[other] - rate[other] * lead.first) / (time + lead.second - lead.first);
    const bool fits = magnitude(with.cruise) <= speed &&
                      magnitude(with.cruise - rate[other]) <= acceleration * lead.first &&
                      magnitude(with.cruise) <= acceleration * lead.tail;
    set(other, from[other], rate[other], to[other],
        fits ? with : lasting(way[other], rate[other], time, acceleration));
  }
  /// Plans the motion from `from` with `rate` to rest on a straight line, |acceleration| <= `acceleration` (>
  /// 0) in each coordinate; it ends rate * time / 2 ahead.
  void brake(const Vec2<S>& from, const Vec2<S>& rate, S acceleration) {
    const S a = magnitude(rate[0]), b = magnitude(rate[1]);
    const S time = (a > b ? a : b) / acceleration;
    last_for(time);
    for (int i = 0; i < 2; ++i)
      set(i, from[i], rate[i], from[i] + rate[i] * (time * S(0.5)), {rate[i], S(0), S(0), time});
  }

  /// The first tick in which the motion is at rest, exactly at its end.
  [[nodiscard]] std::uint32_t ticks() const { return whole_ + 1; }
  /// Motion in a tick, counted from plan() or brake() = 0; at rest after the end.
  [[nodiscard]] Motion2<S> at(std::uint32_t tick) const {
    Motion2<S> m;
    const S t = S(tick) * sample_time_;
    // From the end, not duration minus t: after a long cruise the rounding of t would show in the speed.
    const S left = tick <= whole_ ? S(whole_ - tick) * sample_time_ + fraction_ : S(0);
    for (int i = 0; i < 2; ++i) {
      const Coordinate& c = part_[i];
      if (!(left > S(0))) {
        m.position[i] = c.to;
      } else if (t < c.shape.first) {
        m.position[i] = c.from + (c.rate + c.begin * t * S(0.5)) * t;
        m.velocity[i] = c.rate + c.begin * t;
        m.acceleration[i] = c.begin;
      } else if (left > c.shape.tail) {
        m.position[i] = c.to - c.shape.cruise * (left - c.shape.tail * S(0.5));
        m.velocity[i] = c.shape.cruise;
      } else {
        m.position[i] = c.to + c.end * left * left * S(0.5);
        m.velocity[i] = -c.end * left;
        m.acceleration[i] = c.end;
      }
    }
    return m;
  }

 private:
  /// Velocity between the instants `first` and `second`, s, and the time from there to rest.
  struct Shape {
    S cruise{}, first{}, second{}, tail{};
    [[nodiscard]] S duration() const { return second + tail; }
  };
  struct Coordinate {
    S from{}, rate{}, to{};
    S begin{}, end{};  // accelerations before `first` and after `second`
    Shape shape{};
  };

  void last_for(S time) {
    constexpr S most = S(1'000'000'000);  // ticks that are counted
    const S ticks = time / sample_time_;
    whole_ = static_cast<std::uint32_t>(ticks < most ? ticks : most);
    fraction_ = time - S(whole_) * sample_time_;
  }
  void set(int i, S from, S rate, S to, const Shape& s) {
    part_[i] = {from,
                rate,
                to,
                s.first > S(0) ? (s.cruise - rate) / s.first : S(0),
                s.tail > S(0) ? -s.cruise / s.tail : S(0),
                s};
  }
  /// The way and the rate along the direction of the cruise, which is that of the way left after braking.
  struct Straight {
    S sign, way, rate;
  };
  static Straight straight(S way, S rate, S acceleration) {
    return way * acceleration * S(2) < rate * magnitude(rate) ? Straight{S(-1), -way, -rate}
                                                              : Straight{S(1), way, rate};
  }
  /// In the least time: as fast as `speed` or the way allows.
  static Shape fastest(S way, S rate, S speed, S acceleration) {
    const Straight d = straight(way, rate, acceleration);
    const S peak_square = acceleration * d.way + d.rate * d.rate * S(0.5);  // without a cruise
    const S peak = peak_square > S(0) ? square_root(peak_square) : S(0);
    const S cruise = peak < speed ? peak : speed;
    const S first = magnitude(cruise - d.rate) / acceleration, tail = cruise / acceleration;
    const S braking = d.rate > cruise ? d.rate * d.rate * S(0.5) : cruise * cruise - d.rate * d.rate * S(0.5);
    const S rest = d.way - braking / acceleration;
    return {d.sign * cruise, first, first + (rest > S(0) && peak > speed ? rest / cruise : S(0)), tail};
  }
  /// In `time`, which is at least that of fastest(): a slower cruise.
  static Shape lasting(S way, S rate, S time, S acceleration) {
    const Straight d = straight(way, rate, acceleration);
    const S rest = d.way - d.rate * d.rate * S(0.5) / acceleration, room = time - d.rate / acceleration;
    S cruise;
    if (d.rate > S(0) && rest <= d.rate * room) {  // slows down first
      cruise = room > S(0) ? rest / room : S(0);
    } else {  // (cruise - rate)^2 + cruise^2 of the accelerations against the way that is left
      const S b = d.rate + acceleration * time, c = acceleration * d.way + d.rate * d.rate * S(0.5);
      // In the least time the root is zero, and its rounding may be below.
      cruise = c > S(0) ? S(2) * c / (b + square_root(magnitude(b * b - S(4) * c))) : S(0);
    }
    const S tail = cruise / acceleration;
    return {d.sign * cruise, magnitude(cruise - d.rate) / acceleration, time - tail, tail};
  }

  S sample_time_{1}, fraction_{};  // the motion lasts whole_ ticks and fraction_ seconds
  std::uint32_t whole_ = 0;
  List<Coordinate, 2> part_{};
};

}  // namespace esmc
