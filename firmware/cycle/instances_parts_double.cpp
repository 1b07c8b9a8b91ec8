#include "firmware/cycle/instances_parts.hpp"

namespace esmc::part {

ESMC_PARTS(FiveBar<double>);
ESMC_REDUNDANT_PARTS(FiveBar<double>);
ESMC_PARTS(Rr<double>);

}  // namespace esmc::part
