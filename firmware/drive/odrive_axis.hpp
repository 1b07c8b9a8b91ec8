#pragma once
/// One ODrive axis seen from the controller.

#include <cstdint>
#include <optional>
#include <utility>

#include "firmware/drive/axis.hpp"
#include "firmware/drive/odrive.hpp"
#include "firmware/drive/odrive_read_back.hpp"

namespace esmc::drive {

/// One motor of an ODrive. Satisfies Drive, which explains members without a comment.
class OdriveAxis {
 public:
  using Version = odrive::Version;
  using Line = NoLine;

  OdriveAxis() = default;
  /// `retry_ticks`: time allowed for closed-loop control before the sequence restarts, > 0.
  /// `table`: configuration to be read back before the axis is armed; firmware 0.6 only.
  OdriveAxis(const AxisConfig& config, Version version, std::uint32_t retry_ticks,
             const OdriveTable& table = {})
      : config_(config),
        version_(version),
        retry_ticks_(retry_ticks),
        silence_ticks_(retry_ticks > 0 ? retry_ticks : age_max),
        read_back_(version == Version::v0_6 ? table : OdriveTable{}) {}
  /// Requires a test of the watchdog before the axis is first ready, and after a possible restart: without
  /// frames, at zero torque, it must expire within `ticks`, else config_mismatch(). 0 (default): no test.
  void prove_watchdog(std::uint32_t ticks) { watchdog_ticks_max_ = ticks; }
  /// Sets the silence, in ticks, after which the axis may have restarted: read-back and watchdog test are
  /// then repeated. Default and upper limit: `retry_ticks`.
  void restarts_within(std::uint32_t ticks) { silence_ticks_ = ticks < retry_ticks_ ? ticks : retry_ticks_; }

  /// Adds the identifiers of the node, and those of commands to all nodes.
  void add_filters(hal::IdFilters& list) const {
    list.add({std::uint32_t{config_.node} << 5U, 0x7E0, false});
    if (version_ == Version::v0_6) list.add({std::uint32_t{odrive::node_broadcast} << 5U, 0x7E0, false});
  }
  /// Takes a frame of the drive. Changes nothing unless the result is `accepted`. An emergency stop is
  /// accepted from any node, with any format.
  Received receive(const hal::CanFrame& f) {
    if (f.extended) return Received::not_mine;
    if ((f.id >> 5U) == config_.node) return to_this(f);
    return is_for_all(f) ? to_all(f) : Received::not_mine;
  }

  /// Counts the ages; once per tick, before its frames are received. An axis without a heartbeat for longer
  /// than restarts_within() loses ready(), and repeats read-back and watchdog test.
  void begin_tick() {
    counted_ = reported_ = stopped_now_ = false;
    if (torque_age_ticks_ < age_max) ++torque_age_ticks_;
    if (sample_age_ticks_ < age_max) ++sample_age_ticks_;
    if (heartbeat_age_ticks_ < age_max) ++heartbeat_age_ticks_;
    if (heartbeat_age_ticks_ == silence_ticks_ + 1) [[unlikely]]
      fall_silent();
  }

  [[nodiscard]] bool heard_this_tick() const { return reported_; }  ///< an encoder report was received
  [[nodiscard]] std::uint32_t sample_age_ticks() const { return sample_age_ticks_; }  ///< 0: this tick
  [[nodiscard]] bool brought_sample() const { return sampled_; }  ///< the last accepted frame was one
  [[nodiscard]] std::uint32_t heartbeat_age_ticks() const { return heartbeat_age_ticks_; }  ///< 0: this tick

  /// Joint angle (rad) and rate (rad/s) of the last sample, model convention; see sample_age_ticks().
  template <class S>
  [[nodiscard]] JointSample<S> sample() const {
    const S turn = S(6.283185307179586476925286766559L);
    const S per_rev = turn * S(config_.direction) / S(config_.gear_ratio);
    return {S(estimates_.position_rev) * per_rev + S(config_.offset), S(estimates_.velocity_rev_s) * per_rev};
  }

  /// Torque at the joint that the drive estimates from its current, N m, model convention; empty in a tick
  /// without that message, which firmware 0.6 can send cyclically.
  [[nodiscard]] std::optional<float> observed_torque() const {
    if (torque_age_ticks_ > 0) return std::nullopt;
    return torque_ * config_.direction * config_.gear_ratio;
  }
  /// Ticks since the last message for observed_torque(); 0: in this tick; age_max before the first.
  [[nodiscard]] std::uint32_t torque_age_ticks() const { return torque_age_ticks_; }

