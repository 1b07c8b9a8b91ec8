#include "host_sim/controller/make_controller.hpp"

#include <type_traits>

#include "host_sim/controller/robust.hpp"

namespace esmc::host {

template <class M>
ControllerConfig<M> make_controller(const Scene& scene, Pacing pacing,
                                    const ReferenceBundle<typename M::Scalar>& reference) {
  using S = typename M::Scalar;
  ControllerConfig<M> c = controller_without_design<M>(scene, pacing, reference);
  if (!scene.robust_gain) return c;
  using Designed = std::conditional_t<M::has_type2, FiveBar<double>, Rr<double>>;
  const Gains<Designed> d = robust_gains<Designed>(scene, pacing).gains;
  c.gains.k = d.k.template cast<S>();
  c.gains.layer = d.layer.template cast<S>();
  c.gains.independent.k = static_cast<S>(d.independent.k);
  c.gains.independent.layer = static_cast<S>(d.independent.layer);
  return c;
}

#define ESMC_INSTANCE(M, S) \
  template ControllerConfig<M<S>> make_controller(const Scene&, Pacing, const ReferenceBundle<S>&);
ESMC_INSTANCE(FiveBar, double)
ESMC_INSTANCE(FiveBar, float)
ESMC_INSTANCE(Rr, double)
ESMC_INSTANCE(Rr, float)
#undef ESMC_INSTANCE

}  // namespace esmc::host
