#pragma once
/// A planar chain of bodies and how motion goes along it, from its base outwards: what the serial algorithm
/// (serial.hpp) is made of. All points of a body are fixed combinations of the axes: what is linear in these
/// and their derivatives is known of the mass centres once it is known of the axes, and takes one product for
/// each.

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
  S length{};         ///< from its joint, slid or not, to the next one (or to the tip), along the axis, m
  S centre{};         ///< mass centre along the axis, m
  S centre_across{};  ///< mass centre across the axis, m; ignored for Shape::bar
  S mass{};           ///< kg
  S inertia{};        ///< about the mass centre, kg m2
  S viscous{};        ///< of its joint, N m s/rad or N s/m
  S coulomb{};        ///< of its joint, N m or N
};

/// See the top of the file.
template <class S, class... Links>
class Chain {
 public:
  using Scalar = S;
  static constexpr int joints = sizeof...(Links);
  using Joints = Vec<S, joints>;

  struct NoSlides {};
  /// Where the bodies are; like a vector, not initialised by itself. Unit vectors instead of angles: the
  /// model needs no angle, only its sine and cosine.
  struct Pose {
    List<Vec2<S>, joints> axis;  ///< along body i, in the frame of the subsystem
    List<Vec2<S>, joints> turn;  ///< (cos, sin) of joint i; kept apart because sin theta decides type 1
    [[no_unique_address]] std::conditional_t<((Links::joint == Joint::prismatic) || ...), Joints, NoSlides>
        slide;  ///< of each joint, m
  };

  Chain() = default;
  constexpr explicit Chain(const List<Body<S>, joints>& bodies) : bodies_(bodies) {}

  [[nodiscard]] const Body<S>& body(int i) const { return bodies_[i]; }

  static constexpr List<Joint, joints> kinds_{{Links::joint...}};
  static constexpr List<Shape, joints> shapes_{{Links::shape...}};
  static constexpr bool slides = ((Links::joint == Joint::prismatic) || ...);
  static constexpr Joint joint(int i) { return kinds_[i]; }

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
  /// From the origin of body I, which its joint may have slid, to its mass centre, where x is its axis; or
  /// its rate, where x is that of the axis.
  template <int I>
  [[nodiscard, gnu::always_inline]] Vec2<S> from_joint(const Vec2<S>& x,
                                                       std::integral_constant<int, I>) const {
    if constexpr (shapes_[I] == Shape::bar) {
      return x * bodies_[I].centre;
    } else {
      return x * bodies_[I].centre + perp(x) * bodies_[I].centre_across;
    }
  }
  /// Of a force at the mass centre of body I about its origin.
  template <int I>
  [[nodiscard, gnu::always_inline]] S moment_of(const Vec2<S>& force, const Pose& p,
                                                std::integral_constant<int, I>) const {
    if constexpr (shapes_[I] == Shape::bar) {
      return bodies_[I].centre * cross(p.axis[I], force);
    } else {
      return bodies_[I].centre * cross(p.axis[I], force) - bodies_[I].centre_across * dot(p.axis[I], force);
    }
  }

  /// Whether the axis of body I can turn: there is a revolute joint on the way.
  template <int I>
  static constexpr bool turns = [] {
    bool any = false;
    for (int i = 0; i <= I; ++i) any = any || joint(i) == Joint::revolute;
    return any;
  }();
  /// Something linear of a body: of its axis, where that turns, and of what its joint slides along it, where
  /// that slides.
  struct BodyMotion {
    Vec2<S> axis, slide;
  };
  template <int I>
  [[nodiscard, gnu::always_inline]] static BodyMotion plus(std::integral_constant<int, I>,
                                                           const BodyMotion& a, const BodyMotion& b) {
    BodyMotion out;
    if constexpr (turns<I>) out.axis = a.axis + b.axis;
    if constexpr (joint(I) == Joint::prismatic) out.slide = a.slide + b.slide;
    return out;
  }
  template <int I>
  [[nodiscard, gnu::always_inline]] static BodyMotion minus(std::integral_constant<int, I>,
                                                            const BodyMotion& a, const BodyMotion& b) {
    BodyMotion out;
    if constexpr (turns<I>) out.axis = a.axis - b.axis;
    if constexpr (joint(I) == Joint::prismatic) out.slide = a.slide - b.slide;
    return out;
  }
  /// Of the mass centre; `at_end`, of the end of the body before, goes on to the end of this one, unless it
  /// is the last.
  template <int I>
  [[nodiscard, gnu::always_inline]] Vec2<S> to_mass_centre(Sum<Vec2<S>>& at_end,
                                                           std::integral_constant<int, I> i,
                                                           const BodyMotion& m) const {
    Vec2<S> out;  // at the outermost level, or it would be copied, by way of memory
    if constexpr (joint(I) == Joint::prismatic) at_end.add(m.slide);
    if constexpr (turns<I>) {
      out = at_end.plus(from_joint(m.axis, i));
      if constexpr (I + 1 < joints) at_end.add(m.axis * bodies_[I].length);
    } else {
      out = at_end.value();
    }
    return out;
  }

