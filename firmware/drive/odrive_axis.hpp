#pragma once
/// One ODrive axis seen from the controller: what it last said, how it is enabled, how a torque reaches it.

#include <cstdint>
#include <optional>
#include <utility>

#include "firmware/drive/axis.hpp"
#include "firmware/drive/odrive.hpp"
#include "firmware/drive/odrive_read_back.hpp"

namespace esmc::drive {

/// One motor behind an ODrive, as the controller sees it. Satisfies Drive.
class OdriveAxis {
 public:
  using Version = odrive::Version;
  using Line = NoLine;

  OdriveAxis() = default;
  /// `retry_ticks`: how long to wait for closed-loop control before asking again, > 0.
  /// `table`: what must be read back before the axis is armed; firmware 0.6 only.
  OdriveAxis(const AxisConfig& config, Version version, std::uint32_t retry_ticks,
             const OdriveTable& table = {})
      : config_(config),
        version_(version),
        retry_ticks_(retry_ticks),
        silence_ticks_(retry_ticks > 0 ? retry_ticks : age_max),
        read_back_(version == Version::v0_6 ? table : OdriveTable{}) {}
  /// Before the axis is ready for the first time, and again once it may have restarted, its watchdog is
  /// starved at zero torque and must expire within so many ticks; 0: it is believed.
  void prove_watchdog(std::uint32_t ticks) { starve_ticks_ = ticks; }
  /// An axis without a heartbeat for more than so many ticks may have restarted: what it was found to be
  /// counts no more. `retry_ticks` where nothing is said, and never longer.
  void restarts_within(std::uint32_t ticks) { silence_ticks_ = ticks < retry_ticks_ ? ticks : retry_ticks_; }

  /// Takes a frame from the bus. No side effect unless `accepted`. An emergency stop that somebody sends to
  /// this axis, or to all, is taken whatever its length and format.
  Received receive(const hal::CanFrame& f) {
    if (f.extended) return Received::not_mine;
    if ((f.id >> 5U) == config_.node) return to_this(f);
    return is_for_all(f) ? to_all(f) : Received::not_mine;
  }

  /// Counts the ages; once per tick, before the frames of the tick are received.
  void begin_tick() {
    counted_ = reported_ = false;
    if (torque_age_ticks_ < age_max) ++torque_age_ticks_;
    if (sample_age_ticks_ < age_max) ++sample_age_ticks_;
    if (heartbeat_age_ticks_ < age_max) ++heartbeat_age_ticks_;
    if (heartbeat_age_ticks_ == silence_ticks_ + 1) [[unlikely]]
      fall_silent();
  }

  [[nodiscard]] bool heard_this_tick() const { return reported_; }
  [[nodiscard]] std::uint32_t sample_age_ticks() const { return sample_age_ticks_; }
  [[nodiscard]] bool brought_sample() const { return sampled_; }
  [[nodiscard]] std::uint32_t heartbeat_age_ticks() const { return heartbeat_age_ticks_; }

  template <class S>
  [[nodiscard]] JointSample<S> sample() const {
    const S turn = S(6.283185307179586476925286766559L);
    const S per_rev = turn * S(config_.direction) / S(config_.gear_ratio);
    return {S(estimates_.position_rev) * per_rev + S(config_.offset), S(estimates_.velocity_rev_s) * per_rev};
  }

  /// Torque at the joint as the drive estimates it of its current, N m, model convention; empty in a tick
  /// without such a report. Firmware 0.6, where its cyclic message is switched on.
  [[nodiscard]] std::optional<float> observed_torque() const {
    if (torque_age_ticks_ > 0) return std::nullopt;
    return torque_ * config_.direction * config_.gear_ratio;
  }
  /// Since that report, which is a message of its own and may fall silent alone; age_max before the first.
  [[nodiscard]] std::uint32_t torque_age_ticks() const { return torque_age_ticks_; }

