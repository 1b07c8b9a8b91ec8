#include "firmware/cycle/instances_each.hpp"
#include "firmware/cycle/part_elbow_rotors.hpp"

namespace esmc::part {
#define ESMC_PART(M)                                                                                       \
  template void elbow_rotors(const ControllerConfig<M>&, const Tracking<M>&, PartMemory<M>&, M::Channels&, \
                             M::Channels&)
ESMC_EACH(ESMC_PART);
}  // namespace esmc::part
