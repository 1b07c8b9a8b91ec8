#pragma once
/// One control tick without its frames: joint samples in, joint torques out. The same class runs behind CAN
/// (cycle.hpp), in `esmc sim` and in the unit tests.

#include <array>
#include <cstdint>
#include <numbers>

#include "firmware/control/fused_law.hpp"
#include "firmware/control/reference.hpp"
#include "firmware/cycle/borne_damping.hpp"
#include "firmware/cycle/controller_config.hpp"
#include "firmware/cycle/estimate.hpp"
#include "firmware/cycle/homing.hpp"
#include "firmware/cycle/link_gains.hpp"
#include "firmware/cycle/parts.hpp"
#include "firmware/cycle/path_rate.hpp"
#include "firmware/cycle/plausibility.hpp"
#include "firmware/cycle/setpoint_generator.hpp"
#include "firmware/cycle/sign_test.hpp"
#include "firmware/cycle/stop_trajectory.hpp"
#include "firmware/cycle/tick_result.hpp"
#include "firmware/safety/guards.hpp"
#include "firmware/safety/supervisor.hpp"

namespace esmc {

/// Joint samples in, joint torques out, once per tick. M: Rr or FiveBar.
template <class M>
class Controller {
 public:
  using S = typename M::Scalar;
  using Config = ControllerConfig<M>;

  Controller() = default;
  /// Copies `config`, in which nothing is checked; the path of its reference must outlive this object.
  explicit Controller(const Config& config)
      : config_(config),
        halting_limits_(config.limits.while_halting()),
        reference_(config.reference, config.join_ticks, config.sample_time),
        stop_trajectory_(config.halt_ticks, config.sample_time),
        sign_test_(config.sign_test_move, config.sample_time),
        setpoints_(config.setpoint_speed, config.setpoint_acceleration, config.sample_time, wraps(config),
                   config.setpoint_jerk_ticks),
        path_rate_(config.setpoint_acceleration, config.sample_time),
        lead_ticks_(config.predict != nullptr ? static_cast<std::uint32_t>(config.delay_ticks + S(0.5)) : 0U),
        uses_memory_(config.reach != nullptr || config.observer != nullptr || config.predict != nullptr ||
                     config.correct != nullptr) {}

  [[nodiscard]] const Config& config() const { return config_; }
  /// 1 + index of the joint whose encoder alone explains the last gap above limits.closure; 0: none so far.
  [[nodiscard]] std::uint8_t odd_encoder() const { return odd_encoder_; }
  void forget_odd_encoder() { odd_encoder_ = 0; }  ///< of an earlier order to enable
  /// Configuration of the supervisor of this controller.
  [[nodiscard]] Supervisor::Config supervision() const {
    return {config_.halt_ticks > 0, config_.after_halt,
            config_.sign_test_move > S(0) && config_.motors == Motors::base, config_.enabling_ticks_max,
            config_.stopping_ticks_max};
  }

  /// The generator of set points. While it is active(), its motion replaces the reference.
  [[nodiscard]] SetpointGenerator<S>& setpoints() { return setpoints_; }
  /// The feed-rate override of the reference.
  [[nodiscard]] PathRate<S>& path_rate() { return path_rate_; }
  /// Memory of the optional parts, for a linearisation; valid after the first tick under the law.
  [[nodiscard]] PartMemory<M>& memory() { return memory_; }
  /// True if the mechanism has a pose at this finite position: effector (m) or base joints (rad), as in the
  /// reference. Neither limits nor the way there are checked.
  [[nodiscard]] bool reachable(const Vec2<S>& position) const;
  /// Sets the gains from the parameters of the link (see esmc::set_gains); call only while disabled.
  void set_gains(const link::Parameters& p, S delay_ticks);

  /// One tick, after supervisor.begin_tick(): sample -> estimate -> guards -> reference -> law -> allocation
  /// -> limits. A fault is raised at the supervisor; all torques of the tick are then zero, unless the
  /// reaction is a halt, which begins in the same tick.
  TickResult<M> tick(const Sample<M>& measured, Supervisor& supervisor);
  /// One tick of homing in place of tick(), while supervisor.homing(). The pose is not known, so neither the
  /// law nor the guards of a pose act: samples, speed, travel and torque are bounded.
  [[gnu::cold]] TickResult<M> home(const Sample<M>& measured, Supervisor& supervisor, Homing<S>& homing);

