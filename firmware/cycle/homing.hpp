#pragma once
/// Homing: finds the zero of the encoders by moving one base joint after the other to its end stop.

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "firmware/safety/guards.hpp"
#include "firmware/types.hpp"

namespace esmc {

/// Configuration of homing, one entry per base joint. travel = 0: no homing.
template <class S>
struct HomingConfig {
  Vec2<S> speed = Vec2<S>::Zero();    ///< rad/s, not 0; its sign is the direction to the stop
  Vec2<S> torque = Vec2<S>::Zero();   ///< N m, > 0: limit of |torque| while homing
  Vec2<S> damping = Vec2<S>::Zero();  ///< N m s/rad, > 0: gain of the speed controller
  S travel{};                         ///< rad, > 0, within which a stop must be met
  S back_off{};                       ///< rad, > 0, by which a stop is left
  S share{};  ///< of the gain, per tick: integral part of the speed controller; 0 < share < 0.1
};

/// A joint moves at its speed, by a speed controller with limited torque, until it stands under the whole
/// torque for 1 / share ticks: its end stop. It then moves away by the back-off and must come to stand in the
/// same place again: a motor without torque and an encoder that froze stand too, but anywhere. The second
/// joint is damped meanwhile, so that a closed chain lets the first one pass; the first one then stays
/// pressed on its stop. At last both leave their stops. Not detected: a torque limit below the weight, which
/// stops the joint in one place twice, too.
template <class S>
class Homing {
 public:
  Homing() = default;
  /// `sample_time`: s, > 0; brake() must end within 4 halt_ticks, or 40 where that is more.
  Homing(const HomingConfig<S>& config, S sample_time, std::uint32_t halt_ticks)
      : config_(config), sample_time_(sample_time), halt_ticks_(halt_ticks) {}

  [[nodiscard]] bool available() const { return config_.travel > S(0); }  ///< homing is configured
  /// True in the one tick in which step() has found both joints pressed on their stops: the zero pose.
  [[nodiscard]] bool met() const { return joint_ == 2 && !begun_; }
  [[nodiscard]] bool done() const { return left_; }  ///< both joints have left their stops: homing is over
  [[nodiscard]] bool at_rest() const { return resting_; }  ///< the last brake() found both joints at rest
  /// Limits::feedback_jump for homing, rad per tick: the largest allowed speed times a tick, at least 0.002.
  [[nodiscard]] S feedback_jump() const { return std::max(fastest() * sample_time_, S(0.002F)); }

  /// Makes the next step() begin with the first joint.
  void reset() { *this = Homing(config_, sample_time_, halt_ticks_); }

  /// One tick. `angle` (rad), `rate` (rad/s): of the base joints, finite; sets their `torque`, N m. A fault:
  /// a joint is too fast, has met no stop, has left it again, or does not move.
  Fault step(const Vec2<S>& angle, const Vec2<S>& rate, Vec2<S>& torque) {
    if (const Fault f = too_fast(rate); f != Fault::none) return f;
    if (joint_ == 2) return leave(angle, rate, torque);
    if (const Fault f = seek(angle, rate[joint_]); f != Fault::none) return f;
    for (int j = 0; j < 2; ++j) {
      if (j < joint_ && !within(angle[j] - stop_[j], config_.back_off)) return Fault::home_no_stop;
      if (j > joint_ && !within(angle[j] - from_[j], config_.travel)) return Fault::home_no_stop;
      if (j > joint_) {
        torque[j] = clamped(-config_.damping[j] * rate[j], j);
      } else {
        torque[j] =
            drive(j, j == joint_ && way_ == Way::away ? -config_.speed[j] : config_.speed[j], rate[j]);
      }
    }
    return Fault::none;
  }

