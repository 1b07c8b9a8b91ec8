#pragma once
/// One CiA 402 axis seen from the controller: how it is configured and enabled, what it last said, how a
/// torque reaches it; and what all axes of a bus share: SYNC and our heartbeat.

#include <cstdint>
#include <optional>
#include <type_traits>
#include <utility>

#include "firmware/drive/axis.hpp"
#include "firmware/drive/cia402_setup.hpp"

namespace esmc::drive {

/// SYNC and the heartbeat of the controller.
class CanopenLine {
 public:
  CanopenLine() = default;
  /// `node`: ours, 1..127. `heartbeat_ticks`: one heartbeat every so many ticks, > 0.
  CanopenLine(std::uint8_t node, std::uint32_t heartbeat_ticks)
      : node_(node), heartbeat_ticks_(heartbeat_ticks) {}

  template <class Send>
  void request(Send&& send) {
    send(canopen::encode_sync());
  }
  /// Drives that hear no heartbeat stop by themselves: a controller with a fault says nothing.
  template <class Send>
  void end_tick(Send&& send, bool good) {
    if (wait_ticks_ > 0) --wait_ticks_;
    if (!good || wait_ticks_ > 0) return;
    if (send(canopen::encode_heartbeat(node_, canopen::NmtState::operational)))
      wait_ticks_ = heartbeat_ticks_;
  }

 private:
  std::uint8_t node_ = 127;
  std::uint32_t heartbeat_ticks_ = 1;
  std::uint32_t wait_ticks_ = 0;
};

/// One motor behind CiA 402, as the controller sees it. Satisfies Drive.
class Cia402Axis {
 public:
  using Line = CanopenLine;
  using Settings = Cia402Settings;

  Cia402Axis() = default;
  Cia402Axis(const AxisConfig& config, const Settings& settings) : config_(config), settings_(settings) {}

  void begin_tick() {
    // Nobody has asked for torque in the last tick: the next enabling starts anew, and may find the drive
    // changed.
    if (!asking_ && control_ == 0) {
      restart();
      attempts_ = 0;
      progressed_ = false;
    }
    asking_ = has_torque_ = reported_ = false;
    // A half is kept: against the clock the other one may come after the tick, and until the next SYNC they
    // are one set.
    if (has_report_ && has_motion_) has_report_ = has_motion_ = false;
    if (sample_age_ticks_ < age_max) ++sample_age_ticks_;
    if (heartbeat_age_ticks_ < age_max) ++heartbeat_age_ticks_;
  }

  /// A SYNC goes out now: what has come answers an earlier one. `in_tick`: it begins the tick for which
  /// begin_tick() was called, and a sample that has come since then is a tick old.
  void expect_set(bool in_tick) {
    has_report_ = has_motion_ = reported_ = false;
    if (in_tick && sample_age_ticks_ == 0) sample_age_ticks_ = 1;
  }

  /// Takes a frame from the bus. No side effect unless `accepted`.
  Received receive(const hal::CanFrame& f) {
    const bool before = std::exchange(sampled_, false);
    const Received r = sort(f);
    if (r != Received::accepted) sampled_ = before;
    return r;
  }

  /// Its frames of the tick: both PDOs once it is operational, a heartbeat before. An SDO reply is none: it
  /// comes when it likes, and a set that it completed would not be one of this tick.
  [[nodiscard]] bool heard_this_tick() const { return reported_ || (has_report_ && has_motion_); }
  [[nodiscard]] std::uint32_t sample_age_ticks() const { return sample_age_ticks_; }
  [[nodiscard]] bool brought_sample() const { return sampled_; }
  [[nodiscard]] std::uint32_t heartbeat_age_ticks() const { return heartbeat_age_ticks_; }

  template <class S>
  [[nodiscard]] JointSample<S> sample() const {
    const S per_shaft = S(config_.direction) / S(config_.gear_ratio);
    const S per_count = S(6.283185307179586476925286766559L) / S(settings_.counts_per_turn);
    return {S(position_) * per_count * per_shaft + S(config_.offset),
            S(velocity_) * S(settings_.velocity_unit) * per_shaft};
  }