  /// True if heartbeats in two ticks since the last request reported closed-loop control without error (an
  /// axis without power reports it once and drops out again), and the encoder is connected.
  [[nodiscard]] bool ready() const { return confirmed() && !unconnected_; }
  /// True if the axis reports position and speed 0: firmware 0.5.6 does so after a boot until its first
  /// closed loop connects the encoder, so such a report is no sample. Any other report shows a connected
  /// encoder, until exactly 0 and 0 follow a position away from 0, as after a restart.
  [[nodiscard]] bool encoder_unconnected() const { return unconnected_; }
  /// True if the last heartbeat reports idle and came after the last disable(), without a request for
  /// closed-loop control since, and there is no config_mismatch().
  [[nodiscard]] bool idle() const {
    return answered_ && !asked_ && !config_mismatch() && last_.axis_state == odrive::AxisState::idle;
  }
  /// True from a request for closed-loop control until idle().
  [[nodiscard]] bool must_be_released() const { return release_pending_; }
  /// True once a heartbeat or an encoder report was received.
  [[nodiscard]] bool alive() const { return alive_; }
  /// True while the watchdog is tested: the caller must send nothing to the axis.
  [[nodiscard]] bool tx_suspended() const { return step_ == Step::test_watchdog; }
  /// True while the watchdog test or the read-back goes on; each ends by itself.
  [[nodiscard]] bool setting_up() const {
    return tx_suspended() || (step_ == Step::request && !read_back_.done());
  }
  /// True if an emergency stop was on the bus or reported by the axis, and not acknowledged since.
  [[nodiscard]] bool emergency_stopped() const { return stopped_; }
  /// Resets emergency_stopped() for the operator: its report may be cleared once. A newer report stops again,
  /// and so does an emergency stop on the bus in this tick, which the operator has not seen.
  void acknowledge() {
    stopped_ = stopped_now_;
    acknowledged_ = reports_emergency_stop();
  }
  /// True if the last heartbeat reports an error of the axis or, firmware 0.5.6, of a component.
  [[nodiscard]] bool error() const { return last_.axis_error != 0 || last_.component_flags != 0; }
  /// True if the last heartbeat reported closed-loop control, with or without an error.
  [[nodiscard]] bool closed_loop() const {
    return last_.axis_state == odrive::AxisState::closed_loop_control;
  }
  [[nodiscard]] std::uint32_t error_code() const { return last_.axis_error; }  ///< 0: none, or a component's
  /// True if a value read back is not the required one or was not answered, or the watchdog did not trip;
  /// cleared by disable(). Firmware 0.5.6 cannot be read back.
  [[nodiscard]] bool config_mismatch() const {
    return read_back_.config_mismatch() || watchdog_did_not_trip_;
  }
  /// The last endpoint with a wrong value or no answer; OdriveReadBack::version_endpoint: the version; empty:
  /// none.
  [[nodiscard]] std::optional<std::uint16_t> refused_endpoint() const { return read_back_.refused(); }
  [[nodiscard]] std::uint8_t node() const { return config_.node; }  ///< CAN node of the drive

  /// Tells the next enable() whether the errors of all axes are `known`, and reported in this tick or the
  /// last one (`fresh`). Only then it clears errors: firmware 0.5.6 clears both axes of a board, and an
  /// emergency stop of the other axis would be lost. Axes of two boards may never be fresh together: after 15
  /// reports `known` is enough. No effect with firmware 0.6.
  void know_errors(bool known, bool fresh) {
    known_ = known || version_ == Version::v0_6;
    fresh_ = fresh || version_ == Version::v0_6;
  }

