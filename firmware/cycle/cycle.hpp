#pragma once
/// The control cycle on a CAN bus: frames in, one tick of the controller, frames out.

#include <array>
#include <cstdint>
#include <type_traits>
#include <utility>

#include "firmware/cycle/controller.hpp"
#include "firmware/cycle/enabling_wait.hpp"
#include "firmware/cycle/linked.hpp"
#include "firmware/cycle/plausibility.hpp"
#include "firmware/drive/axis.hpp"
#include "hal/can.hpp"

namespace esmc {

/// Counters of frames since the start; each wraps at 2^32.
struct BusCounters {
  std::uint32_t received = 0;         ///< of our axes
  std::uint32_t not_mine = 0;         ///< of other nodes
  std::uint32_t malformed = 0;        ///< of our axes with a wrong length or format
  std::uint32_t foreign_command = 0;  ///< commands to our axes from other nodes
  std::uint32_t sent = 0;             ///< frames that the bus took
  std::uint32_t send_failed = 0;      ///< dropped: the bus was full or off, or refused it
};

/// A control tick with its frames. M: Rr or FiveBar; D: the drives' protocol.
template <class M, drive::Drive D>
class Cycle {
 public:
  using Mechanism = M;
  using S = typename M::Scalar;
  static constexpr int axes_max = M::joints;
  static constexpr int frames_per_tick_max = 1024;  ///< that one tick reads from the bus
  /// True if the drives send samples on request() only.
  static constexpr bool samples_on_demand = !std::is_same_v<typename D::Line, drive::NoLine>;

  /// Configuration of the controller, the axes, the line and the link.
  struct Config {
    ControllerConfig<M> controller{};
    /// One per joint with a motor or a sensor, in the order of the joints.
    std::array<D, static_cast<unsigned>(axes_max)> axes{};
    typename D::Line line{};
    int axis_count = 2;  ///< of `axes` in use: 2 or M::joints
    /// Ticks without a heartbeat, then the fault heartbeat_lost. 0 allows none: set it.
    std::uint32_t heartbeat_age_ticks_max = 0;
    std::uint32_t waiting_ticks_max = 750;  ///< of EnablingWait, then the fault enabling_timeout
    /// Settings of the drives that cannot be read back have been checked by hand; false: it never arms.
    bool confirmed = true;
    bool zero_absolute = true;  ///< encoders keep their zero without power; false: confirm_zero first
    Vec<S, M::joints> zero_pose = Vec<S, M::joints>::Zero();  ///< rad: the joints at confirm_zero
    S torque_mismatch{};        ///< N m at the joint between a drive's torque and its command; 0: not checked
    S torque_time{};            ///< s, time constant with which a drive follows its command
    bool samples_timed = true;  ///< true: the age of a frame counts; false: lockstep, where it has no meaning
    link::LinkConfig link{};    ///< to a supervisor computer; without a base_id: none
    S delay_ticks{};            ///< as in the layers of controller.gains; for gains that come by the link
    HomingConfig<S> homing{};   ///< to zero_pose, where the base joints are on their end stops
  };

  /// Starts in `disabled`. Nothing in `config` is checked.
  explicit Cycle(const Config& config)
      : controller_(config.controller),
        supervisor_(controller_.supervision()),
        axes_(config.axes),
        line_(config.line),
        axis_count_(config.axis_count),
        heartbeat_age_ticks_max_(config.heartbeat_age_ticks_max),
        waiting_ticks_max_(config.waiting_ticks_max),
        zero_(config.zero_absolute, config.zero_pose),
        torque_feedback_(config.torque_mismatch, config.torque_time, config.controller.sample_time),
        samples_timed_(config.samples_timed),
        link_(config.link),
        delay_ticks_(config.delay_ticks),
        homing_(config.homing, config.controller.sample_time, config.controller.halt_ticks),
        motors_(places(config.controller.motor_count())),
        sensors_(places(config.controller.sensor_count())),
        limits_fit_all_shafts_(motors_that_can_carry(config.controller.torque_limit) == motors_.count),
        drives_confirmed_(config.confirmed) {
    silent_ticks_.fill(drive::age_max);
    link_.offer_homing(homing_.available());
    link_.zero_unknown(!zero_.confirmed());
  }

