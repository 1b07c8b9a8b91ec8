#pragma once
/// The serial algorithm of the report, eqs. (1)-(7): a planar chain of any fixed number of bodies, each
/// joined to the one before by a revolute or a prismatic joint. model.md section 1.
///
/// p = [p#; p°]: p# the joint rates, p° the bar angular rates and the mass-centre velocities of all bodies.
/// The matrices C, A, M of model.md [F1], [F2] are never formed: `rates` is p = C p#, `bias` is c = Cdot p#,
/// `joint_torques` is C^T w, each one pass along the chain.

#include "firmware/mechanism/chain.hpp"

namespace esmc {

/// A planar chain (1)-(7); see the top of the file. Angles in rad, lengths in m, in the frame of its base.
template <class S, class... Links>
class Serial {
  using C = Chain<S, Links...>;

 public:
  using Scalar = S;
  static constexpr int joints = C::joints;
  /// Rows of p as in model.md [F3]: joint rates, bar angular rates, mass-centre velocities (x, y per body).
  static constexpr int channels = 4 * joints;
  using Joints = typename C::Joints;
  using Channels = Vec<S, channels>;
  using Pose = typename C::Pose;

  static constexpr int row_joint(int i) { return i; }               ///< rate of joint i
  static constexpr int row_angle(int i) { return joints + i; }      ///< angular rate of bar i
  static constexpr int row_x(int i) { return 2 * joints + 2 * i; }  ///< x' of mass centre i; y' is next
  /// True for rows with a mass or an inertia in M; false for the rows of joints: see `force`.
  static constexpr bool has_mass(int row) { return row >= joints; }

  Serial() = default;
  /// gravity: along -y, m/s2, >= 0.
  constexpr Serial(const List<Body<S>, joints>& bodies, S gravity) : chain_(bodies), gravity_(gravity) {}

  [[nodiscard]] const Body<S>& body(int i) const { return chain_.body(i); }  ///< constants, i < joints

  /// Pose at q: joint angles (rad; NaN beyond the range of sin_cos) and displacements (m).
  [[nodiscard]] static Pose pose(const Joints& q) {
    Pose p;
    Sum<S> angle;
    Vec2<S> axis(S(1), S(0));
    unroll<joints>([&](auto i) ESMC_INLINE {
      if constexpr (C::revolute(i)) {
        // The sum is rounded once and loses less than turning the unit vector by theta_i would: near type 2
        // every 1e-16 here is 1e-16 / D2 in a torque.
        const bool first = angle.empty();
        angle.add(q[i]);
        const SinCos<S> t = sin_cos(q[i]), a = first ? t : sin_cos(angle.value());
        p.turn[i] = Vec2<S>(t.cos, t.sin);
        axis = Vec2<S>(a.cos, a.sin);
      } else {
        p.turn[i] = Vec2<S>(S(1), S(0));
      }
      C::put_slide(p, i, q[i]);
      p.axis[i] = axis;
    });
    return p;
  }

  /// p = C p# (2): all velocities (rad/s, m/s) of joint rates. Also the part C a of all accelerations.
  [[nodiscard, gnu::always_inline]] Channels rates(const Pose& p, const Joints& qd) const {
    Channels out;
    typename C::RateWalk w;
    Sum<Vec2<S>> end;
    unroll<joints>([&](auto i) ESMC_INLINE {
      const typename C::BodyMotion m = C::move(w, i, p, qd);
      put(out, i, {qd[i], C::turns(i) ? w.spin.value() : S(0), chain_.to_mass_centre(end, i, m)});
    });
    return out;
  }

  /// c = Cdot p# of [F1] is bias(p#, p#): the accelerations at constant joint rates. bias(a, b) = Cdot(a) b
  /// is bilinear, and symmetric: in the plane every entry of p is the rate of a coordinate.
  [[nodiscard, gnu::always_inline]] Channels bias(const Pose& p, const Joints& a, const Joints& b) const {
    Channels out;
    typename C::BiasWalk w;
    Sum<Vec2<S>> end;
    unroll<joints>([&](auto i) ESMC_INLINE {
      put(out, i, {S(0), S(0), chain_.to_mass_centre(end, i, C::move(w, i, p, a, b))});
    });
    return out;
  }

