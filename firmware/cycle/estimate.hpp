#pragma once
/// From measured joint angles and rates to a closed pose and consistent rates, for each mechanism.

#include <optional>

#include "firmware/mechanism/five_bar.hpp"
#include "firmware/mechanism/rr.hpp"
#include "firmware/safety/guards.hpp"

namespace esmc {

template <class M>
struct Estimate {
  typename M::Pose pose{};
  typename M::Rates rates{};
  typename M::Scalar closure{};  ///< m, distance between the leg tips as measured; 0 without passive encoders
};

/// Base encoders only: the passive joints follow from closure in the given assembly mode [F18], [F23].
/// Empty when the base angles fit no closed mechanism. The rates are not finite at type 2.
template <class S>
[[nodiscard]] std::optional<Estimate<FiveBar<S>>> estimate_from_base(const FiveBar<S>& m,
                                                                    const typename FiveBar<S>::Mode& mode,
                                                                    const Vec2<S>& angle, const Vec2<S>& rate) {
  const auto pose = m.forward(angle, mode.assembly);
  if (!pose) return std::nullopt;
  return Estimate<FiveBar<S>>{*pose, m.base_rates(*pose, rate), S(0)};
}
template <class S>
[[nodiscard]] std::optional<Estimate<Rr<S>>> estimate_from_base(const Rr<S>& m, const typename Rr<S>::Mode&,
                                                               const Vec2<S>& angle, const Vec2<S>& rate) {
  return Estimate<Rr<S>>{m.pose(angle), rate, S(0)};
}

/// Encoders on all joints (theta11, theta12, theta21, theta22): regular at type 2 as well. The effector is the
/// mean of the two leg tips, and so is its velocity.
template <class S>
[[nodiscard]] Estimate<FiveBar<S>> estimate_from_all(const FiveBar<S>& m, const Vec<S, 4>& angle,
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

/// The reference in the form the laws take. Empty: outside the workspace, or the base angles do not close.
template <class M>
struct Desired {
  typename M::Pose pose{};
  typename M::Rates rates{};
  typename M::Rates acceleration{};
};

template <class M, class S = typename M::Scalar>
[[nodiscard]] std::optional<Desired<M>> desired_at_effector(const M& m, const typename M::Mode& mode,
                                                            const Vec2<S>& x, const Vec2<S>& v, const Vec2<S>& a) {
  const auto pose = m.inverse(x, mode);
  if (!pose) return std::nullopt;
  const typename M::Rates rates = m.rates_of_effector(*pose, v);
  return Desired<M>{*pose, rates, m.accelerations_of_effector(*pose, rates, a)};
}

template <class M, class S = typename M::Scalar>
[[nodiscard]] std::optional<Desired<M>> desired_at_base(const M& m, const typename M::Mode& mode, const Vec2<S>& q,
                                                        const Vec2<S>& qd, const Vec2<S>& qdd) {
  const auto estimate = estimate_from_base(m, mode, q, qd);
  if (!estimate) return std::nullopt;
  return Desired<M>{estimate->pose, estimate->rates, m.base_accelerations(estimate->pose, estimate->rates, qdd)};
}

}  // namespace esmc
