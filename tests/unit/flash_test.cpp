/// The drivers of the flash of STM32G4 and H7 against a model of it at register level, alone and under the
/// slots of parameters.

#include <gtest/gtest.h>

#include <array>
#include <optional>
#include <span>

#include "firmware/link/parameter_slots.hpp"
#include "hal/flash/bank_slots.hpp"
#include "tests/support/flash_model.hpp"
#include "tests/support/link_bench.hpp"

namespace esmc::test {
namespace {

using hal::MemoryStatus;
using G4 = hal::flash::G4Slots<FlashModelAccess>;
using H7 = hal::flash::H7Slots<FlashModelAccess>;
static_assert(hal::SlotMemory<G4> && hal::SlotMemory<H7>);

template <class Driver>
struct Flash : testing::Test {
  static constexpr unsigned unit = Driver::unit_words;
  static constexpr bool g4 = std::is_same_v<Driver, G4>;
  FlashModel model{g4 ? FlashModel::Chip::g4 : FlashModel::Chip::h7};
  Driver flash{FlashModelAccess{&model}};

  ~Flash() override {
    for (const std::string& w : model.wrong) ADD_FAILURE() << w;
  }
  static std::array<std::uint32_t, unit> pattern(std::uint32_t seed) {
    std::array<std::uint32_t, unit> u{};
    for (unsigned i = 0; i < unit; ++i) u[i] = seed + 0x0101'0101U * i;
    return u;
  }
  bool program(unsigned slot, unsigned at, std::uint32_t seed) {
    const auto u = pattern(seed);
    return flash.begin_program(slot, at, u);
  }
  MemoryStatus wait() {
    for (int i = 0; i < 100; ++i) {
      if (const MemoryStatus s = flash.poll(); s != MemoryStatus::busy) return s;
    }
    return MemoryStatus::busy;
  }
};
using Drivers = testing::Types<G4, H7>;
TYPED_TEST_SUITE(Flash, Drivers);

TYPED_TEST(Flash, ProgramsUnitsAndReadsThemWhereTheyAre) {
  for (unsigned slot = 0; slot < 2; ++slot) {
    for (unsigned at = 0; at < 16; at += TypeParam::unit_words) {
      ASSERT_TRUE(this->program(slot, at, 1000 * slot + at));
      EXPECT_EQ(this->flash.poll(), MemoryStatus::busy);
      ASSERT_EQ(this->wait(), MemoryStatus::ready);
      EXPECT_TRUE(this->model.at_rest());
    }
    for (unsigned at = 0; at < 16; ++at) {
      std::uint32_t word = 0;
      ASSERT_TRUE(this->flash.read(slot, at, word));
      const unsigned in = at % TypeParam::unit_words;
      EXPECT_EQ(word, this->pattern(1000 * slot + at - in)[in]);
      EXPECT_EQ(word, this->model.at(this->model.slot(slot) + 4 * at));
    }
  }
}

TYPED_TEST(Flash, ErasesOneSlotAndNotTheOther) {
  for (unsigned slot = 0; slot < 2; ++slot) {
    ASSERT_TRUE(this->program(slot, 0, 7));
    ASSERT_EQ(this->wait(), MemoryStatus::ready);
  }
  std::uint32_t word = 0;
  ASSERT_TRUE(this->flash.read(1, 0, word));  // and on a G4 into its data cache
  EXPECT_EQ(word, 7U);
  ASSERT_TRUE(this->flash.begin_erase(1));
  ASSERT_EQ(this->wait(), MemoryStatus::ready);
  EXPECT_TRUE(this->model.at_rest());
  ASSERT_TRUE(this->flash.read(1, 0, word));
  EXPECT_EQ(word, hal::erased_word);
  ASSERT_TRUE(this->flash.read(0, 0, word));
  EXPECT_EQ(word, 7U);
  ASSERT_TRUE(this->program(1, 0, 9));
  ASSERT_EQ(this->wait(), MemoryStatus::ready);
  ASSERT_TRUE(this->flash.read(1, 0, word));
  EXPECT_EQ(word, 9U);
}

TYPED_TEST(Flash, WhileItWorksNothingElseIsBegunAndNothingIsRead) {
  this->model.duration = 50;
  ASSERT_TRUE(this->flash.begin_erase(0));
  std::uint32_t word = 123;
  for (int i = 0; i < 20; ++i) {
    EXPECT_FALSE(this->flash.read(0, 0, word));
    EXPECT_FALSE(this->flash.read(1, 0, word));
    EXPECT_FALSE(this->flash.begin_erase(1));
    EXPECT_FALSE(this->program(1, 0, 5));
  }
  EXPECT_EQ(word, 123U);
  EXPECT_EQ(this->wait(), MemoryStatus::ready);
  EXPECT_EQ(this->model.begun, 1U);
  EXPECT_EQ(this->flash.poll(), MemoryStatus::ready);
  // Another program's operation that is still going on when this one begins.
  ASSERT_TRUE(this->flash.begin_erase(0));
  TypeParam other{FlashModelAccess{&this->model}};
  EXPECT_FALSE(other.begin_erase(1));
  EXPECT_FALSE(other.read(1, 0, word));
}

TYPED_TEST(Flash, OutsideOfTheSlotsNothingIsTouched) {
  std::uint32_t word = 0;
  const unsigned size = (this->g4 ? 2048 : 128 * 1024) / 4;
  EXPECT_FALSE(this->flash.begin_erase(2));
  EXPECT_FALSE(this->program(2, 0, 1));
  EXPECT_FALSE(this->program(1, size, 1));
  EXPECT_FALSE(this->program(0, 1, 1)) << "not a unit";
  EXPECT_FALSE(this->flash.read(2, 0, word));
  EXPECT_FALSE(this->flash.read(1, size, word));
  EXPECT_TRUE(this->flash.read(1, size - 1, word));
  EXPECT_EQ(this->model.begun, 0U);
  EXPECT_TRUE(this->model.at_rest());
}

TYPED_TEST(Flash, ErrorsAreSaidOnceAndDoNotStay) {
  // WRPERR, and each of the others that end an operation.
  for (unsigned bit = 0; bit < 32; ++bit) {
    const std::uint32_t error = 1U << bit;
    if ((error & (this->g4 ? 0xC3FAU : 0x006E'0000U)) == 0) continue;
    this->model.spoil = error;
    ASSERT_TRUE(this->flash.begin_erase(0));
    EXPECT_EQ(this->wait(), MemoryStatus::failed) << bit;
    EXPECT_EQ(this->flash.poll(), MemoryStatus::ready);
    EXPECT_TRUE(this->model.at_rest());
    ASSERT_TRUE(this->flash.begin_erase(0));
    EXPECT_EQ(this->wait(), MemoryStatus::ready) << bit;
  }
}

TYPED_TEST(Flash, AUnitIsProgrammedOnce) {
  ASSERT_TRUE(this->program(0, 0, 1));
  ASSERT_EQ(this->wait(), MemoryStatus::ready);
  ASSERT_TRUE(this->program(0, 0, 2));
  EXPECT_EQ(this->wait(), this->g4 ? MemoryStatus::failed : MemoryStatus::ready);
  std::uint32_t word = 0;
  EXPECT_EQ(this->flash.read(0, 0, word), this->g4)
      << "on an H7 its error correction gives up: it has to be read to be known";
  EXPECT_EQ(this->model.wrong, std::vector<std::string>{"programs what is not erased"});
  this->model.wrong.clear();
}

TYPED_TEST(Flash, AUnitThatDidNotArriveWholeIsNotTakenForDone) {
  this->model.loses = static_cast<int>(TypeParam::unit_words);
  ASSERT_TRUE(this->program(0, 0, 1));
  const MemoryStatus s = this->wait();
  std::uint32_t word = 0;
  ASSERT_TRUE(this->flash.read(0, 0, word));
  EXPECT_EQ(word, hal::erased_word) << "a G4 says nothing of it: it has to be read to be known";
  EXPECT_EQ(s, this->g4 ? MemoryStatus::ready : MemoryStatus::failed);
  // The rest waits in the write buffer of an H7; whatever is written next would be mixed with it.
  EXPECT_EQ(this->program(0, 0, 2), this->g4);
  EXPECT_EQ(this->flash.begin_erase(1), false);
  this->model.lose_power();
  TypeParam after{FlashModelAccess{&this->model}};
  EXPECT_TRUE(after.begin_erase(1));
}

TYPED_TEST(Flash, WithoutTwoBanksInTheirOrderItIsNotThere) {
  EXPECT_TRUE(this->flash.available());
  const std::vector<std::uint32_t> turned =
      this->g4 ? std::vector<std::uint32_t>{1U << 22, 1U << 20} : std::vector<std::uint32_t>{1U << 31};
  for (const std::uint32_t bits : turned) {
    this->model.options = bits;
    EXPECT_FALSE(this->flash.available());
    EXPECT_FALSE(this->flash.begin_erase(0));
    EXPECT_FALSE(this->program(0, 0, 1));
    EXPECT_EQ(this->model.begun, 0U);
    link::ParameterSlots slots(this->flash, link_config().parameters, 1, 100);
    EXPECT_FALSE(slots.load());
    EXPECT_EQ(slots.status().state, StoreState::none);
  }
}

TYPED_TEST(Flash, AFlashThatStaysLockedIsNotWritten) {
  this->model.write(this->g4 ? 0x08 : 0x104, 0x1234);  // a wrong key locks it until the next reset
  this->model.wrong.clear();
  EXPECT_FALSE(this->flash.begin_erase(0));
  EXPECT_FALSE(this->program(0, 0, 1));
  EXPECT_EQ(this->model.begun, 0U);
  this->model.wrong.clear();
}

TYPED_TEST(Flash, ADamagedWordIsNotAValue) {
  ASSERT_TRUE(this->program(0, 8, 1));
  ASSERT_EQ(this->wait(), MemoryStatus::ready);
  this->model.tear(this->model.slot(0) + 4 * 8);
  std::uint32_t word = 77;
  EXPECT_FALSE(this->flash.read(0, 8, word));
  EXPECT_EQ(word, 77U);
  EXPECT_TRUE(this->flash.read(0, 0, word));
  ASSERT_TRUE(this->flash.begin_erase(0));
  EXPECT_EQ(this->wait(), MemoryStatus::ready);
  EXPECT_TRUE(this->flash.read(0, 8, word));
}

/// The whole of it: gains stored by the driver, the power lost after every poll.
TYPED_TEST(Flash, PowerLostAtAnyStepLeavesTheOldGainsOrTheNewOnes) {
  const Gains old{50, 41, 100, 300}, wanted{70, 43, 90, 300};
  const auto parameters = link_config().parameters;
  int seen_old = 0, seen_new = 0;
  for (int cut = 0; cut < 80; ++cut) {
    FlashModel m(this->g4 ? FlashModel::Chip::g4 : FlashModel::Chip::h7);
    const auto run = [&](const Gains& g, int polls) {
      TypeParam driver{FlashModelAccess{&m}};
      link::ParameterSlots slots(driver, parameters, 99, 100);
      const auto found = slots.load();
      slots.store(g);
      for (int i = 0; i < polls && slots.busy(); ++i) slots.poll();
      m.lose_power();
      return found;
    };
    run({20, 20, 20, 300}, 1000);
    run(old, 1000);
    run(wanted, cut);
    const auto found = run(old, 0);
    ASSERT_TRUE(found == old || found == wanted) << cut;
    ++(found == old ? seen_old : seen_new);
    run(wanted, 1000);
    ASSERT_EQ(run(old, 0), wanted) << cut;
    ASSERT_TRUE(m.wrong.empty()) << m.wrong[0];
  }
  EXPECT_GT(seen_old, 5);
  EXPECT_GT(seen_new, 10);
}

}  // namespace
}  // namespace esmc::test
