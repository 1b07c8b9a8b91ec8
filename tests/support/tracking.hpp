#pragma once
/// A random 5R that tracks a random reference under random gains, in the firmware's terms and in the
/// oracle's.

#include "firmware/control/allocation.hpp"
#include "firmware/control/fused_law.hpp"
#include "tests/support/random_mechanism.hpp"

namespace esmc::test {

/// Values of every channel in long double.
using Channels18 = Vec<Real, 18>;

template <class S>
struct TrackingCase {
  using M = FiveBar<S>;
  FiveBarCase<S> now, wanted;  ///< same mechanism and modes, places some centimetres apart
  Vec2<S> wanted_acceleration;
  M mechanism;
  Tracking<M> t{};
  Gains<M> gain{};
  Reaching reaching = Reaching::sign;

  /// Coordinates, rates and accelerations asked for, and errors, of the oracle.
  [[nodiscard]] Channels18 error() const {
    return eigen(wanted.oracle.channels(wanted.q)) - eigen(now.oracle.channels(now.q));
  }
  [[nodiscard]] Channels18 error_rate() const { return wanted.rates() - now.rates(); }
  [[nodiscard]] Channels18 wanted_accelerations() const {
    return wanted.accelerations(
        wanted.oracle.accelerations(wanted.q, wanted.qd, wanted.qd, FiveBarModel::by_effector,
                                    Real(wanted_acceleration[0]), Real(wanted_acceleration[1])));
  }
  [[nodiscard]] Channels18 sliding() const {
    return error_rate() + gain.lambda.template cast<Real>().cwiseProduct(error());
  }
  /// Errors of (x, y) and of its rate.
  [[nodiscard]] Vec<Real, 2> effector_error() const { return error().template head<2>(); }
  [[nodiscard]] Vec<Real, 2> effector_error_rate() const { return error_rate().template head<2>(); }
  [[nodiscard]] Vec<Real, 2> sigma() const {
    return effector_error_rate() + Real(gain.independent.lambda) * effector_error();
  }
  [[nodiscard]] Mat<Real, 2, 2> H() const {
    const auto C = now.C();
    return C.transpose() * now.mass().asDiagonal() * C;
  }

  /// Torques at all joints that do what `demand` asks, from two motors or (weighted) from four.
  [[nodiscard]] Vec<S, 4> torque(const Demand<M>& demand, bool four,
                                 const Vec<S, 4>& weight = Vec<S, 4>::Ones()) const {
    const auto w = mechanism.force(demand.acceleration, t.rates);
    if (four) return allocate_all(mechanism, t.pose, w, weight);
    const Vec2<S> base = mechanism.base_torque(t.pose, w);
    return Vec<S, 4>(base[0], S(0), base[1], S(0));
  }
};

/// sw(s) in long double, written from its definition.
inline Real exact_switching(Reaching law, Real s, Real layer) {
  if (law == Reaching::sign) return s > 0 ? Real(1) : (s < 0 ? Real(-1) : Real(0));
  if (law == Reaching::tanh) return std::tanh(s / layer);
  return std::fmin(std::fmax(s / layer, Real(-1)), Real(1));
}

template <class S>
TrackingCase<S> random_tracking(std::uint64_t seed, Real distance = 0.03L) {
  TrackingCase<S> c;
  c.now = c.wanted = random_five_bar<S>(seed, {.min_sin1 = 0.3, .min_sin2 = 0.3});
  c.mechanism = c.now.mechanism();
  Random r(seed ^ 0x5eedU);
  auto& w = c.wanted;
  const auto kept = [&] {  // reached, in the same modes, without a turn of Newton's own
    for (const Real gap : w.oracle.closure(w.q)) {
      if (!(std::fabs(gap) < 1e-16L)) return false;
    }
    for (std::size_t i = 2; i < 6; ++i) {
      if (!(std::fabs(w.q[i] - c.now.q[i]) < 1)) return false;
    }
    for (int leg = 0; leg < 2; ++leg) {
      if (!(FiveBarModel::sin_type1(w.q, leg) * Real(w.mode.working[leg]) > 0.1L)) return false;
    }
    return FiveBarModel::sin_type2(w.q) * Real(w.mode.assembly) > 0.1L;
  };
  for (Real size = distance;; size /= 2) {
    const Vec2<S> step = r.vector<S, 2>(size);
    w.position = c.now.position + step;
    w.q = c.now.q;
    w.q[0] = Real(w.position[0]);
    w.q[1] = Real(w.position[1]);
    w.q = w.oracle.close(w.q, FiveBarModel::by_effector);
    if (kept()) break;
  }
  w.velocity = r.vector<S, 2>(1);
  w.qd = w.oracle.rates(w.q, FiveBarModel::by_effector, Real(w.velocity[0]), Real(w.velocity[1]));
  c.wanted_acceleration = r.vector<S, 2>(10);

  const auto& m = c.mechanism;
  c.t.pose = *m.inverse(c.now.position, c.now.mode);
  c.t.desired_pose = *m.inverse(w.position, w.mode);
  c.t.rates = m.rates_of_effector(c.t.pose, c.now.velocity);
  c.t.desired_rates = m.rates_of_effector(c.t.desired_pose, w.velocity);
  c.t.desired_acceleration =
      m.accelerations_of_effector(c.t.desired_pose, c.t.desired_rates, c.wanted_acceleration);
  for (int i = 0; i < 18; ++i) {
    c.gain.lambda[i] = r.in<S>(5, 60);
    c.gain.k[i] = r.in<S>(1, 100);
    c.gain.layer[i] = r.in<S>(0.1, 5);
  }
  c.gain.independent = {r.in<S>(5, 60), r.in<S>(1, 100), r.in<S>(0.1, 5), r.in<S>(10, 1000), r.in<S>(5, 60)};
  c.reaching = static_cast<Reaching>((seed / 8) % 4);
  return c;
}

}  // namespace esmc::test
