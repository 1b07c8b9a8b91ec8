#pragma once
/// CanBus on the CAN 2.0B controller of a Zynq UltraScale+, polled: no interrupts, bounded work per call.

#include <array>
#include <concepts>
#include <cstddef>
#include <cstdint>

#include "hal/bit_timing.hpp"
#include "hal/can.hpp"
#include "hal/waiting_frames.hpp"
#include "hal/zynqmp_can/registers.hpp"

namespace esmc::hal {

/// Access to registers: on a board the addresses, in a test a model. A read may take a message from a FIFO.
template <class A>
concept ZynqmpCanAccess = requires(A& a, const A& c, std::uint32_t at, std::uint32_t value) {
  { c.read(at) } -> std::same_as<std::uint32_t>;  // register at a byte offset
  a.write(at, value);
};

/// CAN controller of a Zynq UltraScale+. `layout`: of the manual, or of the emulator for an image that runs
/// there only. The controller, whose FIFO cannot give a frame back, gets one at a time; the others wait here.
/// The counter that stamps received frames cannot be read, so their age is not known.
template <zynqmp_can::Layout layout, ZynqmpCanAccess Access>
class ZynqmpCan {
 public:
  static constexpr std::uint32_t waiting_max = WaitingFrames::capacity;  ///< frames

  explicit ZynqmpCan(const Access& access) : a_(access) {}  ///< copies it; off the bus until open()

  /// Joins the bus at `bit_rate` (bit/s) with a reference clock of `clock` (Hz), without filters. False, off
  /// the bus: rate not exactly possible, no answer of the controller, or never 11 recessive bits on the bus.
  [[nodiscard]] bool open(std::uint32_t clock, std::uint32_t bit_rate) {
    opened_ = left_ = false;
    timing_ = bit_timing(clock, bit_rate, zynqmp_can::limits);
    waiting_.clear();
    if (!timing_.exact() || !restart()) return false;
    opened_ = await(zynqmp_can::sr_bit::config, 0);
    return opened_;
  }

  /// Queues a frame. refused: not well formed, or FD; bus_full: waiting_max frames wait.
  SendStatus try_send(const CanFrame& f) {
    if (!well_formed(f) || f.fd || f.bit_rate_switch) return SendStatus::refused;
    if (!opened_) return SendStatus::bus_off;
    pump();
    if (left_) return SendStatus::bus_off;
    if (!waiting_.push(f)) return SendStatus::bus_full;
    pump();
    return SendStatus::ok;
  }

  /// Takes the oldest received frame, of any identifier. False: none or off the bus, `f` untouched.
  [[nodiscard]] bool try_receive(CanFrame& f) {
    if (!opened_) return false;
    pump();
    if (left_) return false;
    using namespace zynqmp_can;
    const Word events = a_.read(isr);
    if ((events & event::rxoflw) != 0) {
      a_.write(icr, event::rxoflw);
      ++overruns_;
    }
    if ((events & event::rxnemp) == 0) return false;
    const Word id = a_.read(rx_fifo), length = a_.read(rx_fifo + 4);  // all four, in this order
    const Word first = a_.read(rx_fifo + 8), second = a_.read(rx_fifo + 12);
    a_.write(icr, event::rxnemp);  // set again at once while there are more
    decode(id, length, first, second, f);
    return true;
  }

  /// Drops waiting perishable frames; also the one in the controller if the bus has not taken it since the
  /// last withdraw(): by a reset, which clears the error counters and may cause an error frame.
  void withdraw() {
    if (!opened_) return;
    pump();
    withdrawn_ += waiting_.withdraw();
    if (!sending_ || !perishable_ || left_) return;
    if (!stale_) {
      stale_ = true;
    } else if ((a_.read(zynqmp_can::isr) & zynqmp_can::event::rxnemp) ==
               0) {  // a reset loses received frames
      ++withdrawn_;
      if (!restart()) left_ = true;
    }
  }

  /// True if the controller has left the bus after 256 errors and not rejoined, or never joined.
  [[nodiscard]] bool off() const {
    if (!opened_) return true;
    const zynqmp_can::Word state = a_.read(zynqmp_can::sr);
    return bus_off(state, a_.read(zynqmp_can::isr)) ||
           (left_ && (!rejoining_ || (state & zynqmp_can::sr_bit::config) != 0));
  }
  /// Rejoins after bus-off, dropping all waiting frames; until then the controller is kept off the bus, for
  /// it would send its FIFO when it recovers. It joins after 11 recessive bits instead of 128 times as many:
  /// call this 2 ms after bus-off or later. Torque does not resume, for bus_off is a latched fault.
  void rejoin() {
    if (!opened_ || !off()) return;
    leave();
    rejoining_ = restart();
  }

  /// Number of times that received frames were lost unread.
  [[nodiscard]] std::uint32_t overruns() const { return overruns_; }
  /// Number of withdrawn frames.
  [[nodiscard]] std::uint32_t withdrawn() const { return withdrawn_; }
  /// Transmit errors in bits 7..0, receive errors in bits 15..8: ECR. 0 while kept off the bus.
  [[nodiscard]] std::uint32_t error_counters() const { return a_.read(zynqmp_can::ecr) & 0xFFFFU; }

 private:
  using Word = zynqmp_can::Word;

