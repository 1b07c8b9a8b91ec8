#include "host_sim/sweep/lanes/loop.hpp"

namespace esmc::host {
namespace {
struct Isa {};
}  // namespace

LaneKernel lane_kernel_v3() { return {"AVX2", 4, &run_lanes<Lanes<4, Isa>>}; }

}  // namespace esmc::host
