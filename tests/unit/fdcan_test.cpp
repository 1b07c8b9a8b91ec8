/// The FDCAN driver against a model of the controller at register level: formats, filters, the interrupt,
/// priorities, error states.

#include <thread>

#include "tests/support/can_driver.hpp"

namespace esmc::test {
namespace {

using hal::CanFrame;
using hal::SendStatus;

template <class On>
class Fdcan : public CanDriver<On> {};
using Parts = testing::Types<OnFdcan<hal::fdcan::G4>, OnFdcan<hal::fdcan::H7>>;
TYPED_TEST_SUITE(Fdcan, Parts);

TYPED_TEST(Fdcan, OnABusItHasNoLoopBack) {
  this->open();
  EXPECT_FALSE(this->model.internal_loop_back());
}

TYPED_TEST(Fdcan, FormatsGoOutAsTheyAre) {
  this->open();
  CanFrame remote = frame(0x29, {});
  remote.remote = true;
  remote.size = 8;
  EXPECT_EQ(this->bus.try_send(frame(0x7FF, {1, 2, 3, 4, 5, 6, 7, 8})), SendStatus::ok);
  EXPECT_EQ(this->bus.try_send(frame(0x1FFFFFFF, {0xAA, 0xBB, 0xCC}, true)), SendStatus::ok);
  EXPECT_EQ(this->bus.try_send(frame(0x100, {}, true)), SendStatus::ok);
  EXPECT_EQ(this->bus.try_send(remote), SendStatus::ok);
  std::vector<WireFrame> got;
  while (auto f = this->model.take()) {
    got.push_back(*f);
    this->poll();
  }
  WireFrame asked{.id = 0x29, .remote = true, .dlc = 8};
  EXPECT_EQ(got, (std::vector<WireFrame>{wire(0x100, {}, true), asked, wire(0x7FF, {1, 2, 3, 4, 5, 6, 7, 8}),
                                         wire(0x1FFFFFFF, {0xAA, 0xBB, 0xCC}, true)}));
}

TYPED_TEST(Fdcan, TheMostUrgentGoesFirst) {
  this->open();
  for (std::uint32_t i = 0; i < 10; ++i)
    EXPECT_EQ(this->bus.try_send(frame(0x700 - i, {static_cast<int>(i)})), SendStatus::ok);
  for (std::uint32_t i = 10; i-- > 0;) {
    this->poll();
    const auto f = this->model.take();
    ASSERT_TRUE(f);
    EXPECT_EQ(f->id, 0x700 - i);
    EXPECT_EQ(f->bytes, std::vector<std::uint8_t>{static_cast<std::uint8_t>(i)});
  }
  EXPECT_FALSE(this->model.take());
  EXPECT_EQ(this->bus.withdrawn(), 0U);
}

/// Three buffers of less urgent frames, one of them on the wire: it ends, then the urgent one goes.
TYPED_TEST(Fdcan, AnUrgentFrameWaitsForOneFrameAtMost) {
  for (const bool spoiled : {false, true}) {
    this->open();
    for (const std::uint32_t id : {0x702U, 0x701U, 0x700U, 0x703U})
      EXPECT_EQ(this->bus.try_send(frame(id, {static_cast<int>(id & 0xFU)})), SendStatus::ok);
    ASSERT_EQ(this->model.begin_frame()->id, 0x700U);
    EXPECT_EQ(this->bus.try_send(frame(0x10, {9})), SendStatus::ok);
    EXPECT_EQ(this->bus.try_send(frame(0x10, {8})), SendStatus::ok);
    this->poll();
    if (spoiled) {
      this->model.spoiled();
    } else {
      this->model.delivered();
    }
    std::vector<std::uint32_t> order;
    for (std::optional<WireFrame> f; (f = this->model.take()); this->poll()) {
      order.push_back(f->id);
      if (f->id == 0x10U) {
        EXPECT_EQ(f->bytes[0], order.size() == 1 ? 9 : 8);
      } else {
        EXPECT_EQ(f->bytes[0], f->id & 0xFU);
      }
    }
    std::vector<std::uint32_t> want{0x10, 0x10, 0x701, 0x702, 0x703};
    if (spoiled) want.insert(want.begin() + 2, 0x700);
    EXPECT_EQ(order, want);
    EXPECT_EQ(this->bus.withdrawn(), 0U);
  }
}

/// A cancelled frame that is on the wire is withdrawn only if it fails there.
TYPED_TEST(Fdcan, ACancelThatLosesIsNotCounted) {
  for (const bool spoiled : {false, true}) {
    this->open();
    const std::uint32_t before = this->bus.withdrawn();
    for (const std::uint32_t id : {0x10U, 0x11U}) {
      CanFrame f = frame(id, {1});
      f.perishable = true;
      EXPECT_EQ(this->bus.try_send(f), SendStatus::ok);
    }
    EXPECT_EQ(this->bus.try_send(frame(0x12, {2})), SendStatus::ok);
    ASSERT_EQ(this->model.begin_frame()->id, 0x10U);
    this->bus.withdraw();
    if (spoiled) {
      this->model.spoiled();
    } else {
      this->model.delivered();
    }
    this->poll();
    EXPECT_EQ(this->bus.withdrawn() - before, spoiled ? 2U : 1U);
    const auto f = this->model.take();
    ASSERT_TRUE(f);
    EXPECT_EQ(f->id, 0x12U);
    EXPECT_FALSE(this->model.take());
  }
}

/// A frame that was withdrawn while it was on the wire, and then lost the arbitration, must not come back
/// when a more urgent one needs its buffer.
TYPED_TEST(Fdcan, AWithdrawnFrameDoesNotComeBack) {
  this->open();
  CanFrame old = frame(0x6E, {15}), now = frame(0x6E, {0});
  old.perishable = now.perishable = true;
  for (const CanFrame& f : {old, frame(0x790, {}), frame(0x796, {})})
    EXPECT_EQ(this->bus.try_send(f), SendStatus::ok);
  ASSERT_EQ(this->model.begin_frame()->id, 0x6EU);
  this->bus.withdraw();
  EXPECT_EQ(this->bus.try_send(frame(0x2E, {})), SendStatus::ok);
  this->model.lost();
  EXPECT_EQ(this->bus.try_send(now), SendStatus::ok);
  std::vector<std::uint32_t> ids;
  for (int i = 0; i < 8; ++i) {
    this->poll();
    const auto f = this->model.take();
    if (!f) break;
    ids.push_back(f->id);
    if (f->id == 0x6E) {
      EXPECT_EQ(f->bytes[0], 0);
    }
  }
  EXPECT_EQ(ids, (std::vector<std::uint32_t>{0x2E, 0x6E, 0x790, 0x796}));
  EXPECT_EQ(this->bus.withdrawn(), 1U);
}

TYPED_TEST(Fdcan, FullIsSaidAndNothingIsOverwritten) {
  this->open();
  int taken = 0;
  while (taken < 100 && this->bus.try_send(frame(0x10, {taken})) == SendStatus::ok) ++taken;
  EXPECT_EQ(taken, 33);  // one with the controller
  EXPECT_EQ(this->bus.try_send(frame(0x11, {})), SendStatus::bus_full);
  for (int i = 0; i < taken; ++i) {
    const auto f = this->model.take();
    ASSERT_TRUE(f);
    EXPECT_EQ(f->bytes[0], i);
    this->poll();
  }
}

/// A bus that is full of other nodes' frames keeps telemetry back; torque and idle still find a place.
TYPED_TEST(Fdcan, AFullQueueGivesUpItsLeastUrgentFrame) {
  this->open();
  constexpr std::uint32_t places = 35;
  for (std::uint32_t i = 0; i < places; ++i)
    EXPECT_EQ(this->bus.try_send(frame(0x700 + i, {})), SendStatus::ok);
  EXPECT_EQ(this->bus.try_send(frame(0x700 + places, {})), SendStatus::bus_full);
  EXPECT_EQ(this->bus.withdrawn(), 0U);
  EXPECT_EQ(this->bus.try_send(frame(0x10, {1})), SendStatus::ok);
  EXPECT_EQ(this->bus.try_send(frame(0x10, {2})), SendStatus::ok);
  EXPECT_EQ(this->bus.withdrawn(), 2U);
  std::vector<std::uint32_t> order;
  for (std::optional<WireFrame> f; (f = this->model.take()); this->poll()) order.push_back(f->id);
  std::vector<std::uint32_t> want{0x10, 0x10};
  for (std::uint32_t i = 0; i < places - 2; ++i) want.push_back(0x700 + i);
  EXPECT_EQ(order, want);
}

TYPED_TEST(Fdcan, RestrictedOperationIsSaidAndLeft) {
  this->open();
  EXPECT_EQ(this->bus.try_send(frame(0x10, {1})), SendStatus::ok);
  this->model.restrict();
  EXPECT_TRUE(this->bus.off());
  EXPECT_EQ(this->bus.try_send(frame(0x10, {2})), SendStatus::bus_off);
  this->bus.rejoin();
  EXPECT_FALSE(this->bus.off());
  EXPECT_EQ(this->bus.try_send(frame(0x10, {3})), SendStatus::ok);
  const auto f = this->model.take();
  ASSERT_TRUE(f);
  EXPECT_EQ(f->bytes[0], 3) << "the frames of before are dropped";
}

TYPED_TEST(Fdcan, FiltersHearWhatTheyAcceptAndCostNoInterrupt) {
  hal::IdFilters filters;
  filters.add({0x20, 0x7E0, false});
  filters.add({0x7FF, 0x7FF, false});
  filters.add({0x68, 0x1FFF'C0FF, true});
  for (const std::uint32_t id : {0x1FU, 0x20U, 0x3FU, 0x40U, 0x68U, 0x7FEU, 0x7FFU, 0x2968U, 0x4868U}) {
    for (const bool extended : {false, true}) {
      if (id > 0x7FF && !extended) continue;
      for (const bool remote : {false, true}) {
        ASSERT_TRUE(this->bus.open(24'000'000, 1'000'000, 0, filters));
        const std::uint32_t before = this->model.interrupts;
        WireFrame w = wire(id, {}, extended);
        w.remote = remote;
        this->model.deliver(w);
        const bool wanted = extended ? id == 0x68 || id == 0x2968 : (id >= 0x20 && id < 0x40) || id == 0x7FF;
        EXPECT_EQ(this->model.interrupts - before, wanted ? 1U : 0U) << id << extended << remote;
        CanFrame f;
        EXPECT_EQ(this->bus.try_receive(f), wanted) << id << extended << remote;
      }
    }
  }
  // More extended ones than a G4 has room for: everything is heard.
  for (std::uint32_t i = 0; i < 8; ++i) filters.add({i, 0x1FFF'FFFF, true});
  ASSERT_TRUE(this->bus.open(24'000'000, 1'000'000, 0, filters));
  this->model.deliver(wire(0x12345, {}, true));
  CanFrame f;
  ASSERT_TRUE(this->bus.try_receive(f));
  EXPECT_EQ(f.id, 0x12345U);
}

TYPED_TEST(Fdcan, WhileTheProgramIsBusyTheRingFills) {
  this->open();
  const auto value = [](int i) { return static_cast<std::uint8_t>(i); };
  for (int i = 0; i < 64; ++i) this->model.deliver(wire(0x40, {value(i)}));
  EXPECT_EQ(this->bus.overruns(), 0U);
  for (int i = 64; i < 68; ++i) this->model.deliver(wire(0x40, {value(i)}));
  EXPECT_EQ(this->bus.overruns(), 4U);
  CanFrame f;
  for (int i = 0; i < 64; ++i) {
    ASSERT_TRUE(this->bus.try_receive(f));
    EXPECT_EQ(f.data[0], i);
  }
  EXPECT_FALSE(this->bus.try_receive(f));
  // Round and round, never empty.
  this->model.deliver(wire(0x41, {value(255)}));
  for (int i = 0; i < 200; ++i) {
    this->model.deliver(wire(0x41, {value(i)}));
    ASSERT_TRUE(this->bus.try_receive(f));
    EXPECT_EQ(f.data[0], value(i - 1));
  }
  EXPECT_EQ(this->bus.overruns(), 4U);
}

TYPED_TEST(Fdcan, MaskedInterruptsLeaveTheFifoWhichKeepsTheOldest) {
  this->open();
  const int depth = TypeParam::kind == FdcanModel::Chip::g4 ? 3 : 32;
  CanFrame f;
  for (int round = 0; round < 5; ++round) {
    this->model.mask(true);
    for (int i = 0; i < depth + (round == 4 ? 4 : 0); ++i)
      this->model.deliver(wire(0x40, {static_cast<std::uint8_t>(i)}));
    EXPECT_FALSE(this->bus.try_receive(f));
    this->model.mask(false);
    for (int i = 0; i < depth; ++i) {
      ASSERT_TRUE(this->bus.try_receive(f));
      EXPECT_EQ(f.data[0], i);
    }
    EXPECT_FALSE(this->bus.try_receive(f));
    EXPECT_EQ(this->bus.overruns(), round == 4 ? 1U : 0U);
  }
}

TYPED_TEST(Fdcan, AgeOfAFrame) {
  for (const std::uint32_t rate : {1'000'000U, 250'000U}) {
    ASSERT_TRUE(this->bus.open(24'000'000, rate));
    for (const std::uint32_t waited : {0U, 300U, 40'000U}) {
      this->model.bits(65'000);  // the counter goes round on the way
      this->model.deliver(wire(0x40, {1, 2, 3, 4, 5, 6, 7, 8}));
      this->model.bits(108 + waited);
      CanFrame f;
      ASSERT_TRUE(this->bus.try_receive(f));
      EXPECT_EQ(this->bus.frame_age_us(), waited * (1'000'000U / rate));
    }
  }
}

TYPED_TEST(Fdcan, AgeThatTheWatchdogAllows) {
  for (const std::uint32_t rate : {1'000'000U, 125'000U}) {
    this->model.bits(1000);
    for (const std::uint32_t longest : {5'000U, 65'000U, 500'000U, 1'000'000U}) {
      ASSERT_TRUE(this->bus.open(24'000'000, rate, 0, {}, false, longest));
      for (std::uint32_t part = 1; part <= 100; ++part) {
        const std::uint32_t waited = longest / 100 * part;
        this->model.deliver(wire(0x40, {1, 2, 3, 4, 5, 6, 7, 8}));
        this->model.bits(108 + static_cast<std::uint32_t>(std::uint64_t{waited} * rate / 1'000'000U));
        CanFrame f;
        ASSERT_TRUE(this->bus.try_receive(f));
        const double step = longest < 65'000 ? 1e6 / rate : 16e6 / rate;
        EXPECT_NEAR(this->bus.frame_age_us(), waited, step) << rate << ' ' << longest;
      }
    }
  }
}

TYPED_TEST(Fdcan, WhatTheBusHasNotTakenIsWithdrawn) {
  this->open();
  const auto torque = [](int value) {
    CanFrame f = frame(0x10, {value});
    f.perishable = true;
    return f;
  };
  for (int i = 0; i < 5; ++i) EXPECT_EQ(this->bus.try_send(torque(i)), SendStatus::ok);
  this->bus.withdraw();
  EXPECT_EQ(this->bus.withdrawn(), 5U);
  EXPECT_EQ(this->bus.try_send(frame(0x11, {77})), SendStatus::ok);
  auto f = this->model.take();
  ASSERT_TRUE(f);
  EXPECT_EQ(f->id, 0x11U);
  EXPECT_FALSE(this->model.take());
  // What is just going out cannot be called back, and nothing overtakes it.
  EXPECT_EQ(this->bus.try_send(torque(1)), SendStatus::ok);
  ASSERT_TRUE(this->model.begin_frame());
  this->bus.withdraw();
  EXPECT_EQ(this->bus.try_send(frame(0x21, {2})), SendStatus::ok);
  this->model.delivered();
  this->poll();
  f = this->model.take();
  ASSERT_TRUE(f);
  EXPECT_EQ(f->id, 0x21U);
}

TYPED_TEST(Fdcan, WhatOthersCountOnIsNotWithdrawn) {
  this->open();
  for (int i = 0; i < 12; ++i) {
    CanFrame f = frame(0x700 - static_cast<std::uint32_t>(i), {i});
    f.perishable = i % 3 != 0;
    EXPECT_EQ(this->bus.try_send(f), SendStatus::ok);
    this->poll();
    if (i % 5 == 4) this->bus.withdraw();
  }
  this->bus.withdraw();
  for (const std::uint32_t i : {9U, 6U, 3U, 0U}) {
    this->poll();
    const auto f = this->model.take();
    ASSERT_TRUE(f);
    EXPECT_EQ(f->id, 0x700 - i);
  }
  this->poll();
  EXPECT_FALSE(this->model.take());
  EXPECT_EQ(this->bus.withdrawn(), 8U);
}

TYPED_TEST(Fdcan, BusOffIsSaidAndComesBackOnlyWhenAsked) {
  this->open();
  EXPECT_EQ(this->bus.try_send(frame(0x10, {1})), SendStatus::ok);
  EXPECT_EQ(this->bus.try_send(frame(0x10, {9})), SendStatus::ok);  // waits behind it
  for (int i = 0; i < 31; ++i) {
    ASSERT_TRUE(this->model.begin_frame());
    this->model.spoiled();
    EXPECT_FALSE(this->bus.off());
  }
  EXPECT_EQ(this->bus.error_counters() & 0xFF, 248U);
  ASSERT_TRUE(this->model.begin_frame());
  this->model.spoiled();
  EXPECT_TRUE(this->bus.off());
  EXPECT_EQ(this->bus.try_send(frame(0x10, {2})), SendStatus::bus_off);
  this->model.idle(100'000);
  EXPECT_TRUE(this->bus.off()) << "not by itself";
  this->bus.rejoin();
  (void)this->model.read(0x18), (void)this->model.read(0x18), (void)this->model.read(0x18);
  EXPECT_EQ(this->bus.try_send(frame(0x10, {3})), SendStatus::bus_off);
  this->model.idle(129 * 11);
  EXPECT_FALSE(this->bus.off());
  CanFrame nothing;
  EXPECT_FALSE(this->bus.try_receive(nothing));  // turns the driver
  EXPECT_FALSE(this->model.take()) << "what was meant before it left must not go out";
  EXPECT_EQ(this->bus.try_send(frame(0x10, {4})), SendStatus::ok);
  const auto f = this->model.take();
  ASSERT_TRUE(f);
  EXPECT_EQ(f->bytes[0], 4);
}

/// A moteus samples at 57/85 of a bit and 12/17 in the data phase: its bit that switches the rate ends 5/85
/// us after its sample point, and ours must lie before that.
TEST(FdcanTiming, WithCanFdSamplesWhereAMoteusDoes) {
  const auto sample_point = [](const hal::BitTiming& t) {
    return (1.0 + t.segment1) / (1.0 + t.segment1 + t.segment2);
  };
  for (const std::uint32_t clock : {170'000'000U, 85'000'000U, 80'000'000U, 40'000'000U}) {
    const hal::BitTiming slow = hal::fdcan::nominal_timing(clock, 1'000'000, true);
    const hal::BitTiming fast = hal::fdcan::data_timing(clock, 5'000'000);
    ASSERT_TRUE(slow.exact() && fast.exact()) << clock;
    EXPECT_LT(sample_point(slow), (57.0 + 5.0) / 85.0 - 0.03) << clock;
    EXPECT_GT(sample_point(slow), 57.0 / 85.0 - 0.03) << clock;
    EXPECT_NEAR(sample_point(fast), 12.0 / 17.0, 0.1) << clock;
  }
}

TYPED_TEST(Fdcan, FdFrames) {
  EXPECT_FALSE(this->bus.open(24'000'000, 1'000'000, 7'000'000));
  EXPECT_TRUE(this->bus.off());
  ASSERT_TRUE(this->bus.open(40'000'000, 1'000'000, 5'000'000));
  EXPECT_EQ(this->model.nominal(40e6).rate, 1e6);
  EXPECT_EQ(this->model.data(40e6).rate, 5e6);
  EXPECT_NEAR(this->model.nominal(40e6).sample_point, 2.0 / 3.0, 0.02);
  EXPECT_NEAR(this->model.data(40e6).sample_point, 2.0 / 3.0, 0.1);
  CanFrame f = frame(0x321, {});
  f.fd = f.bit_rate_switch = true;
  f.size = 13;  // on the wire 16
  for (std::size_t i = 0; i < 13; ++i) f.data[i] = static_cast<std::uint8_t>(0xE0 + i);
  EXPECT_EQ(this->bus.try_send(f), SendStatus::ok);
  const auto out = this->model.take();
  ASSERT_TRUE(out);
  EXPECT_TRUE(out->fd && out->brs);
  ASSERT_EQ(out->bytes.size(), 16U);
  EXPECT_EQ(out->bytes[12], 0xEC);
  EXPECT_EQ(out->bytes[13], 0);
  WireFrame in = wire(0x55, std::vector<std::uint8_t>(64, 0x5A));
  in.fd = in.brs = true;
  in.dlc = 15;
  this->model.deliver(in);
  CanFrame got;
  ASSERT_TRUE(this->bus.try_receive(got));
  EXPECT_TRUE(got.fd && got.bit_rate_switch);
  EXPECT_EQ(got.size, 64);
  EXPECT_EQ(got.data[63], 0x5A);
}

/// The producer is another thread: what the consumer sees is whole and in order.
TEST(SpscRing, IsInOrderBetweenTwoThreads) {
  constexpr std::uint32_t count = 50'000;
  hal::SpscRing<std::array<std::uint32_t, 8>, 16> ring;
  std::thread producer([&] {
    for (std::uint32_t i = 0; i < count;) {
      auto* const slot = ring.free_slot();
      if (slot == nullptr) {
        std::this_thread::yield();
        continue;
      }
      slot->fill(i++);
      ring.push();
    }
  });
  std::uint32_t wrong = 0;
  for (std::uint32_t i = 0; i < count;) {
    const auto* const slot = ring.front();
    if (slot == nullptr) {
      std::this_thread::yield();
      continue;
    }
    for (const std::uint32_t v : *slot) wrong += v == i ? 0 : 1;
    ring.pop();
    ++i;
  }
  producer.join();
  EXPECT_EQ(wrong, 0U);
  EXPECT_EQ(ring.front(), nullptr);
}

TYPED_TEST(Fdcan, InLoopBackItHearsItself) {
  ASSERT_TRUE(this->bus.open(24'000'000, 1'000'000, 0, {}, true));
  EXPECT_TRUE(this->model.internal_loop_back());
  CanFrame got;
  for (const CanFrame& sent : {frame(0x29, {1, 2, 3, 4, 5, 6, 7, 8}), frame(0x1234567, {9}, true)}) {
    EXPECT_EQ(this->bus.try_send(sent), SendStatus::ok);
    EXPECT_FALSE(this->bus.try_receive(got)) << "it takes the time of a frame";
    ASSERT_TRUE(this->model.take());
    ASSERT_TRUE(this->bus.try_receive(got));
    EXPECT_EQ(got, sent);
  }
}

static_assert(hal::TimesFrames<hal::Fdcan<hal::fdcan::G4, FdcanModelAccess>>);
static_assert(hal::can_fd_code(8) == 8 && hal::can_fd_code(9) == 9 && hal::can_fd_code(64) == 15);

}  // namespace
}  // namespace esmc::test
