#pragma once
/// One control tick without its frames: joint samples in, joint torques out. The same object runs behind CAN
/// (cycle.hpp), in `esmc sim` and in the unit tests; there is no second controller.

#include <array>
#include <cstdint>

#include "firmware/control/allocation.hpp"
#include "firmware/control/law.hpp"
#include "firmware/control/reference.hpp"
#include "firmware/cycle/estimate.hpp"
#include "firmware/safety/guards.hpp"
#include "firmware/safety/supervisor.hpp"

namespace esmc {

enum class Motors : std::uint8_t { base, all };   ///< all (5R only): motors on the passive joints too
enum class Sensors : std::uint8_t { base, all };  ///< all (5R only): encoders on the passive joints too

/// Everything that decides what the controller does. The mechanism is what the controller believes.
template <class M>
struct ControllerConfig {
  using S = typename M::Scalar;
  M mechanism{};
  typename M::Mode mode{};
  LawKind law = LawKind::esmc;
  Reaching reaching = Reaching::implicit;
  Gains<M> gains{};
  Reference<S> reference{};
  Limits<S> limits{};
  Vec<S, M::joints> torque_limit = Vec<S, M::joints>::Zero();       ///< N m at the joint, >= 0
  Vec<S, M::joints> torque_weight = Vec<S, M::joints>::Ones();      ///< W of [F26], > 0; four motors only
  S sample_time{};                                                  ///< s, > 0
  std::uint32_t join_ticks = 0;  ///< time to join the reference from the measured pose; 0: at once
  Motors motors = Motors::base;
  Sensors sensors = Sensors::base;

  [[nodiscard]] constexpr int motor_count() const { return motors == Motors::base ? 2 : M::joints; }
  [[nodiscard]] constexpr int sensor_count() const { return sensors == Sensors::base ? 2 : M::joints; }
  /// Joint that motor or sensor i of n sits on: base joints are every second one of a 5R with two.
  [[nodiscard]] static constexpr int joint_of(int i, int n) { return n == M::joints ? i : i * (M::joints / 2); }
};

/// What the sensors say at a tick, in the model's convention, one entry per joint; only the joints that have a
/// sensor are read.
template <class M>
struct Sample {
  using S = typename M::Scalar;
  Vec<S, M::joints> angle = Vec<S, M::joints>::Zero();  ///< rad
  Vec<S, M::joints> rate = Vec<S, M::joints>::Zero();   ///< rad/s
  std::array<std::uint32_t, static_cast<unsigned>(M::joints)> age_ticks{};     ///< 0: of this tick; missed samples otherwise
};

/// What a tick did; everything a log needs. Torques are zero unless `state` is running.
template <class M>
struct TickResult {
  using S = typename M::Scalar;
  State state = State::disabled;
  Fault fault = Fault::none;
  std::uint32_t running_tick = 0;  ///< ticks since the controller runs; 0 in the first one
  bool saturated = false;          ///< a torque was clamped
  Vec<S, M::joints> torque = Vec<S, M::joints>::Zero();  ///< N m at the joints, zero where there is no motor
  Vec2<S> effector = Vec2<S>::Zero();           ///< as estimated, m
  Vec2<S> desired_effector = Vec2<S>::Zero();   ///< m
  Vec2<S> desired_base = Vec2<S>::Zero();       ///< rad, in (-pi, pi]
  typename M::Channels sliding = M::Channels::Zero();
};

template <class M>
class Controller {
 public:
  using S = typename M::Scalar;
  using Config = ControllerConfig<M>;

  Controller() = default;
  explicit Controller(const Config& config)
      : config_(config), reference_(config.reference, config.join_ticks, config.sample_time) {}

  [[nodiscard]] const Config& config() const { return config_; }

  /// One tick, in the order of the data: sample -> estimate -> guards -> reference -> law -> allocation ->
  /// limits. Whatever goes wrong is raised at the supervisor, and every torque of the tick is then zero.
  TickResult<M> tick(const Sample<M>& measured, Supervisor& supervisor);

 private:
  struct Observation {
    Fault fault = Fault::none;
    Estimate<M> estimate{};
  };

  /// sample -> estimate -> guards.
  Observation observe(const Sample<M>& measured, TickResult<M>& out) const {
    Observation o;
    const int n = config_.sensor_count();
    Vec<S, M::joints> angle = measured.angle;
    for (int i = 0; i < n; ++i) {
      const int joint = Config::joint_of(i, n);
      const std::uint32_t age = measured.age_ticks[static_cast<unsigned>(joint)];
      if (age > config_.limits.max_age_ticks) return {Fault::stale_feedback, {}};
      if (!finite(measured.angle[joint]) || !finite(measured.rate[joint])) return {Fault::feedback_not_finite, {}};
      angle[joint] += measured.rate[joint] * (S(age) * config_.sample_time);
    }
    const Vec2<S> base_angle = at_base(angle), base_rate = at_base(measured.rate);
    if (config_.sensors == Sensors::base) {
      const auto closed = estimate_from_base(config_.mechanism, config_.mode, base_angle, base_rate);
      if (!closed) return {Fault::loop_not_closed, {}};
      o.estimate = *closed;
    } else {
      o.estimate = everywhere(angle, measured.rate);
    }
    out.effector = o.estimate.pose.effector;
    o.fault = guard(config_.limits, guarded(o.estimate, base_angle, base_rate));
    return o;
  }

