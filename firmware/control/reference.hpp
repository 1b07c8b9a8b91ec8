#pragma once
/// The reference motion as a function of the tick number. Time is counted in ticks and phases in 2^-64 turns,
/// so that a float controller neither drifts nor loses resolution after hours.

#include <cstdint>
#include <span>

#include "firmware/numeric/elementary.hpp"
#include "firmware/types.hpp"

namespace esmc {

/// A time between ticks; a fraction is exact in a float.
struct TickTime {
  static constexpr unsigned bits = 24;
  std::uint64_t tick = 0;
  std::uint32_t fraction = 0;  ///< of a tick, unit 2^-24, < 2^24
};

/// An angle that changes by the same amount every tick, modulo one turn; unit 2^-64 turn, two's complement.
struct PhaseClock {
  std::uint64_t start = 0, per_tick = 0;

  /// Angle at a tick, rad, in [-pi, pi].
  template <class S>
  [[nodiscard]] S angle(std::uint64_t tick) const {
    return angle_of<S>(start + per_tick * tick);
  }
  /// Angle at a time between ticks, rad, in [-pi, pi].
  template <class S>
  [[nodiscard]] S angle(const TickTime& t) const {
    const auto speed = static_cast<std::int64_t>(per_tick);  // backwards: negative
    return angle_of<S>(start + per_tick * t.tick +
                       static_cast<std::uint64_t>((speed >> TickTime::bits) * std::int64_t{t.fraction}));
  }

 private:
  template <class S>
  [[nodiscard]] static S angle_of(std::uint64_t turns) {
    const auto phase = static_cast<std::int64_t>(turns);
    if constexpr (sizeof(S) >= sizeof(std::int64_t)) {
      return S(phase) * S(6.283185307179586476925286766559L / 18446744073709551616.0L);
    } else {  // 32 bits are more than a float keeps, and a board converts them in one instruction
      return S(static_cast<std::int32_t>(phase >> 32)) * S(6.283185307179586476925286766559L / 4294967296.0L);
    }
  }
};

/// Position, velocity and acceleration of two coordinates, m or rad and per s, s2.
template <class S>
struct Motion2 {
  Vec2<S> position = Vec2<S>::Zero();
  Vec2<S> velocity = Vec2<S>::Zero();
  Vec2<S> acceleration = Vec2<S>::Zero();
};

/// Fifth-order polynomial between two states, in the normalised time u = t / duration.
template <class S>
struct Quintic {
  S duration{1};  ///< s, > 0
  List<Vec2<S>, 6> c{{{Vec2<S>::Zero(), Vec2<S>::Zero(), Vec2<S>::Zero(), Vec2<S>::Zero(), Vec2<S>::Zero(),
                       Vec2<S>::Zero()}}};

