#pragma once
/// One ODrive axis, node 3, on a bus that takes what it is offered. Frames are packed by hand.

#include <gtest/gtest.h>

#include <array>
#include <cstdint>
#include <vector>

#include "firmware/drive/odrive_axis.hpp"
#include "tests/support/odrive_bytes.hpp"
#include "tests/support/torque_frame.hpp"

namespace esmc::test {

using drive::AxisConfig;
using drive::OdriveAxis;
using drive::Received;
using drive::odrive::Version;
using hal::CanFrame;

inline constexpr std::uint8_t node = 3;
inline constexpr std::uint32_t retry = 10;

inline OdriveAxis axis(Version v = Version::v0_6) { return {AxisConfig{.node = node}, v, retry}; }

inline bool only(const std::vector<CanFrame>& sent, unsigned command) {
  return sent.size() == 1 && node_of(sent[0]) == node && command_of(sent[0]) == command;
}
/// A heartbeat in a tick of its own.
inline void hear(OdriveAxis& a, std::uint8_t state = axis_idle, std::uint32_t error = 0,
                 std::array<std::uint8_t, 3> rest = {}) {
  a.begin_tick();
  ASSERT_EQ(a.receive(heartbeat(node, state, error, rest)), Received::accepted);
}
/// Brings an idle, healthy axis to where closed-loop control has been asked for.
inline void ask(OdriveAxis& a) {
  hear(a, 1);
  ASSERT_TRUE(only(enable(a), cmd_mode));
  hear(a, 1);
  ASSERT_TRUE(only(enable(a), cmd_axis_state));
}
/// Asks for closed-loop control and confirms it twice.
inline void arm(OdriveAxis& a) {
  ask(a);
  hear(a, 8);
  hear(a, 8);
}
inline OdriveAxis ready_axis() {
  OdriveAxis a = axis();
  arm(a);
  return a;
}

}  // namespace esmc::test