  /// Torque at the joint as the drive reported it in this tick, be it late and a tick old, N m, model
  /// convention; empty without a report.
  [[nodiscard]] std::optional<float> observed_torque() const {
    if (!has_torque_) return std::nullopt;
    return static_cast<float>(torque_) * torque_lsb() * config_.direction * config_.gear_ratio;
  }

  /// Operation enabled in cyclic torque mode, reported without error in two ticks after it was asked for, and
  /// nothing else since: a tick is judged once both PDOs are there, but one of them is enough to be not
  /// ready.
  [[nodiscard]] bool ready() const { return confirmations_ >= 2 && closed_loop(); }
  /// Torque-free states reported in two ticks after the voltage was disabled, or stopped or restarted since:
  /// a drive that is stopped gives no torque by its abort-connection option, which the profile does not let
  /// it apply when it is made pre-operational.
  [[nodiscard]] bool idle() const { return control_ == 0 && (quiet_ >= 2 || booted_); }
  [[nodiscard]] bool must_be_released() const { return release_pending_; }
  [[nodiscard]] bool alive() const { return alive_; }
  /// CiA 402 has no message for it: a drive's own input shows as fault or as a disabled drive.
  [[nodiscard]] bool emergency_stopped() const { return false; }
  /// Its watchdog is the heartbeat of all axes, and its time is read back.
  [[nodiscard]] bool tx_suspended() const { return false; }
  /// Object dictionary, NMT start, or on its way between states that have torque before them: brakes and
  /// capacitors take time. A second attempt may follow a first that came past `switch on disabled`; a drive
  /// that waits there waits for power.
  [[nodiscard]] bool setting_up() const {
    const bool on_its_way = step_ == Step::operate && (control_ == cia402::control_switch_on ||
                                                       control_ == cia402::control_enable_operation);
    return attempts_ <= (progressed_ ? attempts_max : 1) &&
           (step_ == Step::setup || step_ == Step::start || on_its_way);
  }
  void acknowledge() {}
  [[nodiscard]] bool error() const { return emergency_ != 0 || faulty(); }
  /// Emergency error code, 0 for none.
  [[nodiscard]] std::uint32_t error_code() const { return emergency_; }
  [[nodiscard]] bool closed_loop() const {
    return nmt_ == canopen::NmtState::operational && state_ == cia402::State::operation_enabled &&
           mode_ == cia402::mode_cyclic_torque;
  }
  /// An object that we read, or that the drive would not let us write, is not what it must be. Stays for a
  /// tick after nobody asks for torque any more.
  [[nodiscard]] bool config_mismatch() const { return config_mismatch_; }
  /// The last one: for a message, so it stays until the set-up is begun anew.
  [[nodiscard]] std::optional<canopen::Object> contradicting_object() const { return refused_; }
  [[nodiscard]] std::uint8_t node() const { return config_.node; }
  /// N m per thousandth, as the drive said; 0 before.
  [[nodiscard]] float torque_lsb() const { return rated_torque_ / 1000.0F; }

  /// Frames that bring the axis to cyclic torque mode, a step further; call every tick while enabling.
  ///
  ///   pre-operational, heartbeat on  ->  its heartbeat says pre-operational  ->  every entry of
  ///   cia402::setup
  ///     ->  NMT start  ->  PDOs  ->  controlwords 06, 07, 0F, each after its statusword  ->  two reports:
  ///     ready()
  ///
  /// A drive that boots, or that falls back on the way through its states, has what it had stored: all of it
  /// anew. One SDO request at a time, at most four times; then, and after `retry_ticks` without progress,
  /// from the start.
  template <class Send>
  void enable(Send&& send) {
    asking_ = true;
    disobeyed_ticks_ = 0;
    if (ready() || config_mismatch_) return;
    if (wait_ticks_ > 0) --wait_ticks_;
    if (step_ > Step::call && (booted_ || (step_ > Step::setup && wait_ticks_ == 0))) return restart();
    if (step_ == Step::call) return call(send);
    if (step_ == Step::setup) return configure(send);
    if (step_ == Step::start) return start(send);
    operate();
  }

