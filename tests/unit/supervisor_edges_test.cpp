/// Numbers of faults and states as they are sent and recorded, and time-outs of the supervisor to the tick.

#include <gtest/gtest.h>

#include <array>

#include "firmware/safety/supervisor.hpp"

namespace {

using namespace esmc;

/// A value is never given anew: docs/esmc.dbc and recordings have them.
template <class E, std::size_t n>
constexpr bool counted_from_zero(const std::array<E, n>& all) {
  for (std::size_t i = 0; i < n; ++i) {
    if (static_cast<std::size_t>(all[i]) != i) return false;
  }
  return true;
}
static_assert(counted_from_zero(std::array{Fault::none,
                                           Fault::feedback_not_finite,
                                           Fault::feedback_jump,
                                           Fault::stale_feedback,
                                           Fault::malformed_frame,
                                           Fault::heartbeat_lost,
                                           Fault::enable_open,
                                           Fault::emergency_stop,
                                           Fault::drive_error,
                                           Fault::drive_disarmed,
                                           Fault::bus_overload,
                                           Fault::foreign_controller,
                                           Fault::drive_configuration,
                                           Fault::zero_not_confirmed,
                                           Fault::torque_mismatch,
                                           Fault::bus_off,
                                           Fault::loop_not_closed,
                                           Fault::type1_singularity,
                                           Fault::type2_singularity,
                                           Fault::working_mode,
                                           Fault::workspace,
                                           Fault::joint_speed,
                                           Fault::joint_angle,
                                           Fault::reference_unreachable,
                                           Fault::sign_test,
                                           Fault::join_infeasible,
                                           Fault::command_lost,
                                           Fault::halt_failed,
                                           Fault::torque_not_finite,
                                           Fault::tick_late,
                                           Fault::enabling_timeout,
                                           Fault::drives_not_confirmed}));
static_assert(counted_from_zero(std::array{State::disabled, State::enabling, State::testing, State::running,
                                           State::halting, State::holding, State::lowering, State::stopping,
                                           State::fault}));
static_assert(Supervisor::count_max == 65535);

TEST(SupervisorEdges, DefaultTimeOutsAre5000And1000Ticks) {
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

/// Until its stage is over homing goes on; before and after it a fault takes the torque away, whatever it
/// asks for.
TEST(SupervisorEdges, HomingLastsUntilItIsDoneAndHaltsInItsOwnStateOnly) {
  Supervisor::Config c;
  c.can_halt = true;
  const DriveStatus ready{true, false};
  Supervisor s(c);
  s.begin_tick(Command::home, {});
  ASSERT_EQ(s.state(), State::enabling);
  Supervisor early = s;
  early.raise(Fault::home_no_stop);
  EXPECT_EQ(early.state(), State::fault);
  for (int n = 0; n < 3; ++n) {
    s.begin_tick(Command::none, ready);
    EXPECT_EQ(s.state(), State::testing);
  }
  Supervisor now = s;
  now.raise(Fault::home_no_stop);
  EXPECT_EQ(now.state(), State::halting);
  s.begin_tick(Command::none, ready, true);
  ASSERT_EQ(s.state(), State::stopping);
  s.raise(Fault::home_no_stop);
  EXPECT_EQ(s.state(), State::fault);
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
