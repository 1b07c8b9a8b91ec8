#pragma once
/// Two slots in bank 2 of an STM32's flash as a SlotMemory. Code runs in bank 1, which stays readable while
/// bank 2 is erased or programmed (read while write): the image must lie in bank 1.

#include <concepts>
#include <cstdint>
#include <span>

#include "hal/slot_memory.hpp"

namespace esmc::hal::flash {

using Word = std::uint32_t;

/// Access to the flash interface and memory: on a board the addresses, in a test a model.
template <class A>
concept Access = requires(A& a, const A& c, Word at, Word value, Word& word) {
  { c.read(at) } -> std::same_as<Word>;  // register at a byte offset from the flash interface
  a.write(at, value);
  // A word of the memory. False: an error of two bits, as after a programming that was cut short. The board
  // must turn the chip's exception for it into this result.
  { a.load(at, word) } -> std::same_as<bool>;
  a.store(at, value);  // into the memory, neither merged nor delayed
};

inline constexpr Word key1 = 0x4567'0123U, key2 = 0xCDEF'89ABU;

/// STM32G471/473/474/483/484 with 512 KiB (RM0440, chapter 3, category 3 devices) and the option DBANK, as
/// delivered. A page of 2 KiB is erased in about 25 ms, a double word programmed in about 0.1 ms, once.
struct G4 {
  static constexpr Word keyr = 0x08, sr = 0x10, cr = 0x14;  // offsets in bytes (3.7)
  static constexpr Word busy = 1U << 16, pending = 0;       // SR
  /// SR: OPTVERR, RDERR, FASTERR, MISERR, PGSERR, SIZERR, PGAERR, WRPERR, PROGERR, OPERR. Written to be
  /// cleared; left from before they make the next operation fail (PGSERR).
  static constexpr Word errors = 0xC3FAU;
  static constexpr Word clear = sr, clear_all = errors | 1U;                             // and EOP
  static constexpr Word lock = 1U << 31, start = 1U << 16, program = 1U << 0, idle = 0;  // CR
  static constexpr Word address = 0x0804'0000U, slot_bytes = 2048, first = 126;          // pages of bank 2
  static constexpr unsigned unit_words = 2;

  /// CR to erase a page of bank 2: PER, BKER, PNB.
  static constexpr Word erase(Word page) { return 1U << 1 | 1U << 11 | page << 3; }
  /// True if OPTR says two banks (DBANK), and bank 1 at 0x0800'0000 (BFB2).
  template <Access A>
  static bool available(const A& a) {
    constexpr Word bfb2 = 1U << 20, dbank = 1U << 22;
    return (a.read(0x20) & (dbank | bfb2)) == dbank;
  }
  /// Switches the data cache off, as it does not see an erasure. Reading constants is slower meanwhile.
  template <Access A>
  static void before(A& a) {
    a.write(acr, a.read(acr) & ~dcen);
  }
  /// Empties the data cache while it is off, then switches it on.
  template <Access A>
  static void after(A& a) {
    const Word off = a.read(acr) & ~dcen;
    a.write(acr, off | 1U << 12);  // DCRST
    a.write(acr, off);
    a.write(acr, off | dcen);
  }

 private:
  static constexpr Word acr = 0x00, dcen = 1U << 10;
};

/// STM32H742/743/753 with 2 MiB (RM0433, chapter 4). A sector of 128 KiB is erased in one to four seconds, a
/// flash word of 256 bits programmed in about 0.2 ms, whole and once: its error correction covers all of it.
struct H7 {
  static constexpr Word keyr = 0x104, sr = 0x110, cr = 0x10C;                           // of bank 2 (4.9)
  static constexpr Word busy = 1U << 0 | 1U << 2, pending = 1U << 1;                    // SR2: BSY, QW; WBNE
  static constexpr Word errors = 1U << 17 | 1U << 18 | 1U << 19 | 1U << 21 | 1U << 22;  // of writes
  static constexpr Word clear = 0x114, clear_all = 0x0FEF'0000U;          // CCR2: EOP and all errors
  static constexpr Word lock = 1U << 0, start = 1U << 7, idle = 3U << 4;  // CR2: PSIZE of 64 bits
  static constexpr Word program = idle | 1U << 1;
  static constexpr Word address = 0x0810'0000U, slot_bytes = 128 * 1024, first = 6;  // sectors of bank 2
  static constexpr unsigned unit_words = 8;

