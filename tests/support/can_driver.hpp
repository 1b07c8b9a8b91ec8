#pragma once
/// Drivers of CAN controllers on models of their registers, and frames for them.

#include <gtest/gtest.h>

#include <initializer_list>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "hal/fdcan/fdcan.hpp"
#include "hal/zynqmp_can/zynqmp_can.hpp"
#include "tests/support/fdcan_model.hpp"
#include "tests/support/zynqmp_can_model.hpp"

namespace esmc::test {

template <class Part>
struct OnFdcan {
  using Model = FdcanModel;
  using Access = FdcanModelAccess;
  using Driver = hal::Fdcan<Part, Access>;
  static constexpr auto kind =
      std::is_same_v<Part, hal::fdcan::G4> ? FdcanModel::Chip::g4 : FdcanModel::Chip::h7;
};
template <hal::zynqmp_can::Layout layout>
struct OnZynqmpCan {
  using Model = ZynqmpCanModel;
  using Access = ZynqmpCanModelAccess;
  using Driver = hal::ZynqmpCan<layout, Access>;
  static constexpr auto kind =
      layout == hal::zynqmp_can::Layout::manual ? ZynqmpCanModel::Words::manual : ZynqmpCanModel::Words::qemu;
};

template <class On>
class CanDriver : public testing::Test {
 public:
  typename On::Model model{On::kind};
  typename On::Driver bus{typename On::Access{&model}};
  CanDriver() {
    if constexpr (requires { model.handler; }) model.handler = [this] { bus.interrupt(); };
  }
  ~CanDriver() override {
    for (const std::string& w : model.wrong) ADD_FAILURE() << w;
  }
  void open() { ASSERT_TRUE(bus.open(24'000'000, 1'000'000)); }
  void poll() {
    hal::CanFrame none;
    (void)bus.try_receive(none);
  }
};

inline hal::CanFrame frame(std::uint32_t id, std::initializer_list<int> bytes, bool extended = false) {
  hal::CanFrame f{.id = id, .extended = extended};
  for (const int b : bytes) f.data[f.size++] = static_cast<std::uint8_t>(b);
  return f;
}
inline WireFrame wire(std::uint32_t id, std::vector<std::uint8_t> bytes, bool extended = false) {
  WireFrame f{.id = id, .extended = extended};
  f.dlc = static_cast<unsigned>(bytes.size());
  f.bytes = std::move(bytes);
  return f;
}

}  // namespace esmc::test
