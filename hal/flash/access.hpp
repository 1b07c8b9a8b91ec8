#pragma once
/// What the drivers of this folder need of a processor.

#include <concepts>
#include <cstdint>

namespace esmc::hal::flash {

using Word = std::uint32_t;

/// On a board the addresses, in a test a model of what is there.
template <class A>
concept Access = requires(A& a, const A& c, Word at, Word value, Word& word) {
  { c.read(at) } -> std::same_as<Word>;  // register at a byte offset from the flash interface
  a.write(at, value);
  // A word of the memory. False: its error correction gave up (two bits), which on these chips is an
  // exception: the board sees to it that it is none here. A word whose programming was cut short may read
  // like that for ever.
  { a.load(at, word) } -> std::same_as<bool>;
  a.store(at, value);  // into the memory, not merged with others and not put off
};

inline constexpr Word key1 = 0x4567'0123U, key2 = 0xCDEF'89ABU;

}  // namespace esmc::hal::flash
