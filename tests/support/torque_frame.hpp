#pragma once
/// The torque command of an axis, written over a frame that was full of something else.

#include "hal/can.hpp"

namespace esmc::test {

template <class Axis, class S>
[[nodiscard]] hal::CanFrame torque_frame(const Axis& axis, S joint_torque) {
  hal::CanFrame f{.id = 0x7FF, .size = 1};
  f.data.fill(0x5A);
  axis.put_torque(f, joint_torque);
  return f;
}

}  // namespace esmc::test
