#include "host_sim/sweep/lanes/loop.hpp"

namespace esmc::host {
namespace {
struct Isa {};
}  // namespace

LaneKernel lane_kernel_v4() { return {"AVX-512", 8, &run_lanes<Lanes<8, Isa>>}; }

}  // namespace esmc::host
