#include "host_sim/sweep/lanes/kernel.hpp"

namespace esmc::host {

const std::vector<LaneKernel>& lane_kernels() {
  static const std::vector<LaneKernel> list = [] {
    std::vector<LaneKernel> out;
#ifdef ESMC_WIDE_LANES
    if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
        __builtin_cpu_supports("avx512vl"))
      out.push_back({"AVX-512", 8, &lane_kernel_avx512});
    if (__builtin_cpu_supports("avx2")) out.push_back({"AVX2", 4, &lane_kernel_avx2});
#endif
    out.push_back({"baseline", 2, &lane_kernel_baseline});
    return out;
  }();
  return list;
}

}  // namespace esmc::host
