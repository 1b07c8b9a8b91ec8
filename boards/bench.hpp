#pragma once
/// Measures the cycle on a board: frames of the drives, as `esmc hil` has recorded them, go through the
/// board's CAN controller in loop-back, and ticks begin by its clock. Prints what tests/boards/bench.py
/// reads.

#include <algorithm>
#include <array>
#include <cstdint>

#include "boards/cortex_m/memory.hpp"
#include "boards/node.hpp"
#include "firmware/link/crc.hpp"
#include "scene.hpp"

/// Measurement of the cycle on a board.
namespace esmc::bench {

/// A frame that the drives sent before a tick.
struct Recorded {
  std::uint16_t tick, id;
  std::uint8_t size;
  std::uint8_t data[hal::can_classic_size_max];
};
/// The recording, in the order of ticks.
inline constexpr Recorded recorded[] = {
#include "bench_frames.inc"
};
inline constexpr std::uint32_t ticks = 1U + std::end(recorded)[-1].tick;
/// Period of a tick: longer than the scene's, because arming sends more frames than fit a millisecond.
inline constexpr std::uint32_t period_us = 2500;

/// Stages of a tick whose time is measured: receive and send are the CAN driver's, decode, control and encode
/// the cycle's, `tick` the sum of these; `waiting` is not counted.
enum Stage : std::uint8_t { receive, decode, control, encode, send, tick, waiting, stages };
inline constexpr const char* stage_names[] = {"receive", "decode", "control", "encode", "send", "tick"};

/// Time of each stage in counts of T::count(), which may wrap.
template <class T>
struct Stopwatch {
  std::array<std::uint32_t, stages> spent{}, worst{};  ///< in the present tick; largest of all ticks
  std::array<std::uint64_t, stages> sum{};
  std::uint32_t ticks = 0;

  /// Ends the present stage and begins `next`.
  void enter(Stage next) {
    const std::uint32_t now = T::count();
    spent[stage_] += now - since_;
    stage_ = next;
    since_ = T::count();
  }
  /// Adds the tick to `worst` and `sum`.
  void end_tick() {
    for (unsigned i = 0; i < tick; ++i) spent[tick] += spent[i];
    for (unsigned i = 0; i <= tick; ++i) {
      worst[i] = std::max(worst[i], spent[i]);
      sum[i] += spent[i];
    }
    spent = {};
    ++ticks;
  }

 private:
  Stage stage_ = waiting;
  std::uint32_t since_ = 0;
};

/// The bus of `target`, which returns every frame. Sends the recorded frames of a tick one after the other,
/// and passes them on when they come back; the node's own are only counted.
template <class T>
class LoopBackBus {
  using Bus = std::remove_reference_t<decltype(std::declval<T&>().bus())>;

 public:
  /// Recorded frames that came back, frames that the node has sent, and those of them that came back.
  std::uint32_t taken = 0, sent = 0, returned = 0;

  LoopBackBus(T& target, Stopwatch<T>& watch) : bus_(target.bus()), watch_(watch) {}

  hal::SendStatus try_send(const hal::CanFrame& f) {
    watch_.enter(send);
    const hal::SendStatus status = bus_.try_send(f);
    watch_.enter(waiting);
    ++sent;
    crc_ = link::crc32_add(link::crc32_add(crc_, f.id & 0xFFU), f.id >> 8U & 0xFFU);
    for (const std::uint8_t byte : f.payload()) crc_ = link::crc32_add(crc_, byte);
    watch_.enter(encode);
    return status;
  }
  [[nodiscard]] bool try_receive(hal::CanFrame& f) {
    watch_.enter(waiting);
    offer();
    for (;;) {
      const std::uint32_t before = watch_.spent[receive];
      watch_.enter(receive);
      if constexpr (requires { bus_.interrupt(); }) bus_.interrupt();  // called, so that its time is counted
      const bool got = bus_.try_receive(f);
      watch_.enter(waiting);
      const bool own = got && !(f == offered_);
      if (!own) {
        if (got) offered_ = nothing, ++taken;
        watch_.enter(decode);
        return got;
      }
      ++returned;
      watch_.spent[receive] = before;
    }
  }
  /// Withdraws perishable frames, where the bus can.
  void withdraw() requires requires(Bus& b) { b.withdraw(); }
  { bus_.withdraw(); }
  /// CRC-32 of identifiers and data that the node has sent.
  [[nodiscard]] std::uint32_t digest() const { return ~crc_; }