  /// Call when an order to enable begins: the next enable() begins with the controller mode and reads back
  /// anew, for an earlier order may have been broken off between them, and the axis changed since.
  void begin_enabling() {
    if (step_ != Step::request && step_ != Step::configure) return;
    step_ = Step::configure;
    read_back_.restart();
  }
  /// Sends frames towards closed-loop torque control; call every tick while enabling. A frame that the bus
  /// does not take is sent again.
  ///
  ///   controller mode  ->  a newer heartbeat  ->  clear errors, unless it is an emergency stop
  ///     ->  a heartbeat without error, and all read back  ->  closed-loop control  ->  two heartbeats:
  ///     ready()
  ///
  /// With a watchdog to be tested the first confirmation is followed by silence until the axis reports that
  /// it expired, and then the sequence runs again. A heartbeat must come between mode and closed-loop
  /// control: identifiers are priorities, and the request could overtake the mode in a full transmit queue.
  /// Without progress the sequence restarts every `retry_ticks`.
  template <class Send>
  void enable(Send&& send) {
    if (step_ == Step::test_watchdog) return test_watchdog();
    if (confirmed() || config_mismatch()) return;
    if (clear_wait_ticks_ > 0) --clear_wait_ticks_;
    const bool due = wait_ticks_ == 0;
    if (!due) --wait_ticks_;
    if (step_ == Step::request) read_back_.ask(config_.node, send);
    if (step_ == Step::request && beat_since_mode_ && request(send)) return;
    if (due) repeat();
    if (step_ == Step::configure && (alive_ || due)) configure(send);
  }

  /// Makes the next enable() repeat the last request at once: the drive was not on the bus to receive it.
  void ask_again() {
    wait_ticks_ = 0;
    patient_ = false;
  }

  /// Requests idle; call every tick until idle(). Clears config_mismatch(): the next enable() reads back
  /// anew.
  template <class Send>
  void disable(Send&& send) {
    confirmations_ = 0;
    wait_ticks_ = 0;
    step_ = Step::configure;
    asked_ = false;
    answered_ = false;
    watchdog_did_not_trip_ = false;
    read_back_.restart();
    send(odrive::encode_set_axis_state(config_.node, odrive::AxisState::idle));
  }

  /// True if the shaft torque for this joint torque (N m, model convention) may be sent: finite, <= 1e4 N m.
  template <class S>
  [[nodiscard]] bool can_carry(S joint_torque) const {
    return drive::can_carry(shaft_torque(config_, joint_torque));
  }
  /// Writes a joint torque (N m, model convention) into f, a classic data frame before; 0 unless can_carry().
  template <class S>
  void put_torque(hal::CanFrame& f, S joint_torque) const {
    const float torque = shaft_torque(config_, joint_torque);
    odrive::put_torque(f, config_.node, drive::can_carry(torque) ? torque : 0.0F);
  }

  static constexpr std::uint32_t age_max = drive::age_max;

 private:
  // Not inlined: a frame of another axis costs a few comparisons and no call.
  [[gnu::noinline]] Received to_this(const hal::CanFrame& f) {
    const auto message = static_cast<odrive::Message>(f.id & 0x1FU);
    if (message == odrive::Message::encoder_estimates) return take(odrive::decode_encoder_estimates(f));
    Received r = Received::accepted;
    if (message == odrive::Message::heartbeat) {
      r = take(odrive::decode_heartbeat(f, version_));
    } else if (message == odrive::Message::estop) {
      stopped_ = stopped_now_ = true;
    } else {
      r = commands(f) ? Received::foreign_command : answered(f, message);
    }
    if (r == Received::accepted) sampled_ = false;
    return r;
  }
  [[gnu::noinline]] Received to_all(const hal::CanFrame& f) {
    if (static_cast<odrive::Message>(f.id & 0x1FU) != odrive::Message::estop) {
      return commands(f) ? Received::foreign_command : Received::not_mine;
    }
    stopped_ = stopped_now_ = true;
    sampled_ = false;
    return Received::accepted;
  }
  /// Answers of the axis to requests.
  Received answered(const hal::CanFrame& f, odrive::Message m) {
    switch (m) {
      case odrive::Message::get_version:
        return read_back_.take_version(f);
      case odrive::Message::tx_sdo:
        return read_back_.take_value(f);
      case odrive::Message::get_torques:
        // 0.5.6 has another message there; a remote frame is a request of another node.
        return version_ == Version::v0_6 && !f.remote ? take(odrive::decode_torques(f)) : Received::not_mine;
      default:
        return Received::not_mine;  // other cyclic messages a user may have switched on
    }
  }

  enum class Step : std::uint8_t {
    configure,      ///< send the controller mode
    request,        ///< sent; a newer heartbeat decides the next frame
    confirm,        ///< closed-loop control requested
    test_watchdog,  ///< confirmed; the watchdog must expire
  };

