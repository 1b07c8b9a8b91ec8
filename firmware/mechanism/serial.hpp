#pragma once
/// The serial algorithm of the report, eqs. (1)-(7): a planar chain of any fixed number of bodies, each joined
/// to the one before by a revolute or a prismatic joint.
///
/// p = [p#; p°]: p# the joint rates, p° the bar angular rates and the mass-centre velocities of all bodies.
/// The matrices C, A, M of model.md [F1], [F2] are never formed: `rates` is p = C p#, `bias` is c = Cdot p#,
/// `transposed` is C^T w, each one pass along the chain.

#include "firmware/numeric/elementary.hpp"
#include "firmware/types.hpp"

namespace esmc {

enum class Joint { revolute, prismatic };
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

  /// Where the bodies are. Unit vectors instead of angles: the model needs no angle, only its sine and cosine.
  struct Pose {
    List<Vec2<S>, joints> axis{};  ///< along body i, in the frame of the subsystem
    List<Vec2<S>, joints> turn{};  ///< (cos, sin) of joint i; kept apart because sin theta decides type 1
    Joints slide = Joints::Zero();       ///< displacement of joint i, m; 0 for a revolute joint
  };

  Serial() = default;
  constexpr Serial(const List<Body<S>, joints>& bodies, S gravity) : bodies_(bodies), gravity_(gravity) {}

  [[nodiscard]] const Body<S>& body(int i) const { return bodies_[i]; }

  /// q: joint angles (rad) and displacements (m).
  [[nodiscard]] static Pose pose(const Joints& q) {
    Pose p;
    S angle(0);
    Vec2<S> axis(S(1), S(0));
    unroll<joints>([&](auto i) {
      if constexpr (joint(i) == Joint::revolute) {
        // The sum is rounded once and loses less than turning the unit vector by theta_i would: near type 2
        // every 1e-16 here is 1e-16 / D2 in a torque.
        angle += q[i];
        const SinCos<S> t = sin_cos(q[i]), a = sin_cos(angle);
        p.turn[i] = Vec2<S>(t.cos, t.sin);
        axis = Vec2<S>(a.cos, a.sin);
      } else {
        p.turn[i] = Vec2<S>(S(1), S(0));
        p.slide[i] = q[i];
      }
      p.axis[i] = axis;
    });
    return p;
  }

  /// p = C p#: all velocities from the joint rates. Also the part C a of all accelerations.
  [[nodiscard]] Channels rates(const Pose& p, const Joints& qd) const {
    Channels out;
    S spin(0);
    Vec2<S> v = Vec2<S>::Zero();
    unroll<joints>([&](auto i) {
      if constexpr (joint(i) == Joint::revolute) {
        spin += qd[i];
      } else {
        v += p.axis[i] * qd[i] + perp(p.axis[i]) * (spin * p.slide[i]);
      }
      put(out, i, qd[i], spin, v + perp(arm(p, i)) * spin);
      if constexpr (i + 1 < joints) v += perp(p.axis[i]) * (spin * bodies_[i].length);
    });
    return out;
  }

  /// Bilinear form of c = Cdot p#: c(a, a) is the acceleration that remains when the joints turn at constant
  /// rates a, and c(a, b) is Cdot(a) b (symmetric: in the plane every entry of p is the rate of a coordinate).
  [[nodiscard]] Channels bias(const Pose& p, const Joints& a, const Joints& b) const {
    Channels out;
    S spin_a(0), spin_b(0);
    Vec2<S> acc = Vec2<S>::Zero();
    unroll<joints>([&](auto i) {
      if constexpr (joint(i) == Joint::revolute) {
        spin_a += a[i];
        spin_b += b[i];
      } else {
        acc += perp(p.axis[i]) * (spin_a * b[i] + spin_b * a[i]) - p.axis[i] * (spin_a * spin_b * p.slide[i]);
      }
      const S square = spin_a * spin_b;
      put(out, i, S(0), S(0), acc - arm(p, i) * square);
      if constexpr (i + 1 < joints) acc -= p.axis[i] * (square * bodies_[i].length);
    });
    return out;
  }

  /// C^T w: what forces w, one per channel, do on the joints. The joint rows of w act on their own joint only.
  [[nodiscard]] Joints transposed(const Pose& p, const Channels& w) const {
    Joints out;
    S moment(0);                       // of everything further out, about the joint of the body in hand
    Vec2<S> force = Vec2<S>::Zero();   // of everything further out
    unroll<joints>([&](auto k) {
      constexpr int i = joints - 1 - k;
      const Vec2<S> f(w[row_x(i)], w[row_x(i) + 1]);
      if constexpr (i + 1 < joints) moment += bodies_[i].length * cross(p.axis[i], force);
      moment += w[row_angle(i)] + cross(arm(p, std::integral_constant<int, i>{}), f);
      force += f;
      if constexpr (joint(i) == Joint::revolute) {
        out[i] = w[i] + moment;
      } else {
        out[i] = w[i] + dot(p.axis[i], force);
        moment += p.slide[i] * cross(p.axis[i], force);
      }
    });
    return out;
  }

