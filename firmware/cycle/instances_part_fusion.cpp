#include "firmware/cycle/closure_projection.hpp"
#include "firmware/cycle/instances_each.hpp"

namespace esmc::part {
#define ESMC_PART(M)                                                                                     \
  template std::uint8_t closure_projection(const ControllerConfig<M>&, const Vec<M::Scalar, M::joints>&, \
                                           const Vec<M::Scalar, M::joints>&, Estimate<M>&)
ESMC_EACH_REDUNDANT(ESMC_PART);
}  // namespace esmc::part
