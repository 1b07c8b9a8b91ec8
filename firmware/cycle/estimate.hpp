#pragma once
/// From measured joint angles and rates to a closed pose and consistent rates, for each mechanism.

#include <optional>

#include "firmware/mechanism/five_bar.hpp"
#include "firmware/mechanism/rr.hpp"
#include "firmware/safety/guards.hpp"

namespace esmc {

/// Configuration and rates of the whole mechanism, from the encoders.
template <class M>
struct Estimate {
  typename M::Pose pose;
  typename M::Rates rates;
  typename M::Scalar closure;  ///< m, distance between the leg tips as measured; 0 without passive encoders
};

/// From base encoders (rad, rad/s): the passive joints follow from closure in the given assembly mode [F18],
/// [F23]. False, without results: the angles fit no closed mechanism. Rates are not finite at type 2.
template <class S>
[[nodiscard]] bool estimate_from_base(const FiveBar<S>& m, const typename FiveBar<S>::Mode& mode,
                                      const Vec2<S>& angle, const Vec2<S>& rate,
                                      typename FiveBar<S>::Pose& pose, typename FiveBar<S>::Rates& rates) {
  if (!m.forward(angle, mode.assembly, pose)) return false;
  rates = m.base_rates(pose, rate);
  return true;
}
/// From the encoders of an RR arm (rad, rad/s). Always true: a NaN or too large an angle gives a NaN pose.
template <class S>
[[nodiscard]] bool estimate_from_base(const Rr<S>& m, const typename Rr<S>::Mode&, const Vec2<S>& angle,
                                      const Vec2<S>& rate, typename Rr<S>::Pose& pose,
                                      typename Rr<S>::Rates& rates) {
  pose = m.pose(angle);
  rates = rate;
  return true;
}
/// Pose and rates from base encoders (rad, rad/s), by value, `closure` 0; empty: no pose has them.
template <class M, class S = typename M::Scalar>
[[nodiscard]] std::optional<Estimate<M>> estimate_from_base(const M& m, const typename M::Mode& mode,
                                                            const Vec2<S>& angle, const Vec2<S>& rate) {
  Estimate<M> e;
  e.closure = S(0);
  return estimate_from_base(m, mode, angle, rate, e.pose, e.rates) ? std::optional<Estimate<M>>(e)
                                                                   : std::nullopt;
}

/// From encoders on all joints (theta11, theta12, theta21, theta22; rad, rad/s), at type 2 too. The effector
/// is the mean of the leg tips. Never fails: `closure` reports readings that contradict each other, NaN after
/// a NaN angle: test `closure <= limit`.
template <class S>
[[nodiscard, gnu::cold]] Estimate<FiveBar<S>> estimate_from_all(const FiveBar<S>& m, const Vec<S, 4>& angle,
                                                                const Vec<S, 4>& rate) {
  Estimate<FiveBar<S>> out;
  out.pose = m.pose(angle);
  out.rates.leg = {{rate.template head<2>(), rate.template tail<2>()}};
  out.rates.platform.setZero();
  unroll<2>([&](auto j) {
    out.rates.platform += m.frame(j).from_leg(m.leg(j).tip_rate(out.pose.leg[j], out.rates.leg[j])) * S(0.5);
  });
  const Vec2<S> gap = m.closure_residual(out.pose);
  out.closure = square_root(dot(gap, gap));
  return out;
}

/// The reference as pose, rates and accelerations of all coordinates.
template <class M>
struct Desired {
  typename M::Pose pose;
  typename M::Rates rates;
  typename M::Rates acceleration;
};

/// Reference of an effector at x (m) with velocity v (m/s) and acceleration a (m/s2). False, without results:
/// outside the workspace. Rates and accelerations are not finite at type 1.
template <class M, class S = typename M::Scalar>
[[nodiscard]] ESMC_INLINE inline bool desired_at_effector(const M& m, const typename M::Mode& mode,
                                                          const Vec2<S>& x, const Vec2<S>& v,
                                                          const Vec2<S>& a, typename M::Pose& pose,
                                                          typename M::Rates& rates,
                                                          typename M::Rates& acceleration) {
  if (!m.inverse(x, mode, pose)) return false;
  rates = m.rates_of_effector(pose, v);
  acceleration = m.accelerations_of_effector(pose, rates, a);
  return true;
}

/// Reference of base joints at q (rad) with rates qd (rad/s) and accelerations qdd (rad/s2). False, without
/// results: the legs cannot be closed at q. Rates and accelerations are not finite at type 2.
template <class M, class S = typename M::Scalar>
[[nodiscard]] bool desired_at_base(const M& m, const typename M::Mode& mode, const Vec2<S>& q,
                                   const Vec2<S>& qd, const Vec2<S>& qdd, typename M::Pose& pose,
                                   typename M::Rates& rates, typename M::Rates& acceleration) {
  if (!estimate_from_base(m, mode, q, qd, pose, rates)) return false;
  acceleration = m.base_accelerations(pose, rates, qdd);
  return true;
}

/// Reference of an effector at x (m) with velocity v (m/s) and acceleration a (m/s2), by value. Empty:
/// outside the workspace. Rates and accelerations are not finite at type 1.
template <class M, class S = typename M::Scalar>
[[nodiscard]] std::optional<Desired<M>> desired_at_effector(const M& m, const typename M::Mode& mode,
                                                            const Vec2<S>& x, const Vec2<S>& v,
                                                            const Vec2<S>& a) {
  Desired<M> d;
  return desired_at_effector(m, mode, x, v, a, d.pose, d.rates, d.acceleration) ? std::optional<Desired<M>>(d)
                                                                                : std::nullopt;
}
/// Reference of base joints at q (rad), qd (rad/s), qdd (rad/s2), by value; empty: the legs cannot be closed
/// at q. Rates and accelerations are not finite at type 2.
template <class M, class S = typename M::Scalar>
[[nodiscard]] std::optional<Desired<M>> desired_at_base(const M& m, const typename M::Mode& mode,
                                                        const Vec2<S>& q, const Vec2<S>& qd,
                                                        const Vec2<S>& qdd) {
  Desired<M> d;
  return desired_at_base(m, mode, q, qd, qdd, d.pose, d.rates, d.acceleration) ? std::optional<Desired<M>>(d)
                                                                               : std::nullopt;
}

}  // namespace esmc
