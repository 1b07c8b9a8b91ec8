#pragma once
/// One CiA 402 axis seen from the controller.

#include <cstdint>
#include <optional>
#include <type_traits>
#include <utility>

#include "firmware/drive/axis.hpp"
#include "firmware/drive/canopen_line.hpp"
#include "firmware/drive/cia402_configurator.hpp"

namespace esmc::drive {

/// One motor with a CiA 402 drive. Satisfies Drive, which explains members without a comment.
class Cia402Axis {
 public:
  using Line = CanopenLine;
  using Settings = Cia402Settings;

  Cia402Axis() = default;
  Cia402Axis(const AxisConfig& config, const Settings& settings) : config_(config), settings_(settings) {}

  /// Counts the ages; once per tick, before its frames are received. After a tick without enable(), and with
  /// controlword `disable voltage`, the next enable() starts anew.
  void begin_tick() {
    // Without enable() in the last tick the next enabling starts anew: the drive may have changed.
    if (!asking_ && control_ == 0) {
      restart();
      attempts_ = 0;
      progressed_ = false;
    }
    asking_ = has_torque_ = reported_ = booted_now_ = false;
    // One PDO alone is kept: the other one may come after the tick, and both belong to the same SYNC.
    if (has_report_ && has_motion_) has_report_ = has_motion_ = false;
    if (sample_age_ticks_ < age_max) ++sample_age_ticks_;
    if (heartbeat_age_ticks_ < age_max) ++heartbeat_age_ticks_;
  }

  /// Drops the PDOs received so far, which belong to an earlier SYNC; call when SYNC is sent. `in_tick`:
  /// begin_tick() was called for the tick that this SYNC opens, so a sample received since is a tick old.
  void expect_set(bool in_tick) {
    has_report_ = has_motion_ = reported_ = false;
    if (in_tick && sample_age_ticks_ == 0) sample_age_ticks_ = 1;
  }

  /// Adds the identifiers of the node, and those that only a controller sends.
  void add_filters(hal::IdFilters& list) const {
    list.add({config_.node, canopen::node_mask, false});
    for (const std::uint32_t id :
         {canopen::id_nmt, canopen::id_sync, canopen::id_heartbeat + settings_.master_node})
      list.add({id, 0x7FF, false});
  }
  /// Judges a frame and takes it if it is of the drive. Changes nothing unless the result is `accepted`.
  Received receive(const hal::CanFrame& f) {
    const bool before = std::exchange(sampled_, false);
    const Received r = sort(f);
    if (r != Received::accepted) sampled_ = before;
    return r;
  }

  /// True if both PDOs of the tick have come, or a heartbeat of a drive that is not operational.
  [[nodiscard]] bool heard_this_tick() const { return reported_ || (has_report_ && has_motion_); }
  [[nodiscard]] std::uint32_t sample_age_ticks() const { return sample_age_ticks_; }  ///< 0: this tick
  [[nodiscard]] bool brought_sample() const { return sampled_; }  ///< the last accepted frame completed one
  [[nodiscard]] std::uint32_t heartbeat_age_ticks() const { return heartbeat_age_ticks_; }  ///< 0: this tick

  /// Joint angle (rad) and rate (rad/s) of the last pair of PDOs, model convention; see sample_age_ticks().
  template <class S>
  [[nodiscard]] JointSample<S> sample() const {
    const S per_shaft = S(config_.direction) / S(config_.gear_ratio);
    const S per_count = S(6.283185307179586476925286766559L) / S(settings_.counts_per_turn);
    return {S(position_) * per_count * per_shaft + S(config_.offset),
            S(velocity_) * S(settings_.velocity_unit) * per_shaft};
  }

  /// Torque at the joint reported in this tick, possibly a tick old, N m, model convention; empty: no report.
  [[nodiscard]] std::optional<float> observed_torque() const {
    if (!has_torque_) return std::nullopt;
    return static_cast<float>(torque_) * torque_lsb() * config_.direction * config_.gear_ratio;
  }

