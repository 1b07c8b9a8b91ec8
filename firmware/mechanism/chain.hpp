#pragma once
/// One body of a planar chain after the other, from the base outwards: the steps of the serial algorithm
/// (serial.hpp).
///
/// Every point of a body is a fixed combination of its own axis and the axes before. So differences of poses,
/// rates and accelerations are formed of the axes (`BodyMotion`) and then carried to the mass centres
/// (`to_mass_centre`), at one product for each. Joint indices are constants of an unrolled loop.

#include <type_traits>

#include "firmware/numeric/elementary.hpp"
#include "firmware/types.hpp"

namespace esmc {

/// How a body moves on the one before it: a prismatic joint slides the body along its own axis.
enum class Joint { revolute, prismatic };
/// Where the mass centre of a body may lie.
enum class Shape { bar, plate };  ///< bar: on the axis; plate: anywhere

/// One body and the joint that carries it.
template <Joint J, Shape B = Shape::bar>
struct Link {
  static constexpr Joint joint = J;
  static constexpr Shape shape = B;
};

/// Constants of one body, SI units, in the frame of the body: origin at its joint, x along its axis.
template <class S>
struct Body {
  S length{};          ///< from its joint, slid or not, to the next one or the tip, along the axis, m
  S centre{};          ///< mass centre along the axis, m
  S centre_across{};   ///< mass centre across the axis, m; ignored for Shape::bar
  S mass{};            ///< kg
  S inertia{};         ///< about the mass centre, kg m2
  S viscous{};         ///< of its joint, N m s/rad or N s/m
  S coulomb{};         ///< of its joint, against positive rates, N m or N
  S reverse{coulomb};  ///< likewise, against negative rates
  S rotor{};           ///< mass of the joint's own row of p: a rotor behind its gear, kg m2 or kg
};

/// Kinematics of a planar chain, body by body from the base. `i`: body and its joint, < joints, not checked.
template <class S, class... Links>
class Chain {
 public:
  static constexpr int joints = sizeof...(Links);
  using Joints = Vec<S, joints>;
  static constexpr bool slides = ((Links::joint == Joint::prismatic) || ...);

  struct NoSlides {};
  /// Configuration as unit vectors: the model needs sines and cosines only. Not initialised by itself.
  struct Pose {
    List<Vec2<S>, joints> axis;  ///< along body i, in the frame of the subsystem
    List<Vec2<S>, joints> turn;  ///< (cos, sin) of joint i, whose sine decides type 1; (1, 0) if prismatic
    [[no_unique_address]] std::conditional_t<slides, Joints, NoSlides> slide;  ///< displacements, m
  };

  Chain() = default;
  constexpr explicit Chain(const List<Body<S>, joints>& bodies) : bodies_(bodies) {}

  [[nodiscard]] const Body<S>& body(int i) const { return bodies_[i]; }  ///< constants of body i
  ESMC_INLINE static constexpr bool revolute(int i) { return kinds_[i] == Joint::revolute; }  ///< of joint i
  /// True if the axis of body i can turn: a revolute joint lies between it and the base.
  ESMC_INLINE static constexpr bool turns(int i) {
    for (int j = 0; j <= i; ++j)
      if (revolute(j)) return true;
    return false;
  }

  /// Displacement of joint i, m; 0 of a revolute one.
  ESMC_INLINE static S slid(const Pose& p, int i) {
    if constexpr (slides) {
      return p.slide[i];
    } else {
      return S(0);
    }
  }
  /// Sets the displacement of joint i to q, m; 0 of a revolute one. No effect where no joint slides.
  ESMC_INLINE static void put_slide(Pose& p, int i, S q) {
    if constexpr (slides) p.slide[i] = revolute(i) ? S(0) : q;
  }
  /// Distance from the joint of body i to its end, m.
  ESMC_INLINE S reach(const Pose& p, int i) const {
    return revolute(i) ? bodies_[i].length : S(bodies_[i].length + slid(p, i));
  }
  /// Vector from the joint of body i, after sliding, to its mass centre, m. x: unit vector along its axis;
  /// linear in x, so that a rate of x gives the rate of the vector.
  ESMC_INLINE Vec2<S> from_joint(const Vec2<S>& x, int i) const {
    if (shapes_[i] == Shape::bar) return scaled(x, bodies_[i].centre);
    return x * bodies_[i].centre + perp(x) * bodies_[i].centre_across;
  }
  /// Moment of a force (N) at the mass centre of body i about its origin, N m.
  ESMC_INLINE S moment_of(const Vec2<S>& force, const Pose& p, int i) const {
    const S moment = bodies_[i].centre * cross(p.axis[i], force);
    return shapes_[i] == Shape::bar ? moment : S(moment - bodies_[i].centre_across * dot(p.axis[i], force));
  }

