#pragma once
/// The serial algorithm of the report, eqs. (1)-(7): a planar chain of any fixed number of bodies, each joined
/// to the one before by a revolute or a prismatic joint.
///
/// p = [p#; p°]: p# the joint rates, p° the bar angular rates and the mass-centre velocities of all bodies.
/// The matrices C, A, M of model.md [F1], [F2] are never formed: `rates` is p = C p#, `bias` is c = Cdot p#,
/// `transposed` is C^T w, each one pass along the chain.

#include <type_traits>

#include "firmware/numeric/elementary.hpp"
#include "firmware/types.hpp"

namespace esmc {

/// How a body moves on the one before it.
enum class Joint { revolute, prismatic };
/// Where the mass centre of a body may lie.
enum class Shape { bar, plate };  ///< bar: the mass centre lies on the axis; plate: anywhere

/// One body and the joint that carries it. A prismatic joint slides the body along its own axis.
template <Joint J, Shape B = Shape::bar>
struct Link {
  static constexpr Joint joint = J;
  static constexpr Shape shape = B;
};

/// Constants of one body, SI units, in the frame of the body: origin at its joint, x along its axis.
template <class S>
struct Body {
  S length{};            ///< from its joint to the next one (or to the tip), along the axis, m
  S centre{};            ///< mass centre along the axis, m
  S centre_across{};     ///< mass centre across the axis, m; ignored for Shape::bar
  S mass{};              ///< kg
  S inertia{};           ///< about the mass centre, kg m2
  S viscous{};           ///< of its joint, N m s/rad or N s/m
  S coulomb{};           ///< of its joint, N m or N
};

/// A planar chain of N bodies (1)-(7); see the top of the file.
template <class S, class... Links>
class Serial {
 public:
  using Scalar = S;
  static constexpr int joints = sizeof...(Links);
  /// Rows of p: joint rates, bar angular rates, mass-centre velocities (x, y per body), as in model.md [F3].
  static constexpr int channels = 4 * joints;
  using Joints = Vec<S, joints>;
  using Channels = Vec<S, channels>;

  static constexpr int row_joint(int i) { return i; }
  static constexpr int row_angle(int i) { return joints + i; }
  static constexpr int row_x(int i) { return 2 * joints + 2 * i; }
  /// Joint rows have none: see `force`.
  static constexpr bool has_mass(int row) { return row >= joints; }

  struct NoSlides {};
  /// Where the bodies are; like a vector, not initialised by itself. Unit vectors instead of angles: the model needs no angle, only its sine and cosine.
  struct Pose {
    List<Vec2<S>, joints> axis;  ///< along body i, in the frame of the subsystem
    List<Vec2<S>, joints> turn;  ///< (cos, sin) of joint i; kept apart because sin theta decides type 1
    [[no_unique_address]] std::conditional_t<((Links::joint == Joint::prismatic) || ...), Joints, NoSlides> slide;  ///< of each joint, m
  };

  Serial() = default;
  constexpr Serial(const List<Body<S>, joints>& bodies, S gravity) : bodies_(bodies), gravity_(gravity) {}

  [[nodiscard]] const Body<S>& body(int i) const { return bodies_[i]; }

