/// Waiting for the other half of a loop on a bus where others speak as well: what they say must neither keep
/// us waiting nor pass for what we wait for.

#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <utility>

#include "hal/linux/socketcan.hpp"
#include "host_sim/loop/waiting.hpp"
#include "tests/support/odrive_bytes.hpp"

namespace esmc::host {
namespace {

using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;

/// A bus of two sockets; frames sent on one side wait on the other.
class Waiting : public testing::Test {
 protected:
  Waiting() {
    std::array<int, 2> fd{};
    EXPECT_EQ(::socketpair(AF_UNIX, SOCK_SEQPACKET, 0, fd.data()), 0);
    here_ = HostBus("here", hal::SocketCan(fd[0]));
    there_ = hal::SocketCan(fd[1]);
  }
  void foreign() { EXPECT_EQ(there_.try_send(test::heartbeat(9, 8)), hal::SendStatus::ok); }
  [[nodiscard]] int take() {
    hal::CanFrame f;
    int n = 0;
    while (here_.try_receive(f)) ++n;
    return n;
  }
  static constexpr auto never = [] { return false; };

  HostBus here_{"here", hal::SocketCan(-1)};
  hal::SocketCan there_{-1};
};

/// At every pass another frame has arrived.
TEST_F(Waiting, EndsInTimeHoweverMuchOthersSay) {
  const auto begin = Clock::now();
  int passes = 0;
  const auto busy = [&] {
    (void)take();
    foreign();
    ++passes;
    return Clock::now() - begin > 5s;  // a loop that waits for ever ends here, too late
  };
  EXPECT_EQ(wait_until(here_, busy, never, 100ms), Waited::silent);
  EXPECT_LT(Clock::now() - begin, 3s);
  EXPECT_GT(passes, 2);
}

TEST_F(Waiting, HeedsAStopHoweverMuchOthersSay) {
  const auto begin = Clock::now();
  int passes = 0;
  const auto busy = [&] {
    (void)take();
    foreign();
    ++passes;
    return Clock::now() - begin > 5s;
  };
  EXPECT_EQ(wait_until(
                here_, busy, [&] { return passes >= 3; }, 60s),
            Waited::stopped);
  EXPECT_EQ(passes, 3);
}

/// Frames that the waiter does not take (it may read only so many) are "ready" again at once.
TEST_F(Waiting, EndsInTimeWithUnclaimedFrames) {
  foreign();
  const auto begin = Clock::now();
  EXPECT_EQ(wait_until(
                here_, [&] { return Clock::now() - begin > 5s; }, never, 100ms),
            Waited::silent);
  EXPECT_LT(Clock::now() - begin, 3s);
}

TEST_F(Waiting, IsDoneAsSoonAsItsFramesAreThere) {
  foreign();
  EXPECT_EQ(wait_until(
                here_, [&] { return take() == 1; }, never, 10s),
            Waited::done);
  EXPECT_EQ(wait_until(
                here_, [] { return true; }, [] { return true; }, 0ms),
            Waited::done);
}

/// The interface is gone: poll() says "ready" for ever.
TEST_F(Waiting, ADeadBusIsSilent) {
  there_ = hal::SocketCan(-1);
  const auto begin = Clock::now();
  int passes = 0;
  EXPECT_EQ(wait_until(
                here_, [&] { return ++passes, take() > 0; }, never, 100ms),
            Waited::silent);
  EXPECT_LT(Clock::now() - begin, 3s);
  EXPECT_LT(passes, 110) << "and does not burn the processor";
}

TEST(WaitingVirtual, AVirtualBusHasItsFramesOrNeverWill) {
  hal::VirtualBus<2> bus;
  const auto never = [] { return false; };
  EXPECT_EQ(wait_until(bus.port(0), never, never, 10s), Waited::silent);
  ASSERT_EQ(bus.port(1).try_send(test::heartbeat(1, 8)), hal::SendStatus::ok);
  hal::CanFrame f;
  EXPECT_EQ(wait_until(
                bus.port(0), [&] { return bus.port(0).try_receive(f); }, never, 10s),
            Waited::done);
}

/// Steps that are late by themselves, as on every computer, make no tick of an hour late.
TEST(Pace, APartOfATickIsLateWhenATickWouldBe) {
  Pace pace(3600.0, true, 2'000'000'000);
  for (int n = 0; n < 1000; ++n) pace.wait();
  EXPECT_EQ(pace.late(), 0U);
}

}  // namespace
}  // namespace esmc::host
