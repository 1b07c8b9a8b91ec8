#include "firmware/cycle/instances_each.hpp"
#include "firmware/cycle/part_four_motors.hpp"

namespace esmc::part {
#define ESMC_PART(M)                                                                        \
  template bool four_motors(const ControllerConfig<M>&, const M::Pose&, const M::Channels&, \
                            Vec<M::Scalar, M::joints>&)
ESMC_EACH_REDUNDANT(ESMC_PART);
}  // namespace esmc::part
