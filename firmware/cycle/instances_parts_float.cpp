#include "firmware/cycle/instances_parts.hpp"

namespace esmc::part {

ESMC_PARTS(FiveBar<float>);
ESMC_REDUNDANT_PARTS(FiveBar<float>);
ESMC_PARTS(Rr<float>);

}  // namespace esmc::part
