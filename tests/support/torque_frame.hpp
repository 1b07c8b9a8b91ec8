#pragma once
/// What an axis sends when it is told something: on a bus that takes all of it, or nothing.

#include <vector>

#include "hal/can.hpp"

namespace esmc::test {

template <class Axis>
std::vector<hal::CanFrame> enable(Axis& a, bool taken = true) {
  std::vector<hal::CanFrame> sent;
  a.enable([&](const hal::CanFrame& f) {
    sent.push_back(f);
    return taken;
  });
  return sent;
}
template <class Axis>
std::vector<hal::CanFrame> disable(Axis& a, bool taken = true) {
  std::vector<hal::CanFrame> sent;
  a.disable([&](const hal::CanFrame& f) {
    sent.push_back(f);
    return taken;
  });
  return sent;
}
/// The torque command, written over a frame that was full of something else.
template <class Axis, class S>
[[nodiscard]] hal::CanFrame torque_frame(const Axis& axis, S joint_torque) {
  hal::CanFrame f{.id = 0x7FF, .size = 1};
  f.data.fill(0x5A);
  axis.put_torque(f, joint_torque);
  return f;
}

}  // namespace esmc::test