 private:
  /// Set points of a base joint go round the shorter way, unless it has a limit: within that there is one
  /// way.
  static std::array<bool, 2> wraps(const ControllerConfig<M>& c) {
    std::array<bool, 2> out{};
    for (unsigned i = 0; i < 2; ++i) {
      const Range<S>& r = c.limits.joint_angle[i];
      out[i] =
          c.reference.space == ReferenceSpace::base_joints && r.upper - r.lower > S(2) * S(std::numbers::pi);
    }
    return out;
  }
  /// Checks the sample of a joint; `angle`: at constant speed, when the torque of this tick acts.
  ESMC_INLINE Fault accept(int joint, const Sample<M>& measured, const Limits<S>& limits, S& angle) const {
    const S phase = measured.phase[static_cast<unsigned>(joint)];
    const std::uint32_t age = measured.age_ticks[static_cast<unsigned>(joint)];
    if (age > limits.max_age_ticks) return Fault::stale_feedback;
    angle = measured.angle[joint] +
            measured.rate[joint] * (S(age) * config_.sample_time + phase + config_.torque_lead);
    if (!finite(angle)) return Fault::feedback_not_finite;  // nor is it if a factor is not, even times zero
    if (!jump_check_.plausible(joint, measured, limits.feedback_jump, config_.sample_time)) {
      return Fault::feedback_jump;
    }
    return Fault::none;
  }

  /// sample -> estimate -> guards. Pose and rates are valid without a fault.
  ESMC_INLINE Fault observe(const Sample<M>& measured, const Limits<S>& limits, typename M::Pose& pose,
                            typename M::Rates& rates, TickResult<M>& out) {
    Vec<S, M::joints> angle;
    Fault wrong = Fault::none;
    const bool from_base = config_.sensors == Sensors::base || M::joints == 2;
    if (from_base) {
      unroll<2>([&](auto i) ESMC_INLINE {
        constexpr int joint = Config::joint_of(i, 2);
        if (wrong == Fault::none) wrong = accept(joint, measured, limits, angle[joint]);
      });
    } else {
      for (int i = 0; i < M::joints && wrong == Fault::none; ++i)
        wrong = accept(i, measured, limits, angle[i]);
    }
    if (wrong != Fault::none) {
      out.clear_estimate();
      return wrong;
    }
    const Vec2<S> base_angle = at_base(angle), base_rate = at_base(measured.rate);
    S closure(0);
    if (from_base) {
      if (!estimate_from_base(config_.mechanism, config_.mode, base_angle, base_rate, pose, rates)) {
        out.clear_estimate();
        return Fault::loop_not_closed;
      }
    } else if constexpr (M::joints == 4) {
      Estimate<M> e;
      if (config_.fuse != nullptr) {
        const std::uint8_t joint = config_.fuse(config_, angle, measured.rate, e);
        if (joint != 0) odd_encoder_ = joint;
      } else {
        e = estimate_from_all(config_.mechanism, angle, measured.rate);
      }
      pose = e.pose;
      rates = e.rates;
      closure = e.closure;
    }
    out.effector = pose.effector;
    return guard(limits, guarded(pose, closure, base_angle, base_rate));
  }

  /// For ticks without the law, as limit_apart().
  [[gnu::cold, gnu::noinline]] Fault observe_apart(const Sample<M>& measured, TickResult<M>& out) {
    typename M::Pose pose;
    typename M::Rates rates;
    return observe(measured, config_.limits, pose, rates, out);
  }

  /// `acted`: the law has computed sliding variables.
  Fault compute(const Sample<M>& measured, State state, TickResult<M>& out, bool& acted) {
    const bool run = state == State::running;
    const bool stopping = !run && state != State::testing;
    Tracking<M> t;
    Fault fault = observe(measured, stopping ? halting_limits_ : config_.limits, t.pose, t.rates, out);
    if (fault != Fault::none || state == State::testing) {
      out.clear_desired();
      return fault != Fault::none ? fault : sign_test_torque(t, out);
    }
    if (config_.observer != nullptr) [[unlikely]]
      config_.observer(config_, t, memory_);
    fault = run ? follow(t) : bring_to_rest(state, t, out);
    if (fault != Fault::none) {
      out.clear_desired();
      return fault;
    }
    out.desired_effector = t.desired_pose.effector;
    M::base_directions(t.desired_pose, out.desired_direction);
    if (state == State::lowering) {
      lowering_torque(t, out);
    } else {
      acted = true;
      apply_law(t, out);
      if (run && running_tick_ < config_.ramp_ticks) ramp_torque(t.pose, out);
    }
    if (uses_memory_) [[unlikely]]
      return limit_with_parts(measured, t, !run || running_tick_ >= config_.ramp_ticks, out);
    return limit(out);
  }

