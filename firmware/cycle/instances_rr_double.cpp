#include "firmware/cycle/instances.hpp"

namespace esmc {
ESMC_CONTROLLER(template, Rr<double>);
}