  void ask_again() { wait_ticks_ = 0; }

  /// The voltage is disabled by the controlword of the torque frame, which goes out in every tick. A drive
  /// that does not listen to it, because its PDOs are not ours or off, is at least stopped by NMT, which its
  /// abort-connection option (6007) answers; so is one that has not obeyed for retry_ticks, for our heartbeat
  /// may go on and would let it keep its torque.
  template <class Send>
  void disable(Send&& send) {
    restart();
    const bool listens = mapped_ && nmt_ == canopen::NmtState::operational;
    if (listens && ++disobeyed_ticks_ < settings_.retry_ticks) return;
    disobeyed_ticks_ = 0;
    send(canopen::encode_nmt(canopen::NmtCommand::stop, config_.node));
  }

  /// Whether this joint torque (N m, model convention) may go on the bus. What is more than the frame can say
  /// is clamped to that.
  template <class S>
  [[nodiscard]] bool can_carry(S joint_torque) const {
    return drive::can_carry(shaft_torque(config_, joint_torque));
  }
  /// Torque at the joint, N m, model convention, in thousandths of the rated torque, rounded half away from
  /// zero. Zero for a torque that cannot be carried, and while the scale is not known.
  template <class S>
  void put_torque(hal::CanFrame& f, S joint_torque) const {
    const bool carried = can_carry(joint_torque) && rated_torque_ > 0.0F;
    const float thousandths = carried ? shaft_torque(config_, joint_torque) / rated_torque_ * 1000.0F : 0.0F;
    cia402::put_command(f, config_.node, {control_, rounded(thousandths)});
  }

 private:
  Received sort(const hal::CanFrame& f) {
    if (f.extended) return Received::not_mine;
    if (is_command(f)) return f.remote ? Received::not_mine : Received::foreign_command;
    if ((f.id & canopen::node_mask) != config_.node) return Received::not_mine;
    switch (f.id & ~canopen::node_mask) {
      case canopen::id_heartbeat:
        return take(canopen::decode_heartbeat(f));
      case canopen::id_sdo_reply:
        return take(canopen::decode_sdo_reply(f));
      case canopen::id_emergency:
        return take(canopen::decode_emergency(f));
      // Before we have mapped them, these may be anything.
      case canopen::id_tpdo1:
        return mapped_ ? take(cia402::decode_report(f)) : Received::not_mine;
      case canopen::id_tpdo2:
        return mapped_ ? take(cia402::decode_motion(f)) : Received::not_mine;
      default:
        return Received::not_mine;
    }
  }

  enum class Step : std::uint8_t {
    call,     ///< to pre-operational, with a heartbeat
    setup,    ///< object dictionary
    start,    ///< to operational: wait for both PDOs
    operate,  ///< state machine
  };

  [[nodiscard]] bool faulty() const {
    return state_ == cia402::State::fault || state_ == cia402::State::fault_reaction_active;
  }
  [[nodiscard]] static std::int16_t rounded(float v) {
    constexpr float most = 32767.0F;
    if (v >= most) return 32767;
    if (v <= -most) return -32767;
    return static_cast<std::int16_t>(v + (v < 0.0F ? -0.5F : 0.5F));
  }

  /// What only a controller sends to this axis, or to all of them.
  [[nodiscard]] bool is_command(const hal::CanFrame& f) const {
    if (f.id == canopen::id_nmt) return f.size >= 2 && (f.data[1] == 0 || f.data[1] == config_.node);
    if (f.id == canopen::id_sync || f.id == canopen::id_heartbeat + settings_.master_node) return true;
    if ((f.id & canopen::node_mask) != config_.node) return false;
    switch (f.id & ~canopen::node_mask) {
      case canopen::id_rpdo1:
      case canopen::id_rpdo2:
      case canopen::id_rpdo3:
      case canopen::id_rpdo4:
      case canopen::id_sdo_request:
        return true;
      default:
        return false;
    }
  }

