#include "firmware/cycle/instances_each.hpp"
#include "firmware/cycle/part_motor_map.hpp"

namespace esmc::part {
#define ESMC_PART(M)                                                                 \
  template void motor_map(const ControllerConfig<M>&, const Sample<M>&, MotorTorque, \
                          Vec<M::Scalar, M::joints>&)
ESMC_EACH(ESMC_PART);
}  // namespace esmc::part
