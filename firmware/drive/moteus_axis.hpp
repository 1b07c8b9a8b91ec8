#pragma once
/// One mjbots moteus seen from the controller.
///
/// Each command is answered by one reply, which is sample and heartbeat in one; without a command a drive is
/// silent. So the frame of every tick and state also requests the next sample. It stops the drive unless
/// torque control is wanted, and has torque only while ready(): enable() and disable() decide which frame
/// put_torque() writes. Only a drive that has never sent a frame gets one from enable().
///
/// A stop clears faults and the latched time-out. Before arming, version of the registers and, for an
/// absolute zero, the home state are read; while arming, what the drive has taken as largest torque and
/// watchdog. A reply may have been made before its command acted, so two in different ticks must agree.

#include <cstdint>
#include <optional>

#include "firmware/drive/axis.hpp"
#include "firmware/drive/moteus.hpp"

namespace esmc::drive {

/// One motor with a moteus. Satisfies Drive, which explains members without a comment.
class MoteusAxis {
 public:
  using Line = NoLine;

  /// Limits sent with every torque, and requirements of arming.
  struct Settings {
    float torque_max = 1.0F;  ///< N m at the drive's output, 0 to 327; the drive gets it in steps of 0.01 up
    float watchdog = 0.01F;   ///< s, 0 to 32; the drive gets it in whole ms up
    bool absolute = true;     ///< the position must be absolute before the drive is armed
    std::uint32_t retry_ticks = 150;  ///< time allowed for torque control before the sequence restarts, > 2
  };

  /// Value of error_code() after a time-out of the drive's watchdog.
  static constexpr std::uint32_t timed_out = moteus::mode_timeout;

  MoteusAxis() = default;
  MoteusAxis(const AxisConfig& config, const Settings& settings)
      : config_(config), retry_ticks_(settings.retry_ticks), absolute_(settings.absolute) {
    limits_ = {steps_up(settings.torque_max / moteus::i16_torque),
               steps_up(settings.watchdog / moteus::i16_time)};
  }

