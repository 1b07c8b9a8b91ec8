/// What all drivers of CAN controllers do, each against a model of its controller at register level.

#include "tests/support/can_driver.hpp"

namespace esmc::test {
namespace {

using hal::CanFrame;
using hal::SendStatus;
using hal::zynqmp_can::Layout;

template <class On>
class FdcanAndZynqmpCan : public CanDriver<On> {};
using All = testing::Types<OnFdcan<hal::fdcan::G4>, OnFdcan<hal::fdcan::H7>, OnZynqmpCan<Layout::manual>,
                           OnZynqmpCan<Layout::qemu_7_2>>;
TYPED_TEST_SUITE(FdcanAndZynqmpCan, All);

TYPED_TEST(FdcanAndZynqmpCan, BitTimingIsExactAndSampledLate) {
  for (const std::uint32_t clock :
       {8'000'000U, 24'000'000U, 40'000'000U, 80'000'000U, 85'000'000U, 100'000'000U, 170'000'000U}) {
    for (const std::uint32_t rate : {125'000U, 250'000U, 500'000U, 1'000'000U}) {
      ASSERT_TRUE(this->bus.open(clock, rate)) << clock << " " << rate;
      const auto bit = this->model.nominal(clock);
      EXPECT_EQ(bit.rate, rate) << clock;
      EXPECT_GE(bit.quanta, 8);
      EXPECT_GE(bit.sample_point, 0.75) << clock << " " << rate;
      EXPECT_LE(bit.sample_point, 0.84) << clock << " " << rate;
      if constexpr (requires { bit.jump; }) {
        EXPECT_LE(bit.jump, bit.quanta * (1 - bit.sample_point) + 1e-9);
      }
    }
  }
}

TYPED_TEST(FdcanAndZynqmpCan, RatesThatCannotBeHadAreRefused) {
  EXPECT_FALSE(this->bus.open(24'000'000, 0));
  EXPECT_FALSE(this->bus.open(24'000'000, 800'001));
  EXPECT_FALSE(this->bus.open(4'000'000, 1'000'000));  // four quanta
  EXPECT_FALSE(this->bus.open(170'000'000, 333'333));
  EXPECT_EQ(this->bus.try_send(frame(1, {})), SendStatus::bus_off);
  CanFrame f;
  EXPECT_FALSE(this->bus.try_receive(f));
}

TYPED_TEST(FdcanAndZynqmpCan, WithoutAClockItDoesNotHang) {
  this->model.clocked = false;
  EXPECT_FALSE(this->bus.open(24'000'000, 1'000'000));
  EXPECT_EQ(this->bus.try_send(frame(1, {})), SendStatus::bus_off);
}

TYPED_TEST(FdcanAndZynqmpCan, WhatIsNotWellFormedIsRefused) {
  this->open();
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

TYPED_TEST(FdcanAndZynqmpCan, EverythingIsHeard) {
  this->open();
  WireFrame remote{.id = 0x123, .remote = true, .dlc = 5}, long_code = wire(0x7FE, {1, 2, 3, 4, 5, 6, 7, 8});
  long_code.dlc = 15;  // a classic frame has 8 bytes with every code above
  for (const WireFrame& w : {wire(0, {}), wire(0x7FF, {9, 8, 7, 6, 5, 4, 3, 2}),
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

}  // namespace
}  // namespace esmc::test