  /// One tick in place of step(): damps both joints to rest; call until at_rest(). `rate`: rad/s; sets
  /// `torque`, N m, at most config.torque. Faults: joint_speed; halt_failed after 4 halt_ticks, at least 40,
  /// without rest.
  Fault brake(const Vec2<S>& rate, Vec2<S>& torque) {
    if (const Fault f = too_fast(rate); f != Fault::none) return f;
    resting_ = within(rate[0], S(2) * slow(0)) && within(rate[1], S(2) * slow(1));
    if (!resting_ && ++brake_ticks_ > std::max<std::uint32_t>(4 * halt_ticks_, 40)) return Fault::halt_failed;
    constexpr S share = S(0.05F);
    for (int j = 0; j < 2; ++j) {
      const S against = -config_.damping[j] * (share / config_.share) * rate[j];  // the model in 5 ticks
      // Reduces the integral against friction, keeps the part that carries a weight.
      if (!within(rate[j], slow(j)) && integral_[j] * rate[j] > S(0)) integral_[j] *= S(0.8F);
      integral_[j] = clamped(integral_[j] + share * against, j);
      torque[j] = clamped(integral_[j] + against, j);
    }
    return Fault::none;
  }

 private:
  enum class Way : std::uint8_t { there, away, back };  ///< to the stop, off it, and to it again

  [[nodiscard]] S slow(int j) const { return std::abs(config_.speed[j]) * S(0.125); }
  [[nodiscard]] S clamped(S torque, int j) const {
    return std::clamp(torque, -config_.torque[j], config_.torque[j]);
  }
  /// Four times the larger speed, rad/s: in a closed chain one joint may move the other faster than itself.
  [[nodiscard]] S fastest() const {
    return S(4) * std::max(std::abs(config_.speed[0]), std::abs(config_.speed[1]));
  }
  [[nodiscard]] Fault too_fast(const Vec2<S>& rate) const {
    return within(rate[0], fastest()) && within(rate[1], fastest()) ? Fault::none : Fault::joint_speed;
  }
  /// How far the joint has left its stop, rad; negative: further into it.
  [[nodiscard]] S left(int j, S angle) const {
    return config_.speed[j] > S(0) ? stop_[j] - angle : angle - stop_[j];
  }
  /// The stop is met where it was met before, rad.
  [[nodiscard]] bool same(int j, S angle) const {
    return within(angle - stop_[j], std::min(config_.back_off, S(0.02F)));
  }
  /// The integral of the rate equals the change of the angle since from_, within the back-off and an eighth
  /// of the speed; otherwise angle or rate is wrong.
  [[nodiscard]] bool consistent(int j, S angle, S rate) {
    passed_[j] += rate * sample_time_;
    return within(angle - from_[j] - passed_[j], config_.back_off + S(ticks_) * sample_time_ * slow(j));
  }

  /// Torque towards a wanted speed. That of a joint which stands grows to the whole torque, by at most
  /// `share` of itself in a tick: so it does not start faster than the speed can be held.
  S drive(int j, S wanted, S rate) {
    const S against = config_.damping[j] * (wanted - rate);
    S more = against;
    if (within(rate, slow(j)) && wanted != S(0)) {
      const S push = std::max(S(10) * std::abs(config_.damping[j] * wanted), std::abs(integral_[j]));
      more = clamped(wanted < S(0) ? -push : push, j);
    }
    integral_[j] = clamped(integral_[j] + config_.share * more, j);
    return clamped(integral_[j] + against, j);
  }
  /// The joint stands under the whole torque `way`.
  [[nodiscard]] bool pressed(int j, S way, S rate) const {
    return !within(integral_[j], config_.torque[j] * S(0.999F)) && (integral_[j] < S(0)) == (way < S(0)) &&
           within(rate, slow(j));
  }
  /// Counts a tick; true once twice the time of the travel at `speed` is over, and that in which the integral
  /// turns from one whole torque to the other: in a slow loop it takes longer than a short travel.
  bool late(S speed) {
    return (S(ticks_++) - S(10) / config_.share) * sample_time_ * speed > S(2) * config_.travel;
  }
  /// Counts the ticks without a break; true once they suffice.
  bool stood(bool now) {
    standing_ = now ? standing_ + 1 : 0;
    return S(standing_) * config_.share >= S(1);
  }