  /// Closed-loop control reported without error in at least two heartbeats since the last request: an axis
  /// without power shows it once and drops out again.
  [[nodiscard]] bool ready() const { return confirmed() && !unconnected_; }
  /// The axis reports position and speed 0: firmware 0.5.6 does so after a boot, wherever the shaft is, until
  /// its first closed loop connects the encoder. Such a report is no sample. Any other report shows that the
  /// encoder is connected, until exactly 0 and 0 follow from a distance, as after a restart.
  [[nodiscard]] bool encoder_unconnected() const { return unconnected_; }
  /// Idle as far as is known: only what it said after the last request counts.
  [[nodiscard]] bool idle() const {
    return answered_ && !asked_ && !config_mismatch() && last_.axis_state == odrive::AxisState::idle;
  }
  /// It was asked into closed loop once and has not been seen idle after being asked out of it.
  [[nodiscard]] bool must_be_released() const { return release_pending_; }
  /// The axis itself has said something: an old setpoint or a frame of another controller is no life.
  [[nodiscard]] bool alive() const { return alive_; }
  /// Its watchdog is being starved: nothing may be sent to it.
  [[nodiscard]] bool tx_suspended() const { return step_ == Step::test_watchdog; }
  [[nodiscard]] bool setting_up() const {
    return tx_suspended() || (step_ == Step::request && !read_back_.done());
  }
  /// An emergency stop was seen on the bus or reported by the axis, and no operator has acknowledged it
  /// since.
  [[nodiscard]] bool emergency_stopped() const { return stopped_; }
  /// The operator's reset of an emergency stop: what the axis still reports of it may be cleared, once.
  /// Anything newer stops again.
  void acknowledge() {
    stopped_ = false;
    acknowledged_ = reports_emergency_stop();
  }
  [[nodiscard]] bool error() const { return last_.axis_error != 0 || last_.component_flags != 0; }
  [[nodiscard]] bool closed_loop() const {
    return last_.axis_state == odrive::AxisState::closed_loop_control;
  }
  [[nodiscard]] std::uint32_t error_code() const { return last_.axis_error; }
  /// What was read back is not what it must be, or was not answered; forgotten by disable(). CANSimple 0.5.6
  /// lets nothing be read back.
  [[nodiscard]] bool config_mismatch() const {
    return read_back_.config_mismatch() || watchdog_did_not_trip_;
  }
  /// Its watchdog did not expire when it was starved.
  [[nodiscard]] bool watchdog_is_off() const { return watchdog_did_not_trip_; }
  /// The endpoint that was config_mismatch last; OdriveReadBack::version_endpoint for the version.
  [[nodiscard]] std::optional<std::uint16_t> refused_endpoint() const { return read_back_.refused(); }
  [[nodiscard]] std::uint8_t node() const { return config_.node; }

  /// Frames that bring the axis to closed-loop torque control; call every tick while enabling. `send` says
  /// whether the bus took the frame; what it did not take is sent again.
  ///
  ///   controller mode  ->  a heartbeat that is newer  ->  clear errors, if it reports some (and no emergency
  ///   stop)
  ///                    ->  a heartbeat without error, and all read back  ->  closed-loop control
  ///                    ->  two heartbeats: ready(); the first time, if a watchdog is to be proven, nothing
  ///                    is sent
  ///                        from here until the axis reports that it expired, and then all of it again
  ///
  /// Identifiers are priorities: a full transmit queue would let the request for closed loop overtake the
  /// mode, and the axis would arm in the mode it has stored. So there is a heartbeat between the two. What
  /// leads to nothing is repeated from the start every `retry_ticks`.
  template <class Send>
  void enable(Send&& send) {
    if (step_ == Step::test_watchdog) return test_watchdog();
    if (confirmed() || config_mismatch()) return;
    if (clear_wait_ticks_ > 0) --clear_wait_ticks_;
    const bool due = wait_ticks_ == 0;
    if (!due) --wait_ticks_;
    if (step_ == Step::request) read_back_.ask(config_.node, send);
    if (step_ == Step::request && bus_events_ && request(send)) return;
    if (due) repeat();
    if (step_ == Step::configure && (alive_ || due)) configure(send);
  }