  /// C^T w (1): joint torques (N m, N) of forces w, one per channel. The joint rows of w act on their own
  /// joint only.
  [[nodiscard, gnu::always_inline]] Joints joint_torques(const Pose& p, const Channels& w) const {
    Joints out;
    Sum<S> moment;       // of the bodies further out, about the joint of the body in hand
    Sum<Vec2<S>> force;  // of the bodies further out
    unroll<joints>([&](auto k) ESMC_INLINE {
      constexpr int i = joints - 1 - k;
      const Vec2<S> f(w[row_x(i)], w[row_x(i) + 1]);
      if constexpr (i + 1 < joints) moment.add(body(i).length * cross(p.axis[i], force.value()));
      moment.add(w[row_angle(i)] + chain_.moment_of(f, p, i));
      force.add(f);
      if constexpr (C::revolute(i)) {
        out[i] = w[i] + moment.value();
      } else {
        out[i] = w[i] + dot(p.axis[i], force.value());
        moment.add(C::slid(p, i) * cross(p.axis[i], force.value()));
      }
    });
    return out;
  }

  /// Position of the tip in the frame of the base, m.
  [[nodiscard]] Vec2<S> tip(const Pose& p) const {
    Sum<Vec2<S>> x;
    unroll<joints>([&](auto i) ESMC_INLINE { x.add(p.axis[i] * chain_.reach(p, i)); });
    return x.value();
  }

  /// J qd: velocity of the tip, m/s ([F8] for two bars).
  [[nodiscard]] Vec2<S> tip_rate(const Pose& p, const Joints& qd) const {
    Sum<Vec2<S>> v;
    Sum<S> spin;
    unroll<joints>([&](auto i) ESMC_INLINE {
      if constexpr (C::revolute(i)) {
        spin.add(qd[i]);
      } else {
        v.add(p.axis[i] * qd[i]);
      }
      if (!spin.empty()) v.add(perp(p.axis[i]) * (spin.value() * chain_.reach(p, i)));
    });
    return v.value();
  }

  /// Jdot(a) b of the tip, m/s2 ([F9] for two bars and a = b); bilinear as `bias`.
  [[nodiscard]] Vec2<S> tip_bias(const Pose& p, const Joints& a, const Joints& b) const {
    Sum<Vec2<S>> acc;
    Sum<S> spin_a, spin_b;
    unroll<joints>([&](auto i) ESMC_INLINE {
      if constexpr (C::revolute(i)) {
        spin_a.add(a[i]);
        spin_b.add(b[i]);
      } else if (!spin_a.empty()) {
        acc.add(perp(p.axis[i]) * (spin_a.value() * b[i] + spin_b.value() * a[i]));
      }
      if (!spin_a.empty()) acc.subtract(p.axis[i] * (spin_a.value() * spin_b.value() * chain_.reach(p, i)));
    });
    return acc.empty() ? Vec2<S>(Vec2<S>::Zero()) : acc.value();
  }

  /// Mass centres of all bodies in the frame of the base, m.
  [[nodiscard]] List<Vec2<S>, joints> centres(const Pose& p) const {
    List<Vec2<S>, joints> out;
    Vec2<S> start = Vec2<S>::Zero();
    unroll<joints>([&](auto i) ESMC_INLINE {
      out[i] = start + p.axis[i] * C::slid(p, i) + chain_.from_joint(p.axis[i], i);
      start += p.axis[i] * chain_.reach(p, i);
    });
    return out;
  }

  /// e = q_d - q of all channels [F29]. Angles come from the unit vectors, so they are in [-pi, pi] by
  /// construction; joint entries have no mass and serve display only.
  [[nodiscard]] Channels error(const Pose& desired, const Pose& actual) const {
    Channels out;
    const Joints still = Joints::Zero();
    for_each_error_row(desired, still, still, actual, still, [&](auto row, S e, S, S) { out[row] = e; });
    return out;
  }

