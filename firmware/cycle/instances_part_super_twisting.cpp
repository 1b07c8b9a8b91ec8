#include "firmware/cycle/instances_each.hpp"
#include "firmware/cycle/part_super_twisting.hpp"

namespace esmc::part {
#define ESMC_PART(M)                                                                                         \
  template void super_twisting(const ControllerConfig<M>&, const Tracking<M>&, PartMemory<M>&, M::Channels&, \
                               M::Channels&)
ESMC_EACH(ESMC_PART);
}  // namespace esmc::part
