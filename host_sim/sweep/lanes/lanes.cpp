#include "host_sim/sweep/lanes/lanes.hpp"

namespace esmc::host {

void each_lane(EachLane f, const double* a, const double* b, double* out, int n) {
  const auto all = [&](const auto& of) {
    for (int i = 0; i < n; ++i) out[i] = of(a[i], b[i]);
  };
  switch (f) {
    case EachLane::arc_tangent2:
      return all([](double y, double x) { return arc_tangent2(y, x); });
    case EachLane::angle_of_unit:
      return all([](double y, double x) { return angle_of_unit(y, x); });
    case EachLane::wrap_to_pi:
      return all([](double angle, double) { return wrap_to_pi(angle); });
    case EachLane::hyperbolic_tangent:
      return all([](double x, double) { return hyperbolic_tangent(x); });
  }
}

}  // namespace esmc::host
