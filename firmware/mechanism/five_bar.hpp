#pragma once
/// The 5R five-bar: a point mass held by an RR leg and a mirrored RR leg (model.md section 4), its kinematics
/// in all working and assembly modes (section 5), and the base-joint form that is regular at type 1
/// ([F23]-[F25]).

#include <cstdint>
#include <optional>

#include "firmware/mechanism/coupling.hpp"
#include "firmware/mechanism/params.hpp"

namespace esmc {

/// The leg or arm that `p` describes, not checked (see check()); gravity along -y, m/s2.
template <class S>
[[nodiscard]] Dyad<S> make_dyad(const LegParams<S>& p, S gravity) {
  return Dyad<S>(
      {{Body<S>{p.l1, p.lg1, S(0), p.m1, p.J1, p.d1, p.gamma1 + p.asymmetry1, p.gamma1 - p.asymmetry1},
        Body<S>{p.l2, p.lg2, S(0), p.m2, p.J2, p.d2, p.gamma2 + p.asymmetry2, p.gamma2 - p.asymmetry2,
                p.rotor2}}},
      gravity);
}

/// Inverse kinematics of a dyad [F17] into `p`: tip in m, in the frame of the leg; sign sin theta_2 is
/// `working_mode` (+1 or -1). False, `p` unchanged: the tip is out of reach, at the base or NaN.
template <class S>
[[nodiscard]] bool dyad_inverse(const Dyad<S>& dyad, const Vec2<S>& tip, int working_mode,
                                typename Dyad<S>::Pose& p) {
  const S l1 = dyad.body(0).length, l2 = dyad.body(1).length;
  const S r2 = dot(tip, tip);
  const S stretched = (l1 + l2) * (l1 + l2) - r2, folded = r2 - (l1 - l2) * (l1 - l2);
  if (!(stretched >= S(0) && folded >= S(0) && r2 > S(0))) return false;
  const S scale = S(1) / (stretched + folded);  // = 1 / (4 l1 l2): cos^2 + sin^2 = 1 by construction
  const S c2 = (folded - stretched) * scale;
  const S s2 = S(working_mode) * S(2) * square_root(stretched * folded) * scale;
  const Vec2<S> z(l1 + l2 * c2, l2 * s2);  // the tip in a frame that turns with bar 1
  p.axis[0] = Vec2<S>(dot(z, tip), cross(z, tip)) * (S(1) / r2);
  p.axis[1] = Vec2<S>(p.axis[0].x() * c2 - p.axis[0].y() * s2, p.axis[0].y() * c2 + p.axis[0].x() * s2);
  p.turn[0] = p.axis[0];
  p.turn[1] = Vec2<S>(c2, s2);
  return true;
}

/// Angles of two directions, which need not be unit vectors, rad, each in [-pi, pi].
template <class S>
[[nodiscard]] Vec2<S> angles_of(const List<Vec2<S>, 2>& direction) {
  Vec2<S> out;
  for (int i = 0; i < 2; ++i)
    out[i] = arc_tangent2(direction[i].y(), direction[i].x());  // a loop: one copy of the code in an image
  return out;
}

/// The 5R five-bar; see the top of the file. Lengths in m, angles in rad, torques in N m.
template <class S>
class FiveBar : public Coupling<S, PointMass<S>, Dyad<S>, 2> {
 public:
  using Base = Coupling<S, PointMass<S>, Dyad<S>, 2>;
  using typename Base::Channels;
  using typename Base::Rates;
  using Params = FiveBarParams<S>;
  using Leg = Dyad<S>;
  static constexpr bool has_type2 = true;

  /// Which of the solutions of inverse and forward kinematics the mechanism is in (model.md section 5).
  struct Mode {
    List<int, 2> working{};  ///< sign of sin theta_j2 per leg, +1 or -1
    int assembly = 0;        ///< sign of D2, +1 or -1
  };

  /// Configuration: effector, legs, and D2.
  struct Pose : Base::LegPoses {
    S sin_type2;  ///< D2 = sin(phi12 + phi22): 0 at type 2, its sign is the assembly mode [F18]
  };

  FiveBar() = default;
  /// Nothing in p is checked: see check().
  explicit FiveBar(const Params& p)
      : Base({p.m0, p.g}, {{make_dyad(p.legs[0], p.g), make_dyad(p.legs[1], p.g)}},
             {{LegFrame<S>{Vec2<S>(p.l0, S(0)), S(1)}, LegFrame<S>{Vec2<S>(-p.l0, S(0)), S(-1)}}}) {}

