#pragma once
/// From a scene of `esmc spatial` to the configuration of its controller.

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "host_sim/spatial/controller.hpp"
#include "host_sim/spatial/scene.hpp"

namespace esmc::host {

inline std::uint32_t spatial_ticks(const SpatialScene& s) {
  return static_cast<std::uint32_t>(std::llround(s.duration * s.rate_hz));
}

inline PhaseClock clock_of(double rate, double tick) {
  constexpr double turn_of_phase = 18446744073709551616.0;  // 2^64
  const double turns = rate * tick / 6.283185307179586477, part = turns - std::floor(turns);
  return {0, static_cast<std::uint64_t>(std::min(part * turn_of_phase, turn_of_phase * (1.0 - 0x1p-53)))};
}

inline Vec3<double> spatial_start(const SpatialScene& s) {
  return Vec3<double>((s.platform ? s.platform->home : Vec3<double>::Zero()) + s.reference.position);
}

template <class S>
SpatialReference<S> make_spatial_reference(const SpatialScene& s) {
  const auto& r = s.reference;
  SpatialReference<S> out;
  static_assert(static_cast<int>(SpatialReferenceName::sway) == static_cast<int>(SpatialReferenceKind::sway));
  out.kind = static_cast<SpatialReferenceKind>(r.type);
  const Quaternion<double> start = exponential(r.rotation);
  const double rate = r.type == SpatialReferenceName::sway ? 6.283185307179586477 * r.frequency : r.rate;
  out.position = spatial_start(s).cast<S>();
  out.attitude = normalised(Quaternion<S>{S(start.w), start.v.cast<S>()});
  out.axis = r.axis.cast<S>();
  out.second_axis = r.second_axis.cast<S>();
  out.angle = S(r.angle);
  out.shift = r.shift.cast<S>();
  out.duration = S(r.duration);
  out.rate = S(rate);
  out.second_rate = S(r.second_rate);
  out.phase = clock_of(rate, s.tick());
  out.second_phase = clock_of(r.second_rate, s.tick());
  return out;
}

/// The believed mechanism.
template <class S>
RigidBodyParams<S> believed(const RigidBodyParams<double>& p, const SpatialScene::Model& m) {
  return {S(p.mass * m.mass), (p.inertia * m.inertia).cast<S>()};
}
template <class S>
void believed_mechanism(const SpatialScene& s, FreeBody<S>& out) {
  out = make_free_body(believed<S>(s.body, s.model), S(s.gravity));
}
template <class S>
void believed_mechanism(const SpatialScene& s, Hexapod<S>& out) {
  const HexapodParams<double>& p = *s.platform;
  HexapodParams<S> b;
  b.platform = believed<S>(p.platform, s.model);
  for (int j = 0; j < 6; ++j) {
    b.base[j] = p.base[j].cast<S>();
    b.joint[j] = p.joint[j].cast<S>();
  }
  b.home = p.home.cast<S>();
  const auto strut = [&](const StrutParams<double>& x) {
    const double f = s.model.legs;
    return StrutParams<S>{S(x.centre), S(x.mass * f), S(x.transverse * f), S(x.axial * f), S(x.viscous)};
  };
  b.cylinder = strut(p.cylinder);
  b.rod = strut(p.rod);
  b.gravity = S(p.gravity);
  out = make_hexapod(b);
}

template <class M>
SpatialConfig<M> make_spatial_config(const SpatialScene& s) {
  using S = typename M::Scalar;
  SpatialConfig<M> c;
  believed_mechanism(s, c.mechanism);
  static_assert(static_cast<int>(SpatialLawName::smc_euler) == static_cast<int>(SpatialLaw::smc_euler) &&
                static_cast<int>(ReachingChoice::implicit) == static_cast<int>(Reaching::implicit));
  if (s.law != SpatialLawName::none) c.law = static_cast<SpatialLaw>(s.law);
  c.reaching = static_cast<Reaching>(s.reaching);
  const auto kind = [&](std::size_t i) {
    const bool implicit = c.reaching == Reaching::implicit;
    return typename SpatialGains<S>::Kind{
        S(s.lambda[i]), S(s.gain[i]),
        implicit ? implicit_layer(S(s.gain[i]), S(s.tick()), S(0)) : S(s.layer[i])};
  };
  c.gains.point = kind(0);
  c.gains.turn = kind(1);
  c.hysteresis = S(s.hysteresis);
  c.force_limit = S(s.force_limit);
  c.moment_limit = S(s.moment_limit);
  if (s.platform) c.length = S(s.platform->joint[0].head<2>().norm());
  return c;
}

}  // namespace esmc::host
