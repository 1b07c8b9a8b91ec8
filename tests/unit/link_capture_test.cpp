/// Command interface: the last ticks, kept over a fault and read by frames.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <vector>

#include "tests/support/link_bench.hpp"

namespace esmc::test {
namespace {

/// Of the 24 bytes of a record, by the table of docs/command-interface.md.
struct Row {
  explicit Row(const std::vector<std::uint8_t>& b) : bytes(b) {}
  [[nodiscard]] std::int64_t at(std::size_t from, std::size_t n, bool sign = false) const {
    std::int64_t v = 0;
    for (std::size_t i = n; i-- > 0;) v = v * 256 + bytes[from + i];
    return sign && bytes[from + n - 1] >= 128 ? v - (std::int64_t{1} << (8 * n)) : v;
  }
  [[nodiscard]] std::int64_t tick() const { return at(0, 4); }
  [[nodiscard]] unsigned state() const { return bytes[23] & 15U; }
  std::vector<std::uint8_t> bytes;
};

/// A bench whose link keeps this many ticks.
struct Kept : LinkBench {
  explicit Kept(std::size_t n, const LinkConfig& c = link_config()) : LinkBench(c), memory(n) {
    link.capture_into(memory);
    report.joints = 2;
  }
  /// The frame that says what can be read, after a request for a block.
  hal::CanFrame ask(unsigned block = 0) {
    desk.heard.clear();
    tick({desk.ask(3, block)});
    for (int i = 0; i < 600; ++i) tick();
    for (const auto& f : desk.heard) {
      if (f.id == 0x780 + Desk::capture && Desk::word(f, 0, 2) == 0xFFFF) return f;
    }
    return {};
  }
  /// The records that the last request has brought, by number.
  [[nodiscard]] std::map<unsigned, Row> rows() const {
    std::map<unsigned, std::vector<std::uint8_t>> bytes;
    for (const auto& f : desk.heard) {
      const unsigned number = Desk::word(f, 0, 2);
      if (f.id != 0x780 + Desk::capture || number == 0xFFFF) continue;
      auto& b = bytes[number / 4];
      EXPECT_EQ(b.size(), number % 4 * 6) << "in their order, once each";
      b.insert(b.end(), f.data.begin() + 2, f.data.begin() + 8);
    }
    std::map<unsigned, Row> out;
    for (const auto& [n, b] : bytes) {
      EXPECT_EQ(b.size(), 24U);
      out.emplace(n, Row(b));
    }
    return out;
  }
  std::vector<CaptureRecord> memory;
};

TEST(LinkCapture, WithoutMemoryNothingIsKept) {
  LinkBench b;
  b.run();
  for (int i = 0; i < 20; ++i) b.tick();
  b.tick({b.desk.order(Desk::off)});
  for (int i = 0; i < 5; ++i) b.tick();
  b.tick({b.desk.ask(3, 0)});
  b.settle();
  ASSERT_EQ(b.desk.count(Desk::capture), 1);
  const auto f = b.desk.last(Desk::capture);
  EXPECT_EQ(Desk::word(f, 0, 2), 0xFFFFU);
  EXPECT_EQ(Desk::word(f, 2, 4), 0U);
}

TEST(LinkCapture, KeepsTheLastTicksAndWaitsAfterAFault) {
  constexpr unsigned size = 80, after = size / 8;
  Kept b(size);
  b.run();
  for (int i = 0; i < 200; ++i) b.tick();
  EXPECT_EQ(Desk::word(b.ask(), 2, 1), 1U) << "recording";
  EXPECT_TRUE(b.rows().empty());
  b.tick({}, Fault::drive_error);
  const std::uint32_t fault_tick = [&] {
    for (int i = 0; i < 40; ++i) b.tick();
    return b.desk.tick;
  }();
  auto s = b.ask(0);
  EXPECT_EQ(Desk::word(s, 2, 1), 2U) << "ready";
  ASSERT_EQ(Desk::word(s, 4, 2), size);
  const std::uint32_t recorded = Desk::word(s, 6, 2);
  auto rows = b.rows();
  EXPECT_EQ(rows.size(), 64U) << "a block";
  EXPECT_EQ(Desk::word(b.ask(1), 6, 2), recorded) << "nothing is recorded meanwhile";
  rows.merge(b.rows());
  ASSERT_EQ(rows.size(), size);
  const std::int64_t first = rows.at(0).tick();
  for (const auto& [n, r] : rows) {
    EXPECT_EQ(r.tick(), first + n);
    const bool failed = n >= size - 1 - after;
    EXPECT_EQ(r.state(), static_cast<unsigned>(failed ? State::fault : State::running)) << n;
    EXPECT_EQ(r.bytes[22], static_cast<unsigned>(failed ? Fault::drive_error : Fault::none)) << n;
  }
  EXPECT_LE(rows.at(size - 1).tick(), fault_tick);
  EXPECT_EQ(Desk::word(b.ask(2), 4, 2), size);
  EXPECT_TRUE(b.rows().empty()) << "beyond the last";
  EXPECT_EQ(Desk::word(b.ask(255), 2, 1), 2U);

  // They are kept over the reset, until the next arming; then both runs are there.
  b.tick({b.desk.order(Desk::reset)});
  for (int i = 0; i < 5; ++i) b.tick();
  b.listen();
  ASSERT_EQ(b.one(b.desk.order(Desk::arm)), Outcome::obeyed);
  for (int i = 0; i < 29; ++i) b.tick();
  b.tick({b.desk.order(Desk::off)});
  for (int i = 0; i < 5; ++i) b.tick();
  s = b.ask(0);
  EXPECT_EQ(Desk::word(s, 4, 2), size);
  EXPECT_GT(Desk::word(s, 6, 2), recorded);
  rows = b.rows();
  EXPECT_EQ(rows.at(0).bytes[22], 0U);
  EXPECT_EQ(rows.at(0).tick() - first, Desk::word(s, 6, 2) - recorded) << "the oldest are gone";
}

/// A fault with a halt: the way to rest is recorded as far as the eighth goes, although there is torque.
TEST(LinkCapture, AFaultEndsItWhileTheMechanismIsHeld) {
  Kept b(16);
  b.supervisor = Supervisor({.can_halt = true, .after_halt = AfterHalt::hold});
  b.run();
  b.tick({}, Fault::workspace);
  for (int i = 0; i < 10; ++i) b.tick();
  EXPECT_EQ(b.supervisor.state(), State::halting);
  EXPECT_EQ(Desk::word(b.ask(), 2, 1), 2U);
  const auto rows = b.rows();
  EXPECT_EQ(rows.rbegin()->second.state(), static_cast<unsigned>(State::halting));
  unsigned halting = 0;
  for (const auto& [n, r] : rows) halting += r.state() == static_cast<unsigned>(State::halting) ? 1U : 0U;
  EXPECT_EQ(halting, 3U) << "its tick and an eighth";
}

TEST(LinkCapture, ABusThatTakesNothingGetsEveryPartLater) {
  Kept b(10);
  b.run();
  for (int i = 0; i < 20; ++i) b.tick();
  b.tick({b.desk.order(Desk::off)});
  for (int i = 0; i < 5; ++i) b.tick();
  b.refused_id = 0x780 + Desk::capture;
  b.refused = 7;
  EXPECT_EQ(Desk::word(b.ask(), 4, 2), 10U);
  EXPECT_EQ(b.refused, 0);
  EXPECT_EQ(b.rows().size(), 10U);
  // In the midst of the parts as well.
  b.desk.heard.clear();
  b.tick({b.desk.ask(3, 0)});
  for (int i = 0; i < 30; ++i) b.tick();
  b.refused = 3;
  for (int i = 0; i < 600; ++i) b.tick();
  EXPECT_EQ(b.refused, 0);
  EXPECT_EQ(b.rows().size(), 10U);
  // Arming ends a readout.
  b.refused = 0;
  b.listen();
  b.desk.heard.clear();
  b.tick({b.desk.ask(3, 0)});
  ASSERT_EQ(b.one(b.desk.order(Desk::arm)), Outcome::obeyed);
  for (int i = 0; i < 50; ++i) b.tick();
  EXPECT_LE(b.desk.count(Desk::capture), 3);
}

TEST(LinkCapture, ARecordSaysWhatTheTickWas) {
  Kept b(20);
  b.run();
  for (int i = 0; i < 3; ++i) b.tick();
  b.report = {{}, {-1.5e-3F, 2.5e-3F}, {0.25F, 9.0F, -1.5F, 9.0F}, {0.5F, 9.0F, -2.0F, 9.0F}, 4, no_axis, 0};
  b.link.late_by(123);
  b.tick({b.desk.order(Desk::none)});
  hal::CanFrame wrong = b.desk.order(Desk::none);
  wrong.data[0] ^= 1;
  b.link.late_by(70'000);
  b.report.angle[0] = 100.0F;
  b.report.angle[2] = -100.0F;
  b.report.torque[0] = std::numeric_limits<float>::quiet_NaN();
  b.tick({wrong});
  b.tick({b.desk.order(Desk::off)});
  for (int i = 0; i < 5; ++i) b.tick();
  b.ask();
  std::vector<Row> rows;
  for (const auto& [n, r] : b.rows()) rows.push_back(r);
  const auto at = std::ranges::find_if(rows, [](const Row& r) { return r.at(20, 2) == 123; });
  ASSERT_NE(at, rows.end());
  EXPECT_EQ(at->at(4, 3, true), 250'000) << "urad";
  EXPECT_EQ(at->at(7, 3, true), -1'500'000) << "the second base joint is the third with a motor";
  EXPECT_EQ(at->at(10, 2, true), 8192) << "a quarter of the limit, in steps of 1/32767";
  EXPECT_EQ(at->at(12, 2, true), -32767);
  EXPECT_EQ(at->at(14, 3, true), -1500) << "um";
  EXPECT_EQ(at->at(17, 3, true), 2500);
  EXPECT_EQ(at->bytes[22], 0U);
  EXPECT_EQ(at->bytes[23], 0x10U | static_cast<unsigned>(State::running)) << "a frame was obeyed";
  const Row& next = *(at + 1);
  EXPECT_EQ(next.at(4, 3, true), 0x7F'FFFF) << "as large as it can be";
  EXPECT_EQ(next.at(7, 3, true), -0x7F'FFFF);
  EXPECT_EQ(next.at(10, 2, true), 0) << "no number";
  EXPECT_EQ(next.at(20, 2), 0xFFFF);
  EXPECT_EQ(next.bytes[23], 0x20U | static_cast<unsigned>(State::running)) << "a frame was refused";
}

/// After 22 minutes of a console with 50 signs of life a second.
TEST(LinkCapture, SaysHoweverLongThatAFrameWasObeyedOrRefused) {
  Kept b(20);
  b.run();
  hal::CanFrame wrong = b.desk.order(Desk::none);
  wrong.size = 7;
  for (int i = 0; i < 70'000; ++i) {
    ASSERT_EQ(b.link.receive(b.desk.order(Desk::none)), Outcome::obeyed);
    (void)b.link.receive(wrong);
  }
  b.tick();
  for (int i = 0; i < 4; ++i) b.tick();
  b.tick({b.desk.order(Desk::none)});
  b.tick({wrong});
  b.tick({b.desk.order(Desk::off)});
  for (int i = 0; i < 5; ++i) b.tick();
  b.ask();
  std::vector<unsigned> said;
  for (const auto& [n, r] : b.rows()) said.push_back(r.bytes[23] & 0x30U);
  ASSERT_GE(said.size(), 8U);
  const std::vector<unsigned> wanted{0x00, 0x10, 0x20, 0x10};
  EXPECT_NE(std::search(said.begin(), said.end(), wanted.begin(), wanted.end()), said.end());
}

/// A reference that may run without a console: only once it runs, and nothing else does.
TEST(LinkUnattended, OnlyTheReferenceGoesOnWithoutASignOfLife) {
  constexpr int silence = 10;
  for (const bool unattended : {false, true}) {
    for (const unsigned source : {Desk::reference, Desk::stream, Desk::hold}) {
      LinkConfig c = with_silence(silence);
      c.unattended = unattended;
      LinkBench b(c);
      b.supervisor = Supervisor({.can_halt = true, .after_halt = AfterHalt::hold});
      b.run(source);
      b.settle();
      EXPECT_EQ(b.desk.last(Desk::identity).data[5], unattended ? 1 : 0);
      for (int i = 0; i < 5 * silence; ++i) b.tick();
      const bool alone = unattended && source == Desk::reference;
      EXPECT_EQ(b.supervisor.fault(), alone ? Fault::none : Fault::command_lost);
      EXPECT_EQ(b.supervisor.running(), alone);
      if (!alone) continue;
      // An order still ends it, and nobody is needed for the way to rest.
      EXPECT_EQ(b.one(b.desk.order(Desk::disarm)), Outcome::obeyed);
      for (int i = 0; i < 5 * silence; ++i) b.tick();
      EXPECT_EQ(b.supervisor.state(), State::halting);
      EXPECT_EQ(b.supervisor.fault(), Fault::none);
    }
  }
}

/// Until it runs somebody has to be there.
TEST(LinkUnattended, ArmingNeedsASignOfLife) {
  LinkConfig c = with_silence(10);
  c.unattended = true;
  LinkBench b(c);
  b.supervisor = Supervisor({.sign_test = true});
  b.listen();
  ASSERT_EQ(b.one(b.desk.order(Desk::arm)), Outcome::obeyed);
  for (int i = 0; i < 10; ++i) b.tick();
  EXPECT_EQ(b.supervisor.state(), State::testing);
  b.tick();
  EXPECT_EQ(b.supervisor.fault(), Fault::command_lost);
}

}  // namespace
}  // namespace esmc::test