  // Functions that never run under the law are cold: compiled for size, and not copied to a board's fast
  // memory.

  /// One tick of the sign test.
  [[gnu::cold]] Fault sign_test_torque(const Tracking<M>& now, TickResult<M>& out) {
    Vec2<S> torque = weight(now.pose);
    const Vec2<S> limits(config_.torque_limit[Config::joint_of(0, 2)],
                         config_.torque_limit[Config::joint_of(1, 2)]);
    const auto verdict = sign_test_.step(config_.mechanism, now.pose, M::base_angles(now.pose),
                                         M::base(now.rates), limits, torque);
    if (verdict == SignTest<M>::Verdict::failed) return Fault::sign_test;
    out.stage_done = verdict == SignTest<M>::Verdict::passed;
    to_base_motors(torque, out);
    return limit_apart(out);
  }

  /// Torque of the base motors that balances the weight at rest.
  [[nodiscard, gnu::cold, gnu::noinline]] Vec2<S> weight(const typename M::Pose& pose) const {
    return config_.mechanism.base_torque(
        pose, config_.mechanism.force(M::Channels::Zero().eval(), M::Rates::Zero()));
  }

  /// Ramps the torque beyond the weight: the brake, or the sign test, carried the weight a tick before.
  [[gnu::cold]] void ramp_torque(const typename M::Pose& pose, TickResult<M>& out) const {
    const S share = S(static_cast<std::uint32_t>(running_tick_) + 1U) / S(config_.ramp_ticks);
    Vec<S, M::joints> held = Vec<S, M::joints>::Zero();
    if (config_.allocate != nullptr) {
      const typename M::Channels still = M::Channels::Zero();
      config_.allocate(config_, pose, config_.mechanism.force(still, M::Rates::Zero()), held);
      if (!config_.preload.isZero(S(0))) {  // a preload is no weight
        Vec<S, M::joints> preloaded;
        config_.allocate(config_, pose, still, preloaded);
        held -= preloaded;
      }
    } else {
      const Vec2<S> base = weight(pose);
      for (int i = 0; i < 2; ++i) held[Config::joint_of(i, 2)] = base[i];
    }
    out.torque = held + (out.torque - held) * share;
  }

  Fault follow(Tracking<M>& t) {
    if (!desire(t)) return Fault::reference_unreachable;
    if (config_.predict != nullptr) [[unlikely]]
      config_.predict(config_, memory_, t);
    return join_feasible() ? Fault::none : Fault::join_infeasible;
  }

  static constexpr std::uint32_t outlook = 16;
  /// Checks one of `outlook` points of the joining motion per tick, so that all of it is known early, of
  /// fewer ticks all in the first one: speed and acceleration of the base joints, and torque.
  [[nodiscard]] bool join_feasible() const {
    return setpoints_.active() || config_.join_ticks == 0 || running_tick_ >= outlook ||
           running_tick_ >= config_.join_ticks || next_points_feasible();
  }
  [[nodiscard, gnu::noinline, gnu::cold]] bool next_points_feasible() const {
    const std::uint32_t ticks = config_.join_ticks;
    if (ticks >= outlook)
      return within_limits_at(static_cast<std::uint32_t>(ticks * (running_tick_ + 1) / (outlook + 1)));
    bool feasible = true;
    for (std::uint32_t n = 0; running_tick_ == 0 && n < ticks; ++n)
      feasible = feasible && within_limits_at(n);
    return feasible;
  }
  [[nodiscard, gnu::noinline, gnu::cold]] bool within_limits_at(std::uint32_t ahead) const {
    Desired<M> d;
    if (!desired(config_.reference.space, reference_.at(ahead), d.pose, d.rates, d.acceleration))
      return false;
    const Vec2<S> rate = M::base(d.rates), acceleration = M::base(d.acceleration);
    for (int i = 0; i < 2; ++i) {
      if (!within(rate[i], config_.limits.joint_speed)) return false;
      if (config_.limits.join_acceleration != S(0) &&
          !within(acceleration[i], config_.limits.join_acceleration))
        return false;
    }
    return motors_can(d);
  }
  /// The motion needs no more torque than this share of the limits, by the model.
  [[nodiscard, gnu::noinline, gnu::cold]] bool motors_can(const Desired<M>& d, S share = S(1)) const {
    typename M::Channels a = config_.mechanism.channel_accelerations(d.pose, d.rates, d.acceleration);
    config_.mechanism.add_rotors(a);
    const typename M::Channels force = config_.mechanism.force(a, d.rates) * (S(1) / share);
    if (config_.allocate != nullptr) {
      Vec<S, M::joints> torque;
      return !config_.allocate(config_, d.pose, force, torque);
    }
    const Vec2<S> torque = config_.mechanism.base_torque(d.pose, force);
    const Vec<S, M::joints> most = config_.torque_given();
    for (int i = 0; i < 2; ++i) {
      if (!within(torque[i], most[Config::joint_of(i, 2)])) return false;
    }
    return true;
  }

