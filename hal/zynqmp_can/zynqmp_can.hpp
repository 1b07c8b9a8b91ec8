#pragma once
/// CanBus on the CAN 2.0B controller of a Zynq UltraScale+, polled: no interrupts, no heap, bounded work per
/// call.

#include <array>
#include <concepts>
#include <cstddef>
#include <cstdint>

#include "hal/bit_timing.hpp"
#include "hal/can.hpp"
#include "hal/waiting_frames.hpp"
#include "hal/zynqmp_can/registers.hpp"

namespace esmc::hal {

/// Where the registers are: on a board the addresses, in a test a model of them. A read may take a message
/// from a FIFO.
template <class A>
concept ZynqmpCanAccess = requires(A& a, const A& c, std::uint32_t at, std::uint32_t value) {
  { c.read(at) } -> std::same_as<std::uint32_t>;  // register at a byte offset
  a.write(at, value);
};

/// `layout`: that of the manual; that of the emulator for an image that runs there and nowhere else. Frames
/// leave in the order of try_send(): one at a time is with the controller, whose FIFO cannot give one back,
/// the others wait here. The controller stamps frames with a counter that nobody can read: when a frame came
/// is not known.
template <zynqmp_can::Layout layout, ZynqmpCanAccess Access>
class ZynqmpCan {
 public:
  static constexpr std::uint32_t waiting_max = WaitingFrames::most;  ///< frames

  explicit ZynqmpCan(const Access& access) : a_(access) {}

  /// Takes the bus at `bit_rate` (bit/s) with a reference clock of `clock` (Hz). Accepts every frame: whoever
  /// uses our identifiers must be heard. False where the rate cannot be had exactly, the controller does not
  /// answer, or the bus is never recessive for 11 bits; it is then off the bus, and every try_send is
  /// bus_off.
  [[nodiscard]] bool open(std::uint32_t clock, std::uint32_t bit_rate) {
    opened_ = left_ = false;
    timing_ = bit_timing(clock, bit_rate, zynqmp_can::limits);
    waiting_.clear();
    if (!timing_.exact() || !restart()) return false;
    opened_ = await(zynqmp_can::sr_bit::config, 0);
    return opened_;
  }

  SendStatus try_send(const CanFrame& f) {
    if (!well_formed(f) || f.fd || f.bit_rate_switch) return SendStatus::refused;
    if (!opened_) return SendStatus::bus_off;
    pump();
    if (left_) return SendStatus::bus_off;
    if (!waiting_.push(f)) return SendStatus::bus_full;
    pump();
    return SendStatus::ok;
  }

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

  /// Takes back what is perishable and waits here. The frame that is with the controller can be taken back by
  /// a reset of all of it only, which costs its error counters and, if it is just sending, an error frame:
  /// where the bus has not taken a perishable frame from one withdraw() to the next, that is done.
  void withdraw() {
    if (!opened_) return;
    pump();
    withdrawn_ += waiting_.withdraw();
    if (!sending_ || !perishable_ || left_) return;
    if (!stale_) {
      stale_ = true;
    } else if ((a_.read(zynqmp_can::isr) & zynqmp_can::event::rxnemp) ==
               0) {  // received frames would be lost with it
      ++withdrawn_;
      if (!restart()) left_ = true;
    }
  }

  /// The controller has left the bus, by 256 errors of its own or because it never got there.
  [[nodiscard]] bool off() const {
    if (!opened_) return true;
    const zynqmp_can::Word state = a_.read(zynqmp_can::sr);
    return bus_off(state, a_.read(zynqmp_can::isr)) ||
           (left_ && (!rejoining_ || (state & zynqmp_can::sr_bit::config) != 0));
  }
  /// Asks it back after bus-off, until which it is kept from the bus: by itself it would come back and send
  /// what its FIFO held. It then takes part after 11 recessive bits, not after 128 times as many: leave 2 ms
  /// or more between its leaving and this. Everything that waits is dropped. Torque does not resume by this:
  /// bus_off is a latched fault of the supervisor.
  void rejoin() {
    if (!opened_ || !off()) return;
    leave();
    rejoining_ = restart();
  }

  /// How often frames were lost because nobody read them; frames that were withdrawn.
  [[nodiscard]] std::uint32_t overruns() const { return overruns_; }
  [[nodiscard]] std::uint32_t withdrawn() const { return withdrawn_; }
  /// Transmit errors in bits 7..0, receive errors in bits 15..8: ECR. 0 while it is kept from the bus.
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

  /// Empty FIFOs, normal mode, no acceptance filters; on the bus after 11 recessive bits, when SR.CONFIG is
  /// 0. False: no answer.
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

  /// The event, too: it may have come back by itself in the meantime.
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

  /// Notices bus-off and the way back, and gives the controller the next frame when it has sent the last one.
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
    a_.write(tx_fifo + 12, data[1]);  // the message is complete with its fourth word, used or not
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
  bool opened_ = false, left_ = false, rejoining_ = false;     // off the bus and kept there; on the way back
  bool sending_ = false, perishable_ = false, stale_ = false;  // of the frame that is with the controller
  std::uint32_t overruns_ = 0, withdrawn_ = 0;
  WaitingFrames waiting_{};
};

}  // namespace esmc::hal
