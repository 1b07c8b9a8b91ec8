#pragma once
/// From a scene to what the controller runs with. Here, and only in commands/, the two sides meet.

#include <cmath>
#include <cstdint>
#include <numbers>
#include <vector>

#include "firmware/cycle/instances.hpp"
#include "host_sim/scene/scene.hpp"

namespace esmc::host {

/// How a run treats time: decides the scene's defaults for delay_ticks and join.
enum class Pacing { lockstep, realtime };

/// A reference that owns its path.
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

ReferenceBundle<double> make_reference(const Scene& scene, Pacing pacing);

/// The controller's belief: the true mechanism times the factors of [control.model].
FiveBarParams<double> believed_mechanism(const Scene& scene);

/// The mechanism of a type, chosen by the null pointer. RR takes leg 1 and gravity.
inline FiveBar<double> make_mechanism(const FiveBarParams<double>& p, const FiveBar<double>*) {
  return FiveBar<double>(p);
}
inline Rr<double> make_mechanism(const FiveBarParams<double>& p, const Rr<double>*) {
  return Rr<double>(RrParams<double>{p.legs[0], p.g});
}

inline FiveBar<double>::Mode mode_of(const Scene& s, const FiveBar<double>*) {
  return {{{s.working_mode[0], s.working_mode[1]}}, s.assembly_mode};
}
inline Rr<double>::Mode mode_of(const Scene& s, const Rr<double>*) { return {s.working_mode[0]}; }

/// Number of control ticks of a run.
[[nodiscard]] inline std::uint32_t tick_count(const Scene& s) {
  return static_cast<std::uint32_t>(std::llround(s.duration * s.rate_hz));
}

/// Known torque delay the implicit law is told, in ticks.
[[nodiscard]] inline double delay_ticks(const Scene& s, Pacing pacing) {
  return s.delay_ticks.value_or(pacing == Pacing::realtime ? 2.0 : 0.0);
}

/// `reference` must outlive the configuration.
template <class M>
ControllerConfig<M> make_controller(const Scene& scene, Pacing pacing, const ReferenceBundle<double>& reference);

/// The cycle with one ODrive axis per motor and passive encoder.
template <class M>
typename OdriveCycle<M>::Config make_cycle(const Scene& scene, Pacing pacing,
                                           const ReferenceBundle<double>& reference);

}  // namespace esmc::host
