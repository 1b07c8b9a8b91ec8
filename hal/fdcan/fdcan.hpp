#pragma once
/// CanBus on an STM32's FDCAN (Bosch M_CAN), polled: no interrupts, no heap, bounded work per call.

#include <array>
#include <concepts>
#include <cstddef>
#include <cstdint>

#include "hal/bit_timing.hpp"
#include "hal/can.hpp"
#include "hal/fdcan/registers.hpp"
#include "hal/waiting_frames.hpp"

namespace esmc::hal {

/// Access to registers and message memory: on a board the addresses, in a test a model.
template <class A>
concept FdcanAccess = requires(A& a, const A& c, std::uint32_t at, std::uint32_t value) {
  { c.read(at) } -> std::same_as<std::uint32_t>;  // register at a byte offset
  a.write(at, value);
  { c.read_ram(at) } -> std::same_as<std::uint32_t>;  // word of the message memory
  a.write_ram(at, value);
};

/// Bytes of a frame by its data length code, and back.
inline constexpr std::array<std::uint8_t, 16> fdcan_sizes{0, 1,  2,  3,  4,  5,  6,  7,
                                                          8, 12, 16, 20, 24, 32, 48, 64};
/// The smallest code whose frame holds `size` bytes (at most 64), padded with zeros.
[[nodiscard]] constexpr std::uint32_t fdcan_code(std::uint8_t size) {
  std::uint32_t code = 0;
  while (code < 15 && fdcan_sizes[code] < size) ++code;
  return code;
}

/// `Chip`: fdcan::G4 or fdcan::H7. Frames leave in the order of try_send(): the controller gets one at a
/// time, the others wait here and can be withdrawn, so that no torque of an earlier tick is sent.
template <class Chip, FdcanAccess Access>
class Fdcan {
 public:
  static constexpr std::uint32_t waiting_max = WaitingFrames::capacity;  ///< frames

  explicit Fdcan(const Access& access) : a_(access) {}  ///< copies `access`; off the bus until open()

  /// Joins the bus at `bit_rate` (bit/s) with a kernel clock of `clock` (Hz); `data_rate` 0: classic frames
  /// only. No filter: other nodes that use our identifiers must be noticed. False, and off the bus: a rate is
  /// not exactly possible, or the controller does not answer.
  [[nodiscard]] bool open(std::uint32_t clock, std::uint32_t bit_rate, std::uint32_t data_rate = 0) {
    opened_ = false;
    const BitTiming slow = bit_timing(clock, bit_rate, fdcan::nominal_limits);
    const BitTiming fast = data_rate == 0 ? BitTiming{} : bit_timing(clock, data_rate, fdcan::data_limits);
    if (!slow.exact() || (data_rate != 0 && !fast.exact())) return false;
    using namespace fdcan;
    a_.write(cccr, a_.read(cccr) & ~cccr_bit::csr);
    a_.write(cccr, cccr_bit::init);
    if (!await(cccr_bit::init, cccr_bit::init)) return false;
    a_.write(cccr, cccr_bit::init | cccr_bit::cce);
    if (!await(cccr_bit::cce, cccr_bit::cce)) return false;
    a_.write(nbtp, ((slow.jump_width - 1) << 25) | ((slow.prescaler - 1) << 16) | ((slow.segment1 - 1) << 8) |
                       (slow.segment2 - 1));
    Word mode = cccr_bit::init | cccr_bit::cce;
    if (data_rate != 0) {
      // The delay through the transceiver is compensated, possible with quanta of one or two periods.
      const Word offset = fast.prescaler * (1 + fast.segment1);
      a_.write(dbtp, (fast.prescaler <= 2 ? 1U << 23 : 0U) | ((fast.prescaler - 1) << 16) |
                         ((fast.segment1 - 1) << 8) | ((fast.segment2 - 1) << 4) | (fast.jump_width - 1));
      a_.write(tdcr, (offset < 127 ? offset : 127) << 8);
      mode |= cccr_bit::fdoe | cccr_bit::brse;
    }
    a_.write(cccr, mode);
    a_.write(tscc, 1);  // counts bit times; of no use with FD frames
    Chip::configure(a_);
    for (Word at = 0; at < Chip::ram_words; ++at)
      a_.write_ram(at, 0);  // its parity is undefined until then (AN5348)
    a_.write(ie, 0);
    a_.write(ir, ~Word{0});
    a_.write(cccr, mode & ~(cccr_bit::init | cccr_bit::cce));
    opened_ = await(cccr_bit::init, 0);
    fd_ = data_rate != 0;
    bit_rate_ = bit_rate;
    waiting_.clear();
    return opened_;
  }

