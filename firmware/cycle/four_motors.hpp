#pragma once
/// Optional part of the controller: motors on all joints of a 5R, each within its limit and, where wanted,
/// preloaded.

#include "firmware/cycle/controller.hpp"

namespace esmc::part {

/// Motor torques that do what the forces w on the channels ask (box_allocation.hpp). Returns whether they do
/// less: saturated. For ControllerConfig::allocate. Compiled into the archive, for FiveBar.
template <class M>
bool four_motors(const ControllerConfig<M>& c, const typename M::Pose& p, const typename M::Channels& w,
                 Vec<typename M::Scalar, M::joints>& torque);

}  // namespace esmc::part

namespace esmc {

/// ControllerConfig::allocate for these motors.
template <class M>
[[nodiscard]] constexpr decltype(ControllerConfig<M>::allocate) allocation_for(
    [[maybe_unused]] Motors motors) {
  if constexpr (M::joints == 4) {
    if (motors == Motors::all) return &part::four_motors<M>;
  }
  return nullptr;
}

}  // namespace esmc