  /// The polynomial with position, velocity and acceleration of `a` at its start and of `b` at its end.
  /// duration: s, > 0, which the caller checks.
  [[nodiscard]] static Quintic between(const Motion2<S>& a, const Motion2<S>& b, S duration) {
    const S d = duration, d2 = duration * duration;
    const Vec2<S> p = b.position - a.position - a.velocity * d - a.acceleration * (d2 * S(0.5));
    const Vec2<S> v = (b.velocity - a.velocity) * d - a.acceleration * d2;
    const Vec2<S> w = (b.acceleration - a.acceleration) * d2;
    return {duration,
            {{a.position, a.velocity * d, a.acceleration * (d2 * S(0.5)), p * S(10) - v * S(4) + w * S(0.5),
              p * S(-15) + v * S(7) - w, p * S(6) - v * S(3) + w * S(0.5)}}};
  }
  /// Motion at t (s, clamped to [0, duration]); a NaN gives NaN.
  [[nodiscard]] Motion2<S> at(S t) const {
    const S u = t <= S(0) ? S(0) : (t >= duration ? S(1) : t / duration), r = S(1) / duration;
    Motion2<S> m;
    m.position = c[0] + (c[1] + (c[2] + (c[3] + (c[4] + c[5] * u) * u) * u) * u) * u;
    m.velocity = (c[1] + (c[2] * S(2) + (c[3] * S(3) + (c[4] * S(4) + c[5] * (S(5) * u)) * u) * u) * u) * r;
    m.acceleration = (c[2] * S(2) + (c[3] * S(6) + (c[4] * S(12) + c[5] * (S(20) * u)) * u) * u) * (r * r);
    return m;
  }
};

/// A piece of a path: a quintic that starts `offset` >= 0 seconds before tick `start_tick`.
template <class S>
struct PathSegment {
  std::uint32_t start_tick = 0;
  S offset{};
  Quintic<S> curve{};
};

/// Shapes of a reference.
enum class ReferenceKind : std::uint8_t {
  hold_start,  ///< stay where the mechanism is when it starts to run
  circle,      ///< centre + radius (cos, sin)(phase)
  sine,        ///< per coordinate: offset + amplitude sin(phase_i)
  path,        ///< quintic segments, then rest at the end (or again from the start with repeat_ticks)
};
/// Coordinates of a reference: metres or radians.
enum class ReferenceSpace : std::uint8_t { effector, base_joints };

/// A reference as a function of the tick number. Fields that a kind does not use are ignored.
template <class S>
struct Reference {
  ReferenceKind kind = ReferenceKind::hold_start;
  ReferenceSpace space = ReferenceSpace::effector;
  Vec2<S> centre = Vec2<S>::Zero();     ///< circle: m; sine: offset of each coordinate
  Vec2<S> amplitude = Vec2<S>::Zero();  ///< circle: radius in both; sine: of each coordinate
  Vec2<S> speed = Vec2<S>::Zero();      ///< rad/s, of each phase (the circle uses the first)
  List<PhaseClock, 2> phase{};
  std::span<const PathSegment<S>> path{};  ///< kept by reference; each with a later start_tick
  std::uint32_t repeat_ticks = 0;          ///< length of one round of the path; 0: once

  /// Motion at a tick; sample_time: s, > 0. hold_start and an empty path give the centre at rest.
  [[nodiscard, gnu::cold]] Motion2<S> at(std::uint64_t tick, S sample_time) const {
    return motion(tick, sample_time);
  }
  /// Motion at a time between ticks, otherwise as at(tick).
  [[nodiscard, gnu::noinline, gnu::cold]] Motion2<S> at(const TickTime& t, S sample_time) const {
    return motion(t, sample_time);
  }
  /// Motion for a torque that is constant from this tick to the next: as at(), but on a path the acceleration
  /// is the mean over that time, because it may jump within.
  [[nodiscard, gnu::noinline]] Motion2<S> from(std::uint64_t tick, S sample_time) const {
    if (kind != ReferenceKind::path || path.empty()) return motion(tick, sample_time);
    const std::uint32_t now = tick_of_round(tick), next = now + 1 == repeat_ticks ? 0 : now + 1;
    const std::size_t i = segment_of(now);
    std::size_t k = next == 0 ? 0 : i;  // a new round begins with the first
    if (k + 1 < path.size() && path[k + 1].start_tick <= next) ++k;
    Motion2<S> m = in_segment(path[i], now, sample_time);
    m.acceleration = (in_segment(path[k], next, sample_time).velocity - m.velocity) * (S(1) / sample_time);
    return m;
  }
  /// Motion from a time between ticks on, otherwise as from(tick).
  [[nodiscard, gnu::noinline, gnu::cold]] Motion2<S> from(const TickTime& t, S sample_time) const {
    Motion2<S> m = at(t, sample_time);
    if (kind == ReferenceKind::path)
      m.acceleration =
          (at({t.tick + 1, t.fraction}, sample_time).velocity - m.velocity) * (S(1) / sample_time);
    return m;
  }