  /// Queues a frame. refused: not well formed, FD without data_rate, or bit_rate_switch without FD; bus_off:
  /// see off(); bus_full: waiting_max frames wait.
  SendStatus try_send(const CanFrame& f) {
    if (!well_formed(f) || (f.fd && !fd_) || (f.bit_rate_switch && !f.fd)) return SendStatus::refused;
    if (off()) return SendStatus::bus_off;
    pump();
    if (!waiting_.push(f)) return SendStatus::bus_full;
    pump();
    return SendStatus::ok;
  }

  /// Takes the oldest received frame, of any identifier. False: none, `f` untouched.
  [[nodiscard]] bool try_receive(CanFrame& f) {
    if (!opened_) return false;
    pump();
    const fdcan::Word state = a_.read(Chip::rxf0s);
    if ((state & fdcan::rx_lost) != 0) {
      a_.write(fdcan::ir, Chip::lost_flag);
      ++overruns_;
    }
    if ((state & Chip::fill) == 0) return false;
    const fdcan::Word index = (state >> 8) & Chip::index;
    read(Chip::rx_fifo + index * fdcan::element::words, f);
    a_.write(Chip::rxf0a, index);
    return true;
  }

  /// Time in us since the end of the frame received last, at most its stuff bits too long. Wraps after 65 ms
  /// at 1 Mbit/s. 0, not known, with FD frames.
  [[nodiscard]] std::uint32_t frame_age_us() const { return age_us_; }

  /// Withdraws perishable frames, also the one in the controller unless it is being sent.
  void withdraw() {
    withdrawn_ += waiting_.withdraw();
    if (perishable_) cancel();
  }

  /// True if the controller has left the bus after 256 errors and not rejoined, or never joined.
  [[nodiscard]] bool off() const { return !opened_ || (a_.read(fdcan::psr) & fdcan::psr_bit::bus_off) != 0; }
  /// Rejoins after bus-off, dropping all waiting frames: the controller waits for 128 idle sequences and is
  /// off() until then. Torque does not resume, for bus_off is a latched fault.
  void rejoin() {
    if (!opened_ || !off()) return;
    withdrawn_ += waiting_.clear();
    cancel();
    const fdcan::Word mode = a_.read(fdcan::cccr);
    if ((mode & fdcan::cccr_bit::init) != 0)
      a_.write(fdcan::cccr, mode & ~(fdcan::cccr_bit::init | fdcan::cccr_bit::cce));
  }

  /// Number of times that received frames were lost unread.
  [[nodiscard]] std::uint32_t overruns() const { return overruns_; }
  /// Number of withdrawn frames.
  [[nodiscard]] std::uint32_t withdrawn() const { return withdrawn_; }
  /// Transmit errors (0..255) in bits 7..0, receive errors (0..127) in bits 14..8: ECR.
  [[nodiscard]] std::uint32_t error_counters() const { return a_.read(fdcan::ecr) & 0x7FFFU; }

 private:
  /// Waits for the controller's clock domain; bounded, for it may have no clock.
  [[nodiscard]] bool await(fdcan::Word mask, fdcan::Word value) const {
    for (int n = 0; n < 100'000; ++n) {
      if ((a_.read(fdcan::cccr) & mask) == value) return true;
    }
    return false;
  }

