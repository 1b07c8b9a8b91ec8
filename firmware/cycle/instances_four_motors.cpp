#include "firmware/cycle/four_motors.hpp"

#include "firmware/control/box_allocation.hpp"

namespace esmc::part {

template <class M>
bool four_motors(const ControllerConfig<M>& c, const typename M::Pose& p, const typename M::Channels& w,
                 Vec<typename M::Scalar, M::joints>& torque) {
  using S = typename M::Scalar;
  const BoxAllocation<S> a = allocate_all_within(c.mechanism, p, w, c.torque_weight, c.torque_limit, c.preload);
  torque = a.torque;
  return a.force < S(1);
}

template bool four_motors(const ControllerConfig<FiveBar<double>>&, const FiveBar<double>::Pose&,
                          const FiveBar<double>::Channels&, Vec<double, 4>&);
template bool four_motors(const ControllerConfig<FiveBar<float>>&, const FiveBar<float>::Pose&,
                          const FiveBar<float>::Channels&, Vec<float, 4>&);

}  // namespace esmc::part
