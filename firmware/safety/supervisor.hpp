#pragma once
/// The supervisor: the state of the controller, and the effect of each fault on it.
///
///   disabled --enable--> enabling --every axis ready--> running --stop--> stopping --all idle--> disabled
///       with a sign test: enabling --every axis ready--> testing --passed--> running
///   disabled --home--> enabling --every axis ready--> testing --on both end stops--> stopping
///       in testing a halt, or a fault with Reaction::halt, leads to halting --at rest--> off
///   running --halt, or a fault with Reaction::halt--> halting --at rest--> holding, lowering or off
///   every state but disabled --any other fault--> fault --reset--> disabled
///   enabling --time-out--> fault (enabling_timeout); stopping --time-out--> disabled
///
/// There is torque in testing, running, halting, holding and lowering only. `begin_tick` makes the
/// transitions, once per tick and before anything is computed, so that a tick belongs to one state; only a
/// fault acts at once, in the tick that finds it. docs/safety.md has the table of states and events.

#include <array>
#include <cstdint>

#include "firmware/safety/faults.hpp"

namespace esmc {

/// States. Torque is 0 in disabled, enabling, stopping and fault. Values: wire format, as those of Fault.
enum class State : std::uint8_t {
  disabled = 0,  ///< waits for an order
  enabling = 1,  ///< the drives are made ready for torque control
  testing = 2,   ///< each motor in turn gets a small torque: the sign test, or homing
  running = 3,
  halting = 4,   ///< the law brings the mechanism to rest where it is
  holding = 5,   ///< at rest, under the law, until the operator ends it
  lowering = 6,  ///< weight compensation fades, against damping
  stopping = 7,  ///< the drives are ordered to go idle
  fault = 8
};
inline constexpr int state_count = static_cast<int>(State::fault) + 1;
/// Names of the states, in the order of their values.
inline constexpr std::array<const char*, state_count> state_names{
    "disabled", "enabling", "testing", "running", "halting", "holding", "lowering", "stopping", "fault"};
static_assert(state_names.back() != nullptr);
[[nodiscard]] constexpr const char* name(State s) { return name_in(state_names, s); }

/// Commands of an operator.
enum class Command : std::uint8_t {
  none,
  enable,        ///< from disabled to enabling; no effect in any other state
  stop,          ///< zero torque, drives to idle
  halt,          ///< to rest under control first, where the configuration allows it
  confirm_zero,  ///< the mechanism stands in its zero pose; obeyed while disabled
  reset,         ///< from fault to disabled; ends holding too
  home           ///< from disabled to enabling, for homing; no effect in any other state
};

/// Behaviour after a mechanism has been brought to rest.
enum class AfterHalt : std::uint8_t {
  release,  ///< torque off: for mechanisms that gravity does not move, or with a brake
  hold,     ///< torque stays until the operator commands stop or reset
  lower,    ///< weight compensation fades against damping, then torque off
};

/// State of the drives at the start of a tick.
struct DriveStatus {
  bool all_ready = false;  ///< every axis confirmed closed-loop control
  bool all_idle = false;   ///< every axis reported idle
};

/// State machine of the controller, with the latched fault; see the top of the file. Starts in `disabled`.
class Supervisor {
 public:
  /// Options and time-outs.
  struct Config {
    bool can_halt = false;  ///< false: every fault, and every halt, takes the torque away at once
    AfterHalt after_halt = AfterHalt::release;
    bool sign_test = false;                   ///< between enabling and running
    std::uint32_t enabling_ticks_max = 5000;  ///< > 0; then the fault enabling_timeout
    std::uint32_t stopping_ticks_max = 1000;  ///< > 0; then disabled, even without idle confirmed
  };

  Supervisor() = default;
  explicit Supervisor(const Config& config) : config_(config) {}

  [[nodiscard]] State state() const { return state_; }  ///< after the last begin_tick() or raise()
  /// The first fault since power-up or reset; Fault::none where there was none.
  [[nodiscard]] Fault fault() const { return fault_; }
  [[nodiscard]] bool running() const { return state_ == State::running; }
  /// True while the mechanism comes to rest, or is at rest, under torque: halting, holding, lowering.
  [[nodiscard]] bool halting_or_held() const {
    return state_ == State::halting || state_ == State::holding || state_ == State::lowering;
  }
  /// True in the states in which there may be torque: testing, running, halting, holding, lowering.
  [[nodiscard]] bool powered() const { return running() || halting_or_held() || state_ == State::testing; }
  /// True from the order to home until `disabled` or `fault`: the zero, and so the pose, is not known.
  [[nodiscard]] bool homing() const { return homing_ && state_ != State::disabled && state_ != State::fault; }
  static constexpr std::uint16_t count_max = 0xFFFF;
  /// Occurrences of a fault since power-up, at most count_max; consecutive ticks count as one.
  [[nodiscard]] std::uint16_t count(Fault f) const { return counts_[static_cast<unsigned>(f)].times; }

