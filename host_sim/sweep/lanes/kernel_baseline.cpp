#include "host_sim/sweep/lanes/loop.hpp"

namespace esmc::host {
namespace {
struct Isa {};
}  // namespace

LaneKernel lane_kernel_baseline() { return {"baseline", 2, &run_lanes<Lanes<2, Isa>>}; }

}  // namespace esmc::host
