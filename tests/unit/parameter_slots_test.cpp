/// Gains in two slots: what is taken at power-up and what is not, losses of power at every step, memories
/// that fail.

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <limits>
#include <vector>

#include "tests/support/slot_store.hpp"

namespace esmc::test {
namespace {

const Gains older{50, 41, 100, 300}, newer{60, 42, 120, 300}, wanted{70, 43, 90, 300};

/// With the checksum right whatever else is not.
std::vector<std::uint32_t> sealed(std::vector<std::uint32_t> w) {
  std::vector<std::uint8_t> bytes;
  for (std::size_t i = 0; i + 1 < w.size(); ++i) {
    for (unsigned k = 0; k < 4; ++k) bytes.push_back(static_cast<std::uint8_t>(w[i] >> (8 * k)));
  }
  w.back() = crc32(bytes);
  return w;
}

template <class M>
struct Slots : testing::Test {
  M nvm;
  ~Slots() override {
    for (const std::string& w : nvm.wrong) ADD_FAILURE() << w;
  }
};
using Memories = testing::Types<SlotMemory<2>, SlotMemory<8>>;
TYPED_TEST_SUITE(Slots, Memories);
using Contents = std::vector<SlotContent>;

TYPED_TEST(Slots, ARecordWordByWord) {
  // Checksums by another program, zlib's.
  const std::vector<std::uint32_t> seven{0x45534D01, 7,          0x89ABCDEF, 0x425E0000,
                                         0x42200000, 0x43160000, 0x43960000, 0x27074A0F};
  this->nvm.put(1, seven);
  Store s(this->nvm);
  EXPECT_EQ(s.taken, (Gains{55.5F, 40, 150, 300}));
  EXPECT_EQ(s.slots.status().used, 2);
  EXPECT_EQ(s.slots.status().sequence, 7U);
  s.store({20, 30, 100, 300});
  const std::vector<std::uint32_t> eight{0x45534D01, 8,          0x89ABCDEF, 0x41A00000,
                                         0x41F00000, 0x42C80000, 0x43960000, 0xA897C34C};
  EXPECT_EQ(std::vector<std::uint32_t>(this->nvm.slots[0].begin(), this->nvm.slots[0].begin() + 8), eight);
  EXPECT_EQ(std::vector<std::uint32_t>(this->nvm.slots[1].begin(), this->nvm.slots[1].begin() + 8), seven);
}

TYPED_TEST(Slots, AnEmptyMemoryTakesTheFirstRecordAndThenTurnAbout) {
  Store first(this->nvm);
  EXPECT_FALSE(first.taken);
  EXPECT_EQ(first.slots.status(), (StoreStatus{.state = StoreState::idle}));
  for (std::uint32_t n = 1; n <= 5; ++n) {
    const Gains g{10 + static_cast<float>(n), 40, 150, 300};
    first.slots.store(g);
    EXPECT_EQ(first.slots.status().state, StoreState::storing);
    first.finish();
    EXPECT_EQ(first.slots.status().state, StoreState::stored);
    EXPECT_EQ(first.slots.status().used, 0) << "at power-up it was none";
    EXPECT_EQ(first.slots.status().sequence, n);
    Store again(this->nvm);
    EXPECT_EQ(again.taken, g);
    EXPECT_EQ(again.slots.status().used, 1 + (n + 1) % 2);
    EXPECT_EQ(again.contents(),
              (Contents{SlotContent::valid, n == 1 ? SlotContent::empty : SlotContent::valid}));
  }
}

TYPED_TEST(Slots, TheNewestCountsAlsoWhereNumbersGoRound) {
  for (const std::uint32_t n : {1U, 0x7FFF'FFFFU, 0x8000'0000U, 0xFFFF'FFFFU}) {
    for (unsigned in = 0; in < 2; ++in) {
      TypeParam memory;
      memory.put(in, record(n + 1, newer));
      memory.put(1 - in, record(n, older));
      Store s(memory);
      EXPECT_EQ(s.taken, newer) << n;
      EXPECT_EQ(s.slots.status().used, in + 1);
      EXPECT_EQ(s.slots.status().sequence, n + 1);
      s.store(wanted);
      Store after(memory);
      EXPECT_EQ(after.taken, wanted) << n;
      EXPECT_EQ(after.slots.status().sequence, n + 2);
      EXPECT_EQ(after.slots.status().used, 2 - in);
    }
  }
}

TYPED_TEST(Slots, WithoutAStoreNothingHappens) {
  this->nvm.put(0, record(1, newer));
  Store unknown(this->nvm, 0);
  EXPECT_FALSE(unknown.taken);
  this->nvm.usable = false;
  Store unavailable(this->nvm);
  EXPECT_FALSE(unavailable.taken);
  for (Store<TypeParam>* s : {&unknown, &unavailable}) {
    s->slots.store(wanted);
    s->slots.forget();
    EXPECT_FALSE(s->slots.busy());
    s->slots.poll();
    EXPECT_EQ(s->slots.status(), StoreStatus{});
  }
  EXPECT_EQ(this->nvm.begun, 0);
}

TYPED_TEST(Slots, WhatIsWrongIsIgnoredAsAWhole) {
  constexpr float inf = std::numeric_limits<float>::infinity();
  struct Case {
    const char* what;
    std::vector<std::uint32_t> words;
    SlotContent content;
  };
  const auto changed = [](std::size_t i, std::uint32_t v) {
    auto w = record(9, newer);
    w[i] = v;
    return w;
  };
  const auto gain = [&](std::size_t i, float v) {
    return sealed(changed(3 + i, std::bit_cast<std::uint32_t>(v)));
  };
  const std::vector<Case> cases{
      {"mark", sealed(changed(0, 0x45534E01)), SlotContent::damaged},
      {"zeros", std::vector<std::uint32_t>(8, 0), SlotContent::damaged},
      {"format", sealed(changed(0, 0x45534D02)), SlotContent::other_format},
      {"format 0", sealed(changed(0, 0x45534D00)), SlotContent::other_format},
      {"sum", changed(7, 0), SlotContent::damaged},
      {"sequence without sum", changed(1, 10), SlotContent::damaged},
      {"scene", record(9, newer, own_scene + 1), SlotContent::other_scene},
      {"scene 0", record(9, newer, 0), SlotContent::other_scene},
      {"below", gain(0, std::nextafter(10.0F, 0.0F)), SlotContent::out_of_bounds},
      {"above", gain(1, std::nextafter(80.0F, 100.0F)), SlotContent::out_of_bounds},
      {"the last writable one", gain(2, 200.1F), SlotContent::out_of_bounds},
      {"nan", gain(2, std::nanf("")), SlotContent::out_of_bounds},
      {"infinite", gain(0, inf), SlotContent::out_of_bounds},
      {"minus infinite", gain(2, -inf), SlotContent::out_of_bounds},
      {"not writable", gain(3, std::nextafter(300.0F, 0.0F)), SlotContent::out_of_bounds},
      {"not writable, nan", gain(3, std::nanf("")), SlotContent::out_of_bounds},
      {"on the bounds", sealed(record(9, {10, 80, 0, 300})), SlotContent::valid},
  };
  for (const Case& c : cases) {
    for (const bool with_older : {false, true}) {
      TypeParam memory;
      memory.put(1, c.words);
      if (with_older) memory.put(0, record(8, older));
      Store s(memory);
      const bool valid = c.content == SlotContent::valid;
      EXPECT_EQ(s.contents()[1], c.content) << c.what;
      EXPECT_EQ(s.taken.has_value(), valid || with_older) << c.what;
      if (!valid && with_older) {
        EXPECT_EQ(s.taken, older) << c.what;
      }
      EXPECT_EQ(s.slots.status().used, valid ? 2 : with_older ? 1 : 0) << c.what;
    }
  }
}

TYPED_TEST(Slots, EveryFlippedBitIsFoundAndEveryUnreadableWord) {
  for (unsigned bit = 0; bit < 256; ++bit) {
    auto w = record(9, newer);
    w[bit / 32] ^= 1U << (bit % 32);
    TypeParam memory;
    memory.put(0, w);
    EXPECT_FALSE(Store(memory).taken) << bit;
  }
  for (unsigned i = 0; i < 8; ++i) {
    TypeParam memory;
    memory.put(0, record(9, newer));
    memory.unreadable[0][i] = true;
    Store s(memory);
    EXPECT_FALSE(s.taken);
    EXPECT_EQ(s.contents()[0], SlotContent::damaged);
    // Not even where the word would have been 0.
    TypeParam zeros;
    zeros.put(0, record(0, {60, 42, 0, 300}));
    EXPECT_EQ(Store(zeros).contents()[0], SlotContent::valid);
    zeros.unreadable[0][i] = true;
    EXPECT_EQ(Store(zeros).contents()[0], SlotContent::damaged) << i;
    TypeParam blank;
    blank.unreadable[1][i] = true;
    EXPECT_EQ(Store(blank).contents()[1], SlotContent::damaged) << "not taken for an empty one";
  }
}

TYPED_TEST(Slots, BothBadLeavesTheBakedOnesAndCanBeMended) {
  this->nvm.put(0, record(9, newer, own_scene + 1));
  this->nvm.put(1, std::vector<std::uint32_t>(8, 0x1234'5678U));
  Store s(this->nvm);
  EXPECT_FALSE(s.taken);
  EXPECT_EQ(s.contents(), (Contents{SlotContent::other_scene, SlotContent::damaged}));
  EXPECT_EQ(s.slots.status().sequence, 0U);
  s.store(wanted);
  EXPECT_EQ(s.slots.status().sequence, 10U) << "newer than that of the other scene";
  EXPECT_EQ(s.contents(), (Contents{SlotContent::other_scene, SlotContent::valid}));
  EXPECT_EQ(Store(this->nvm, own_scene + 1).taken, newer) << "whose image finds its own";
}

TYPED_TEST(Slots, TheRecordThatCountsIsSparedWhateverItsNumber) {
  for (unsigned in = 0; in < 2; ++in) {
    TypeParam memory;
    memory.put(in, record(4, newer));
    memory.put(1 - in, record(9, older, own_scene + 1));
    Store s(memory);
    EXPECT_EQ(s.taken, newer);
    s.store(wanted);
    EXPECT_EQ(s.contents(), (Contents{SlotContent::valid, SlotContent::valid}));
    EXPECT_EQ(s.slots.status().sequence, 10U);
    EXPECT_EQ(memory.slots[in][1], 4U);
  }
  // What is not whole has no number.
  TypeParam memory;
  memory.put(0, record(0xFFFF'FFF0U, newer));
  memory.put(1, std::vector<std::uint32_t>(8, 0));
  Store s(memory);
  s.store(wanted);
  EXPECT_EQ(s.slots.status().sequence, 0xFFFF'FFF1U);
}

TYPED_TEST(Slots, OfTwoOtherScenesTheOlderOneIsGivenUp) {
  for (unsigned in = 0; in < 2; ++in) {
    TypeParam memory;
    memory.put(in, record(4, newer, 1));
    memory.put(1 - in, record(3, older, 2));
    Store s(memory);
    s.store(wanted);
    EXPECT_EQ(s.contents()[in], SlotContent::other_scene);
    EXPECT_EQ(s.contents()[1 - in], SlotContent::valid);
    EXPECT_EQ(s.slots.status().sequence, 5U);
  }
}

constexpr Torn ways[] = {Torn::unreadable, Torn::as_before, Torn::as_after, Torn::half_the_words,
                         Torn::half_the_bits};

TYPED_TEST(Slots, PowerLostAtAnyStepOfStoringLeavesTheOldRecordOrTheNewOne) {
  int seen_old = 0, seen_new = 0;
  for (const Torn how : ways) {
    for (unsigned in = 0; in < 2; ++in) {
      for (const bool both : {false, true}) {
        const auto fresh = [&] {
          TypeParam memory;
          memory.put(in, record(6, newer));
          if (both) memory.put(1 - in, record(5, older));
          return memory;
        };
        TypeParam undisturbed = fresh();
        Store whole(undisturbed);
        whole.slots.store(wanted);
        const int polls = whole.finish();
        ASSERT_GT(polls, 8);
        for (int cut = 0; cut <= polls; ++cut) {
          TypeParam memory = fresh();
          {
            Store s(memory);
            s.slots.store(wanted);
            for (int i = 0; i < cut; ++i) s.slots.poll();
            memory.lose_power(how);
          }
          Store after(memory);
          ASSERT_TRUE(after.taken == newer || after.taken == wanted) << "cut after " << cut;
          ++(after.taken == newer ? seen_old : seen_new);
          if (cut == polls) {
            EXPECT_EQ(after.taken, wanted);
          }
          // And whatever lies there is no obstacle.
          EXPECT_EQ(after.store(older), StoreState::stored);
          EXPECT_EQ(Store(memory).taken, older);
          ASSERT_EQ(memory.wrong.size(), 0U) << memory.wrong[0];
        }
      }
    }
  }
  EXPECT_GT(seen_old, 50);
  EXPECT_GT(seen_new, 20);
}

TYPED_TEST(Slots, PowerLostAtAnyStepOfForgettingDoesNotBringAnOlderOneBack) {
  int seen_none = 0, seen_newer = 0;
  for (const Torn how : ways) {
    for (unsigned in = 0; in < 2; ++in) {
      for (int cut = 0; cut < 60; ++cut) {
        TypeParam memory;
        memory.put(in, record(6, newer));
        memory.put(1 - in, record(5, older));
        {
          Store s(memory);
          s.slots.forget();
          for (int i = 0; i < cut; ++i) s.slots.poll();
          memory.lose_power(how);
        }
        Store after(memory);
        ASSERT_TRUE(!after.taken || after.taken == newer) << cut;
        ++(after.taken ? seen_newer : seen_none);
      }
    }
  }
  EXPECT_GT(seen_none, 50);
  EXPECT_GT(seen_newer, 50);
}

TYPED_TEST(Slots, ForgettingLeavesBothEmpty) {
  this->nvm.put(0, record(6, newer));
  this->nvm.put(1, record(5, older, own_scene + 1));
  Store s(this->nvm);
  s.slots.forget();
  EXPECT_EQ(s.slots.status().state, StoreState::forgetting);
  s.finish();
  EXPECT_EQ(s.slots.status(), (StoreStatus{.state = StoreState::forgotten, .used = 1}));
  EXPECT_FALSE(Store(this->nvm).taken);
  s.store(wanted);
  EXPECT_EQ(s.contents(), (Contents{SlotContent::valid, SlotContent::empty}))
      << "none of them is to be spared any more";
  EXPECT_EQ(Store(this->nvm).taken, wanted);
}

TYPED_TEST(Slots, OneStepPerPollAndOneOrderAtATime) {
  this->nvm.put(0, record(6, newer));
  Store s(this->nvm);
  s.slots.store(wanted);
  for (int n = 0; s.slots.busy() && n < 1000; ++n) {
    const int before = this->nvm.begun;
    s.slots.poll();
    EXPECT_LE(this->nvm.begun, before + 1);
    if (!s.slots.busy()) break;
    s.slots.store(older);
    s.slots.forget();
    EXPECT_LE(this->nvm.begun, before + 1);
  }
  EXPECT_EQ(this->nvm.begun, 1 + 8 / static_cast<int>(TypeParam::unit_words));
  EXPECT_EQ(Store(this->nvm).taken, wanted);
}

TYPED_TEST(Slots, AMemoryThatFailsIsToldAndTheOldRecordStays) {
  const int operations = 1 + 8 / static_cast<int>(TypeParam::unit_words);
  for (int kind = 0; kind < 5; ++kind) {
    for (int n = 0; n < operations; ++n) {
      TypeParam memory;
      memory.put(0, record(6, newer));
      memory.put(1, record(5, older));
      if (kind >= 2 && n == 0) continue;
      memory.flips_word = kind == 2 ? 0 : TypeParam::unit_words - 1;
      const std::array member{&TypeParam::fails_at, &TypeParam::refused_at, &TypeParam::flips_at,
                              &TypeParam::flips_at, &TypeParam::rots_at};
      memory.*member.at(static_cast<unsigned>(kind)) = n;
      Store s(memory);
      EXPECT_EQ(s.store(wanted), StoreState::failed) << kind << ' ' << n;
      EXPECT_EQ(s.slots.status().sequence, 6U);
      EXPECT_EQ(s.contents()[0], SlotContent::valid);
      EXPECT_EQ(Store(memory).taken, newer);
      memory.fails_at = memory.refused_at = memory.flips_at = memory.rots_at = -1;
      EXPECT_EQ(s.store(wanted), StoreState::stored) << "another time";
      EXPECT_EQ(Store(memory).taken, wanted);
      EXPECT_TRUE(memory.wrong.empty()) << kind << ' ' << n << ' ' << memory.wrong[0];
    }
  }
  // An erasure that does nothing and says that it has.
  TypeParam memory;
  memory.put(0, record(6, newer));
  memory.put(1, record(5, older));
  memory.unreadable[1][7] = true;
  memory.fails_at = 0;
  Store s(memory);
  s.slots.forget();
  s.finish();
  EXPECT_EQ(s.slots.status().state, StoreState::failed);
  EXPECT_EQ(s.contents(), (Contents{SlotContent::valid, SlotContent::damaged}));
}

TYPED_TEST(Slots, AMemoryThatStaysBusyIsNotWaitedForForEver) {
  this->nvm.put(0, record(6, newer));
  Store s(this->nvm);
  this->nvm.duration = 1000;
  s.slots.store(wanted);
  EXPECT_EQ(s.finish(), 1 + 51) << "one begins it, and 50 may be busy";
  EXPECT_EQ(s.slots.status().state, StoreState::failed);
  EXPECT_EQ(s.contents(), (Contents{SlotContent::damaged, SlotContent::damaged})) << "it cannot be read";
  // And if it ends after all, there is another chance.
  EXPECT_EQ(s.store(wanted), StoreState::failed) << "not yet";
  this->nvm.duration = 2;
  for (int i = 0; i < 1100; ++i) s.slots.poll();
  EXPECT_EQ(s.store(wanted), StoreState::stored);
  EXPECT_EQ(Store(this->nvm).taken, wanted);
  // Each operation has its own time.
  TypeParam slow;
  slow.duration = 40;
  Store t(slow);
  EXPECT_EQ(t.store(wanted), StoreState::stored);
}

TYPED_TEST(Slots, AfterWhatWasGivenUpTheRecordThatCountsIsStillSpared) {
  for (unsigned in = 0; in < 2; ++in) {
    for (int cut = 0; cut < 40; ++cut) {
      TypeParam memory;
      memory.put(in, record(6, newer));
      memory.put(1 - in, record(5, older));
      Store s(memory);
      memory.duration = 60;
      s.store(wanted);
      ASSERT_EQ(s.slots.status().state, StoreState::failed);
      const int begun = memory.begun;
      s.slots.store(wanted);
      EXPECT_FALSE(s.slots.busy()) << "nobody knows which slot that would be";
      EXPECT_EQ(s.slots.status().state, StoreState::failed);
      memory.duration = 2;
      for (int i = 0; i < 100; ++i) s.slots.poll();
      EXPECT_EQ(memory.begun, begun);
      EXPECT_EQ(s.contents()[in], SlotContent::valid) << "it was looked at again";
      EXPECT_EQ(s.contents()[1 - in], SlotContent::empty);
      EXPECT_EQ(s.slots.status().sequence, 6U);
      s.slots.store(wanted);
      for (int i = 0; i < cut; ++i) s.slots.poll();
      const bool stored = s.slots.status().state == StoreState::stored;
      memory.lose_power(Torn::unreadable);
      const auto taken = Store(memory).taken;
      ASSERT_TRUE(taken == wanted || (!stored && taken == newer)) << cut;
    }
  }
}

TYPED_TEST(Slots, WhatIsStoredIsLaterThanTheRecordThatCountsWhateverAnotherScenesNumber) {
  for (unsigned in = 0; in < 2; ++in) {
    TypeParam memory;
    memory.put(in, record(5U + 0x8000'0001U, newer));
    memory.put(1 - in, record(5, older, own_scene + 1));
    Store s(memory);
    ASSERT_EQ(s.taken, newer);
    EXPECT_EQ(s.store(wanted), StoreState::stored);
    EXPECT_EQ(Store(memory).taken, wanted) << in;
  }
}

TYPED_TEST(Slots, ARecordThatFailedOnlyAtTheEndIsToldAsItIs) {
  // All of it was programmed, and then the memory reported an error: the next power-up will take it.
  this->nvm.put(0, record(6, newer));
  this->nvm.put(1, record(7, wanted));
  Store s(this->nvm);
  this->nvm.fails_at = 0;
  EXPECT_EQ(s.store(older), StoreState::failed);
  EXPECT_EQ(s.slots.status().sequence, 7U);
  EXPECT_EQ(s.contents(), (Contents{SlotContent::valid, SlotContent::valid}));
}

}  // namespace
}  // namespace esmc::test