 private:
  static constexpr hal::CanFrame nothing{.id = ~0U};  // equal to no frame
  void offer() {
    if (offered_.id != nothing.id || taken == std::size(recorded) || recorded[taken].tick > watch_.ticks)
      return;
    hal::CanFrame f{.id = recorded[taken].id, .size = recorded[taken].size};
    std::copy_n(recorded[taken].data, f.size, f.data.begin());
    if (bus_.try_send(f) == hal::SendStatus::ok) offered_ = f;
  }

  Bus& bus_;
  Stopwatch<T>& watch_;
  hal::CanFrame offered_ = nothing;
  std::uint32_t crc_ = link::crc32_start;
};

/// The image's cycle with a stopwatch around what its loop calls.
template <class T>
class MeasuredNode : public baked::Node {
 public:
  MeasuredNode(const baked::Node::Config& config, Stopwatch<T>& watch) : baked::Node(config), watch_(watch) {}

  /// Receives as baked::Node. A call that brings no recorded frame adds no time to any stage.
  void receive(LoopBackBus<T>& bus) {
    const auto before = watch_.spent;
    const std::uint32_t taken = bus.taken;
    watch_.enter(decode);
    baked::Node::receive(bus);
    watch_.enter(waiting);
    if (bus.taken == taken) watch_.spent = before;
  }
  /// A tick that always sends torques, as in the recorded run.
  auto tick(LoopBackBus<T>& bus, bool) {
    watch_.enter(control);
    const auto result = baked::Node::tick(bus);
    watch_.enter(waiting);
    watch_.end_tick();
    return result;
  }

 private:
  Stopwatch<T>& watch_;
};

/// Board for TimedLoop with the bus in loop-back: no contact, no outputs, no watchdog.
template <class T>
struct BenchBoard {
  T& target;
  LoopBackBus<T> loop_back;
  NoWatchdog no_watchdog{};
  NoContact no_contact{};
  NoOutput no_output{};
  [[nodiscard]] LoopBackBus<T>& bus() { return loop_back; }
  [[nodiscard]] std::uint32_t now_us() { return target.now_us(); }
  [[nodiscard]] NoWatchdog& watchdog() { return no_watchdog; }
  [[nodiscard]] NoContact& enable() { return no_contact; }
  [[nodiscard]] NoOutput& drive_enable() { return no_output; }
};

/// Bytes of the stack that have been used since the start.
[[nodiscard]] inline std::uint32_t stack_used() {
  const volatile std::uint32_t* at = &esmc_stack_bottom + 64;  // its guard cannot be read
  while (at < &esmc_stack_top && *at == stack_paint) ++at;
  return static_cast<std::uint32_t>(reinterpret_cast<std::uintptr_t>(&esmc_stack_top) -
                                    reinterpret_cast<std::uintptr_t>(at));
}

/// Runs all recorded ticks, then prints the result on the console. T: bus() that returns frames, now_us(), a
/// static count() that wraps, the name of its `unit`, and out() that takes texts and numbers by <<.
template <class T>
void run(T& target) {
  static_assert(baked::lockstep, "the recording is of a lockstep run: bake without --realtime");
  static Stopwatch<T> watch;
  static BenchBoard<T> board{target, {target, watch}};
  static MeasuredNode<T> node(baked::config(1), watch);
  node.command(Command::enable);
  // The first tick is due when the loop is made: its frames come before.
  for (const std::uint32_t begin_us = board.now_us(); board.now_us() - begin_us < period_us;)
    node.receive(board.bus());
  TimedLoop loop(node, board, 1000U * period_us);
  std::uint32_t lateness_us = 0;
  while (watch.ticks < ticks) {
    if (loop.turn()) lateness_us = std::max(lateness_us, loop.lateness_us());
  }
  const std::uint32_t end_us = board.now_us(), used = stack_used();
  hal::CanFrame last;
  while (board.now_us() - end_us < period_us) (void)board.bus().try_receive(last);  // the torques of the end

  target.out() << "\r\nbench of " << ticks << " ticks, " << period_us << " us each, "
               << (sizeof(baked::Scalar) == sizeof(float) ? "float" : "double") << ", in " << T::unit
               << "\r\n";
  for (unsigned i = 0; i <= tick; ++i) {
    target.out() << stage_names[i] << " worst " << watch.worst[i] << " mean "
                 << static_cast<std::uint32_t>(watch.sum[i] / ticks) << "\r\n";
  }
  target.out() << "stack " << used << " bytes\r\nlate " << loop.late() << ", worst lateness " << lateness_us
               << " us\r\nstate " << name(node.supervisor().state()) << ", fault "
               << name(node.supervisor().fault()) << "\r\n";
  target.out() << "frames taken " << board.bus().taken << ", sent " << board.bus().sent << ", returned "
               << board.bus().returned << "\r\ndigest " << board.bus().digest() << "\r\ndone\r\n";
}

}  // namespace esmc::bench
