#pragma once
/// CanBus on an STM32's FDCAN (Bosch M_CAN): received frames by interrupt, sending polled; no heap, bounded
/// work per call.

#include <array>
#include <atomic>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>

#include "hal/bit_timing.hpp"
#include "hal/can.hpp"
#include "hal/fdcan/registers.hpp"
#include "hal/id_filters.hpp"
#include "hal/spsc_ring.hpp"
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

/// CAN controller of an STM32. `Chip`: fdcan::G4 or fdcan::H7.
///
/// Receiving: interrupt() moves elements of the controller's FIFO, which on a G4 holds three, into a ring,
/// and touches neither the transmit registers nor anything else of this object. It may interrupt every other
/// call.
///
/// Sending: the most urgent frames are in the controller's buffers, which send in the order of identifiers;
/// the others wait here. A frame that finds all buffers taken by less urgent ones takes them back. Frames
/// leave in the order of priority as long as some call comes once per frame time, and those of one identifier
/// in the order of try_send(): the controller, which would send these in any order, gets one at a time.
template <class Chip, FdcanAccess Access>
class Fdcan {
 public:
  static constexpr std::uint32_t waiting_max = WaitingFrames::capacity;  ///< frames
  static constexpr std::uint32_t received_max = 64;  ///< of 8 bytes at 1 Mbit/s: those of 7 ms
  /// Interrupts may be masked this long, us: the FIFO holds as many of the shortest frames at 1 Mbit/s.
  static constexpr std::uint32_t masked_us_max = 100;
  static_assert(Chip::rx_elements * 47 >= masked_us_max);

  explicit Fdcan(const Access& access) : a_(access) {}  ///< copies `access`; off the bus until open()

  /// Joins the bus at `bit_rate` (bit/s) with a kernel clock of `clock` (Hz); `data_rate` 0: classic frames
  /// only. Frames that `filters` do not accept cause no interrupt. Call before the interrupt is enabled.
  /// False, and off the bus: a rate is not exactly possible, or the controller does not answer. `loop_back`:
  /// away from the pins, for measurements without a transceiver; the controller receives its own frames, as
  /// fast as on a bus. `age_max_us`: the oldest age that frame_age_us() must tell, up to 1'000'000 us; the
  /// longer, the coarser.
  [[nodiscard]] bool open(std::uint32_t clock, std::uint32_t bit_rate, std::uint32_t data_rate = 0,
                          const IdFilters& filters = {}, bool loop_back = false,
                          std::uint32_t age_max_us = 60'000) {
    opened_ = false;
    const BitTiming slow = fdcan::nominal_timing(clock, bit_rate, data_rate != 0);
    const BitTiming fast = data_rate == 0 ? BitTiming{} : fdcan::data_timing(clock, data_rate);
    if (!slow.exact() || (data_rate != 0 && !fast.exact())) return false;
    using namespace fdcan;
    a_.write(cccr, a_.read(cccr) & ~cccr_bit::csr);
    a_.write(cccr, cccr_bit::init);
    if (!await(cccr_bit::init, cccr_bit::init)) return false;
    a_.write(cccr, cccr_bit::init | cccr_bit::cce);
    if (!await(cccr_bit::cce, cccr_bit::cce)) return false;
    a_.write(nbtp, ((slow.jump_width - 1) << 25) | ((slow.prescaler - 1) << 16) | ((slow.segment1 - 1) << 8) |
                       (slow.segment2 - 1));
    Word mode = cccr_bit::init | cccr_bit::cce | (loop_back ? cccr_bit::test | cccr_bit::mon : 0U);
    if (data_rate != 0) {
      // The delay through the transceiver is compensated, possible with quanta of one or two periods.
      const Word offset = fast.prescaler * (1 + fast.segment1);
      a_.write(dbtp, (fast.prescaler <= 2 ? 1U << 23 : 0U) | ((fast.prescaler - 1) << 16) |
                         ((fast.segment1 - 1) << 8) | ((fast.segment2 - 1) << 4) | (fast.jump_width - 1));
      a_.write(tdcr, (offset < 127 ? offset : 127) << 8);
      mode |= cccr_bit::fdoe | cccr_bit::brse;
    }
    a_.write(cccr, mode);
    if (loop_back) a_.write(test, 1U << 4);  // LBCK; with MON away from the pins
    // The age and the frame itself, in bits, must not go round the counter of 16 bits.
    const std::uint64_t span = std::uint64_t{age_max_us} * bit_rate / 1'000'000U + 256U;
    stamp_bits_ = static_cast<Word>(span < 0xF'0000U ? span / 0x1'0000U + 1U : 16U);
    a_.write(tscc, ((stamp_bits_ - 1) << 16) | 1U);  // counts bit times; of no use with FD frames
    for (Word at = 0; at < Chip::ram_words; ++at)
      a_.write_ram(at, 0);  // its parity is undefined until then (AN5348)
    configure_filters(filters.list());
    a_.write(ie, rx_new | Chip::lost_flag);
    a_.write(ils, 0);  // all on line 0
    a_.write(ile, 1);
    a_.write(ir, ~Word{0});
    a_.write(cccr, mode & ~(cccr_bit::init | cccr_bit::cce));
    opened_ = await(cccr_bit::init, 0);
    fd_ = data_rate != 0;
    bit_rate_ = bit_rate;
    waiting_.clear();
    received_.clear();
    buffers_ = {};
    return opened_;
  }

