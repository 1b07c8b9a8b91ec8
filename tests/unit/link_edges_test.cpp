/// Command interface at its edges: values exactly at a bound, frames in an unusual order, silence in each
/// state, order of the frames sent, defaults.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <tuple>
#include <utility>
#include <vector>

#include "firmware/link/parameter_slots.hpp"
#include "tests/support/link_bench.hpp"

namespace esmc::test {
namespace {

/// A supervisor that was led into this state.
Supervisor in_state(State s) {
  Supervisor v({.can_halt = true,
                .after_halt = s == State::lowering ? AfterHalt::lower : AfterHalt::hold,
                .sign_test = s == State::testing});
  if (s == State::disabled) return v;
  v.begin_tick(Command::enable, {});
  if (s == State::fault) v.raise(Fault::drive_error);
  if (s == State::enabling || s == State::fault) return v;
  v.begin_tick(Command::none, {.all_ready = true});
  if (s == State::testing || s == State::running) return v;
  v.begin_tick(s == State::stopping ? Command::stop : Command::halt, {});
  if (s != State::halting && s != State::stopping) v.begin_tick(Command::none, {}, true);
  return v;
}

bool silent_tick(CommandLink& link, const Supervisor& s) {
  link.begin_tick();
  const bool lost = link.lost();
  link.transmit(s, {}, [](const hal::CanFrame&) { return true; });
  return lost;
}

TEST(LinkEdges, ASilentConsoleIsLostInEveryArmedState) {
  struct Case {
    State state;
    bool watched;
  };
  for (const auto& [state, watched] :
       {Case{State::disabled, false}, Case{State::enabling, true}, Case{State::testing, true},
        Case{State::running, true}, Case{State::halting, true}, Case{State::holding, true},
        Case{State::lowering, true}, Case{State::stopping, false}, Case{State::fault, false}}) {
    const Supervisor s = in_state(state);
    ASSERT_EQ(s.state(), state);
    for (const int silence : {1, 10}) {
      CommandLink link(with_silence(static_cast<float>(silence)));
      for (int i = 0; i < 50; ++i) EXPECT_FALSE(silent_tick(link, Supervisor{}));
      for (int i = 0; i <= silence; ++i) EXPECT_FALSE(silent_tick(link, s)) << name(state) << i;
      EXPECT_EQ(silent_tick(link, s), watched) << name(state);
    }
  }
  CommandLink link(with_silence(10));
  for (int i = 0; i < 50; ++i) link.begin_tick();
  EXPECT_FALSE(link.lost()) << "before the first state is known";
}

/// What something on the way has kept keeps no motion alive: a sign of life answers a Status that is no older
/// than an order may be.
TEST(LinkEdges, ASignOfLifeThatAnswersAnOldStatusIsNone) {
  for (const bool old : {false, true}) {
    LinkBench b(with_silence(500));
    b.run();
    const unsigned tick = b.desk.tick;
    for (int i = 0; i < 1500; ++i) {
      if (old) b.desk.tick = tick;
      b.tick({b.desk.order(Desk::none)});
    }
    EXPECT_EQ(b.supervisor.fault(), old ? Fault::command_lost : Fault::none);
  }
}

TEST(LinkEdges, AStreamEndsWithItsEpisode) {
  LinkBench b;
  b.supervisor = Supervisor({.can_halt = true, .after_halt = AfterHalt::hold});
  b.run();
  b.tick(b.sample(0, 170'000, 0, 0));
  b.tick({b.desk.order(Desk::disarm)});
  for (int i = 0; i < 20; ++i) b.tick();
  EXPECT_EQ(b.supervisor.state(), State::halting);
  EXPECT_EQ(b.supervisor.fault(), Fault::none);
  EXPECT_FALSE(b.desk.streaming);
}

TEST(LinkEdges, AnyBlockOfIdentifiersWillDo) {
  for (const std::uint32_t base : {0x20U, 0x620U, 0x7E0U}) {
    LinkConfig c = link_config();
    c.base_id = base;
    LinkBench b(c);
    b.desk.base = base;
    b.run();
    EXPECT_TRUE(b.tick({b.desk.pair(Desk::point, 0, 170'000)}).has_point) << base;
    EXPECT_EQ(b.link.scene(), 0x89ABCDEFU);
  }
}

/// It may have waited to be read where the program stood still: no tick has been counted meanwhile.
TEST(LinkEdges, AnOrderIsAsOldAsItsStatusAndItsWait) {
  struct Case {
    unsigned age, waited;
    Outcome outcome;
  };
  for (const auto& [age, waited, outcome] :
       {Case{50, 0, Outcome::obeyed}, Case{51, 0, Outcome::refused}, Case{30, 20, Outcome::obeyed},
        Case{30, 21, Outcome::refused}, Case{30, 30, Outcome::refused}}) {
    LinkBench b;
    b.listen();
    while (b.desk.count(Desk::status) == 0) b.tick();
    for (unsigned i = 0; i < age; ++i) b.link.begin_tick();
    const hal::CanFrame f = b.desk.order(Desk::arm);
    EXPECT_EQ(waited == 0 ? b.link.receive(f) : b.link.receive(f, waited), outcome) << age << ' ' << waited;
    EXPECT_EQ(b.link.receive(b.desk.order(Desk::off), 60'000), Outcome::obeyed)
        << "what takes torque away is never too old";
  }
}

TEST(LinkEdges, WithoutASessionAReservedBitIsRefused) {
  LinkBench b;
  b.listen();
  for (const unsigned what : {Desk::off, Desk::disarm}) {
    for (unsigned bit = 4; bit < 8; ++bit) {
      hal::CanFrame f = b.desk.order(what);
      EXPECT_EQ(b.link.receive(b.desk.seal(f, 0)), Outcome::obeyed);
      f.data[1] = static_cast<std::uint8_t>(f.data[1] | (1U << bit));
      EXPECT_EQ(b.link.receive(b.desk.seal(f, 0)), Outcome::refused) << what << ' ' << bit;
    }
  }
}

TEST(LinkEdges, EveryOrderHasItsOutcome) {
  LinkBench b;
  b.listen();
  EXPECT_EQ(b.one(b.desk.order(Desk::confirm_zero)), Outcome::obeyed);
  EXPECT_EQ(b.one(b.desk.order(Desk::override_speed, 1)), Outcome::obeyed)
      << "the slowest for the next start";
  b.run();
  EXPECT_EQ(b.one(b.desk.order(Desk::hold)), Outcome::obeyed);
  b.tick({}, Fault::drive_error);
  EXPECT_EQ(b.one(b.desk.order(Desk::reset)), Outcome::obeyed);
  EXPECT_EQ(b.supervisor.state(), State::disabled);
}

TEST(LinkEdges, ThePaceOfTheReference) {
  LinkBench b;
  b.run(Desk::reference);
  for (int i = 0; i < 20; ++i) EXPECT_FALSE(b.tick().has_rate) << "nobody asked for another";
  b.tick({b.desk.order(Desk::hold)});
  const Request r = b.tick({b.desk.order(Desk::resume)});
  EXPECT_TRUE(r.has_rate);
  EXPECT_EQ(r.percent, 100);
  for (const auto& [percent, pace] : {std::pair{99U, 1U}, {100U, 0U}}) {
    b.tick({b.desk.order(Desk::override_speed, percent)});
    b.settle();
    EXPECT_EQ(b.desk.pace, pace) << percent;
  }
}

TEST(LinkEdges, BoundsThemselvesAreAccepted) {
  for (const std::uint32_t scene : {0U, 0x89ABCDEFU, 0x7F000000U, 0xFF000000U}) {
    LinkConfig config = link_config();
    config.scene = scene;
    LinkBench b(config);
    b.run();
    for (const auto& [x, y] : {std::pair{300'000, 0}, {-300'000, 300'000}}) {
      EXPECT_EQ(b.one(b.desk.pair(Desk::point, x, y)), Outcome::obeyed) << x << ' ' << y;
    }
  }
  LinkBench c;
  c.run();
  c.tick(c.sample(0, 170'000, -100'000, 100'000));
  EXPECT_EQ(c.outcomes, (std::vector<Outcome>{Outcome::obeyed, Outcome::obeyed}));
  for (const auto& [value, answer] : {std::pair{10.0F, Answer::ok}, {80.0F, Answer::ok}}) {
    Parameters p = link_config().parameters;
    EXPECT_EQ(p.write(0, value, true), answer);
  }
}

/// At 1 m/s and 10 m/s2, 1 ms apart and ten more that samples may have waited: 11 mm and 0.11 m/s, each and a
/// unit.
TEST(LinkEdges, SamplesAwayFromZeroMayMoveAsFarAsTheLimit) {
  const auto second = [](int dx, int dy, int dvx, int dvy, int gap = 0) {
    LinkBench b;
    b.run();
    b.tick(b.sample(100'000, 170'000, 50'000, -30'000));
    for (int i = 0; i < gap; ++i) b.tick();
    b.tick(b.sample(100'000 + dx, 170'000 + dy, 50'000 + dvx, -30'000 + dvy));
    return b.outcomes[1];
  };
  for (const int sign : {1, -1}) {
    EXPECT_EQ(second(sign * 11'000, 0, 0, 0), Outcome::obeyed);
    EXPECT_EQ(second(0, sign * 11'000, 0, 0), Outcome::obeyed);
    EXPECT_EQ(second(0, 0, sign * 11'000, 0), Outcome::obeyed);
    EXPECT_EQ(second(0, 0, 0, sign * 11'000), Outcome::obeyed);
    EXPECT_EQ(second(sign * 11'003, 0, 0, 0), Outcome::refused);
    EXPECT_EQ(second(0, sign * 11'003, 0, 0), Outcome::refused);
    EXPECT_EQ(second(0, 0, sign * 11'003, 0), Outcome::refused);
    EXPECT_EQ(second(0, 0, 0, sign * 11'003), Outcome::refused);
  }
  EXPECT_EQ(second(11'900, 0, 11'900, 0, 1), Outcome::obeyed) << "after a lost one";
}

TEST(LinkEdges, AVelocityAloneIsNoSample) {
  for (const bool after_a_sample : {false, true}) {
    LinkBench b;
    b.run();
    std::vector<hal::CanFrame> frames;
    if (after_a_sample) frames = b.sample(0, 170'000, 0, 0);
    const std::size_t alone = frames.size();
    for (int i = 0; i < 17; ++i) frames.push_back(b.desk.pair(Desk::velocity, 0, 0));
    b.tick(frames);
    for (std::size_t i = alone; i < frames.size(); ++i) EXPECT_EQ(b.outcomes[i], Outcome::refused) << i;
  }
}

TEST(LinkEdges, ARefusedPositionReplacesTheOneBefore) {
  LinkBench b;
  b.run();
  const auto good = b.desk.pair(Desk::position, 0, 170'000), bad = b.desk.pair(Desk::position, 400'000, 0);
  b.tick({good, bad, b.desk.pair(Desk::velocity, 0, 0)});
  EXPECT_EQ(b.outcomes, (std::vector<Outcome>{Outcome::obeyed, Outcome::refused, Outcome::refused}));
  LinkBench c;
  c.run();
  c.desk.counter[Desk::velocity] = 15;
  c.tick({c.desk.pair(Desk::position, 400'000, 0), c.desk.pair(Desk::velocity, 0, 0)});
  EXPECT_EQ(c.outcomes, (std::vector<Outcome>{Outcome::refused, Outcome::refused}));
}

TEST(LinkEdges, TheLastMotionOfATickCounts) {
  enum Kind { point, hold, sample };
  for (const Kind first : {point, hold, sample}) {
    for (const Kind last : {point, hold, sample}) {
      LinkBench b;
      b.run();
      std::vector<hal::CanFrame> frames;
      for (const Kind k : {first, last}) {
        if (k == point) frames.push_back(b.desk.pair(Desk::point, 0, 170'000));
        if (k == hold) frames.push_back(b.desk.order(Desk::hold));
        if (k != sample) continue;
        for (const auto& f : b.sample(0, 170'000, 0, 0)) frames.push_back(f);
      }
      const Request r = b.tick(frames);
      EXPECT_EQ(r.has_point, last == point) << first << last;
      EXPECT_EQ(r.hold, last == hold) << first << last;
      EXPECT_EQ(r.has_sample, last == sample) << first << last;
    }
  }
}

TEST(LinkEdges, AtPowerUpStatusAndIdentityAreSentAndNothingElse) {
  LinkConfig c = link_config();
  c.status_ticks = 1;
  LinkBench b(c);
  for (int i = 0; i < 20; ++i) b.tick();
  ASSERT_EQ(b.desk.heard.size(), 20U);
  EXPECT_EQ(b.desk.heard[0].id, 0x780U + Desk::status);
  EXPECT_EQ(b.desk.heard[1].id, 0x780U + Desk::identity);
  EXPECT_EQ(b.desk.count(Desk::status), 19);
  EXPECT_EQ(b.desk.reaction, 0U);
}

TEST(LinkEdges, EveryRequestIsAnsweredByItsOwnKind) {
  const auto kinds = [](unsigned subject) {
    LinkBench b;
    b.settle();
    b.desk.heard.clear();
    b.tick({b.desk.ask(subject, 200)});
    b.settle();
    std::vector<unsigned> out;
    for (const auto& f : b.desk.heard) {
      if (f.id != b.desk.base + Desk::status) out.push_back(f.id - b.desk.base);
    }
    std::sort(out.begin(), out.end());
    return out;
  };
  using Kinds = std::vector<unsigned>;
  EXPECT_EQ(kinds(0), (Kinds{Desk::record}));
  EXPECT_EQ(kinds(1), (Kinds{Desk::value}));
  EXPECT_EQ(kinds(2), (Kinds{Desk::table, Desk::counts, Desk::identity, Desk::slots}));
  EXPECT_EQ(kinds(3), (Kinds{Desk::capture}));
}

TEST(LinkEdges, TheValueOfAnUnknownParameterIsZero) {
  LinkBench b;
  b.tick({b.desk.ask(1, 200)});
  b.settle();
  EXPECT_EQ(b.desk.last(Desk::value).data[0], 200);
  EXPECT_EQ(Desk::word(b.desk.last(Desk::value), 4, 4), 0U);
}

TEST(LinkEdges, AnswersAloneTakeATickEachAndTurnsWithStatus) {
  for (const bool status : {false, true}) {
    LinkConfig c = link_config();
    c.status_ticks = status ? 1 : 0;
    LinkBench b(c);
    b.settle();
    b.desk.heard.clear();
    std::vector<hal::CanFrame> asks;
    for (unsigned i = 0; i < 12; ++i) asks.push_back(b.desk.ask(1, i));
    b.tick(asks);
    const int ticks = status ? 24 : 12;
    for (int i = 1; i < ticks; ++i) b.tick();
    EXPECT_EQ(b.desk.count(Desk::value), 12);
    EXPECT_EQ(b.desk.count(Desk::status), status ? 12 : 0);
  }
}

TEST(LinkEdges, ANewStateGoesBeforeAnAnswer) {
  LinkBench b;
  b.listen();
  b.settle();
  b.desk.heard.clear();
  b.tick({b.desk.order(Desk::arm), b.desk.ask(1, 0)});
  ASSERT_EQ(b.desk.heard.size(), 1U);
  EXPECT_EQ(b.desk.heard[0].id, b.desk.base + Desk::status);
}

TEST(LinkEdges, AFaultIsFollowedByItsRecord) {
  LinkConfig c = link_config();
  c.telemetry_ticks = 1;
  LinkBench b(c);
  b.report.joints = 2;
  b.run();
  b.settle();
  b.desk.heard.clear();
  b.tick({}, Fault::drive_error);
  b.tick();
  ASSERT_EQ(b.desk.heard.size(), 2U);
  EXPECT_EQ(b.desk.heard[0].id, b.desk.base + Desk::status);
  EXPECT_EQ(b.desk.heard[1].id, b.desk.base + Desk::record) << "telemetry waits";
}

TEST(LinkEdges, AStatusThatTheBusRefusesIsSentInTheNextTick) {
  LinkBench b;
  b.settle();
  b.desk.heard.clear();
  b.refused_id = b.desk.base + Desk::status;
  b.refused = 1;
  while (b.refused > 0) b.tick();
  EXPECT_TRUE(b.desk.heard.empty());
  b.tick();
  EXPECT_EQ(b.desk.count(Desk::status), 1);
}

TEST(LinkEdges, ATableAskedForWithThePeriodicOneHasTheSlotsToo) {
  LinkConfig c = link_config();
  c.table_ticks = 10;
  LinkBench b(c);
  for (int i = 0; i < 9; ++i) b.tick();
  b.tick({b.desk.ask(2)});
  b.settle();
  EXPECT_EQ(b.desk.count(Desk::slots), 1);
}

TEST(LinkEdges, ASetOfTelemetryIsOfOneTick) {
  LinkConfig c = link_config();
  c.telemetry_ticks = 1;
  c.status_ticks = 3;
  LinkBench b(c);
  for (int i = 0; i < 60; ++i) {
    const auto t = static_cast<float>(i);
    b.report = {{t, t + 0.25F}, {t + 0.5F, t + 0.75F}, {t + 10, t + 30}, {t + 20, t + 40}, 2, no_axis, 0};
    b.tick();
  }
  constexpr std::array<std::array<float, 2>, 4> offsets{{{0, 0.25F}, {0.5F, 0.75F}, {10, 20}, {30, 40}}};
  unsigned next = 0, sets = 0;
  float t = 0;
  for (const auto& f : b.desk.heard) {
    const unsigned kind = f.id - b.desk.base - Desk::effector;
    if (kind > 3) continue;
    ASSERT_EQ(kind, next);
    if (kind == 0) t = Desk::real(f, 0);
    EXPECT_EQ(Desk::real(f, 0), t + offsets[kind][0]);
    EXPECT_EQ(Desk::real(f, 4), t + offsets[kind][1]);
    next = (next + 1) % 4;
    sets += kind == 3 ? 1 : 0;
  }
  EXPECT_GE(sets, 8U);
}

TEST(LinkEdges, AStoreOrderIsToldAsUnderWayAtOnce) {
  for (const auto& [order, state, request] :
       {std::tuple{Desk::store, StoreState::storing, StoreRequest::store},
        {Desk::forget, StoreState::forgetting, StoreRequest::forget}}) {
    LinkBench b;
    b.listen();
    b.link.store_status({.state = StoreState::idle});
    b.settle();
    EXPECT_EQ(b.one(b.desk.order(order)), Outcome::obeyed);
    b.settle();
    EXPECT_EQ(b.desk.last(Desk::slots).data[0], static_cast<unsigned>(state));
    EXPECT_EQ(b.link.take_store_request(), request);
  }
}

TEST(LinkEdges, ARecordMarksTheTickOfARefusedFrameAndNoOther) {
  LinkConfig c = link_config();
  c.parameters = Parameters({40, 40, 150, 300, 1e-3F, 2, 4, 50, 1.0F, 10.0F, 3, 0}, {});
  LinkBench b(c);
  std::array<CaptureRecord, 1> last{};
  b.link.capture_into(last);
  b.report.joints = 2;
  b.report.torque = {1, 1};
  b.run();
  const auto flags = [&](const std::vector<hal::CanFrame>& frames) {
    b.tick(frames);
    return last[0][23] >> 4U;
  };
  hal::CanFrame wrong = b.desk.order(Desk::none), good = b.desk.order(Desk::none);
  wrong.data[0] ^= 1;
  EXPECT_EQ(flags({}), 0);
  EXPECT_EQ(flags({good}), 1);
  EXPECT_EQ(flags({}), 0);
  const auto counter = good;  // a second time: not ahead
  const auto order = [&] { return b.desk.order(Desk::arm); };
  EXPECT_EQ(flags({wrong}), 2);
  EXPECT_EQ(flags({}), 0);
  EXPECT_EQ(flags({counter}), 2);
  EXPECT_EQ(flags({order()}), 2);
  EXPECT_EQ(flags({wrong, counter}), 2) << "of two kinds in one tick";
  const auto again = b.desk.order(Desk::none);
  EXPECT_EQ(flags({again}), 1);
  EXPECT_EQ(flags({again, order()}), 2);
  EXPECT_EQ(flags({wrong, order()}), 2);
  EXPECT_EQ(last[0][10] | last[0][11] << 8, 16384) << "half of the first limit";
  EXPECT_EQ(last[0][12] | last[0][13] << 8, 8192) << "a quarter of the second";
}

TEST(LinkEdges, ARecordOfTheVeryFirstTickKnowsOfNoFrames) {
  CommandLink link(link_config());
  std::array<CaptureRecord, 1> last{};
  link.capture_into(last);
  silent_tick(link, in_state(State::enabling));
  CaptureRecord expected{};
  expected[0] = 1;
  expected[23] = static_cast<std::uint8_t>(State::enabling);
  EXPECT_EQ(last[0], expected);
}

// ---- the ring of captured ticks

constexpr CaptureTick nothing{.torque_max = {1, 1}};
static_assert(encode_record(nothing) == CaptureRecord{});
static_assert(encode_record({.state = State::testing, .obeyed = true, .torque_max = {1, 1}})[23] == 0x12);
static_assert(encode_record({.state = State::testing, .refused = true, .torque_max = {1, 1}})[23] == 0x22);

TEST(CaptureEdges, NumbersAreRoundedAndKeptWithinTheirSize) {
  struct Case {
    float v;
    std::int32_t most, rounded;
  };
  constexpr std::int32_t all = 0x7FFF'FFFF;
  for (const auto& [v, most, rounded] :
       {Case{0.7F, 10, 1}, Case{-0.7F, 10, -1}, Case{0.4F, 10, 0}, Case{-0.4F, 10, 0}, Case{1.5F, 10, 2},
        Case{-1.5F, 10, -2}, Case{10.4F, 10, 10}, Case{11, 10, 10}, Case{-11, 10, -10},
        Case{2147483648.0F, all, all}, Case{-2147483648.0F, all, -all}}) {
    EXPECT_EQ(rounded_within(v, most), rounded) << v;
  }
  CaptureTick t;
  EXPECT_EQ(encode_record(t), CaptureRecord{}) << "no limit, no torque: 0";
  t.error = {100, -100};
  t.angle = {-100, 100};
  const CaptureRecord r = encode_record(t);
  const auto number = [&](unsigned at) { return r[at] | r[at + 1] << 8 | r[at + 2] << 16; };
  EXPECT_EQ(number(14), 0x7F'FFFF);
  EXPECT_EQ(number(17), 0x80'0001);
  EXPECT_EQ(number(4), 0x80'0001);
  EXPECT_EQ(number(7), 0x7F'FFFF);
}

struct Ring {
  explicit Ring(std::size_t n) : memory(n), capture(memory) {}
  void record(State s, Fault f = Fault::none) { capture.record({.state = s, .fault = f}); }
  /// The next frame; size 0 if nothing is due.
  hal::CanFrame next() {
    hal::CanFrame out;
    due = capture.transmit(0x780, [&](const hal::CanFrame& f) { return out = f, true; });
    return out;
  }
  /// State, records, and records since power-up.
  std::array<std::uint32_t, 3> ask(std::uint8_t block = 0) {
    capture.read(block);
    const hal::CanFrame f = next();
    EXPECT_TRUE(due);
    EXPECT_EQ(Desk::word(f, 0, 2), 0xFFFFU);
    return {Desk::word(f, 2, 2), Desk::word(f, 4, 2), Desk::word(f, 6, 2)};
  }
  std::vector<CaptureRecord> memory;
  Capture capture;
  bool due = false;
};

TEST(CaptureEdges, TheCountsHaveSixteenBits) {
  using Said = std::array<std::uint32_t, 3>;
  Ring r(600);
  EXPECT_EQ(r.ask(), (Said{2, 0, 0})) << "empty, but it can be read";
  for (int i = 0; i < 0x2EE; ++i) r.record(State::running);
  EXPECT_EQ(r.ask(), (Said{1, 600, 0x2EE}));
  EXPECT_EQ(r.next().size, 0) << "no part while it records";
  EXPECT_FALSE(r.due);
  r.record(State::disabled);
  EXPECT_EQ(r.ask(9), (Said{2, 600, 0x2EE}));
  for (unsigned part = 9 * 64 * 4; part < 600 * 4; ++part) {
    EXPECT_EQ(Desk::word(r.next(), 0, 2), part);
    EXPECT_TRUE(r.due);
  }
  EXPECT_EQ(r.next().size, 0);
}

TEST(CaptureEdges, AFaultThatNoTickPrecedesLeavesNoRecord) {
  Ring r(64);
  r.record(State::fault, Fault::drive_error);
  EXPECT_EQ(r.ask()[1], 0U);
}

// ---- the memory of faults

/// What a memory of faults sends, as it is asked for: {message, fault} of every frame.
struct Faults {
  Faults() { supervisor.begin_tick(Command::enable, {}); }
  void raise(Fault f) {
    supervisor.raise(f);
    memory.update(supervisor, 1, report);
  }
  bool send(bool taken = true) {
    return memory.transmit(0x780, supervisor.fault(), [&](const hal::CanFrame& f) {
      if (taken) heard.push_back({f.id - 0x780U, f.data[0]});
      return taken;
    });
  }
  std::vector<std::array<unsigned, 2>> all() {
    heard.clear();
    while (send()) {
    }
    return heard;
  }
  Supervisor supervisor;
  FaultMemory memory;
  Report report;
  std::vector<std::array<unsigned, 2>> heard;
};
using Sent = std::vector<std::array<unsigned, 2>>;

TEST(FaultMemoryEdges, EveryFaultHasARecordAndADetail) {
  Faults m;
  Sent expected;
  for (unsigned i = 1; i < static_cast<unsigned>(fault_count); ++i) {
    m.raise(static_cast<Fault>(i));
    expected.insert(expected.end(), {{Desk::record, i}, {Desk::detail, i}});
  }
  EXPECT_EQ(m.all(), expected);
  EXPECT_EQ(m.all(), Sent{});
  expected.push_back({Desk::record, 0});
  for (int latched = 1; latched >= 0; --latched) {
    m.memory.read_out();
    EXPECT_EQ(m.all(), expected) << "the end mark last";
    m.supervisor.begin_tick(Command::reset, {});
  }
}

TEST(FaultMemoryEdges, AnEncoderIsBlamedForTheLoopOnly) {
  Faults m;
  m.report.encoder = 1;
  std::vector<unsigned> axis;
  for (const Fault f : {Fault::loop_not_closed, Fault::emergency_stop, Fault::loop_not_closed}) {
    m.report.axis = axis.size() < 2 ? no_axis : 0;  // a drive says more
    m.supervisor.begin_tick(Command::reset, {});
    m.supervisor.begin_tick(Command::enable, {});
    m.raise(f);
    (void)m.memory.transmit(0x780, f, [&](const hal::CanFrame& frame) {
      axis.push_back(frame.data[1]);
      return true;
    });
    (void)m.all();
  }
  EXPECT_EQ(axis, (std::vector<unsigned>{1, no_axis, 0}));
}

TEST(FaultMemoryEdges, TheLatchedFaultIsSentFirstAndWithItsDetail) {
  for (const unsigned latched : {1U, 8U, 31U}) {
    Faults m;
    m.raise(static_cast<Fault>(latched));
    for (const unsigned other : {1U, 5U, 31U}) m.raise(static_cast<Fault>(other));
    EXPECT_TRUE(m.send(false)) << "due also when the bus does not take it";
    Sent expected{{Desk::record, latched}, {Desk::detail, latched}};
    for (const unsigned other : {1U, 5U, 31U}) {
      if (other != latched) expected.insert(expected.end(), {{Desk::record, other}, {Desk::detail, other}});
    }
    EXPECT_EQ(m.all(), expected) << latched;
  }
  // A fault that is latched between the two frames of another one waits for the second.
  Faults m;
  m.raise(Fault::bus_off);
  m.all();
  m.memory.read_out();
  m.supervisor.begin_tick(Command::reset, {});
  m.send();
  m.supervisor.begin_tick(Command::enable, {});
  m.raise(Fault::feedback_not_finite);
  EXPECT_EQ(m.all()[0], (std::array<unsigned, 2>{Desk::detail, 15}));
}

// ---- the table of parameters

TEST(ParameterEdges, OnlyGainsAreWrittenAndRestored) {
  for (int i = 0; i < 32; ++i) {
    LinkConfig c = link_config();
    auto values = c.parameters.values();
    values[11] = static_cast<float>(i);
    c.parameters = Parameters(values, c.parameters.bounds());
    LinkBench b(c);
    EXPECT_EQ(b.one(b.desk.set_gain(4, 1e-3F)), Outcome::refused);
    b.settle();
    EXPECT_EQ(b.desk.last(Desk::value).data[1], static_cast<unsigned>(Answer::read_only));
    const std::array<Gains, 2> gains{{{10, 80, 200, 300}, {7, 7, 7, 7}}};
    EXPECT_TRUE(b.link.restore(gains[0]));
    for (unsigned k = 0; k < parameter_count; ++k) {
      EXPECT_EQ(b.link.parameters().values()[k], k < gain_count ? gains[0][k] : values[k]) << k;
    }
  }
}

TEST(ParameterEdges, WithoutBoundsNothingCanBeWritten) {
  Parameters p({40, 40, 150, 300, 1e-3F, 2, 2, 50, 1, 10, 3, 0}, {});
  for (std::uint8_t i = 0; i < parameter_count; ++i) EXPECT_EQ(p.write(i, 0.5F, true), Answer::read_only);
}

// ---- frames, byte by byte, and what nobody sets

template <class E, std::size_t n>
constexpr bool on_the_wire(const std::array<E, n>& names, const std::array<unsigned, n>& values) {
  for (std::size_t i = 0; i < n; ++i) {
    if (static_cast<unsigned>(names[i]) != values[i]) return false;
  }
  return true;
}
using enum Message;
static_assert(on_the_wire(std::array{command, set_point, stream_position, stream_velocity, parameter_write,
                                     Message::request},
                          {0, 1, 2, 3, 4, 5}));
static_assert(on_the_wire(std::array{status, fault_record, fault_detail, parameter_value, parameter_table,
                                     link_counters, effector, tracking_error, joint_1, identity,
                                     parameter_slots, Message::capture},
                          {0x10, 0x11, 0x12, 0x13, 0x14, 0x15, 0x16, 0x17, 0x18, 0x1C, 0x1D, 0x1E}));
static_assert(joints_max == 4 && incoming_count == 6 && outgoing_first == 0x10 && block_size == 32);
static_assert(protocol_version == 1 && no_axis == 255 && any_session == 0 && subject_count == 4);
static_assert(on_the_wire(std::array{Order::none, Order::arm, Order::disarm, Order::off, Order::reset,
                                     Order::confirm_zero, Order::hold, Order::reference, Order::stream,
                                     Order::store, Order::forget, Order::override, Order::resume},
                          {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 19, 20}));
static_assert(on_the_wire(std::array{Source::hold, Source::reference, Source::stream}, {0, 1, 2}));
static_assert(on_the_wire(std::array{Space::effector, Space::base_joints}, {0, 1}));
static_assert(on_the_wire(std::array{Answer::ok, Answer::unknown_index, Answer::read_only,
                                     Answer::out_of_bounds, Answer::not_now},
                          {0, 1, 2, 3, 4}));
static_assert(on_the_wire(std::array{Subject::faults, Subject::parameter, Subject::table, Subject::capture},
                          {0, 1, 2, 3}));
static_assert(on_the_wire(std::array{Reacted::none, Reacted::zero_torque, Reacted::halt}, {0, 1, 2}));
static_assert(on_the_wire(std::array{Pace::full, Pace::reduced, Pace::held}, {0, 1, 2}));
static_assert(on_the_wire(std::array{StoreState::none, StoreState::idle, StoreState::storing,
                                     StoreState::stored, StoreState::forgetting, StoreState::forgotten,
                                     StoreState::failed},
                          {0, 1, 2, 3, 4, 5, 6}));
static_assert(on_the_wire(std::array{SlotContent::empty, SlotContent::valid, SlotContent::damaged,
                                     SlotContent::other_format, SlotContent::other_scene,
                                     SlotContent::out_of_bounds},
                          {0, 1, 2, 3, 4, 5}));
static_assert(on_the_wire(std::array{CaptureState::none, CaptureState::recording, CaptureState::ready},
                          {0, 1, 2}));
static_assert(capture_record_size == 24 && capture_part_size == 6 && capture_parts == 4);
static_assert(capture_status == 0xFFFF && capture_torque_steps == 32767.0F);
static_assert(position_unit == 1e-6F && velocity_unit == 1e-5F);
static_assert(Capture::block == 64 && Capture::records_max == 16383);
static_assert(parameter_count == 12 && gain_count == 4);
static_assert(on_the_wire(std::array{Index::lambda_position, Index::lambda_angle, Index::gain_position,
                                     Index::gain_angle, Index::sample_time, Index::torque_limit_1,
                                     Index::torque_limit_2, Index::joint_speed, Index::speed,
                                     Index::acceleration, Index::stream_age, Index::silence},
                          {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11}));
static_assert(SlotRecord::words == 8 && SlotRecord::mark == 0x45534D00U && SlotRecord::format_mask == 255);
static_assert(SlotRecord::format == 1);

static_assert(encode_status(0x780, {.tick = 0xABCDEF}, 0x1F).data[1] == 0x0F);
static_assert(encode_fault_record(0x780, {.time_us = 0x01020304}).data[7] == 1);
static_assert(encode_fault_detail(0x780, {.drive_error = 0x01020304}).data[7] == 1);
static_assert(encode_parameter_value(0x780, 3, Answer::ok, true, 1.0F).data[7] == 0x3F);
static_assert(encode_parameter_table(0x780, 0x01020304, 12).data[3] == 1);
static_assert(encode_identity(0x780, 0x01020304, true).data[3] == 1);
static_assert(decode_identity(encode_identity(0x780, 0x01020304, true), 0x780)->scene == 0x01020304);
static_assert(encode_parameter_slots(0x780, {.sequence = 0x01020304}).data[7] == 1);
static_assert(encode_counters(0x780, {.refused = 0x0102}).data[7] == 1);
static_assert(encode_capture(0x780, 0x0102, {1, 2, 3, 4, 5, 6}).data[7] == 6);
static_assert(encode_floats(0x780, 0x16, 1.0F, 2.0F).data[7] == 0x40);

constexpr hal::CanFrame to_controller(unsigned message, std::array<std::uint8_t, 8> bytes) {
  hal::CanFrame f = hal::data_frame(0x780 + message, 8);
  for (std::size_t i = 0; i < 8; ++i) f.data[i] = bytes[i];
  return f;
}
constexpr auto written = decode_parameter_write(to_controller(4, {0, 1, 2, 0, 0, 0, 0x80, 0x3F}));
static_assert(written && written->index == 2 && written->value == 1.0F);
constexpr auto asked = decode_request(to_controller(5, {0, 1, 3, 200, 0, 0, 0, 0}));
static_assert(asked && asked->subject == Subject::capture && asked->index == 200);
static_assert(!decode_request(to_controller(5, {0, 1, 3, 200, 0, 0, 0, 1})));
constexpr auto commanded = decode_command(to_controller(0, {0, 1, 19, 50, 0x34, 0x12, 0x78, 0x56}));
static_assert(commanded && commanded->percent == 50 && commanded->tick == 0x1234);
static_assert(commanded && commanded->parameters == 0x5678);
constexpr auto led = decode_pair(to_controller(1, {0, 0x11, 1, 0, 0, 0xFE, 0xFF, 0xFF}), 0.5F);
static_assert(led && led->space == Space::base_joints && led->value == std::array{0.5F, -1.0F});

TEST(LinkEdges, UnsetFieldsHaveNoEffect) {
  const CommandFrame c;
  EXPECT_EQ(c.order, Order::none);
  EXPECT_EQ(c.percent + c.tick + c.parameters, 0);
  const LinkConfig config;
  EXPECT_EQ(config.base_id, 0U) << "no link";
  EXPECT_EQ(config.session, 1) << "not the one for all";
  EXPECT_EQ(config.counter_jump_max, 2);
  EXPECT_EQ(config.status_ticks, 1U);
  EXPECT_EQ(config.command_age_ticks_max + config.telemetry_ticks + config.table_ticks, 0U);
  EXPECT_EQ(config.period_ns + config.scene, 0U);
  EXPECT_EQ(config.source, Source::reference);
  EXPECT_EQ(config.space, Space::effector);
  EXPECT_TRUE(config.has_path && !config.unattended);
  const Request r;
  EXPECT_EQ(r.source, Source::reference);
  EXPECT_EQ(r.percent, 100);
  EXPECT_FALSE(r.hold || r.has_point || r.has_sample || r.has_gains || r.has_rate);
  const Report report;
  EXPECT_EQ(report.joints + report.drive_error, 0U);
  EXPECT_EQ(report.axis, no_axis);
  const SlotRecord kept;
  EXPECT_EQ(kept.sequence + kept.scene, 0U);
  const Bounds bounds;
  EXPECT_EQ(bounds.lower, 0);
  EXPECT_EQ(bounds.upper, 0);
}

}  // namespace
}  // namespace esmc::test
