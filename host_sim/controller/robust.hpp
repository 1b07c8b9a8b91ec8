#pragma once
/// Robust gains of a scene: the problem that host_sim/design solves, and its cached solution.

#include "host_sim/controller/controller_config.hpp"
#include "host_sim/design/result.hpp"

namespace esmc::host {

/// Problem of robust design: the controller without gains, its motion (or workspace), its uncertainty. The
/// scene has [uncertainty] and a switching gain. Throws InputError where the reference leaves the reach.
template <class M>
design::Problem<M> design_problem(const Scene& scene, Pacing pacing);

/// Result of robust design.
template <class M>
struct RobustGains {
  Gains<M> gains;
  double stiffness = 0.0;  ///< largest decay rate within the layer, 1/s
};
/// Gains for gain = "robust". Throws InputError with the reason where the design is refused.
template <class M>
RobustGains<M> robust_gains(const Scene& scene, Pacing pacing);

/// The configuration with the gains of the scene. `reference` must outlive it. Throws InputError like
/// robust_gains.
template <class M>
ControllerConfig<M> make_controller(const Scene& scene, Pacing pacing,
                                    const ReferenceBundle<typename M::Scalar>& reference);

}  // namespace esmc::host
