#pragma once
/// From a scene to the controller's configuration.

#include "host_sim/controller/controller_config.hpp"

namespace esmc::host {

/// With the gains of the scene; those of gain = "robust" are designed first, in double. `reference` must
/// outlive the configuration. Throws InputError where the design is refused.
template <class M>
ControllerConfig<M> make_controller(const Scene& scene, Pacing pacing,
                                    const ReferenceBundle<typename M::Scalar>& reference);

}  // namespace esmc::host
