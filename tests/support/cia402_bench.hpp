#pragma once
/// One CiA 402 axis of the firmware and a slave made of bytes, on a bus that takes everything, or nothing.

#include <gtest/gtest.h>

#include <cstdint>
#include <utility>
#include <vector>

#include "firmware/drive/cia402_axis.hpp"
#include "tests/support/canopen_bytes.hpp"
#include "tests/support/torque_frame.hpp"

namespace esmc::test {

using drive::AxisConfig;
using drive::Cia402Axis;
using drive::Received;
using hal::CanFrame;

inline constexpr std::uint8_t node = 3;
inline constexpr int retry = 40, patience = 10;
inline constexpr std::size_t setup_writes = 41;  ///< of a drive that has every object

inline Cia402Axis::Settings settings() {
  Cia402Axis::Settings s;
  s.rated_torque = 2.0F;
  s.torque_limit = 2.5F;
  s.counts_per_turn = 4096;
  s.velocity_unit = 0.01F;
  s.heartbeat_ms = 8;
  s.consumer_ms = 15;
  s.master_node = 100;
  s.retry_ticks = retry;
  s.sdo_ticks = patience;
  return s;
}

struct Bench {
  Cia402Axis axis{AxisConfig{.node = node}, settings()};
  Slave slave;
  bool bus_takes = true;
  bool cut = false;            ///< against the clock: its second frame comes when the tick is over
  std::vector<CanFrame> sent;  ///< in the last tick
  std::vector<CanFrame> late;

  Received hear(const CanFrame& f) { return axis.receive(f); }
  void listen() {
    if (!cut) axis.expect_set(false);
    axis.begin_tick();
    take(std::exchange(late, {}));
    if (cut) axis.expect_set(true);
    std::vector<CanFrame> said = slave.speak();
    if (cut && said.size() == 2) {
      late.push_back(said.back());
      said.pop_back();
    }
    take(said);
  }
  void take(const std::vector<CanFrame>& frames) {
    for (const CanFrame& f : frames) EXPECT_EQ(axis.receive(f), Received::accepted) << std::hex << f.id;
  }
  void command(bool enabling) {
    sent.clear();
    const auto send = [&](const CanFrame& f) {
      sent.push_back(f);
      if (bus_takes) slave.take(f);
      return bus_takes;
    };
    if (enabling) axis.enable(send);
    (void)send(test::torque_frame(axis, 0.0F));
    if (!bus_takes) sent.pop_back();
  }
  void tick(bool enabling = true) {
    listen();
    command(enabling);
  }
  void disable() {
    listen();
    sent.clear();
    const auto send = [&](const CanFrame& f) {
      sent.push_back(f);
      slave.take(f);
      return true;
    };
    if (!axis.idle()) axis.disable(send);
    (void)send(test::torque_frame(axis, 0.0F));
  }
  template <class Done>
  bool until(const Done& done, int ticks = 400) {
    for (int i = 0; i < ticks && !done(); ++i) tick();
    return done();
  }
  bool make_ready() {
    return until([&] { return axis.ready(); });
  }
  /// Up to the tick in which the object is asked for or written.
  bool make_ask(std::uint32_t object) {
    return until([&] {
      for (const CanFrame& f : sent) {
        if (f.id == 0x600U + node && entry(f.data[1] + 256U * f.data[2], f.data[3]) == object) return true;
      }
      return false;
    });
  }
  [[nodiscard]] int count(std::uint32_t id) const {
    int n = 0;
    for (const CanFrame& f : sent) n += f.id == id ? 1 : 0;
    return n;
  }
  [[nodiscard]] unsigned control() const { return little(test::torque_frame(axis, 0.0F), 0, 2); }
};

}  // namespace esmc::test
