/// Gains in two slots: equal numbers, numbers half of the range apart, and what lies behind a record.

#include <gtest/gtest.h>

#include "tests/support/slot_store.hpp"

namespace esmc::test {
namespace {

using Memory = SlotMemory<2>;
const Gains baked{40, 40, 150, 300};
static_assert(SlotRecord{1, 2, {3, 4, 5, 6}}.encode()[6] == 0x40C0'0000U);

TEST(SlotEdges, OfTwoEqualNumbersTheFirstSlotCounts) {
  Memory m;
  m.put(0, record(5, baked));
  m.put(1, record(5, baked));
  Store s(m);
  EXPECT_EQ(s.slots.status().used, 1);
  EXPECT_EQ(s.store(), StoreState::stored);
  EXPECT_EQ(m.slots[0][1], 5U);
  EXPECT_EQ(m.slots[1][1], 6U);
}

TEST(SlotEdges, TheOnlyRecordIsSparedWhateverItsNumber) {
  for (const std::uint32_t sequence : {0U, 7U, 0x7FFF'FFFFU, 0x8000'0001U, 0xFFFF'FFF0U}) {
    for (const unsigned at : {0U, 1U}) {
      Memory m;
      m.put(at, record(sequence, baked, 1));
      Store s(m);
      EXPECT_EQ(s.store(), StoreState::stored);
      EXPECT_EQ(m.slots[at][1], sequence);
      EXPECT_EQ(m.slots[1 - at][1], sequence + 1);
    }
  }
}

TEST(SlotEdges, WhatLiesBehindARecordIsNotLookedAt) {
  Memory m;
  m.slots[0][SlotRecord::words] = m.slots[1][SlotRecord::words] = 5;
  Store s(m);
  EXPECT_EQ(s.slots.status().slots[0], SlotContent::empty);
  EXPECT_EQ(s.slots.status().slots[1], SlotContent::empty);
}

TEST(SlotEdges, ARecordThatCannotBeUsedIsSparedAndCounted) {
  struct Case {
    std::uint32_t sequence, scene;
    float lambda;
    SlotContent content;
  };
  for (const auto& [sequence, scene, lambda, content] :
       {Case{7, own_scene, 5, SlotContent::out_of_bounds}, Case{7, 1, 40, SlotContent::other_scene},
        Case{0, 1, 40, SlotContent::other_scene}}) {
    Memory m;
    m.put(0, record(sequence, {lambda, 40, 150, 300}, scene));
    Store s(m);
    EXPECT_FALSE(s.taken);
    EXPECT_EQ(s.slots.status().slots[0], content);
    EXPECT_EQ(s.store(), StoreState::stored);
    EXPECT_EQ(m.slots[0][1], sequence) << "the older record is still there";
    EXPECT_EQ(m.slots[1][1], sequence + 1);
  }
}

TEST(SlotEdges, TheNextNumberIsOneMoreThanThatOfTheRecordInUse) {
  Memory m;
  m.put(0, record(100, baked));
  m.put(1, record(100 + 0x7FFF'FFFFU, baked, 1));  // half of the range ahead
  Store s(m);
  ASSERT_TRUE(s.taken);
  EXPECT_EQ(s.store(), StoreState::stored);
  EXPECT_EQ(m.slots[1][1], 101U);
}

TEST(SlotEdges, AForgetThatFailedDoesNotReachIntoTheNextStore) {
  Memory m;
  m.put(0, record(100, baked));
  m.fails_at = 0;
  Store s(m);
  s.slots.forget();
  s.finish();
  EXPECT_EQ(s.slots.status().state, StoreState::failed);
  EXPECT_EQ(s.store(), StoreState::stored);
  EXPECT_EQ(m.slots[0][1], 100U);
  EXPECT_EQ(m.slots[1][1], 101U);
}

TEST(SlotEdges, AStepThatTheMemoryRefusesIsTheLast) {
  Memory m;
  m.refused_at = 2;  // the second unit of the record
  Store s(m);
  EXPECT_EQ(s.store(), StoreState::failed);
  EXPECT_EQ(m.begun, 2);
}

TEST(SlotEdges, AnOrderAfterATimeOutFailsUntilTheMemoryIsReady) {
  Memory m;
  m.duration = 1000;
  Store s(m);
  EXPECT_EQ(s.store(), StoreState::failed);
  EXPECT_EQ(s.store(), StoreState::failed);
  EXPECT_EQ(m.begun, 1);
  m.duration = 40;
  for (int i = 0; i < 2000; ++i) s.slots.poll();
  EXPECT_EQ(s.slots.status().state, StoreState::failed);
  EXPECT_EQ(s.store(), StoreState::stored) << "with all its time";
}

TEST(SlotEdges, TheSlotsAreToldAtPowerUpBeforeTheStoreIsServed) {
  Memory m;
  m.put(1, record(3, {55, 40, 150, 300}));
  LinkBench b;
  Store s(m);
  restore(b.link, s.slots);
  b.settle();
  EXPECT_EQ(Desk::word(b.desk.last(Desk::slots), 0, 2), 0x0201U) << "idle, the second one in use";
}

TEST(SlotEdges, ALinkAsksForNoPaceOfItsOwn) {
  LinkBench b;
  for (int i = 0; i < 5; ++i) EXPECT_FALSE(b.tick().has_rate);
}

}  // namespace
}  // namespace esmc::test
