#include "firmware/cycle/instances_each.hpp"
#include "firmware/cycle/part_implicit_coupled.hpp"

namespace esmc::part {
#define ESMC_PART(M)                                                                             \
  template void implicit_coupled(const ControllerConfig<M>&, const Tracking<M>&, PartMemory<M>&, \
                                 M::Channels&, M::Channels&)
ESMC_EACH(ESMC_PART);
}  // namespace esmc::part