  /// Withdraws the frame in the controller, if there is one.
  void cancel() {
    const fdcan::Word pending = opened_ ? a_.read(Chip::txbrp) : 0;
    if (pending == 0) return;
    ++withdrawn_;
    perishable_ = false;
    a_.write(Chip::txbcr, pending);
  }

  /// Gives the controller the next frame if it has none. A written request becomes pending some clocks later.
  void pump() {
    if (waiting_.empty() || (a_.read(Chip::txbrp) | a_.read(Chip::txbar)) != 0) return;
    const CanFrame& f = waiting_.front();
    const fdcan::Word index = (a_.read(fdcan::txfqs) >> 16) & 0x1FU & Chip::index;
    if (index >= Chip::tx_elements) return;
    fdcan::Word at = Chip::tx_buffers + index * fdcan::element::words;
    const fdcan::Word code = fdcan_code(f.size);
    a_.write_ram(at++,
                 (f.extended ? f.id | fdcan::element::extended : f.id << fdcan::element::standard_shift) |
                     (f.remote ? fdcan::element::remote : 0U));
    a_.write_ram(at++, (code << fdcan::element::dlc_shift) | (f.fd ? fdcan::element::fd : 0U) |
                           (f.bit_rate_switch ? fdcan::element::bit_rate_switch : 0U));
    for (std::size_t i = 0; i < fdcan_sizes[code] && !f.remote; i += 4) {
      fdcan::Word w = 0;
      for (std::size_t k = 0; k < 4; ++k) {
        if (i + k < f.size) w |= static_cast<fdcan::Word>(f.data[i + k]) << (8U * k);
      }
      a_.write_ram(at++, w);
    }
    a_.write(Chip::txbar, 1U << index);
    perishable_ = f.perishable;
    waiting_.pop();
  }

  void read(fdcan::Word at, CanFrame& f) {
    const fdcan::Word first = a_.read_ram(at), second = a_.read_ram(at + 1);
    f.extended = (first & fdcan::element::extended) != 0;
    f.id = f.extended ? first & 0x1FFF'FFFFU : (first >> fdcan::element::standard_shift) & 0x7FFU;
    f.remote = (first & fdcan::element::remote) != 0;
    f.fd = (second & fdcan::element::fd) != 0;
    f.bit_rate_switch = f.fd && (second & fdcan::element::bit_rate_switch) != 0;
    const std::uint8_t size = fdcan_sizes[(second >> fdcan::element::dlc_shift) & 0xFU];
    f.size =
        f.fd || size < can_classic_size_max ? size : can_classic_size_max;  // codes 9..15 of a classic frame
    for (std::size_t i = 0; i < f.size && !f.remote; i += 4) {
      const fdcan::Word w = a_.read_ram(at + 2 + static_cast<fdcan::Word>(i / 4));
      for (std::size_t k = 0; k < 4 && i + k < f.size; ++k)
        f.data[i + k] = static_cast<std::uint8_t>(w >> (8U * k));
    }
    // The stamp is of the first bit; `bits` is the length of the frame without stuff bits.
    const std::uint32_t bits = (f.extended ? 64U : 44U) + (f.remote ? 0U : 8U * f.size);
    const std::uint32_t since = (a_.read(fdcan::tscv) - second) & 0xFFFFU;
    age_us_ = since > bits && !fd_
                  ? static_cast<std::uint32_t>(std::uint64_t{since - bits} * 1'000'000U / bit_rate_)
                  : 0U;
  }

  Access a_;
  bool opened_ = false, fd_ = false;
  bool perishable_ = false;  // the frame in the controller is
  std::uint32_t bit_rate_ = 1, overruns_ = 0, withdrawn_ = 0, age_us_ = 0;
  WaitingFrames waiting_{};
};

}  // namespace esmc::hal