  /// Queues a frame. refused: not well formed, FD without data_rate, or bit_rate_switch without FD; bus_off:
  /// see off(); bus_full: waiting_max frames wait, none of them less urgent.
  SendStatus try_send(const CanFrame& f) {
    if (!well_formed(f) || (f.fd && !fd_) || (f.bit_rate_switch && !f.fd)) return SendStatus::refused;
    if (off()) return SendStatus::bus_off;
    pump();
    if (!waiting_.push(f)) return SendStatus::bus_full;
    pump();
    return SendStatus::ok;
  }

  /// The handler of interrupt line 0: moves received frames into the ring.
  void interrupt() {
    const fdcan::Word events = a_.read(fdcan::ir) & (fdcan::rx_new | Chip::lost_flag);
    a_.write(fdcan::ir, events);  // first: a frame that comes from now on asks for another interrupt
    if ((events & Chip::lost_flag) != 0) count_overrun();
    for (fdcan::Word n = 0; n < 2 * Chip::rx_elements; ++n) {
      const fdcan::Word state = a_.read(Chip::rxf0s);
      if ((state & Chip::fill) == 0) return;
      const fdcan::Word index = (state >> 8) & Chip::index;
      if (Element* const slot = received_.free_slot(); slot != nullptr) {
        copy(Chip::rx_fifo + index * fdcan::element::words, *slot);
        received_.push();
      } else {
        count_overrun();
      }
      a_.write(Chip::rxf0a, index);
    }
  }

  /// Takes the oldest received frame. False: none, `f` untouched.
  [[nodiscard]] bool try_receive(CanFrame& f) {
    if (!opened_) return false;
    pump();
    const Element* const received = received_.front();
    if (received == nullptr) return false;
    decode(*received, f);
    // The stamp is of the first bit; `bits` is the length of the frame without stuff bits.
    const std::uint32_t bits = (f.extended ? 64U : 44U) + (f.remote ? 0U : 8U * f.size);
    const std::uint32_t since = ((a_.read(fdcan::tscv) - (*received)[1]) & 0xFFFFU) * stamp_bits_;
    age_us_ = since > bits && !fd_
                  ? static_cast<std::uint32_t>(std::uint64_t{since - bits} * 1'000'000U / bit_rate_)
                  : 0U;
    received_.pop();
    return true;
  }

  /// Time in us since the end of the frame received last, at most its stuff bits too long, in steps of a bit
  /// time, or of up to 16 where `age_max_us` of open() takes more than 65 536. Beyond that age it wraps. 0,
  /// not known, with FD frames.
  [[nodiscard]] std::uint32_t frame_age_us() const { return age_us_; }

  /// Drops waiting perishable frames, also those in the controller except one that is being sent.
  void withdraw() {
    withdrawn_ += waiting_.withdraw();
    cancel([](const Buffer& b) { return b.perishable; });
  }

