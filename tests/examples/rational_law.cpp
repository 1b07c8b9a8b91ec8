// The reaching law of docs/extending.md, which a patch adds: on s' = d - K sw(s) it settles where K s / (|s|
// + layer) = d.
#include <cmath>
#include <cstdio>

#include "firmware/control/reaching.hpp"

int main() {
  constexpr double gain = 20.0, layer = 0.5, disturbance = 5.0, tick = 1e-3;
  double s = 1.0;
  for (int i = 0; i < 2000; ++i) {
    s += tick * (disturbance - gain * esmc::switching(esmc::Reaching::rational, s, layer));
  }
  const double settled = layer * disturbance / (gain - disturbance);
  std::printf("settled at s = %.4f\n", s);
  const bool nan_stays = std::isnan(esmc::switching(esmc::Reaching::rational, std::nan(""), layer));
  return std::abs(s - settled) < 1e-6 && nan_stays ? 0 : 1;
}