  /// Four motors and four encoders: type 2 is a pose like any other, of which the base joints know nothing.
  [[nodiscard]] bool passes_type2() const {
    return config_.allocate != nullptr && config_.sensors == Sensors::all;
  }
  [[nodiscard, gnu::cold]] Truth<S> at_rest(const typename M::Rates& rates) const {
    const S part = config_.limits.joint_speed * S(0.02), told = config_.limits.rest_speed;
    const S slow = part > told ? part : told;
    const Vec2<S> rate = M::base(rates);
    Truth<S> rest = within(rate[0], slow) && within(rate[1], slow);
    if constexpr (M::joints == 4) {
      for (int j = 0; j < 2 && passes_type2(); ++j) rest = rest && within(rates.leg[j][1], slow);
    }
    return rest;
  }
  /// Of the effector where type 2 may be passed, unless that way leaves the reach and the base joints know
  /// one: in their assembly mode.
  [[gnu::cold, gnu::noinline]] void begin_stop(const Tracking<M>& t) {
    memory_.begin_halt();
    if (passes_type2()) {
      stop_space_ = ReferenceSpace::effector;
      stop_trajectory_.begin(t.pose.effector, config_.mechanism.tip_rate(t.pose, t.rates));
      if (!(M::sin_type2_in_mode(t.pose, config_.mode) > S(0)) || stop_is_in_reach()) return;
    }
    stop_space_ = ReferenceSpace::base_joints;
    stop_trajectory_.begin(M::base_angles(t.pose), M::base(t.rates));
  }
  [[nodiscard, gnu::cold]] bool stop_is_in_reach() const {
    for (std::uint32_t quarter = 1; quarter <= 4; ++quarter) {
      Desired<M> d;
      const Motion2<S> m = stop_trajectory_.at(config_.halt_ticks * quarter / 4U);
      if (!desired(stop_space_, m, d.pose, d.rates, d.acceleration) ||
          M::min_abs_sin_type1(d.pose) < config_.limits.min_abs_sin_type1)
        return false;
    }
    return true;
  }
  /// Along the stop trajectory to rest; the mechanism then stays there.
  [[gnu::cold]] Fault bring_to_rest(State state, Tracking<M>& t, TickResult<M>& out) {
    const Truth<S> rest = at_rest(t.rates);
    if (!stop_trajectory_.begun()) begin_stop(t);
    if (config_.predict != nullptr && state != State::lowering) config_.predict(config_, memory_, t);
    const Motion2<S> m = stop_trajectory_.at(lead_ticks_);
    if (!desired(stop_space_, m, t.desired_pose, t.desired_rates, t.desired_acceleration)) {
      return Fault::halt_failed;
    }
    if (state == State::halting) {
      out.stage_done = stop_trajectory_.over() && rest;
      if (stop_trajectory_.overdue() && !rest) return Fault::halt_failed;
    } else if (state == State::lowering) {
      out.stage_done = lowered_ticks_ >= config_.lower_ticks;
    }
    return Fault::none;
  }

