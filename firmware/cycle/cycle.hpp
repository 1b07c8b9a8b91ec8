#pragma once
/// The control cycle on a CAN bus: frames in, one tick of the controller, frames out.

#include <array>
#include <cstdint>
#include <type_traits>
#include <utility>

#include "firmware/cycle/controller.hpp"
#include "firmware/cycle/linked.hpp"
#include "firmware/cycle/plausibility.hpp"
#include "firmware/drive/axis.hpp"
#include "hal/can.hpp"

namespace esmc {

/// Losses that no caller can apply_law on are counted, not printed.
struct BusCounters {
  std::uint32_t received = 0;         ///< frames of our axes
  std::uint32_t not_mine = 0;         ///< frames of somebody else
  std::uint32_t malformed = 0;        ///< frames of our axes with a wrong length or format
  std::uint32_t foreign_command = 0;  ///< commands to our axes that we did not send
  std::uint32_t sent = 0;
  std::uint32_t send_failed = 0;  ///< queue full: the frame was dropped
};

/// A control tick with its frames. M: Rr or FiveBar; D: the drives' protocol.
template <class M, drive::Drive D>
class Cycle {
 public:
  using Mechanism = M;
  using S = typename M::Scalar;
  static constexpr int axes_max = M::joints;
  static constexpr int frames_per_tick_max = 1024;  ///< what one tick reads from the bus at most
  /// The drives send samples when asked to by request(), and not by themselves.
  static constexpr bool samples_on_demand = !std::is_same_v<typename D::Line, drive::NoLine>;

  /// What the controller, the axes, the line and the link are told.
  struct Config {
    ControllerConfig<M> controller{};
    std::array<D, static_cast<unsigned>(axes_max)>
        axes{};  ///< one per joint with a motor or a sensor, in the order of the joints
    typename D::Line line{};
    int axis_count = 2;
    std::uint32_t heartbeat_age_ticks_max = 0;
    std::uint32_t waiting_ticks_max =
        750;  ///< while enabling, without a word from a drive, or without any being set up: enabling_timeout
    bool zero_absolute = true;  ///< encoders keep their zero without power; false: confirm_zero first
    Vec<S, M::joints> zero_pose = Vec<S, M::joints>::Zero();  ///< rad: the joints as confirm_zero finds them
    S torque_mismatch{};        ///< N m at the joint between a drive's torque and its command; 0: any
    S torque_time{};            ///< s: in which a drive follows its command
    bool samples_timed = true;  ///< false where time is counted in sets: how long a frame waited says nothing
    link::LinkConfig link{};    ///< to a supervisor computer; without a base_id: none
    S delay_ticks{};            ///< as in the layers of controller.gains; for gains that come by the link
  };

  explicit Cycle(const Config& config)
      : controller_(config.controller),
        supervisor_(controller_.supervision()),
        axes_(config.axes),
        line_(config.line),
        axis_count_(config.axis_count),
        heartbeat_age_ticks_max_(config.heartbeat_age_ticks_max),
        waiting_ticks_max_(config.waiting_ticks_max),
        zero_(config.zero_absolute, config.zero_pose),
        echo_(config.torque_mismatch, config.torque_time, config.controller.sample_time),
        samples_timed_(config.samples_timed),
        link_(config.link),
        delay_ticks_(config.delay_ticks),
        motors_(places(config.controller.motor_count())),
        sensors_(places(config.controller.sensor_count())),
        limits_fit_all_shafts_(motors_that_can_carry(config.controller.torque_limit) == motors_.count) {
    silent_ticks_.fill(drive::age_max);
  }

  /// Takes effect at the next tick. A stop is not overwritten by what is asked after it, and a halt by a stop
  /// only.
  void command(Command c) {
    if (command_ != Command::stop && (command_ != Command::halt || c == Command::stop)) command_ = c;
  }
  /// The normally closed contact `enable` of the board, before each tick; open is a fault. Closed where there
  /// is none.
  void enable_input(bool closed) { enable_closed_ = closed; }
  /// Two ticks in a row began late, or one by far: this one is a fault. What keeps the clock says so, before
  /// the tick.
  void tick_late() { late_ = true; }
  /// So many us will have passed at the next tick that no samples answer (lockstep); < 1000 s.
  void time_passed(std::uint32_t us) {
    passed_ticks_ = static_cast<std::uint32_t>(S(us) * S(1e-6F) / controller_.config().sample_time);
  }
  /// The output `drive_enable`: drives may have power. Low before the first enabling and in a fault.
  [[nodiscard]] bool drive_enable() const {
    return supervisor_.state() != State::disabled && supervisor_.state() != State::fault;
  }
  /// The output of a brake that opens with power: only while there may be torque.
  [[nodiscard]] bool release_brake() const { return supervisor_.powered(); }
  /// The last tick put out what its state allows: finite, within its limit, and zero where there may be none.
  /// Nothing but broken memory makes it false; the board's watchdog is refreshed only while it holds.
  [[nodiscard]] bool output_ok() const { return output_ok_; }