  [[nodiscard]] bool is_for_all(const hal::CanFrame& f) const {
    return version_ == Version::v0_6 && (f.id >> 5U) == odrive::node_broadcast;
  }
  /// A command of a controller. Firmware 0.5.6 obeys remote frames too, and every frame feeds its watchdog,
  /// so that polling by another node would keep our last torque alive. With 0.6 remote frames are requests,
  /// and the first byte of RxSdo tells a write.
  [[nodiscard]] bool commands(const hal::CanFrame& f) const {
    const std::uint32_t message = f.id & 0x1FU;
    if (version_ == Version::v0_5_6) return f.remote || f.size == 0 || odrive::is_command(message, version_);
    if (f.remote) return false;
    if (static_cast<odrive::Message>(message) == odrive::Message::rx_sdo) return f.size > 0 && f.data[0] != 0;
    return odrive::is_command(message, version_);
  }
  [[nodiscard]] bool confirmed() const { return confirmations_ >= 2; }
  [[nodiscard]] bool reports_emergency_stop() const {
    const std::uint32_t bit = version_ == Version::v0_6 ? odrive::error_estop_0_6 : odrive::error_estop_0_5_6;
    return (last_.axis_error & bit) != 0;
  }

  [[nodiscard]] bool reports_watchdog() const {
    const std::uint32_t bit =
        version_ == Version::v0_6 ? odrive::error_watchdog_0_6 : odrive::error_watchdog_0_5_6;
    return (last_.axis_error & bit) != 0;
  }
  /// One tick of silence. Passed if the watchdog disarms the axis; after any other error all is repeated.
  void test_watchdog() {
    if (!closed_loop() || error()) {
      proven_ = reports_watchdog() && !closed_loop();
      if (!proven_) invalidate_readback();
      step_ = Step::configure;
      return;
    }
    watchdog_did_not_trip_ = ++watchdog_ticks_ > watchdog_ticks_max_;
  }

  /// The axis may have restarted with its stored configuration: a watchdog that was not saved is off again.
  void invalidate_readback() {
    proven_ = false;
    disconnect();
    if (!read_back_.config_mismatch()) read_back_.restart();
  }
  void disconnect() { connected_ = away_ = false; }
  /// An axis under torque must not become ready again: the watchdog test would begin, and the axis keep its
  /// last torque meanwhile. A test that has begun is completed.
  [[gnu::cold]] void fall_silent() {
    invalidate_readback();
    if (step_ == Step::test_watchdog) return;
    confirmations_ = 0;
    step_ = Step::configure;
  }

  void wait() { wait_ticks_ = retry_ticks_ > 0 ? retry_ticks_ - 1 : 0; }

  /// A silent axis gets the mode too, but it counts only once the axis is alive.
  template <class Send>
  void configure(Send&& send) {
    const bool taken = send(odrive::encode_set_controller_mode(config_.node));
    if (taken || !alive_) wait();
    if (!taken || !alive_) return;
    step_ = Step::request;
    beat_since_mode_ = false;
  }
  /// After a heartbeat newer than the mode. True: closed-loop control was requested in this tick.
  template <class Send>
  bool request(Send&& send) {
    if (error()) {
      clear(send);
      return false;
    }
    if (stopped_ || !read_back_.done() ||
        !send(odrive::encode_set_axis_state(config_.node, odrive::AxisState::closed_loop_control))) {
      return false;
    }
    step_ = Step::confirm;
    asked_ = true;
    release_pending_ = true;
    patient_ = true;
    wait();
    return true;
  }
  /// Only in the tick of the report: an error that is not reported yet must not be cleared.
  template <class Send>
  void clear(Send&& send) {
    if (heartbeat_age_ticks_ > 0 || clear_wait_ticks_ > 0 || stopped_ || !known_) return;
    if (!fresh_ && postponed_ < postponed_max) {
      ++postponed_;
      return;
    }
    if (!send(odrive::encode_clear_errors(config_.node, version_))) return;
    clear_wait_ticks_ = retry_ticks_;
    postponed_ = 0;
    acknowledged_ = false;
  }
  /// Restarts the sequence, but leaves an axis that has confirmed once the time for its second heartbeat.
  void repeat() {
    if (confirmations_ > 0 && patient_) {
      patient_ = false;
      wait();
      return;
    }
    step_ = Step::configure;
  }