  /// Fading weight compensation, and damping that reaches the torque limit at a tenth of the allowed speed,
  /// or what the loop bears.
  [[gnu::cold]] void lowering_torque(const Tracking<M>& t, TickResult<M>& out) {
    const S left =
        lowered_ticks_ < config_.lower_ticks ? S(1) - S(lowered_ticks_) / S(config_.lower_ticks) : S(0);
    if (lowered_ticks_ < config_.lower_ticks) ++lowered_ticks_;
    const M& m = config_.mechanism;
    const Vec2<S> x = Vec2<S>::UnitX(), y = Vec2<S>::UnitY();
    if constexpr (M::joints == 4) {
      if (passes_type2()) {
        const typename M::Channels still = M::Channels::Zero();
        typename M::Channels w = m.force(still, M::Rates::Zero()) * left;
        const Vec2<S> damping =
            borne_damping(config_, t.pose, m.chain_rates(t.pose, x), m.chain_rates(t.pose, y));
        w.template head<2>() -= damping.cwiseProduct(m.tip_rate(t.pose, t.rates));
        Vec<S, M::joints> preload;  // is no weight
        config_.allocate(config_, t.pose, w, out.torque);
        config_.allocate(config_, t.pose, still, preload);
        out.torque -= preload;
        return;
      }
    }
    const Vec2<S> held = weight(t.pose), rate = M::base(t.rates);
    const Vec2<S> borne = borne_damping(config_, t.pose, m.base_rates(t.pose, x), m.base_rates(t.pose, y));
    Vec2<S> torque;
    for (int i = 0; i < 2; ++i) {
      const S most = config_.torque_limit[Config::joint_of(i, 2)] / (config_.limits.joint_speed * S(0.1));
      torque[i] = held[i] * left - rate[i] * (borne[i] < most ? borne[i] : most);
    }
    to_base_motors(torque, out);
  }

  /// reference -> desired pose and motion, joined from the state at the first running tick.
  bool desire(Tracking<M>& t) {
    const bool at_effector = config_.reference.space == ReferenceSpace::effector;
    if (running_tick_ == 0) {
      const Vec2<S> position = at_effector ? t.pose.effector : M::base_angles(t.pose);
      const Vec2<S> velocity = at_effector ? config_.mechanism.tip_rate(t.pose, t.rates) : M::base(t.rates);
      const S rate = path_rate_.begin();
      if (path_rate_.active()) {
        reference_.start_slowly(position, velocity, rate);
      } else {
        reference_.start(position, velocity);
      }
      if (setpoints_.active()) setpoints_.start(position, velocity);
    }
    return desired(config_.reference.space,
                   setpoints_.active()   ? setpoints_.at()
                   : path_rate_.active() ? at_path_rate()
                                         : reference_.at(running_tick_ + lead_ticks_),
                   t.desired_pose, t.desired_rates, t.desired_acceleration);
  }
  [[nodiscard, gnu::noinline, gnu::cold]] Motion2<S> at_path_rate() {
    return path_rate_.step(reference_, running_tick_, lead_ticks_, [&](const Motion2<S>& m) {
      Desired<M> d;
      const S to_the_loop = S(0.95);  // of the torque; the rest is for the errors that it corrects
      return desired(config_.reference.space, m, d.pose, d.rates, d.acceleration) &&
             motors_can(d, to_the_loop);
    });
  }
  /// Not inlined: long, and called in four places.
  [[nodiscard, gnu::noinline]] bool desired(ReferenceSpace space, const Motion2<S>& m, typename M::Pose& pose,
                                            typename M::Rates& rates, typename M::Rates& acceleration) const {
    return space == ReferenceSpace::effector
               ? desired_at_effector(config_.mechanism, config_.mode, m.position, m.velocity, m.acceleration,
                                     pose, rates, acceleration)
               : desired_at_base(config_.mechanism, config_.mode, m.position, m.velocity, m.acceleration,
                                 pose, rates, acceleration);
  }

