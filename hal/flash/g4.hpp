#pragma once
/// Two pages of bank 2 of an STM32G471/473/474/483/484 with 512 KiB as a SlotMemory. Source: RM0440, chapter
/// 3 (embedded flash memory, category 3 devices).
///
/// Code runs in bank 1, which can be read while bank 2 is erased or programmed (read while write): that needs
/// the option DBANK, as it is delivered, and the image below 0x0804'0000. A page of 2 KiB is erased in some
/// 25 ms, a double word of 64 bits is programmed in some 0.1 ms; a second programming of it fails.

#include <span>

#include "hal/flash/access.hpp"
#include "hal/slot_memory.hpp"

namespace esmc::hal::flash {

/// Registers (3.7), offsets in bytes.
namespace g4 {
inline constexpr Word acr = 0x00, keyr = 0x08, sr = 0x10, cr = 0x14, optr = 0x20;
inline constexpr Word acr_dcen = 1U << 10, acr_dcrst = 1U << 12;
inline constexpr Word sr_bsy = 1U << 16;
/// OPTVERR, RDERR, FASTERR, MISERR, PGSERR, SIZERR, PGAERR, WRPERR, PROGERR, OPERR; EOP. One is cleared by
/// writing it. The ones that are left over from before are errors of the next operation as well (PGSERR).
inline constexpr Word sr_errors = 0xC3FAU, sr_eop = 1U;
inline constexpr Word cr_pg = 1U << 0, cr_per = 1U << 1, cr_bker = 1U << 11, cr_strt = 1U << 16,
                      cr_lock = 1U << 31;
inline constexpr unsigned cr_pnb = 3;  // 7 bits
inline constexpr Word optr_bfb2 = 1U << 20, optr_dbank = 1U << 22;
inline constexpr Word bank2 = 0x0804'0000U, page_bytes = 2048;
}  // namespace g4

/// `first_page`: of bank 2; the slots are that page and the next one.
template <Access A, unsigned first_page = 126>
class G4Slots {
 public:
  static_assert(first_page + memory_slots <= 128);
  static constexpr unsigned unit_words = 2;

  explicit G4Slots(const A& access) : a_(access) {}

  /// Two banks, and bank 1 is the one at 0x0800'0000.
  [[nodiscard]] bool available() const {
    return (a_.read(g4::optr) & (g4::optr_dbank | g4::optr_bfb2)) == g4::optr_dbank;
  }

  /// A read of a bank that is being written would halt the processor until it is done: it is not tried.
  [[nodiscard]] bool read(unsigned slot, unsigned at, std::uint32_t& word) {
    if (slot >= memory_slots || at >= g4::page_bytes / 4 || operating_ || busy()) return false;
    return a_.load(address(slot, at), word);
  }

  [[nodiscard]] bool begin_erase(unsigned slot) {
    if (slot >= memory_slots || !open()) return false;
    const Word page = g4::cr_per | g4::cr_bker | ((first_page + slot) << g4::cr_pnb);
    a_.write(g4::cr, page);
    a_.write(g4::cr, page | g4::cr_strt);
    return operating_ = true;
  }

  [[nodiscard]] bool begin_program(unsigned slot, unsigned at,
                                   std::span<const std::uint32_t, unit_words> unit) {
    if (slot >= memory_slots || at % unit_words != 0 || at >= g4::page_bytes / 4 || !open()) return false;
    a_.write(g4::cr, g4::cr_pg);
    a_.store(address(slot, at), unit[0]);
    a_.store(address(slot, at + 1), unit[1]);  // begins it
    return operating_ = true;
  }

  MemoryStatus poll() {
    if (!operating_) return MemoryStatus::ready;
    const Word state = a_.read(g4::sr);
    if ((state & g4::sr_bsy) != 0) return MemoryStatus::busy;
    operating_ = false;
    close();
    return (state & g4::sr_errors) == 0 ? MemoryStatus::ready : MemoryStatus::failed;
  }

 private:
  static constexpr Word address(unsigned slot, unsigned at) {
    return g4::bank2 + (first_page + slot) * g4::page_bytes + 4U * at;
  }
  [[nodiscard]] bool busy() const { return (a_.read(g4::sr) & g4::sr_bsy) != 0; }

  /// Unlocked, without old errors, and without the data cache: it does not see what is erased or programmed,
  /// and ST's own library does the same against "data misbehavior". Until it is done the constants of the
  /// code come at the speed of the flash.
  [[nodiscard]] bool open() {
    if (operating_ || !available() || busy()) return false;
    if ((a_.read(g4::cr) & g4::cr_lock) != 0) {
      a_.write(g4::keyr, key1);
      a_.write(g4::keyr, key2);
    }
    if ((a_.read(g4::cr) & g4::cr_lock) != 0) return false;
    a_.write(g4::acr, a_.read(g4::acr) & ~g4::acr_dcen);
    a_.write(g4::sr, g4::sr_errors | g4::sr_eop);
    return true;
  }
  /// Locked again, so that nothing that runs wild can write; the data cache back, emptied, which it must be
  /// while it is off.
  void close() {
    a_.write(g4::sr, g4::sr_errors | g4::sr_eop);
    a_.write(g4::cr, 0);
    a_.write(g4::cr, g4::cr_lock);
    const Word off = a_.read(g4::acr) & ~g4::acr_dcen;
    a_.write(g4::acr, off | g4::acr_dcrst);
    a_.write(g4::acr, off);
    a_.write(g4::acr, off | g4::acr_dcen);
  }

  A a_;
  bool operating_ = false;
};

}  // namespace esmc::hal::flash