  /// Position of the tip in the frame of the subsystem, m.
  [[nodiscard]] Vec2<S> tip(const Pose& p) const {
    Vec2<S> x = Vec2<S>::Zero();
    unroll<joints>([&](auto i) { x += p.axis[i] * (bodies_[i].length + p.slide[i]); });
    return x;
  }

  [[nodiscard]] Vec2<S> tip_rate(const Pose& p, const Joints& qd) const {
    Vec2<S> v = Vec2<S>::Zero();
    S spin(0);
    unroll<joints>([&](auto i) {
      if constexpr (joint(i) == Joint::revolute) {
        spin += qd[i];
      } else {
        v += p.axis[i] * qd[i];
      }
      v += perp(p.axis[i]) * (spin * (bodies_[i].length + p.slide[i]));
    });
    return v;
  }

  /// Bilinear form of Jdot qd of the tip, m/s2; see `bias`.
  [[nodiscard]] Vec2<S> tip_bias(const Pose& p, const Joints& a, const Joints& b) const {
    Vec2<S> acc = Vec2<S>::Zero();
    S spin_a(0), spin_b(0);
    unroll<joints>([&](auto i) {
      if constexpr (joint(i) == Joint::revolute) {
        spin_a += a[i];
        spin_b += b[i];
      } else {
        acc += perp(p.axis[i]) * (spin_a * b[i] + spin_b * a[i]);
      }
      acc -= p.axis[i] * (spin_a * spin_b * (bodies_[i].length + p.slide[i]));
    });
    return acc;
  }

  /// Mass centre of body i in the frame of the subsystem, m.
  [[nodiscard]] List<Vec2<S>, joints> centres(const Pose& p) const {
    List<Vec2<S>, joints> out;
    Vec2<S> origin = Vec2<S>::Zero();
    unroll<joints>([&](auto i) {
      origin += p.axis[i] * p.slide[i];
      out[i] = origin + arm(p, i);
      origin += p.axis[i] * bodies_[i].length;
    });
    return out;
  }

  /// q_d - q channel by channel. Angles come from the unit vectors, so they are in (-pi, pi] by construction
  /// (model.md section 9: wrap consistently); the joint entries have no mass and serve display only.
  [[nodiscard]] Channels error(const Pose& desired, const Pose& actual) const {
    Channels out;
    const List<Vec2<S>, joints> gd = centres(desired), g = centres(actual);
    S before(0);
    unroll<joints>([&](auto i) {
      const S turned = arc_tangent2(cross(actual.axis[i], desired.axis[i]), dot(actual.axis[i], desired.axis[i]));
      const S of_joint = joint(i) == Joint::revolute ? wrap_to_pi(turned - before)
                                                     : S(desired.slide[i] - actual.slide[i]);
      put(out, i, of_joint, turned, gd[i] - g[i]);
      before = turned;
    });
    return out;
  }

  /// M v' + f + g with M, f, g of [F2]: the forces to be carried by C^T. The joint rows hold friction alone,
  /// because M is zero there: whatever v' says about them never reaches the joints (model.md section 9).
  [[nodiscard]] Channels force(const Channels& v, const Joints& qd) const {
    Channels out;
    unroll<joints>([&](auto i) {
      const Body<S>& b = bodies_[i];
      put(out, i, b.viscous * qd[i] + b.coulomb * sign(qd[i]), b.inertia * v[row_angle(i)],
          Vec2<S>(b.mass * v[row_x(i)], b.mass * (v[row_x(i) + 1] + gravity_)));
    });
    return out;
  }

  /// Diagonal of M.
  [[nodiscard]] Channels mass() const {
    Channels out;
    unroll<joints>(
        [&](auto i) { put(out, i, S(0), bodies_[i].inertia, Vec2<S>(bodies_[i].mass, bodies_[i].mass)); });
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
  static constexpr Joint joint(int i) { return kinds_[i]; }

  static S sign(S v) { return S(v > S(0)) - S(v < S(0)); }  // sign(0) = 0, model.md section 12

  /// From the joint of body i to its mass centre.
  template <int I>
  [[nodiscard]] Vec2<S> arm(const Pose& p, std::integral_constant<int, I>) const {
    if constexpr (shapes_[I] == Shape::bar) {
      return p.axis[I] * bodies_[I].centre;
    } else {
      return p.axis[I] * bodies_[I].centre + perp(p.axis[I]) * bodies_[I].centre_across;
    }
  }

  static void put(Channels& out, int i, const S& of_joint, const S& of_angle, const Vec2<S>& of_centre) {
    out[row_joint(i)] = of_joint;
    out[row_angle(i)] = of_angle;
    out[row_x(i)] = of_centre.x();
    out[row_x(i) + 1] = of_centre.y();
  }

  List<Body<S>, joints> bodies_{};
  S gravity_{};
};

/// Two revolute bars in series: the RR arm, and each leg of the 5R.
template <class S>
using Dyad = Serial<S, Link<Joint::revolute>, Link<Joint::revolute>>;

}  // namespace esmc