  /// Stores a command for the next tick in place of an earlier one; only a stop replaces a halt or a stop.
  /// Without homing in the configuration `home` has no effect.
  void command(Command c) {
    if (c == Command::home && !homing_.available()) return;
    if (command_ != Command::stop && (command_ != Command::halt || c == Command::stop)) command_ = c;
  }
  /// Takes a reading of the normally closed contact `enable`; closed until the first call. One open reading
  /// since the last tick is the fault enable_open, also if later ones are closed.
  void enable_input(bool closed) {
    enable_closed_ = closed;
    enable_was_open_ = enable_was_open_ || !closed;
  }
  /// Raises the fault tick_late in the next tick. Call when ticks begin late again and again, or one by far.
  void tick_late() { late_ = true; }
  /// Sets the lateness of the coming tick, us, for its record (link::Capture); no effect on control.
  void late_by(std::uint32_t us) { link_.late_by(us); }
  /// Lockstep: sets the time since the last tick, us, < 1e9, for the next tick() without `answer` alone.
  void time_passed(std::uint32_t us) {
    passed_ticks_ = static_cast<std::uint32_t>(S(us) * S(1e-6L) / controller_.config().sample_time + S(0.5F));
  }
  /// The output `drive_enable`, true where drives may have power: not in disabled and fault.
  [[nodiscard]] bool drive_enable() const {
    return supervisor_.state() != State::disabled && supervisor_.state() != State::fault;
  }
  /// The output of a brake that opens with power: high while there may be torque.
  [[nodiscard]] bool release_brake() const { return supervisor_.powered(); }
  /// True if the torques of the last tick were finite, within their limits, and zero where the state allows
  /// none. Only broken memory makes it false; it is the condition for refreshing the watchdog.
  [[nodiscard]] bool output_ok() const { return output_ok_; }

  [[nodiscard]] const Supervisor& supervisor() const { return supervisor_; }
  [[nodiscard]] const Controller<M>& controller() const { return controller_; }
  [[nodiscard]] const BusCounters& counters() const { return counters_; }  ///< since the start
  [[nodiscard]] const Sample<M>& sample() const { return sample_; }        ///< of the last tick
  [[nodiscard]] const link::CommandLink& link() const { return link_; }
  /// The link, for a store of parameters: link::restore() before the first tick, link::serve() between ticks.
  [[nodiscard]] link::CommandLink& link() { return link_; }
  [[nodiscard]] const D& axis(int i) const { return axes_[static_cast<unsigned>(i)]; }  ///< i < axis_count

  /// Identifiers that receive() needs: of the axes and the link, including those that only we send, so that a
  /// foreign sender is detected. All other frames count as not_mine.
  [[nodiscard]] hal::IdFilters filters() const {
    hal::IdFilters list;
    for (int i = 0; i < axis_count_; ++i) axis(i).add_filters(list);
    link_.add_filters(list);
    return list;
  }
  /// Makes every axis repeat its last request to the drive at the next tick. Call only before heard().
  void ask_again() {
    for (D& a : axes_) a.ask_again();
  }

  /// True if every axis has sent its frames of the tick: in lockstep the condition for tick().
  [[nodiscard]] bool complete() const {
    bool all = opened_;
    for (int i = 0; i < axis_count_; ++i) all = all && axis(i).heard_this_tick();
    return all;
  }
  /// True if at least one axis has sent its frames of the tick.
  [[nodiscard]] bool set_begun() const {
    return opened_ && any_axis([](const D& a) { return a.heard_this_tick(); });
  }
  /// True once any axis has sent a frame of its own (Drive::alive); stays true.
  [[nodiscard]] bool heard() const {
    return any_axis([](const D& a) { return a.alive(); });
  }
  /// True if every motor has reported idle after its last request; see Drive::idle.
  [[nodiscard]] bool all_idle() const { return status().all_idle; }
  /// True if frames were lost or receive() has reached frames_per_tick_max: the next tick raises
  /// bus_overload, so waiting for more frames is useless.
  [[nodiscard]] bool overloaded() const { return (bus_events_ & flooded) != 0; }

