#pragma once
/// What the firmware needs of a memory that keeps two records without power.

#include <concepts>
#include <cstdint>
#include <span>

namespace esmc::hal {

inline constexpr unsigned memory_slots = 2;
inline constexpr std::uint32_t erased_word = 0xFFFF'FFFFU;

/// What became of an operation.
enum class [[nodiscard]] MemoryStatus : std::uint8_t{
    ready, busy,
    failed,  ///< said once of an operation, then ready
};

/// Two slots that are erased one by one and programmed in units of `unit_words` words of 32 bits, each unit
/// once after an erasure. No call waits; an operation that was begun goes on by itself until poll() no longer
/// says busy. Where the power goes during an operation its slot, or its unit, may read as anything or not at
/// all; the other slot is as it was.
template <class M>
concept SlotMemory = requires(M& m, const M& c, unsigned slot, unsigned at, std::uint32_t& word,
                              const std::uint32_t* unit) {
  { M::unit_words } -> std::convertible_to<unsigned>;
  { c.available() } -> std::same_as<bool>;
  // `at`: in words. False: cannot be read, for it is busy or the word is damaged; `word` is then untouched.
  { m.read(slot, at, word) } -> std::same_as<bool>;
  // False: not begun.
  { m.begin_erase(slot) } -> std::same_as<bool>;
  {
    m.begin_program(slot, at, std::span<const std::uint32_t, M::unit_words>(unit, M::unit_words))
    } -> std::same_as<bool>;
  { m.poll() } -> std::same_as<MemoryStatus>;
};

}  // namespace esmc::hal