  /// Sets the joint rows of s (sliding variables, errors, rates) from the rows of the bars: s_theta2 = s_phi2
  /// - s_phi1 (model.md section 10). Not wrapped. `first`: the row of s with which this chain begins.
  template <int N>
  static void fill_joint_rows(Vec<S, N>& s, int first = 0) requires(!C::slides) {
    unroll<joints>([&](auto i) ESMC_INLINE {
      const S of_bar = s[first + row_angle(i)];
      s[first + row_joint(i)] = i == 0 ? of_bar : S(of_bar - s[first + row_angle(i) - 1]);
    });
  }

  /// Calls f(row, e, e', q''_d) once for every channel [F29]: e = q_d - q as in `error`, e' = C(q_d) qd_d -
  /// C(q) qd, q''_d = C(q_d) qdd_d + Cdot(q_d) qd_d. Body by body, so that no vector of channels is stored.
  /// Without `joint_rows` the rows of the joints are left out.
  template <bool joint_rows = true, class F>
  ESMC_INLINE void for_each_error_row(const Pose& desired, const Joints& qd_d, const Joints& qdd_d,
                                      const Pose& actual, const Joints& qd, F&& f) const {
    S turned{};
    typename C::RateWalk fast, slow, push;
    typename C::BiasWalk drift;
    Sum<Vec2<S>> error_at_end, rate_at_end, push_at_end;
    unroll<joints>([&](auto i) ESMC_INLINE {
      const S before = turned;
      turned = C::turned_at(i, desired, actual);
      const typename C::BodyMotion v = C::move(fast, i, desired, qd_d) - C::move(slow, i, actual, qd),
                                   a = C::move(push, i, desired, qdd_d) +
                                       C::move(drift, i, desired, qd_d, qd_d);
      if constexpr (joint_rows)
        f(constant<row_joint(i)>, C::joint_error(i, before, turned, desired, actual), S(qd_d[i] - qd[i]),
          qdd_d[i]);
      f(constant<row_angle(i)>, turned, C::turns(i) ? S(fast.spin.value() - slow.spin.value()) : S(0),
        C::turns(i) ? push.spin.value() : S(0));
      const Vec2<S> e = chain_.to_mass_centre(error_at_end, i, C::gap(i, desired, actual)),
                    e_rate = chain_.to_mass_centre(rate_at_end, i, v),
                    reference = chain_.to_mass_centre(push_at_end, i, a);
      f(constant<row_x(i)>, e.x(), e_rate.x(), reference.x());
      f(constant<row_x(i) + 1>, e.y(), e_rate.y(), reference.y());
    });
  }

  /// Calls f(row, C sigma, C qdd + Cdot(a) b) once for every channel [F33], body by body.
  template <class F>
  ESMC_INLINE void for_each_reference_row(const Pose& p, const Joints& sigma, const Joints& qdd,
                                          const Joints& a, const Joints& b, F&& f) const {
    typename C::RateWalk fast, push;
    typename C::BiasWalk drift;
    Sum<Vec2<S>> rate_at_end, push_at_end;
    unroll<joints>([&](auto i) ESMC_INLINE {
      const Vec2<S> v = chain_.to_mass_centre(rate_at_end, i, C::move(fast, i, p, sigma));
      const Vec2<S> r =
          chain_.to_mass_centre(push_at_end, i, C::move(push, i, p, qdd) + C::move(drift, i, p, a, b));
      f(constant<row_joint(i)>, sigma[i], qdd[i]);
      f(constant<row_angle(i)>, C::turns(i) ? fast.spin.value() : S(0),
        C::turns(i) ? push.spin.value() : S(0));
      f(constant<row_x(i)>, v.x(), r.x());
      f(constant<row_x(i) + 1>, v.y(), r.y());
    });
  }

