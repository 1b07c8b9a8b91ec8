#pragma once
/// One tick of control in space: from samples to the inputs of a free body (force, moment) or of a platform
/// on six legs (one force per motor). Faults are latched; every input is then 0.

#include <array>
#include <cmath>
#include <cstdint>
#include <limits>

#include "firmware/control/reference.hpp"
#include "host_sim/scene/names.hpp"
#include "host_sim/spatial/hexapod.hpp"
#include "host_sim/spatial/law.hpp"
#include "host_sim/spatial/rotation.hpp"

namespace esmc::host {

/// Desired motion of a body, SI units; angular quantities in its own (desired) frame.
template <class S>
struct SpatialMotion {
  Vec3<S> position = Vec3<S>::Zero(), velocity = Vec3<S>::Zero(), acceleration = Vec3<S>::Zero();
  Quaternion<S> attitude{};
  Vec3<S> turning = Vec3<S>::Zero(), turning_rate = Vec3<S>::Zero();  ///< rad/s, rad/s2
};

/// A reference in space. Fields that a kind does not use are ignored. Axes have length 1, in the frame of the
/// body.
template <class S>
struct SpatialReference {
  SpatialReferenceKind kind = SpatialReferenceKind::hold;
  Vec3<S> position = Vec3<S>::Zero();  ///< start, m
  Quaternion<S> attitude{};            ///< start
  Vec3<S> axis = Vec3<S>(S(0), S(0), S(1)), second_axis = Vec3<S>(S(1), S(0), S(0));
  S angle{};                           ///< rad, of any size
  Vec3<S> shift = Vec3<S>::Zero();     ///< m
  S duration{1};                       ///< of turn, s, > 0
  S rate{}, second_rate{};             ///< rad/s; of sway that of the phase
  PhaseClock phase{}, second_phase{};  ///< the same per tick

  /// Desired motion at a tick; sample_time: s, > 0.
  [[nodiscard]] SpatialMotion<S> at(std::uint64_t tick, S sample_time) const {
    SpatialMotion<S> m;
    m.position = position;
    m.attitude = attitude;
    switch (kind) {
      case SpatialReferenceKind::hold:
        break;
      case SpatialReferenceKind::turn: {
        const S t = S(tick) * sample_time, u = t < duration ? t / duration : S(1), f = S(1) / duration;
        move(m, {u * u * u * (S(10) - u * (S(15) - S(6) * u)), S(30) * u * u * (S(1) - u) * (S(1) - u) * f,
                 S(60) * u * (S(1) - u) * (S(1) - S(2) * u) * f * f});
        break;
      }
      case SpatialReferenceKind::sway: {
        const SinCos<S> p = sin_cos(phase.template angle<S>(tick));
        move(m, {S(0.5) * (S(1) - p.cos), S(0.5) * rate * p.sin, S(0.5) * rate * rate * p.cos});
        break;
      }
      case SpatialReferenceKind::spin:
        rotate(m, axis, {phase.template angle<S>(tick), rate, S(0)});
        break;
      case SpatialReferenceKind::tumble:
        rotate(m, axis, {phase.template angle<S>(tick), rate, S(0)});
        rotate(m, second_axis, {second_phase.template angle<S>(tick), second_rate, S(0)});
        break;
    }
    return m;
  }

 private:
  struct Path {
    S value, rate, acceleration;
  };
  void move(SpatialMotion<S>& m, const Path& s) const {
    m.position += shift * s.value;
    m.velocity = shift * s.rate;
    m.acceleration = shift * s.acceleration;
    rotate(m, axis, {angle * s.value, angle * s.rate, angle * s.acceleration});
  }
  /// Turns further about an axis of the body, which carries the motion so far into the new frame.
  static void rotate(SpatialMotion<S>& m, const Vec3<S>& about_axis, const Path& p) {
    const Quaternion<S> q = about(about_axis, p.value), back = q.conjugate();
    const Vec3<S> so_far = rotated(back, m.turning), own = about_axis * p.rate;
    m.attitude = m.attitude * q;
    m.turning = so_far + own;
    m.turning_rate = rotated(back, m.turning_rate) + about_axis * p.acceleration - cross(own, so_far);
  }
};

/// Why the controller has stopped.
enum class SpatialFault {
  none,
  not_finite,      ///< a measured or computed value is not a number
  not_unit,        ///< the norm of the measured quaternion differs from 1 by more than a tenth
  type1,           ///< a leg does not reach the reference or the measured pose
  type2,           ///< the motors' forces no longer hold the platform
  euler_singular,  ///< smc_euler at pitch = +-90 degrees
};
template <>
inline constexpr auto names_of<SpatialFault> =
    std::array{"none", "not_finite", "not_unit", "type1", "type2", "euler_singular"};

/// Measured motion. The attitude may be q or -q, its norm off by rounding and noise.
template <class S>
struct SpatialSample {
  Vec3<S> position, velocity;  ///< of the mass centre, in N
  Quaternion<S> attitude;
  Vec3<S> turning;  ///< omega in the frame of the body, rad/s
};

/// Configuration of a controller in space.
template <class M, class S = typename M::Scalar>
struct SpatialConfig {
  M mechanism{};  ///< as the controller believes it to be
  SpatialLaw law = SpatialLaw::esmc;
  Reaching reaching = Reaching::implicit;
  SpatialGains<S> gains{};
  S hysteresis{S(0.1)};  ///< of the way round, see AttitudeChoice
  S force_limit{};       ///< of each entry of the force or each motor, N, > 0
  S moment_limit{};      ///< free body: of each entry, N m, > 0
  S length{S(1)};  ///< platform: of its size, m, > 0; makes moments comparable with forces for least_pivot
  S least_pivot{S(0.02)};  ///< platform: of the motors' map, below which it is type 2
};

/// What one tick gives.
template <class S>
struct SpatialResult {
  Vec<S, 6> input = Vec<S, 6>::Zero();  ///< [force in N; moment in the frame of the body], or motors' forces
  Vec<S, 6> sliding = Vec<S, 6>::Zero();  ///< s of the platform's own channels
  bool saturated = false;
  SpatialFault fault = SpatialFault::none;
};

/// M: FreeBody or Hexapod.
template <class M>
class SpatialController {
 public:
  using S = typename M::Scalar;

