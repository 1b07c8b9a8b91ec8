#pragma once
/// One drive in MIT mode seen from the controller.
///
/// Each command is answered by one reply, which is sample and heartbeat in one; without a command a drive is
/// silent. So the torque command of every tick and state also requests the next sample, and it is the zero
/// command on which enabling and disabling rely. enable() and disable() add special frames only: a second
/// command in a tick would break lockstep, which counts commands.
///
/// A reply shows neither the mode of the drive nor that it has obeyed (most firmware answers before it acts).
/// So idle() and closed_loop() mean: the bus took the frame, and the drive answered two later ticks. Damiao
/// reports its mode in the error field; once seen, it must agree. Ranges, zero and time-out cannot be read
/// back. Errors of a drive are not cleared here.

#include <cstdint>
#include <optional>

#include "firmware/drive/axis.hpp"
#include "firmware/drive/mit.hpp"

namespace esmc::drive {

/// One motor with a drive in MIT mode. Satisfies Drive, which explains members without a comment.
class MitAxis {
 public:
  using Dialect = mit::Dialect;
  using Line = NoLine;

  /// Settings of the drive.
  struct Settings {
    mit::Ranges ranges{};
    Dialect dialect = Dialect::mini_cheetah;
    std::uint16_t master_id = 0;  ///< identifier of the replies, possibly the node itself; not of cubemars_v3
    std::uint32_t retry_ticks = 150;  ///< time allowed for replies before the sequence restarts, > 2
    float velocity_unit = 0.0F;       ///< cubemars_v3: rad/s at the output for 10 electrical rpm
  };

  /// Bits of error_code() beside the drive's own error, which has the low eight.
  static constexpr std::uint32_t position_at_rail = 0x100;  ///< first or last code: shaft beyond the range
  static constexpr std::uint32_t velocity_at_rail = 0x200;  ///< first or last code: speed beyond the range
  /// The position moved by more than half of its span between two replies: firmware without a clamp has
  /// wrapped around, and later positions are wrong by the span. Latched until the controller restarts.
  static constexpr std::uint32_t position_lost = 0x400;

  MitAxis() = default;
  MitAxis(const AxisConfig& config, const Settings& settings) : config_(config), settings_(settings) {}

