/// The FDCAN driver against a model of the controller at register level: bit timing, formats, FIFOs, error
/// states.

#include <gtest/gtest.h>

#include "hal/fdcan/fdcan.hpp"
#include "tests/support/fdcan_model.hpp"

namespace esmc::test {
namespace {

using hal::CanFrame;
using hal::SendStatus;

template <class Part>
struct Rig {
  FdcanModel model{std::is_same_v<Part, hal::fdcan::G4> ? FdcanModel::Chip::g4 : FdcanModel::Chip::h7};
  hal::Fdcan<Part, FdcanModelAccess> bus{FdcanModelAccess{&model}};
  ~Rig() {
    for (const std::string& w : model.wrong) ADD_FAILURE() << w;
  }
};
template <class Part>
class Fdcan : public testing::Test, public Rig<Part> {};
using Parts = testing::Types<hal::fdcan::G4, hal::fdcan::H7>;
TYPED_TEST_SUITE(Fdcan, Parts);

CanFrame frame(std::uint32_t id, std::initializer_list<int> bytes, bool extended = false) {
  CanFrame f{.id = id, .extended = extended};
  for (const int b : bytes) f.data[f.size++] = static_cast<std::uint8_t>(b);
  return f;
}
WireFrame wire(std::uint32_t id, std::vector<std::uint8_t> bytes, bool extended = false) {
  WireFrame f{.id = id, .extended = extended};
  f.dlc = static_cast<unsigned>(bytes.size());
  f.bytes = std::move(bytes);
  return f;
}

TYPED_TEST(Fdcan, BitTimingIsExactAndSampledLate) {
  for (const std::uint32_t clock :
       {8'000'000U, 24'000'000U, 40'000'000U, 80'000'000U, 85'000'000U, 170'000'000U}) {
    for (const std::uint32_t rate : {125'000U, 250'000U, 500'000U, 1'000'000U}) {
      ASSERT_TRUE(this->bus.open(clock, rate)) << clock << " " << rate;
      const auto bit = this->model.nominal(clock);
      EXPECT_EQ(bit.rate, rate) << clock;
      EXPECT_GE(bit.quanta, 8);
      EXPECT_GE(bit.sample_point, 0.75) << clock << " " << rate;
      EXPECT_LE(bit.sample_point, 0.84) << clock << " " << rate;
    }
  }
}

TYPED_TEST(Fdcan, RatesThatCannotBeHadAreRefused) {
  EXPECT_FALSE(this->bus.open(24'000'000, 0));
  EXPECT_FALSE(this->bus.open(24'000'000, 800'001));
  EXPECT_FALSE(this->bus.open(4'000'000, 1'000'000));  // four quanta
  EXPECT_FALSE(this->bus.open(170'000'000, 333'333));
  EXPECT_FALSE(this->bus.open(24'000'000, 1'000'000, 7'000'000));
  EXPECT_EQ(this->bus.try_send(frame(1, {})), SendStatus::bus_off);
  CanFrame f;
  EXPECT_FALSE(this->bus.try_receive(f));
}

TYPED_TEST(Fdcan, WithoutAClockItDoesNotHang) {
  this->model.clocked = false;
  EXPECT_FALSE(this->bus.open(24'000'000, 1'000'000));
  EXPECT_TRUE(this->bus.off());
  EXPECT_EQ(this->bus.try_send(frame(1, {})), SendStatus::bus_off);
}

TYPED_TEST(Fdcan, FormatsGoOutAsTheyAre) {
  ASSERT_TRUE(this->bus.open(24'000'000, 1'000'000));
  CanFrame remote = frame(0x29, {});
  remote.remote = true;
  remote.size = 8;
  EXPECT_EQ(this->bus.try_send(frame(0x7FF, {1, 2, 3, 4, 5, 6, 7, 8})), SendStatus::ok);
  EXPECT_EQ(this->bus.try_send(frame(0x1FFFFFFF, {0xAA, 0xBB, 0xCC}, true)), SendStatus::ok);
  EXPECT_EQ(this->bus.try_send(frame(0x100, {}, true)), SendStatus::ok);
  EXPECT_EQ(this->bus.try_send(remote), SendStatus::ok);
  CanFrame none;
  std::vector<WireFrame> got;
  while (auto f = this->model.take()) {
    got.push_back(*f);
    (void)this->bus.try_receive(none);  // the loop polls
  }
  WireFrame asked{.id = 0x29, .remote = true, .dlc = 8};
  EXPECT_EQ(got, (std::vector<WireFrame>{wire(0x7FF, {1, 2, 3, 4, 5, 6, 7, 8}),
                                         wire(0x1FFFFFFF, {0xAA, 0xBB, 0xCC}, true), wire(0x100, {}, true),
                                         asked}));
}

TYPED_TEST(Fdcan, OrderIsKeptWhateverTheIdentifiers) {
  ASSERT_TRUE(this->bus.open(24'000'000, 1'000'000));
  for (std::uint32_t i = 0; i < 10; ++i)
    EXPECT_EQ(this->bus.try_send(frame(0x700 - i, {static_cast<int>(i)})), SendStatus::ok);
  CanFrame none;
  for (std::uint32_t i = 0; i < 10; ++i) {
    const auto f = this->model.take();
    ASSERT_TRUE(f);
    EXPECT_EQ(f->id, 0x700 - i);
    (void)this->bus.try_receive(none);
  }
  EXPECT_FALSE(this->model.take());
}

TYPED_TEST(Fdcan, FullIsSaidAndNothingIsOverwritten) {
  ASSERT_TRUE(this->bus.open(24'000'000, 1'000'000));
  int taken = 0;
  while (taken < 100 && this->bus.try_send(frame(0x10, {taken})) == SendStatus::ok) ++taken;
  EXPECT_EQ(taken, 33);  // one with the controller
  EXPECT_EQ(this->bus.try_send(frame(0x11, {})), SendStatus::bus_full);
  CanFrame none;
  for (int i = 0; i < taken; ++i) {
    const auto f = this->model.take();
    ASSERT_TRUE(f);
    EXPECT_EQ(f->bytes[0], i);
    (void)this->bus.try_receive(none);
  }
}

TYPED_TEST(Fdcan, WhatIsNotWellFormedIsRefused) {
  ASSERT_TRUE(this->bus.open(24'000'000, 1'000'000));
  CanFrame f = frame(0x800, {});
  EXPECT_EQ(this->bus.try_send(f), SendStatus::refused);
  f = frame(1, {});
  f.size = 9;
  EXPECT_EQ(this->bus.try_send(f), SendStatus::refused);
  f = frame(1, {1});
  f.fd = true;
  EXPECT_EQ(this->bus.try_send(f), SendStatus::refused) << "opened for classic frames";
  EXPECT_FALSE(this->model.take());
}

TYPED_TEST(Fdcan, EverythingIsHeard) {
  ASSERT_TRUE(this->bus.open(24'000'000, 1'000'000));
  WireFrame remote{.id = 0x123, .remote = true, .dlc = 5}, long_code = wire(0x7FE, {1, 2, 3, 4, 5, 6, 7, 8});
  long_code.dlc = 15;  // a classic frame has 8 bytes with every code above
  const std::vector<WireFrame> sent{wire(0, {}), wire(0x7FF, {9, 8, 7, 6, 5, 4, 3, 2}),
                                    wire(0x1ABCDEF0, {1, 2, 3, 4, 5}, true), remote, long_code};
  std::vector<CanFrame> got;
  for (const WireFrame& w : sent) {
    this->model.deliver(w);
    CanFrame f = frame(0x55, {1, 1, 1, 1, 1, 1, 1, 1});
    ASSERT_TRUE(this->bus.try_receive(f));
    EXPECT_FALSE(this->bus.try_receive(f));
    got.push_back(f);
  }
  for (std::size_t i = 0; i < sent.size(); ++i) {
    EXPECT_EQ(got[i].id, sent[i].id);
    EXPECT_EQ(got[i].extended, sent[i].extended);
    EXPECT_EQ(got[i].remote, sent[i].remote);
    EXPECT_FALSE(got[i].fd);
    EXPECT_EQ(got[i].size, sent[i].dlc > 8 ? 8 : sent[i].dlc);
    for (std::size_t k = 0; k < sent[i].bytes.size(); ++k) EXPECT_EQ(got[i].data[k], sent[i].bytes[k]);
  }
}

TYPED_TEST(Fdcan, AFullFifoKeepsTheOldestAndCountsWhatItLost) {
  ASSERT_TRUE(this->bus.open(24'000'000, 1'000'000));
  const int depth = std::is_same_v<TypeParam, hal::fdcan::G4> ? 3 : 32;
  for (int i = 0; i < depth + 4; ++i) this->model.deliver(wire(0x40, {static_cast<std::uint8_t>(i)}));
  CanFrame f;
  for (int i = 0; i < depth; ++i) {
    ASSERT_TRUE(this->bus.try_receive(f));
    EXPECT_EQ(f.data[0], i);
  }
  EXPECT_FALSE(this->bus.try_receive(f));
  EXPECT_EQ(this->bus.overruns(), 1U);
  // Round and round.
  for (int i = 0; i < 200; ++i) {
    this->model.deliver(wire(0x41, {static_cast<std::uint8_t>(i)}));
    ASSERT_TRUE(this->bus.try_receive(f));
    EXPECT_EQ(f.data[0], i);
  }
  EXPECT_EQ(this->bus.overruns(), 1U);
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

TYPED_TEST(Fdcan, WhatTheBusHasNotTakenIsWithdrawn) {
  ASSERT_TRUE(this->bus.open(24'000'000, 1'000'000));
  const auto torque = [](int value) {
    CanFrame f = frame(0x10, {value});
    f.perishable = true;
    return f;
  };
  for (int i = 0; i < 5; ++i) EXPECT_EQ(this->bus.try_send(torque(i)), SendStatus::ok);
  this->bus.withdraw();
  EXPECT_EQ(this->bus.withdrawn(), 5U);
  EXPECT_EQ(this->bus.try_send(frame(0x11, {77})), SendStatus::ok);
  CanFrame none;
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
  (void)this->bus.try_receive(none);
  f = this->model.take();
  ASSERT_TRUE(f);
  EXPECT_EQ(f->id, 0x21U);
}

TYPED_TEST(Fdcan, WhatOthersCountOnIsNotWithdrawn) {
  ASSERT_TRUE(this->bus.open(24'000'000, 1'000'000));
  for (int i = 0; i < 12; ++i) {
    CanFrame f = frame(0x700 - static_cast<std::uint32_t>(i), {i});
    f.perishable = i % 3 != 0;
    EXPECT_EQ(this->bus.try_send(f), SendStatus::ok);
    if (i % 5 == 4) this->bus.withdraw();
  }
  this->bus.withdraw();
  CanFrame none;
  for (const std::uint32_t i : {0U, 3U, 6U, 9U}) {
    const auto f = this->model.take();
    ASSERT_TRUE(f);
    EXPECT_EQ(f->id, 0x700 - i);
    (void)this->bus.try_receive(none);
  }
  EXPECT_FALSE(this->model.take());
  EXPECT_EQ(this->bus.withdrawn(), 8U);
}

TYPED_TEST(Fdcan, BusOffIsSaidAndComesBackOnlyWhenAsked) {
  ASSERT_TRUE(this->bus.open(24'000'000, 1'000'000));
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

TYPED_TEST(Fdcan, FdFrames) {
  ASSERT_TRUE(this->bus.open(40'000'000, 1'000'000, 5'000'000));
  EXPECT_EQ(this->model.nominal(40e6).rate, 1e6);
  EXPECT_EQ(this->model.data(40e6).rate, 5e6);
  EXPECT_GE(this->model.data(40e6).sample_point, 0.7);
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

static_assert(hal::TimesFrames<hal::Fdcan<hal::fdcan::G4, FdcanModelAccess>>);
static_assert(hal::fdcan_code(8) == 8 && hal::fdcan_code(9) == 9 && hal::fdcan_code(64) == 15);

}  // namespace
}  // namespace esmc::test