  /// Pose from all four joint angles (theta11, theta12, theta21, theta22), rad; NaN beyond the range of
  /// sin_cos. The effector is the mean of the two leg tips, whose difference is `closure_residual`.
  [[nodiscard]] Pose pose(const Vec<S, 4>& theta) const {
    Pose p;
    for (int j = 0; j < 2; ++j) p.leg[j] = Leg::pose(theta.template segment<2>(2 * j));
    p.effector = (tip_in_base(p, 0) + tip_in_base(p, 1)) * S(0.5);
    p.sin_type2 = sin_type2(p);
    return p;
  }

  /// Tip of leg 1 minus tip of leg 2, in N, m: zero when the mechanism is closed.
  [[nodiscard]] Vec2<S> closure_residual(const Pose& p) const {
    return tip_in_base(p, 0) - tip_in_base(p, 1);
  }

  /// Inverse kinematics [F17] of the effector (m, in N); mode.assembly is ignored. Empty: out of reach, NaN.
  [[nodiscard]] std::optional<Pose> inverse(const Vec2<S>& effector, const Mode& mode) const {
    Pose p;
    return inverse(effector, mode, p) ? std::optional<Pose>(p) : std::nullopt;
  }
  /// Inverse kinematics [F17] into `p`: effector in m, in N. False: out of reach or NaN, `p` is undefined.
  [[nodiscard]] bool inverse(const Vec2<S>& effector, const Mode& mode, Pose& p) const {
    for (int j = 0; j < 2; ++j) {
      if (!dyad_inverse(this->leg(j), this->frame(j).point_to_leg(effector), mode.working[j], p.leg[j]))
        return false;
    }
    p.effector = effector;
    p.sin_type2 = sin_type2(p);
    return true;
  }

  /// Forward kinematics [F18] from the base joints (rad) in the assembly mode sign D2 (+1 or -1). Empty: the
  /// legs cannot be closed, because the elbows are too far apart, too close, or on one another; or NaN.
  [[nodiscard]] std::optional<Pose> forward(const Vec2<S>& base_angles, int assembly_mode) const {
    Pose p;
    return forward(base_angles, assembly_mode, p) ? std::optional<Pose>(p) : std::nullopt;
  }
  /// Forward kinematics [F18] into `p`: base joints in rad, sign D2. False: not closed or NaN, `p` undefined.
  [[nodiscard]] bool forward(const Vec2<S>& base_angles, int assembly_mode, Pose& p) const {
    List<Vec2<S>, 2> elbow;
    const auto t = sin_cos(std::array<S, 2>{base_angles[0], base_angles[1]});
    unroll<2>([&](auto j) ESMC_INLINE {
      p.leg[j].axis[0] = p.leg[j].turn[0] = Vec2<S>(t.cos[j], t.sin[j]);
      elbow[j] = this->frame(j).point_from_leg(p.leg[j].axis[0] * l1(j));
    });
    const S l12 = l2(0), l22 = l2(1);
    const Vec2<S> w = elbow[0] - elbow[1];
    const S d2 = dot(w, w);
    const S sum = d2 + l22 * l22 - l12 * l12;  // 2 d a of [F18]
    const S square = S(4) * d2 * l22 * l22 - sum * sum;
    if (!(d2 > S(0) && square >= S(0))) return false;
    const S half_inverse = S(0.5) / d2;
    const S along = sum * half_inverse, across = S(assembly_mode) * square_root(square) * half_inverse;
    const Vec2<S> from_elbow2 = w * along - perp(w) * across;
    p.effector = elbow[1] + from_elbow2;
    p.leg[0].axis[1] = this->frame(0).to_leg(from_elbow2 - w) * (S(1) / l12);
    p.leg[1].axis[1] = this->frame(1).to_leg(from_elbow2) * (S(1) / l22);
    unroll<2>([&](auto j) ESMC_INLINE {
      p.leg[j].turn[1] =
          Vec2<S>(dot(p.leg[j].axis[0], p.leg[j].axis[1]), cross(p.leg[j].axis[0], p.leg[j].axis[1]));
    });
    p.sin_type2 = across * d2 / (l12 * l22);
    return true;
  }

  /// (theta11, theta12, theta21, theta22) of a pose, rad, each in [-pi, pi].
  [[nodiscard]] static Vec<S, 4> angles(const Pose& p) {
    Vec<S, 4> out;
    out << angles_of(p.leg[0].turn), angles_of(p.leg[1].turn);
    return out;
  }