  Received take(const std::optional<odrive::Heartbeat>& h) {
    if (!h) return Received::malformed;
    last_ = *h;
    alive_ = true;
    beat_since_mode_ = true;
    answered_ = true;
    heartbeat_age_ticks_ = 0;
    if (!reports_emergency_stop()) {
      acknowledged_ = false;
    } else if (!acknowledged_) {
      stopped_ = true;
    }
    if (idle()) release_pending_ = false;
    if (confirmations_ > 0 && !closed_loop() && !reports_watchdog()) invalidate_readback();
    if (step_ != Step::confirm || !closed_loop() || error()) {
      confirmations_ = 0;
    } else if (confirmations_ < 2 && !counted_) {  // two heartbeats in a tick count as one
      ++confirmations_;
      counted_ = true;
    }
    connected_ = connected_ || confirmed();
    if (confirmed() && watchdog_ticks_max_ > 0 && !proven_) {
      step_ = Step::test_watchdog;
      watchdog_ticks_ = 0;
      confirmations_ = 0;
    }
    return Received::accepted;
  }
  Received take(const std::optional<odrive::EncoderEstimates>& e) {
    if (!e) return Received::malformed;
    alive_ = reported_ = true;
    sampled_ = version_ != Version::v0_5_6 || encoder_connected(*e);
    if (!sampled_) return Received::accepted;
    estimates_ = *e;
    sample_age_ticks_ = 0;
    return Received::accepted;
  }
  /// Of firmware 0.5.6, whether this report comes from a connected encoder.
  bool encoder_connected(const odrive::EncoderEstimates& e) {
    const bool zero = e.position_rev == 0.0F && e.velocity_rev_s == 0.0F;
    if (zero && away_) disconnect();
    connected_ = connected_ || !zero;
    unconnected_ = !connected_;
    if (connected_) away_ = e.position_rev > near_zero_rev || e.position_rev < -near_zero_rev;
    return connected_;
  }

  Received take(const std::optional<odrive::Torques>& t) {
    if (!t) return Received::malformed;
    torque_ = t->estimate;
    torque_age_ticks_ = 0;
    return Received::accepted;
  }

  static constexpr std::uint8_t postponed_max = 15;
  static constexpr float near_zero_rev = 1e-3F;

  AxisConfig config_{};
  Version version_ = Version::v0_6;
  odrive::Heartbeat last_{};
  odrive::EncoderEstimates estimates_{};
  std::uint32_t retry_ticks_ = 150, silence_ticks_ = 150;
  OdriveReadBack read_back_{};
  std::uint32_t wait_ticks_ = 0;        // until the sequence is repeated
  std::uint32_t clear_wait_ticks_ = 0;  // until errors may be cleared again
  std::uint32_t sample_age_ticks_ = age_max;
  std::uint32_t heartbeat_age_ticks_ = age_max;
  std::uint32_t watchdog_ticks_max_ = 0, watchdog_ticks_ = 0;
  float torque_ = 0.0F;  // N m at the shaft
  std::uint32_t torque_age_ticks_ = age_max;
  std::uint8_t confirmations_ = 0;
  Step step_ = Step::configure;
  bool alive_ = false;        // a heartbeat or a sample
  bool sampled_ = false;      // by the last frame
  bool reported_ = false;     // position and speed, in this tick
  bool connected_ = false;    // closed loop confirmed or an angle reported since the last possible restart
  bool away_ = false;         // the last sample was not near zero
  bool unconnected_ = false;  // the last report came from an unconnected encoder
  bool beat_since_mode_ = false;      // a heartbeat since the bus took the mode
  bool patient_ = false;              // the next repetition may wait for a second confirmation
  bool asked_ = false;                // the last request was for closed-loop control
  bool answered_ = false;             // a heartbeat since the last request
  bool release_pending_ = false;      // asked into closed loop, not seen idle since
  bool stopped_ = false;              // emergency stop, not acknowledged
  bool acknowledged_ = false;         // its report may be cleared
  bool known_ = true, fresh_ = true;  // see know_errors()
  std::uint8_t postponed_ = 0;        // reports that were not fresh
  bool proven_ = false;               // the watchdog has passed its test
  bool watchdog_did_not_trip_ = false;
  bool stopped_now_ = false;  // emergency stop on the bus in this tick
  bool counted_ = false;      // a heartbeat of this tick has been counted
};

static_assert(Drive<OdriveAxis>);

}  // namespace esmc::drive