  /// Makes the transitions of a tick. `stage_done`, from the controller: test passed (testing), at rest
  /// (halting), torque faded (lowering). `passed`: periods since the last tick, < 2^31.
  void begin_tick(Command command, DriveStatus drives, bool stage_done = false, std::uint32_t passed = 1) {
    ++tick_;
    switch (state_) {
      case State::disabled:
        if (command != Command::enable && command != Command::home) break;
        homing_ = command == Command::home;
        await(State::enabling);
        break;
      case State::enabling:
        if (command == Command::stop || command == Command::halt) {
          await(State::stopping);
        } else if (drives.all_ready && (passed <= 1 || waited_ticks_ + passed < config_.enabling_ticks_max)) {
          state_ = config_.sign_test || homing_ ? State::testing : State::running;
        } else if ((waited_ticks_ += passed) >= config_.enabling_ticks_max) {
          raise(Fault::enabling_timeout);
        }
        break;
      case State::testing:
        if (command == Command::halt && homing_ && config_.can_halt && !stage_done) {
          state_ = State::halting;
        } else if (command == Command::stop || command == Command::halt || (stage_done && homing_)) {
          await(State::stopping);
        } else if (stage_done) {
          state_ = State::running;
        }
        break;
      case State::running:
        if (command == Command::halt && config_.can_halt) {
          state_ = State::halting;
        } else if (command == Command::stop || command == Command::halt) {
          await(State::stopping);
        }
        break;
      case State::halting:
        if (command == Command::stop) {
          leave();
        } else if (stage_done) {
          rest();
        }
        break;
      case State::holding:
        if (command == Command::stop || command == Command::reset) leave();
        break;
      case State::lowering:
        if (command == Command::stop || stage_done) leave();
        break;
      case State::stopping:
        if (drives.all_idle || (waited_ticks_ += passed) >= config_.stopping_ticks_max)
          state_ = State::disabled;
        break;
      case State::fault:
        if (command == Command::reset) {
          state_ = State::disabled;
          fault_ = Fault::none;
        }
        break;
    }
  }

  // Always inline: the simulator compiles the controller for several instruction sets, and one copy must not
  // serve them all.
  /// Counts a fault, latches the first since power-up or reset, and enters fault, or halting where both the
  /// configuration and reaction(f) allow it. `none` has no effect, nor has any fault while disabled: there is
  /// no torque to take away, and enabling finds a persisting fault again.
  [[gnu::always_inline]] inline void raise(Fault f) {
    if (f == Fault::none || state_ == State::disabled) return;
    count(counts_[static_cast<unsigned>(f)]);
    const bool moves = running() || (homing_ && state_ == State::testing);
    const bool halt = config_.can_halt && (moves || halting_or_held()) && reaction(f) == Reaction::halt;
    if (fault_ == Fault::none) fault_ = f;
    if (!halt) {
      state_ = State::fault;
    } else if (moves) {
      state_ = State::halting;
    }
  }

 private:
  struct Count {
    std::uint32_t last_tick = 0;
    std::uint16_t times = 0;
  };
  void count(Count& c) const {
    const bool goes_on = c.times > 0 && tick_ - c.last_tick <= 1;
    if (!goes_on && c.times < count_max) ++c.times;
    c.last_tick = tick_;
  }
  void rest() {
    if (homing_) return leave();  // the law needs a pose to hold it or to let the weight down
    switch (config_.after_halt) {
      case AfterHalt::release:
        leave();
        break;
      case AfterHalt::hold:
        state_ = State::holding;
        break;
      case AfterHalt::lower:
        state_ = State::lowering;
        break;
    }
  }
  void leave() { await(fault_ == Fault::none ? State::stopping : State::fault); }
  void await(State s) {
    state_ = s;
    waited_ticks_ = 0;
  }

  Config config_{};
  State state_ = State::disabled;
  Fault fault_ = Fault::none;
  std::uint32_t tick_ = 0;  // since power-up, modulo 2^32
  std::uint32_t waited_ticks_ = 0;
  bool homing_ = false;  // the last order was to home
  std::array<Count, static_cast<unsigned>(fault_count)> counts_{};
};

}  // namespace esmc
