#pragma once
/// The controller in space against the plant, tick by tick.

#include "host_sim/spatial/controller.hpp"
#include "tests/support/spatial_case.hpp"

namespace esmc::test {

template <class S>
SpatialSample<S> sample_of(const SpatialState& s) {
  const Quaternion<double> q{s.attitude[0], s.attitude.tail<3>()};
  return {s.position.cast<S>(),
          s.velocity.cast<S>(),
          {S(q.w), q.v.cast<S>()},
          rotated(q.conjugate(), s.turning).template cast<S>()};
}

template <class S>
SpatialGains<S> gains(double lambda, double k, double layer) {
  const typename SpatialGains<S>::Kind kind{S(lambda), S(k), S(layer)};
  return {kind, kind, S(0.01)};
}

/// Controller, reference and plant, 1 kHz.
template <class M>
struct SpatialLoop {
  using S = typename M::Scalar;
  static constexpr double tick = 1e-3;
  SpatialController<M> controller;
  SpatialReference<S> reference;
  SpatialPlant plant;
  SpatialState state{};
  std::uint32_t n = 0;
  double work = 0.0;
  SpatialSample<S> sample{};  ///< of the last tick
  SpatialMotion<S> motion{};  ///< wanted at the last tick
  SpatialResult<S> result{};

  /// `touch(sample, motion)` may change what the controller gets to see.
  template <class F>
  const SpatialResult<S>& step(F&& touch) {
    motion = reference.at(n++, S(tick));
    sample = sample_of<S>(state);
    touch(sample, motion);
    result = controller.tick(sample, motion);
    SpatialPlant::Input u{};
    for (int i = 0; i < 6; ++i) u[static_cast<std::size_t>(i)] = double(result.input[i]);
    plant.step(state, u, tick, work);
    return result;
  }
  const SpatialResult<S>& step() {
    return step([](auto&, auto&) {});
  }
  /// Angle between the plant's attitude and the wanted one of the next tick, rad.
  [[nodiscard]] double angle() const {
    const auto m = reference.at(n, S(tick));
    const Quaternion<double> d{double(m.attitude.w), m.attitude.v.template cast<double>()},
        q{state.attitude[0], state.attitude.tail<3>()};
    return logarithm(Quaternion<double>(q.conjugate() * d)).norm();
  }
};

/// A free body of unequal inertias under implicit ESMC.
template <class S>
SpatialConfig<FreeBody<S>> body_config(S gravity = S(0)) {
  SpatialConfig<FreeBody<S>> c;
  c.mechanism = make_free_body<S>({S(2), Vec3<S>(S(0.02), S(0.03), S(0.045))}, gravity);
  c.gains = gains<S>(20, 60, 0.06);
  c.force_limit = S(1000);
  c.moment_limit = S(100);
  return c;
}
inline SpatialPlant body_plant(double gravity = 0.0) { return {{2, {0.02, 0.03, 0.045}}, gravity}; }

}  // namespace esmc::test