  /// Nobody can have heard the last request: repeat it at the next enable().
  void ask_again() {
    wait_ticks_ = 0;
    patient_ = false;
  }

  /// Frames that take the axis out of closed-loop control.
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

  static constexpr float shaft_torque_max = drive::shaft_torque_max;
  /// Whether what this joint torque (N m, model convention) becomes at the shaft may go on the bus.
  template <class S>
  [[nodiscard]] bool can_carry(S joint_torque) const {
    return drive::can_carry(shaft_torque(config_, joint_torque));
  }
  /// Torque at the joint, N m, model convention. What the drive receives is rounded to float; zero for a
  /// torque that cannot be carried.
  template <class S>
  void put_torque(hal::CanFrame& f, S joint_torque) const {
    const float torque = shaft_torque(config_, joint_torque);
    odrive::put_torque(f, config_.node, drive::can_carry(torque) ? torque : 0.0F);
  }

  static constexpr std::uint32_t age_max = drive::age_max;

 private:
  // Not inlined, so that a frame of another axis costs a few comparisons and no call.
  [[gnu::noinline]] Received to_this(const hal::CanFrame& f) {
    const auto message = static_cast<odrive::Message>(f.id & 0x1FU);
    if (message == odrive::Message::encoder_estimates) return take(odrive::decode_encoder_estimates(f));
    Received r = Received::accepted;
    if (message == odrive::Message::heartbeat) {
      r = take(odrive::decode_heartbeat(f, version_));
    } else if (message == odrive::Message::estop) {
      stopped_ = true;
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
    stopped_ = true;
    sampled_ = false;
    return Received::accepted;
  }
  /// What the axis says when it is asked.
  Received answered(const hal::CanFrame& f, odrive::Message m) {
    switch (m) {
      case odrive::Message::get_version:
        return read_back_.take_version(f);
      case odrive::Message::tx_sdo:
        return read_back_.take_value(f);
      case odrive::Message::get_torques:
        // 0.5.6 has another message there, and a request of somebody else is none.
        return version_ == Version::v0_6 && !f.remote ? take(odrive::decode_torques(f)) : Received::not_mine;
      default:
        return Received::not_mine;  // other cyclic messages a user may have switched on
    }
  }

  enum class Step : std::uint8_t {
    configure,      ///< the controller mode has to be sent
    request,        ///< the bus has taken it: a newer heartbeat decides what comes next
    confirm,        ///< closed-loop control has been asked for
    test_watchdog,  ///< confirmed; the watchdog has to expire
  };

  [[nodiscard]] bool is_for_all(const hal::CanFrame& f) const {
    return version_ == Version::v0_6 && (f.id >> 5U) == odrive::node_broadcast;
  }
  /// What only we may send. 0.5.6 does not look at RTR before it obeys, and any frame to it feeds its
  /// watchdog: one that polls it would keep our last torque alive. With 0.6 a remote frame asks for nothing
  /// here, and a write to an endpoint is told by its first byte.
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
  /// One tick of silence. Any other end than the watchdog's, which disarms, is none: the sequence begins
  /// anew, watchdog included.
  void test_watchdog() {
    if (!closed_loop() || error()) {
      proven_ = reports_watchdog() && !closed_loop();
      if (!proven_) invalidate_readback();
      step_ = Step::configure;
      return;
    }
    watchdog_did_not_trip_ = ++starved_ticks_ > starve_ticks_;
  }

  /// It may have restarted, and with what it has stored: a watchdog that was switched on and not saved is off
  /// again.
  void invalidate_readback() {
    proven_ = false;
    disconnect();
    if (!read_back_.config_mismatch()) read_back_.restart();
  }
  void disconnect() { connected_ = away_ = false; }
  /// One that runs must not be found ready once more: it would be starved where nobody waits for the end of
  /// that, and keep its last torque. One that is starved already is starved to the end.
  [[gnu::cold]] void fall_silent() {
    invalidate_readback();
    if (step_ == Step::test_watchdog) return;
    confirmations_ = 0;
    step_ = Step::configure;
  }

  void wait() { wait_ticks_ = retry_ticks_ > 0 ? retry_ticks_ - 1 : 0; }

  /// Sent to a silent axis as well, for it to be heard on the bus; but it counts only once the axis lives.
  template <class Send>
  void configure(Send&& send) {
    const bool taken = send(odrive::encode_set_controller_mode(config_.node));
    if (taken || !alive_) wait();
    if (!taken || !alive_) return;
    step_ = Step::request;
    bus_events_ = false;
  }
  /// With a heartbeat that is newer than the mode. Whether closed-loop control was asked for in this tick.
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
  /// Only in the tick of the report, so that nothing can have been added to it that we do not know of.
  template <class Send>
  void clear(Send&& send) {
    if (heartbeat_age_ticks_ > 0 || clear_wait_ticks_ > 0 || stopped_) return;
    if (!send(odrive::encode_clear_errors(config_.node, version_))) return;
    clear_wait_ticks_ = retry_ticks_;
    acknowledged_ = false;
  }
  /// From the start, but an axis that has confirmed once gets the time for its second heartbeat.
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
    bus_events_ = true;
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
    } else if (confirmations_ < 2 && !counted_) {  // a heartbeat seen twice in a tick is one heartbeat
      ++confirmations_;
      counted_ = true;
    }
    connected_ = connected_ || confirmed();
    if (confirmed() && starve_ticks_ > 0 && !proven_) {
      step_ = Step::test_watchdog;
      starved_ticks_ = 0;
      confirmations_ = 0;
    }
    return Received::accepted;
  }
  Received take(const std::optional<odrive::EncoderEstimates>& e) {
    if (!e) return Received::malformed;
    alive_ = reported_ = true;
    const bool zero = e->position_rev == 0.0F && e->velocity_rev_s == 0.0F;
    if (zero && away_) disconnect();
    connected_ = connected_ || !zero;
    unconnected_ = version_ == Version::v0_5_6 && !connected_;
    sampled_ = !unconnected_;
    if (unconnected_) return Received::accepted;
    estimates_ = *e;
    away_ = e->position_rev > near_zero_rev || e->position_rev < -near_zero_rev;
    sample_age_ticks_ = 0;
    return Received::accepted;
  }

