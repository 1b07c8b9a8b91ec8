/// The driver of the Zynq UltraScale+'s CAN controller against a model of it at register level: bit timing,
/// formats in both layouts of a message, FIFOs, error states.

#include <gtest/gtest.h>

#include "hal/zynqmp_can/zynqmp_can.hpp"
#include "tests/support/zynqmp_can_model.hpp"

namespace esmc::test {
namespace {

using hal::CanFrame;
using hal::SendStatus;
using hal::zynqmp_can::Layout;

template <Layout layout>
struct As {
  static constexpr Layout value = layout;
  static constexpr auto words =
      layout == Layout::manual ? ZynqmpCanModel::Words::manual : ZynqmpCanModel::Words::qemu;
};
template <class L>
class ZynqmpCan : public testing::Test {
 public:
  ZynqmpCanModel model{L::words};
  hal::ZynqmpCan<L::value, ZynqmpCanModelAccess> bus{ZynqmpCanModelAccess{&model}};
  ~ZynqmpCan() override {
    for (const std::string& w : model.wrong) ADD_FAILURE() << w;
  }
  void open() { ASSERT_TRUE(bus.open(100'000'000, 1'000'000)); }
  void poll() {
    CanFrame none;
    (void)bus.try_receive(none);
  }
};
using Layouts = testing::Types<As<Layout::manual>, As<Layout::qemu_7_2>>;
TYPED_TEST_SUITE(ZynqmpCan, Layouts);

CanFrame frame(std::uint32_t id, std::initializer_list<int> bytes, bool extended = false) {
  CanFrame f{.id = id, .extended = extended};
  for (const int b : bytes) f.data[f.size++] = static_cast<std::uint8_t>(b);
  return f;
}
Message wire(std::uint32_t id, std::vector<std::uint8_t> bytes, bool extended = false) {
  Message f{.id = id, .extended = extended};
  f.dlc = static_cast<unsigned>(bytes.size());
  f.bytes = std::move(bytes);
  return f;
}

TYPED_TEST(ZynqmpCan, BitTimingIsExactAndSampledLate) {
  for (const std::uint32_t clock : {24'000'000U, 40'000'000U, 80'000'000U, 100'000'000U}) {
    for (const std::uint32_t rate : {125'000U, 250'000U, 500'000U, 1'000'000U}) {
      ASSERT_TRUE(this->bus.open(clock, rate)) << clock << " " << rate;
      const auto bit = this->model.bit(clock);
      EXPECT_EQ(bit.rate, rate) << clock;
      EXPECT_GE(bit.quanta, 8);
      EXPECT_GE(bit.sample_point, 0.75) << clock << " " << rate;
      EXPECT_LE(bit.sample_point, 0.84) << clock << " " << rate;
      EXPECT_LE(bit.jump, bit.quanta * (1 - bit.sample_point) + 1e-9);
    }
  }
}

TYPED_TEST(ZynqmpCan, RatesThatCannotBeHadAreRefused) {
  EXPECT_FALSE(this->bus.open(100'000'000, 0));
  EXPECT_FALSE(this->bus.open(100'000'000, 800'001));
  EXPECT_FALSE(this->bus.open(4'000'000, 1'000'000));  // four quanta
  EXPECT_FALSE(this->bus.open(100'000'000, 10'000));   // a prescaler above 256
  EXPECT_EQ(this->bus.try_send(frame(1, {})), SendStatus::bus_off);
  CanFrame f;
  EXPECT_FALSE(this->bus.try_receive(f));
}

TYPED_TEST(ZynqmpCan, WithoutAClockOrABusItDoesNotHang) {
  this->model.clocked = false;
  EXPECT_FALSE(this->bus.open(100'000'000, 1'000'000));
  this->model.clocked = this->model.stuck = true;
  EXPECT_FALSE(this->bus.open(100'000'000, 1'000'000));
  EXPECT_EQ(this->bus.try_send(frame(1, {})), SendStatus::bus_off);
}

TYPED_TEST(ZynqmpCan, FormatsGoOutAsTheyAre) {
  this->open();
  CanFrame remote = frame(0x29, {}), far = frame(0x1ABCDEF0, {}, true);
  remote.remote = far.remote = true;
  remote.size = 8;
  for (const CanFrame& f :
       {frame(0x7FF, {1, 2, 3, 4, 5, 6, 7, 8}), frame(0x1FFFFFFF, {0xAA, 0xBB, 0xCC}, true),
        frame(0x12345678, {1, 2, 3, 4, 5}, true), frame(0x001, {}), remote, far}) {
    EXPECT_EQ(this->bus.try_send(f), SendStatus::ok);
  }
  std::vector<Message> got;
  while (auto f = this->model.take()) {
    got.push_back(*f);
    this->poll();
  }
  const Message asked{.id = 0x29, .remote = true, .dlc = 8},
      asked_far{.id = 0x1ABCDEF0, .extended = true, .remote = true};
  // The first is with the controller already; the others in the order of their priorities.
  EXPECT_EQ(got, (std::vector<Message>{wire(0x7FF, {1, 2, 3, 4, 5, 6, 7, 8}), wire(0x001, {}), asked,
                                       wire(0x12345678, {1, 2, 3, 4, 5}, true), asked_far,
                                       wire(0x1FFFFFFF, {0xAA, 0xBB, 0xCC}, true)}));
}

TYPED_TEST(ZynqmpCan, EverythingIsHeard) {
  this->open();
  Message remote{.id = 0x123, .remote = true, .dlc = 5}, long_code = wire(0x7FE, {1, 2, 3, 4, 5, 6, 7, 8});
  long_code.dlc = 15;  // a classic frame has 8 bytes with every code above
  for (const Message& w : {wire(0, {}), wire(0x7FF, {9, 8, 7, 6, 5, 4, 3, 2}),
                           wire(0x1ABCDEF1, {1, 2, 3, 4, 5}, true), remote, long_code}) {
    this->model.deliver(w);
    CanFrame f = frame(0x55, {1, 1, 1, 1, 1, 1, 1, 1});
    ASSERT_TRUE(this->bus.try_receive(f));
    EXPECT_FALSE(this->bus.try_receive(f));
    EXPECT_EQ(f.id, w.id);
    EXPECT_EQ(f.extended, w.extended);
    EXPECT_EQ(f.remote, w.remote);
    EXPECT_FALSE(f.fd);
    EXPECT_EQ(f.size, w.dlc > 8 ? 8 : w.dlc);
    for (std::size_t k = 0; k < w.bytes.size(); ++k) EXPECT_EQ(f.data[k], w.bytes[k]);
  }
}

TYPED_TEST(ZynqmpCan, TheMostUrgentGoesFirstAndFullIsSaid) {
  this->open();
  const auto number = [](int i) { return frame(0x700 - static_cast<std::uint32_t>(i), {i}); };
  int taken = 0;
  while (taken < 100 && this->bus.try_send(number(taken)) == SendStatus::ok) ++taken;
  EXPECT_EQ(taken, 33);  // one with the controller
  EXPECT_EQ(this->bus.try_send(number(0)), SendStatus::bus_full);
  for (int i = 0; i < taken; ++i) {
    const auto f = this->model.take();
    ASSERT_TRUE(f);
    const int want = i == 0 ? 0 : taken - i;  // the first was alone
    EXPECT_EQ(f->bytes, std::vector<std::uint8_t>{static_cast<std::uint8_t>(want)});
    EXPECT_FALSE(this->model.begin_frame()) << "one at a time";
    for (int n = 0; n < 3; ++n) this->poll();
  }
  EXPECT_FALSE(this->model.take());
}

TYPED_TEST(ZynqmpCan, WhatIsNotWellFormedIsRefused) {
  this->open();
  CanFrame f = frame(0x800, {});
  EXPECT_EQ(this->bus.try_send(f), SendStatus::refused);
  f = frame(1, {});
  f.size = 9;
  EXPECT_EQ(this->bus.try_send(f), SendStatus::refused);
  f = frame(1, {1});
  f.fd = true;
  EXPECT_EQ(this->bus.try_send(f), SendStatus::refused) << "the controller knows classic frames only";
  EXPECT_FALSE(this->model.take());
}

TYPED_TEST(ZynqmpCan, AFullFifoKeepsTheOldest) {
  this->open();
  for (int i = 0; i < 64 + 4; ++i) this->model.deliver(wire(0x40, {static_cast<std::uint8_t>(i)}));
  CanFrame f;
  for (int i = 0; i < 64; ++i) {
    ASSERT_TRUE(this->bus.try_receive(f));
    EXPECT_EQ(f.data[0], i);
  }
  EXPECT_FALSE(this->bus.try_receive(f));
  this->model.deliver(wire(0x41, {7}));
  EXPECT_TRUE(this->bus.try_receive(f));
}

TYPED_TEST(ZynqmpCan, BusOffIsSaidAndStays) {
  this->open();
  EXPECT_EQ(this->bus.try_send(frame(0x10, {1})), SendStatus::ok);
  EXPECT_EQ(this->bus.try_send(frame(0x10, {2})), SendStatus::ok);
  for (int i = 0; i < 31; ++i) {
    ASSERT_TRUE(this->model.begin_frame());
    this->model.spoiled();
    this->poll();
  }
  EXPECT_EQ(this->bus.try_send(frame(0x10, {3})), SendStatus::ok);
  this->model.spoiled();
  EXPECT_EQ(this->bus.try_send(frame(0x10, {4})), SendStatus::bus_off);
  this->model.idle(100'000);
  EXPECT_EQ(this->bus.try_send(frame(0x10, {5})), SendStatus::bus_off);
  EXPECT_FALSE(this->model.take());
  this->open();
  EXPECT_EQ(this->bus.try_send(frame(0x10, {6})), SendStatus::ok);
  const auto f = this->model.take();
  ASSERT_TRUE(f);
  EXPECT_EQ(f->bytes[0], 6) << "what was meant before it left must not go out";
}

TYPED_TEST(ZynqmpCan, UnreadBusOffIsReported) {
  this->open();
  EXPECT_EQ(this->bus.try_send(frame(0x10, {1})), SendStatus::ok);
  for (int i = 0; i < 32; ++i) this->model.spoiled();
  this->model.idle(128 * 11);  // the controller is back by itself, with the old frame in its FIFO
  CanFrame f;
  EXPECT_FALSE(this->bus.try_receive(f));
  EXPECT_FALSE(this->model.take());
  EXPECT_EQ(this->bus.try_send(frame(0x10, {2})), SendStatus::bus_off);
}

static_assert(hal::CanBus<hal::ZynqmpCan<Layout::manual, ZynqmpCanModelAccess>>);
static_assert(hal::CanBus<hal::ZynqmpCan<Layout::qemu_7_2, ZynqmpCanModelAccess>>);

}  // namespace
}  // namespace esmc::test
