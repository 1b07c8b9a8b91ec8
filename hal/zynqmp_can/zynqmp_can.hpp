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
/// The counter that stamps received frames cannot be read, so their age is not known. After bus-off the
/// controller is kept off the bus, for it would send its FIFO when it recovers.
template <zynqmp_can::Layout layout, ZynqmpCanAccess Access>
class ZynqmpCan {
 public:
  static constexpr std::uint32_t waiting_max = WaitingFrames::capacity;  ///< frames

  explicit ZynqmpCan(const Access& access) : a_(access) {}  ///< copies it; off the bus until open()

  /// Joins the bus at `bit_rate` (bit/s) with a reference clock of `clock` (Hz), without filters. False, off
  /// the bus: rate not exactly possible, no answer of the controller, or never 11 recessive bits on the bus.
  [[nodiscard]] bool open(std::uint32_t clock, std::uint32_t bit_rate) {
    using namespace zynqmp_can;
    opened_ = sending_ = false;
    waiting_.clear();
    const BitTiming timing = bit_timing(clock, bit_rate, limits, 5);
    if (!timing.exact()) return false;
    a_.write(srr, srr_bit::srst);
    if (!await(sr_bit::config, sr_bit::config)) return false;
    a_.write(brpr, timing.prescaler - 1);
    a_.write(btr, ((timing.jump_width - 1) << 7) | ((timing.segment2 - 1) << 4) | (timing.segment1 - 1));
    a_.write(msr, 0);
    a_.write(afr, 0);
    a_.write(ier, 0);
    a_.write(icr, event::all);
    a_.write(srr, srr_bit::cen);
    return opened_ = await(sr_bit::config, 0);
  }

  /// Queues a frame. refused: not well formed, or FD; bus_full: waiting_max frames wait, none of them
  /// less urgent; bus_off: for good.
  SendStatus try_send(const CanFrame& f) {
    if (!well_formed(f) || f.fd || f.bit_rate_switch) return SendStatus::refused;
    pump();
    if (!opened_) return SendStatus::bus_off;
    if (!waiting_.push(f)) return SendStatus::bus_full;
    pump();
    return SendStatus::ok;
  }

  /// Takes the oldest received frame, of any identifier. False: none or off the bus, `f` untouched.
  [[nodiscard]] bool try_receive(CanFrame& f) {
    pump();
    using namespace zynqmp_can;
    if (!opened_) return false;
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

  /// Number of times that received frames were lost unread.
  [[nodiscard]] std::uint32_t overruns() const { return overruns_; }

 private:
  using Word = zynqmp_can::Word;

  /// Bounded, for the controller may have no clock.
  [[nodiscard]] bool await(zynqmp_can::Word mask, zynqmp_can::Word value) const {
    for (int n = 0; n < 100'000; ++n) {
      if ((a_.read(zynqmp_can::sr) & mask) == value) return true;
    }
    return false;
  }

  /// Detects bus-off, and gives the controller the next frame when it has sent the last one.
  void pump() {
    using namespace zynqmp_can;
    if (!opened_) return;
    const Word events = a_.read(isr);
    // By the event too, for the controller may have recovered meanwhile.
    if ((a_.read(sr) & sr_bit::estat) == sr_bit::bus_off || (events & event::bsoff) != 0) {
      a_.write(srr, srr_bit::srst);  // configuration mode with empty FIFOs
      opened_ = false;
      return;
    }
    if (sending_ && (events & event::txok) != 0) sending_ = false;
    if (sending_ || waiting_.empty()) return;
    a_.write(icr, event::txok);
    encode(waiting_.front());
    sending_ = true;
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
  bool opened_ = false, sending_ = false;
  std::uint32_t overruns_ = 0;
  WaitingFrames waiting_{};
};

}  // namespace esmc::hal