  Fault compute(const Sample<M>& measured, TickResult<M>& out) {
    const Observation now = observe(measured, out);
    if (now.fault != Fault::none) return now.fault;
    Tracking<M> t{};
    t.pose = now.estimate.pose;
    t.rates = now.estimate.rates;
    if (!desire(now.estimate, t)) return Fault::reference_unreachable;
    out.desired_effector = t.desired_pose.effector;
    out.desired_base = M::base_angles(t.desired_pose);
    act(t, out);
    return limit(out);
  }

  /// reference -> desired pose and motion, joined from where the mechanism was when it began to run.
  bool desire(const Estimate<M>& now, Tracking<M>& t) {
    const bool at_effector = config_.reference.space == ReferenceSpace::effector;
    if (running_tick_ == 0) {
      reference_.start(at_effector ? now.pose.effector : M::base_angles(now.pose),
                       at_effector ? config_.mechanism.tip_rate(now.pose, now.rates) : M::base(now.rates));
    }
    const Motion2<S> m = reference_.at(running_tick_);
    const auto desired =
        at_effector
            ? desired_at_effector(config_.mechanism, config_.mode, m.position, m.velocity, m.acceleration)
            : desired_at_base(config_.mechanism, config_.mode, m.position, m.velocity, m.acceleration);
    if (!desired) return false;
    t.desired_pose = desired->pose;
    t.desired_rates = desired->rates;
    t.desired_acceleration = desired->acceleration;
    return true;
  }

  /// law -> forces on the channels -> motor torques.
  void act(const Tracking<M>& t, TickResult<M>& out) const {
    if (config_.law == LawKind::pd) {
      spread(torque_pd<M>(config_.gains, t), out);
      return;
    }
    const Demand<M> d = demand(config_.law, config_.mechanism, config_.gains, config_.reaching, t);
    out.sliding = d.sliding;
    const typename M::Channels w = config_.mechanism.force(d.acceleration, t.rates);
    if constexpr (M::joints == 4) {
      if (config_.motors == Motors::all) {
        out.torque = allocate_all(config_.mechanism, t.pose, w, config_.torque_weight);
        return;
      }
    }
    spread(config_.mechanism.base_torque(t.pose, w), out);
  }

  Fault limit(TickResult<M>& out) const {
    Fault fault = Fault::none;
    for (int i = 0; i < M::joints; ++i) {
      const TorqueCheck c = limit_torque(out.torque[i], config_.torque_limit[i]);
      if (c == TorqueCheck::not_finite) fault = Fault::torque_not_finite;
      out.saturated = out.saturated || c == TorqueCheck::limited;
    }
    return fault;
  }

  void spread(const Vec2<S>& base, TickResult<M>& out) const {
    for (int i = 0; i < 2; ++i) out.torque[Config::joint_of(i, 2)] = base[i];
  }
  static Vec2<S> at_base(const Vec<S, M::joints>& v) { return {v[Config::joint_of(0, 2)], v[Config::joint_of(1, 2)]}; }

  Estimate<M> everywhere(const Vec<S, M::joints>& angle, const Vec<S, M::joints>& rate) const {
    if constexpr (M::joints == 4) {
      return estimate_from_all(config_.mechanism, angle, rate);
    } else {
      return *estimate_from_base(config_.mechanism, config_.mode, angle, rate);  // RR: base is all there is
    }
  }

  Measured<S> guarded(const Estimate<M>& e, const Vec2<S>& angle, const Vec2<S>& rate) const {
    Measured<S> m;
    m.abs_sin_type1 = M::min_abs_sin_type1(e.pose);
    // Four motors hold the mechanism at type 2 as well, if the state is measured there and not computed.
    const bool regular = config_.motors == Motors::all && config_.sensors == Sensors::all;
    // Otherwise the other assembly mode is as bad as type 2 itself, which lies between: the law may even rest there.
    m.sin_type2 = regular ? S(1) : M::sin_type2_in_mode(e.pose, config_.mode);
    m.closure = e.closure;
    m.x = e.pose.effector.x();
    m.y = e.pose.effector.y();
    m.working_mode_kept = M::in_working_mode(e.pose, config_.mode);
    m.joint_angle = {angle[0], angle[1]};
    m.joint_rate = {rate[0], rate[1]};
    return m;
  }

  Config config_{};
  JoinedReference<S> reference_{};
  std::uint32_t running_tick_ = 0;
};

// Not inline: the archive (instances.cpp) is the only place that compiles it, so that whoever links the archive
// runs the very code that was tested.
template <class M>
TickResult<M> Controller<M>::tick(const Sample<M>& measured, Supervisor& supervisor) {
  TickResult<M> out;
  const bool run = supervisor.running();
  if (!run) running_tick_ = 0;
  out.running_tick = running_tick_;
  if (run || supervisor.state() == State::enabling) {
    const Fault fault = run ? compute(measured, out) : observe(measured, out).fault;
    supervisor.raise(fault == Fault::stale_feedback && !run ? Fault::none : fault);
  }
  out.state = supervisor.state();
  out.fault = supervisor.fault();
  if (out.state != State::running) {
    out.torque.setZero();
  } else {
    ++running_tick_;
  }
  return out;
}

}  // namespace esmc