  /// Rates, and the part of accelerations that is like them.
  struct RateWalk {
    Sum<S> spin;
  };
  template <int I>
  [[nodiscard, gnu::always_inline]] static BodyMotion move(RateWalk& w, std::integral_constant<int, I> i,
                                                           const Pose& p, const Joints& qd) {
    BodyMotion m;
    if constexpr (joint(I) == Joint::revolute) w.spin.add(qd[I]);
    if constexpr (turns<I>) m.axis = perp(p.axis[I]) * w.spin.value();
    if constexpr (joint(I) == Joint::prismatic) {
      m.slide = p.axis[I] * qd[I];
      if constexpr (turns<I>) m.slide += m.axis * slid(p, i);
    }
    return m;
  }
  /// What remains of accelerations at constant rates; bilinear.
  struct BiasWalk {
    Sum<S> spin_a, spin_b;
  };
  template <int I>
  [[nodiscard, gnu::always_inline]] static BodyMotion move(BiasWalk& w, std::integral_constant<int, I> i,
                                                           const Pose& p, const Joints& a, const Joints& b) {
    BodyMotion m;
    if constexpr (joint(I) == Joint::revolute) {
      w.spin_a.add(a[I]);
      w.spin_b.add(b[I]);
    }
    if constexpr (turns<I>) m.axis = p.axis[I] * S(-(w.spin_a.value() * w.spin_b.value()));
    if constexpr (joint(I) == Joint::prismatic) {
      if constexpr (turns<I>) {
        m.slide = m.axis * slid(p, i) + perp(p.axis[I]) * (w.spin_a.value() * b[I] + w.spin_b.value() * a[I]);
      } else {
        m.slide.setZero();
      }
    }
    return m;
  }
  /// Desired less actual.
  template <int I>
  [[nodiscard, gnu::always_inline]] static BodyMotion gap(std::integral_constant<int, I> i,
                                                          const Pose& desired, const Pose& actual) {
    BodyMotion m;
    if constexpr (turns<I>) m.axis = desired.axis[I] - actual.axis[I];
    if constexpr (joint(I) == Joint::prismatic)
      m.slide = desired.axis[I] * slid(desired, i) - actual.axis[I] * slid(actual, i);
    return m;
  }
  /// Angle from the actual to the desired axis, in (-pi, pi].
  template <int I>
  [[nodiscard, gnu::always_inline]] static S turned_at(std::integral_constant<int, I>, const Pose& desired,
                                                       const Pose& actual) {
    return angle_of_unit(cross(actual.axis[I], desired.axis[I]), dot(actual.axis[I], desired.axis[I]));
  }
  /// Of the joint, from the angles of the body before and of its own.
  template <int I>
  [[nodiscard, gnu::always_inline]] static S joint_error(std::integral_constant<int, I> i, S before, S turned,
                                                         const Pose& desired, const Pose& actual) {
    if constexpr (joint(I) == Joint::revolute) {
      return I == 0 ? turned : wrap_to_pi(S(turned - before));
    } else {
      return slid(desired, i) - slid(actual, i);
    }
  }

 private:
  List<Body<S>, joints> bodies_{};
};

}  // namespace esmc
