#pragma once
/// Robust gains of a scene: the problem that host_sim/design solves, and its cached solution.

#include "host_sim/controller/controller_config.hpp"
#include "host_sim/design/design.hpp"

namespace esmc::host {

/// A controller of the scene without its gains, its motion (or its workspace) and its uncertainty. The scene
/// must have [uncertainty] and a law with a switching gain. Throws InputError where the reference leaves the
/// reach.
template <class M>
design::Problem<M> design_problem(const Scene& scene, Pacing pacing);

template <class M>
struct RobustGains {
  Gains<M> gains;
  double stiffness = 0.0;  ///< of the design, 1/s
};
/// Gains for gain = "robust". Throws InputError with the reason where the design is refused.
template <class M>
RobustGains<M> robust_gains(const Scene& scene, Pacing pacing);

extern template design::Problem<FiveBar<double>> design_problem(const Scene&, Pacing);
extern template design::Problem<Rr<double>> design_problem(const Scene&, Pacing);
extern template RobustGains<FiveBar<double>> robust_gains(const Scene&, Pacing);
extern template RobustGains<Rr<double>> robust_gains(const Scene&, Pacing);

}  // namespace esmc::host
