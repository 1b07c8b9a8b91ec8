#include "host_sim/sweep/lanes/lanes.hpp"

namespace esmc::host {

void arc_tangent2_each(const double* y, const double* x, double* out, int n) {
  for (int i = 0; i < n; ++i) out[i] = arc_tangent2(y[i], x[i]);
}
void angle_of_unit_each(const double* y, const double* x, double* out, int n) {
  for (int i = 0; i < n; ++i) out[i] = angle_of_unit(y[i], x[i]);
}

void wrap_to_pi_each(const double* angle, double* out, int n) {
  for (int i = 0; i < n; ++i) out[i] = wrap_to_pi(angle[i]);
}

void hyperbolic_tangent_each(const double* x, double* out, int n) {
  for (int i = 0; i < n; ++i) out[i] = hyperbolic_tangent(x[i]);
}

}  // namespace esmc::host
