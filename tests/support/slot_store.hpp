#pragma once
/// A store of gains on a memory of a test: what it took at power-up, and orders carried out to their end.

#include <optional>
#include <vector>

#include "firmware/link/parameter_slots.hpp"
#include "tests/support/link_bench.hpp"
#include "tests/support/slot_memory.hpp"

namespace esmc::test {

inline constexpr std::uint32_t own_scene = 0x89ABCDEFU;  ///< of link_config()

inline std::vector<std::uint32_t> record(std::uint32_t sequence, const Gains& g,
                                         std::uint32_t of = own_scene) {
  const auto w = SlotRecord{sequence, of, g}.encode();
  return {w.begin(), w.end()};
}

template <class Memory>
struct Store {
  explicit Store(Memory& m, std::uint32_t of = own_scene)
      : slots(m, link_config().parameters, of, 50), taken(slots.load()) {}
  /// How many polls it took.
  int finish() {
    int n = 0;
    for (; slots.busy() && n < 10'000; ++n) slots.poll();
    return n;
  }
  StoreState store(const Gains& g = link_config().parameters.gains()) {
    slots.store(g);
    finish();
    return slots.status().state;
  }
  [[nodiscard]] std::vector<SlotContent> contents() const {
    return {slots.status().slots[0], slots.status().slots[1]};
  }
  ParameterSlots<Memory> slots;
  std::optional<Gains> taken;
};

}  // namespace esmc::test