  /// True if the drive reported operation enabled in cyclic torque mode without error in two ticks, and no
  /// other state since. Two PDOs confirm a tick, one of them is enough to be not ready.
  [[nodiscard]] bool ready() const { return confirmations_ >= 2 && closed_loop(); }
  /// True after controlword `disable voltage` if the drive then reported a state without torque in two ticks
  /// in a row, was stopped by NMT, or booted. The drive's abort-connection option ends the torque of a
  /// stopped drive; that option does not apply in pre-operational.
  [[nodiscard]] bool idle() const { return control_ == 0 && (quiet_ >= 2 || booted_); }
  [[nodiscard]] bool must_be_released() const {
    return release_pending_;
  }                                                    ///< operation requested, not idle() or booted since
  [[nodiscard]] bool alive() const { return alive_; }  ///< a heartbeat, EMCY or SDO reply was received
  /// False: CiA 402 has no message for it; the drive's own input shows as a fault or a disabled drive.
  [[nodiscard]] bool emergency_stopped() const { return false; }
  /// False: the drive's watchdog is our heartbeat, whose time-out is read back instead of tested.
  [[nodiscard]] bool tx_suspended() const { return false; }
  /// True in the set-up by SDO, NMT start, or between `ready to switch on` and torque control: brakes take
  /// time. A second attempt counts only if the first left `switch on disabled`, as without power.
  [[nodiscard]] bool setting_up() const {
    const bool on_its_way = step_ == Step::operate && (control_ == cia402::control_switch_on ||
                                                       control_ == cia402::control_enable_operation);
    return attempts_ <= (progressed_ ? attempts_max : 1) &&
           (step_ == Step::setup || step_ == Step::start || on_its_way);
  }
  void acknowledge() {}  ///< nothing to reset: see emergency_stopped()
  [[nodiscard]] bool error() const { return emergency_ != 0 || faulty(); }  ///< EMCY received, or state fault
  /// Emergency error code, 0 for none.
  [[nodiscard]] std::uint32_t error_code() const { return emergency_; }
  /// True if the drive last reported operation enabled, in NMT operational and cyclic torque mode.
  [[nodiscard]] bool closed_loop() const {
    return nmt_ == canopen::NmtState::operational && state_ == cia402::State::operation_enabled &&
           mode_ == cia402::mode_cyclic_torque;
  }
  /// True once a value read back is not the required one; cleared by disable() or a tick without enable().
  [[nodiscard]] bool config_mismatch() const { return configurator_.config_mismatch(); }
  /// The last object with a wrong value or a refusal; empty: none since the set-up began.
  [[nodiscard]] std::optional<canopen::Object> contradicting_object() const {
    return configurator_.refused();
  }
  /// True if the drive reports in this tick that it has booted: an encoder may have lost its zero.
  [[nodiscard]] bool restarted() const { return booted_now_; }
  /// True if the drive has no object 6072, so that its torque limit was not read back; until the next set-up.
  [[nodiscard]] bool torque_limit_unread() const { return configurator_.limit_unread(); }
  [[nodiscard]] std::uint8_t node() const { return config_.node; }  ///< CAN node of the drive
  /// N m at the shaft per thousandth of the rated torque, as read from the drive; 0 before.
  [[nodiscard]] float torque_lsb() const { return configurator_.torque_lsb(); }

  /// Sends frames towards cyclic torque mode; call every tick while enabling.
  ///
  ///   NMT pre-operational, heartbeat on  ->  a heartbeat says pre-operational  ->  cia402::setup
  ///     ->  NMT start  ->  PDOs  ->  controlwords 06, 07, 0F, each after its statusword  ->  ready()
  ///
  /// Starts anew if the drive boots or falls back, and after `retry_ticks` or four requests without answer.
  template <class Send>
  void enable(Send&& send) {
    asking_ = true;
    disobeyed_ticks_ = 0;
    if (ready() || config_mismatch()) return;
    if (wait_ticks_ > 0) --wait_ticks_;
    if (step_ > Step::preoperational && (booted_ || (step_ > Step::setup && wait_ticks_ == 0)))
      return restart();
    if (step_ == Step::preoperational) return to_preoperational(send);
    if (step_ == Step::setup) return configure(send);
    if (step_ == Step::start) return start(send);
    operate();
  }