  /// q: joint angles (rad) and displacements (m).
  [[nodiscard]] static Pose pose(const Joints& q) {
    Pose p;
    Sum<S> angle;
    Vec2<S> axis(S(1), S(0));
    unroll<joints>([&](auto i) ESMC_INLINE {
      if constexpr (joint(i) == Joint::revolute) {
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
      put_slide(p, i, q[i]);
      p.axis[i] = axis;
    });
    return p;
  }

  /// p = C p#: all velocities from the joint rates. Also the part C a of all accelerations.
  [[nodiscard]] Channels rates(const Pose& p, const Joints& qd) const {
    Channels out;
    RateWalk w;
    unroll<joints>([&](auto i) ESMC_INLINE { put(out, i, step(w, i, p, qd)); });
    return out;
  }

  /// Bilinear form of c = Cdot p#: c(a, a) is the acceleration that remains when the joints turn at constant
  /// rates a, and c(a, b) is Cdot(a) b (symmetric: in the plane every entry of p is the rate of a coordinate).
  [[nodiscard]] Channels bias(const Pose& p, const Joints& a, const Joints& b) const {
    Channels out;
    BiasWalk w;
    unroll<joints>([&](auto i) ESMC_INLINE { put(out, i, {S(0), S(0), step(w, i, p, a, b)}); });
    return out;
  }

  /// C^T w: what forces w, one per channel, do on the joints. The joint rows of w act on their own joint only.
  [[nodiscard, gnu::always_inline]] Joints transposed(const Pose& p, const Channels& w) const {
    Joints out;
    Sum<S> moment;       // of everything further out, about the joint of the body in hand
    Sum<Vec2<S>> force;  // of everything further out
    unroll<joints>([&](auto k) ESMC_INLINE {
      constexpr int i = joints - 1 - k;
      const Vec2<S> f(w[row_x(i)], w[row_x(i) + 1]);
      if constexpr (i + 1 < joints) moment.add(bodies_[i].length * cross(p.axis[i], force.value()));
      moment.add(w[row_angle(i)] + cross(arm(p, std::integral_constant<int, i>{}), f));
      force.add(f);
      if constexpr (joint(i) == Joint::revolute) {
        out[i] = w[i] + moment.value();
      } else {
        out[i] = w[i] + dot(p.axis[i], force.value());
        moment.add(slid(p, std::integral_constant<int, i>{}) * cross(p.axis[i], force.value()));
      }
    });
    return out;
  }

  /// Position of the tip in the frame of the subsystem, m.
  [[nodiscard]] Vec2<S> tip(const Pose& p) const {
    Sum<Vec2<S>> x;
    unroll<joints>([&](auto i) ESMC_INLINE { x.add(p.axis[i] * reach(p, i)); });
    return x.value();
  }

  [[nodiscard]] Vec2<S> tip_rate(const Pose& p, const Joints& qd) const {
    Sum<Vec2<S>> v;
    Sum<S> spin;
    unroll<joints>([&](auto i) ESMC_INLINE {
      if constexpr (joint(i) == Joint::revolute) {
        spin.add(qd[i]);
      } else {
        v.add(p.axis[i] * qd[i]);
      }
      if (!spin.empty()) v.add(perp(p.axis[i]) * (spin.value() * reach(p, i)));
    });
    return v.value();
  }

  /// Bilinear form of Jdot qd of the tip, m/s2; see `bias`.
  [[nodiscard]] Vec2<S> tip_bias(const Pose& p, const Joints& a, const Joints& b) const {
    Sum<Vec2<S>> acc;
    Sum<S> spin_a, spin_b;
    unroll<joints>([&](auto i) ESMC_INLINE {
      if constexpr (joint(i) == Joint::revolute) {
        spin_a.add(a[i]);
        spin_b.add(b[i]);
      } else if (!spin_a.empty()) {
        acc.add(perp(p.axis[i]) * (spin_a.value() * b[i] + spin_b.value() * a[i]));
      }
      if (!spin_a.empty()) acc.subtract(p.axis[i] * (spin_a.value() * spin_b.value() * reach(p, i)));
    });
    return acc.empty() ? Vec2<S>(Vec2<S>::Zero()) : acc.value();
  }

  /// Mass centre of body i in the frame of the subsystem, m.
  [[nodiscard]] List<Vec2<S>, joints> centres(const Pose& p) const {
    List<Vec2<S>, joints> out;
    CentreWalk w;
    unroll<joints>([&](auto i) ESMC_INLINE { out[i] = step(w, i, p); });
    return out;
  }

  /// q_d - q channel by channel. Angles come from the unit vectors, so they are in (-pi, pi] by construction
  /// (model.md section 9: wrap consistently); the joint entries have no mass and serve display only.
  [[nodiscard]] Channels error(const Pose& desired, const Pose& actual) const {
    Channels out;
    ErrorWalk w;
    unroll<joints>([&](auto i) ESMC_INLINE { put(out, i, step(w, i, desired, actual)); });
    return out;
  }

  /// Where all joints turn, what is said of a joint is the difference of what is said of its bodies: `follow_bars`.
  static constexpr bool joints_follow = ((Links::joint == Joint::revolute) && ...);
  /// The joint rows of something linear in errors and rates, sliding variables say, from the rows of the bars (model.md
  /// section 10: s_theta2 = s_phi2 - s_phi1). Not wrapped.
  template <int N>
  static void follow_bars(Vec<S, N>& s, int first = 0)
    requires joints_follow
  {
    unroll<joints>([&](auto i) ESMC_INLINE {
      const S of_bar = s[first + row_angle(i)];
      s[first + row_joint(i)] = i == 0 ? of_bar : S(of_bar - s[first + row_angle(i) - 1]);
    });
  }

  /// Calls f(row, e, e', q''_d) for every channel, or for all but the joints': what `error`, the difference of two `rates`,
  /// and `rates` + `bias` of the desired motion say of it, body by body, so that no vector of channels is stored on the way.
  template <bool with_joints = true, class F>
  ESMC_INLINE void compare(const Pose& desired, const Joints& desired_rate, const Joints& desired_acceleration, const Pose& actual,
               const Joints& rate, F&& f) const {
    ErrorWalk error;
    RateWalk fast, slow, push;
    BiasWalk drift;
    unroll<joints>([&](auto i) ESMC_INLINE {
      const Row e = step(error, i, desired, actual);
      const Row vd = step(fast, i, desired, desired_rate), v = step(slow, i, actual, rate);
      const Row a = step(push, i, desired, desired_acceleration);
      const Vec2<S> c = step(drift, i, desired, desired_rate, desired_rate);
      if constexpr (with_joints) f(std::integral_constant<int, row_joint(i)>{}, e.joint, S(vd.joint - v.joint), a.joint);
      f(std::integral_constant<int, row_angle(i)>{}, e.angle, S(vd.angle - v.angle), a.angle);
      f(std::integral_constant<int, row_x(i)>{}, e.centre.x(), S(vd.centre.x() - v.centre.x()), S(a.centre.x() + c.x()));
      f(std::integral_constant<int, row_x(i) + 1>{}, e.centre.y(), S(vd.centre.y() - v.centre.y()), S(a.centre.y() + c.y()));
    });
  }

  /// Calls f(row, rate, acceleration) for every channel, or for all but the joints': what `rates` says of `speed`, and what
  /// `rates` of `acceleration` and `bias(a, b)` say together; body by body, as `compare` does.
  template <bool with_joints = true, class F>
  ESMC_INLINE void resolve(const Pose& p, const Joints& speed, const Joints& acceleration, const Joints& a, const Joints& b,
                           F&& f) const {
    RateWalk fast, push;
    BiasWalk drift;
    unroll<joints>([&](auto i) ESMC_INLINE {
      const Row v = step(fast, i, p, speed), r = step(push, i, p, acceleration);
      const Vec2<S> c = step(drift, i, p, a, b);
      if constexpr (with_joints) f(std::integral_constant<int, row_joint(i)>{}, v.joint, r.joint);
      f(std::integral_constant<int, row_angle(i)>{}, v.angle, r.angle);
      f(std::integral_constant<int, row_x(i)>{}, v.centre.x(), S(r.centre.x() + c.x()));
      f(std::integral_constant<int, row_x(i) + 1>{}, v.centre.y(), S(r.centre.y() + c.y()));
    });
  }

  /// M v' + f + g with M, f, g of [F2]: the forces to be carried by C^T. The joint rows hold friction alone,
  /// because M is zero there: whatever v' says about them never reaches the joints (model.md section 9).
  [[nodiscard, gnu::always_inline]] Channels force(const Channels& v, const Joints& qd) const {
    Channels out;
    unroll<joints>([&](auto i) ESMC_INLINE {
      const Body<S>& b = bodies_[i];
      put(out, i, {b.viscous * qd[i] + against(b.coulomb, qd[i]), b.inertia * v[row_angle(i)],
                   Vec2<S>(b.mass * v[row_x(i)], b.mass * (v[row_x(i) + 1] + gravity_))});
    });
    return out;
  }

  /// Diagonal of M.
  [[nodiscard]] Channels mass() const {
    Channels out;
    unroll<joints>(
        [&](auto i) ESMC_INLINE { put(out, i, {S(0), bodies_[i].inertia, Vec2<S>(bodies_[i].mass, bodies_[i].mass)}); });
    return out;
  }

  /// A 2R chain inverts its tip velocity in closed form; theta_2 enters by its own sine, so the result keeps
  /// its relative accuracy down to type 1 (sin theta_2 = 0), where it does not exist.
  [[nodiscard]] Joints tip_inverse(const Pose& p, const Vec2<S>& v) const
    requires(joints == 2 && ((Links::joint == Joint::revolute) && ...))
  {
    const S inner = dot(p.axis[1], v) / (bodies_[0].length * p.turn[1].y());
    const S outer = -dot(p.axis[0], v) / (bodies_[1].length * p.turn[1].y());
    return Joints(inner, outer - inner);
  }

  /// Transpose of tip_inverse: the tip force that balances joint torques tau. Pole at type 1.
  [[nodiscard]] Vec2<S> tip_force(const Pose& p, const Joints& tau) const
    requires(joints == 2 && ((Links::joint == Joint::revolute) && ...))
  {
    const S on_bar1 = tau[0] - tau[1];
    return p.axis[1] * (on_bar1 / (bodies_[0].length * p.turn[1].y())) -
           p.axis[0] * (tau[1] / (bodies_[1].length * p.turn[1].y()));
  }

 private:
  static constexpr List<Joint, joints> kinds_{{Links::joint...}};
  static constexpr List<Shape, joints> shapes_{{Links::shape...}};
  static constexpr bool slides = ((Links::joint == Joint::prismatic) || ...);
  static constexpr Joint joint(int i) { return kinds_[i]; }

  /// coulomb * sign(v), with sign(0) = 0 (model.md section 12). v of a NaN counts as 0: the viscous term has it.
  static S against(S coulomb, S v) {
    if constexpr (BinaryFloat<S>) {
      return v > S(0) ? coulomb : v < S(0) ? -coulomb : S(0);
    } else {
      return coulomb * (S(v > S(0)) - S(v < S(0)));
    }
  }

  /// Displacement of joint i, m: a chain without a prismatic joint stores none.
  template <int I>
  [[nodiscard]] static S slid(const Pose& p, std::integral_constant<int, I>) {
    if constexpr (slides) {
      return p.slide[I];
    } else {
      return S(0);
    }
  }
  template <int I>
  static void put_slide(Pose& p, std::integral_constant<int, I>, S q) {
    if constexpr (slides) p.slide[I] = joint(I) == Joint::prismatic ? q : S(0);
  }
  /// From the joint of body i to its end, m.
  template <int I>
  [[nodiscard]] S reach(const Pose& p, std::integral_constant<int, I>) const {
    if constexpr (joint(I) == Joint::revolute) {
      return bodies_[I].length;
    } else {
      return bodies_[I].length + slid(p, std::integral_constant<int, I>{});
    }
  }
  /// From the joint of body i to its mass centre.
  template <int I>
  [[nodiscard]] Vec2<S> arm(const Pose& p, std::integral_constant<int, I>) const {
    if constexpr (shapes_[I] == Shape::bar) {
      return p.axis[I] * bodies_[I].centre;
    } else {
      return p.axis[I] * bodies_[I].centre + perp(p.axis[I]) * bodies_[I].centre_across;
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

  // What is carried along a chain, from its base outwards: step() gives the rows of body I and goes on to its end.
  // `at_end` is of the end of the body before.
  struct RateWalk {
    Sum<S> spin;
    Sum<Vec2<S>> at_end;
  };
  template <int I>
  [[nodiscard, gnu::always_inline]] Row step(RateWalk& w, std::integral_constant<int, I> i, const Pose& p, const Joints& qd) const {
    if constexpr (joint(I) == Joint::revolute) {
      w.spin.add(qd[I]);
    } else {
      w.at_end.add(p.axis[I] * qd[I]);
      if (!w.spin.empty()) w.at_end.add(perp(p.axis[I]) * (w.spin.value() * slid(p, i)));
    }
    Row out;  // one name for all returns, or it would be copied
    out.joint = qd[I];
    if (w.spin.empty()) {
      out.angle = S(0);
      out.centre = w.at_end.value();
      return out;
    }
    out.angle = w.spin.value();
    out.centre = w.at_end.plus(perp(arm(p, i)) * w.spin.value());
    if constexpr (I + 1 < joints) w.at_end.add(perp(p.axis[I]) * (w.spin.value() * bodies_[I].length));
    return out;
  }

  struct BiasWalk {
    Sum<S> spin_a, spin_b;
    Sum<Vec2<S>> at_end;
  };
  /// Of the mass centre; joints and bars have none.
  template <int I>
  [[nodiscard, gnu::always_inline]] Vec2<S> step(BiasWalk& w, std::integral_constant<int, I> i, const Pose& p, const Joints& a,
                             const Joints& b) const {
    if constexpr (joint(I) == Joint::revolute) {
      w.spin_a.add(a[I]);
      w.spin_b.add(b[I]);
    } else if (!w.spin_a.empty()) {
      w.at_end.add(perp(p.axis[I]) * (w.spin_a.value() * b[I] + w.spin_b.value() * a[I]));
      w.at_end.subtract(p.axis[I] * (w.spin_a.value() * w.spin_b.value() * slid(p, i)));
    }
    Vec2<S> out;
    if (w.spin_a.empty()) {
      out.setZero();
      return out;
    }
    const S square = w.spin_a.value() * w.spin_b.value();
    out = w.at_end.minus(arm(p, i) * square);
    if constexpr (I + 1 < joints) w.at_end.subtract(p.axis[I] * (square * bodies_[I].length));
    return out;
  }

  struct CentreWalk {
    Sum<Vec2<S>> at_end;
  };
  template <int I>
  [[nodiscard, gnu::always_inline]] Vec2<S> step(CentreWalk& w, std::integral_constant<int, I> i, const Pose& p) const {
    if constexpr (joint(I) == Joint::prismatic) w.at_end.add(p.axis[I] * slid(p, i));
    const Vec2<S> out = w.at_end.plus(arm(p, i));
    if constexpr (I + 1 < joints) w.at_end.add(p.axis[I] * bodies_[I].length);
    return out;
  }

  struct ErrorWalk {
    Sum<S> turned;
    CentreWalk desired, actual;
  };
  template <int I>
  [[nodiscard, gnu::always_inline]] Row step(ErrorWalk& w, std::integral_constant<int, I> i, const Pose& desired, const Pose& actual) const {
    const S turned = angle_of_unit(cross(actual.axis[I], desired.axis[I]), dot(actual.axis[I], desired.axis[I]));
    S of_joint;
    if constexpr (joint(I) == Joint::revolute) {
      of_joint = w.turned.empty() ? turned : wrap_to_pi(S(turned - w.turned.value()));
    } else {
      of_joint = slid(desired, i) - slid(actual, i);
    }
    w.turned = {};
    w.turned.add(turned);
    return {of_joint, turned, Vec2<S>(step(w.desired, i, desired) - step(w.actual, i, actual))};
  }

  List<Body<S>, joints> bodies_{};
  S gravity_{};
};

/// Two revolute bars in series: the RR arm, and each leg of the 5R.
template <class S>
using Dyad = Serial<S, Link<Joint::revolute>, Link<Joint::revolute>>;

}  // namespace esmc