 private:
  template <class Time>
  [[nodiscard]] ESMC_INLINE Motion2<S> motion(const Time& time, S sample_time) const {
    Motion2<S> m;
    m.position = centre;
    switch (kind) {
      case ReferenceKind::hold_start:
        break;
      case ReferenceKind::circle: {
        const SinCos<S> t = sin_cos(phase[0].template angle<S>(time));
        const S r = amplitude[0], w = speed[0];
        m.position += Vec2<S>(r * t.cos, r * t.sin);
        m.velocity = Vec2<S>(-r * w * t.sin, r * w * t.cos);
        m.acceleration = Vec2<S>(-r * w * w * t.cos, -r * w * w * t.sin);
        break;
      }
      case ReferenceKind::sine:
        for (int i = 0; i < 2; ++i) {
          const SinCos<S> t = sin_cos(phase[i].template angle<S>(time));
          m.position[i] += amplitude[i] * t.sin;
          m.velocity[i] = amplitude[i] * speed[i] * t.cos;
          m.acceleration[i] = -amplitude[i] * speed[i] * speed[i] * t.sin;
        }
        break;
      case ReferenceKind::path:
        if (!path.empty()) m = along_path(time, sample_time);
        break;
    }
    return m;
  }

  [[nodiscard]] Motion2<S> along_path(std::uint64_t ticks, S sample_time) const {
    const std::uint32_t tick = tick_of_round(ticks);
    return in_segment(path[segment_of(tick)], tick, sample_time);
  }
  /// The next tick tells which segment has begun by then; before its own beginning it is the one before.
  [[nodiscard, gnu::cold]] Motion2<S> along_path(const TickTime& time, S sample_time) const {
    if (time.fraction == 0) return along_path(time.tick, sample_time);
    const std::uint32_t next = tick_of_round(time.tick) + 1;
    const S back = S((1U << TickTime::bits) - time.fraction) * (sample_time * S(0x1p-24L));
    std::size_t i = segment_of(next);
    const auto since = [&] {
      return next < path[i].start_tick ? S(-1)
                                       : S(next - path[i].start_tick) * sample_time + (path[i].offset - back);
    };
    if (i > 0 && since() < S(0)) {
      --i;
      // A table may leave out a piece that begins and ends between two ticks: on, not at rest, until the
      // next.
      const S gap = since() - path[i].curve.duration;
      if (gap > S(0) && gap < sample_time) {
        Motion2<S> m = path[i].curve.at(since());
        m.position += (m.velocity + m.acceleration * (gap * S(0.5))) * gap;
        m.velocity += m.acceleration * gap;
        return m;
      }
    }
    const S t = since();
    return motion_in(path[i], t >= S(0), t);
  }
  [[nodiscard]] std::uint32_t tick_of_round(std::uint64_t ticks) const {
    constexpr std::uint64_t end = 0xFFFF'FFFE;  // no segment starts later
    if (repeat_ticks == 0) return static_cast<std::uint32_t>(ticks < end ? ticks : end);
    const auto low = static_cast<std::uint32_t>(ticks);
    return low == ticks ? low % repeat_ticks  // a board divides 32 bits in one instruction
                        : static_cast<std::uint32_t>(ticks % repeat_ticks);
  }
  /// The last segment that has begun: at most 32 halvings.
  [[nodiscard]] std::size_t segment_of(std::uint32_t tick) const {
    std::size_t low = 0, high = path.size();
    while (high - low > 1) {
      const std::size_t middle = low + (high - low) / 2;
      if (path[middle].start_tick <= tick)
        low = middle;
      else
        high = middle;
    }
    return low;
  }
  [[nodiscard]] static Motion2<S> in_segment(const PathSegment<S>& s, std::uint32_t tick, S sample_time) {
    const bool begun = tick >= s.start_tick;
    return motion_in(s, begun, begun ? S(tick - s.start_tick) * sample_time + s.offset : S(0));
  }
  [[nodiscard]] static Motion2<S> motion_in(const PathSegment<S>& s, bool begun, S t) {
    const Motion2<S> m = s.curve.at(t);
    return begun && !(t > s.curve.duration) ? m : Motion2<S>{m.position};  // at rest before and after
  }
};

/// A reference that starts from the position and velocity of the mechanism at tick 0: the offset (present
/// minus reference) fades out along a quintic without a jump in acceleration.
template <class S>
class JoinedReference {
 public:
  JoinedReference() = default;
  /// `join_ticks`: duration of joining, 0: at once; sample_time: s, > 0. The path must outlive this object.
  JoinedReference(const Reference<S>& reference, std::uint32_t join_ticks, S sample_time)
      : reference_(reference), join_ticks_(join_ticks), sample_time_(sample_time) {}

