/// Command interface: the orders store and forget, what they exclude, what is told of them.

#include <gtest/gtest.h>

#include <vector>

#include "tests/support/slot_store.hpp"

namespace esmc::test {
namespace {

using Memory = SlotMemory<2>;

/// A bench whose controller has a memory.
struct Stored : LinkBench {
  explicit Stored(Memory& m, const LinkConfig& c = link_config())
      : LinkBench(c), slots(m, c.parameters, c.scene, 1000) {
    restore(link, slots);
  }
  Request turn(const std::vector<hal::CanFrame>& frames = {}, Fault f = Fault::none) {
    const Request r = tick(frames, f);
    serve(link, slots);
    return r;
  }
  Outcome order(unsigned what) {
    turn({desk.order(what)});
    return outcomes.at(0);
  }
  void listen_and_learn() {
    for (int i = 0; i < 8; ++i) turn({desk.ask(2)});
    for (int i = 0; i < 8; ++i) turn();
    desk.heard.clear();
  }
  [[nodiscard]] StoreState told() const { return static_cast<StoreState>(desk.last(Desk::slots).data[0]); }
  void until_done() {
    for (int i = 0; i < 200 && slots.busy(); ++i) turn();
    for (int i = 0; i < 8; ++i) turn();
    ASSERT_FALSE(slots.busy());
  }
  ParameterSlots<Memory> slots;
};

TEST(LinkStore, WhatIsStoredIsThereAfterTheNextPowerUp) {
  Memory memory;
  {
    Stored b(memory);
    b.listen_and_learn();
    b.turn({b.desk.set_gain(0, 55.5F), b.desk.set_gain(2, 99.0F)});
    b.settle();  // the table with its new checksum
    EXPECT_EQ(b.order(Desk::store), Outcome::obeyed);
    for (int i = 0; i < 4; ++i) b.turn();
    EXPECT_EQ(b.told(), StoreState::storing);
    b.until_done();
    EXPECT_EQ(b.told(), StoreState::stored);
    const auto f = b.desk.last(Desk::slots);
    EXPECT_EQ(f.size, 8);
    EXPECT_EQ(f.data[1], 0) << "it began with the baked ones";
    EXPECT_EQ(f.data[2], static_cast<unsigned>(SlotContent::valid));
    EXPECT_EQ(f.data[3], static_cast<unsigned>(SlotContent::empty));
    EXPECT_EQ(Desk::word(f, 4, 4), 1U);
  }
  Stored again(memory);
  EXPECT_EQ(again.link.parameters()[Index::lambda_position], 55.5F);
  EXPECT_EQ(again.link.parameters()[Index::gain_position], 99.0F);
  EXPECT_TRUE(again.turn().has_gains) << "the controller is given them before anything else";
  EXPECT_FALSE(again.turn().has_gains);
  again.settle();
  EXPECT_EQ(again.desk.last(Desk::slots).data[1], 1) << "told at power-up";
  Memory blank;
  EXPECT_FALSE(Stored(blank).turn().has_gains);
}

TEST(LinkStore, WithoutAStoreTheOrdersAreRefused) {
  LinkBench b;
  b.listen();
  EXPECT_EQ(b.one(b.desk.order(Desk::store)), Outcome::refused);
  EXPECT_EQ(b.one(b.desk.order(Desk::forget)), Outcome::refused);
  EXPECT_EQ(b.link.counters().refused, 2);
  EXPECT_EQ(b.link.take_store_request(), StoreRequest::none);
  EXPECT_EQ(b.desk.count(Desk::slots), 0);
  b.tick({b.desk.ask(2)});
  b.settle();
  EXPECT_EQ(b.desk.count(Desk::slots), 1) << "a request is answered: no store";
  EXPECT_EQ(Desk::word(b.desk.last(Desk::slots), 0, 4), 0U);
  // A link that is off has no store either.
  Memory memory;
  memory.put(0, record(1, {50, 40, 150, 300}));
  LinkConfig off = link_config();
  off.base_id = 0;
  Stored none(memory, off);
  EXPECT_EQ(none.link.parameters()[Index::lambda_position], 40.0F);
  EXPECT_EQ(none.slots.status().used, 0);
}

TEST(LinkStore, OnlyWhileDisabled) {
  Memory memory;
  Stored b(memory);
  b.supervisor = Supervisor({.can_halt = true, .after_halt = AfterHalt::hold});
  b.listen_and_learn();
  const auto refused = [&](State in) {
    EXPECT_EQ(b.supervisor.state(), in);
    EXPECT_EQ(b.order(Desk::store), Outcome::refused) << name(in);
    EXPECT_EQ(b.order(Desk::forget), Outcome::refused) << name(in);
  };
  b.turn({b.desk.order(Desk::arm), b.desk.order(Desk::store)});
  EXPECT_EQ(b.outcomes, (std::vector<Outcome>{Outcome::obeyed, Outcome::refused}))
      << "not in the tick that arms";
  b.turn();
  refused(State::running);
  b.turn({b.desk.order(Desk::disarm)});
  refused(State::halting);
  b.turn({}, Fault::drive_error);
  refused(State::fault);
  EXPECT_EQ(memory.begun, 0);
  EXPECT_EQ(b.link.parameters().gains(), link_config().parameters.gains());
}

TEST(LinkStore, NothingIsArmedWhileTheMemoryGoesOnAfterATimeOut) {
  Memory memory;
  Stored b(memory);
  b.listen_and_learn();
  memory.duration = 1000;  // for ever
  EXPECT_EQ(b.order(Desk::store), Outcome::obeyed);
  for (int i = 0; i < 2000; ++i) b.turn();
  EXPECT_EQ(b.told(), StoreState::failed);
  EXPECT_EQ(b.order(Desk::arm), Outcome::refused);
  memory.duration = 1;
  for (int i = 0; i < 2000; ++i) b.turn();
  EXPECT_EQ(b.order(Desk::arm), Outcome::obeyed);
}

TEST(LinkStore, CheckedLikeEveryOrder) {
  Memory memory;
  Stored b(memory);
  b.listen_and_learn();
  auto with = [&](auto&& change) {
    auto saved = b.desk;
    change();
    const auto store = b.desk.order(Desk::store), forget = b.desk.order(Desk::forget);
    b.desk = saved;
    b.desk.counter[0] = (b.desk.counter[0] + 2) & 15;
    b.turn({store, forget});
    return b.outcomes;
  };
  const std::vector<Outcome> bad_crc{Outcome::bad_crc, Outcome::bad_crc},
      late{Outcome::refused, Outcome::refused};
  EXPECT_EQ(with([&] { ++b.desk.session; }), bad_crc);
  b.desk.counter[0] = (b.desk.counter[0] + 14) & 15;
  EXPECT_EQ(with([&] { b.desk.session = 0; }), late) << "with no session only what takes torque away";
  b.desk.counter[0] = (b.desk.counter[0] + 14) & 15;
  EXPECT_EQ(with([&] { b.desk.tick -= 60; }), late);
  // The table that was seen, for store as for arm.
  b.desk.crc32 ^= 0x8000U;
  EXPECT_EQ(b.order(Desk::store), Outcome::refused);
  EXPECT_EQ(memory.begun, 0);
  EXPECT_EQ(b.link.take_store_request(), StoreRequest::none);
  b.desk.crc32 ^= 0x8000U;
  auto order = b.desk.order(Desk::store);
  b.turn({order, order});
  EXPECT_EQ(b.outcomes, (std::vector<Outcome>{Outcome::obeyed, Outcome::bad_counter}));
}

TEST(LinkStore, NothingElseUntilItIsDone) {
  for (const unsigned what : {Desk::store, Desk::forget}) {
    Memory memory;
    memory.duration = 20;
    Stored b(memory);
    b.listen_and_learn();
    // In the tick of the order itself, and in every one until it is done.
    b.turn({b.desk.order(what), b.desk.order(Desk::arm), b.desk.set_gain(0, 30.0F)});
    EXPECT_EQ(b.outcomes, (std::vector<Outcome>{Outcome::obeyed, Outcome::refused, Outcome::refused}));
    int ticks = 0;
    for (; b.slots.busy(); ++ticks) {
      ASSERT_LT(ticks, 400);
      b.turn({b.desk.order(Desk::arm), b.desk.order(Desk::store), b.desk.order(Desk::forget),
              b.desk.set_gain(0, 30.0F), b.desk.order(Desk::none)});
      EXPECT_EQ(b.outcomes, (std::vector<Outcome>{Outcome::refused, Outcome::refused, Outcome::refused,
                                                  Outcome::refused, Outcome::obeyed}));
      EXPECT_EQ(b.supervisor.state(), State::disabled);
    }
    EXPECT_EQ(b.desk.last(Desk::value).data[1], static_cast<unsigned>(Answer::not_now));
    EXPECT_GT(ticks, 30);
    EXPECT_EQ(b.link.parameters()[Index::lambda_position], 40.0F);
    EXPECT_EQ(b.order(Desk::arm), Outcome::obeyed);
  }
}

TEST(LinkStore, ForgetIsTheBakedGainsNowAndLater) {
  Memory memory;
  Stored b(memory);
  b.listen_and_learn();
  b.turn({b.desk.set_gain(0, 55.5F)});
  b.settle();
  b.order(Desk::store);
  b.until_done();
  const std::uint32_t before = b.desk.crc32;
  const Request r = b.turn({b.desk.order(Desk::forget)});
  EXPECT_EQ(b.outcomes.at(0), Outcome::obeyed);
  EXPECT_TRUE(r.has_gains);
  EXPECT_EQ(b.link.parameters().gains(), link_config().parameters.gains());
  EXPECT_EQ(b.link.parameters().crc(), link_config().parameters.crc());
  for (int i = 0; i < 4; ++i) b.turn();
  EXPECT_NE(b.desk.crc32, before) << "what is armed next is another table";
  EXPECT_EQ(b.told(), StoreState::forgetting);
  b.until_done();
  EXPECT_EQ(b.told(), StoreState::forgotten);
  Stored again(memory);
  EXPECT_EQ(again.link.parameters().gains(), link_config().parameters.gains());
  EXPECT_EQ(again.slots.status().used, 0);
}

TEST(LinkStore, AFailureIsTold) {
  Memory memory;
  memory.fails_at = 2;
  Stored b(memory);
  b.listen_and_learn();
  b.order(Desk::store);
  b.until_done();
  EXPECT_EQ(b.told(), StoreState::failed);
  EXPECT_EQ(b.order(Desk::arm), Outcome::obeyed) << "the gains in use are not touched by that";
}

TEST(LinkStore, ToldAtEveryChangeAndWithTheTable) {
  Memory memory;
  LinkConfig c = link_config();
  c.table_ticks = 10;
  Stored b(memory, c);
  b.bus_takes = false;
  b.turn();
  b.bus_takes = true;
  for (int i = 1; i < 9; ++i) b.turn();
  EXPECT_EQ(b.desk.count(Desk::slots), 1) << "at power-up, as soon as the bus took it";
  b.settle();
  EXPECT_EQ(b.desk.count(Desk::slots), 2);
  EXPECT_EQ(b.link.receive(b.desk.last(Desk::slots)), Outcome::foreign_command);
  // Without a store no frame is spent on it every second.
  LinkBench none(c);
  for (int i = 0; i < 28; ++i) none.tick();
  EXPECT_EQ(none.desk.count(Desk::table), 2);
  EXPECT_EQ(none.desk.count(Desk::slots), 0);
}

TEST(LinkStore, GainsOfAnotherTableAreNotTaken) {
  LinkBench b;
  for (const Gains& g : {Gains{9, 40, 150, 300}, Gains{40, 40, 150, 301}, Gains{40, 40, -1, 300}}) {
    EXPECT_FALSE(b.link.restore(g));
    EXPECT_EQ(b.link.parameters().values(), link_config().parameters.values());
  }
  EXPECT_FALSE(b.tick().has_gains);
  const std::uint32_t before = b.link.parameters().crc();
  EXPECT_TRUE(b.link.restore({41, 42, 43, 300}));
  EXPECT_EQ(b.link.parameters().gains(), (Gains{41, 42, 43, 300}));
  EXPECT_NE(b.link.parameters().crc(), before);
}

}  // namespace
}  // namespace esmc::test