  /// Difference of poses, rate or acceleration of two vectors of a body: the unit vector of its axis (1, 1/s,
  /// 1/s2) and the displacement of its joint along that axis (m, m/s, m/s2).
  struct BodyMotion {
    Vec2<S> axis, slide;

    ESMC_INLINE BodyMotion() : axis(Vec2<S>::Zero()), slide(Vec2<S>::Zero()) {}  ///< zero
    ESMC_INLINE BodyMotion(const Vec2<S>& of_axis, const Vec2<S>& of_slide)
        : axis(of_axis), slide(of_slide) {}
    ESMC_INLINE friend BodyMotion operator+(const BodyMotion& a, const BodyMotion& b) {
      return {a.axis + b.axis, a.slide + b.slide};
    }
    ESMC_INLINE friend BodyMotion operator-(const BodyMotion& a, const BodyMotion& b) {
      return {a.axis - b.axis, a.slide - b.slide};
    }
  };
  /// The motion m of body i at its mass centre, m (per s, s2). `at_end`: of the end of the body before, empty
  /// for i = 0; this function moves it to the end of body i.
  ESMC_INLINE Vec2<S> to_mass_centre(Sum<Vec2<S>>& at_end, int i, const BodyMotion& m) const {
    Vec2<S> out;  // the only object returned, or it would be copied by way of memory
    if (!revolute(i)) at_end.add(m.slide);
    if (turns(i)) {
      out = at_end.plus(from_joint(m.axis, i));
      if (i + 1 < joints) at_end.add(scaled(m.axis, bodies_[i].length));
    } else {
      out = at_end.value();
    }
    return out;
  }

  /// Memory of move() for rates, p = C p# (2): one object per pass along the chain.
  struct RateWalk {
    Sum<S> spin;  ///< angular rate of the body in hand, rad/s
  };
  /// Rate of body i at the joint rates qd; call for i = 0, 1, .. in this order, with one w.
  ESMC_INLINE static BodyMotion move(RateWalk& w, int i, const Pose& p, const Joints& qd) {
    BodyMotion m;
    if (revolute(i)) w.spin.add(qd[i]);
    if (turns(i)) m.axis = perp(p.axis[i]) * w.spin.value();
    if (!revolute(i)) {
      m.slide = p.axis[i] * qd[i];
      if (turns(i)) m.slide += m.axis * slid(p, i);
    }
    return m;
  }
  /// Memory of move() for the accelerations Cdot(a) b at constant joint rates a and b, [F1] for a = b.
  struct BiasWalk {
    Sum<S> spin_a, spin_b;
  };
  /// Acceleration of body i at constant rates a and b; call for i = 0, 1, .. in this order, with one w.
  ESMC_INLINE static BodyMotion move(BiasWalk& w, int i, const Pose& p, const Joints& a, const Joints& b) {
    BodyMotion m;
    if (revolute(i)) {
      w.spin_a.add(a[i]);
      w.spin_b.add(b[i]);
    }
    if (turns(i)) m.axis = p.axis[i] * S(-(w.spin_a.value() * w.spin_b.value()));
    if (!revolute(i) && turns(i))
      m.slide = m.axis * slid(p, i) + perp(p.axis[i]) * (w.spin_a.value() * b[i] + w.spin_b.value() * a[i]);
    return m;
  }
  /// Desired less actual pose of body i.
  ESMC_INLINE static BodyMotion gap(int i, const Pose& desired, const Pose& actual) {
    BodyMotion m;
    if (turns(i)) m.axis = desired.axis[i] - actual.axis[i];
    if (!revolute(i)) m.slide = desired.axis[i] * slid(desired, i) - actual.axis[i] * slid(actual, i);
    return m;
  }
  /// Angle from the actual to the desired axis of body i, rad, in [-pi, pi].
  ESMC_INLINE static S turned_at(int i, const Pose& desired, const Pose& actual) {
    return angle_of_unit(cross(actual.axis[i], desired.axis[i]), dot(actual.axis[i], desired.axis[i]));
  }
  /// Error of joint i, desired less actual: rad in [-pi, pi], or m. `before`, `turned`: `turned_at` of the
  /// body before and of this one.
  ESMC_INLINE static S joint_error(int i, S before, S turned, const Pose& desired, const Pose& actual) {
    if (!revolute(i)) return slid(desired, i) - slid(actual, i);
    return i == 0 ? turned : wrap_to_pi(S(turned - before));
  }

 private:
  static constexpr List<Joint, joints> kinds_{{Links::joint...}};
  static constexpr List<Shape, joints> shapes_{{Links::shape...}};

  List<Body<S>, joints> bodies_{};
};

}  // namespace esmc