  /// True if the controller does not send: it has left the bus after 256 errors and not rejoined, never
  /// joined, or restricted its operation because its message memory was too slow.
  [[nodiscard]] bool off() const {
    return !opened_ || (a_.read(fdcan::psr) & fdcan::psr_bit::bus_off) != 0 ||
           (a_.read(fdcan::cccr) & halted) != 0;
  }
  /// Rejoins where off(), dropping all waiting frames: after bus-off the controller waits for 128 idle
  /// sequences and is off() until then. Torque does not resume, for bus_off is a latched fault.
  void rejoin() {
    if (!opened_ || !off()) return;
    withdrawn_ += waiting_.clear();
    cancel([](const Buffer&) { return true; });
    const fdcan::Word mode = a_.read(fdcan::cccr);
    if ((mode & halted) != 0) a_.write(fdcan::cccr, mode & ~(halted | fdcan::cccr_bit::cce));
  }

  /// Number of times that received frames were lost unread.
  [[nodiscard]] std::uint32_t overruns() const { return overruns_.load(std::memory_order_relaxed); }
  /// Number of frames withdrawn or dropped for more urgent ones, without those that were sent all the same.
  [[nodiscard]] std::uint32_t withdrawn() const { return withdrawn_ + waiting_.dropped(); }
  /// Transmit errors (0..255) in bits 7..0, receive errors (0..127) in bits 14..8: ECR.
  [[nodiscard]] std::uint32_t error_counters() const { return a_.read(fdcan::ecr) & 0x7FFFU; }

 private:
  static constexpr fdcan::Word halted = fdcan::cccr_bit::init | fdcan::cccr_bit::restricted;
  /// Header and data as they lie in the message memory, in either direction.
  using Element = std::array<fdcan::Word, fdcan::element::words>;
  /// A transmit buffer of the controller, and the frame in it.
  struct Buffer {
    std::uint32_t key = 0;  // arbitration()
    bool taken = false, perishable = false;
    bool taken_back = false;  // cancelled for a more urgent frame, to be sent later
    bool dropped = false;     // cancelled for good
  };
  static_assert(Chip::tx_elements <= WaitingFrames::returned_max);

  /// Waits for the controller's clock domain; bounded, for it may have no clock.
  [[nodiscard]] bool await(fdcan::Word mask, fdcan::Word value) const {
    for (int n = 0; n < 100'000; ++n) {
      if ((a_.read(fdcan::cccr) & mask) == value) return true;
    }
    return false;
  }

  void configure_filters(std::span<const IdFilter> filters) {
    using namespace fdcan;
    Word standard = 0, extended = 0;
    for (const IdFilter& f : filters) {
      if (!f.extended) {
        a_.write_ram(Chip::standard_filters + standard++, filter::standard | (f.id << 16) | f.mask);
        continue;
      }
      const Word at = Chip::extended_filters + 2 * extended++;
      a_.write_ram(at, filter::extended_first | f.id);
      a_.write_ram(at + 1, filter::extended_second | f.mask);
    }
    Chip::configure(a_, filters.empty() ? 0U : filter::reject_standard | filter::reject_extended, standard,
                    extended);
  }
  // Of the interrupt alone; a plain load and store need no exclusive access.
  void count_overrun() {
    overruns_.store(overruns_.load(std::memory_order_relaxed) + 1, std::memory_order_relaxed);
  }

  /// Withdraws the frames in the controller that `which` selects. One that is being sent may still go out.
  template <class Which>
  void cancel(Which&& which) {
    fdcan::Word selected = 0;
    for (std::size_t i = 0; i < buffers_.size(); ++i) {
      if (!buffers_[i].taken || !which(buffers_[i])) continue;
      buffers_[i].taken_back = false;
      buffers_[i].dropped = true;
      selected |= 1U << i;
    }
    if (selected == 0) return;
    a_.write(Chip::txbcr, selected);
    collect();
  }

  /// Frees the buffers whose frames were sent or cancelled since the last call.
  void collect() {
    // A request shows in TXBAR until it shows in TXBRP.
    const fdcan::Word asked = a_.read(Chip::txbar), pending = asked | a_.read(Chip::txbrp);
    for (std::size_t i = 0; i < buffers_.size(); ++i) {
      if (!buffers_[i].taken || ((pending >> i) & 1U) != 0) continue;
      buffers_[i].taken = false;
      if (((a_.read(Chip::txbto) >> i) & 1U) != 0) continue;
      if (!std::exchange(buffers_[i].taken_back, false)) {
        ++withdrawn_;
        continue;
      }
      Element element{};
      CanFrame f;
      copy(Chip::tx_buffers + static_cast<fdcan::Word>(i) * fdcan::element::words, element);
      decode(element, f);
      f.perishable = buffers_[i].perishable;
      waiting_.give_back(f);
    }
  }