  /// law -> forces on the channels -> motor torques.
  void apply_law(const Tracking<M>& t, TickResult<M>& out) {
    if (config_.law == LawKind::pd) {
      out.sliding.setZero();
      to_base_motors(torque_pd<M>(config_.gains, t), out);
      return;
    }
    typename M::Channels acceleration;
    if (config_.reach != nullptr) [[unlikely]] {
      config_.reach(config_, t, memory_, acceleration, out.sliding);
    } else {
      fused_acceleration(config_.law, config_.mechanism, config_.gains, config_.reaching, t, acceleration,
                         out.sliding);
    }
    typename M::Channels w = config_.mechanism.force(acceleration, t.rates);
    if (config_.observer != nullptr) [[unlikely]]
      compensate(w);
    if constexpr (M::joints == 4) {
      if (config_.allocate != nullptr) {
        out.saturated = Truth<S>(config_.allocate(config_, t.pose, w, out.torque));
        if (uses_memory_) [[unlikely]]
          memory_.asked = config_.mechanism.base_torque(t.pose, w);
        return;
      }
    }
    to_base_motors(config_.mechanism.base_torque(t.pose, w), out);
    if (uses_memory_) [[unlikely]]
      memory_.asked = at_base(out.torque);
  }

  /// Subtracts the disturbance on the rows of the base joints, which C^T leaves unchanged.
  [[gnu::cold]] void compensate(typename M::Channels& w) const {
    if constexpr (M::joints == 4) {
      for (int j = 0; j < 2; ++j) w[M::row_leg(j)] -= memory_.disturbance[j];
    } else {
      w.template head<2>() -= memory_.disturbance;
    }
  }

  /// What optional parts add to limit(): their memory is of torques that the motors give. `whole`: without
  /// ramp.
  [[gnu::cold, gnu::noinline]] Fault limit_with_parts(const Sample<M>& measured, const Tracking<M>& t,
                                                      bool whole, TickResult<M>& out) {
    out.effector = t.pose.effector;  // a predictor has moved it
    if (config_.correct != nullptr)
      config_.correct(config_, measured, MotorTorque::given_to_asked, out.torque);
    const Fault fault = limit(out);
    Vec<S, M::joints> given = out.torque;
    if (config_.correct != nullptr) config_.correct(config_, measured, MotorTorque::asked_to_given, given);
    memory_.keep(given, !out.saturated && whole);
    return fault;
  }

  /// For what runs without the law: the tick has the only copy that must be fast.
  [[gnu::cold, gnu::noinline]] Fault limit_apart(TickResult<M>& out) const { return limit(out); }
  ESMC_INLINE Fault limit(TickResult<M>& out) const {
    Fault fault = Fault::none;
    const int n = config_.motor_count();
    for (int k = 0; k < n; ++k) {
      const int i = Config::joint_of(k, n);
      const auto c = limit_torque(out.torque[i], config_.torque_limit[i]);
      if (c == TorqueCheck::not_finite) fault = Fault::torque_not_finite;
      out.saturated = out.saturated || c == TorqueCheck::limited;
    }
    return fault;
  }

  void to_base_motors(const Vec2<S>& base, TickResult<M>& out) const {
    for (int i = 0; i < 2; ++i) out.torque[Config::joint_of(i, 2)] = base[i];
  }
  static Vec2<S> at_base(const Vec<S, M::joints>& v) {
    return {v[Config::joint_of(0, 2)], v[Config::joint_of(1, 2)]};
  }

  /// What guard() checks. `closure`: m, 0 without passive encoders; `angle`, `rate`: of the two base joints,
  /// rad and rad/s.
  Measured<S> guarded(const typename M::Pose& pose, S closure, const Vec2<S>& angle,
                      const Vec2<S>& rate) const {
    Measured<S> m;
    m.abs_sin_type1 = M::min_abs_sin_type1(pose);
    // Unless type 2 is passed, the other assembly mode is guarded too, for the law could come to rest there.
    m.sin_type2 = passes_type2() ? S(1) : M::sin_type2_in_mode(pose, config_.mode);
    m.closure = closure;
    m.x = pose.effector.x();
    m.y = pose.effector.y();
    m.working_mode_kept = M::in_working_mode(pose, config_.mode);
    m.joint_angle = {angle[0], angle[1]};
    m.joint_rate = {rate[0], rate[1]};
    return m;
  }