  void ask_again() { wait_ticks_ = 0; }  ///< the next enable() repeats its request or starts over

  /// Ends torque control: the controlword of put_torque() disables the voltage. A drive without our PDOs is
  /// stopped by NMT, to which its abort-connection option (6007) reacts; so is a drive that has not obeyed
  /// for retry_ticks, for our heartbeat goes on and would keep its torque alive.
  template <class Send>
  void disable(Send&& send) {
    restart();
    const bool listens = mapped_ && nmt_ == canopen::NmtState::operational;
    if (listens && ++disobeyed_ticks_ < settings_.retry_ticks) return;
    disobeyed_ticks_ = 0;
    send(canopen::encode_nmt(canopen::NmtCommand::stop, config_.node));
  }

  /// True if this joint torque (N m, model convention) may be sent; beyond the frame's range it is clamped.
  template <class S>
  [[nodiscard]] bool can_carry(S joint_torque) const {
    return drive::can_carry(shaft_torque(config_, joint_torque));
  }
  /// Writes controlword and joint torque (N m, model convention) into f, a classic data frame before; rounded
  /// to 1/1000 of the rated torque, clamped to the frame. 0 unless can_carry() and the rated torque is known.
  template <class S>
  void put_torque(hal::CanFrame& f, S joint_torque) const {
    const float rated = configurator_.rated_torque();
    const bool carried = can_carry(joint_torque) && rated > 0.0F;
    const float thousandths = carried ? shaft_torque(config_, joint_torque) / rated * 1000.0F : 0.0F;
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
      // Before we have mapped them, PDOs may hold anything.
      case canopen::id_tpdo1:
        return mapped_ ? take(cia402::decode_report(f)) : Received::not_mine;
      case canopen::id_tpdo2:
        return mapped_ ? take(cia402::decode_motion(f)) : Received::not_mine;
      default:
        return Received::not_mine;
    }
  }

  enum class Step : std::uint8_t {
    preoperational,  ///< until a heartbeat says so
    setup,           ///< object dictionary
    start,           ///< NMT start, until a PDO comes
    operate,         ///< state machine
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

  /// A frame that only a controller sends to this axis, or to all.
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
    step_ = Step::preoperational;
    wait_ticks_ = 0;
    preoperational_requested_ = false;
    configurator_.clear_mismatch();
  }

