#pragma once
/// The loop of an image: the same cycle as everywhere, over the board's bus, at the board's pace.

#include <concepts>
#include <cstdint>

#include "hal/can.hpp"
#include "hal/clock.hpp"
#include "hal/io.hpp"

namespace esmc {

/// What the loop needs of a board.
template <class B>
concept Board = requires(B& b) {
  requires hal::CanBus<std::remove_reference_t<decltype(b.bus())>>;
  requires hal::Watchdog<std::remove_reference_t<decltype(b.watchdog())>>;
  requires hal::DigitalInput<std::remove_reference_t<decltype(b.enable())>>;
  requires hal::DigitalOutput<std::remove_reference_t<decltype(b.drive_enable())>>;
  { b.now_us() } -> std::same_as<std::uint32_t>;  // wraps
};

/// Lockstep: a tick is a complete set of samples, as `esmc plant` sends them. Until a drive is heard it is asked to arm
/// every `knock_us`, as `esmc controller` does.
template <class Node, Board B>
class LockstepLoop {
 public:
  static constexpr std::uint32_t knock_us = 100'000;

  LockstepLoop(Node& node, B& board) : node_(node), board_(board) {}

  /// One turn; call for ever.
  void turn() {
    node_.enable_input(board_.enable().closed());
    node_.receive(board_.bus());
    if (node_.complete() || node_.overloaded()) {
      tick(true);
    } else if (!node_.heard() && (!knocked_ || board_.now_us() - knocked_at_us_ >= knock_us)) {
      knocked_ = true;
      knocked_at_us_ = board_.now_us();
      node_.ask_again();
      tick(false);
    }
  }

 private:
  void tick(bool answer) {
    node_.tick(board_.bus(), answer);
    node_.request(board_.bus());
    board_.drive_enable().set(node_.drive_enable());
    if (node_.good()) board_.watchdog().refresh();
  }

  Node& node_;
  B& board_;
  bool knocked_ = false;
  std::uint32_t knocked_at_us_ = 0;
};

}  // namespace esmc
