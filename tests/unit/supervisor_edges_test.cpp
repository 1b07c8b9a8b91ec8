/// Time-outs of the supervisor, to the tick.

#include <gtest/gtest.h>

#include "firmware/safety/supervisor.hpp"

namespace {

using namespace esmc;

TEST(SupervisorEdges, TimeOutsThatNobodySetAreFiveThousandAndAThousandTicks) {
  Supervisor v;
  v.begin_tick(Command::enable, {});
  for (int i = 1; i < 5000; ++i) {
    v.begin_tick(Command::none, {});
    ASSERT_EQ(v.state(), State::enabling) << i;
  }
  v.begin_tick(Command::none, {});
  EXPECT_EQ(v.fault(), Fault::enabling_timeout);
  Supervisor w;
  w.begin_tick(Command::enable, {});
  w.begin_tick(Command::stop, {});
  for (int i = 1; i < 1000; ++i) {
    w.begin_tick(Command::none, {});
    ASSERT_EQ(w.state(), State::stopping) << i;
  }
  w.begin_tick(Command::none, {});
  EXPECT_EQ(w.state(), State::disabled);
}

/// Drives that get ready when the time is up: in a tick of one period they are in time, after a gap that
/// reaches the limit they are not.
TEST(SupervisorEdges, AGapThatReachesTheTimeOutIsTooLate) {
  struct Case {
    std::uint32_t waited, passed;
    bool in_time;
  };
  for (const auto& [waited, passed, in_time] :
       {Case{9, 1, true}, Case{9, 0, true}, Case{7, 2, true}, Case{8, 2, false}, Case{9, 2, false},
        Case{0, 9, true}, Case{0, 10, false}, Case{0, 1000, false}}) {
    Supervisor v({.enabling_ticks_max = 10});
    v.begin_tick(Command::enable, {});
    for (std::uint32_t i = 0; i < waited; ++i) v.begin_tick(Command::none, {});
    v.begin_tick(Command::none, {.all_ready = true}, false, passed);
    EXPECT_EQ(v.running(), in_time) << waited << ' ' << passed;
    EXPECT_EQ(v.fault(), in_time ? Fault::none : Fault::enabling_timeout) << waited << ' ' << passed;
  }
}

}  // namespace
