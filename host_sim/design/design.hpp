#pragma once
/// Switching gains from stated uncertainty: docs/robust-design.md. `esmc design` and gain = "robust" call the
/// same function.

#include "host_sim/design/result.hpp"

namespace esmc::host::design {

/// Designs gains. A problem without points or with impossible numbers is refused in the result; no exception.
template <class M>
[[nodiscard]] Design<M> design(const Problem<M>& p);

}  // namespace esmc::host::design
