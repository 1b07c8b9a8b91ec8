#pragma once
/// From a scene to the controller's configuration, without the gains that robust.hpp adds.

#include <cmath>
#include <cstdint>
#include <vector>

#include "firmware/cycle/instances.hpp"
#include "host_sim/scene/scene.hpp"

namespace esmc::host {

/// How a run treats time: decides the scene's defaults for delay_ticks and join.
enum class Pacing { lockstep, realtime };

/// A reference with the path that it refers to.
template <class S>
struct ReferenceBundle {
  Reference<S> reference{};
  std::vector<PathSegment<S>> path;
  std::uint32_t join_ticks = 0;

  /// The reference with its span on `path` of this bundle, which must outlive it.
  [[nodiscard]] Reference<S> get() const {
    Reference<S> r = reference;
    r.path = path;
    return r;
  }
};

/// The reference of the scene, in double, or in float as a board has it.
template <class S = double>
ReferenceBundle<S> make_reference(const Scene& scene, Pacing pacing);
template <>
ReferenceBundle<double> make_reference<double>(const Scene& scene, Pacing pacing);
template <>
ReferenceBundle<float> make_reference<float>(const Scene& scene, Pacing pacing);

/// The parameters that the controller assumes: the scene's `believed`, or else the true mechanism, times the
/// factors of [control.model], with its friction; with friction = "exact" that of the effects.
FiveBarParams<double> believed_mechanism(const Scene& scene);
/// A mechanism with a point mass, kg, at its effector; `arm`: an RR, whose distal bar then has it.
FiveBarParams<double> with_payload(FiveBarParams<double> p, bool arm, double payload);
/// Whether l1, l2 and l0 of both are equal to the last bit, and so all poses.
[[nodiscard]] bool same_lengths(const FiveBarParams<double>& a, const FiveBarParams<double>& b);

/// The parameters, each rounded to the scalar type S.
template <class S>
LegParams<S> cast(const LegParams<double>& p) {
  return {S(p.l1), S(p.l2), S(p.lg1),    S(p.lg2),    S(p.m1),         S(p.m2),         S(p.J1),    S(p.J2),
          S(p.d1), S(p.d2), S(p.gamma1), S(p.gamma2), S(p.asymmetry1), S(p.asymmetry2), S(p.rotor2)};
}
/// The parameters of a five-bar, each rounded to S.
template <class S>
FiveBarParams<S> cast(const FiveBarParams<double>& p) {
  return {S(p.l0), S(p.m0), S(p.g), {cast<S>(p.legs[0]), cast<S>(p.legs[1])}};
}

/// The parameters as the mechanism M takes them, in its scalar type. RR takes leg 1 and gravity.
template <class M>
auto params_of(const FiveBarParams<double>& p) {
  using S = typename M::Scalar;
  if constexpr (M::joints == 4) {
    return cast<S>(p);
  } else {
    return RrParams<S>{cast<S>(p.legs[0]), S(p.g)};
  }
}
/// Calls f with a null pointer to the mechanism of a scene in the scalar type S.
template <class S, class F>
auto with_mechanism(const Scene& s, const F& f) {
  return s.type == MechanismType::five_bar ? f(static_cast<FiveBar<S>*>(nullptr))
                                           : f(static_cast<Rr<S>*>(nullptr));
}

/// Working mode of a scene, of the five-bar assembly mode as well.
template <class M>
typename M::Mode mode_of(const Scene& s) {
  if constexpr (M::joints == 4) {
    return {{{s.working_mode[0], s.working_mode[1]}}, s.assembly_mode};
  } else {
    return {s.working_mode[0]};
  }
}

/// Number of control ticks of a run.
[[nodiscard]] inline std::uint32_t tick_count(const Scene& s) {
  return static_cast<std::uint32_t>(std::llround(s.duration * s.rate_hz));
}

/// Steps of a fixed-step integrator in a tick, >= 1, none longer than simulation.step.
[[nodiscard]] inline int steps_per_tick(const Scene& s) {
  return std::max(1, static_cast<int>(std::ceil(s.tick() / s.step - 1e-9)));
}

/// Torque delay that the controller assumes, in ticks.
[[nodiscard]] inline double delay_ticks(const Scene& s, Pacing pacing) {
  return s.delay_ticks.value_or(pacing == Pacing::realtime ? 2.0 : 0.0);
}

/// Delay, ticks, for which the reaching law is designed: of sensors, and of torque without a predictor.
[[nodiscard]] inline double borne_delay(const Scene& s, Pacing pacing) {
  return s.sensor_lag_ticks + (s.predictor ? 0.0 : delay_ticks(s, pacing));
}

/// The configuration with the gains of [control]: none for gain = "robust". `reference` must outlive it.
template <class M>
ControllerConfig<M> controller_without_design(const Scene& scene, Pacing pacing,
                                              const ReferenceBundle<typename M::Scalar>& reference);
/// For explicit instances of templates on the mechanism: `instance` of each one in each scalar type.
#define ESMC_EACH_CONTROLLER(instance) \
  instance(FiveBar, double) instance(FiveBar, float) instance(Rr, double) instance(Rr, float)

}  // namespace esmc::host
