#pragma once
/// Interface of a non-volatile memory for two records.

#include <concepts>
#include <cstdint>
#include <span>

namespace esmc::hal {

inline constexpr unsigned memory_slots = 2;
inline constexpr std::uint32_t erased_word = 0xFFFF'FFFFU;

/// State of the operation that was begun.
enum class [[nodiscard]] MemoryStatus : std::uint8_t{
    ready,  ///< none is under way
    busy,
    failed,  ///< returned once per failed operation, then ready
};

/// Memory of two slots, erased one by one and programmed in units of `unit_words` words of 32 bits, each unit
/// once after an erasure. No call waits; a begun operation goes on until poll() no longer returns busy. After
/// a loss of power its slot or unit may read as anything or not at all; the other slot is intact.
template <class M>
concept SlotMemory = requires(M& m, const M& c, unsigned slot, unsigned at, std::uint32_t& word,
                              const std::uint32_t* unit) {
  { M::unit_words } -> std::convertible_to<unsigned>;
  { c.available() } -> std::same_as<bool>;
  // `at`: in words. False: busy, or the word is damaged; `word` is then untouched.
  { m.read(slot, at, word) } -> std::same_as<bool>;
  // False: not begun.
  { m.begin_erase(slot) } -> std::same_as<bool>;
  {
    m.begin_program(slot, at, std::span<const std::uint32_t, M::unit_words>(unit, unit))
    } -> std::same_as<bool>;
  { m.poll() } -> std::same_as<MemoryStatus>;
};

}  // namespace esmc::hal