  /// Reads the waiting frames, at most frames_per_tick_max per tick. May be called several times per tick.
  template <hal::CanBus Bus>
  void receive(Bus& bus) {
    open();
    int taken = taken_;
    for (; taken < frames_per_tick_max && bus.try_receive(incoming_); ++taken) {
      if constexpr (hal::TimesFrames<Bus>) {
        take(incoming_, samples_timed_ ? S(bus.frame_age_us()) * S(1e-6F) : S(0));
      } else {
        take(incoming_, S(0));
      }
    }
    taken_ = taken;
    // Unread frames would make later samples stale, and the content of lost frames is not known.
    if (taken_ == frames_per_tick_max) bus_events_ |= flooded;
    if constexpr (requires { bus.overruns(); }) {
      const std::uint32_t before = std::exchange(overruns_, bus.overruns());
      if (before != overruns_) bus_events_ |= flooded;
    }
  }

  /// Requests the next samples, if samples_on_demand: in lockstep at a tick's end, in real time at its start.
  template <hal::CanBus Bus>
  void request(Bus& bus) {
    for (D& a : axes_) {
      if constexpr (requires { a.expect_set(opened_); }) a.expect_set(opened_);
    }
    line_.request([&](hal::CanFrame f) {
      f.perishable = true;
      return put(bus, f);
    });
  }

  /// One tick, after receive(): transitions, faults, state to torque, torque to frames. Without `answer` no
  /// torque frame is sent (lockstep: the set was not complete).
  template <hal::CanBus Bus>
  TickResult<M> tick(Bus& bus, bool answer = true) {
    const TickResult<M> result = decide(answer);
    transmit(bus, result, answer);
    if (link_.active()) send_telemetry(bus, result);
    if (!supervisor_.powered()) {  // transitions out of torque do not depend on it
      status_ = status();
      link_.zero_unknown(!zero_.confirmed());
    }
    opened_ = false;
    return result;
  }

 private:
  /// Bus events since the last tick, one bit each in bus_events_.
  static constexpr std::uint8_t bus_off = 1, flooded = 2, foreign_command = 4, malformed = 8;

  template <class Condition>
  [[nodiscard]] bool any_axis(Condition&& condition) const {
    bool any = false;
    for (int i = 0; i < axis_count_; ++i) any = any || condition(axis(i));
    return any;
  }
  /// The part of tick() that no frame passes.
  TickResult<M> decide(bool answer);
  /// At the first call of a tick: counts the ages.
  void open() {
    if (opened_) return;
    for (int i = 0; i < axis_count_; ++i) axes_[static_cast<unsigned>(i)].begin_tick();
    if (!supervisor_.powered()) {
      for (std::uint32_t& age : silent_ticks_) age += age < drive::age_max ? 1U : 0U;
    }
    if (link_.active()) link_.begin_tick();
    opened_ = true;
    taken_ = 0;
  }

  /// `age`: s that the frame has waited.
  void take(const hal::CanFrame& f, S age) {
    for (int i = 0; i < axis_count_; ++i) {
      D& a = axes_[static_cast<unsigned>(i)];
      const drive::Received r = a.receive(f);
      if (r == drive::Received::not_mine) continue;
      if (r == drive::Received::accepted) {
        ++counters_.received;
        silent_ticks_[static_cast<unsigned>(i)] = 0;
        if (a.brought_sample()) phase_[static_cast<unsigned>(i)] = age;
      } else if (r == drive::Received::malformed) {
        ++counters_.malformed;
        bus_events_ |= malformed;
      } else {
        ++counters_.foreign_command;
        bus_events_ |= foreign_command;
      }
      return;
    }
    if (link_.active()) {
      // A frame that waited while the program stood still is old.
      const link::Outcome o = link_.receive(
          f, static_cast<std::uint32_t>(std::min(age / controller_.config().sample_time, S(1e6F))),
          [&](const std::array<float, 2>& p) {
            return controller_.reachable({S(p[0]), S(p[1])});
          });
      if (o == link::Outcome::foreign_command) bus_events_ |= foreign_command;
      if (o != link::Outcome::not_mine) return;
    }
    ++counters_.not_mine;
  }

