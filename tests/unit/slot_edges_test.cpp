/// Gains in two slots: equal numbers, numbers half of the range apart, and what lies behind a record.

#include <gtest/gtest.h>

#include <array>
#include <vector>

#include "firmware/link/parameter_slots.hpp"
#include "tests/support/link_bench.hpp"
#include "tests/support/slot_memory.hpp"

namespace esmc::test {
namespace {

// The table's indices are sent and stored.
constexpr bool counted_from_zero(const std::array<Index, parameter_count>& all) {
  for (unsigned i = 0; i < parameter_count; ++i) {
    if (static_cast<unsigned>(all[i]) != i) return false;
  }
  return true;
}
static_assert(counted_from_zero({Index::lambda_position, Index::lambda_angle, Index::gain_position,
                                 Index::gain_angle, Index::sample_time, Index::torque_limit_1,
                                 Index::torque_limit_2, Index::joint_speed, Index::speed, Index::acceleration,
                                 Index::stream_age, Index::silence}));

using Memory = SlotMemory<2>;
constexpr std::uint32_t ours = 0x89ABCDEFU, other = 1;

std::vector<std::uint32_t> record(std::uint32_t sequence, std::uint32_t scene) {
  const auto w = SlotRecord{sequence, scene, {40, 40, 150, 300}}.encode();
  return {w.begin(), w.end()};
}
ParameterSlots<Memory> loaded(Memory& m) {
  ParameterSlots<Memory> s(m, link_config().parameters, ours, 50);
  (void)s.load();
  return s;
}
void store(ParameterSlots<Memory>& s) {
  s.store(link_config().parameters.gains());
  for (int i = 0; i < 1000 && s.busy(); ++i) s.poll();
  EXPECT_EQ(s.status().state, StoreState::stored);
}

TEST(SlotEdges, OfTwoEqualNumbersTheFirstSlotCounts) {
  Memory m;
  m.put(0, record(5, ours));
  m.put(1, record(5, ours));
  auto s = loaded(m);
  EXPECT_EQ(s.status().used, 1);
  store(s);
  EXPECT_EQ(m.slots[0][1], 5U);
  EXPECT_EQ(m.slots[1][1], 6U);
}

TEST(SlotEdges, TheOnlyRecordIsSparedWhateverItsNumber) {
  for (const std::uint32_t sequence : {0U, 7U, 0x7FFF'FFFFU, 0x8000'0001U, 0xFFFF'FFF0U}) {
    for (const unsigned at : {0U, 1U}) {
      Memory m;
      m.put(at, record(sequence, other));
      auto s = loaded(m);
      store(s);
      EXPECT_EQ(m.slots[at][1], sequence);
      EXPECT_EQ(m.slots[1 - at][1], sequence + 1);
    }
  }
}

TEST(SlotEdges, WhatLiesBehindARecordIsNotLookedAt) {
  Memory m;
  m.slots[0][SlotRecord::words] = m.slots[1][SlotRecord::words] = 5;
  auto s = loaded(m);
  EXPECT_EQ(s.status().slots[0], SlotContent::empty);
  EXPECT_EQ(s.status().slots[1], SlotContent::empty);
}

TEST(SlotEdges, ALinkAsksForNoPaceOfItsOwn) {
  LinkBench b;
  for (int i = 0; i < 5; ++i) EXPECT_FALSE(b.tick().has_rate);
}

}  // namespace
}  // namespace esmc::test