  void set_control(std::uint16_t control) {
    if (control == control_) return;
    control_ = control;
    quiet_ = confirmations_ = 0;
  }
  void restart() {
    set_control(cia402::control_disable_voltage);
    step_ = Step::call;
    wait_ticks_ = 0;
    preoperational_requested_ = config_mismatch_ = false;
  }

  /// Sent to a silent axis as well, for it to be heard; but it counts only once its heartbeat has been heard.
  template <class Send>
  void call(Send&& send) {
    if (preoperational_requested_ && answered_) {
      step_ = Step::setup;
      if (attempts_ <= attempts_max) ++attempts_;
      entry_ = 0;
      refused_.reset();
      begin_transfer(false);
      return configure(send);
    }
    if (wait_ticks_ > 0 && (preoperational_requested_ || !heard_)) return;
    const bool taken =
        send(canopen::encode_nmt(canopen::NmtCommand::enter_pre_operational, config_.node)) &&
        send(canopen::encode_sdo_write(config_.node, cia402::producer_heartbeat, settings_.heartbeat_ms, 2));
    wait_ticks_ = settings_.retry_ticks;
    preoperational_requested_ = taken && heard_;
    answered_ = mapped_ = booted_ = false;
    emergency_ = 0;
  }

  void begin_transfer(bool reading) {
    reading_ = reading;
    in_flight_ = false;
    sent_ = 0;
  }
  template <class Send>
  void configure(Send&& send) {
    if (in_flight_ && wait_ticks_ > 0) return;
    if (sent_ > repetitions_max) return restart();
    const cia402::Entry& e = cia402::setup[entry_];
    const bool reads = reading_ || e.task >= cia402::Task::expect;
    const hal::CanFrame f =
        reads ? canopen::encode_sdo_read(config_.node, e.object)
              : canopen::encode_sdo_write(config_.node, e.object,
                                          cia402::value_of(e, settings_, config_.node), e.bytes);
    if (!send(f)) return;
    reading_ = reads;
    in_flight_ = true;
    ++sent_;
    wait_ticks_ = settings_.sdo_ticks;
  }
  void next_entry() {
    begin_transfer(false);
    if (++entry_ < cia402::setup.size()) return;
    step_ = Step::start;
    wait_ticks_ = settings_.retry_ticks;
    mapped_ = true;
    started_ = false;
    nmt_ = canopen::NmtState::pre_operational;
    state_ = cia402::State::unknown;
    mode_ = 0;
  }
  template <class Send>
  void start(Send&& send) {
    if (!started_) started_ = send(canopen::encode_nmt(canopen::NmtCommand::start, config_.node));
    if (nmt_ != canopen::NmtState::operational) return;
    step_ = Step::operate;
    operate();
  }
  void operate() {
    const bool on_its_way =
        control_ == cia402::control_switch_on || control_ == cia402::control_enable_operation;
    // A fault on the way may be that it missed our heartbeat: it watches again from the next one, which the
    // set-up gives time for.
    const bool fell_back = on_its_way && (state_ == cia402::State::switch_on_disabled || faulty());
    if (nmt_ != canopen::NmtState::operational || fell_back) return restart();
    const std::uint16_t before = control_;
    set_control(answer_to(state_));
    if (control_ != before) wait_ticks_ = settings_.retry_ticks;
    progressed_ = progressed_ || control_ == cia402::control_switch_on;
    if (control_ == cia402::control_enable_operation) release_pending_ = true;
    if (control_ == cia402::control_fault_reset) emergency_ = 0;
  }
  /// The controlword that a statusword asks for.
  [[nodiscard]] std::uint16_t answer_to(cia402::State state) const {
    using cia402::State;
    if (state == State::switch_on_disabled) return cia402::control_shutdown;
    if (state == State::ready_to_switch_on) return cia402::control_switch_on;
    if (state == State::switched_on) return cia402::control_enable_operation;
    // Enabled because we asked for it: else somebody else did.
    if (state == State::operation_enabled)
      return control_ == cia402::control_enable_operation ? control_ : disabled;
    // The edge needs a frame without the bit before it.
    if (state == State::fault && (control_ == disabled || control_ == cia402::control_fault_reset)) {
      return cia402::control_fault_reset;
    }
    return disabled;
  }

