#pragma once
/// What part_fusion.hpp declares; compiled by instances_part_fusion.cpp alone.

#include "firmware/cycle/controller.hpp"

namespace esmc::part {
/// The gap between the tips, linear in small turns of the joints: column i is tip 1 less tip 2 per rad of joint i, m in N.
template <class S>
class Closure {
 public:
  using M = FiveBar<S>;
  Closure(const M& m, const typename M::Pose& p, const Vec<S, 4>& variance) : variance_(variance) {
    unroll<2>([&](auto j) ESMC_INLINE {
      const S sign = j == 0 ? S(1) : S(-1);
      const Vec2<S> tip = m.leg(j).tip(p.leg[j]);
      column_[2 * j] = m.frame(j).from_leg(perp(tip)) * sign;
      column_[2 * j + 1] = m.frame(j).from_leg(perp(p.leg[j].axis[1])) * (sign * m.leg(j).body(1).length);
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

  /// The smallest turns that take away `gap`.
  [[nodiscard]] Vec<S, 4> correction(const Vec2<S>& gap) const {
    const Vec2<S> multiplier = weighed(gap);
    Vec<S, 4> out;
    for (int i = 0; i < 4; ++i) out[i] = -variance_[i] * dot(column_[i], multiplier);
    return out;
  }
  [[nodiscard]] Vec2<S> rate(const Vec<S, 4>& joint_rate) const {
    Vec2<S> out = Vec2<S>::Zero();
    for (int i = 0; i < 4; ++i) out += column_[i] * joint_rate[i];
    return out;
  }

  /// What is left of the gap's weight without encoder i, as a part of it: 0 where i alone explains the gap.
  [[nodiscard]] S left_without(int i, const Vec2<S>& gap) const {
    const Vec2<S> multiplier = weighed(gap);
    const S along = dot(column_[i], multiplier);
    return S(1) - along * along / (dot(column_[i], weighed(column_[i])) * dot(gap, multiplier));
  }

  /// 1 + the joint that explains the gap, if one does (within 12 degrees of its direction, in units of the encoders' deviations) and
  /// no other comes near.
  [[nodiscard, gnu::noinline]] std::uint8_t odd(const Vec2<S>& gap) const {
    constexpr S explained = S(0.04F), margin = S(0.01F);
    int best = 0;
    Vec<S, 4> left;
    for (int i = 0; i < 4; ++i) {
      left[i] = left_without(i, gap);
      if (left[i] < left[best]) best = i;
    }
    bool clear = left[best] <= explained;
    for (int i = 0; i < 4; ++i) clear = clear && (i == best || left[i] >= S(4) * left[best] + margin);
    return clear ? static_cast<std::uint8_t>(best + 1) : std::uint8_t{0};
  }

 private:
  [[nodiscard]] Vec2<S> weighed(const Vec2<S>& v) const { return {xx_ * v.x() + xy_ * v.y(), xy_ * v.x() + yy_ * v.y()}; }

  List<Vec2<S>, 4> column_;
  const Vec<S, 4>& variance_;
  S xx_, xy_, yy_;
};

template <class M>
std::uint8_t closure_projection(const ControllerConfig<M>& config, const Vec<typename M::Scalar, M::joints>& angle,
                                const Vec<typename M::Scalar, M::joints>& rate, Estimate<M>& out) {
  using S = typename M::Scalar;
  const M& m = config.mechanism;
  const Vec<S, 4>& variance = config.encoder_variance;
  Vec<S, 4> turns = Vec<S, 4>::Zero();
  std::uint8_t odd = 0;
  out.pose = m.pose(angle);
  for (int step = 0; step < 2; ++step) {
    const Vec2<S> gap = m.closure_residual(out.pose);
    const Closure<S> closure(m, out.pose, variance);
    if (step == 0) {
      out.closure = square_root(dot(gap, gap));
      if (!(out.closure <= config.limits.closure)) odd = closure.odd(gap);
    }
    turns = closure.correction(gap - closure.rate(turns));  // the smallest in all, not the next small step
    out.pose = m.pose(angle + turns);
  }
  const Closure<S> closure(m, out.pose, variance);
  const Vec<S, 4> turning = rate + closure.correction(closure.rate(rate));
  out.rates.leg = {{turning.template head<2>(), turning.template tail<2>()}};
  out.rates.platform.setZero();
  unroll<2>([&](auto j) ESMC_INLINE {
    out.rates.platform += m.frame(j).from_leg(m.leg(j).tip_rate(out.pose.leg[j], out.rates.leg[j])) * S(0.5);
  });
  return odd;
}

}  // namespace esmc::part