  /// A silent axis gets the request too, but it counts only once a heartbeat has come.
  template <class Send>
  void to_preoperational(Send&& send) {
    if (preoperational_requested_ && answered_) {
      step_ = Step::setup;
      if (attempts_ <= attempts_max) ++attempts_;
      configurator_.begin();
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

  template <class Send>
  void configure(Send&& send) {
    if (configurator_.in_flight() && wait_ticks_ > 0) return;
    if (configurator_.exhausted()) return restart();
    if (configurator_.request(send, settings_, config_.node)) wait_ticks_ = settings_.sdo_ticks;
  }
  void begin_start() {
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
    // The drive may have missed our heartbeat: the set-up gives it time to hear the next one.
    const bool fell_back = on_its_way && (state_ == cia402::State::switch_on_disabled || faulty());
    if (nmt_ != canopen::NmtState::operational || fell_back) return restart();
    const std::uint16_t before = control_;
    set_control(answer_to(state_));
    if (control_ != before) wait_ticks_ = settings_.retry_ticks;
    progressed_ = progressed_ || control_ == cia402::control_switch_on;
    if (control_ == cia402::control_enable_operation) release_pending_ = true;
    if (control_ == cia402::control_fault_reset) emergency_ = 0;
  }
  /// The next controlword for a state of the drive.
  [[nodiscard]] std::uint16_t answer_to(cia402::State state) const {
    using cia402::State;
    if (state == State::switch_on_disabled) return cia402::control_shutdown;
    if (state == State::ready_to_switch_on) return cia402::control_switch_on;
    if (state == State::switched_on) return cia402::control_enable_operation;
    // Enabled on our request, not by another node.
    if (state == State::operation_enabled)
      return control_ == cia402::control_enable_operation ? control_ : disabled;
    // The rising edge needs a frame without the bit before it.
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
      booted_now_ = true;
      booted_ = true;  // no torque until it is enabled anew; its heartbeat may be off again
      release_pending_ = false;
      mapped_ = false;  // its PDOs may come at once and hold anything
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
    if (!cia402::is_torque_free(state_)) quiet_ = 0;  // at once: the other PDO may be lost
    return take_pdo(has_report_);
  }
  Received take(const std::optional<cia402::Motion>& m) {
    if (!m) return Received::malformed;
    pending_velocity_ = m->velocity;
    mode_ = m->mode;
    return take_pdo(has_motion_);
  }
  /// Position and velocity are valid together, of the same SYNC. Only operational nodes send PDOs.
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
  /// Consecutive ticks, up to two.
  static void count(std::uint8_t& ticks, bool yes) {
    if (!yes) ticks = 0;
    if (yes && ticks < 2) ++ticks;
  }
  /// Once per tick, when both PDOs have come.
  void judge() {
    count(confirmations_, control_ == cia402::control_enable_operation && closed_loop() && !error());
    count(quiet_, cia402::is_torque_free(state_));
    if (idle()) release_pending_ = false;
  }

  Received take(const std::optional<canopen::Sdo>& reply) {
    if (!reply) return Received::malformed;
    alive_ = true;
    if (step_ == Step::setup && configurator_.take(*reply, settings_, config_.node)) begin_start();
    return Received::accepted;
  }

  static constexpr std::uint8_t attempts_max = 2;
  static constexpr std::uint16_t disabled = cia402::control_disable_voltage;

  AxisConfig config_{};
  Settings settings_{};
  Cia402Configurator configurator_{};
  std::int32_t position_ = 0, velocity_ = 0;
  std::int32_t pending_position_ = 0, pending_velocity_ = 0;
  std::uint32_t sample_age_ticks_ = age_max;
  std::uint32_t heartbeat_age_ticks_ = age_max;
  std::int16_t torque_ = 0;            // thousandths of the rated torque
  std::uint16_t wait_ticks_ = 0;       // for an answer, or for progress
  std::uint16_t disobeyed_ticks_ = 0;  // since the order to disable, or the last NMT stop
  std::uint16_t control_ = 0;
  std::uint16_t emergency_ = 0;
  Step step_ = Step::preoperational;
  canopen::NmtState nmt_ = canopen::NmtState::boot_up;
  cia402::State state_ = cia402::State::unknown;
  std::int8_t mode_ = 0;
  std::uint8_t attempts_ = 0;                     // set-ups since the order to enable
  std::uint8_t confirmations_ = 0;                // consecutive ticks that reported torque control, up to two
  std::uint8_t quiet_ = 0;                        // consecutive ticks that reported no torque, up to two
  bool progressed_ = false;                       // past switch on disabled, since the order to enable
  bool preoperational_requested_ = false;         // since its heartbeat was first heard
  bool answered_ = false;                         // a heartbeat said pre-operational since
  bool started_ = false;                          // the bus took NMT start
  bool mapped_ = false;                           // its PDOs are ours
  bool has_report_ = false, has_motion_ = false;  // PDOs since the last SYNC
  bool has_torque_ = false;                       // a report in this tick
  bool reported_ = false;                         // a heartbeat of this tick says not operational
  bool heard_ = false;                            // a heartbeat or boot-up
  bool booted_ = false;                           // since NMT pre-operational was sent
  bool booted_now_ = false;                       // in this tick
  bool alive_ = false;
  bool sampled_ = false;          // by the last frame
  bool asking_ = false;           // enable() was called in this tick
  bool release_pending_ = false;  // asked into torque control, not seen idle since
};

static_assert(Drive<Cia402Axis>);
static_assert(std::is_trivially_copyable_v<Cia402Axis> && sizeof(Cia402Axis) <= 160);

}  // namespace esmc::drive