  /// Requests of the supervisor computer for this tick.
  void apply_link_commands() {
    const Command c = apply_requests(link_, controller_, delay_ticks_);
    if (c != Command::none) command(c);
  }
  template <hal::CanBus Bus>
  void send_telemetry(Bus& bus, const TickResult<M>& result) {
    link::Report r = report_of(controller_, result, sample_);
    for (int i = motors_.count - 1; i >= 0; --i) {
      const D& a = axis(i * motors_.axis_step);
      if (!a.error()) continue;
      r.axis = static_cast<std::uint8_t>(i);
      r.drive_error = a.error_code();
    }
    link_.transmit(supervisor_, r, [&](const hal::CanFrame& f) { return put(bus, f); });
  }

  [[nodiscard]] DriveStatus status() const {
    DriveStatus s{true, true};
    for (int i = 0; i < motors_.count; ++i) {
      const D& a = axis(i * motors_.axis_step);
      s.all_ready = s.all_ready && a.ready();
      s.all_idle = s.all_idle && a.idle();
    }
    return s;
  }

  /// Faults of the bus and the drives, before anything is computed.
  Fault drive_fault() {
    const std::uint8_t events = std::exchange(bus_events_, std::uint8_t{0});  // latched by the supervisor
    for (int i = 0; i < axis_count_; ++i) {
      if (axis(i).emergency_stopped()) return Fault::emergency_stop;
    }
    if (std::exchange(enable_was_open_, !enable_closed_)) return Fault::enable_open;
    if (!drives_confirmed_) return Fault::drives_not_confirmed;
    if (events != 0) {
      return (events & bus_off) != 0           ? Fault::bus_off
             : (events & flooded) != 0         ? Fault::bus_overload
             : (events & foreign_command) != 0 ? Fault::foreign_controller
                                               : Fault::malformed_frame;
    }
    const bool powered = supervisor_.powered();
    for (int i = 0; i < motors_.count; ++i) {
      const D& a = axis(i * motors_.axis_step);
      if (a.config_mismatch()) return Fault::drive_configuration;
      if (!powered) continue;  // other errors of a drive that is being enabled are expected
      if (a.error()) return Fault::drive_error;
      if (!a.closed_loop()) return Fault::drive_disarmed;
      if (motors_.count > sensors_.count && a.sample_age_ticks() > controller_.config().limits.max_age_ticks)
        return Fault::stale_feedback;
      if (a.heartbeat_age_ticks() > heartbeat_age_ticks_max_) return Fault::heartbeat_lost;
      if constexpr (requires { a.observed_torque(); }) {
        if (!torque_feedback_.plausible(i * motors_.joint_step, a.observed_torque()))
          return Fault::torque_mismatch;
      }
      if constexpr (requires { a.torque_age_ticks(); }) {
        if (torque_feedback_.compares() && a.torque_age_ticks() > heartbeat_age_ticks_max_)
          return Fault::torque_mismatch;
      }
    }
    if (!powered) {
      torque_feedback_.forget();
      // Some drives send samples only after their set-up: enabling may proceed until they do.
      return !zero_.confirmed() && !supervisor_.homing() && sensed() ? Fault::zero_not_confirmed
                                                                     : Fault::none;
    }
    return zero_.confirmed() || supervisor_.homing() ? Fault::none : Fault::zero_not_confirmed;
  }

