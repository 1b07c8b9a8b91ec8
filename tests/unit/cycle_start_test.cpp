/// What parts of the cycle are before their first use, and again after a reset.

#include <gtest/gtest.h>

#include <algorithm>
#include <cstddef>
#include <memory>
#include <new>

#include "firmware/cycle/controller_config.hpp"
#include "firmware/cycle/parts.hpp"
#include "firmware/cycle/tick_result.hpp"
#include "firmware/mechanism/five_bar.hpp"
#include "firmware/mechanism/rr.hpp"

namespace {

using Five = esmc::FiveBar<double>;
using Arm = esmc::Rr<double>;

/// Made where other numbers were: what the constructor leaves alone is not zero.
template <class M, class... Argument>
struct OnDirt {
  using Result = esmc::TickResult<M>;
  alignas(Result) std::byte memory[sizeof(Result)];
  Result* result;
  OnDirt() {
    volatile std::byte* dirt = memory;  // not left out by the compiler
    for (std::size_t i = 0; i < sizeof(Result); ++i) dirt[i] = std::byte{0x3F};
    result = new (memory) Result(Argument{}...);
  }
  ~OnDirt() { std::destroy_at(result); }
  OnDirt(const OnDirt&) = delete;
  OnDirt& operator=(const OnDirt&) = delete;
};

template <class M>
void expect_nothing(const esmc::TickResult<M>& r) {
  EXPECT_EQ(r.state, esmc::State::disabled);
  EXPECT_EQ(r.fault, esmc::Fault::none);
  EXPECT_EQ(r.running_tick, 0U);
  EXPECT_FALSE(r.saturated);
  EXPECT_FALSE(r.stage_done);
  EXPECT_TRUE(r.torque.isZero(0));
}
template <class M>
void expect_nothing_desired(const esmc::TickResult<M>& r) {
  EXPECT_TRUE(r.desired_effector.isZero(0));
  for (int i = 0; i < 2; ++i) EXPECT_TRUE(r.desired_direction[i].isZero(0)) << i;
}

template <class M>
struct AtFirst : testing::Test {};
using Mechanisms = testing::Types<Five, Arm>;
TYPED_TEST_SUITE(AtFirst, Mechanisms, );

TYPED_TEST(AtFirst, AResultIsOfADisabledTickInWhichNothingWasSeenOrDesired) {
  OnDirt<TypeParam> made;
  expect_nothing(*made.result);
  EXPECT_TRUE(made.result->effector.isZero(0));
  expect_nothing_desired(*made.result);
  EXPECT_TRUE(made.result->sliding.isZero(0));
}

TYPED_TEST(AtFirst, AResultToBeSetHasNoTorqueEither) {
  OnDirt<TypeParam, typename esmc::TickResult<TypeParam>::Unset> made;
  expect_nothing(*made.result);
  made.result->clear_desired();
  expect_nothing_desired(*made.result);
  made.result->clear_estimate();
  EXPECT_TRUE(made.result->effector.isZero(0));
}

TYPED_TEST(AtFirst, AMemoryOfTorquesHoldsNoneAndThenTheLastOnes) {
  using Memory = esmc::PartMemory<TypeParam>;
  using Torque = esmc::Vec<double, TypeParam::joints>;
  static_assert(Memory::depth == 9, "the last tick's, and eight of delay");
  Memory memory;
  EXPECT_TRUE(memory.whole);
  EXPECT_EQ(memory.ticks, 0);
  EXPECT_TRUE(memory.disturbance.isZero(0));
  for (int round = 0; round < 2; ++round) {
    for (int n = 1; n <= 2 * Memory::depth; ++n) {
      memory.keep(Torque::Constant(100 * round + n), n % 3 != 0);
      EXPECT_EQ(memory.whole, n % 3 != 0);
      EXPECT_EQ(memory.ticks, std::min(n, Memory::depth));
      for (int ago = 0; ago < Memory::depth + 2; ++ago) {
        const bool kept = ago < n && ago < Memory::depth;
        EXPECT_EQ(memory.torque(ago), Torque::Constant(kept ? 100 * round + n - ago : 0)) << n << ' ' << ago;
      }
    }
    memory.disturbance = {1, 2};
    memory.reset();
    EXPECT_EQ(memory.ticks, 0);
    EXPECT_TRUE(memory.disturbance.isZero(0));
    EXPECT_TRUE(memory.torque(0).isZero(0));
  }
}

TYPED_TEST(AtFirst, AResetMemoryOfTheLawKnowsNothing) {
  esmc::PartMemory<TypeParam> memory;
  const auto step = [&memory](double s) {
    return memory.twisting.step({s, -s}, {0, 0}, 100, 1e-3, {2, 0.5}).eval();
  };
  const esmc::Vec2<double> first = step(0.1);
  for (int n = 0; n < 20; ++n) (void)step(0.3 * n);
  EXPECT_NE(step(0.1), first);
  memory.reset();
  EXPECT_EQ(step(0.1), first);
}

/// A scene names what it needs: every stage takes no time, and what is scaled is scaled by one.
TYPED_TEST(AtFirst, AConfigurationIsOfTheLawAlone) {
  const esmc::ControllerConfig<TypeParam> c;
  EXPECT_EQ(c.law, esmc::LawKind::esmc);
  EXPECT_EQ(c.reaching, esmc::Reaching::implicit);
  EXPECT_TRUE(c.torque_limit.isZero(0)) << "without a limit there is no torque";
  EXPECT_TRUE(c.torque_weight.isOnes(0) && c.encoder_variance.isOnes(0));
  EXPECT_EQ(c.join_ticks + c.ramp_ticks + c.halt_ticks + c.lower_ticks + c.setpoint_jerk_ticks, 0U);
  EXPECT_EQ(c.sign_test_move, 0.0);
  EXPECT_EQ(c.after_halt, esmc::AfterHalt::release);
  EXPECT_EQ(c.setpoint_speed, 1.0);
  EXPECT_EQ(c.setpoint_acceleration, 1.0);
  EXPECT_EQ(c.motors, esmc::Motors::base);
  EXPECT_EQ(c.sensors, esmc::Sensors::base);
  EXPECT_EQ(c.motor_count(), 2);
  EXPECT_EQ(c.sensor_count(), 2);
}

}  // namespace
