#pragma once
/// Optional part of the controller: motors on all joints of a 5R, each within its limit and, where wanted, preloaded.

#include "firmware/cycle/controller.hpp"

namespace esmc::part {

/// Motor torques that do what the forces w on the channels ask (box_allocation.hpp). Returns whether they do less: saturated.
/// For ControllerConfig::allocate.
template <class M>
bool four_motors(const ControllerConfig<M>& c, const typename M::Pose& p, const typename M::Channels& w,
                 Vec<typename M::Scalar, M::joints>& torque);

extern template bool four_motors(const ControllerConfig<FiveBar<double>>&, const FiveBar<double>::Pose&,
                                 const FiveBar<double>::Channels&, Vec<double, 4>&);
extern template bool four_motors(const ControllerConfig<FiveBar<float>>&, const FiveBar<float>::Pose&,
                                 const FiveBar<float>::Channels&, Vec<float, 4>&);

}  // namespace esmc::part

namespace esmc {

/// ControllerConfig::allocate for these motors.
template <class M>
[[nodiscard]] constexpr decltype(ControllerConfig<M>::allocate) allocation_for([[maybe_unused]] Motors motors) {
  if constexpr (M::joints == 4) {
    if (motors == Motors::all) return &part::four_motors<M>;
  }
  return nullptr;
}

}  // namespace esmc