  /// Sets `out` to (cos, sin) of theta11 and of theta21.
  static void base_directions(const Pose& p, List<Vec2<S>, 2>& out) {
    unroll<2>([&](auto j) ESMC_INLINE { out[j] = p.leg[j].turn[0]; });
  }
  /// (theta11, theta21) of a pose, rad, each in [-pi, pi].
  [[nodiscard]] static Vec2<S> base_angles(const Pose& p) {
    List<Vec2<S>, 2> direction;
    base_directions(p, direction);
    return angles_of(direction);
  }

  /// sin theta_j2: 0 at a type-1 (serial) singularity.
  [[nodiscard]] static S sin_type1(const Pose& p, int leg) { return p.leg[leg].turn[1].y(); }
  /// Smallest |sin theta_j2| of the legs.
  [[nodiscard]] static S min_abs_sin_type1(const Pose& p) {
    const S a = absolute(sin_type1(p, 0)), b = absolute(sin_type1(p, 1));
    if constexpr (requires { choose(a < b, a, b); }) {
      return choose(a < b, a, b);
    } else {
      return a < b ? a : b;
    }
  }

  [[nodiscard]] static S abs_sin_type2(const Pose& p) { return absolute(p.sin_type2); }  ///< |D2|
  /// D2 times its sign in the assembly mode `mode`: negative in the other assembly mode.
  [[nodiscard]] static S sin_type2_in_mode(const Pose& p, const Mode& mode) {
    return p.sin_type2 * S(mode.assembly);
  }
  /// True if both legs bend as `mode` says; false at type 1 and for a NaN.
  [[nodiscard]] static auto in_working_mode(const Pose& p, const Mode& mode) {
    return sin_type1(p, 0) * S(mode.working[0]) > S(0) && sin_type1(p, 1) * S(mode.working[1]) > S(0);
  }

  // ---- what a control law needs: the same names for every mechanism ----

  /// Whether the channel is an angle (rad) and not a length (m).
  static constexpr bool is_angle(int row) { return row >= 2 && (row - 2) % Leg::channels < 2 * Leg::joints; }
  [[nodiscard]] static Vec2<S> independent(const Rates& r) { return r.platform; }           ///< (x', y'), m/s
  [[nodiscard]] static Vec2<S> base(const Rates& r) { return {r.leg[0][0], r.leg[1][0]}; }  ///< base joints
  /// x_d - x of the effector, m.
  [[nodiscard]] static Vec2<S> independent_error(const Pose& desired, const Pose& actual) {
    return PointMass<S>::error(desired, actual);
  }
  /// theta_d - theta of the base joints, rad, in [-pi, pi].
  [[nodiscard]] static Vec2<S> base_error(const Pose& desired, const Pose& actual) {
    Vec2<S> out;
    for (int j = 0; j < 2; ++j) {
      const Vec2<S>& a = actual.leg[j].axis[0];
      const Vec2<S>& d = desired.leg[j].axis[0];
      out[j] = angle_of_unit(cross(a, d), dot(a, d));
    }
    return out;
  }

  [[nodiscard]] static Vec2<S> tip_rate(const Pose&, const Rates& r) { return r.platform; }  ///< in N, m/s
  /// Rates of effector and joints (rad/s) at the effector's velocity v (m/s). Not finite at type 1.
  [[nodiscard]] Rates rates_of_effector(const Pose& p, const Vec2<S>& v) const {
    return this->chain_rates(p, v);
  }
  /// Accelerations of effector and joints at the effector's acceleration a (m/s2). Not finite at type 1.
  [[nodiscard]] Rates accelerations_of_effector(const Pose& p, const Rates& r, const Vec2<S>& a) const {
    return this->chain_accelerations(p, r, a);
  }

  // ---- base-joint form: theta11, theta21 independent. Regular at type 1, pole at type 2 ----

  /// Rates of effector and joints by those of the base joints, rad/s [F23]. Not finite at type 2.
  [[nodiscard]] Rates base_rates(const Pose& p, const Vec2<S>& base) const {
    Vec2<S> closure;
    unroll<2>([&](auto j) ESMC_INLINE { closure[j] = l1(j) * p.leg[j].turn[1].y() * base[j]; });
    return complete(p, base, closure, Vec2<S>::Zero());
  }

  /// Accelerations of effector and joints by those of the base joints (rad/s2), at rates r [F24].
  [[nodiscard]] Rates base_accelerations(const Pose& p, const Rates& r, const Vec2<S>& base) const {
    Vec2<S> closure, inner;
    unroll<2>([&](auto j) ESMC_INLINE {
      const S w1 = r.leg[j][0], w2 = r.leg[j][0] + r.leg[j][1];
      closure[j] =
          l1(j) * (p.leg[j].turn[1].y() * base[j] - p.leg[j].turn[1].x() * w1 * w1) - l2(j) * w2 * w2;
      inner[j] = l1(j) * p.leg[j].turn[1].y() * w1 * w1;
    });
    return complete(p, base, closure, inner);
  }