  void begin(Way way, const Vec2<S>& angle) {
    // The second joint has come this far since the first one began.
    if (joint_ == 0 && way == Way::there) from_ = angle;
    if (joint_ < 2) from_[joint_] = angle[joint_];
    if (joint_ == 2) from_ = angle;
    way_ = way;
    passed_.setZero();
    ticks_ = standing_ = 0;
    begun_ = true;
  }
  /// Moves on to the next way or joint where the present one stands under the torque of the last tick.
  Fault seek(const Vec2<S>& angles, S rate) {
    if (!begun_) begin(Way::there, angles);
    const S angle = angles[joint_], way = way_ == Way::away ? -config_.speed[joint_] : config_.speed[joint_];
    if (!within(angle - from_[joint_], config_.travel) || late(std::abs(way))) return Fault::home_no_stop;
    if (!consistent(joint_, angle, rate)) return Fault::feedback_jump;
    const bool stands = stood(pressed(joint_, way, rate));
    if (way_ == Way::away) {
      if (stands) return Fault::sign_test;
      if (left(joint_, angle) > config_.back_off) begin(Way::back, angles);
    } else if (stands && way_ == Way::there) {
      stop_[joint_] = angle;
      begin(Way::away, angles);
    } else if (stands) {
      if (!same(joint_, angle)) return Fault::home_no_stop;
      if (joint_ == 1 && !same(0, angles[0])) return Fault::none;  // until it does, or time is over
      stop_[joint_++] = angle;
      begun_ = false;
    }
    return Fault::none;
  }
  /// Both joints off their stops, and to rest.
  Fault leave(const Vec2<S>& angle, const Vec2<S>& rate, Vec2<S>& torque) {
    if (!begun_) begin(Way::away, angle);
    bool stands = false;
    left_ = true;
    for (int j = 0; j < 2; ++j) {
      const S way = left(j, angle[j]);
      const bool off = way > config_.back_off;
      // It stops in the time that the integral takes, four times that of the loop, from twice the larger
      // speed: the joints push each other.
      if (way < -config_.back_off ||
          way > config_.back_off + S(0.5) * fastest() * sample_time_ / config_.share)
        return Fault::home_no_stop;
      if (!consistent(j, angle[j], rate[j])) return Fault::feedback_jump;
      stands = stands || (!off && pressed(j, -config_.speed[j], rate[j]));
      left_ = left_ && off && within(rate[j], S(2) * slow(j));
      torque[j] = drive(j, off ? S(0) : -config_.speed[j], rate[j]);
    }
    if (stood(stands)) return Fault::sign_test;
    const S speed = std::min(std::abs(config_.speed[0]), std::abs(config_.speed[1]));
    return late(speed) ? Fault::home_no_stop : Fault::none;
  }

  HomingConfig<S> config_{};
  S sample_time_{};
  std::uint32_t halt_ticks_ = 0;
  int joint_ = 0;                           // that seeks its stop; 2: none
  Way way_ = Way::there;                    // of that joint
  bool begun_ = false, left_ = false;       // the way; both stops
  bool resting_ = false;                    // at the last brake()
  Vec2<S> from_ = Vec2<S>::Zero();          // rad, where the way began, or waiting
  Vec2<S> passed_ = Vec2<S>::Zero();        // rad since then, by the rates
  std::uint32_t ticks_ = 0, standing_ = 0;  // on the way; without a break under the whole torque
  std::uint32_t brake_ticks_ = 0;
  Vec2<S> stop_ = Vec2<S>::Zero(), integral_ = Vec2<S>::Zero();
};

}  // namespace esmc
