#pragma once
/// Peripherals common to both STM32 families: pins, microsecond counter, independent watchdog, serial line.
/// The chip.hpp of a board holds their addresses. Sources: RM0440, RM0433.

#include <cstdint>

namespace esmc::stm32 {

using Word = std::uint32_t;

/// The register at an absolute address.
[[nodiscard]] inline volatile Word& reg(Word address) { return *reinterpret_cast<volatile Word*>(address); }
inline void set_bits(Word address, Word bits) { reg(address) = reg(address) | bits; }  ///< others stay
/// Replaces the bits of `mask` by those of `value`, which has no others: not checked.
inline void set_field(Word address, Word mask, Word value) { reg(address) = (reg(address) & ~mask) | value; }
/// Reads a register of the clock control back, after which a clock that was switched on runs.
inline void finish_access(Word address) { [[maybe_unused]] const Word read_back = reg(address); }
/// Waits until the bits of `mask` in a register are `value`. False: not within about half a second.
[[nodiscard]] inline bool await(Word address, Word mask, Word value) {
  for (int n = 0; n < 1'000'000; ++n) {
    if ((reg(address) & mask) == value) return true;
  }
  return false;
}

/// Enables interrupt `number` in the NVIC, with the priority of reset, the highest: nothing preempts it but
/// faults.
inline void enable_interrupt(Word number) {
  asm volatile("dsb" ::: "memory");  // what its handler reads is written
  reg(0xE000'E100U + 4 * (number / 32)) = 1U << (number % 32);
}

/// Pin `number`, 0..15, of the port at address `port`, whose clock must run. A contact is closed when high.
struct Pin {
  Word port;
  unsigned number;

  /// Makes the pin an output that is low.
  void output_low() const {
    set(false);
    set_field(port, 3U << (2 * number), 1U << (2 * number));
  }
  /// Makes the pin an input with a pull-down: an open contact and a broken wire read low.
  void input_pulled_down() const {
    set_field(port + 0x0C, 3U << (2 * number), 2U << (2 * number));
    set_field(port, 3U << (2 * number), 0);
  }
  /// Gives the pin to a peripheral by its alternate function, 0..15. `pull_up`: high where nothing drives it.
  void alternate(Word function, bool pull_up) const {
    set_field(port + 0x0C, 3U << (2 * number), (pull_up ? 1U : 0U) << (2 * number));
    const unsigned at = 4 * (number % 8);
    set_field(port + (number < 8 ? 0x20 : 0x24), 0xFU << at, function << at);
    set_field(port + 0x08, 3U << (2 * number), 2U << (2 * number));  // fast edges
    set_field(port, 3U << (2 * number), 2U << (2 * number));
  }
  /// True if an input is high (hal::DigitalInput).
  [[nodiscard]] bool closed() const { return ((reg(port + 0x10) >> number) & 1U) != 0; }
  /// Sets the level of an output (hal::DigitalOutput).
  void set(bool on) const { reg(port + 0x18) = 1U << (on ? number : number + 16); }
};

/// Pin and the number of its alternate function, for Pin::alternate().
struct Function {
  Pin pin;
  Word number;
  bool pull_up = false;
};

/// Starts TIM2, fed with timer_hz (whole MHz), as a counter of microseconds, which wraps after 71 minutes.
inline void start_microseconds(Word timer_hz) {
  constexpr Word tim2 = 0x4000'0000U;
  reg(tim2 + 0x28) = timer_hz / 1'000'000U - 1U;  // PSC
  reg(tim2 + 0x2C) = ~Word{0};                    // ARR
  reg(tim2 + 0x14) = 1;                           // EGR: load both
  reg(tim2) = 1;                                  // CR1: count
}
/// The counter of start_microseconds(), us.
[[nodiscard]] inline Word microseconds() { return reg(0x4000'0024U); }

/// The independent watchdog with its own oscillator (32 kHz within some per cent). Only a reset stops it.
class IndependentWatchdog {
 public:
  /// `base`: address of its registers.
  explicit constexpr IndependentWatchdog(Word base) : base_(base) {}
  /// Starts the watchdog. `timeout_us`: 1000 to 500 000, not checked. False: its oscillator does not run, so
  /// it would never end a program that hangs.
  [[nodiscard]] bool start(Word timeout_us) const {
    reg(base_) = 0xCCCC;
    reg(base_) = 0x5555;
    reg(base_ + 4) = 0;                           // PR: 8 kHz
    reg(base_ + 8) = timeout_us / 125U;           // RLR
    const bool counts = await(base_ + 12, 7, 0);  // SR: taken over, which takes five cycles of that clock
    refresh();
    return counts;
  }
  void refresh() const { reg(base_) = 0xAAAA; }  ///< restarts the time-out

 private:
  Word base_;
};

/// Text output, 115 200 bit/s. Never waits: text that does not fit the ring is dropped.
class Console {
 public:
  /// `base`: address of the USART, which is off until start().
  explicit constexpr Console(Word base) : base_(base) {}
  /// Starts the line with a peripheral clock of clock_hz; call again when that clock changes.
  void start(Word clock_hz) const {
    reg(base_) = 0;                           // the rate can be set while it is off
    reg(base_ + 0x0C) = clock_hz / 115'200U;  // BRR
    reg(base_) = (1U << 3) | 1U;              // CR1: transmitter
  }
  Console& operator<<(const char* text) {
    while (*text != '\0') put(*text++);
    return *this;
  }
  Console& operator<<(Word value) {  // decimal
    char digits[10];
    int n = 0;
    do {
      digits[n++] = static_cast<char>('0' + value % 10U);
      value /= 10U;
    } while (value != 0);
    while (n > 0) put(digits[--n]);
    return *this;
  }
  /// Appends a number as eight hexadecimal digits, without a prefix.
  Console& hex(Word value) {
    for (int shift = 28; shift >= 0; shift -= 4)
      put("0123456789abcdef"[(value >> static_cast<unsigned>(shift)) & 0xFU]);
    return *this;
  }
  [[nodiscard]] bool idle() const { return tail_ == head_; }  ///< all text has been sent
  /// Sends the next byte if the line is ready; nothing else sends, so call it again and again.
  void pump() {
    if (tail_ == head_ || (reg(base_ + 0x1C) & (1U << 7)) == 0) return;
    reg(base_ + 0x28) = static_cast<unsigned char>(ring_[tail_++ % size]);
  }

 private:
  static constexpr Word size = 256;
  void put(char c) {
    if (head_ - tail_ < size) ring_[head_++ % size] = c;
  }
  Word base_, head_ = 0, tail_ = 0;
  char ring_[size] = {};
};

/// hal::FdcanAccess of a CAN controller: registers by byte offset from `base`, message memory by word index
/// from `ram`.
template <Word base, Word ram>
struct FdcanMemory {
  [[nodiscard]] Word read(Word at) const { return reg(base + at); }
  void write(Word at, Word value) { reg(base + at) = value; }
  [[nodiscard]] Word read_ram(Word at) const { return reg(ram + 4 * at); }
  void write_ram(Word at, Word value) { reg(ram + 4 * at) = value; }
};

/// hal::flash::Access to flash interface and memory. read, write: a register, byte offset from `base`; load,
/// store: an absolute address in the flash. `Guard::load` returns false for a damaged word.
template <Word base, class Guard>
struct FlashMemory {
  [[nodiscard]] Word read(Word at) const { return reg(base + at); }
  void write(Word at, Word value) {
    reg(base + at) = value;
    asm volatile("dsb" ::: "memory");
  }
  [[nodiscard]] bool load(Word address, Word& word) { return Guard::load(address, word); }
  void store(Word address, Word value) {
    reg(address) = value;
    asm volatile("dsb" ::: "memory");  // not merged with the next store
  }
};

/// A word of the random number generator at `base`, whose clock runs; 0: it gives none.
[[nodiscard]] inline Word random_word(Word base) {
  set_bits(base, 1U << 2);       // RNGEN
  for (int n = 0; n < 2; ++n) {  // the first word is discarded
    if (!await(base + 4, 1, 1)) return 0;
    const Word value = reg(base + 8);
    if (n == 1) return value;
  }
  return 0;
}

/// Reason why start-up failed.
enum class StartFault : std::uint8_t { none, oscillator, pll, core_voltage, clock_switch, can, watchdog };
[[nodiscard]] constexpr const char* name(StartFault f) {
  constexpr const char* names[] = {"none",         "oscillator", "pll",     "core_voltage",
                                   "clock_switch", "can",        "watchdog"};
  return names[static_cast<unsigned>(f)];
}

}  // namespace esmc::stm32
