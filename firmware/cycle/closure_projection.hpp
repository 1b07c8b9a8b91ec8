#pragma once
/// Definition of part_fusion.hpp, for instances_part_fusion.cpp.

#include "firmware/cycle/controller.hpp"

namespace esmc::part {
/// Linearised gap between the leg tips: column i is the change of tip 1 minus tip 2 per rad of joint i, m.
template <class S>
class Closure {
 public:
  using M = FiveBar<S>;
  /// Keeps a reference to `variance` (> 0, relative to each other), which must outlive it.
  Closure(const M& m, const typename M::Pose& p, const Vec<S, 4>& variance) : variance_(variance) {
    unroll<2>([&](auto j) ESMC_INLINE {
      const S sign = j == 0 ? S(1) : S(-1);
      const Vec2<S> tip = m.leg(j).tip(p.leg[j]);
      constexpr int base = 2 * j;
      column_[base] = m.frame(j).from_leg(perp(tip)) * sign;
      column_[base + 1] = m.frame(j).from_leg(perp(p.leg[j].axis[1])) * (sign * m.leg(j).body(1).length);
    });
    S xx(0), xy(0), yy(0);
    for (int i = 0; i < 4; ++i) {
      const Vec2<S>& c = column_[i];
      xx += variance[i] * c.x() * c.x();
      xy += variance[i] * c.x() * c.y();
      yy += variance[i] * c.y() * c.y();
    }
    const S inverse = S(1) / (xx * yy - xy * xy);
    xx_ = yy * inverse;
    xy_ = -xy * inverse;
    yy_ = xx * inverse;
  }

  /// The smallest turns (rad), relative to the standard deviations, that close `gap` (m), to first order.
  [[nodiscard]] Vec<S, 4> correction(const Vec2<S>& gap) const {
    const Vec2<S> multiplier = weighed(gap);
    Vec<S, 4> out;
    for (int i = 0; i < 4; ++i) out[i] = -variance_[i] * dot(column_[i], multiplier);
    return out;
  }
  /// Rate of the gap, m/s, of joint rates in rad/s.
  [[nodiscard]] Vec2<S> rate(const Vec<S, 4>& joint_rate) const {
    Vec2<S> out = Vec2<S>::Zero();
    for (int i = 0; i < 4; ++i) out += column_[i] * joint_rate[i];
    return out;
  }

 private:
  [[nodiscard]] Vec2<S> weighed(const Vec2<S>& v) const {
    return {xx_ * v.x() + xy_ * v.y(), xy_ * v.x() + yy_ * v.y()};
  }

  List<Vec2<S>, 4> column_;
  const Vec<S, 4>& variance_;
  S xx_, xy_, yy_;
};

/// Smallest distance of the leg tips, m, over all angles of joint i (0 to 3: theta11, theta12, theta21,
/// theta22) while the other readings stay. Exact: does not depend on the reading of joint i.
template <class S>
[[nodiscard]] S remaining_gap(const FiveBar<S>& m, const typename FiveBar<S>::Pose& p, int i) {
  const int leg = i / 2, other = 1 - leg;
  const Vec2<S> tip = m.leg(leg).tip(p.leg[leg]);
  const Vec2<S> joint =
      i % 2 == 0 ? Vec2<S>(Vec2<S>::Zero()) : Vec2<S>(p.leg[leg].axis[0] * m.leg(leg).body(0).length);
  const Vec2<S> target =
      m.frame(leg).point_to_leg(m.frame(other).point_from_leg(m.leg(other).tip(p.leg[other])));
  const Vec2<S> arm = tip - joint, wanted = target - joint;
  return magnitude(square_root(dot(wanted, wanted)) - square_root(dot(arm, arm)));
}

/// 1 + the only joint whose angle alone can close the gap to `allowed` / 4 (m) while every other joint leaves
/// more than `allowed` / 2; else 0. Wrong only if the other three readings contradict each other by that.
template <class S>
[[nodiscard, gnu::noinline]] std::uint8_t contradicting_joint(const FiveBar<S>& m,
                                                              const typename FiveBar<S>::Pose& p, S allowed) {
  int named = 0, apart = 0;
  for (int i = 0; i < 4; ++i) {
    const S left = remaining_gap(m, p, i);
    if (left <= S(0.25F) * allowed) named = i + 1;
    if (left > S(0.5F) * allowed) ++apart;  // not so for a NaN
  }
  return apart == 3 ? static_cast<std::uint8_t>(named) : std::uint8_t{0};
}

template <class M>
std::uint8_t closure_projection(const ControllerConfig<M>& config,
                                const Vec<typename M::Scalar, M::joints>& angle,
                                const Vec<typename M::Scalar, M::joints>& rate, Estimate<M>& out) {
  using S = typename M::Scalar;
  const M& m = config.mechanism;
  const Vec<S, 4>& variance = config.encoder_variance;
  Vec<S, 4> turns = Vec<S, 4>::Zero();
  std::uint8_t contradicting = 0;
  out.pose = m.pose(angle);
  for (int step = 0; step < 2; ++step) {
    const Vec2<S> gap = m.closure_residual(out.pose);
    const Closure<S> closure(m, out.pose, variance);
    if (step == 0) {
      out.closure = square_root(dot(gap, gap));
      if (!(out.closure <= config.limits.closure))
        contradicting = contradicting_joint(m, out.pose, config.limits.closure);
    }
    turns = closure.correction(gap - closure.rate(turns));  // the smallest turns in total, not of this step
    out.pose = m.pose(angle + turns);
  }
  const Closure<S> closure(m, out.pose, variance);
  const Vec<S, 4> turning = rate + closure.correction(closure.rate(rate));
  out.rates.leg = {{turning.template head<2>(), turning.template tail<2>()}};
  out.rates.platform.setZero();
  unroll<2>([&](auto j) ESMC_INLINE {
    out.rates.platform += m.frame(j).from_leg(m.leg(j).tip_rate(out.pose.leg[j], out.rates.leg[j])) * S(0.5);
  });
  return contradicting;
}

}  // namespace esmc::part
