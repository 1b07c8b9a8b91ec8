#pragma once
/// Each motor in turn gets a small torque, and its joint must move as the model predicts: finds a motor that
/// turns the wrong way, or whose commands reach another motor than its encoder belongs to.

#include <algorithm>
#include <cstdint>

#include "firmware/cycle/estimate.hpp"
#include "firmware/types.hpp"

namespace esmc {

/// In addition to the weight torque, motor i gets +pulse until its joint should have moved by `move`, then
/// -pulse for as long, which ends the motion. After the first half the motion of both joints is compared with
/// the model's, along its direction: 1/4 to 4 times are allowed, for friction and wrong masses. Two nodes
/// swapped with angle and torque are not found on equal legs with the same `direction`.
template <class M>
class SignTest {
 public:
  using S = typename M::Scalar;
  static constexpr S share_max = S(0.05F);  ///< pulse as a share of the torque limit
  /// Limits of one half: what is longer than both cannot be tested. Ticks alone would refuse in a fast loop
  /// what passes in a slow one.
  static constexpr std::uint32_t ticks_max = 199;
  static constexpr S seconds_max = S(0.2F);
  static constexpr int motors = 2;

  /// Result of a tick; failed: a motor does not answer as the model predicts.
  enum class Verdict : std::uint8_t { going_on, passed, failed };

  SignTest() = default;
  /// `move`: rotation that each joint must show, rad, > 0, several steps of the encoder; sample_time: s, > 0.
  SignTest(S move, S sample_time) : move_(move), sample_time_(sample_time) {}

  /// Makes the next step() begin with the first motor.
  void reset() {
    motor_ = 0;
    tick_ = half_ = 0;
  }

  /// One tick. `angle`, `rate`: of the base joints, measured, rad and rad/s; `torque` (N m): balances the
  /// weight, plus the pulse on return; `limit`: of the base motors, N m. passed is kept until reset().
  Verdict step(const M& m, const typename M::Pose& now, const Vec2<S>& angle, const Vec2<S>& rate,
               const Vec2<S>& limit, Vec2<S>& torque) {
    if (motor_ == motors) return Verdict::passed;
    if (half_ > 0 && tick_ == 2 * half_) {
      tick_ = 0;
      if (++motor_ == motors) return Verdict::passed;
    }
    if (tick_ == 0 && !begin(m, now, angle, rate, limit, torque)) return Verdict::failed;
    if (ran_away(angle) || (tick_ == half_ && !moved(angle))) return Verdict::failed;
    torque[motor_] += tick_ < half_ ? pulse_ : -pulse_;
    ++tick_;
    return Verdict::going_on;
  }

 private:
  [[gnu::cold]] bool begin(const M& m, const typename M::Pose& now, const Vec2<S>& angle, const Vec2<S>& rate,
                           const Vec2<S>& limit, const Vec2<S>& weight) {
    // H: torques of unit accelerations beyond the weight. A pulse accelerates the joints by its inverse.
    Vec2<S> column[2];
    const typename M::Rates still = M::Rates::Zero();
    for (int i = 0; i < 2; ++i) {
      const Vec2<S> unit(S(i == 0), S(i == 1));
      typename M::Channels a = m.channel_accelerations(now, still, m.base_accelerations(now, still, unit));
      m.add_rotors(a);
      column[i] = m.base_torque(now, m.force(a, still)) - weight;
    }
    const S determinant = column[0][0] * column[1][1] - column[1][0] * column[0][1];
    pulse_ = limit[motor_] * share_max;
    answer_ = motor_ == 0 ? Vec2<S>(column[1][1], -column[0][1]) : Vec2<S>(-column[1][0], column[0][0]);
    answer_ *= pulse_ / determinant;  // rad/s2
    const S own = answer_[motor_];
    if (!(own > S(0))) return false;  // every valid model accelerates along the torque; also for a NaN
    const S ticks = square_root(S(2) * move_ / own) / sample_time_;
    if (!(ticks <= S(ticks_max) || ticks * sample_time_ < seconds_max)) return false;
    half_ = std::max<std::uint32_t>(static_cast<std::uint32_t>(ticks), 2) - 1;
    for (int n = 0; n < 2 && half_time() * half_time() * own * S(0.5) < move_; ++n) ++half_;  // rounded up
    from_ = angle;
    rate_ = rate;
    return true;
  }
  [[nodiscard]] S half_time() const { return S(half_) * sample_time_; }

  /// Both joints moved four times as far as expected of the whole half.
  [[nodiscard]] bool ran_away(const Vec2<S>& angle) const {
    const S t = half_time(), passed = S(tick_) * sample_time_;
    const Vec2<S> seen = angle - from_ - rate_ * passed;
    const S most = S(4) * square_root(dot(answer_, answer_)) * (t * t * S(0.5));
    return !(dot(seen, seen) <= most * most);
  }
  [[nodiscard]] bool moved(const Vec2<S>& angle) const {
    const S t = half_time();
    const Vec2<S> expected = answer_ * (t * t * S(0.5));
    const Vec2<S> seen = angle - from_ - rate_ * t;
    const S along = dot(seen, expected), size = dot(expected, expected);
    const S own = seen[motor_] / expected[motor_];
    return along >= size * S(0.25) && own >= S(0.25) && own <= S(4);  // ran_away() bounds `along`
  }

  S move_{}, sample_time_{1}, pulse_{};
  Vec2<S> answer_ = Vec2<S>::Zero(), from_ = Vec2<S>::Zero(), rate_ = Vec2<S>::Zero();
  std::uint32_t tick_ = 0, half_ = 0;
  int motor_ = 0;
};

}  // namespace esmc