  explicit SpatialController(const SpatialConfig<M>& config) : config_(config), choice_(config.hysteresis) {}
  /// One tick. After the first fault every later result is that fault with all inputs 0.

  [[nodiscard]] SpatialResult<S> tick(const SpatialSample<S>& sample, const SpatialMotion<S>& reference) {
    SpatialResult<S> out;
    if (fault_ == SpatialFault::none) fault_ = work(sample, reference, out);
    if (fault_ != SpatialFault::none) {
      out = {};
      out.fault = fault_;
    }
    return out;
  }

 private:
  [[nodiscard]] SpatialFault work(const SpatialSample<S>& sample, const SpatialMotion<S>& reference,
                                  SpatialResult<S>& out) {
    const M& m = config_.mechanism;
    const S norm = sample.attitude.squared_norm();
    const S zero = norm * S(0) + sum_of_zeros(sample.position, sample.velocity) +
                   sum_of_zeros(sample.turning, reference.position);
    if (!(zero == S(0))) return SpatialFault::not_finite;
    if (!(norm > S(0.81) && norm < S(1.21))) return SpatialFault::not_unit;
    SpatialTracking<M> t;
    if (!m.pose(sample.position, normalised(sample.attitude), t.pose)) return SpatialFault::type1;
    if (!m.pose(reference.position, reference.attitude, t.desired_pose)) return SpatialFault::type1;
    t.turn = choice_.choose(t.pose.attitude.conjugate() * reference.attitude);
    t.rates = m.chain_rates(t.pose, M::joined(sample.velocity, sample.turning));
    t.desired_rates = m.chain_rates(t.desired_pose, M::joined(reference.velocity, reference.turning));
    t.desired_acceleration = m.chain_accelerations(t.desired_pose, t.desired_rates,
                                                   M::joined(reference.acceleration, reference.turning_rate));
    SpatialDemand<M> demand;
    switch (config_.law) {
      case SpatialLaw::esmc:
        demand = esmc_acceleration(m, config_.gains, config_.reaching, t);
        break;
      case SpatialLaw::esmc_projected:
        demand = projected_acceleration(m, config_.gains, config_.reaching, t);
        break;
      case SpatialLaw::smc_euler:
        if (!euler_acceleration(m, config_.gains, config_.reaching, t, demand))
          return SpatialFault::euler_singular;
        break;
      case SpatialLaw::none:
        break;
    }
    const Vec<S, 6> force = m.gather(t.pose, m.force(demand.acceleration, m.channel_rates(t.pose, t.rates)));
    for (int i = 0; i < 6; ++i) out.sliding[i] = demand.sliding[i];
    out.input = force;
    if constexpr (M::legs > 0) {
      const S pivot = m.template motor_forces<UpsLeg<S>::slide>(t.pose, force, config_.length, out.input);
      if (!(pivot > config_.least_pivot)) return SpatialFault::type2;
    }
    for (int i = 0; i < 6; ++i) {
      const S limit = M::legs == 0 && i >= 3 ? config_.moment_limit : config_.force_limit;
      if (!(std::fabs(out.input[i]) <= std::numeric_limits<S>::max())) return SpatialFault::not_finite;
      if (out.input[i] > limit || out.input[i] < -limit) {
        out.input[i] = out.input[i] > S(0) ? limit : -limit;
        out.saturated = true;
      }
    }
    return SpatialFault::none;
  }
  /// 0, or NaN where an entry is not finite.
  [[nodiscard]] static S sum_of_zeros(const Vec3<S>& a, const Vec3<S>& b) {
    S sum(0);
    for (int i = 0; i < 3; ++i) sum += a[i] * S(0) + b[i] * S(0);
    return sum;
  }

  SpatialConfig<M> config_;
  AttitudeChoice<S> choice_;
  SpatialFault fault_ = SpatialFault::none;
};

}  // namespace esmc::host
