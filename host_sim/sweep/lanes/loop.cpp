/// The loop over ESMC_LANES mechanisms, compiled once per instruction set.

#include "host_sim/sweep/lanes/loop.hpp"

namespace esmc::host {
namespace {
struct Isa {};
}  // namespace

void ESMC_KERNEL(const LaneSettings& settings, const LaneCase* cases, LaneScore* out) {
  LaneLoop<Lanes<ESMC_LANES, Isa>>(settings, cases).run(out);
}

}  // namespace esmc::host