  /// M v' + f + g of (1), [F2]: forces on the channels, N m and N, that go through C^T. The joint rows hold
  /// friction alone, v' there is not read: rotors act through `add_rotors` (model.md section 9).
  [[nodiscard, gnu::always_inline]] Channels force(const Channels& v, const Joints& qd) const {
    Channels out;
    unroll<joints>([&](auto i) ESMC_INLINE {
      const Body<S>& b = body(i);
      put(out, i,
          {b.viscous * qd[i] + against(b, qd[i]), b.inertia * v[row_angle(i)],
           Vec2<S>(b.mass * v[row_x(i)], b.mass * (v[row_x(i) + 1] + gravity_))});
    });
    return out;
  }

  /// Adds M^-1 r k k^T v to the accelerations v of the channels for each rotor r at a joint i > 0, k = (-1,
  /// 1) on the rows of bars i - 1 and i: `force` then includes the term r k k^T of M. `first`: row of v with
  /// which this chain begins. The inertias of both bars must be > 0.
  template <int N>
  void add_rotors(Vec<S, N>& v, int first = 0) const {
    for (int i = 1; i < joints; ++i) {
      if (!(body(i).rotor > S(0))) continue;
      S &inner = v[first + row_angle(i - 1)], &outer = v[first + row_angle(i)];
      const S torque = body(i).rotor * (outer - inner);
      inner -= torque / body(i - 1).inertia;
      outer += torque / body(i).inertia;
    }
  }

  /// Diagonal of M, kg m2 and kg; rotors are the masses of the joint rows.
  [[nodiscard]] Channels mass() const {
    Channels out;
    unroll<joints>([&](auto i) ESMC_INLINE {
      put(out, i, {body(i).rotor, body(i).inertia, Vec2<S>(body(i).mass, body(i).mass)});
    });
    return out;
  }

  /// J^-1 v of two bars [F8]: joint rates (rad/s) of a tip velocity (m/s). theta_2 enters by its own sine, so
  /// the relative accuracy holds down to the pole at type 1 (sin theta_2 = 0).
  [[nodiscard]] Joints tip_inverse(const Pose& p, const Vec2<S>& v) const
      requires(joints == 2 && !C::slides) {
    const S inner = dot(p.axis[1], v) / (body(0).length * p.turn[1].y());
    const S outer = -dot(p.axis[0], v) / (body(1).length * p.turn[1].y());
    return Joints(inner, outer - inner);
  }

  /// J^-T tau: tip force (N) of joint torques (N m). Pole at type 1.
  [[nodiscard]] Vec2<S> tip_force(const Pose& p, const Joints& tau) const
      requires(joints == 2 && !C::slides) {
    const S on_bar1 = tau[0] - tau[1];
    return p.axis[1] * (on_bar1 / (body(0).length * p.turn[1].y())) -
           p.axis[0] * (tau[1] / (body(1).length * p.turn[1].y()));
  }

 private:
  template <int N>
  static constexpr std::integral_constant<int, N> constant{};

  /// Dry friction of a joint at the rate v, 0 at rest (model.md section 12); 0 for a NaN, which the viscous
  /// term keeps.
  static S against(const Body<S>& b, S v) {
    if constexpr (BinaryFloat<S>) {
      return v > S(0) ? b.coulomb : v < S(0) ? -b.reverse : S(0);
    } else {
      return b.coulomb * S(v > S(0)) - b.reverse * S(v < S(0));
    }
  }

  /// The channels of one body.
  struct Row {
    S joint, angle;
    Vec2<S> centre;
  };
  static void put(Channels& out, int i, const Row& r) {
    out[row_joint(i)] = r.joint;
    out[row_angle(i)] = r.angle;
    out[row_x(i)] = r.centre.x();
    out[row_x(i) + 1] = r.centre.y();
  }

  C chain_{};
  S gravity_{};
};

/// Two revolute bars in series: the RR arm, and each leg of the 5R.
template <class S>
using Dyad = Serial<S, Link<Joint::revolute>, Link<Joint::revolute>>;

}  // namespace esmc
