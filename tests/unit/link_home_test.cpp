/// Command interface: the order `home`, and the budget of samples that come at once.

#include <gtest/gtest.h>

#include <optional>
#include <vector>

#include "tests/support/link_bench.hpp"

namespace esmc::test {
namespace {

TEST(LinkHome, IsObeyedWhereItIsOfferedAndArmingNeedsNoOffer) {
  for (const auto offered : {std::optional<bool>{}, std::optional{false}, std::optional{true}}) {
    LinkBench b;
    if (offered) b.link.offer_homing(*offered);
    b.listen();
    const bool obeyed = offered.value_or(false);
    EXPECT_EQ(b.tick({b.desk.order(Desk::home)}).command, obeyed ? Command::home : Command::none);
    EXPECT_EQ(b.outcomes.at(0), obeyed ? Outcome::obeyed : Outcome::refused);
    EXPECT_EQ(b.link.counters().refused, obeyed ? 0 : 1);
    if (obeyed) continue;
    EXPECT_EQ(b.tick({b.desk.order(Desk::arm)}).command, Command::enable);
    EXPECT_EQ(b.outcomes.at(0), Outcome::obeyed);
  }
}

/// A counter of 0 is one that was heard: what jumps from it is refused, as from any other.
TEST(LinkHome, ACounterOfZeroHasBeenHeard) {
  LinkBench b;
  b.listen();
  b.desk.counter[Desk::command] = 15;
  ASSERT_EQ(b.one(b.desk.order(Desk::none)), Outcome::obeyed);
  b.desk.counter[Desk::command] = 7;
  EXPECT_EQ(b.one(b.desk.order(Desk::none)), Outcome::bad_counter);
}

TEST(LinkHome, OnlyWhileDisabledAndForWhoKnowsTheTable) {
  LinkBench b;
  b.link.offer_homing(true);
  b.listen();
  const auto crc = b.desk.crc32;
  b.desk.crc32 ^= 1U;
  const auto refused = [&] {
    EXPECT_EQ(b.tick({b.desk.order(Desk::home)}).command, Command::none);
    EXPECT_EQ(b.outcomes.at(0), Outcome::refused);
  };
  refused();
  b.desk.crc32 = crc;
  b.run();
  refused();
}

TEST(LinkHome, StatusTellsAnUnknownZero) {
  LinkBench b;
  const auto told = [&] {
    b.settle();
    return (b.desk.last(Desk::status).data[3] & 0x20U) != 0;
  };
  EXPECT_FALSE(told());
  b.link.zero_unknown(true);
  EXPECT_TRUE(told());
  b.link.zero_unknown(false);
  EXPECT_FALSE(told());
}

/// While it runs, `stream` announces another stream; any other source has to wait.
TEST(LinkHome, ASourceDoesNotChangeWhileItRuns) {
  LinkBench b;
  b.run();
  EXPECT_EQ(b.one(b.desk.order(Desk::stream)), Outcome::obeyed);
  EXPECT_EQ(b.one(b.desk.order(Desk::reference)), Outcome::refused);
  EXPECT_EQ(b.desk.source, 2U);
  EXPECT_EQ(b.supervisor.state(), State::running);
}

/// A link whose set points may move by `step` m in a tick of 1 ms, first sample at 0, rest.
struct Stream {
  LinkBench b;
  explicit Stream(float step) : b(config(step)) { b.run(); }
  static LinkConfig config(float step) {
    LinkConfig c = link_config();
    c.parameters = Parameters({40, 40, 150, 300, 1e-3F, 2, 2, 50, 1000.0F * step, 0.01F, 3, 0},
                              {Bounds{10, 80}, Bounds{10, 80}, Bounds{0, 200}, Bounds{0, 0}});
    return c;
  }
  /// All in one tick, micrometres of x; the outcomes of their velocities.
  std::vector<Outcome> at_once(const std::vector<int>& x) {
    std::vector<hal::CanFrame> frames;
    for (const int at : x) {
      for (const auto& f : b.sample(at, 0, 0, 0)) frames.push_back(f);
    }
    b.tick(frames);
    std::vector<Outcome> out;
    for (std::size_t i = 1; i < b.outcomes.size(); i += 2) out.push_back(b.outcomes[i]);
    return out;
  }
};
constexpr auto yes = Outcome::obeyed, no = Outcome::refused;

TEST(LinkHome, SamplesThatRestNeitherSaveTicksNorTakeThem) {
  // Nine ticks' worth, and one for the rounding of a sample; one tick is left, whatever rests in between.
  EXPECT_EQ(Stream(1e-6F).at_once({0, 10, 10, 10, 10, 10, 10, 15}),
            (std::vector{yes, yes, yes, yes, yes, yes, yes, no}));
  EXPECT_EQ(Stream(1e-6F).at_once({0, 10, 10, 10, 10, 10, 10, 11}),
            (std::vector{yes, yes, yes, yes, yes, yes, yes, yes}));
}

TEST(LinkHome, TheWholeBudgetMayBeSpent) {
  EXPECT_EQ(Stream(0.5e-3F).at_once({0, 5001}), (std::vector{yes, yes}));
  EXPECT_EQ(Stream(0.5e-3F).at_once({0, 5003}), (std::vector{yes, no}));
}

}  // namespace
}  // namespace esmc::test