  /// Gives waiting frames to the controller, the most urgent first.
  void pump() {
    collect();
    while (!waiting_.empty()) {
      const std::uint32_t key = arbitration(waiting_.front());
      std::size_t free = buffers_.size();
      fdcan::Word less_urgent = 0;
      for (std::size_t i = buffers_.size(); i-- > 0;) {
        if (!buffers_[i].taken) {
          free = i;
        } else if (buffers_[i].key == key) {
          return;
        } else if (buffers_[i].key > key) {
          less_urgent |= 1U << i;  // again at every call: a request under way may have missed the first
        }
      }
      if (free < buffers_.size()) {
        request(static_cast<fdcan::Word>(free), waiting_.front());
        buffers_[free] = {key, true, waiting_.front().perishable, false, false};
        waiting_.pop();
        continue;
      }
      for (std::size_t i = 0; i < buffers_.size(); ++i)
        buffers_[i].taken_back =
            !buffers_[i].dropped && (buffers_[i].taken_back || ((less_urgent >> i) & 1U) != 0);
      if (less_urgent != 0) a_.write(Chip::txbcr, less_urgent);
      return;
    }
  }

  /// Writes f into a free buffer of the controller and asks for its transmission.
  void request(fdcan::Word index, const CanFrame& f) {
    fdcan::Word at = Chip::tx_buffers + index * fdcan::element::words;
    const fdcan::Word code = can_fd_code(f.size);
    a_.write_ram(at++,
                 (f.extended ? f.id | fdcan::element::extended : f.id << fdcan::element::standard_shift) |
                     (f.remote ? fdcan::element::remote : 0U));
    a_.write_ram(at++, (code << fdcan::element::dlc_shift) | (f.fd ? fdcan::element::fd : 0U) |
                           (f.bit_rate_switch ? fdcan::element::bit_rate_switch : 0U));
    for (std::size_t i = 0; i < can_fd_sizes[code] && !f.remote; i += 4) {
      fdcan::Word w = 0;
      for (std::size_t k = 0; k < 4; ++k) {
        if (i + k < f.size) w |= static_cast<fdcan::Word>(f.data[i + k]) << (8U * k);
      }
      a_.write_ram(at++, w);
    }
    a_.write(Chip::txbar, 1U << index);
  }

  /// Bytes of data in an element with this second word; codes 9..15 of a classic frame mean 8.
  [[nodiscard]] static std::uint8_t size_of(fdcan::Word second) {
    const std::uint8_t size = can_fd_sizes[(second >> fdcan::element::dlc_shift) & 0xFU];
    return (second & fdcan::element::fd) != 0 || size < can_classic_size_max ? size : can_classic_size_max;
  }
  void copy(fdcan::Word at, Element& to) const {
    to[0] = a_.read_ram(at);
    to[1] = a_.read_ram(at + 1);
    if ((to[0] & fdcan::element::remote) != 0) return;
    const std::size_t words = (size_of(to[1]) + 3U) / 4U;
    for (std::size_t i = 0; i < words; ++i) to[2 + i] = a_.read_ram(at + 2 + static_cast<fdcan::Word>(i));
  }
  static void decode(const Element& from, CanFrame& f) {
    const fdcan::Word first = from[0], second = from[1];
    f.extended = (first & fdcan::element::extended) != 0;
    f.id = f.extended ? first & 0x1FFF'FFFFU : (first >> fdcan::element::standard_shift) & 0x7FFU;
    f.remote = (first & fdcan::element::remote) != 0;
    f.fd = (second & fdcan::element::fd) != 0;
    f.bit_rate_switch = f.fd && (second & fdcan::element::bit_rate_switch) != 0;
    f.size = size_of(second);
    for (std::size_t i = 0; i < f.size && !f.remote; ++i)
      f.data[i] = static_cast<std::uint8_t>(from[2 + i / 4] >> (8U * (i % 4)));
  }

  Access a_;
  bool opened_ = false, fd_ = false;
  std::uint32_t bit_rate_ = 1, stamp_bits_ = 1, withdrawn_ = 0, age_us_ = 0;
  std::atomic<std::uint32_t> overruns_ = 0;
  std::array<Buffer, Chip::tx_elements> buffers_{};
  WaitingFrames waiting_{};
  SpscRing<Element, received_max> received_{};
};

}  // namespace esmc::hal
