#pragma once
/// One ODrive axis seen from the controller: what it last said, how it is enabled, how a torque reaches it.

#include <cstdint>

#include "firmware/drive/odrive.hpp"

namespace esmc::drive {

/// How a motor sits in the mechanism. Angles and torques of the model on one side, of the shaft on the other.
struct AxisConfig {
  std::uint8_t node = 0;
  float direction = 1.0F;   ///< +1: the motor turns with the joint angle of the model, -1: against it
  float gear_ratio = 1.0F;  ///< motor turns per joint turn, > 0
  float offset = 0.0F;      ///< joint angle at encoder zero, rad
};

enum class Received : std::uint8_t { not_mine, accepted, malformed };

/// Joint side of an axis, as last heard.
template <class S>
struct JointSample {
  S angle{};  ///< rad, model convention
  S rate{};   ///< rad/s
};

class OdriveAxis {
 public:
  using Version = odrive::Version;
  static constexpr int frames_per_tick_max = 4;

  OdriveAxis() = default;
  /// `retry_ticks`: how long to wait for closed-loop control before asking again, > 0.
  OdriveAxis(const AxisConfig& config, Version version, std::uint32_t retry_ticks)
      : config_(config), version_(version), retry_ticks_(retry_ticks) {}

  /// Takes a frame from the bus. No side effect unless `accepted`.
  Received receive(const hal::CanFrame& f) {
    if (f.extended || (f.id >> 5U) != config_.node) return Received::not_mine;
    switch (static_cast<odrive::Message>(f.id & 0x1FU)) {
      case odrive::Message::heartbeat: return take(odrive::decode_heartbeat(f, version_));
      case odrive::Message::encoder_estimates: return take(odrive::decode_encoder_estimates(f));
      default: return Received::not_mine;  // other cyclic messages a user may have switched on
    }
  }

  /// Counts the ages; once per tick, before the frames of the tick are received.
  void begin_tick() {
    counted_ = false;
    if (sample_age_ticks_ < age_max) ++sample_age_ticks_;
    if (heartbeat_age_ticks_ < age_max) ++heartbeat_age_ticks_;
  }

  /// Ticks since the newest sample (0: arrived in this tick). age_max before the first one.
  [[nodiscard]] std::uint32_t sample_age_ticks() const { return sample_age_ticks_; }
  [[nodiscard]] std::uint32_t heartbeat_age_ticks() const { return heartbeat_age_ticks_; }

  template <class S>
  [[nodiscard]] JointSample<S> sample() const {
    const S turn = S(6.283185307179586476925286766559L);
    const S per_rev = turn * S(config_.direction) / S(config_.gear_ratio);
    return {S(estimates_.position_rev) * per_rev + S(config_.offset), S(estimates_.velocity_rev_s) * per_rev};
  }

  /// Closed-loop control reported without error in at least two heartbeats since the last request: an axis
  /// without power shows it once and drops out again.
  [[nodiscard]] bool ready() const { return confirmations_ >= 2; }
  /// Idle as far as is known: only what it said after the last request counts.
  [[nodiscard]] bool idle() const { return answered_ && !asked_ && last_.axis_state == odrive::AxisState::idle; }
  /// It was asked into closed loop once and has not been seen idle after being asked out of it.
  [[nodiscard]] bool must_be_released() const { return owed_; }
  /// Somebody pressed the emergency stop after we began to enable: not ours to clear.
  [[nodiscard]] bool emergency_stopped() const {
    const std::uint32_t bit = version_ == Version::v0_6 ? odrive::error_estop_0_6 : odrive::error_estop_0_5_6;
    return clean_ && (last_.axis_error & bit) != 0;
  }
  [[nodiscard]] bool error() const { return heard_ && (last_.axis_error != 0 || last_.component_flags != 0); }
  [[nodiscard]] bool closed_loop() const {
    return heard_ && last_.axis_state == odrive::AxisState::closed_loop_control;
  }
  [[nodiscard]] std::uint32_t error_code() const { return last_.axis_error; }

  /// Frames that bring the axis to closed-loop torque control; call every tick while enabling. The whole
  /// sequence is repeated every `retry_ticks` until the axis is ready.
  template <class Send>
  void enable(Send&& send) {
    if (ready()) return;
    if (wait_ticks_ > 0) {
      --wait_ticks_;
      return;
    }
    confirmations_ = 0;
    asked_ = true;
    answered_ = false;
    owed_ = true;
    send(odrive::encode_set_controller_mode(config_.node));
    send(odrive::encode_clear_errors(config_.node, version_));
    send(odrive::encode_set_axis_state(config_.node, odrive::AxisState::closed_loop_control));
    wait_ticks_ = retry_ticks_ > 0 ? retry_ticks_ - 1 : 0;
  }

  /// Nobody can have heard the last request: repeat it at the next enable().
  void ask_again() { wait_ticks_ = 0; }

  /// Frames that take the axis out of closed-loop control.
  template <class Send>
  void disable(Send&& send) {
    confirmations_ = 0;
    wait_ticks_ = 0;
    asked_ = false;
    answered_ = false;
    clean_ = false;
    send(odrive::encode_set_axis_state(config_.node, odrive::AxisState::idle));
  }

  /// Torque at the joint, N m, model convention. What the drive receives is rounded to float.
  template <class S>
  [[nodiscard]] hal::CanFrame torque_frame(S joint_torque) const {
    return odrive::encode_torque(config_.node,
                                 static_cast<float>(joint_torque) * config_.direction / config_.gear_ratio);
  }

  static constexpr std::uint32_t age_max = 0xFFFF'FFFF;

 private:
  Received take(const std::optional<odrive::Heartbeat>& h) {
    if (!h) return Received::malformed;
    last_ = *h;
    heard_ = true;
    answered_ = true;
    heartbeat_age_ticks_ = 0;
    clean_ = clean_ || (asked_ && !error());
    if (idle()) owed_ = false;
    if (!asked_ || !closed_loop() || error()) {
      confirmations_ = 0;
    } else if (confirmations_ < 2 && !counted_) {  // a heartbeat seen twice in a tick is one heartbeat
      ++confirmations_;
      counted_ = true;
    }
    return Received::accepted;
  }
  Received take(const std::optional<odrive::EncoderEstimates>& e) {
    if (!e) return Received::malformed;
    estimates_ = *e;
    sample_age_ticks_ = 0;
    return Received::accepted;
  }

  AxisConfig config_{};
  Version version_ = Version::v0_6;
  odrive::Heartbeat last_{};
  odrive::EncoderEstimates estimates_{};
  std::uint32_t retry_ticks_ = 150;
  std::uint32_t wait_ticks_ = 0;
  std::uint32_t sample_age_ticks_ = age_max;
  std::uint32_t heartbeat_age_ticks_ = age_max;
  std::uint8_t confirmations_ = 0;
  bool heard_ = false;
  bool asked_ = false;    // the last request was for closed-loop control
  bool answered_ = false; // heard since the last request
  bool owed_ = false;     // asked into closed loop, not seen idle since
  bool clean_ = false;    // heard without error since we began to enable
  bool counted_ = false;  // a heartbeat of this tick has been counted
};

}  // namespace esmc::drive
