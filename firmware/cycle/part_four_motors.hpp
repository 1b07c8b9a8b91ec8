#pragma once
/// Definition of four_motors.hpp, for instances_part_four_motors.cpp.

#include "firmware/control/box_allocation.hpp"
#include "firmware/cycle/four_motors.hpp"

namespace esmc::part {

template <class M>
bool four_motors(const ControllerConfig<M>& c, const typename M::Pose& p, const typename M::Channels& w,
                 Vec<typename M::Scalar, M::joints>& torque) {
  using S = typename M::Scalar;
  const BoxAllocation<S> a =
      allocate_all_within(c.mechanism, p, w, c.torque_weight, c.torque_given(), c.preload);
  torque = a.torque;
  return a.force < S(1);
}

}  // namespace esmc::part
