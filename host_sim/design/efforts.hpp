#pragma once
/// Torques of the motors: of the worst plant on the motion, and of the law.

#include <algorithm>
#include <cmath>
#include <limits>

#include "firmware/control/box_allocation.hpp"
#include "host_sim/design/worst.hpp"

namespace esmc::host::design {

/// Torques at the joints that equal forces w on the channels.
template <class M>
struct Effort {
  Vec<double, M::joints> torque = Vec<double, M::joints>::Zero();
  double force = 1.0;  ///< four motors: share of w that they give together within their limits
  double preload =
      1.0;  ///< four motors: remaining share of the preload; 0: it is the limit on the other side
};
/// Torques as the controller allocates them: of two motors they may exceed the limits, of four never.
template <class M>
[[nodiscard]] Effort<M> effort(const ControllerConfig<M>& c, const typename M::Pose& pose,
                               const typename M::Channels& w) {
  if constexpr (M::joints == 4) {
    if (c.allocate != nullptr) {
      const auto a = allocate_all_within(c.mechanism, pose, w, c.torque_weight, c.torque_limit, c.preload);
      return {a.torque, a.force, a.preload};
    }
  }
  const Vec2<double> base = c.mechanism.base_torque(pose, w);
  Effort<M> out;
  for (int i = 0; i < 2; ++i) out.torque[ControllerConfig<M>::joint_of(i, 2)] = base[i];
  return out;
}

/// Largest torque of `e` by its torque_limit (1: at the limit), infinite where a torque is not finite. With
/// c.allocate: w as a share of the largest multiple of w that the four motors can give together.
template <class M>
[[nodiscard]] double share_of_limits(const ControllerConfig<M>& c, const typename M::Pose& pose,
                                     const typename M::Channels& w, const Effort<M>& e) {
  double most = 0.0;
  for (int j = 0; j < M::joints; ++j) {
    if (!std::isfinite(e.torque[j])) return std::numeric_limits<double>::infinity();
    if (e.torque[j] != 0.0) most = std::max(most, std::abs(e.torque[j]) / c.torque_limit[j]);
  }
  if (c.allocate == nullptr) return most;
  // The share of a force beyond all limits that they meet says how far the limits reach.
  constexpr double much = 0x1p20;
  return 1.0 / (much * effort(c, pose, typename M::Channels(w * much)).force);
}

/// Largest torque magnitudes, N m, that keep the worst plant on the motion itself; `swing`: see friction().
template <class M>
[[nodiscard]] Effort<M> holding(const Problem<M>& p, const Uncertain<M>& u, double swing, const State<M>& s) {
  using Channels = typename M::Channels;
  const Worst<M> w(u, s, swing);
  const Channels own = p.controller.mechanism.force(s.wanted, s.track.rates);
  Effort<M> out;
  if (p.controller.allocate != nullptr) {
    w.each_push([&](const Vec2<double>& F) {
      Channels all = own;
      for (int k = 0; k < 2; ++k)
        all[k] -= F[k];  // on independent coordinate k: effector, or joint of the RR
      const Effort<M> e = effort(p.controller, s.track.pose, all);
      out.torque = out.torque.cwiseMax(e.torque.cwiseAbs());
      out.force = std::min(out.force, e.force);
      out.preload = std::min(out.preload, e.preload);
    });
    return out;
  }
  const auto asked = effort(p.controller, s.track.pose, own).torque;
  List<Vec<double, M::joints>, 2> map;
  for (int k = 0; k < 2; ++k) {
    Channels push = Channels::Zero();
    push[k] = 1.0;
    map[k] = effort(p.controller, s.track.pose, push).torque;
  }
  for (int j = 0; j < M::joints; ++j) {
    const Span d = w.along(Vec2<double>(map[0][j], map[1][j]));
    out.torque[j] = std::max(std::abs(asked[j] - d.low), std::abs(asked[j] - d.high));
  }
  return out;
}

/// Torque magnitudes, N m, that the law with gains g asks for in state s.
template <class M>
[[nodiscard]] Effort<M> asking(const Problem<M>& p, const Gains<M>& g, const State<M>& s) {
  const auto& c = p.controller;
  const Demand<M> d = demand(c.law, c.mechanism, g, c.reaching, s.track);
  Effort<M> out = effort(p.controller, s.track.pose, c.mechanism.force(d.acceleration, s.track.rates));
  out.torque = out.torque.cwiseAbs();
  return out;
}

}  // namespace esmc::host::design
