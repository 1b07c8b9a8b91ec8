#pragma once
/// The table of states of docs/safety.md, written out once more, and what the frames of a cycle mean to it.

#include <cstddef>

#include "firmware/safety/supervisor.hpp"

namespace esmc::fuzz {

/// What a protocol has to say. Kind of a frame that goes to a drive, and the torque in it.
struct Said {
  enum class Kind { torque, enabling, releasing, alive, asking, unknown } kind = Kind::unknown;
  std::size_t axis = 0;
  double shaft = 0;      ///< N m
  bool enables = false;  ///< with a word besides the torque that lets the drive give it
};

/// Which states there are torques in; and which state may follow which from one tick's end to the next.
inline bool has_torque(State s) {
  return s == State::testing || s == State::running || s == State::halting || s == State::holding ||
         s == State::lowering;
}
inline bool may_follow(State before, State after, bool enabled, bool reset) {
  if (before == after) return true;
  switch (after) {
    case State::disabled:
      return before == State::stopping || (before == State::fault && reset);
    case State::enabling:
      return before == State::disabled && enabled;
    case State::testing:
      return before == State::enabling;
    case State::running:
      return before == State::enabling || before == State::testing;
    case State::halting:
      return before == State::running || before == State::enabling || before == State::testing;
    case State::holding:
    case State::lowering:
      return before == State::halting;
    case State::stopping:
      return before != State::disabled && before != State::fault;
    case State::fault:
      return before != State::disabled || enabled;
  }
  return false;
}

}  // namespace esmc::fuzz