  /// CR2 to erase a sector of bank 2: SER, PSIZE, SNB.
  static constexpr Word erase(Word sector) { return idle | 1U << 2 | sector << 8; }
  /// True if OPTCR says bank 1 at 0x0800'0000 (SWAP_BANK).
  template <Access A>
  static bool available(const A& a) {
    return (a.read(0x18) & 1U << 31) == 0;
  }
  /// Before and after an operation there is nothing to do: no data cache is in use.
  template <Access A>
  static void before(A&) {}
  template <Access A>
  static void after(A&) {}
};

/// Two slots in bank 2 of the flash (SlotMemory). `Chip`: G4 or H7.
template <class Chip, Access A>
class BankSlots {
 public:
  static constexpr unsigned unit_words = Chip::unit_words;

  explicit BankSlots(const A& access) : a_(access) {}  ///< copies `access`

  /// True if the option bytes of the chip allow the use of bank 2.
  [[nodiscard]] bool available() const { return Chip::available(a_); }

  /// Reads word `at` of a slot. False, `word` untouched: out of range, damaged, or the bank is being written,
  /// when a read would halt the processor until it is done.
  [[nodiscard]] bool read(unsigned slot, unsigned at, std::uint32_t& word) {
    if (slot >= memory_slots || at >= Chip::slot_bytes / 4 || operating_ || busy()) return false;
    return a_.load(address(slot, at), word);
  }

  /// Begins to erase a slot, 0 or 1; poll() reports the end. False: not begun.
  [[nodiscard]] bool begin_erase(unsigned slot) {
    if (slot >= memory_slots || !open()) return false;
    const Word command = Chip::erase(Chip::first + slot);
    a_.write(Chip::cr, command);
    a_.write(Chip::cr, command | Chip::start);
    return operating_ = true;
  }

  /// Begins to program the unit at word `at`, a multiple of unit_words. False: not begun.
  [[nodiscard]] bool begin_program(unsigned slot, unsigned at,
                                   std::span<const std::uint32_t, unit_words> unit) {
    if (slot >= memory_slots || at % unit_words != 0 || at >= Chip::slot_bytes / 4 || !open()) return false;
    a_.write(Chip::cr, Chip::program);
    for (unsigned i = 0; i < unit_words; ++i)
      a_.store(address(slot, at + i), unit[i]);  // the last one begins
    return operating_ = true;
  }

  /// Ends a completed operation. failed: once per failed operation; ready also if there is none.
  MemoryStatus poll() {
    if (!operating_) return MemoryStatus::ready;
    const Word state = a_.read(Chip::sr);
    if ((state & Chip::busy) != 0) return MemoryStatus::busy;
    operating_ = false;
    close();
    // Pending words were not a whole unit.
    return (state & (Chip::errors | Chip::pending)) == 0 ? MemoryStatus::ready : MemoryStatus::failed;
  }

 private:
  static constexpr Word address(unsigned slot, unsigned at) {
    return Chip::address + (Chip::first + slot) * Chip::slot_bytes + 4U * at;
  }
  [[nodiscard]] bool busy() const { return (a_.read(Chip::sr) & Chip::busy) != 0; }

  /// Unlocks, and clears old errors, with which nothing would begin.
  [[nodiscard]] bool open() {
    if (operating_ || !available() || (a_.read(Chip::sr) & (Chip::busy | Chip::pending)) != 0) return false;
    if ((a_.read(Chip::cr) & Chip::lock) != 0) {
      a_.write(Chip::keyr, key1);
      a_.write(Chip::keyr, key2);
    }
    if ((a_.read(Chip::cr) & Chip::lock) != 0) return false;
    Chip::before(a_);
    a_.write(Chip::clear, Chip::clear_all);
    return true;
  }
  /// Locks again, against stray writes.
  void close() {
    a_.write(Chip::clear, Chip::clear_all);
    a_.write(Chip::cr, Chip::idle);
    a_.write(Chip::cr, Chip::idle | Chip::lock);
    Chip::after(a_);
  }

  A a_;
  bool operating_ = false;
};

template <Access A>
using G4Slots = BankSlots<G4, A>;
template <Access A>
using H7Slots = BankSlots<H7, A>;

}  // namespace esmc::hal::flash
