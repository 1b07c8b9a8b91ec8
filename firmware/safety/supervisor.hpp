#pragma once
/// The supervisor: which state the controller is in, and what each fault makes of it.
///
///   disabled --enable--> enabling --every axis ready--> running --stop--> stopping --every axis idle-->
///   disabled
///                        (with a sign test: enabling --every axis ready--> testing --passed--> running)
///   running --halt, or a fault that leaves a trustworthy state--> halting --at rest--> holding, lowering or
///   off every state but disabled --any other fault--> fault --reset--> disabled enabling --time-out--> fault
///   (enabling_timeout);  stopping --time-out--> disabled
///
/// There is torque in testing, running, halting, holding and lowering only. `begin_tick` makes the
/// transitions, once per tick and before anything is computed, so that all of a tick belongs to one state;
/// only a fault strikes at once, in the tick that finds it. docs/safety.md has the table of states, events
/// and reactions.

#include <array>
#include <cstdint>

#include "firmware/safety/faults.hpp"

namespace esmc {

/// States. Disabled, enabling, stopping and fault: torque 0.
enum class State : std::uint8_t {
  disabled,
  enabling,
  testing,  ///< each motor in turn gets a little torque and must answer as the model says
  running,
  halting,   ///< the law brings the mechanism to rest where it is
  holding,   ///< at rest, under the law, until the operator ends it
  lowering,  ///< weight let down against damping
  stopping,
  fault
};
inline constexpr int state_count = static_cast<int>(State::fault) + 1;

[[nodiscard]] constexpr const char* name(State s) {
  switch (s) {
    case State::disabled:
      return "disabled";
    case State::enabling:
      return "enabling";
    case State::testing:
      return "testing";
    case State::running:
      return "running";
    case State::halting:
      return "halting";
    case State::holding:
      return "holding";
    case State::lowering:
      return "lowering";
    case State::stopping:
      return "stopping";
    case State::fault:
      return "fault";
  }
  return "unknown";
}

/// What an operator asks for.
enum class Command : std::uint8_t {
  none,
  enable,
  stop,          ///< zero torque, drives to idle
  halt,          ///< to rest under control first, where the configuration allows it
  confirm_zero,  ///< the mechanism stands in its zero pose; heard while disabled
  reset
};

/// What becomes of a mechanism that has been brought to rest.
enum class AfterHalt : std::uint8_t {
  release,  ///< torque off: for mechanisms that gravity does not move, or with a brake
  hold,     ///< torque stays until the operator commands stop or reset
  lower,    ///< weight is let down against damping, then torque off
};

/// What the drives say at the start of a tick.
struct DriveStatus {
  bool all_ready = false;  ///< every axis confirmed closed-loop control
  bool all_idle = false;   ///< every axis reported idle
};

/// States, latched faults and reactions: whether there may be torque.
class Supervisor {
 public:
  /// What it may do instead of taking the torque away.
  struct Config {
    bool can_halt = false;  ///< false: every fault, and every halt, takes the torque away at once
    AfterHalt after_halt = AfterHalt::release;
    bool sign_test = false;                   ///< between enabling and running
    std::uint32_t enabling_ticks_max = 5000;  ///< > 0; then the fault enabling_timeout: an order to arm does
                                              ///< not outlive the operator's attention
    std::uint32_t stopping_ticks_max =
        1000;  ///< > 0; then disabled, whether or not the drives have confirmed idle
  };

  Supervisor() = default;
  explicit Supervisor(const Config& config) : config_(config) {}

  [[nodiscard]] State state() const { return state_; }
  /// The first fault of the episode.
  [[nodiscard]] Fault fault() const { return fault_; }
  [[nodiscard]] bool running() const { return state_ == State::running; }
  /// Coming to rest, or at rest, under torque.
  [[nodiscard]] bool retreating() const {
    return state_ == State::halting || state_ == State::holding || state_ == State::lowering;
  }
  /// Whether there may be torque at all.
  [[nodiscard]] bool powered() const { return running() || retreating() || state_ == State::testing; }
  /// Ticks since power-up, modulo 2^32; at which of them the latched fault was found; how often each fault
  /// has come since power-up, up to count_max. One that is found in tick after tick has come once.
  [[nodiscard]] std::uint32_t tick() const { return tick_; }
  [[nodiscard]] std::uint32_t fault_tick() const { return fault_tick_; }
  static constexpr std::uint16_t count_max = 0xFFFF;
  [[nodiscard]] std::uint16_t count(Fault f) const { return counts_[static_cast<unsigned>(f)].times; }

  /// `stage_done`: the controller's word that the motors answered (testing), that the mechanism is at rest
  /// (halting) or has been let down (lowering). `passed`: periods since the tick before, where that is not
  /// one (lockstep); < 2^31.
  void begin_tick(Command command, DriveStatus drives, bool stage_done = false, std::uint32_t passed = 1) {
    ++tick_;
    switch (state_) {
      case State::disabled:
        if (command == Command::enable) await(State::enabling);
        break;
      case State::enabling:
        if (command == Command::stop || command == Command::halt) {
          await(State::stopping);
        } else if (drives.all_ready && (passed <= 1 || waited_ticks_ + passed < config_.enabling_ticks_max)) {
          state_ = config_.sign_test ? State::testing : State::running;
        } else if ((waited_ticks_ += passed) >= config_.enabling_ticks_max) {
          raise(Fault::enabling_timeout);
        }
        break;
      case State::testing:
        if (command == Command::stop || command == Command::halt) {
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

  /// Latches the first fault of an episode; later ones are counted and do not replace its name. Nothing
  /// happens while disabled: there is no torque to take away, and what is wrong will be found again on
  /// enabling.
  void raise(Fault f) {
    if (f == Fault::none || state_ == State::disabled) return;
    count(counts_[static_cast<unsigned>(f)]);
    const bool halt = config_.can_halt && (running() || retreating()) && reaction(f) == Reaction::halt;
    if (fault_ == Fault::none) {
      fault_ = f;
      fault_tick_ = tick_;
    }
    if (!halt) {
      state_ = State::fault;
    } else if (running()) {
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
  std::uint32_t tick_ = 0, fault_tick_ = 0, waited_ticks_ = 0;
  std::array<Count, static_cast<unsigned>(fault_count)> counts_{};
};

}  // namespace esmc
