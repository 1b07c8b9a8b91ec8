#pragma once
/// Optional part: motors on all joints of a 5R, each within its limit, optionally preloaded.

#include "firmware/cycle/controller.hpp"

namespace esmc::part {

/// Sets the torques of all motors, N m, for forces w on the channels (box_allocation.hpp), as
/// ControllerConfig::allocate. True: w was shortened. Compiled into the archive for FiveBar.
template <class M>
bool four_motors(const ControllerConfig<M>& c, const typename M::Pose& p, const typename M::Channels& w,
                 Vec<typename M::Scalar, M::joints>& torque);

}  // namespace esmc::part

namespace esmc {

/// ControllerConfig::allocate for these motors: part::four_motors for `all` of a 5R, else null.
template <class M>
[[nodiscard]] constexpr decltype(ControllerConfig<M>::allocate) allocation_for(
    [[maybe_unused]] Motors motors) {
  if constexpr (M::joints == 4) {
    if (motors == Motors::all) return &part::four_motors<M>;
  }
  return nullptr;
}

}  // namespace esmc
