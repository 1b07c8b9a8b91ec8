/// The loops of boards/node.hpp on a clock and a node of the test's own.

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "boards/light.hpp"
#include "boards/node.hpp"
#include "tests/support/board_double.hpp"

namespace esmc::test {
namespace {

struct Bus {
  int withdrawals = 0, rejoined = 0;
  bool is_off = false;
  hal::SendStatus try_send(const hal::CanFrame&) { return hal::SendStatus::ok; }
  bool try_receive(hal::CanFrame&) { return false; }
  void withdraw() { ++withdrawals; }
  void rejoin() { ++rejoined; }
  [[nodiscard]] bool off() const { return is_off; }
};
using FakeBoard = test::BoardDouble<Bus>;
static_assert(Board<FakeBoard>);

template <bool on_demand>
struct FakeNode {
  static constexpr bool samples_on_demand = on_demand;
  FakeBoard& board;
  std::vector<std::uint32_t> ticks{}, requests{};
  std::vector<Command> commands{};
  std::vector<std::size_t> late_at{};  // how many ticks had been done
  std::vector<bool> answers{};
  std::uint32_t tick_us = 0;  // of each tick
  bool set_complete = false, flooded = false, healthy = true, powered = false, enabled = true;
  int withdrawn_before_request = 0;
  void enable_input(bool closed) { enabled = closed; }
  void receive(Bus&) {}
  [[nodiscard]] bool complete() const { return set_complete; }
  [[nodiscard]] bool overloaded() const { return flooded; }
  void request(Bus& bus) {
    requests.push_back(board.now);
    withdrawn_before_request = bus.withdrawals;
  }
  int tick(Bus&, bool answer) {
    answers.push_back(answer);
    ticks.push_back(board.now);
    board.now += tick_us;
    return 0;
  }
  void command(Command c) { commands.push_back(c); }
  void tick_late() { late_at.push_back(ticks.size()); }
  [[nodiscard]] bool output_ok() const { return healthy; }
  [[nodiscard]] bool drive_enable() const { return powered; }
  [[nodiscard]] bool release_brake() const { return powered; }
};

/// Turns at every microsecond of `n`.
template <class Loop>
void run(FakeBoard& board, Loop& loop, std::uint32_t n) {
  for (std::uint32_t i = 0; i < n; ++i, ++board.now) {
    for (int k = 0; k < 3; ++k) loop.turn();
  }
}

TEST(TimedLoop, TicksAtTheirInstantsAlsoWhenThePeriodIsNoWholeMicrosecond) {
  FakeBoard board;
  FakeNode<false> node{board};
  TimedLoop loop(node, board, 333'333);
  run(board, loop, 1'000'000);
  ASSERT_EQ(node.ticks.size(), 3001U);  // 0, 333.333 us, ..., 999.999 ms
  for (std::size_t k = 0; k < node.ticks.size(); ++k) {
    EXPECT_NEAR(node.ticks[k], 333.333 * static_cast<double>(k), 1.0);
  }
  EXPECT_EQ(loop.late(), 0U);
}

TEST(TimedLoop, GoesOnWhereTheCounterGoesRound) {
  FakeBoard board;
  board.now = 0xFFFF'FF00U;
  FakeNode<false> node{board};
  TimedLoop loop(node, board, 1'000'000);
  run(board, loop, 10'000);
  EXPECT_EQ(node.ticks.size(), 10U);
  EXPECT_EQ(loop.late(), 0U);
}

TEST(TimedLoop, AsksAtTheInstantAndWaitsNoLongerThanItsPatience) {
  FakeBoard board;
  FakeNode<true> node{board};
  TimedLoop loop(node, board, 1'000'000);
  run(board, loop, 1000);
  EXPECT_EQ(node.requests, std::vector<std::uint32_t>{0});
  EXPECT_EQ(node.ticks, std::vector<std::uint32_t>{400});
  EXPECT_EQ(node.withdrawn_before_request, 1);
  node.set_complete = true;  // the answers are there at once
  run(board, loop, 1000);
  EXPECT_EQ(node.requests.back(), 1000U);
  EXPECT_EQ(node.ticks.back(), 1000U);
  node.set_complete = false;
  node.flooded = true;  // no set will be complete
  run(board, loop, 1000);
  EXPECT_EQ(node.ticks.back(), 2000U);
  EXPECT_EQ(board.bus_.withdrawals, 3);
}

TEST(TimedLoop, OneLateTickIsCountedTwoInARowAreAFault) {
  FakeBoard board;
  FakeNode<false> node{board};
  TimedLoop loop(node, board, 1'000'000);
  run(board, loop, 1);
  board.now = 1500;  // half a period is not late yet
  run(board, loop, 1);
  EXPECT_EQ(loop.late(), 0U);
  board.now = 2700;
  EXPECT_EQ(loop.instant_us(), 2000U);
  run(board, loop, 1);
  EXPECT_EQ(loop.late(), 1U);
  EXPECT_EQ(loop.lateness_us(), 700U);
  EXPECT_EQ(loop.instant_us(), 3700U);
  EXPECT_TRUE(node.late_at.empty());
  run(board, loop, 3000);  // from there on in time
  EXPECT_EQ(node.ticks.back(), 5700U);
  EXPECT_EQ(loop.late(), 1U);
  board.now = 7500;
  run(board, loop, 1);
  board.now = 9300;
  run(board, loop, 1);
  EXPECT_EQ(loop.late(), 3U);
  EXPECT_EQ(node.late_at, std::vector<std::size_t>{node.ticks.size() - 1})
      << "before the second of them is done";
  EXPECT_TRUE(node.commands.empty());
}

/// The schedule shifts with each late tick, so that every other one is in time.
TEST(TimedLoop, AnOverloadOfAFewPerCentIsAFault) {
  for (const std::uint32_t tick_us : {900U, 1050U, 1100U, 1200U, 1400U, 1480U, 1520U}) {
    FakeBoard board;
    FakeNode<false> node{board};
    node.tick_us = tick_us;
    TimedLoop loop(node, board, 1'000'000);
    run(board, loop, 100);
    EXPECT_EQ(node.late_at.empty(), tick_us < 1000U) << tick_us;
    EXPECT_TRUE(node.late_at.empty() || node.late_at[0] < 64U) << tick_us;
  }
}

TEST(TimedLoop, ThreeLateTicksOf64AreNone) {
  for (const std::uint32_t between : {15U, 30U}) {
    FakeBoard board;
    FakeNode<false> node{board};
    TimedLoop loop(node, board, 1'000'000);
    for (int i = 0; i < 8; ++i) {
      run(board, loop, 1000 * between);
      board.now += 1700;
    }
    EXPECT_EQ(loop.late(), 7U);
    EXPECT_EQ(node.late_at.empty(), between == 30U) << between;
  }
}

TEST(TimedLoop, OutputsFollowAndTheWatchdogIsFedByGoodTicksOnly) {
  FakeBoard board;
  FakeNode<false> node{board};
  TimedLoop loop(node, board, 1'000'000);
  run(board, loop, 3000);
  EXPECT_EQ(board.dog.refreshed, 3U);
  EXPECT_FALSE(board.power.on || board.brake_.on);
  node.healthy = false;
  node.powered = true;
  board.contact.on = false;
  run(board, loop, 3000);
  EXPECT_EQ(board.dog.refreshed, 3U);
  EXPECT_TRUE(board.power.on && board.brake_.on);
  EXPECT_FALSE(node.enabled);
}

TEST(TimedLoop, SendsNoTorqueBeforeItWasArmed) {
  FakeBoard board;
  FakeNode<false> node{board};
  TimedLoop loop(node, board, 1'000'000);
  run(board, loop, 2000);
  node.powered = true;
  run(board, loop, 1000);
  node.powered = false;  // disarmed: zero torque is told
  run(board, loop, 1000);
  EXPECT_EQ(node.answers, (std::vector<bool>{false, false, true, true}));
}

/// Twenty slots of 0.1 s in a round of 2 s: # on, . off, % both.
std::string pattern(State state, bool crashed = false) {
  std::string out;
  for (std::uint32_t slot = 0; slot < 20; ++slot) {
    unsigned on = 0;
    for (std::uint32_t ms = 0; ms < 100; ++ms)
      on += light_on(state, crashed, 2000U + 100U * slot + ms) ? 1U : 0U;
    out += on == 0 ? '.' : on == 100 ? '#' : '%';
  }
  return out;
}

TEST(Light, EveryStateHasItsPatternAndNoneIsSteady) {
  EXPECT_EQ(pattern(State::disabled), "#...................");
  EXPECT_EQ(pattern(State::enabling), "%%%%%%%%%%%%%%%%%%%%");
  EXPECT_EQ(pattern(State::testing), pattern(State::enabling));
  EXPECT_EQ(pattern(State::running), ".###################");
  EXPECT_EQ(pattern(State::holding), ".#.#################");
  for (const State s : {State::halting, State::lowering, State::stopping})
    EXPECT_EQ(pattern(s), "#####.....#####.....");
  EXPECT_EQ(pattern(State::fault), "##..##..##..........");
  for (int s = 0; s < state_count; ++s)
    EXPECT_EQ(pattern(static_cast<State>(s), true), "#.#.#.#.#.#.........") << "after a crash";
}

TEST(TimedLoop, ComesBackToTheBusFiveTimesASecond) {
  FakeBoard board;
  FakeNode<false> node{board};
  TimedLoop loop(node, board, 1'000'000);
  run(board, loop, 300'000);
  EXPECT_EQ(board.bus_.rejoined, 0);
  board.bus_.is_off = true;
  run(board, loop, 199'000);
  EXPECT_EQ(board.bus_.rejoined, 0);
  run(board, loop, 801'000);
  EXPECT_EQ(board.bus_.rejoined, 5);
}

TEST(TimedLoop, AfterItsStartItWaitsAsLong) {
  FakeBoard board;
  board.now = 5'000'000;
  board.bus_.is_off = true;
  FakeNode<false> node{board};
  TimedLoop loop(node, board, 1'000'000);
  run(board, loop, 200'000);
  EXPECT_EQ(board.bus_.rejoined, 0);
  run(board, loop, 1);
  EXPECT_EQ(board.bus_.rejoined, 1);
}

}  // namespace
}  // namespace esmc::test