  Config config_{};
  Limits<S> halting_limits_{};
  JoinedReference<S> reference_{};
  StopTrajectory<S> stop_trajectory_{};
  ReferenceSpace stop_space_ = ReferenceSpace::base_joints;
  SignTest<M> sign_test_{};
  SetpointGenerator<S> setpoints_{};
  PathRate<S> path_rate_{};
  SampleJumpCheck<M> jump_check_{};
  PartMemory<M> memory_{};
  std::uint32_t lead_ticks_ = 0;    // of the reference before the measured state, with a predictor
  bool uses_memory_ = false;        // an optional part needs the memory
  std::uint64_t running_tick_ = 0;  // 64 bits: 32 overflow after 50 days at 1 kHz
  std::uint32_t lowered_ticks_ = 0;
  std::uint8_t odd_encoder_ = 0;
};

template <class M>
bool Controller<M>::reachable(const Vec2<S>& position) const {
  Desired<M> d;
  return desired(config_.reference.space, {position, Vec2<S>::Zero(), Vec2<S>::Zero()}, d.pose, d.rates,
                 d.acceleration);
}

template <class M>
void Controller<M>::set_gains(const link::Parameters& p, S delay_ticks) {
  esmc::set_gains(config_.gains, p, config_.reaching, config_.sample_time, delay_ticks);
}

// Not inline: only the archive (instances_*.cpp) compiles it, so that programs run the tested code.
template <class M>
TickResult<M> Controller<M>::tick(const Sample<M>& measured, Supervisor& supervisor) {
  TickResult<M> out{typename TickResult<M>::Unset{}};
  if (!supervisor.powered()) {
    running_tick_ = 0;
    lowered_ticks_ = 0;
    stop_trajectory_.end();
    sign_test_.reset();
    memory_.reset();
  }
  out.running_tick = running_tick_;
  bool acted = false;
  if (supervisor.powered()) {
    // After a fault with Reaction::halt the same tick begins to bring the mechanism to rest.
    for (bool again = supervisor.running();; again = false) {
      supervisor.raise(compute(measured, supervisor.state(), out, acted));
      if (!(again && supervisor.halting_or_held())) break;
      out.torque.setZero();
    }
  } else {  // the effector is reported in every state; while enabling the guards must hold too
    const Fault fault = observe_apart(measured, out);
    out.clear_desired();
    if (supervisor.state() == State::enabling && fault != Fault::stale_feedback) supervisor.raise(fault);
  }
  if (!acted) out.sliding.setZero();
  jump_check_.keep(measured, M::joints / config_.sensor_count());
  out.state = supervisor.state();
  out.fault = supervisor.fault();
  if (supervisor.powered()) {
    if (supervisor.state() != State::testing) ++running_tick_;
    stop_trajectory_.advance();
    setpoints_.advance();
  } else {
    out.torque.setZero();
    out.stage_done = false;
  }
  return out;
}

template <class M>
TickResult<M> Controller<M>::home(const Sample<M>& measured, Supervisor& supervisor, Homing<S>& homing) {
  TickResult<M> out;
  Fault fault = Fault::none;
  Vec<S, M::joints> angle;
  Limits<S> limits = config_.limits;
  if (const S jump = homing.feedback_jump(); !(limits.feedback_jump > S(0) && limits.feedback_jump < jump))
    limits.feedback_jump = jump;
  for (int i = 0, n = config_.sensor_count(); i < n && fault == Fault::none; ++i) {
    const int joint = Config::joint_of(i, n);
    fault = accept(joint, measured, limits, angle[joint]);
  }
  if (!supervisor.powered()) {
    homing.reset();
    if (supervisor.state() == State::enabling && fault != Fault::stale_feedback) supervisor.raise(fault);
  } else if (fault != Fault::none) {
    supervisor.raise(fault);
  } else {
    const bool brakes = supervisor.state() == State::halting;
    const Vec2<S> rate = at_base(measured.rate);
    Vec2<S> torque = Vec2<S>::Zero();
    if (!within(rate[0], limits.joint_speed) || !within(rate[1], limits.joint_speed)) {
      fault = Fault::joint_speed;
    } else {
      fault = brakes ? homing.brake(rate, torque) : homing.step(at_base(angle), rate, torque);
    }
    to_base_motors(torque, out);
    if (const Fault limited = limit_apart(out); fault == Fault::none) fault = limited;
    supervisor.raise(fault);
    // A fault may ask for the brake, which has not begun.
    out.stage_done = fault == Fault::none && (brakes ? homing.at_rest() : homing.done());
  }
  jump_check_.keep(measured, M::joints / config_.sensor_count());
  out.state = supervisor.state();
  out.fault = supervisor.fault();
  if (!supervisor.powered()) out.torque.setZero();
  return out;
}

}  // namespace esmc
