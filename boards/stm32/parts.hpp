#pragma once
/// What an STM32 gives a board whichever it is: registers, pins, a microsecond counter, the independent
/// watchdog, a serial line. The chip.hpp of a board says where these are. Sources: RM0440, RM0433.

#include <cstdint>

namespace esmc::stm32 {

using Word = std::uint32_t;

[[nodiscard]] inline volatile Word& reg(Word address) { return *reinterpret_cast<volatile Word*>(address); }
inline void set_bits(Word address, Word bits) { reg(address) = reg(address) | bits; }
inline void set_field(Word address, Word mask, Word value) { reg(address) = (reg(address) & ~mask) | value; }
/// A clock that was switched on runs once its register has been read back.
inline void finish_access(Word address) { [[maybe_unused]] const Word read_back = reg(address); }
/// False: it has not happened within about half a second of a processor that runs on its own oscillator.
[[nodiscard]] inline bool await(Word address, Word mask, Word value) {
  for (int n = 0; n < 1'000'000; ++n) {
    if ((reg(address) & mask) == value) return true;
  }
  return false;
}

/// A pin of the port at `port`. GPIO registers are the same in both families.
struct Pin {
  Word port;
  unsigned number;

  void output_low() const {
    set(false);
    set_field(port, 3U << (2 * number), 1U << (2 * number));
  }
  /// With a pull-down: an open contact and a broken wire read low.
  void input_pulled_down() const {
    set_field(port + 0x0C, 3U << (2 * number), 2U << (2 * number));
    set_field(port, 3U << (2 * number), 0);
  }
  void alternate(Word function) const {
    const unsigned at = 4 * (number % 8);
    set_field(port + (number < 8 ? 0x20 : 0x24), 0xFU << at, function << at);
    set_field(port + 0x08, 3U << (2 * number), 2U << (2 * number));  // fast edges
    set_field(port, 3U << (2 * number), 2U << (2 * number));
  }
  [[nodiscard]] bool high() const { return ((reg(port + 0x10) >> number) & 1U) != 0; }
  void set(bool on) const { reg(port + 0x18) = 1U << (on ? number : number + 16); }
};

/// TIM2 as a counter of microseconds that goes round after 71 minutes.
inline void start_microseconds(Word timer_hz) {
  constexpr Word tim2 = 0x4000'0000U;
  reg(tim2 + 0x28) = timer_hz / 1'000'000U - 1U;  // PSC
  reg(tim2 + 0x2C) = ~Word{0};                    // ARR
  reg(tim2 + 0x14) = 1;                           // EGR: take them
  reg(tim2) = 1;                                  // CR1: count
}
[[nodiscard]] inline Word microseconds() { return reg(0x4000'0024U); }

/// The independent watchdog with its own oscillator (32 kHz within some per cent). Once started, only a reset
/// ends it.
class IndependentWatchdog {
 public:
  explicit constexpr IndependentWatchdog(Word base) : base_(base) {}
  /// `timeout_us`: 1000 to 500 000.
  void start(Word timeout_us) const {
    reg(base_) = 0xCCCC;
    reg(base_) = 0x5555;
    reg(base_ + 4) = 0;                  // PR: 8 kHz
    reg(base_ + 8) = timeout_us / 125U;  // RLR
    (void)await(base_ + 12, 7, 0);
    refresh();
  }
  void refresh() const { reg(base_) = 0xAAAA; }

 private:
  Word base_;
};

/// Status for people, 115 200 bit/s, never waited for: what does not fit is dropped.
class Console {
 public:
  explicit constexpr Console(Word base) : base_(base) {}
  void start(Word clock_hz) const {
    reg(base_) = 0;                           // the rate is taken while it is off
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
  Console& hex(Word value) {
    for (int shift = 28; shift >= 0; shift -= 4)
      put("0123456789abcdef"[(value >> static_cast<unsigned>(shift)) & 0xFU]);
    return *this;
  }
  [[nodiscard]] bool idle() const { return tail_ == head_; }
  /// Gives the line its next byte when it takes one.
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

/// A controller's registers and its message memory.
template <Word base, Word ram>
struct FdcanMemory {
  [[nodiscard]] Word read(Word at) const { return reg(base + at); }
  void write(Word at, Word value) { reg(base + at) = value; }
  [[nodiscard]] Word read_ram(Word at) const { return reg(ram + 4 * at); }
  void write_ram(Word at, Word value) { reg(ram + 4 * at) = value; }
};

/// The flash interface at `base`, and the memory. `Guard::load` reads a word that may be damaged: false
/// instead of an exception.
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
    asm volatile("dsb" ::: "memory");  // not merged with the next one
  }
};

/// A word of the random number generator at `base`, whose clock runs; 0 where it gives none.
[[nodiscard]] inline Word random_word(Word base) {
  set_bits(base, 1U << 2);       // RNGEN
  for (int n = 0; n < 2; ++n) {  // the first one is thrown away
    if (!await(base + 4, 1, 1)) return 0;
    const Word value = reg(base + 8);
    if (n == 1) return value;
  }
  return 0;
}

/// Why start-up went no further.
enum class StartFault : std::uint8_t { none, oscillator, pll, core_voltage, clock_switch, can };
[[nodiscard]] constexpr const char* name(StartFault f) {
  switch (f) {
    case StartFault::none:
      return "none";
    case StartFault::oscillator:
      return "oscillator";
    case StartFault::pll:
      return "pll";
    case StartFault::core_voltage:
      return "core_voltage";
    case StartFault::clock_switch:
      return "clock_switch";
    case StartFault::can:
      return "can";
  }
  return "?";
}

}  // namespace esmc::stm32