  /// Of a passive encoder only samples count.
  [[gnu::cold, gnu::noinline]] bool enabling_expired(std::uint32_t passed) {
    if (!wait_.waits) {  // the first tick of an order
      controller_.forget_odd_encoder();
      if constexpr (requires(D & a) { a.begin_enabling(); }) {
        for (D& a : axes_) a.begin_enabling();
      }
    }
    return wait_.expired(
        axis_count_, passed, waiting_ticks_max_,
        [this](int i) {
          return i % motors_.axis_step == 0 ? silent_ticks_[static_cast<unsigned>(i)]
                                            : axis(i).sample_age_ticks();
        },
        [this](int i) { return i % motors_.axis_step == 0 && axis(i).setting_up(); });
  }

  /// True if the last heartbeat of every axis, passive encoders included, is at most `age` ticks old.
  [[nodiscard]] bool all_reported(std::uint32_t age) const {
    return !any_axis([age](const D& a) { return a.heartbeat_age_ticks() > age; });
  }

  /// The operator's reset of an emergency stop: the axes may clear their present report of it.
  void acknowledge() {
    for (int i = 0; i < axis_count_; ++i) axes_[static_cast<unsigned>(i)].acknowledge();
  }

  /// Number of motors, from the first on, whose shafts can carry the torque of their joint.
  [[nodiscard]] int motors_that_can_carry(const Vec<S, M::joints>& torque) const {
    int i = 0;
    while (i < motors_.count && axis(i * motors_.axis_step).can_carry(torque[i * motors_.joint_step])) ++i;
    return i;
  }
  /// A torque within its limit at the joint may still be too large or infinite at the shaft, as a float
  /// behind a gear. A shaft that can carry the limit can carry every torque below it.
  void check_shafts(TickResult<M>& result) {
    if (limits_fit_all_shafts_ || motors_that_can_carry(result.torque) == motors_.count) return;
    raise(Fault::torque_not_finite, result);
  }
  /// Raises a fault that takes the torque away, after the controller's tick.
  [[gnu::cold, gnu::noinline]] void raise(Fault f, TickResult<M>& result) {
    supervisor_.raise(f);
    result.state = supervisor_.state();
    result.fault = supervisor_.fault();
    result.torque.setZero();
  }

  [[nodiscard]] bool allowed(const TickResult<M>& result) const {
    const bool powered = supervisor_.powered();
    bool within_limits = true;
    unroll<M::joints>([&](auto j) ESMC_INLINE {
      within_limits =
          within_limits && within(result.torque[j], powered ? controller_.config().torque_limit[j] : S(0));
    });
    return within_limits;
  }

  void gather() {
    const auto& c = controller_.config();
    for (int i = 0; i < sensors_.count; ++i) {
      const int joint = i * sensors_.joint_step, at = i * sensors_.axis_step;
      const D& a = axis(at);
      const auto s = a.template sample<S>();
      sample_.angle[joint] = s.angle + zero_.shift(joint);
      sample_.rate[joint] = s.rate;
      S phase = phase_[static_cast<unsigned>(at)];
      sample_.age_ticks[static_cast<unsigned>(joint)] = aged(a.sample_age_ticks(), phase, c.sample_time);
      // Sampled at the request, at the beginning of a tick: the waiting time is in its age already.
      if constexpr (samples_on_demand) phase = S(0);
      sample_.phase[static_cast<unsigned>(joint)] = phase;
      // A drive that was silent may have restarted, and its encoder lost its zero. Passive encoders, and
      // drives before their first heartbeat, are judged by their samples.
      const bool beats = joint % motors_.joint_step == 0 && a.heartbeat_age_ticks() != drive::age_max;
      const std::uint32_t silent = beats ? a.heartbeat_age_ticks() : a.sample_age_ticks();
      if (silent != drive::age_max && silent > heartbeat_age_ticks_max_) zero_.forget();
      if constexpr (requires { a.restarted(); }) {
        if (a.restarted()) zero_.forget();
      }
    }
  }

  /// Moves whole ticks of the phase of a sample to its age: it waited in a queue for longer than a tick.
  [[nodiscard]] static std::uint32_t aged(std::uint32_t age, S& phase, S sample_time) {
    if (phase < sample_time) return age;
    const S waited = phase / sample_time;
    if (!(waited < S(1e6F))) return drive::age_max;
    const auto whole = static_cast<std::uint32_t>(waited);
    phase -= S(whole) * sample_time;
    if (phase < S(0)) phase = S(0);
    return age > drive::age_max - whole ? drive::age_max : age + whole;
  }

