/// The driver of the Zynq UltraScale+'s CAN controller against a model of it at register level:
/// formats in both layouts of a message, FIFOs, error states.

#include "tests/support/can_driver.hpp"

namespace esmc::test {
namespace {

using hal::CanFrame;
using hal::SendStatus;
using hal::zynqmp_can::Layout;

template <class On>
class ZynqmpCan : public CanDriver<On> {};
using Layouts = testing::Types<OnZynqmpCan<Layout::manual>, OnZynqmpCan<Layout::qemu_7_2>>;
TYPED_TEST_SUITE(ZynqmpCan, Layouts);

TYPED_TEST(ZynqmpCan, WithoutABusItDoesNotHang) {
  EXPECT_FALSE(this->bus.open(100'000'000, 10'000));  // a prescaler above 256
  this->model.stuck = true;
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
  std::vector<WireFrame> got;
  while (auto f = this->model.take()) {
    got.push_back(*f);
    this->poll();
  }
  const WireFrame asked{.id = 0x29, .remote = true, .dlc = 8},
      asked_far{.id = 0x1ABCDEF0, .extended = true, .remote = true};
  // The first is with the controller already; the others in the order of their priorities.
  EXPECT_EQ(got, (std::vector<WireFrame>{wire(0x7FF, {1, 2, 3, 4, 5, 6, 7, 8}), wire(0x001, {}), asked,
                                         wire(0x12345678, {1, 2, 3, 4, 5}, true), asked_far,
                                         wire(0x1FFFFFFF, {0xAA, 0xBB, 0xCC}, true)}));
}

TYPED_TEST(ZynqmpCan, TheMostUrgentGoesFirstAndAFullQueueGivesUpTheLeastUrgent) {
  this->open();
  const auto number = [](int i) { return frame(0x700 - static_cast<std::uint32_t>(i), {i}); };
  constexpr int places = 33;  // one with the controller
  for (int i = 0; i < places; ++i) EXPECT_EQ(this->bus.try_send(number(i)), SendStatus::ok);
  EXPECT_EQ(this->bus.try_send(number(0)), SendStatus::bus_full);
  EXPECT_EQ(this->bus.try_send(number(places)), SendStatus::ok) << "in the place of number 1";
  for (int i = 0; i < places; ++i) {
    const auto f = this->model.take();
    ASSERT_TRUE(f);
    const int want = i == 0 ? 0 : places + 1 - i;  // the first was alone
    EXPECT_EQ(f->bytes, std::vector<std::uint8_t>{static_cast<std::uint8_t>(want)});
    EXPECT_FALSE(this->model.begin_frame()) << "one at a time";
    for (int n = 0; n < 3; ++n) this->poll();
  }
  EXPECT_FALSE(this->model.take());
}

TYPED_TEST(ZynqmpCan, AFullFifoKeepsTheOldestAndCountsWhatItLost) {
  this->open();
  for (int i = 0; i < 64 + 4; ++i) this->model.deliver(wire(0x40, {static_cast<std::uint8_t>(i)}));
  CanFrame f;
  for (int i = 0; i < 64; ++i) {
    ASSERT_TRUE(this->bus.try_receive(f));
    EXPECT_EQ(f.data[0], i);
  }
  EXPECT_FALSE(this->bus.try_receive(f));
  EXPECT_EQ(this->bus.overruns(), 1U);
  this->model.deliver(wire(0x41, {7}));
  EXPECT_TRUE(this->bus.try_receive(f));
  EXPECT_EQ(this->bus.overruns(), 1U);
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
