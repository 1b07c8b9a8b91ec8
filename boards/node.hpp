#pragma once
/// The loops that run a cycle on a board.

#include <bit>
#include <concepts>
#include <cstdint>

#include "firmware/safety/supervisor.hpp"
#include "hal/can.hpp"
#include "hal/io.hpp"

namespace esmc {

/// Interface of a board to its loop: CAN bus, watchdog, the input `enable`, the output `drive_enable`, and
/// now_us(), a clock in microseconds that wraps at 2^32. Optional: brake(), an output.
template <class B>
concept Board = requires(B& b) {
  requires hal::CanBus<std::remove_reference_t<decltype(b.bus())>>;
  requires hal::Watchdog<std::remove_reference_t<decltype(b.watchdog())>>;
  requires hal::DigitalInput<std::remove_reference_t<decltype(b.enable())>>;
  requires hal::DigitalOutput<std::remove_reference_t<decltype(b.drive_enable())>>;
  { b.now_us() } -> std::same_as<std::uint32_t>;  // wraps
};

/// For a board without an enable contact: always closed.
struct NoContact {
  [[nodiscard]] static bool closed() { return true; }
};
/// For a board without an output: set() has no effect.
struct NoOutput {
  static void set(bool) {}
};
/// For a board without a watchdog: refresh() has no effect.
struct NoWatchdog {
  static void refresh() {}
};

/// Sets the outputs of the board and refreshes the watchdog if the torques of the tick were allowed
/// (Cycle::output_ok); call after node.tick().
template <class Node, Board B>
void finish_tick(Node& node, B& board) {
  board.drive_enable().set(node.drive_enable());
  if constexpr (requires { board.brake(); }) board.brake().set(node.release_brake());
  if (node.output_ok()) board.watchdog().refresh();
}

/// Loop in lockstep with `esmc plant`: one tick per complete set of samples. Until a drive has sent a frame,
/// the request to arm is repeated every `retry_us`, as by `esmc controller`. States without torque also tick
/// every `retry_us` without a set, so that commands are taken and stopping ends; but enabling waits for sets
/// and ends with the fault enabling_timeout after `enabling_us`. The watchdog is refreshed while waiting.
template <class Node, Board B>
class LockstepLoop {
 public:
  static constexpr std::uint32_t retry_us = 100'000, enabling_us = 5'000'000;

  LockstepLoop(Node& node, B& board) : node_(node), board_(board) {}  ///< both must outlive the loop

  /// Does one turn, without waiting; call in an endless loop.
  void turn() {
    node_.enable_input(board_.enable().closed());
    node_.receive(board_.bus());
    const std::uint32_t quiet_us = board_.now_us() - ticked_at_us_;
    const bool enabling = node_.supervisor().state() == State::enabling;
    if (node_.complete() || node_.overloaded()) {
      tick(true, 0);
    } else if (enabling && board_.now_us() - set_at_us_ >= enabling_us) {
      tick(false, enabling_us);
    } else if (!ticked_ || (quiet_us >= (node_.set_begun() ? 10U * retry_us : retry_us) &&
                            !node_.supervisor().powered() && (!enabling || !node_.heard()))) {
      if (!node_.heard()) node_.ask_again();
      tick(false, enabling || !ticked_ ? 0 : quiet_us);
    } else if (node_.output_ok()) {
      board_.watchdog().refresh();
    }
  }

 private:
  /// `passed_us`: time since the last set.
  void tick(bool answer, std::uint32_t passed_us) {
    const bool enabling = node_.supervisor().state() == State::enabling;
    if (!answer) node_.time_passed(passed_us);
    node_.tick(board_.bus(), answer);
    ticked_ = true;
    ticked_at_us_ = board_.now_us();
    if (answer || !enabling) set_at_us_ = ticked_at_us_;
    if (answer || !node_.heard()) node_.request(board_.bus());  // a slow plant has a request already
    finish_tick(node_, board_);
  }

  Node& node_;
  B& board_;
  bool ticked_ = false;
  std::uint32_t ticked_at_us_ = 0;
  std::uint32_t set_at_us_ = 0;  // last set, or command to enable
};

/// Loop in real time: tick k begins k periods after the first. Frames that the bus has not taken by then are
/// withdrawn where the bus supports it, so that no torque is older than its tick. Before the first arming no
/// torque frame is sent, not even zero: drives that an earlier controller left armed lose torque by their
/// watchdogs. A tick that begins half a period late is counted, and the schedule shifts; two in a row, four
/// of 64, or one that is `gap_us` and ten periods late, are the fault `tick_late`: the law's sample time must
/// hold, also in a loop that is overloaded by a few per cent, and commands from before a gap must not act
/// after it.
template <class Node, Board B>
class TimedLoop {
 public:
  static constexpr std::uint32_t rejoin_us = 200'000;  ///< between attempts to come back to the bus
  static constexpr std::uint32_t gap_us = 50'000;

  /// Both must outlive the loop; the first tick is due now. `period_ns`: 1000 ns to a second, not checked.
  /// `patience`: share of the period, 0..1, to wait for requested samples.
  TimedLoop(Node& node, B& board, std::uint32_t period_ns, float patience = 0.4F)
      : node_(node),
        board_(board),
        period_us_(period_ns / 1000U),
        period_rest_ns_(period_ns % 1000U),
        patience_us_(static_cast<std::uint32_t>(static_cast<float>(period_us_) * patience)),
        next_us_(board.now_us()),
        on_bus_us_(next_us_) {}

  /// Does one turn, without waiting; call in an endless loop, or after each frame and at instant_us(). True:
  /// a tick was done, and `seen` was called with its result.
  /// Not inlined: boards with fast memory have it there (cortex_m/sections.ld).
  template <class Seen>
  [[gnu::noinline]] bool turn(Seen&& seen) {
    node_.enable_input(board_.enable().closed());
    node_.receive(board_.bus());
    const std::uint32_t now = board_.now_us(), since = now - next_us_;
    // The instant is a period ahead at most: every other difference is a delay.
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
  /// Does one turn without a function for the result.
  bool turn() {
    return turn([](const auto&) {});
  }

  /// Time of the board's clock, us, at which the next turn() is due at the latest.
  [[nodiscard]] std::uint32_t instant_us() const {
    return !asked_ ? next_us_ : (Node::samples_on_demand ? began_us_ + patience_us_ : began_us_);
  }
  /// Delay of the last tick against its instant, us.
  [[nodiscard]] std::uint32_t lateness_us() const { return lateness_us_; }
  /// Number of late ticks since the start.
  [[nodiscard]] std::uint32_t late() const { return late_; }

 private:
  void begin(std::uint32_t since) {
    lateness_us_ = since;
    late_ticks_ <<= 1U;
    if constexpr (requires { node_.late_by(since); }) node_.late_by(since);
    if (since > period_us_ / 2) {
      ++late_;
      const bool repeated = (late_ticks_ & 2U) != 0 || std::popcount(late_ticks_) >= 3;
      late_ticks_ |= 1U;
      if (repeated || (since >= gap_us && since / 10U >= period_us_)) node_.tick_late();
      next_us_ += since;
    }
    began_us_ = next_us_ + (since > period_us_ / 2 ? 0U : since);
    asked_ = true;
    if constexpr (requires { board_.bus().withdraw(); }) board_.bus().withdraw();
    if constexpr (requires { board_.bus().rejoin(); }) {
      // Not at every tick: with a wrong bit rate it would disturb the other nodes.
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
  std::uint64_t late_ticks_ = 0;  // of the last 64, the present one in bit 0
  bool asked_ = false, armed_ = false;
};

}  // namespace esmc
