/// Command interface: set points, streams, and what becomes of recordings.

#include <gtest/gtest.h>

#include <cmath>
#include <utility>
#include <vector>

#include "tests/support/link_bench.hpp"

namespace esmc::test {
namespace {

TEST(Link, WhatIsAskedForBeforeItRunsDoesNotWait) {
  LinkBench b;
  b.listen();
  for (const unsigned source : {Desk::stream, Desk::reference, Desk::hold}) {
    ASSERT_EQ(b.one(b.desk.order(source)), Outcome::obeyed);
    EXPECT_EQ(b.one(b.desk.pair(Desk::point, 0, 170'000)), Outcome::refused);
    EXPECT_EQ(b.one(b.desk.pair(Desk::position, 0, 170'000)), Outcome::refused);
    EXPECT_EQ(b.one(b.desk.pair(Desk::velocity, 0, 0)), Outcome::refused);
  }
  ASSERT_EQ(b.one(b.desk.order(Desk::arm)), Outcome::obeyed);
  const Request r = b.tick();
  ASSERT_EQ(b.supervisor.state(), State::running);
  EXPECT_FALSE(r.has_point || r.has_sample || r.hold);
  EXPECT_EQ(r.source, Source::hold);
  EXPECT_EQ(b.one(b.desk.pair(Desk::point, 0, 170'000)), Outcome::refused) << "hold takes no set point";
}

TEST(Link, SetPointsWithinTheirBounds) {
  LinkBench b;
  b.run();
  const Request r = b.tick({b.desk.pair(Desk::point, -123'456, 170'000)});
  EXPECT_TRUE(r.has_point);
  EXPECT_FALSE(r.has_sample);
  EXPECT_FLOAT_EQ(r.position[0], -0.123456F);
  EXPECT_FLOAT_EQ(r.position[1], 0.17F);
  for (const auto& [x, y] :
       {std::pair{300'001, 0}, {-300'001, 0}, {0, -1}, {0, 300'001}, {-8'388'608, 8'388'607}}) {
    EXPECT_EQ(b.one(b.desk.pair(Desk::point, x, y)), Outcome::refused) << x << ' ' << y;
  }
  EXPECT_EQ(b.one(b.desk.pair(Desk::point, 0, 170'000, 1)), Outcome::refused)
      << "joints where the effector is led";
  EXPECT_FALSE(b.tick().has_point) << "once";
  b.link.refuse();
  EXPECT_EQ(b.link.counters().refused, 7);
}

/// Neither for a stream that is going on, nor as a sign of life.
TEST(Link, APointOutOfReachHasNoEffect) {
  const auto nowhere = [](const std::array<float, 2>&) { return false; };
  LinkBench b;
  b.run();
  b.tick(b.sample(0, 170'000, 0, 0));
  EXPECT_EQ(b.link.receive(b.desk.pair(Desk::point, 0, 170'000), 0, nowhere), Outcome::refused);
  EXPECT_TRUE(b.tick(b.sample(10, 170'000, 0, 0)).has_sample) << "the stream goes on";
  for (int n = 0; n < 60; ++n) {
    (void)b.link.receive(b.desk.pair(Desk::point, 0, 170'000), 0, nowhere);
    EXPECT_FALSE(b.tick().has_point);
  }
  EXPECT_EQ(b.supervisor.fault(), Fault::command_lost) << "and is missed when it ends";
  LinkBench c(with_silence(20));
  c.run();
  for (int n = 0; n < 30; ++n) {
    (void)c.link.receive(c.desk.pair(Desk::point, 0, 170'000), 0, nowhere);
    c.tick();
  }
  EXPECT_EQ(c.supervisor.fault(), Fault::command_lost);
  LinkBench d;
  d.run();
  EXPECT_EQ(d.link.receive(d.desk.order(Desk::hold), 0, nowhere), Outcome::obeyed);
  EXPECT_EQ(d.link.receive(d.desk.pair(Desk::point, 0, 170'000), 0, nowhere), Outcome::refused);
  EXPECT_TRUE(d.tick().hold);
}

/// Neither as a sign of life, nor for the counter of the frames after it.
TEST(Link, AFrameWithoutMeaningHasNoEffect) {
  LinkBench b(with_silence(20));
  b.run();
  for (int n = 0; n < 30; ++n) b.tick({b.desk.order(Desk::none, 7)});
  EXPECT_EQ(b.supervisor.fault(), Fault::command_lost);
  LinkBench c;
  c.run();
  const auto good = c.desk.order(Desk::none), bad = c.desk.order(Desk::none, 7);
  EXPECT_EQ(c.one(bad), Outcome::malformed);
  EXPECT_EQ(c.one(good), Outcome::obeyed);
}

TEST(Link, HoldIsNotUndoneInItsTick) {
  LinkBench b;
  b.run(Desk::reference);
  const Request r =
      b.tick({b.desk.order(Desk::hold), b.desk.order(Desk::resume), b.desk.order(Desk::override_speed, 50)});
  EXPECT_EQ(b.outcomes, (std::vector{Outcome::obeyed, Outcome::refused, Outcome::refused}));
  EXPECT_TRUE(r.has_rate);
  EXPECT_EQ(r.percent, 0);
  EXPECT_EQ(b.one(b.desk.order(Desk::resume)), Outcome::obeyed);
  EXPECT_EQ(b.tick({b.desk.order(Desk::override_speed, 50), b.desk.order(Desk::override_speed, 40)}).percent,
            40);
}

TEST(Link, ASampleIsAPositionAndItsVelocity) {
  LinkBench b;
  b.run();
  Request r = b.tick(b.sample(10'000, 170'000, 50'000, -20'000));
  EXPECT_TRUE(r.has_sample);
  EXPECT_FLOAT_EQ(r.position[0], 0.01F);
  EXPECT_FLOAT_EQ(r.velocity[0], 0.5F);
  EXPECT_FLOAT_EQ(r.velocity[1], -0.2F);
  b.tick();
  EXPECT_TRUE(b.desk.streaming || b.link.counters().obeyed > 0);
  // A velocity alone, twice, or of another sample.
  EXPECT_EQ(b.one(b.desk.pair(Desk::velocity, 50'000, -20'000)), Outcome::refused);
  b.desk.counter[Desk::position] = b.desk.counter[Desk::velocity] = 3;
  LinkBench c;
  c.run();
  const auto p = c.desk.pair(Desk::position, 10'000, 170'000);
  c.desk.counter[Desk::velocity] = c.desk.counter[Desk::position];
  EXPECT_FALSE(c.tick({p, c.desk.pair(Desk::velocity, 0, 0)}).has_sample) << "another counter";
  EXPECT_EQ(c.outcomes[1], Outcome::refused);
  // In another space.
  LinkBench d;
  d.run();
  EXPECT_EQ(d.one(d.desk.pair(Desk::position, 0, 170'000, 1)), Outcome::refused);
  LinkBench e;
  e.run();
  e.tick({e.desk.pair(Desk::position, 0, 170'000), e.desk.pair(Desk::velocity, 0, 0, 1)});
  EXPECT_EQ(e.outcomes[1], Outcome::refused);
  // Out of bounds.
  LinkBench f;
  f.run();
  EXPECT_EQ(f.one(f.desk.pair(Desk::position, 400'000, 170'000)), Outcome::refused);
}

TEST(Link, SpeedOfASampleIsLimited) {
  for (const auto& [vx, vy] : {std::pair{100'001, 0}, {-100'001, 0}, {0, 100'001}, {0, -100'001}}) {
    LinkBench b;
    b.run();
    b.tick(b.sample(0, 170'000, vx, vy));
    EXPECT_EQ(b.outcomes[1], Outcome::refused);
  }
  LinkBench b;
  b.run();
  b.tick(b.sample(0, 170'000, 100'000, -100'000));
  EXPECT_EQ(b.outcomes[1], Outcome::obeyed);
}

/// However many come in a tick, and whatever comes late: on the whole no faster than the limits.
TEST(Link, SamplesAreNoFasterThanTheLimitsOnTheWhole) {
  for (const int each : {1, 2, 4, 8}) {
    LinkBench b;
    b.run();
    b.tick(b.sample(-290'000, 170'000, 0, 0));
    int sent = -290'000, obeyed = sent, tick = 0;
    for (; tick < 60; ++tick) {
      for (int k = 0; k < each; ++k) {
        const auto frames = b.sample(sent += 990, 170'000, 0, 0);
        for (const auto& f : frames) (void)b.link.receive(f);
      }
      const Request r = b.tick();
      if (r.has_sample) obeyed = static_cast<int>(std::lround(1e6F * r.position[0]));
      EXPECT_LE(obeyed + 290'000, 1'000 * (tick + 1 + 10) + 100) << each;
    }
    EXPECT_EQ(b.supervisor.fault(), each == 1 ? Fault::none : Fault::command_lost) << each;
  }
}

TEST(Link, AStreamThatDiesIsAFault) {
  LinkBench b;
  b.run();
  b.tick(b.sample(0, 170'000, 0, 0));
  for (int i = 0; i < 3; ++i) b.tick();
  EXPECT_EQ(b.supervisor.state(), State::running) << "three ticks old, as configured";
  b.tick();
  EXPECT_EQ(b.supervisor.fault(), Fault::command_lost);
  EXPECT_EQ(b.supervisor.state(), State::fault);
  for (int i = 0; i < 5; ++i) b.tick();
  EXPECT_EQ(b.supervisor.count(Fault::command_lost), 1);
}

TEST(Link, AStreamEndsWithASetPointOrHold) {
  for (const bool hold : {true, false}) {
    LinkBench b;
    b.run();
    b.tick(b.sample(0, 170'000, 0, 0));
    const Request r = b.tick({hold ? b.desk.order(Desk::hold) : b.desk.pair(Desk::point, 0, 170'000)});
    EXPECT_EQ(r.hold, hold);
    EXPECT_EQ(r.has_point, !hold);
    for (int i = 0; i < 20; ++i) b.tick();
    EXPECT_EQ(b.supervisor.state(), State::running);
  }
  // What another computer goes on to stream is void, until it pauses or announces a new stream.
  for (const int end : {0, 1, 2}) {
    LinkBench b;
    b.run();
    b.tick(b.sample(0, 170'000, 0, 0));
    b.tick({end == 1 ? b.desk.pair(Desk::point, 0, 170'000) : b.desk.order(Desk::hold)});
    if (end == 0) b.tick({b.desk.order(Desk::hold)});  // once more
    for (int i = 0; i < 20; ++i) {
      EXPECT_FALSE(b.tick(b.sample(0, 170'000, 0, 0)).has_sample);
      EXPECT_EQ(b.outcomes[1], Outcome::refused);
    }
    if (end == 2) {
      EXPECT_EQ(b.one(b.desk.order(Desk::stream)), Outcome::obeyed);
    } else {
      for (int i = 0; i < 4; ++i) b.tick();
    }
    EXPECT_TRUE(b.tick(b.sample(0, 170'000, 0, 0)).has_sample);
    EXPECT_EQ(b.supervisor.fault(), Fault::none);
  }
}

TEST(Link, TheReferenceIsSlowedHeldAndResumed) {
  constexpr unsigned full = 0, reduced = 1, held = 2;
  LinkBench b;
  b.listen();
  const auto paced = [&](unsigned what, unsigned percent = 0) {
    const Request r = b.tick({b.desk.order(what, percent)});
    EXPECT_EQ(r.has_rate, b.outcomes[0] == Outcome::obeyed);
    return r.has_rate ? int{r.percent} : -1;
  };
  const auto pace = [&] {
    b.settle();
    return b.desk.pace;
  };
  // While disabled a speed for the next start, and nothing that would keep it from moving.
  EXPECT_EQ(paced(Desk::override_speed, 0), -1);
  EXPECT_EQ(paced(Desk::resume), -1);
  EXPECT_EQ(pace(), full);
  EXPECT_EQ(paced(Desk::override_speed, 40), 40);
  EXPECT_EQ(pace(), reduced);
  ASSERT_EQ(b.one(b.desk.order(Desk::reference)), Outcome::obeyed);
  ASSERT_EQ(b.one(b.desk.order(Desk::arm)), Outcome::obeyed);
  EXPECT_EQ(paced(Desk::override_speed, 50), -1) << "while enabling";
  b.settle();
  ASSERT_EQ(b.supervisor.state(), State::running);
  EXPECT_EQ(paced(Desk::override_speed, 50), 50);
  EXPECT_FALSE(b.tick().has_rate) << "once";
  EXPECT_EQ(paced(Desk::resume), -1) << "not held";
  EXPECT_EQ(paced(Desk::hold), 0);
  EXPECT_EQ(pace(), held);
  EXPECT_EQ(paced(Desk::hold), 0);
  EXPECT_EQ(paced(Desk::resume), 50);
  EXPECT_EQ(pace(), reduced);
  EXPECT_EQ(paced(Desk::override_speed, 0), 0) << "the same as hold";
  EXPECT_EQ(paced(Desk::override_speed, 100), 100);
  EXPECT_EQ(pace(), full);
  // A hold ends with the episode, the percentage does not.
  EXPECT_EQ(paced(Desk::override_speed, 30), 30);
  EXPECT_EQ(paced(Desk::hold), 0);
  b.tick({b.desk.order(Desk::off)});
  const Request after = b.tick();
  EXPECT_TRUE(after.has_rate);
  EXPECT_EQ(after.percent, 30);
  EXPECT_EQ(pace(), reduced);
}

TEST(Link, ASpeedWithoutAMeaningIsRefused) {
  LinkBench b;
  b.listen();
  for (const unsigned percent : {101U, 128U, 255U})
    EXPECT_EQ(b.one(b.desk.order(Desk::override_speed, percent)), Outcome::malformed) << percent;
  for (const unsigned what : {Desk::none, Desk::arm, Desk::off, Desk::hold, Desk::resume})
    EXPECT_EQ(b.one(b.desk.order(what, 50)), Outcome::malformed) << what;
  for (unsigned what = 12; what < 256; ++what) {
    if (what != Desk::override_speed && what != Desk::resume) {
      EXPECT_EQ(b.one(b.desk.order(what)), Outcome::malformed) << what;
    }
  }
  EXPECT_EQ(b.supervisor.state(), State::disabled);
  // Under set points, and where the reference does not move.
  LinkBench guided;
  guided.run();
  EXPECT_EQ(guided.one(guided.desk.order(Desk::override_speed, 50)), Outcome::refused);
  EXPECT_EQ(guided.one(guided.desk.order(Desk::resume)), Outcome::refused);
  LinkConfig c = link_config();
  c.has_path = false;
  LinkBench still(c);
  still.run(Desk::reference);
  EXPECT_EQ(still.one(still.desk.order(Desk::override_speed, 50)), Outcome::refused);
  EXPECT_EQ(still.one(still.desk.order(Desk::hold)), Outcome::refused);
  EXPECT_EQ(still.desk.pace, 0U);
  // Too old, as any order.
  LinkBench late;
  late.run(Desk::reference);
  const std::uint32_t tick = late.desk.tick;
  for (int i = 0; i < 60; ++i) late.tick();
  late.desk.tick = tick;
  EXPECT_EQ(late.one(late.desk.order(Desk::hold)), Outcome::refused);
}

TEST(Link, ASilentComputerIsAFaultWhereItIsWatched) {
  LinkBench b(with_silence(10));
  b.run();
  for (int i = 0; i < 30; ++i) b.one(b.desk.order(Desk::none));
  EXPECT_EQ(b.supervisor.state(), State::running);
  const hal::CanFrame last = b.desk.order(Desk::none);
  b.tick({last});
  for (int i = 0; i < 10; ++i) b.tick({last});  // a repeated frame is no life
  EXPECT_EQ(b.supervisor.state(), State::running);
  b.tick({last});
  EXPECT_EQ(b.supervisor.fault(), Fault::command_lost);
}

/// A monitoring computer gives no sign of life for a lost one.
TEST(Link, OnlyOrdersAndObeyedMotionAreSignsOfLife) {
  for (const int kind : {0, 1, 2, 3, 4, 5}) {
    LinkBench b(with_silence(10));
    b.run();
    for (int i = 0; i < 40; ++i) {
      Desk& d = b.desk;
      if (kind == 0) b.tick({d.order(Desk::none)});
      if (kind == 1) b.tick({d.pair(Desk::point, 0, 170'000)});
      if (kind == 2) b.tick(b.sample(0, 170'000, 0, 0));
      if (kind == 3) b.tick({d.ask(2)});
      if (kind == 4) b.tick({d.set_gain(0, 30.0F)});
      if (kind == 5) b.tick({d.pair(Desk::point, 0, 999'000)});
    }
    EXPECT_EQ(b.supervisor.fault(), kind < 3 ? Fault::none : Fault::command_lost) << kind;
  }
}

TEST(Link, AHeldReferenceIsWatchedEvenUnattended) {
  LinkConfig c = with_silence(10);
  c.unattended = c.has_path = true;
  LinkBench b(c);
  b.run(Desk::reference);
  for (int i = 0; i < 50; ++i) b.tick();
  EXPECT_EQ(b.supervisor.fault(), Fault::none);
  b.tick({b.desk.order(Desk::none)});
  ASSERT_EQ(b.one(b.desk.order(Desk::hold)), Outcome::obeyed);
  for (int i = 0; i < 10; ++i) b.tick();
  EXPECT_EQ(b.supervisor.fault(), Fault::none);
  b.tick();
  EXPECT_EQ(b.supervisor.fault(), Fault::command_lost);
}

/// What is armed is the table whose checksum the order bears.
TEST(Link, NothingIsWrittenBetweenArmAndItsTick) {
  LinkBench b;
  b.listen();
  const auto armed = b.desk.order(Desk::arm), written = b.desk.set_gain(0, 30.0F);
  const float before = b.link.parameters().at(0);
  b.tick({armed, written});
  EXPECT_EQ(b.outcomes[0], Outcome::obeyed);
  EXPECT_EQ(b.outcomes[1], Outcome::refused);
  EXPECT_EQ(b.link.parameters().at(0), before);
}

TEST(Link, RecordedFramesOfAnotherEpisodeMoveNothing) {
  LinkBench b;
  b.run();
  std::vector<hal::CanFrame> recording;
  for (int i = 0; i < 48; ++i) {
    for (const auto& f : {b.desk.order(Desk::none), b.desk.pair(Desk::point, 100 * i, 170'000),
                          b.desk.pair(Desk::position, 100 * i, 170'000), b.desk.pair(Desk::velocity, 0, 0),
                          b.desk.set_gain(0, 30.0F), b.desk.ask(2)}) {
      recording.push_back(f);
    }
  }
  b.tick({b.desk.order(Desk::off)});
  b.tick();
  b.tick({b.desk.order(Desk::stream)});
  b.tick({b.desk.order(Desk::arm)});
  b.tick();
  ASSERT_EQ(b.supervisor.state(), State::running);
  for (const auto& f : recording) {
    const Request r = b.tick({f});
    EXPECT_EQ(b.outcomes[0], Outcome::bad_crc);
    EXPECT_FALSE(r.has_point || r.has_sample || r.hold || r.has_gains);
  }
}

}  // namespace
}  // namespace esmc::test
