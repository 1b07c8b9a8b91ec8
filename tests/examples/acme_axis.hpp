#pragma once
/// A protocol that the library does not have. docs/extending.md explains it. The drives are invented:
///
///   to the drive    100 + node  u8 mode (0 idle, 1 torque), f32 torque in N m at the shaft
///   from the drive  180 + node  f32 angle in rad and i16 rate in 0.01 rad/s at the shaft, u8 mode, u8 error;
///   after every command

#include <bit>

#include "firmware/drive/axis.hpp"

namespace acme {

using esmc::drive::Received;
using esmc::hal::CanFrame;

class AcmeAxis {
 public:
  using Line = esmc::drive::NoLine;  // nothing is sent once per bus

  AcmeAxis() = default;
  explicit AcmeAxis(const esmc::drive::AxisConfig& config) : config_(config) {}

  // For the filters of a CAN controller: all that receive() judges.
  void add_filters(esmc::hal::IdFilters& list) const {
    for (const std::uint32_t function : {0x100U, 0x180U}) list.add({function + config_.node, 0x7FF});
  }

  // What it said, and how long ago.
  void begin_tick() {
    if (age_ < esmc::drive::age_max) ++age_;
  }
  Received receive(const CanFrame& f) {
    if (f.extended || f.remote) return Received::not_mine;
    if (f.id == 0x100U + config_.node) return Received::foreign_command;
    if (f.id != 0x180U + config_.node) return Received::not_mine;
    if (f.size != 8 || f.data[6] > 1) return Received::malformed;
    angle_ = std::bit_cast<float>(word(f));
    rate_ = 0.01F * static_cast<float>(static_cast<std::int16_t>(f.data[4] | f.data[5] << 8));
    error_ = f.data[7];
    age_ = 0;
    const bool obeys = (f.data[6] == 1) == asked_;
    confirmed_ = static_cast<std::uint8_t>(obeys ? (confirmed_ < 2 ? confirmed_ + 1 : 2) : 0);
    return Received::accepted;
  }
  [[nodiscard]] bool heard_this_tick() const { return age_ == 0; }
  [[nodiscard]] std::uint32_t sample_age_ticks() const { return age_; }
  [[nodiscard]] std::uint32_t heartbeat_age_ticks() const { return age_; }  // a reply is both
  [[nodiscard]] bool brought_sample() const { return true; }
  [[nodiscard]] bool alive() const { return age_ != esmc::drive::age_max; }
  template <class S>
  [[nodiscard]] esmc::drive::JointSample<S> sample() const {
    const S per_rad = S(config_.direction) / S(config_.gear_ratio);
    return {S(angle_) * per_rad + S(config_.offset), S(rate_) * per_rad};
  }

  // Its state. A reply may answer an older command; the second one that agrees does not.
  [[nodiscard]] bool ready() const { return asked_ && confirmed_ == 2 && !error(); }
  [[nodiscard]] bool idle() const { return !asked_ && confirmed_ == 2; }
  [[nodiscard]] bool closed_loop() const { return asked_ && confirmed_ > 0; }
  [[nodiscard]] bool must_be_released() const { return asked_ || confirmed_ < 2; }
  [[nodiscard]] bool error() const { return error_ != 0; }
  [[nodiscard]] std::uint32_t error_code() const { return error_; }
  [[nodiscard]] bool emergency_stopped() const { return false; }  // these drives have none,
  [[nodiscard]] bool config_mismatch() const { return false; }    // nothing of them can be read back,
  [[nodiscard]] bool tx_suspended() const { return false; }       // and no watchdog is tried before arming
  [[nodiscard]] bool setting_up() const { return false; }         // nor anything set up
  void acknowledge() {}
  void ask_again() {}

  // What it is asked. The mode travels with the torque command, so enabling needs no frame of its own.
  template <class Send>
  void enable(Send&&) {
    ask(true);
  }
  template <class Send>
  void disable(Send&&) {
    ask(false);
  }
  template <class S>
  [[nodiscard]] bool can_carry(S joint_torque) const {
    return esmc::drive::can_carry(esmc::drive::shaft_torque(config_, joint_torque));
  }
  template <class S>
  void put_torque(CanFrame& f, S joint_torque) const {
    const float torque = can_carry(joint_torque) ? esmc::drive::shaft_torque(config_, joint_torque) : 0.0F;
    const auto bits = std::bit_cast<std::uint32_t>(torque);
    f.id = 0x100U + config_.node;
    f.size = 5;
    f.data[0] = asked_ ? 1 : 0;
    for (unsigned i = 0; i < 4; ++i) f.data[1 + i] = static_cast<std::uint8_t>(bits >> 8 * i);
  }

 private:
  static std::uint32_t word(const CanFrame& f) {
    return f.data[0] | static_cast<std::uint32_t>(f.data[1]) << 8 |
           static_cast<std::uint32_t>(f.data[2]) << 16 | static_cast<std::uint32_t>(f.data[3]) << 24;
  }
  void ask(bool torque) {
    if (asked_ != torque) confirmed_ = 0;
    asked_ = torque;
  }

  esmc::drive::AxisConfig config_{};
  float angle_ = 0.0F, rate_ = 0.0F;
  std::uint32_t age_ = esmc::drive::age_max;
  std::uint8_t error_ = 0, confirmed_ = 0;
  bool asked_ = false;
};
static_assert(esmc::drive::Drive<AcmeAxis>);

}  // namespace acme
