#pragma once
/// Two sectors of bank 2 of an STM32H742/743/753 with 2 MiB as a SlotMemory. Source: RM0433, chapter 4
/// (embedded flash memory).
///
/// Each bank has an interface of its own, and bank 1, in which the code runs, is read while bank 2 is erased
/// or programmed (read while write, 4.3). A sector of 128 KiB is erased in one to four seconds, a flash word
/// of 256 bits is programmed in some 0.2 ms, whole, and once: its error correction is over all of it.

#include <span>

#include "hal/flash/access.hpp"
#include "hal/slot_memory.hpp"

namespace esmc::hal::flash {

/// Registers of bank 2 (4.9), offsets in bytes.
namespace h7 {
inline constexpr Word optcr = 0x18, keyr2 = 0x104, cr2 = 0x10C, sr2 = 0x110, ccr2 = 0x114;
inline constexpr Word optcr_swap_bank = 1U << 31;
inline constexpr Word cr_lock = 1U << 0, cr_pg = 1U << 1, cr_ser = 1U << 2, cr_start = 1U << 7;
inline constexpr Word cr_psize = 3U << 4;  // 64 bits at a time: 1.8 V and more
inline constexpr unsigned cr_snb = 8;      // 3 bits
inline constexpr Word sr_bsy = 1U << 0, sr_wbne = 1U << 1, sr_qw = 1U << 2;
/// WRPERR, PGSERR, STRBERR, INCERR, OPERR. The others are of reads.
inline constexpr Word sr_errors = (1U << 17) | (1U << 18) | (1U << 19) | (1U << 21) | (1U << 22);
/// CCR2: EOP and all errors, those of reads too: RDPERR, RDSERR, SNECCERR, DBECCERR, CRCEND.
inline constexpr Word ccr_all = 0x0FEF'0000U;
inline constexpr Word bank2 = 0x0810'0000U, sector_bytes = 128 * 1024;
}  // namespace h7

/// `first_sector`: of bank 2; the slots are that sector and the next one.
template <Access A, unsigned first_sector = 6>
class H7Slots {
 public:
  static_assert(first_sector + memory_slots <= 8);
  static constexpr unsigned unit_words = 8;

  explicit H7Slots(const A& access) : a_(access) {}

  /// Bank 1 is the one at 0x0800'0000.
  [[nodiscard]] bool available() const { return (a_.read(h7::optcr) & h7::optcr_swap_bank) == 0; }

  /// A read of a bank that is being written would halt the processor until it is done: it is not tried.
  [[nodiscard]] bool read(unsigned slot, unsigned at, std::uint32_t& word) {
    if (slot >= memory_slots || at >= h7::sector_bytes / 4 || operating_ || busy()) return false;
    return a_.load(address(slot, at), word);
  }

  [[nodiscard]] bool begin_erase(unsigned slot) {
    if (slot >= memory_slots || !open()) return false;
    const Word sector = h7::cr_ser | h7::cr_psize | ((first_sector + slot) << h7::cr_snb);
    a_.write(h7::cr2, sector);
    a_.write(h7::cr2, sector | h7::cr_start);
    return operating_ = true;
  }

  [[nodiscard]] bool begin_program(unsigned slot, unsigned at,
                                   std::span<const std::uint32_t, unit_words> unit) {
    if (slot >= memory_slots || at % unit_words != 0 || at >= h7::sector_bytes / 4 || !open()) return false;
    a_.write(h7::cr2, h7::cr_pg | h7::cr_psize);
    for (unsigned i = 0; i < unit_words; ++i)
      a_.store(address(slot, at + i), unit[i]);  // the last one begins it
    return operating_ = true;
  }

  MemoryStatus poll() {
    if (!operating_) return MemoryStatus::ready;
    const Word state = a_.read(h7::sr2);
    if ((state & (h7::sr_bsy | h7::sr_qw)) != 0) return MemoryStatus::busy;
    operating_ = false;
    close();
    // Words that still wait in the write buffer were not all of a flash word.
    return (state & (h7::sr_errors | h7::sr_wbne)) == 0 ? MemoryStatus::ready : MemoryStatus::failed;
  }

 private:
  static constexpr Word address(unsigned slot, unsigned at) {
    return h7::bank2 + (first_sector + slot) * h7::sector_bytes + 4U * at;
  }
  [[nodiscard]] bool busy() const { return (a_.read(h7::sr2) & (h7::sr_bsy | h7::sr_qw)) != 0; }

  /// Unlocked, and without old errors: with one of them set nothing is begun (PGSERR).
  [[nodiscard]] bool open() {
    if (operating_ || !available() || busy() || (a_.read(h7::sr2) & h7::sr_wbne) != 0) return false;
    if ((a_.read(h7::cr2) & h7::cr_lock) != 0) {
      a_.write(h7::keyr2, key1);
      a_.write(h7::keyr2, key2);
    }
    if ((a_.read(h7::cr2) & h7::cr_lock) != 0) return false;
    a_.write(h7::ccr2, h7::ccr_all);
    return true;
  }
  /// Locked again, so that nothing that runs wild can write.
  void close() {
    a_.write(h7::ccr2, h7::ccr_all);
    a_.write(h7::cr2, h7::cr_psize);
    a_.write(h7::cr2, h7::cr_psize | h7::cr_lock);
  }

  A a_;
  bool operating_ = false;
};

}  // namespace esmc::hal::flash