  /// Adds the identifiers of commands and replies. Of cubemars_v3: all up to 3FFFh that end with the node.
  void add_filters(hal::IdFilters& list) const {
    if (v3()) return list.add({config_.node, 0x1FFF'C0FF, true});
    list.add({config_.node, 0x7FF, false});
    list.add({settings_.master_id, 0x7FF, false});
  }
  /// Takes a reply of the drive. Changes nothing unless the result is `accepted`. A frame with the identifier
  /// of commands to the node that is no reply is a `foreign_command`; a broken reply with another identifier
  /// is `malformed`.
  Received receive(const hal::CanFrame& f) {
    if (f.extended != v3() || f.remote) return Received::not_mine;
    const bool commands =
        v3() ? (f.id & 0xFFU) == config_.node && f.id <= mit::v3_command_max : f.id == config_.node;
    if (is_from_drive(f)) {
      if (const auto reply = mit::decode_reply(f, settings_.dialect)) {
        take(*reply);
        return Received::accepted;
      }
      if (!commands) return Received::malformed;
    }
    return commands ? Received::foreign_command : Received::not_mine;
  }

  /// Counts the age of the last reply; once per tick, before the frames of the tick are received.
  void begin_tick() {
    counted_ = false;
    if (age_ticks_ < age_max) ++age_ticks_;
    if (torque_age_ticks_ < age_max) ++torque_age_ticks_;
  }

  [[nodiscard]] bool heard_this_tick() const { return age_ticks_ == 0; }       ///< a reply came in this tick
  [[nodiscard]] std::uint32_t sample_age_ticks() const { return age_ticks_; }  ///< ticks since the last reply
  [[nodiscard]] bool brought_sample() const { return true; }                   ///< every reply is a sample
  [[nodiscard]] std::uint32_t heartbeat_age_ticks() const { return age_ticks_; }  ///< since the last reply

  /// Joint angle (rad) and rate (rad/s) of the last reply, even with an error, model convention.
  template <class S>
  [[nodiscard]] JointSample<S> sample() const {
    const S per_rad = S(config_.direction) / S(config_.gear_ratio);
    const auto& r = settings_.ranges;
    if (v3()) {
      const auto number = [](std::uint16_t plus) {
        return S(std::int32_t{plus} - std::int32_t{mit::middle_16});
      };
      return {number(last_.position) * S(0.0017453292519943295769L) * per_rad + S(config_.offset),
              number(last_.velocity) * S(settings_.velocity_unit) * per_rad};
    }
    return {S(mit::value(last_.position, r.position, mit::code_max_16)) * per_rad + S(config_.offset),
            S(mit::value(last_.velocity, r.velocity, mit::code_max_12)) * per_rad};
  }

  /// Torque of the last reply, N m at the joint, model convention; empty if the reply has none
  /// (cubemars_v3) or has it cut (5 bytes).
  [[nodiscard]] std::optional<float> observed_torque() const {
    if (!last_.whole_torque) return std::nullopt;
    return mit::value(last_.torque, settings_.ranges.torque, mit::code_max_12) * config_.direction *
           config_.gear_ratio;
  }

  /// Ticks since the last torque for observed_torque(); age_max before the first.
  [[nodiscard]] std::uint32_t torque_age_ticks() const { return torque_age_ticks_; }

  /// True if the bus took the frame into motor mode, and replies without error came in two ticks since.
  [[nodiscard]] bool ready() const { return step_ == Step::entered && replies_ >= replies_wanted; }
  /// True if the bus took the frame that leaves motor mode, and replies came in two ticks since.
  [[nodiscard]] bool idle() const { return step_ == Step::left && replies_ >= replies_wanted; }
  [[nodiscard]] bool must_be_released() const {
    return release_pending_;
  }                                                                  ///< motor mode entered, not idle() since
  [[nodiscard]] bool alive() const { return alive_; }                ///< a reply has come since the start
  [[nodiscard]] bool error() const { return error_ != 0; }           ///< error_code() is not 0
  [[nodiscard]] std::uint32_t error_code() const { return error_; }  ///< 0: none; low byte: the drive's own
  /// True if the last order was to enter motor mode and the drive reports no other mode.
  [[nodiscard]] bool closed_loop() const { return step_ == Step::entered && !says(mode_off); }
  [[nodiscard]] bool emergency_stopped() const { return false; }  ///< false: the protocol has none
  [[nodiscard]] bool tx_suspended() const { return false; }       ///< false: its watchdog is not tested
  [[nodiscard]] bool setting_up() const { return false; }         ///< false: there is no set-up
  void acknowledge() {}                                           ///< no effect: no emergency stop
  [[nodiscard]] bool config_mismatch() const { return false; }    ///< false: nothing can be read back

  /// Sends frames towards motor mode; call every tick while enabling, before put_torque(0).
  ///
  ///   leave motor mode  ->  replies in two ticks  ->  enter motor mode, without an error  ->  replies in two
  ///   ticks: ready()
  ///
  /// The first two replies show that a zero command has arrived: a drive that enters motor mode acts on its
  /// last command. Without progress the sequence restarts every retry_ticks, and where the drive is silent,
  /// which may restart.
  template <class Send>
  void enable(Send&& send) {
    if (may_have_restarted(age_ticks_, settings_.retry_ticks) && (step_ == Step::entered || replies_ > 0)) {
      step_ = Step::unknown;
      replies_ = 0;
      wait_ticks_ = 0;
    }
    if (ready()) return;
    const bool due = wait_ticks_ == 0;
    if (!due) --wait_ticks_;
    if (step_ == Step::left && replies_ >= replies_wanted && !error()) {
      if (!order(send, mit::Special::enter)) return;
      step_ = Step::entered;
      replies_ = 0;
      release_pending_ = true;
      wait();
      return;
    }
    if (due) step_ = Step::unknown;
    if (step_ == Step::unknown && (alive_ || due)) leave(send);
  }

  void ask_again() { wait_ticks_ = 0; }  ///< the next enable() does not wait any longer

  /// Sends frames that end motor mode, from the second call on: a drive keeps its last command, so the zero
  /// command of the first tick must reach it before. Call every tick until idle().
  template <class Send>
  void disable(Send&& send) {
    wait_ticks_ = 0;
    if (step_ == Step::unknown || step_ == Step::entered) {
      step_ = Step::leaving;
      return;
    }
    const bool first = step_ == Step::leaving;
    const bool taken = order(send, mit::Special::leave);
    if (!first || !taken) return;
    step_ = Step::left;
    replies_ = 0;
  }

  /// True if the shaft torque for this joint torque (N m, model convention) may be sent: finite, <= 1e4 N m.
  template <class S>
  [[nodiscard]] bool can_carry(S joint_torque) const {
    return drive::can_carry(shaft_torque(config_, joint_torque));
  }
  /// Writes a joint torque (N m, model convention) with gains 0 into f, a classic data frame already: rounded
  /// to a step, clamped to the drive's range; zero (to half a step) unless can_carry().
  template <class S>
  void put_torque(hal::CanFrame& f, S joint_torque) const {
    const float torque = can_carry(joint_torque) ? shaft_torque(config_, joint_torque) : 0.0F;
    mit::put_command(f, config_.node,
                     {.torque = mit::code(torque, settings_.ranges.torque, mit::code_max_12)},
                     settings_.dialect);
  }

  static constexpr std::uint32_t age_max = drive::age_max;

 private:
  enum class Step : std::uint8_t {
    unknown,  ///< nothing requested yet, or a request without effect
    leaving,  ///< the next frame leaves motor mode
    left,     ///< the bus took it
    entered,  ///< the bus took the frame that enters motor mode
  };
  /// The first reply after a special frame may answer an older command; the second one cannot.
  static constexpr std::uint8_t replies_wanted = 2;
  static constexpr std::uint8_t mode_off = 0, mode_on = 1;  ///< Damiao's error field without an error

  /// The drive reports this mode; false if it reports none.
  [[nodiscard]] bool says(std::uint8_t mode) const { return reports_mode_ && last_.error == mode; }

  [[nodiscard]] bool v3() const { return settings_.dialect == Dialect::cubemars_v3; }
  [[nodiscard]] bool is_from_drive(const hal::CanFrame& f) const {
    if (v3()) return f.id == (mit::v3_reply | config_.node);
    return f.id == settings_.master_id && f.size > 0 &&
           mit::names(f.data[0], config_.node, settings_.dialect);
  }
  /// Of cubemars_v3, which has no motor mode, nothing: the zero command of every tick is all there is.
  template <class Send>
  bool order(Send&& send, mit::Special s) const {
    return v3() || send(mit::encode_special(config_.node, s));
  }

  void wait() { wait_ticks_ = settings_.retry_ticks > 0 ? settings_.retry_ticks - 1 : 0; }

  template <class Send>
  void leave(Send&& send) {
    const bool taken = order(send, mit::Special::leave);
    if (taken || !alive_) wait();
    if (!taken || !alive_) return;
    step_ = Step::left;
    replies_ = 0;
  }

  void take(const mit::Reply& r) {
    if (alive_ && span(r.position, last_.position) > mit::code_max_16 / 2U) lost_ = position_lost;
    last_ = r;
    alive_ = true;
    age_ticks_ = 0;
    if (r.whole_torque) torque_age_ticks_ = 0;
    if (settings_.dialect == Dialect::damiao && r.error == mode_on) reports_mode_ = true;
    error_ = lost_ | fault_of(r);
    if (step_ == Step::entered && (error() || !closed_loop())) {
      replies_ = 0;
    } else if (step_ == Step::left && says(mode_on)) {
      replies_ = 0;
    } else if (replies_ < replies_wanted && !counted_) {  // two replies in a tick count as one
      ++replies_;
      counted_ = true;
    }
    if (idle()) release_pending_ = false;
  }
  [[nodiscard]] static std::uint32_t span(std::uint16_t a, std::uint16_t b) {
    return a > b ? std::uint32_t{a} - b : std::uint32_t{b} - a;
  }
  [[nodiscard]] std::uint32_t fault_of(const mit::Reply& r) const {
    const bool mode = settings_.dialect == Dialect::damiao && r.error <= mode_on;
    std::uint32_t e = mode ? 0U : std::uint32_t{r.error};
    if (r.position == 0 || r.position == mit::code_max_16) e |= position_at_rail;
    if (r.velocity == 0 || r.velocity == (v3() ? mit::code_max_16 : mit::code_max_12)) e |= velocity_at_rail;
    return e;
  }

  AxisConfig config_{};
  Settings settings_{};
  mit::Reply last_{};
  std::uint32_t wait_ticks_ = 0;  // until the sequence is repeated
  std::uint32_t age_ticks_ = age_max, torque_age_ticks_ = age_max;
  std::uint32_t error_ = 0;
  std::uint32_t lost_ = 0;
  std::uint8_t replies_ = 0;  // ticks with a reply since the last special frame
  Step step_ = Step::unknown;
  bool alive_ = false;
  bool release_pending_ = false;  // asked into motor mode, not seen out of it since
  bool counted_ = false;          // a reply of this tick has been counted
  bool reports_mode_ = false;     // has reported motor mode
};

static_assert(Drive<MitAxis>);

}  // namespace esmc::drive