  Received take(const std::optional<odrive::Torques>& t) {
    if (!t) return Received::malformed;
    torque_ = t->estimate;
    torque_age_ticks_ = 0;
    return Received::accepted;
  }

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
  std::uint32_t starve_ticks_ = 0, starved_ticks_ = 0;
  float torque_ = 0.0F;  // N m at the shaft
  std::uint32_t torque_age_ticks_ = age_max;
  std::uint8_t confirmations_ = 0;
  Step step_ = Step::configure;
  bool alive_ = false;     // a heartbeat or a sample
  bool sampled_ = false;   // by the last frame
  bool reported_ = false;  // position and speed, in this tick
  bool connected_ =
      false;  // closed loop was confirmed, or an angle reported, since the axis may have restarted last
  bool away_ = false;                   // the last sample was not near zero
  bool unconnected_ = false;            // the last report was the zero of an encoder that is not connected
  bool bus_events_ = false;             // a heartbeat since the bus took the mode
  bool patient_ = false;                // the next repetition may wait for a second confirmation
  bool asked_ = false;                  // the last request was for closed-loop control
  bool answered_ = false;               // heard since the last request
  bool release_pending_ = false;        // asked into closed loop, not seen idle since
  bool stopped_ = false;                // emergency stop, not acknowledged
  bool acknowledged_ = false;           // what the axis reports of it may be cleared
  bool proven_ = false;                 // the watchdog has expired once
  bool watchdog_did_not_trip_ = false;  // starved for too long
  bool counted_ = false;                // a heartbeat of this tick has been counted
};

static_assert(Drive<OdriveAxis>);

}  // namespace esmc::drive
