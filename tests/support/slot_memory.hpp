#pragma once
/// A memory of two slots whose operations take polls, fail, and are cut short by losses of power.

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "hal/slot_memory.hpp"

namespace esmc::test {

/// What is read of a unit or a slot whose operation was cut short.
enum class Torn { unreadable, as_before, as_after, half_the_words, half_the_bits };

template <unsigned unit>
struct SlotMemory {
  static constexpr unsigned unit_words = unit, words = 16;
  using Slot = std::array<std::uint32_t, words>;

  std::array<Slot, 2> slots{filled(~0U), filled(~0U)};
  std::array<std::array<bool, words>, 2> unreadable{}, programmed{};
  std::vector<std::string> wrong{};
  bool usable = true;
  int duration = 2;     ///< polls that an operation is busy
  int fails_at = -1;    ///< the operation with this number does nothing and says failed
  int refused_at = -1;  ///< is not begun the first time
  int flips_at = -1;    ///< programs another word, number flips_word of the unit, and says nothing
  unsigned flips_word = 0;
  int rots_at = -1;  ///< what it programs cannot be read, and it says nothing
  int begun = 0;

  static Slot filled(std::uint32_t w) {
    Slot s{};
    s.fill(w);
    return s;
  }
  void put(unsigned slot, const std::vector<std::uint32_t>& record) {
    for (unsigned i = 0; i < record.size(); ++i) {
      slots[slot][i] = record[i];
      programmed[slot][i] = true;
    }
  }
  void lose_power(Torn how) {
    if (busy_ > 0) {
      for (unsigned i = from_; i < to_; ++i) {
        std::uint32_t& w = slots[slot_][i];
        const std::uint32_t after = next_[i - from_];
        if (how != Torn::as_before) unreadable[slot_][i] = how == Torn::unreadable;
        programmed[slot_][i] = true;
        if (how == Torn::as_after || (how == Torn::half_the_words && i % 2 == 0)) w = after;
        if (how == Torn::half_the_bits) w = (w & 0xAAAA'AAAAU) | (after & 0x5555'5555U);
      }
    }
    busy_ = 0;
    failed_ = false;
  }

  // --- hal::SlotMemory
  [[nodiscard]] bool available() const { return usable; }
  [[nodiscard]] bool read(unsigned slot, unsigned at, std::uint32_t& word) {
    if (slot > 1 || at >= words) wrong.emplace_back("reads outside");
    if (busy_ > 0 || unreadable.at(slot).at(at)) return false;
    word = slots[slot][at];
    return true;
  }
  [[nodiscard]] bool begin_erase(unsigned slot) {
    if (!begin(slot, 0, words)) return false;
    next_.assign(words, ~0U);
    erases_ = true;
    return true;
  }
  [[nodiscard]] bool begin_program(unsigned slot, unsigned at, std::span<const std::uint32_t, unit> u) {
    if (at % unit != 0) wrong.emplace_back("not a unit");
    if (!begin(slot, at, at + unit)) return false;
    for (unsigned i = at; i < at + unit; ++i) {
      if (programmed.at(slot).at(i)) wrong.emplace_back("programs what is not erased");
    }
    next_.assign(u.begin(), u.end());
    if (begun - 1 == flips_at) next_[flips_word] ^= 0x100U;
    erases_ = false;
    return true;
  }
  hal::MemoryStatus poll() {
    if (busy_ > 0) {
      if (duration < 1000) --busy_;
      if (busy_ > 0) return hal::MemoryStatus::busy;
      finish();
    }
    const bool failed = failed_;
    failed_ = false;
    return failed ? hal::MemoryStatus::failed : hal::MemoryStatus::ready;
  }

 private:
  bool begin(unsigned slot, unsigned from, unsigned to) {
    if (busy_ > 0) return false;
    if (begun == refused_at) {
      refused_at = -1;
      return false;
    }
    if (slot > 1 || to > words) wrong.emplace_back("writes outside");
    ++begun;
    slot_ = slot;
    from_ = from;
    to_ = to;
    busy_ = duration + 1;
    return true;
  }
  void finish() {
    if (begun - 1 == fails_at) {
      failed_ = true;
      return;
    }
    for (unsigned i = from_; i < to_; ++i) {
      slots[slot_][i] = next_[i - from_];
      unreadable[slot_][i] = begun - 1 == rots_at;
      programmed[slot_][i] = !erases_;
    }
  }

  std::vector<std::uint32_t> next_{};
  unsigned slot_ = 0, from_ = 0, to_ = 0;
  int busy_ = 0;
  bool erases_ = false, failed_ = false;
};
static_assert(hal::SlotMemory<SlotMemory<2>> && hal::SlotMemory<SlotMemory<8>>);

}  // namespace esmc::test