  [[nodiscard]] const Supervisor& supervisor() const { return supervisor_; }
  [[nodiscard]] const Controller<M>& controller() const { return controller_; }
  [[nodiscard]] const BusCounters& counters() const { return counters_; }
  [[nodiscard]] const Sample<M>& sample() const { return sample_; }
  [[nodiscard]] const link::CommandLink& link() const { return link_; }
  /// For the store of parameters that a board may have: link::restore() before the first tick, link::serve()
  /// between ticks.
  [[nodiscard]] link::CommandLink& link() { return link_; }
  [[nodiscard]] const D& axis(int i) const { return axes_[static_cast<unsigned>(i)]; }

  /// No axis has been heard yet: the enabling sequence is repeated at the next tick instead of after its
  /// time.
  void ask_again() {
    for (D& a : axes_) a.ask_again();
  }

  /// True when every axis has sent its frame of the tick: in lockstep the time to tick.
  [[nodiscard]] bool complete() const {
    bool all = opened_;
    for (int i = 0; i < axis_count_; ++i) all = all && axis(i).heard_this_tick();
    return all;
  }

  /// True when some axis has sent its frame of the tick: a set is under way.
  [[nodiscard]] bool set_begun() const {
    bool any = false;
    for (int i = 0; i < axis_count_; ++i) any = any || axis(i).heard_this_tick();
    return opened_ && any;
  }

  /// True when some axis has said something since the cycle began to listen.
  [[nodiscard]] bool heard() const {
    bool any = false;
    for (int i = 0; i < axis_count_; ++i) any = any || axis(i).alive();
    return any;
  }
  /// True when every motor has said that it is idle, after whatever it was asked last.
  [[nodiscard]] bool all_idle() const { return status().all_idle; }
  /// receive() reads no more before the next tick, which will raise bus_overload: whoever waits for a
  /// complete() set must not wait on.
  [[nodiscard]] bool overloaded() const { return (bus_events_ & flooded) != 0; }

  /// Takes what waits on the bus, at most frames_per_tick_max frames. May be called several times per tick.
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
    // What is left unread makes every later sample older than it looks; what the controller had no room for
    // is not known at all.
    if (taken_ == frames_per_tick_max) bus_events_ |= flooded;
    if constexpr (requires { bus.overruns(); }) {
      const std::uint32_t before = std::exchange(overruns_, bus.overruns());
      if (before != overruns_) bus_events_ |= flooded;
    }
  }

  /// Asks the drives for the samples of the next tick, where the protocol samples on demand. In lockstep at
  /// the end of a tick, against the clock at its beginning.
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

  /// One tick, read top to bottom: transitions, what the drives say, state to torque, torque to frames.
  /// With `answer` false no torque frame is sent (lockstep: the set was not complete, nobody waits for one).
  template <hal::CanBus Bus>
  TickResult<M> tick(Bus& bus, bool answer = true) {
    open();
    if (link_.active()) apply_link_commands();
    // The drives' word of the tick before: a tick in which the last axis confirms is still one of enabling.
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
    if (enabling && waits_in_vain(passed)) supervisor_.raise(Fault::enabling_timeout);
    if (!enabling && wait_.waits) wait_ = {};
    if (std::exchange(late_, false)) supervisor_.raise(Fault::tick_late);
    TickResult<M> result = controller_.tick(sample_, supervisor_);
    check_shafts(result);
    stage_done_ = result.stage_done;
    output_ok_ = allowed(result);
    transmit(bus, result, answer);
    if (link_.active()) send_telemetry(bus, result);
    if (!supervisor_.powered()) status_ = status();  // no way out of a state with torque asks the drives
    opened_ = false;
    return result;
  }

 private:
  /// What happened on the bus since the last tick, bits of bus_events_. In one word, as mostly there is none.
  static constexpr std::uint8_t bus_off = 1, flooded = 2, foreign_command = 4, malformed = 8;

