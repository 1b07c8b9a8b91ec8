#pragma once
/// The loop of an image: the same cycle as everywhere, over the board's bus, at the board's pace.

#include <concepts>
#include <cstdint>

#include "firmware/safety/supervisor.hpp"
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

/// Outputs follow the node's state, and the watchdog is refreshed after a good tick only.
template <class Node, Board B>
void finish_tick(Node& node, B& board) {
  board.drive_enable().set(node.drive_enable());
  if constexpr (requires { board.brake(); }) board.brake().set(node.release_brake());
  if (node.output_ok()) board.watchdog().refresh();
}

/// Lockstep: a tick is a complete set of samples, as `esmc plant` sends them. Until a drive is heard it is
/// asked to arm every `knock_us`, as `esmc controller` does. To wait for a set is no hang: the watchdog is
/// refreshed then as well. Without a set the states without torque go on ticking every `knock_us`, so that
/// orders are taken and stopping ends; but enabling waits for sets, as virtual time does, and is the fault
/// enabling_timeout after `enabling_us`.
template <class Node, Board B>
class LockstepLoop {
 public:
  static constexpr std::uint32_t knock_us = 100'000, enabling_us = 5'000'000;

  LockstepLoop(Node& node, B& board) : node_(node), board_(board) {}

  /// One turn; call for ever.
  void turn() {
    node_.enable_input(board_.enable().closed());
    node_.receive(board_.bus());
    const std::uint32_t quiet_us = board_.now_us() - ticked_at_us_;
    const bool enabling = node_.supervisor().state() == State::enabling;
    if (node_.complete() || node_.overloaded()) {
      tick(true, 0);
    } else if (enabling && board_.now_us() - set_at_us_ >= enabling_us) {
      tick(false, enabling_us);
    } else if (!ticked_ || (quiet_us >= (node_.set_begun() ? 10U * knock_us : knock_us) &&
                            !node_.supervisor().powered() && (!enabling || !node_.heard()))) {
      if (!node_.heard()) node_.ask_again();
      tick(false, enabling || !ticked_ ? 0 : quiet_us);
    } else if (node_.output_ok()) {
      board_.watchdog().refresh();
    }
  }

 private:
  /// `passed_us`: of time that no set shows.
  void tick(bool answer, std::uint32_t passed_us) {
    const bool enabling = node_.supervisor().state() == State::enabling;
    if (!answer) node_.time_passed(passed_us);
    node_.tick(board_.bus(), answer);
    ticked_ = true;
    ticked_at_us_ = board_.now_us();
    if (answer || !enabling) set_at_us_ = ticked_at_us_;
    if (answer || !node_.heard())
      node_.request(board_.bus());  // a plant that is only slow has been asked already
    finish_tick(node_, board_);
  }

  Node& node_;
  B& board_;
  bool ticked_ = false;
  std::uint32_t ticked_at_us_ = 0, set_at_us_ = 0;  ///< set_at_us_: of the last set, or of the order to arm
};

/// Against the clock: tick k begins at the instant k periods after the first. What the bus has not taken of a
/// tick's frames by then is withdrawn where the bus can do that, so that no torque is older than its tick.
/// Until it is armed for the first time since its start it sends no torque, not even zero: drives that a
/// controller before it has left armed lose it by their watchdogs. A tick that begins half a period late is
/// counted and the instants go on from there; two in a row, or one that is `gap_us` and ten periods late, are
/// the fault `tick_late`, and the mechanism is brought to rest: what was ordered before the program stood
/// still is not done after.
template <class Node, Board B>
class TimedLoop {
 public:
  static constexpr std::uint32_t rejoin_us = 200'000;  ///< between attempts to come back to the bus
  static constexpr std::uint32_t gap_us = 50'000;

  /// `period_ns`: up to a second. The drives' answers are waited for during `patience` of a period, where
  /// they are asked.
  TimedLoop(Node& node, B& board, std::uint32_t period_ns, float patience = 0.4F)
      : node_(node),
        board_(board),
        period_us_(period_ns / 1000U),
        period_rest_ns_(period_ns % 1000U),
        patience_us_(static_cast<std::uint32_t>(static_cast<float>(period_us_) * patience)),
        next_us_(board.now_us()),
        on_bus_us_(next_us_) {}

  /// One turn; call for ever, as often as can be, or when a frame has come and at instant_us(). True: a tick
  /// has been done, and `seen` was given its result.
  template <class Seen>
  bool turn(Seen&& seen) {
    node_.enable_input(board_.enable().closed());
    node_.receive(board_.bus());
    const std::uint32_t now = board_.now_us(), since = now - next_us_;
    // Before the instant, which is a period ahead at most: anything else is late, also by more than half of
    // the counter's round.
    if (since > 0U - 2U * period_us_ - 2U) return false;
    if (!asked_) {
      begin(since);
      return false;
    }
    if (Node::samples_on_demand && !node_.complete() && !node_.overloaded() && now - began_us_ < patience_us_)
      return false;
    armed_ = armed_ || node_.drive_enable();
    const auto result = node_.tick(board_.bus(), armed_);
    finish_tick(node_, board_);
    asked_ = false;
    advance();
    seen(result);
    return true;
  }
  bool turn() {
    return turn([](const auto&) {});
  }

  /// The next instant at which something is to be done, whatever comes on the bus, on the board's clock.
  [[nodiscard]] std::uint32_t instant_us() const {
    return !asked_ ? next_us_ : (Node::samples_on_demand ? began_us_ + patience_us_ : began_us_);
  }
  /// By how much the last tick began after its instant.
  [[nodiscard]] std::uint32_t lateness_us() const { return lateness_us_; }
  /// Ticks that began late, since the start.
  [[nodiscard]] std::uint32_t late() const { return late_; }

 private:
  void begin(std::uint32_t since) {
    lateness_us_ = since;
    if (since > period_us_ / 2) {
      ++late_;
      if (late_before_ || (since >= gap_us && since / 10U >= period_us_)) node_.tick_late();
      late_before_ = true;
      next_us_ += since;
    } else {
      late_before_ = false;
    }
    began_us_ = next_us_ + (since > period_us_ / 2 ? 0U : since);
    asked_ = true;
    if constexpr (requires { board_.bus().withdraw(); }) board_.bus().withdraw();
    if constexpr (requires { board_.bus().rejoin(); }) {
      // Not at every tick: with a wrong bit rate it would disturb the others for ever.
      if (!board_.bus().off()) {
        on_bus_us_ = began_us_;
      } else if (began_us_ - on_bus_us_ >= rejoin_us) {
        on_bus_us_ = began_us_;
        board_.bus().rejoin();
      }
    }
    if (Node::samples_on_demand) node_.request(board_.bus());
  }
  void advance() {
    next_us_ += period_us_;
    rest_ns_ += period_rest_ns_;
    if (rest_ns_ >= 1000U) {
      rest_ns_ -= 1000U;
      ++next_us_;
    }
  }

  Node& node_;
  B& board_;
  std::uint32_t period_us_, period_rest_ns_, patience_us_, next_us_, on_bus_us_, began_us_ = 0, rest_ns_ = 0,
                                                                                 late_ = 0, lateness_us_ = 0;
  bool asked_ = false, late_before_ = false, armed_ = false;
};

}  // namespace esmc