  [[nodiscard]] const Reference<S>& reference() const { return reference_; }  ///< without the offset

  /// Begins at this position and velocity (m or rad, per s) at tick 0, in the coordinates of the reference.
  /// With hold_start the position becomes the centre.
  void start(const Vec2<S>& position, const Vec2<S>& velocity) {
    join(position, velocity);
    slow_ = false;
  }
  /// start() for a motion whose time passes at `rate`, in (0, 1), of real time; `velocity`: per s of real
  /// time. Its share fades in join_ticks of real time: over the longer join the noise of a measured velocity
  /// would become a distance.
  void start_slowly(const Vec2<S>& position, const Vec2<S>& velocity, S rate) {
    join(position, Vec2<S>::Zero());
    const Motion2<S> moving{Vec2<S>::Zero(), velocity * (S(1) / rate), Vec2<S>::Zero()};
    drift_ = Quintic<S>::between(moving, {}, S(join_ticks_) * sample_time_ * rate);
    slow_ = join_ticks_ > 0;
  }

  /// Motion at a tick since start(): the reference, and the rest of the offset for join_ticks.
  [[nodiscard]] Motion2<S> at(std::uint64_t tick) const {
    return motion(tick, tick, [&] { return ticks(tick); });
  }
  /// Motion at a time between ticks, otherwise as at(tick).
  [[nodiscard]] Motion2<S> at(const TickTime& t) const {
    return motion(t, t.tick, [&] { return ticks(t.tick) + S(t.fraction) * S(0x1p-24L); });
  }

 private:
  void join(const Vec2<S>& position, const Vec2<S>& velocity) {
    if (reference_.kind == ReferenceKind::hold_start) reference_.centre = position;
    if (join_ticks_ == 0) return;
    const Motion2<S> m = reference_.from(0, sample_time_);
    Motion2<S> offset{position - m.position, velocity - m.velocity, -m.acceleration};
    if (reference_.space == ReferenceSpace::base_joints) {
      offset.position = Vec2<S>(wrap_to_pi(offset.position[0]), wrap_to_pi(offset.position[1]));
    }
    join_ = Quintic<S>::between(offset, {}, S(join_ticks_) * sample_time_);
  }
  static S ticks(std::uint64_t tick) { return S(static_cast<std::uint32_t>(tick)); }
  template <class Time, class Ticks>
  [[nodiscard]] ESMC_INLINE Motion2<S> motion(const Time& time, std::uint64_t tick,
                                              const Ticks& ticks) const {
    Motion2<S> m = reference_.from(time, sample_time_);
    if (tick < join_ticks_) {
      const S t = ticks() * sample_time_;
      add(m, join_.at(t));
      if (slow_) [[unlikely]]
        add(m, drift_.at(t));
    }
    return m;
  }
  static ESMC_INLINE void add(Motion2<S>& to, const Motion2<S>& m) {
    to.position += m.position;
    to.velocity += m.velocity;
    to.acceleration += m.acceleration;
  }

  Reference<S> reference_{};
  std::uint32_t join_ticks_ = 0;
  S sample_time_{1};
  Quintic<S> join_{}, drift_{};
  bool slow_ = false;  // drift_ is the start's velocity, join_ the rest of its offset
};

}  // namespace esmc
