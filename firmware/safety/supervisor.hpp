#pragma once
/// The supervisor: five states, and no torque in any but one.
///
///   disabled --enable--> enabling --every axis ready--> running --stop--> stopping --every axis idle--> disabled
///   enabling --stop--> stopping;  every state but disabled --fault--> fault --reset--> disabled
///
/// `begin_tick` makes the transitions, once per tick and before anything is computed, so that all of a tick
/// belongs to one state; only a fault strikes at once, in the tick that finds it.

#include <cstdint>

#include "firmware/safety/faults.hpp"

namespace esmc {

enum class State : std::uint8_t { disabled, enabling, running, stopping, fault };

[[nodiscard]] constexpr const char* name(State s) {
  switch (s) {
    case State::disabled: return "disabled";
    case State::enabling: return "enabling";
    case State::running: return "running";
    case State::stopping: return "stopping";
    case State::fault: return "fault";
  }
  return "unknown";
}

enum class Command : std::uint8_t { none, enable, stop, reset };

/// What the drives say at the start of a tick.
struct DriveStatus {
  bool all_ready = false;  ///< every axis confirmed closed-loop control
  bool all_idle = false;   ///< every axis reported idle
};

class Supervisor {
 public:
  [[nodiscard]] State state() const { return state_; }
  [[nodiscard]] Fault fault() const { return fault_; }
  [[nodiscard]] bool running() const { return state_ == State::running; }

  void begin_tick(Command command, DriveStatus drives) {
    switch (state_) {
      case State::disabled:
        if (command == Command::enable) state_ = State::enabling;
        break;
      case State::enabling:
        if (command == Command::stop) {
          state_ = State::stopping;
        } else if (drives.all_ready) {
          state_ = State::running;
        }
        break;
      case State::running:
        if (command == Command::stop) state_ = State::stopping;
        break;
      case State::stopping:
        if (drives.all_idle) state_ = State::disabled;
        break;
      case State::fault:
        if (command == Command::reset) {
          state_ = State::disabled;
          fault_ = Fault::none;
        }
        break;
    }
  }

  /// Latches the first fault of an episode; later ones do not replace its name. Nothing happens while disabled:
  /// there is no torque to take away, and what is wrong will be found again on enabling.
  void raise(Fault f) {
    if (f == Fault::none || state_ == State::disabled || state_ == State::fault) return;
    state_ = State::fault;
    fault_ = f;
  }

 private:
  State state_ = State::disabled;
  Fault fault_ = Fault::none;
};

}  // namespace esmc