  Received take(const std::optional<canopen::NmtState>& state) {
    if (!state) return Received::malformed;
    alive_ = heard_ = true;
    nmt_ = *state;
    heartbeat_age_ticks_ = 0;
    if (nmt_ == canopen::NmtState::operational) return Received::accepted;
    if (nmt_ == canopen::NmtState::boot_up) {
      booted_ = true;  // without torque until somebody enables it anew, and perhaps silent from now on:
                       // heartbeats are off again
      release_pending_ = false;
      mapped_ = false;  // its PDOs may come at once, and be anything
      state_ = cia402::State::unknown;
    }
    answered_ = nmt_ == canopen::NmtState::pre_operational;
    reported_ = true;
    confirmations_ = 0;
    if (!answered_) quiet_ = 2;
    if (idle()) release_pending_ = false;
    return Received::accepted;
  }
  Received take(const std::optional<canopen::Emergency>& e) {
    if (!e) return Received::malformed;
    alive_ = true;
    emergency_ = e->code;
    if (error()) confirmations_ = 0;
    return Received::accepted;
  }
  Received take(const std::optional<cia402::Report>& r) {
    if (!r) return Received::malformed;
    pending_position_ = r->position;
    torque_ = r->torque;
    has_torque_ = true;
    state_ = cia402::state_of(r->status);
    if (!cia402::is_torque_free(state_)) quiet_ = 0;  // at once: the other PDO of the set may be lost
    return take_pdo(has_report_);
  }
  Received take(const std::optional<cia402::Motion>& m) {
    if (!m) return Received::malformed;
    pending_velocity_ = m->velocity;
    mode_ = m->mode;
    return take_pdo(has_motion_);
  }
  /// Position and velocity count once both are there, of the same SYNC. PDOs come from operational nodes
  /// only.
  Received take_pdo(bool& has) {
    nmt_ = canopen::NmtState::operational;
    const bool first = !has;
    has = true;
    if (has_report_ && has_motion_) {
      position_ = pending_position_;
      velocity_ = pending_velocity_;
      sample_age_ticks_ = 0;
      sampled_ = true;
      if (first) judge();
    }
    return Received::accepted;
  }
  /// Ticks in a row, up to two.
  static void count(std::uint8_t& ticks, bool yes) {
    if (!yes) ticks = 0;
    if (yes && ticks < 2) ++ticks;
  }
  /// Once per tick, with both PDOs of it.
  void judge() {
    count(confirmations_, control_ == cia402::control_enable_operation && closed_loop() && !error());
    count(quiet_, cia402::is_torque_free(state_));
    if (idle()) release_pending_ = false;
  }

