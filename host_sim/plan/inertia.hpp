#pragma once
/// What a believed mechanism weighs and what it takes to accelerate it, joint by joint: the closed form of a
/// leg of two bars. The algorithm of the firmware gives the same by way of all its channels, at five times
/// the instructions, and a plan evaluates it at every tick.

#include "host_sim/design/extremes.hpp"

namespace esmc::host::plan {

using design::leg_of;

/// Force on the effector, N, which an arm has none of, and torques of the joints of every leg, N m.
struct Forces {
  Vec2<double> effector = Vec2<double>::Zero();
  List<Vec2<double>, 2> leg{{Vec2<double>::Zero(), Vec2<double>::Zero()}};
};

template <class M>
class Inertia {
 public:
  static constexpr int legs = M::joints / 2;

  explicit Inertia(const M& m) {
    for (int j = 0; j < legs; ++j) {
      const auto& chain = leg_of(m, j);
      const Body<double>&inner = chain.body(0), &outer = chain.body(1);
      // The force that holds a mass of 1 kg is the gravity of the mechanism.
      typename M::Leg::Channels w = chain.force(M::Leg::Channels::Zero(), Vec2<double>::Zero());
      const double g = outer.mass > 0.0 ? w[M::Leg::row_x(1) + 1] / outer.mass : 0.0;
      leg_[j] = {
          inner.inertia + inner.mass * inner.centre * inner.centre + outer.mass * inner.length * inner.length,
          outer.inertia + outer.mass * outer.centre * outer.centre,
          outer.mass * inner.length * outer.centre,
          outer.rotor,
          g * (inner.mass * inner.centre + outer.mass * inner.length),
          g * outer.mass * outer.centre};
    }
    if constexpr (legs == 2) mass_ = m.platform().mass, weight_ = mass_ * m.platform().gravity;
  }
  /// What holds a pose.
  [[nodiscard]] Forces weight(const typename M::Pose& pose) const {
    Forces out;
    out.effector.y() = weight_;
    for (int j = 0; j < legs; ++j) {
      const auto& p = leg_of(pose, j);
      const double outer = leg_[j].pull2 * p.axis[1].x();
      out.leg[j] = {leg_[j].pull1 * p.axis[0].x() + outer, outer};
    }
    return out;
  }
  /// What a motion takes beyond that.
  [[nodiscard]] Forces push(const typename M::Pose& pose, const typename M::Rates& rates,
                            const typename M::Rates& acceleration) const {
    Forces out;
    if constexpr (legs == 2) out.effector = mass_ * acceleration.platform;
    for (int j = 0; j < legs; ++j) {
      const Leg& l = leg_[j];
      const Vec2<double>&v = leg_of(rates, j), &a = leg_of(acceleration, j), &turn = leg_of(pose, j).turn[1];
      const double a2 = a[0] + a[1], v2 = v[0] + v[1],  // of the outer bar
          inner = l.inertia1 * a[0] + l.coupled * (turn.x() * a2 - turn.y() * v2 * v2),
                   outer = l.inertia2 * a2 + l.coupled * (turn.x() * a[0] + turn.y() * v[0] * v[0]);
      out.leg[j] = {inner + outer, outer + l.rotor * a[1]};
    }
    return out;
  }

 private:
  /// By the absolute angles of the bars: inertias, kg m2, and what gravity pulls at the level, N m.
  struct Leg {
    double inertia1, inertia2, coupled, rotor, pull1, pull2;
  };
  List<Leg, 2> leg_{};
  double mass_ = 0.0, weight_ = 0.0;
};

}  // namespace esmc::host::plan