  /// Adds the identifiers of replies to us and of every frame to the drive.
  void add_filters(hal::IdFilters& list) const {
    const std::uint32_t node = config_.node;
    list.add({node, 0xFF, false});
    list.add({node, 0x1FFF'00FF, true});
    if (node < 8) {
      list.add({node << 8U, 0x7FF, false});
    } else {
      list.add({0, 0x1FFF'00FF, true});  // one for all drives: more would not fit
    }
    list.add({moteus::to_all, 0xFF, false});
    list.add({moteus::to_all, 0x1FFF'00FF, true});
  }
  /// Takes a reply of the drive. Changes nothing unless the result is `accepted`. Every frame of another node
  /// to the drive, or to all drives, is a `foreign_command`; a broken reply, or one that is not CAN FD, is
  /// `malformed`.
  Received receive(const hal::CanFrame& f) {
    const std::uint32_t from = f.id >> 8U, to = f.id & 0xFFU;
    if (f.id > 0xFFFF) return Received::not_mine;
    if (to == config_.node || to == moteus::to_all) return Received::foreign_command;
    if (from != config_.node || to != 0 || f.remote || f.extended != (f.id > 0x7FF))
      return Received::not_mine;
    const auto reply = moteus::decode_reply(f);
    if (!reply) return Received::malformed;
    take(*reply);
    return Received::accepted;
  }

  /// Counts the age of the last reply; once per tick, before the frames of the tick are received.
  void begin_tick() {
    counted_ = false;
    if (age_ticks_ < age_max) ++age_ticks_;
  }

  [[nodiscard]] bool heard_this_tick() const { return age_ticks_ == 0; }       ///< a reply came in this tick
  [[nodiscard]] std::uint32_t sample_age_ticks() const { return age_ticks_; }  ///< ticks since the last reply
  [[nodiscard]] bool brought_sample() const { return true; }                   ///< every reply is a sample
  [[nodiscard]] std::uint32_t heartbeat_age_ticks() const { return age_ticks_; }  ///< since the last reply

  /// Joint angle (rad) and rate (rad/s) of the last reply, even with an error, model convention; NaN where
  /// the drive does not know them.
  template <class S>
  [[nodiscard]] JointSample<S> sample() const {
    const S per_turn = S(6.283185307179586476925286766559L) * S(config_.direction) / S(config_.gear_ratio);
    return {S(last_.position) * per_turn + S(config_.offset), S(last_.velocity) * per_turn};
  }
  /// Torque of the last reply, N m at the joint, model convention.
  [[nodiscard]] std::optional<float> observed_torque() const {
    return last_.torque * config_.direction * config_.gear_ratio;
  }

  /// True if replies of two ticks since the last request reported torque control without error, the last one
  /// as well, and the limits that were sent.
  [[nodiscard]] bool ready() const { return wanted_ && replies_ >= replies_wanted; }
  /// True if replies of two ticks since the last request to stop reported the drive stopped, and there is no
  /// config_mismatch().
  [[nodiscard]] bool idle() const { return !wanted_ && !mismatch_ && replies_ >= replies_wanted; }
  [[nodiscard]] bool must_be_released() const {
    return release_pending_;
  }                                                              ///< torque requested, not idle() since
  [[nodiscard]] bool alive() const { return alive_; }            ///< a reply was received since the start
  [[nodiscard]] bool error() const { return error_code_ != 0; }  ///< a fault, or its watchdog has expired
  /// The drive's fault (32 and above), its mode where that is no fault code, or timed_out; 0: none.
  [[nodiscard]] std::uint32_t error_code() const { return error_code_; }
  /// The last error_code() that was not 0, which a stop does not clear.
  [[nodiscard]] std::uint32_t last_error() const { return last_error_; }
  /// True if the last reply reports position mode, which carries the torque.
  [[nodiscard]] bool closed_loop() const { return reports(moteus::mode_position); }
  /// True if a value read back is not the required one, or the drive refuses a register; cleared by
  /// disable().
  [[nodiscard]] bool config_mismatch() const { return mismatch_; }
  /// The last register with a wrong value or a refusal; moteus::no_register: none yet.
  [[nodiscard]] std::uint32_t refused_register() const { return refused_; }
  [[nodiscard]] std::uint8_t node() const { return config_.node; }  ///< CAN node of the drive
  [[nodiscard]] bool emergency_stopped() const { return false; }    ///< false: the protocol has none
  [[nodiscard]] bool tx_suspended() const { return false; }         ///< false: its watchdog is not tested
  [[nodiscard]] bool setting_up() const { return false; }           ///< false: there is no set-up
  void acknowledge() {}                                             ///< no effect: no emergency stop
  /// Makes the next enable() query a drive that has sent no frame yet; others get a request every tick.
  void ask_again() {
    if (!alive_) wait_ticks_ = 0;
  }

  /// Moves towards torque control; call every tick while enabling, before put_torque(0).
  ///
  ///   stopped in two ticks, without mismatch  ->  torque control and limits in two ticks: ready()
  ///
  /// Without progress the sequence restarts after retry_ticks, and where the drive is silent, which may
  /// restart; a drive never heard gets a query as often.
  template <class Send>
  void enable(Send&& send) {
    if (may_have_restarted(age_ticks_, retry_ticks_) && (wanted_ || replies_ > 0)) want(false);
    if (ready() || config_mismatch()) return;
    if (!alive_) return wake(send);
    if (wanted_) {
      if (wait_ticks_ > 0) --wait_ticks_;
      if (wait_ticks_ == 0) want(false);
      return;
    }
    if (replies_ < replies_wanted) return;
    if (last_.version != float{moteus::map_version_known}) {
      refuse(moteus::reg::map_version);
    } else if (absolute_ && !(last_.home > 0.0F)) {
      refuse(moteus::reg::home_state);
    } else {
      want(true);
      refused_ = moteus::no_register;
      release_pending_ = true;
      wait_ticks_ = retry_ticks_;
    }
  }
  /// Makes every following frame of put_torque() a stop; call every tick until idle(). Sends nothing itself.
  template <class Send>
  void disable(Send&&) {
    mismatch_ = false;
    if (wanted_) want(false);
  }

  /// True if the torque at the drive's output for this joint torque (N m, model convention) may be sent:
  /// finite, <= 1e4 N m.
  template <class S>
  [[nodiscard]] bool can_carry(S joint_torque) const {
    return drive::can_carry(shaft_torque(config_, joint_torque));
  }
  /// Writes the frame of a tick into f, any data frame before: the joint torque (N m, model convention) if
  /// ready(), 0 unless can_carry(); no torque before, and a stop unless torque control is wanted.
  template <class S>
  void put_torque(hal::CanFrame& f, S joint_torque) const {
    if (!wanted_) return moteus::put_query(f, config_.node, true);
    const float torque = can_carry(joint_torque) ? shaft_torque(config_, joint_torque) : 0.0F;
    moteus::put_torque(f, config_.node, torque, limits_, !ready());
  }

  static constexpr std::uint32_t age_max = drive::age_max;

 private:
  /// The first reply after a request may be older than it; the second one cannot.
  static constexpr std::uint8_t replies_wanted = 2;

  /// Whole steps that are at least v; 1 to the largest there are, which a NaN gets as well.
  [[nodiscard]] static constexpr std::int16_t steps_up(float v) {
    constexpr std::int16_t most = 0x7FFF;
    if (!(v < float{most})) return most;
    const auto whole = v > 1.0F ? static_cast<std::int16_t>(v) : std::int16_t{1};
    return static_cast<float>(whole) < v * 0.99999F ? static_cast<std::int16_t>(whole + 1) : whole;
  }

  [[nodiscard]] bool reports(std::uint8_t mode) const { return last_.mode == static_cast<float>(mode); }
  void want(bool torque) {
    wanted_ = torque;
    replies_ = 0;
  }

  template <class Send>
  void wake(Send&& send) {
    if (wait_ticks_ > 0) --wait_ticks_;
    if (wait_ticks_ > 0) return;
    hal::CanFrame f;
    moteus::put_query(f, config_.node, false);  // a second command in a tick would break lockstep
    if (send(f)) wait_ticks_ = retry_ticks_;
  }
  void refuse(std::uint32_t name) {
    refused_ = name;
    mismatch_ = true;
  }

  void take(const moteus::Reply& r) {
    last_ = r;
    alive_ = true;
    age_ticks_ = 0;
    error_code_ = 0;
    if (reports(moteus::mode_fault))
      error_code_ = static_cast<std::uint32_t>(r.fault > 0.0F ? r.fault : r.mode);
    if (reports(moteus::mode_timeout)) error_code_ = timed_out;
    if (error()) last_error_ = error_code_;
    if (wanted_ && r.refused != moteus::no_register) refuse(r.refused);
    if (!agrees()) {
      replies_ = 0;
    } else if (replies_ < replies_wanted && !counted_) {  // two replies in a tick count as one
      ++replies_;
      counted_ = true;
    }
    if (idle()) release_pending_ = false;
  }
  /// The last reply shows what is wanted. Limits are read back until ready().
  bool agrees() {
    if (!wanted_) return reports(moteus::mode_stopped);
    if (!closed_loop()) return false;
    if (ready()) return true;
    // The last reply may be to a frame that did not ask for them.
    if (!(last_.max_torque == last_.max_torque) || !(last_.time == last_.time)) return false;
    const auto near = [](float v, std::int16_t steps, float unit) {
      return __builtin_fabsf(v - static_cast<float>(steps) * unit) < 0.5F * unit;
    };
    if (!near(last_.max_torque, limits_.torque, moteus::i16_torque)) refuse(moteus::reg::max_torque);
    if (!near(last_.time, limits_.time, moteus::i16_time)) refuse(moteus::reg::watchdog_timeout);
    return !config_mismatch();
  }

  AxisConfig config_{};
  moteus::Reply last_{};
  moteus::Limits limits_{};
  std::uint32_t retry_ticks_ = 150;
  std::uint32_t wait_ticks_ = 0;  // until the sequence restarts
  std::uint32_t age_ticks_ = age_max;
  std::uint32_t error_code_ = 0, last_error_ = 0;
  std::uint32_t refused_ = moteus::no_register;
  std::uint8_t replies_ = 0;  // ticks with a reply that agrees, since the last request
  bool absolute_ = true;
  bool mismatch_ = false;
  bool wanted_ = false;  // torque control
  bool alive_ = false;
  bool release_pending_ = false;  // wanted, not seen stopped since
  bool counted_ = false;          // a reply of this tick has been counted
};

static_assert(Drive<MoteusAxis>);

}  // namespace esmc::drive
