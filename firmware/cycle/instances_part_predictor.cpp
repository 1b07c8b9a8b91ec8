#include "firmware/cycle/instances_each.hpp"
#include "firmware/cycle/part_predictor.hpp"

namespace esmc::part {
#define ESMC_PART(M) template void predictor(const ControllerConfig<M>&, const PartMemory<M>&, Tracking<M>&)
ESMC_EACH(ESMC_PART);
}  // namespace esmc::part