  /// F_a = C_a^T w [F25], N m: forces on all channels gathered on the base joints. The motor torque where
  /// only the base joints have motors.
  [[nodiscard, gnu::always_inline]] Vec2<S> base_torque(const Pose& p, const Channels& w) const {
    return gather_on_base(p, w.template head<2>(), this->leg_torques(p, w));
  }

  /// C^_a^T [w0; tau] [F25], N m: effector force w0 (N, in frame N) and torques tau[leg] of base and passive
  /// joint (N m), gathered on the base joints. Not finite at type 2.
  [[nodiscard, gnu::always_inline]] Vec2<S> gather_on_base(const Pose& p, const Vec2<S>& w0,
                                                           const List<Vec2<S>, 2>& tau) const {
    Vec2<S> f = w0;  // force on the effector, the moments of the distal bars included
    unroll<2>([&](auto j) ESMC_INLINE {
      f += this->frame(j).from_leg(perp(p.leg[j].axis[1])) * (tau[j][1] / l2(j));
    });
    const Vec2<S> pushed = solve_closure_transposed(p, f);
    Vec2<S> out;
    unroll<2>([&](auto j) ESMC_INLINE {
      out[j] = tau[j][0] - tau[j][1] * (S(1) + l1(j) * p.leg[j].turn[1].x() / l2(j)) +
               l1(j) * p.leg[j].turn[1].y() * pushed[j];
    });
    return out;
  }

 private:
  /// Bar lengths of leg j, m.
  [[nodiscard]] S l1(int j) const { return this->leg(j).body(0).length; }
  [[nodiscard]] S l2(int j) const { return this->leg(j).body(1).length; }
  static S sin_type2(const Pose& p) {
    const Vec2<S>&u1 = p.leg[0].axis[1], &u2 = p.leg[1].axis[1];
    return u1.y() * u2.x() + u1.x() * u2.y();
  }
  static S absolute(S v) {
    if constexpr (BinaryFloat<S>) {
      return std::fabs(v);
    } else if constexpr (requires { magnitude(v); }) {
      return magnitude(v);
    } else {
      return v < S(0) ? -v : v;
    }
  }
  [[nodiscard]] Vec2<S> tip_in_base(const Pose& p, int j) const {
    return this->frame(j).point_from_leg(this->leg(j).tip(p.leg[j]));
  }

  /// Rows of U [F23] in N: the distal bars' directions.
  [[nodiscard]] Vec2<S> distal(const Pose& p, int j) const {
    return this->frame(j).from_leg(p.leg[j].axis[1]);
  }
  /// U^-1 r; det U = D2.
  [[nodiscard]] Vec2<S> solve_closure(const Pose& p, const Vec2<S>& r) const {
    const Vec2<S> u1 = distal(p, 0), u2 = distal(p, 1);
    const S inverse = S(1) / p.sin_type2;
    return Vec2<S>(u2.y() * r[0] - u1.y() * r[1], u1.x() * r[1] - u2.x() * r[0]) * inverse;
  }
  /// U^-T f.
  [[nodiscard]] Vec2<S> solve_closure_transposed(const Pose& p, const Vec2<S>& f) const {
    const Vec2<S> u1 = distal(p, 0), u2 = distal(p, 1);
    const S inverse = S(1) / p.sin_type2;
    return Vec2<S>(cross(f, u2), cross(u1, f)) * inverse;
  }
  /// Rates or accelerations of all joints from U times those of the effector ([F23], [F24]); `inner`: what
  /// the proximal bar's own rotation takes off the distal one.
  [[nodiscard]] Rates complete(const Pose& p, const Vec2<S>& base, const Vec2<S>& closure,
                               const Vec2<S>& inner) const {
    Rates out;
    out.platform = solve_closure(p, closure);
    unroll<2>([&](auto j) ESMC_INLINE {
      const S across = dot(perp(p.leg[j].axis[1]), this->frame(j).to_leg(out.platform));
      const S outer = (across - l1(j) * p.leg[j].turn[1].x() * base[j] - inner[j]) / l2(j);
      out.leg[j] = Vec2<S>(base[j], outer - base[j]);
    });
    return out;
  }
};

}  // namespace esmc
