#include "firmware/cycle/instances_each.hpp"
#include "firmware/cycle/part_momentum_observer.hpp"

namespace esmc::part {
#define ESMC_PART(M) \
  template void momentum_observer(const ControllerConfig<M>&, const Tracking<M>&, PartMemory<M>&)
ESMC_EACH(ESMC_PART);
}  // namespace esmc::part