  /// The first call of a tick ages what is known.
  void open() {
    if (opened_) return;
    for (int i = 0; i < axis_count_; ++i) axes_[static_cast<unsigned>(i)].begin_tick();
    if (!supervisor_.powered()) {
      for (std::uint32_t& age : silent_ticks_) age += age < drive::age_max ? 1U : 0U;
    }
    link_.begin_tick();
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
      // What has waited while the program stood still is as old as it waited.
      const link::Outcome o = link_.receive(
          f, static_cast<std::uint32_t>(std::min(age / controller_.config().sample_time, S(1e6F))));
      if (o == link::Outcome::foreign_command) bus_events_ |= foreign_command;
      if (o != link::Outcome::not_mine) return;
    }
    ++counters_.not_mine;
  }

  /// What the supervisor computer wants of this tick. A stop of our own program is not overwritten.
  void apply_link_commands() {
    const Command c = heed(link_, controller_, delay_ticks_);
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

  /// What is wrong on the bus or in a drive, before anything is computed.
  Fault drive_fault() {
    const std::uint8_t news = std::exchange(bus_events_, std::uint8_t{0});  // latched by the supervisor
    for (int i = 0; i < axis_count_; ++i) {
      if (axis(i).emergency_stopped()) return Fault::emergency_stop;
    }
    if (!enable_closed_) return Fault::enable_open;
    if (news != 0) {
      return (news & bus_off) != 0           ? Fault::bus_off
             : (news & flooded) != 0         ? Fault::bus_overload
             : (news & foreign_command) != 0 ? Fault::foreign_controller
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
        if (!echo_.plausible(i * motors_.joint_step, a.observed_torque())) return Fault::torque_mismatch;
      }
      if constexpr (requires { a.torque_age_ticks(); }) {
        if (echo_.compares() && a.torque_age_ticks() > heartbeat_age_ticks_max_)
          return Fault::torque_mismatch;
      }
    }
    if (!powered) {
      echo_.forget();
      // Some drives say where they are only once they have been set up: enabling may get that far, and no
      // further.
      return !zero_.confirmed() && sensed() ? Fault::zero_not_confirmed : Fault::none;
    }
    return zero_.confirmed() ? Fault::none : Fault::zero_not_confirmed;
  }

  /// An order to arm must not outlive the attention of the one who gave it, and power that comes later must
  /// not meet it: it ends where a drive says nothing, or speaks and is neither being set up nor ready (its
  /// motor has no power).
  [[gnu::noinline]] bool waits_in_vain(std::uint32_t passed) {
    bool all = true, set_up = false;
    for (int i = 0; i < axis_count_; ++i) {
      const bool motor = i % motors_.axis_step == 0;  // of a passive encoder only samples count
      const std::uint32_t silent =
          motor ? silent_ticks_[static_cast<unsigned>(i)] : axis(i).sample_age_ticks();
      bool& heard = wait_.heard[static_cast<unsigned>(i)];
      heard = heard || silent == 0;
      all = all && heard;
      set_up = set_up || (motor && axis(i).setting_up());
    }
    if (all && !wait_.all) wait_.ticks = 0;
    wait_.all = all;
    wait_.waits = true;
    if (!all || !set_up) wait_.ticks += passed;
    return wait_.ticks >= waiting_ticks_max_;
  }

  /// The operator has seen the emergency stop: it is what the axes report now that may be cleared.
  void acknowledge() {
    for (int i = 0; i < axis_count_; ++i) axes_[static_cast<unsigned>(i)].acknowledge();
  }

  /// How many motors, counted from the first, can carry what their joint is to get.
  [[nodiscard]] int motors_that_can_carry(const Vec<S, M::joints>& torque) const {
    int i = 0;
    while (i < motors_.count && axis(i * motors_.axis_step).can_carry(torque[i * motors_.joint_step])) ++i;
    return i;
  }
  /// What is finite and within its limit at the joint may be neither at the shaft, in a float, behind a gear.
  /// A shaft that can carry the limit carries what is below.
  void check_shafts(TickResult<M>& result) {
    if (limits_fit_all_shafts_ || motors_that_can_carry(result.torque) == motors_.count) return;
    supervisor_.raise(Fault::torque_not_finite);
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
      // Sampled when it was asked for, at the beginning of a tick: how long the answer then waited is in its
      // ticks already.
      if constexpr (samples_on_demand) phase = S(0);
      sample_.phase[static_cast<unsigned>(joint)] = phase;
      // A drive that was away may have restarted, and then its count began anew. Of a passive encoder, and of
      // a drive that has never sent one, heartbeats say nothing.
      const bool beats = joint % motors_.joint_step == 0 && a.heartbeat_age_ticks() != drive::age_max;
      const std::uint32_t silent = beats ? a.heartbeat_age_ticks() : a.sample_age_ticks();
      if (silent != drive::age_max && silent > heartbeat_age_ticks_max_) zero_.forget();
    }
  }

  /// A sample that waited in a queue for longer than a tick is not of this tick: whole ticks of its phase are
  /// age.
  [[nodiscard]] static std::uint32_t aged(std::uint32_t age, S& phase, S sample_time) {
    if (phase < sample_time) return age;
    const S waited = phase / sample_time;
    if (!(waited < S(1e6F))) return drive::age_max;
    const auto whole = static_cast<std::uint32_t>(waited);
    phase -= S(whole) * sample_time;
    if (phase < S(0)) phase = S(0);
    return age > drive::age_max - whole ? drive::age_max : age + whole;
  }

  /// Whether every encoder has just been heard.
  [[nodiscard]] bool sensed() const {
    const auto& c = controller_.config();
    bool all = true;
    for (int i = 0; i < sensors_.count; ++i) {
      all =
          all && sample_.age_ticks[static_cast<unsigned>(i * sensors_.joint_step)] <= c.limits.max_age_ticks;
    }
    return all;
  }

  /// Nothing unless every encoder has just said a number.
  void confirm_zero() {
    bool numbers = sensed();
    for (int i = 0; i < sensors_.count; ++i)
      numbers = numbers && finite(sample_.angle[i * sensors_.joint_step]);
    if (numbers) zero_.confirm(sample_.angle);
  }

  template <hal::CanBus Bus>
  void transmit(Bus& bus, const TickResult<M>& result, bool answer) {
    const auto send = [&](const hal::CanFrame& f) { return put(bus, f); };
    for (int i = 0; i < motors_.count; ++i) {
      D& a = axes_[static_cast<unsigned>(i * motors_.axis_step)];
      // A silent drive is called. The others are not asked into torque before all have been heard.
      const bool heard = wait_.heard[static_cast<unsigned>(i * motors_.axis_step)];
      if (result.state == State::enabling && (wait_.all || !heard)) a.enable(send);
      const bool leave = result.state == State::fault || result.state == State::stopping;
      if ((leave && !a.idle()) || (result.state == State::disabled && a.must_be_released())) a.disable(send);
      if (answer && !a.tx_suspended()) {
        a.put_torque(outgoing_, result.torque[i * motors_.joint_step]);
        send(outgoing_);
      }
    }
    echo_.told(result.torque);
    // No word that keeps a drive alive before we have set it up: it may have torque from a controller before
    // us.
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

  /// Where motors or encoders are: number i sits on axis i * axis_step and joint i * joint_step. Axes stand
  /// in the order of the joints that have one: those of the base only, or all.
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
  TorqueFeedbackCheck<M> echo_;
  bool samples_timed_;
  link::CommandLink link_;
  S delay_ticks_;
  Places motors_, sensors_;
  bool limits_fit_all_shafts_;  ///< all can carry their torque limit
  std::array<S, static_cast<unsigned>(axes_max)> phase_{};
  std::array<std::uint32_t, static_cast<unsigned>(axes_max)>
      silent_ticks_{};                ///< since an axis has said something; not counted under torque
  struct Wait {                       ///< since the order to arm
    std::uint32_t ticks = 0;          ///< for a drive to speak; once all have, for power
    bool waits = false, all = false;  ///< all have been heard
    std::array<bool, static_cast<unsigned>(axes_max)> heard{};
  };
  Wait wait_{};
  std::uint32_t passed_ticks_ = 0;
  Command command_ = Command::none;
  DriveStatus status_{};
  Sample<M> sample_{};
  hal::CanFrame incoming_{}, outgoing_{.perishable = true};  // kept: a frame has 76 bytes to clear
  BusCounters counters_{};
  bool stage_done_ = false;
  bool enable_closed_ = true;
  bool output_ok_ = false;
  bool opened_ = false;
  bool enabled_once_ = false;  // to torque, once since the start
  std::uint8_t bus_events_ = 0;
  bool late_ = false;
  std::uint32_t overruns_ = 0;  // of the bus, as it counts them
  int taken_ = 0;
};

}  // namespace esmc