  /// Every encoder has a fresh sample.
  [[nodiscard]] bool sensed() const {
    const auto& c = controller_.config();
    bool all = true;
    for (int i = 0; i < sensors_.count; ++i) {
      all =
          all && sample_.age_ticks[static_cast<unsigned>(i * sensors_.joint_step)] <= c.limits.max_age_ticks;
    }
    return all;
  }

  /// Refused unless every encoder has a fresh, finite sample: then an earlier zero no longer counts either,
  /// for the operator says that the mechanism stands elsewhere.
  [[gnu::cold, gnu::noinline]] void confirm_zero() {
    bool numbers = sensed();
    for (int i = 0; i < sensors_.count; ++i)
      numbers = numbers && finite(sample_.angle[i * sensors_.joint_step]);
    if (numbers) return zero_.confirm(sample_.angle);
    zero_.forget();
    link_.refuse();
  }

  /// A tick of homing. Where both joints press on their stops, the mechanism stands in its zero pose.
  [[gnu::cold, gnu::noinline]] TickResult<M> home() {
    TickResult<M> result = controller_.home(sample_, supervisor_, homing_);
    if (result.state == State::enabling) {
      homing_angle_ = sample_.angle;
      zero_.forget();  // what ends homing early must not look like its end
    }
    if (result.state != State::testing) return result;
    if (homing_.met()) {
      if (!closes(homing_angle_ + zero_.pose() - sample_.angle)) raise(Fault::loop_not_closed, result);
      homing_angle_ = sample_.angle;
    }
    if (result.stage_done) zero_.confirm(homing_angle_);
    return result;
  }
  /// The mechanism can be closed at these angles; encoders on all joints show the assembly mode as well.
  [[nodiscard]] bool closes(const Vec<S, M::joints>& angle) const {
    const auto& c = controller_.config();
    if constexpr (M::joints == 4) {
      if (c.sensors == Sensors::all) {
        const auto e = estimate_from_all(c.mechanism, angle, Vec<S, M::joints>::Zero().eval());
        return e.closure <= c.limits.closure;
      }
    }
    const Vec2<S> base(angle[0], angle[M::joints / 2]);
    return estimate_from_base(c.mechanism, c.mode, base, Vec2<S>::Zero().eval()).has_value();
  }

  template <hal::CanBus Bus>
  void transmit(Bus& bus, const TickResult<M>& result, bool answer) {
    const auto send = [&](const hal::CanFrame& f) { return put(bus, f); };
    for (int i = 0; i < motors_.count; ++i) {
      D& a = axes_[static_cast<unsigned>(i * motors_.axis_step)];
      // Silent drives get the request; the others not before all have been heard.
      const bool heard = wait_.heard[static_cast<unsigned>(i * motors_.axis_step)];
      if (result.state == State::enabling && (wait_.all || !heard)) {
        if constexpr (requires { a.know_errors(true, true); })
          a.know_errors(all_reported(heartbeat_age_ticks_max_), all_reported(1));
        a.enable(send);
      }
      const bool leave = result.state == State::fault || result.state == State::stopping;
      if ((leave && !a.idle()) || (result.state == State::disabled && a.must_be_released())) a.disable(send);
      if (answer && !a.tx_suspended()) {
        a.put_torque(outgoing_, result.torque[i * motors_.joint_step]);
        send(outgoing_);
      }
    }
    torque_feedback_.commanded(result.torque);
    // No heartbeat before the first enabling: a drive may still have torque from an earlier controller.
    if constexpr (samples_on_demand) {
      enabled_once_ = enabled_once_ || result.state == State::enabling;
      line_.end_tick(send, enabled_once_ && result.state != State::fault);
    }
  }

