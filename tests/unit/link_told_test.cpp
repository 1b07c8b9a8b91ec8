/// Command interface: gains, parameters, status, faults, telemetry.

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "tests/support/link_bench.hpp"

namespace esmc::test {
namespace {

TEST(Link, GainsWithinBoundsWhileDisabled) {
  LinkBench b;
  b.listen();
  const std::uint32_t before = b.desk.crc32;
  const Request r = b.tick({b.desk.set_gain(0, 55.5F)});
  EXPECT_EQ(b.outcomes[0], Outcome::obeyed);
  EXPECT_TRUE(r.has_gains);
  EXPECT_EQ(b.link.parameters()[Index::lambda_position], 55.5F);
  EXPECT_EQ(Desk::real(b.desk.last(Desk::value), 4), 55.5F) << "told at once";
  b.settle();
  EXPECT_NE(b.desk.crc32, before) << "and the table after it";
  struct Case {
    unsigned index;
    float value;
    Answer answer;
  };
  for (const Case& c : {Case{0, 9.9F, Answer::out_of_bounds}, Case{1, 80.1F, Answer::out_of_bounds},
                        Case{2, NAN, Answer::out_of_bounds}, Case{2, -INFINITY, Answer::out_of_bounds},
                        Case{3, 10.0F, Answer::read_only}, Case{4, 1e-3F, Answer::read_only},
                        Case{12, 0.0F, Answer::unknown_index}, Case{255, 0.0F, Answer::unknown_index}}) {
    EXPECT_EQ(b.one(b.desk.set_gain(c.index, c.value)), Outcome::refused);
    b.tick();
    const auto answer = b.desk.last(Desk::value);
    EXPECT_EQ(answer.data[0], c.index);
    EXPECT_EQ(answer.data[1], static_cast<unsigned>(c.answer)) << c.index;
    EXPECT_EQ(answer.data[2], c.index < 3 ? 1 : 0);
  }
  b.run();
  EXPECT_EQ(b.one(b.desk.set_gain(0, 50.0F)), Outcome::refused);
  EXPECT_EQ(b.desk.last(Desk::value).data[1], static_cast<unsigned>(Answer::not_now));
  EXPECT_EQ(b.link.parameters()[Index::lambda_position], 55.5F);
}

TEST(Link, TheTableAndItsChecksum) {
  LinkBench b;
  std::vector<std::uint8_t> bytes;
  for (unsigned i = 0; i < 12; ++i) b.tick({b.desk.ask(1, i)});
  for (int i = 0; i < 3; ++i) b.settle();
  unsigned index = 0;
  for (const auto& f : b.desk.heard) {
    if (f.id != 0x780U + Desk::value) continue;
    ASSERT_EQ(f.data[0], index) << "one answer each, in the order of the parameters";
    ASSERT_EQ(f.data[1], 0);
    EXPECT_EQ(Desk::real(f, 4), b.link.parameters().at(static_cast<std::uint8_t>(index++)));
    for (std::size_t k = 4; k < 8; ++k) bytes.push_back(f.data[k]);
  }
  EXPECT_EQ(index, 12U);
  EXPECT_EQ(b.desk.count(Desk::identity), 1);
  EXPECT_GE(b.desk.count(Desk::status), 6) << "answers in every tick do not hold it back";
  b.tick({b.desk.ask(1, 12)});
  b.settle();
  EXPECT_EQ(b.desk.last(Desk::value).data[1], static_cast<unsigned>(Answer::unknown_index));
  b.tick({b.desk.ask(2)});
  b.settle();
  EXPECT_EQ(b.desk.crc32, crc32(bytes));
  EXPECT_EQ(b.desk.last(Desk::table).data[4], 12);
  EXPECT_EQ(Desk::word(b.desk.last(Desk::counts), 0, 2), 14U);
  EXPECT_NE(Parameters().crc(), 0U);
}

TEST(Link, WhichSceneItWasMadeOfIsToldAtOnceOnRequestAndWithTheTable) {
  LinkConfig c = link_config();
  c.table_ticks = 20;
  LinkBench b(c);
  b.bus_takes = false;
  b.tick();
  b.bus_takes = true;
  b.tick();
  const auto f = b.desk.last(Desk::identity);
  EXPECT_EQ(b.desk.count(Desk::identity), 1);
  EXPECT_EQ(f.size, 8);
  EXPECT_EQ(Desk::word(f, 0, 4), 0x89ABCDEFU);
  EXPECT_EQ(f.data[4], protocol_version);
  EXPECT_EQ(Desk::word(f, 5, 3), 0U);
  EXPECT_EQ(decode_identity(f, c.base_id)->scene, 0x89ABCDEFU);
  b.tick({b.desk.ask(2)});
  b.settle();
  EXPECT_EQ(b.desk.count(Desk::identity), 2);
  while (b.desk.count(Desk::table) < 4) b.tick();
  b.settle();
  EXPECT_EQ(b.desk.count(Desk::identity), 5) << "with the table in tick 20, 40 and 60";
  EXPECT_EQ(b.link.receive(f), Outcome::foreign_command) << "a frame with our identifier";
}

TEST(Link, StatusEveryFewTicksAndAtEveryChange) {
  LinkBench b;
  for (int i = 0; i < 40; ++i) b.tick();
  EXPECT_EQ(b.desk.count(Desk::status), 10);
  const auto f = b.desk.last(Desk::status);
  EXPECT_EQ(f, b.desk.seal(f, f.data[7]));
  EXPECT_EQ(b.desk.tick, 40U);
  EXPECT_EQ(f.data[1] & 15, 10);
  // What the bus did not take is told in the next ticks, the change first.
  b.tick({b.desk.ask(2)});
  b.settle();
  b.bus_takes = false;
  b.tick({b.desk.order(Desk::arm), b.desk.ask(1, 0), b.desk.ask(2)});
  b.bus_takes = true;
  b.desk.heard.clear();
  b.tick();
  EXPECT_EQ(b.desk.count(Desk::status), 1);
  b.tick();
  EXPECT_EQ(b.desk.count(Desk::value), 1);
  b.settle();
  EXPECT_EQ(b.desk.count(Desk::table), 1);
  EXPECT_EQ(b.desk.state, 2U + 1U) << "already running";
}

TEST(Link, ReactionsInStatus) {
  LinkBench b;
  b.supervisor = Supervisor({.can_halt = true, .after_halt = AfterHalt::hold});
  b.run();
  b.tick({}, Fault::workspace);
  EXPECT_EQ(b.desk.state, static_cast<unsigned>(State::halting));
  EXPECT_EQ(b.desk.reaction, 2U);
  EXPECT_EQ(b.desk.source, 2U);
  // A fault that changes no state is told at once as well.
  LinkBench c;
  c.supervisor = Supervisor({.can_halt = true, .after_halt = AfterHalt::hold});
  c.run();
  c.tick({c.desk.order(Desk::disarm)});
  ASSERT_EQ(c.supervisor.state(), State::halting);
  while (c.desk.tick % 4 != 0) c.tick();
  c.tick({}, Fault::workspace);
  EXPECT_EQ(c.desk.state, static_cast<unsigned>(State::halting));
  EXPECT_EQ(c.desk.fault, static_cast<unsigned>(Fault::workspace));
  EXPECT_EQ(c.desk.reaction, 2U);
}

TEST(Link, FaultRecordsAreSentOnceAndReadOutOnRequest) {
  LinkBench b;
  b.run();
  b.report.axis = 1;
  b.report.drive_error = 0xDEADBEEF;
  b.desk.heard.clear();
  b.tick({}, Fault::drive_error);
  EXPECT_EQ(b.desk.heard.size(), 1U);
  EXPECT_EQ(b.desk.fault, static_cast<unsigned>(Fault::drive_error)) << "first Status, then the record";
  const unsigned at = b.desk.tick;
  b.settle();
  const auto r = b.desk.last(Desk::record), d = b.desk.last(Desk::detail);
  EXPECT_EQ(r.data[0], static_cast<unsigned>(Fault::drive_error));
  EXPECT_EQ(r.data[1], 1);
  EXPECT_EQ(Desk::word(r, 2, 2), 1U);
  EXPECT_EQ(Desk::word(r, 4, 4), 1000 * at);
  EXPECT_EQ(d.data[0], r.data[0]);
  EXPECT_EQ(Desk::word(d, 4, 4), 0xDEADBEEFU);
  b.desk.heard.clear();
  b.tick({}, Fault::bus_off);
  b.settle();
  EXPECT_EQ(b.desk.count(Desk::record), 1) << "the later one alone";
  EXPECT_EQ(b.desk.last(Desk::record).data[0], static_cast<unsigned>(Fault::bus_off));
  b.desk.heard.clear();
  b.tick({b.desk.ask(0)});
  b.bus_takes = false;
  for (int i = 0; i < 8; ++i) b.tick();
  b.bus_takes = true;
  for (int i = 0; i < 16; ++i) b.tick();
  EXPECT_EQ(b.desk.count(Desk::record), 3);
  EXPECT_EQ(b.desk.count(Desk::detail), 2);
  const auto end = b.desk.last(Desk::record);
  EXPECT_EQ(end.data[0], 0);
  EXPECT_EQ(Desk::word(end, 2, 2), 2U);
}

TEST(Link, AReadoutIncludesWhatIsStillWaiting) {
  LinkBench b;
  b.run();
  b.tick({}, Fault::drive_error);
  b.settle();
  b.bus_takes = false;
  b.tick({}, Fault::bus_off);
  b.bus_takes = true;
  b.desk.heard.clear();
  b.tick({b.desk.ask(0)});
  for (int i = 0; i < 16; ++i) b.tick();
  EXPECT_EQ(b.desk.count(Desk::record), 3);
}

TEST(Link, AnAnswerThatTheBusRefusesIsSentAgain) {
  LinkBench b;
  b.settle();
  b.refused_id = 0x780 + Desk::value;
  b.refused = 2;
  b.desk.heard.clear();
  b.tick({b.desk.ask(1, 2)});
  b.settle();
  EXPECT_EQ(b.refused, 0);
  EXPECT_EQ(b.desk.count(Desk::value), 1);
  EXPECT_EQ(b.desk.last(Desk::value).data[0], 2);
}

TEST(Link, ADetailThatTheBusRefusesIsSentAgain) {
  LinkBench b;
  b.run();
  b.refused_id = 0x780 + Desk::detail;
  b.refused = 1;
  b.desk.heard.clear();
  b.tick({}, Fault::drive_error);
  b.settle();
  EXPECT_EQ(b.refused, 0);
  EXPECT_EQ(b.desk.count(Desk::record), 1);
  EXPECT_EQ(b.desk.count(Desk::detail), 1);
}

/// The fault occurs again between the two frames of its record: both are of the same occurrence.
TEST(Link, ARecordAndItsDetailBelongTogether) {
  LinkConfig c = link_config();
  c.status_ticks = 0;
  LinkBench b(c);
  b.supervisor = Supervisor({.can_halt = true, .after_halt = AfterHalt::hold});
  b.run();
  b.settle();
  b.desk.heard.clear();
  b.report.drive_error = 1;
  b.tick({}, Fault::drive_error);
  while (b.desk.count(Desk::record) == 0) b.tick();
  EXPECT_EQ(b.desk.count(Desk::detail), 0);
  b.refused_id = 0x780 + Desk::detail;
  b.refused = 100;
  b.report.drive_error = 2;
  b.tick({b.desk.order(Desk::reset)});
  for (int i = 0; i < 3; ++i) b.tick();
  b.tick({b.desk.order(Desk::arm)});
  EXPECT_LT(b.refused, 100);
  b.tick({}, Fault::drive_error);
  b.refused = 0;
  b.settle();
  EXPECT_EQ(b.desk.count(Desk::record), 2);
  EXPECT_EQ(b.desk.count(Desk::detail), 1);
  EXPECT_EQ(Desk::word(b.desk.last(Desk::record), 2, 2), 2U);
  EXPECT_EQ(Desk::word(b.desk.last(Desk::detail), 4, 4), 2U);
}

/// Whatever is due: never two frames in a tick, and every kind has its turn.
TEST(Link, OneFrameInATickAndNoKindWaitsForEver) {
  LinkConfig c = link_config();
  c.status_ticks = 1;
  c.telemetry_ticks = 1;
  c.table_ticks = 2;
  LinkBench b(c);
  b.report.joints = 4;
  b.run();
  b.tick({}, Fault::drive_error);
  b.desk.heard.clear();
  b.tick({b.desk.ask(0)});
  for (std::size_t i = 2; i <= 200; ++i) {
    b.tick();
    ASSERT_EQ(b.desk.heard.size(), i);
  }
  for (const unsigned m : {Desk::status, Desk::counts, Desk::identity}) EXPECT_GE(b.desk.count(m), 15) << m;
  EXPECT_GE(b.desk.count(Desk::effector), 3);
  EXPECT_EQ(b.desk.count(Desk::record), 2);
}

TEST(Link, Telemetry) {
  LinkConfig c = link_config();
  c.telemetry_ticks = 10;
  c.table_ticks = 20;
  LinkBench b(c);
  b.report = {{0.1F, 0.2F}, {1e-3F, -2e-3F}, {0.5F, 1.5F, 2.5F, 3.5F}, {1, 2, 3, 4}, 3, no_axis, 0};
  b.bus_takes = false;
  for (int i = 0; i < 19; ++i) b.tick();  // the first set begins in tick 10 and waits
  b.bus_takes = true;
  for (int i = 0; i < 40; ++i) b.tick();
  EXPECT_EQ(b.desk.count(Desk::effector), 4);
  EXPECT_EQ(b.desk.count(Desk::error), 4);
  EXPECT_EQ(b.desk.count(Desk::table), 2);
  EXPECT_EQ(b.desk.count(Desk::counts), 2);
  EXPECT_EQ(Desk::real(b.desk.last(Desk::error), 4), -2e-3F);
  for (unsigned i = 0; i < 4; ++i) EXPECT_EQ(b.desk.count(Desk::joint + i), i < 3 ? 4 : 0);
  EXPECT_EQ(Desk::real(b.desk.last(Desk::joint + 2), 0), 2.5F);
  EXPECT_EQ(Desk::real(b.desk.last(Desk::joint + 2), 4), 3.0F);
}

/// A console finds out by differences what became of its orders, also after a day of another one's frames.
TEST(Link, CountersGoOnFromZeroAfterTheTop) {
  LinkBench b;
  hal::CanFrame f = b.desk.order(Desk::none);
  f.size = 3;
  for (int i = 0; i < 65'536 + 7; ++i) (void)b.link.receive(f);
  EXPECT_EQ(b.link.counters().refused, 7);
  (void)b.link.receive(f);
  EXPECT_EQ(b.link.counters().refused, 8);
}

}  // namespace
}  // namespace esmc::test