  Received take(const std::optional<canopen::Sdo>& reply) {
    if (!reply) return Received::malformed;
    alive_ = true;
    if (step_ != Step::setup || !in_flight_) return Received::accepted;
    const cia402::Entry& e = cia402::setup[entry_];
    if (!(reply->object == e.object)) return Received::accepted;
    if (reply->kind == canopen::SdoKind::abort) {
      if (e.task == cia402::Task::attempt || (e.optional && cia402::absent(reply->value))) {
        next_entry();
      } else {
        refuse(e);
      }
    } else if (reply->kind == (reading_ ? canopen::SdoKind::value : canopen::SdoKind::written)) {
      if (!reading_ && e.task == cia402::Task::verify) {
        begin_transfer(true);
      } else if (!reading_ || agrees(e, *reply)) {
        next_entry();
      } else {
        refuse(e);
      }
    }
    return Received::accepted;
  }
  void refuse(const cia402::Entry& e) {
    config_mismatch_ = true;
    refused_ = e.object;
  }
  /// Whether what was read is what must be there.
  bool agrees(const cia402::Entry& e, const canopen::Sdo& reply) {
    if (reply.size != 0 && reply.size != e.bytes) return false;
    const std::uint32_t used = e.bytes == 4 ? 0xFFFF'FFFFU : (1U << (8U * e.bytes)) - 1U;
    const std::uint32_t value = reply.value & used;
    if (e.task == cia402::Task::rated) {
      rated_torque_ = static_cast<float>(value) * settings_.rated_torque_unit;
      const float off = rated_torque_ - settings_.rated_torque, allowed = 0.01F * rated_torque_;
      return rated_torque_ > 0.0F && off <= allowed && -off <= allowed;
    }
    if (e.task == cia402::Task::at_least) {
      return static_cast<float>(value) * torque_lsb() >=
             settings_.torque_limit * 0.9999F;  // rounding of the scale
    }
    const std::uint32_t wanted = cia402::value_of(e, settings_, config_.node) & used;
    return ((value ^ wanted) & e.mask) == 0;
  }

  static constexpr std::uint8_t repetitions_max = 3, attempts_max = 2;
  static constexpr std::uint16_t disabled = cia402::control_disable_voltage;

  AxisConfig config_{};
  Settings settings_{};
  float rated_torque_ = 0.0F;  // N m, from the drive
  std::int32_t position_ = 0, velocity_ = 0;
  std::int32_t pending_position_ = 0, pending_velocity_ = 0;
  std::uint32_t sample_age_ticks_ = age_max;
  std::uint32_t heartbeat_age_ticks_ = age_max;
  std::int16_t torque_ = 0;            // thousandths of the rated torque
  std::uint16_t wait_ticks_ = 0;       // for an answer, or for progress
  std::uint16_t disobeyed_ticks_ = 0;  // since it was told to leave torque control, or last told by NMT
  std::uint16_t control_ = 0;
  std::uint16_t emergency_ = 0;
  Step step_ = Step::call;
  canopen::NmtState nmt_ = canopen::NmtState::boot_up;
  cia402::State state_ = cia402::State::unknown;
  std::int8_t mode_ = 0;
  std::uint8_t entry_ = 0;                 // of the set-up
  std::uint8_t sent_ = 0;                  // how often the request in flight was sent
  std::uint8_t attempts_ = 0;              // set-ups since it was asked for torque
  std::uint8_t confirmations_ = 0;         // ticks in a row that reported torque control, up to two
  std::uint8_t quiet_ = 0;                 // ticks in a row that reported no torque, up to two
  bool progressed_ = false;                // past switch on disabled, since it was asked for torque
  bool in_flight_ = false;                 // an SDO request waits for its answer
  bool reading_ = false;                   // the request in flight, or the next one, is a read
  bool preoperational_requested_ = false;  // told to be pre-operational since its heartbeat was first heard
  bool answered_ = false;                  // said pre-operational since
  bool started_ = false;                   // NMT start was taken by the bus
  bool mapped_ = false;                    // its PDOs are ours
  bool has_report_ = false, has_motion_ = false;  // PDOs since the last SYNC
  bool has_torque_ = false;                       // a report in this tick
  bool reported_ = false;                         // said in this tick that it is not operational
  bool heard_ = false;                            // a heartbeat or boot-up
  bool booted_ = false;                           // since it was called
  bool alive_ = false;
  bool sampled_ = false;          // by the last frame
  bool asking_ = false;           // enable() was called in this tick
  bool release_pending_ = false;  // asked into torque control, not seen idle since
  bool config_mismatch_ = false;
  std::optional<canopen::Object> refused_;
};

static_assert(Drive<Cia402Axis>);
static_assert(std::is_trivially_copyable_v<Cia402Axis> && sizeof(Cia402Axis) <= 160);

}  // namespace esmc::drive