  template <hal::CanBus Bus>
  bool put(Bus& bus, const hal::CanFrame& f) {
    switch (bus.try_send(f)) {
      case hal::SendStatus::ok:
        ++counters_.sent;
        return true;
      case hal::SendStatus::bus_off:
        bus_events_ |= bus_off;
        break;
      case hal::SendStatus::bus_full:
      case hal::SendStatus::refused:
        break;
    }
    ++counters_.send_failed;
    return false;
  }

  /// Motor or encoder i sits on axis i * axis_step and joint i * joint_step. Axes are in the order of the
  /// joints that have one: the base joints, or all.
  struct Places {
    int count, axis_step, joint_step;
  };
  [[nodiscard]] Places places(int count) const {
    const int joint_step = M::joints / count;
    return {count, axis_count_ == M::joints ? joint_step : 1, joint_step};
  }

  Controller<M> controller_{};
  Supervisor supervisor_{};
  std::array<D, static_cast<unsigned>(axes_max)> axes_{};
  typename D::Line line_;
  int axis_count_;
  std::uint32_t heartbeat_age_ticks_max_, waiting_ticks_max_;
  ZeroPose<M> zero_;
  TorqueFeedbackCheck<M> torque_feedback_;
  bool samples_timed_;
  link::CommandLink link_;
  S delay_ticks_;
  Homing<S> homing_;
  Vec<S, M::joints> homing_angle_ = Vec<S, M::joints>::Zero();  // rad: where it began, then on the stops
  Places motors_, sensors_;
  bool limits_fit_all_shafts_;  // every shaft can carry the torque limit of its joint
  std::array<S, static_cast<unsigned>(axes_max)> phase_{};
  std::array<std::uint32_t, static_cast<unsigned>(axes_max)> silent_ticks_{};  // not counted under torque
  EnablingWait<axes_max> wait_{};
  std::uint32_t passed_ticks_ = 0;
  Command command_ = Command::none;
  DriveStatus status_{};
  Sample<M> sample_{};
  hal::CanFrame incoming_{}, outgoing_{.perishable = true};  // members: clearing one costs 76 bytes
  BusCounters counters_{};
  bool stage_done_ = false;
  bool drives_confirmed_ = true;
  bool enable_closed_ = true, enable_was_open_ = false;  // at the last reading; at one since the last tick
  bool output_ok_ = false;
  bool opened_ = false;
  bool enabled_once_ = false;  // since the start
  std::uint8_t bus_events_ = 0;
  bool late_ = false;
  std::uint32_t overruns_ = 0;  // of the bus, at the last receive()
  int taken_ = 0;
};

// Not inline: only the archive (instances_*.cpp) compiles it, not each program once more for each of its
// buses.
template <class M, drive::Drive D>
TickResult<M> Cycle<M, D>::decide(bool answer) {
  open();
  if (link_.active()) apply_link_commands();
  // status_ is of the last tick: the tick in which the last axis confirms still belongs to enabling.
  const bool acknowledged = command_ == Command::reset && supervisor_.fault() == Fault::emergency_stop;
  const std::uint32_t passed = answer ? 1U : std::exchange(passed_ticks_, 0U);
  supervisor_.begin_tick(command_, status_, stage_done_, passed);
  if (acknowledged) acknowledge();
  gather();
  if (command_ == Command::confirm_zero && supervisor_.state() == State::disabled) confirm_zero();
  command_ = Command::none;
  supervisor_.raise(drive_fault());
  if (link_.lost()) supervisor_.raise(Fault::command_lost);
  const bool enabling = supervisor_.state() == State::enabling;
  if (enabling && enabling_expired(passed)) supervisor_.raise(Fault::enabling_timeout);
  if (!enabling && wait_.waits) wait_ = {};
  if (std::exchange(late_, false)) supervisor_.raise(Fault::tick_late);
  TickResult<M> result = supervisor_.homing() ? home() : controller_.tick(sample_, supervisor_);
  check_shafts(result);
  stage_done_ = result.stage_done;
  output_ok_ = allowed(result);
  return result;
}

}  // namespace esmc
