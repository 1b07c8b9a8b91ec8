/// Command interface: checksums, format, counters, orders.

#include <gtest/gtest.h>

#include <numeric>
#include <string_view>
#include <vector>

#include "tests/support/link_bench.hpp"

namespace esmc::test {
namespace {

TEST(Crc, CheckValuesOfTheCatalogue) {
  constexpr std::string_view digits = "123456789";
  std::vector<std::uint8_t> bytes(digits.begin(), digits.end());
  std::uint8_t c = crc8_start;
  for (const std::uint8_t b : bytes) c = crc8_add(c, b);
  EXPECT_EQ(c ^ crc8_inverted, 0x4B);
  EXPECT_EQ(j1850(bytes), 0x4B);
  EXPECT_EQ(crc32(bytes), 0xCBF43926U);
}

TEST(Link, IsNotThereWithoutABase) {
  CommandLink none;
  EXPECT_FALSE(none.active());
  none.begin_tick();
  for (std::uint32_t id = 0; id < 0x800; ++id) {
    EXPECT_EQ(none.receive(hal::data_frame(id, 8)), Outcome::not_mine) << id;
  }
  EXPECT_FALSE(none.lost());
  EXPECT_EQ(none.session(), 1);
  const Request r = none.take();
  EXPECT_EQ(r.command, Command::none);
  EXPECT_EQ(r.source, Source::reference);
}

TEST(Link, HearsTheIdentifiersOfItsBlockAndNoOthers) {
  const auto heard = [](const CommandLink& link) {
    hal::IdFilters filters;
    link.add_filters(filters);
    std::vector<std::uint32_t> ids;
    for (std::uint32_t id = 0; id < 0x800; ++id) {
      for (const hal::IdFilter& f : filters.list()) {
        if (f.matches({.id = id})) ids.push_back(id);
        EXPECT_FALSE(f.matches({.id = id, .extended = true}));
      }
    }
    return ids;
  };
  std::vector<std::uint32_t> block(32);
  std::iota(block.begin(), block.end(), 0x780);
  EXPECT_EQ(heard(CommandLink(link_config())), block);
  EXPECT_TRUE(heard(CommandLink{}).empty());
}

TEST(Link, FramesOfOthersAreNotItsBusiness) {
  LinkBench b;
  hal::CanFrame f = b.desk.order(Desk::off);
  f.extended = true;
  EXPECT_EQ(b.one(f), Outcome::not_mine);
  for (const unsigned id : {0x77FU, 0x7A0U, 0U, 0x7FFU}) {
    f = b.desk.order(Desk::off);
    f.id = id;
    EXPECT_EQ(b.one(f), Outcome::not_mine) << id;
  }
  f = b.desk.order(Desk::off);
  f.id = 0x790;
  EXPECT_EQ(b.one(f), Outcome::foreign_command);
  f.remote = true;
  EXPECT_EQ(b.one(f), Outcome::not_mine);
  const Counters c = b.link.counters();
  EXPECT_EQ(c.obeyed + c.bad_crc + c.bad_counter + c.refused, 0);
}

TEST(Link, FormatIsCheckedBeforeAnythingElse) {
  LinkBench b;
  b.run();
  const int before = b.link.counters().refused;
  for (unsigned message = 0; message < 16; ++message) {
    for (int kind = 0; kind < 4; ++kind) {
      hal::CanFrame f = b.desk.make(0, 3);
      f.id = 0x780 + message;
      if (kind == 0) f.size = 7;
      if (kind == 1) f.remote = true;
      if (kind == 2) f.fd = true;
      if (kind == 3) {
        if (message < 6) continue;
        f = b.desk.seal(f, b.desk.session);
      }
      EXPECT_EQ(b.one(f), Outcome::malformed) << message << ' ' << kind;
    }
  }
  EXPECT_EQ(b.supervisor.state(), State::running);
  EXPECT_EQ(b.link.counters().refused, before + 16 * 3 + 10);
}

TEST(Link, BitsWithoutAMeaningAreMalformed) {
  LinkBench b;
  b.run();
  const auto with = [&](unsigned message, std::uint64_t payload, unsigned tag) {
    const unsigned counter = b.desk.counter[message];
    const Outcome o = b.one(b.desk.make(message, payload, tag));
    b.desk.counter[message] = static_cast<std::uint8_t>(counter);  // no frame without a meaning counts
    return o;
  };
  EXPECT_EQ(with(Desk::command, 12, 0), Outcome::malformed);
  EXPECT_EQ(with(Desk::command, 3, 1), Outcome::malformed);
  EXPECT_EQ(with(Desk::command, 3 | 0x100, 0), Outcome::malformed);
  EXPECT_EQ(with(Desk::point, 0, 2), Outcome::malformed);
  EXPECT_EQ(with(Desk::position, 0, 4), Outcome::malformed);
  EXPECT_EQ(with(Desk::velocity, 0, 8), Outcome::malformed);
  EXPECT_EQ(with(Desk::write, 0, 1), Outcome::malformed);
  EXPECT_EQ(with(Desk::write, 0x100, 0), Outcome::malformed);
  EXPECT_EQ(with(Desk::request, 0, 1), Outcome::malformed);
  EXPECT_EQ(with(Desk::request, 4, 0), Outcome::malformed);
  EXPECT_EQ(with(Desk::request, 0x10000, 0), Outcome::malformed);
  EXPECT_EQ(b.supervisor.state(), State::running);
}

TEST(Link, EveryFlippedBitIsFound) {
  LinkBench b;
  b.run();
  for (const unsigned message : {0U, 1U, 2U, 3U, 4U, 5U}) {
    const hal::CanFrame good = message == 0 ? b.desk.order(Desk::off) : b.desk.make(message, 0);
    for (unsigned bit = 0; bit < 64; ++bit) {
      hal::CanFrame f = good;
      f.data[bit / 8] = static_cast<std::uint8_t>(f.data[bit / 8] ^ (1U << (bit % 8)));
      EXPECT_EQ(b.one(f), Outcome::bad_crc) << message << ' ' << bit;
    }
    hal::CanFrame f = good;
    f.id = 0x780 + (message + 1) % 6;  // the same bytes under another identifier
    EXPECT_EQ(b.one(f), Outcome::bad_crc);
  }
  EXPECT_EQ(b.link.counters().bad_crc, 6 * 65);
  EXPECT_EQ(b.supervisor.state(), State::running);
}

TEST(Link, ArmsDisarmsAndResets) {
  LinkBench b;
  b.listen();
  EXPECT_EQ(b.one(b.desk.order(Desk::none)), Outcome::obeyed);
  EXPECT_EQ(b.supervisor.state(), State::disabled);
  EXPECT_EQ(b.one(b.desk.order(Desk::arm)), Outcome::obeyed);
  EXPECT_EQ(b.supervisor.state(), State::enabling);
  EXPECT_EQ(b.desk.state, 1U) << "a change of state is told at once";
  b.tick();
  EXPECT_EQ(b.supervisor.state(), State::running);
  EXPECT_EQ(b.one(b.desk.order(Desk::arm)), Outcome::refused);
  EXPECT_EQ(b.one(b.desk.order(Desk::confirm_zero)), Outcome::refused);
  EXPECT_EQ(b.one(b.desk.order(Desk::reference)), Outcome::refused);
  EXPECT_EQ(b.one(b.desk.order(Desk::stream)), Outcome::refused);
  EXPECT_EQ(b.one(b.desk.order(Desk::hold)), Outcome::obeyed) << "on the path";
  EXPECT_EQ(b.tick({b.desk.order(Desk::disarm)}).command, Command::halt);
  EXPECT_EQ(b.supervisor.state(), State::stopping);
  b.tick();
  EXPECT_EQ(b.supervisor.state(), State::disabled);
  EXPECT_EQ(b.desk.session, 78) << "another session after every episode";
  EXPECT_EQ(b.tick({b.desk.order(Desk::confirm_zero)}).command, Command::confirm_zero);
  b.tick({b.desk.order(Desk::arm)});
  b.tick();
  b.tick({}, Fault::drive_error);
  EXPECT_EQ(b.desk.state, static_cast<unsigned>(State::fault));
  EXPECT_EQ(b.desk.fault, static_cast<unsigned>(Fault::drive_error));
  EXPECT_EQ(b.desk.reaction, 1U);
  b.tick({b.desk.order(Desk::reset)});
  EXPECT_EQ(b.supervisor.state(), State::disabled);
}

TEST(Link, OffIsNotSoftenedAndNotOverruled) {
  LinkBench b;
  b.run();
  EXPECT_EQ(b.tick({b.desk.order(Desk::disarm), b.desk.order(Desk::off), b.desk.order(Desk::disarm)}).command,
            Command::stop);
  b.tick();
  ASSERT_EQ(b.supervisor.state(), State::disabled);
  EXPECT_EQ(b.tick({b.desk.order(Desk::off), b.desk.order(Desk::arm)}).command, Command::stop);
  EXPECT_EQ(b.outcomes[1], Outcome::refused);
  EXPECT_EQ(b.tick({b.desk.order(Desk::arm), b.desk.order(Desk::off)}).command, Command::stop);
  EXPECT_EQ(b.supervisor.state(), State::disabled);
}

TEST(Link, TakingTorqueAwayNeedsNeitherCounterNorSession) {
  LinkBench b;
  b.run();
  const hal::CanFrame good = b.desk.order(Desk::off);
  EXPECT_EQ(b.one(good), Outcome::obeyed);
  EXPECT_EQ(b.one(good), Outcome::obeyed) << "repeated";
  b.tick();
  for (const unsigned what : {Desk::disarm, Desk::off}) {
    hal::CanFrame f;
    f.id = 0x780;
    f.size = 8;
    f.data[2] = static_cast<std::uint8_t>(what);
    EXPECT_EQ(b.one(b.desk.seal(f, 0)), Outcome::obeyed);
  }
  for (const unsigned what : {Desk::none, Desk::arm, Desk::reset, Desk::hold, 9U, 50U}) {
    hal::CanFrame f = b.desk.order(what);
    EXPECT_EQ(b.one(b.desk.seal(f, 0)), Outcome::refused) << what;
  }
  EXPECT_EQ(b.one(b.desk.seal(b.desk.pair(Desk::point, 0, 0), 0)), Outcome::bad_crc);
  hal::CanFrame reserved = b.desk.order(Desk::off);
  reserved.data[3] = 1;
  EXPECT_EQ(b.one(b.desk.seal(reserved, 0)), Outcome::refused);
}

TEST(Link, AnOrderAnswersARecentStatus) {
  LinkBench b;
  b.listen();
  const std::uint32_t tick = b.desk.tick;
  for (int i = 0; i < 60; ++i) b.tick();
  const std::uint32_t now = b.desk.tick;
  b.desk.tick = tick;
  EXPECT_EQ(b.one(b.desk.order(Desk::arm)), Outcome::refused);
  b.desk.tick = now + 10;
  EXPECT_EQ(b.one(b.desk.order(Desk::arm)), Outcome::refused) << "from the future";
  b.desk.tick = now;
  b.desk.crc32 ^= 1;
  EXPECT_EQ(b.one(b.desk.order(Desk::arm)), Outcome::refused) << "other parameters";
  b.desk.crc32 ^= 1;
  EXPECT_EQ(b.one(b.desk.order(Desk::arm)), Outcome::obeyed);
}

TEST(Link, CounterRules) {
  for (int step = 0; step < 16; ++step) {
    LinkBench b;
    b.run();
    ASSERT_EQ(b.one(b.desk.pair(Desk::point, 0, 170'000)), Outcome::obeyed);
    b.desk.counter[Desk::point] = static_cast<std::uint8_t>((b.desk.counter[Desk::point] + step - 1) & 15);
    const bool good = step == 1 || step == 2;
    EXPECT_EQ(b.one(b.desk.pair(Desk::point, 10'000, 170'000)), good ? Outcome::obeyed : Outcome::bad_counter)
        << step;
    EXPECT_EQ(b.link.counters().bad_counter, good ? 0 : 1);
    EXPECT_TRUE(good || !b.tick().has_point);
  }
}

TEST(Link, AComputerThatStartsAnewIsInStepAfterFifteenFrames) {
  LinkBench b;
  b.listen();
  b.desk.counter[0] = static_cast<std::uint8_t>(b.desk.counter[0] + 7);
  ASSERT_EQ(b.one(b.desk.order(Desk::none)), Outcome::obeyed);
  b.desk.counter[0] = 15;
  int n = 1;
  while (b.one(b.desk.order(Desk::none)) != Outcome::obeyed) ++n;
  EXPECT_LE(n, 15);
}

TEST(Link, SessionsSkipTheOneThatIsForAll) {
  LinkConfig c = link_config();
  c.session = 255;
  LinkBench b(c);
  b.run();
  b.tick({b.desk.order(Desk::off)});
  b.tick();
  EXPECT_EQ(b.link.session(), 1);
}

constexpr unsigned half = 0x8000, period = 2 * half;  // ticks that 16 bits tell apart

/// A bench at this tick, whose computer has heard the last Status.
void advance(LinkBench& b, unsigned tick) {
  while (b.now < tick) {
    b.tick();
    b.desk.heard.clear();
  }
}

TEST(Link, AnArmThatIsHeldBackForAllTicksThatSixteenBitsTellApartIsRefused) {
  for (const unsigned sent :
       {100U, half - 2, half - 1, half, half + 1, half + 49, half + 51, period - 1, period + 3}) {
    LinkBench b;
    b.listen();
    advance(b, sent);
    hal::CanFrame arm = b.desk.order(Desk::arm);
    for (const unsigned later : {period - 1, period, period + 49}) {
      advance(b, sent + later - 1);
      EXPECT_EQ(b.one(arm), Outcome::bad_crc) << sent << ' ' << later;
    }
    EXPECT_EQ(b.supervisor.state(), State::disabled);
  }
}

TEST(Link, ANewSessionRefusesNoOrderThatAnswersARecentStatus) {
  for (const unsigned after : {0U, 1U, 46U, 47U, 49U, 50U, 51U}) {
    for (const unsigned waited : {0U, 2U}) {
      LinkBench b;
      b.listen();
      advance(b, half - 1);
      const hal::CanFrame arm = b.desk.order(Desk::arm);  // of the session before
      const unsigned told = b.desk.tick;
      ASSERT_EQ(b.desk.session, 77U);
      if (after > 0) {
        b.tick();
        EXPECT_EQ(b.desk.session, 78U) << "told at once";
      }
      advance(b, half + after - 1);
      b.link.begin_tick();
      const bool recent = half + after + waited - told <= 50;
      EXPECT_EQ(b.link.receive(arm, waited) == Outcome::obeyed, recent) << after << ' ' << waited;
    }
  }
}

TEST(Link, BeforeSession1Comes255) {
  LinkConfig c = link_config();
  c.session = 255;
  LinkBench b(c);
  b.listen();
  advance(b, half - 1);
  const hal::CanFrame arm = b.desk.order(Desk::arm);
  b.tick();
  EXPECT_EQ(b.link.session(), 1);
  EXPECT_EQ(b.one(arm), Outcome::obeyed);
}

TEST(Link, TheSessionBeforeIsValidForAsLongAsAStatusIsRecent) {
  for (const unsigned after : {0U, 49U, 50U, 51U}) {
    LinkBench b;
    b.listen();
    advance(b, half - 1);
    const hal::CanFrame ask = b.desk.ask(2);
    advance(b, half + after - 1);
    EXPECT_EQ(b.one(ask), after < 50 ? Outcome::obeyed : Outcome::bad_crc) << after;
  }
  LinkBench b;
  b.run();
  advance(b, half - 2);
  b.tick({b.desk.order(Desk::off)});
  b.tick();  // disabled, and with this the session is new
  ASSERT_EQ(b.supervisor.state(), State::disabled);
  hal::CanFrame old = b.desk.ask(2);
  EXPECT_EQ(b.one(b.desk.seal(old, b.desk.session - 1U)), Outcome::bad_crc);
}

/// 256 sessions later the one before is the first again, with the same 16 bits of the tick.
TEST(Link, AnOrderOfTheSessionBeforeAnswersAStatusOfThatSession) {
  LinkBench b;
  b.listen();
  advance(b, half - 1);
  const unsigned told = b.desk.tick;
  advance(b, half + 10);
  hal::CanFrame arm = b.desk.order(Desk::arm);
  EXPECT_EQ(b.one(b.desk.seal(arm, b.desk.session - 1U)), Outcome::refused);
  EXPECT_EQ(b.supervisor.state(), State::disabled);
  b.desk.tick = told;
  arm = b.desk.order(Desk::arm);
  EXPECT_EQ(b.one(b.desk.seal(arm, b.desk.session - 1U)), Outcome::obeyed);
}

TEST(Link, TheSessionOfAnArmedControllerStays) {
  LinkBench b;
  b.run();
  advance(b, period + 10);
  EXPECT_EQ(b.link.session(), 77);
  EXPECT_EQ(b.one(b.desk.order(Desk::hold)), Outcome::obeyed);
  b.tick({}, Fault::drive_error);
  ASSERT_EQ(b.supervisor.state(), State::fault);
  advance(b, period + half);
  EXPECT_EQ(b.link.session(), 78);
}

}  // namespace
}  // namespace esmc::test