  /// Bounded, for the controller may have no clock.
  [[nodiscard]] bool await(zynqmp_can::Word mask, zynqmp_can::Word value) const {
    for (int n = 0; n < 100'000; ++n) {
      if ((a_.read(zynqmp_can::sr) & mask) == value) return true;
    }
    return false;
  }

  /// Empty FIFOs, normal mode, no filters; on the bus after 11 recessive bits (SR.CONFIG 0). False: silent.
  [[nodiscard]] bool restart() {
    using namespace zynqmp_can;
    sending_ = stale_ = false;
    a_.write(srr, srr_bit::srst);
    if (!await(sr_bit::config, sr_bit::config)) return false;
    a_.write(brpr, timing_.prescaler - 1);
    a_.write(btr, ((timing_.jump_width - 1) << 7) | ((timing_.segment2 - 1) << 4) | (timing_.segment1 - 1));
    a_.write(msr, 0);
    a_.write(afr, 0);
    a_.write(ier, 0);
    a_.write(icr, event::all);
    a_.write(srr, srr_bit::cen);
    return true;
  }

  /// By the event too, for the controller may have recovered meanwhile.
  [[nodiscard]] static constexpr bool bus_off(zynqmp_can::Word state, zynqmp_can::Word events) {
    return (state & zynqmp_can::sr_bit::estat) == zynqmp_can::sr_bit::bus_off ||
           (events & zynqmp_can::event::bsoff) != 0;
  }

  /// Configuration mode with empty FIFOs.
  void leave() {
    a_.write(zynqmp_can::srr, zynqmp_can::srr_bit::srst);
    withdrawn_ += waiting_.clear() + (sending_ ? 1U : 0U);
    sending_ = stale_ = rejoining_ = false;
    left_ = true;
  }

  /// Detects bus-off and recovery, and gives the controller the next frame when it has sent the last one.
  void pump() {
    using namespace zynqmp_can;
    const Word state = a_.read(sr), events = a_.read(isr);
    if (bus_off(state, events)) return leave();
    if ((state & sr_bit::config) != 0) return;
    if (rejoining_) left_ = rejoining_ = false;
    if (sending_ && (events & event::txok) != 0) sending_ = stale_ = false;
    if (sending_ || waiting_.empty()) return;
    const CanFrame& f = waiting_.front();
    a_.write(icr, event::txok);
    encode(f);
    sending_ = true;
    perishable_ = f.perishable;
    waiting_.pop();
  }

  /// Bytes i to i + 3 as one word.
  [[nodiscard]] static constexpr unsigned shift_of(std::size_t i) {
    return 8U * static_cast<unsigned>(layout == zynqmp_can::Layout::manual ? 3U - i % 4U : i % 4U);
  }

  void encode(const CanFrame& f) {
    using namespace zynqmp_can;
    Word id = 0;
    if constexpr (layout == Layout::qemu_7_2) {
      id = f.id | (f.extended ? 1U << 31 : 0U) | (f.remote ? 1U << 30 : 0U);
    } else if (f.extended) {
      id = ((f.id >> idl_bits) << idh_shift) | ((f.id & idl_mask) << idl_shift) | srrrtr | ide |
           (f.remote ? rtr : 0U);
    } else {
      id = (f.id << idh_shift) | (f.remote ? srrrtr : 0U);
    }
    std::array<Word, 2> data{};
    for (std::size_t i = 0; i < f.size && !f.remote; ++i)
      data[i / 4] |= static_cast<Word>(f.data[i]) << shift_of(i);
    a_.write(tx_fifo, id);
    a_.write(tx_fifo + 4, static_cast<Word>(f.size) << dlc_shift);
    a_.write(tx_fifo + 8, data[0]);
    a_.write(tx_fifo + 12, data[1]);  // the fourth word completes the message
  }

  static void decode(Word id, Word length, Word first, Word second, CanFrame& f) {
    using namespace zynqmp_can;
    f = CanFrame{};
    if constexpr (layout == Layout::qemu_7_2) {
      f.extended = (id & (1U << 31)) != 0;
      f.remote = (id & (1U << 30)) != 0;
      f.id = id & (f.extended ? 0x1FFF'FFFFU : 0x7FFU);
    } else {
      f.extended = (id & ide) != 0;
      f.remote = (id & (f.extended ? rtr : srrrtr)) != 0;
      f.id = id >> idh_shift;
      if (f.extended) f.id = (f.id << idl_bits) | ((id >> idl_shift) & idl_mask);
    }
    const Word code = length >> dlc_shift;  // above 8 it means 8
    f.size = code < can_classic_size_max ? static_cast<std::uint8_t>(code) : can_classic_size_max;
    for (std::size_t i = 0; i < f.size && !f.remote; ++i) {
      f.data[i] = static_cast<std::uint8_t>((i < 4 ? first : second) >> shift_of(i));
    }
  }

  Access a_;
  BitTiming timing_{};
  bool opened_ = false, left_ = false, rejoining_ = false;     // left_: off the bus and kept there
  bool sending_ = false, perishable_ = false, stale_ = false;  // of the frame in the controller
  std::uint32_t overruns_ = 0, withdrawn_ = 0;
  WaitingFrames waiting_{};
};

}  // namespace esmc::hal
