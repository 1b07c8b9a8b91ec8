#pragma once
/// The RR arm: the serial algorithm alone, two revolute joints, both driven (model.md section 2).

#include <optional>

#include "firmware/mechanism/five_bar.hpp"

namespace esmc {

/// The RR arm; see the top of the file. Lengths in m, angles in rad, torques in N m. A member without a
/// comment means what it means in FiveBar and Coupling; here joints are independent coordinates and base
/// joints as well, so a conversion between these returns its argument.
template <class S>
class Rr {
 public:
  using Scalar = S;
  using Params = RrParams<S>;
  using Leg = Dyad<S>;
  static constexpr int joints = 2;
  static constexpr int channels = Leg::channels;
  static constexpr bool has_type2 = false;
  static constexpr bool has_mass(int row) { return Leg::has_mass(row); }  ///< see Serial
  using Independent = Vec2<S>;                                            ///< joint rates
  using Channels = typename Leg::Channels;
  using Rates = Vec2<S>;

  /// Which solution of inverse kinematics the arm is in.
  struct Mode {
    int working = 0;  ///< sign of sin theta_2, +1 or -1
  };

  /// A configuration: unit vectors of the bars, and the effector in m.
  struct Pose {
    typename Leg::Pose arm;
    Vec2<S> effector;
  };

  Rr() = default;
  explicit Rr(const Params& p) : arm_(make_dyad(p.arm, p.g)) {}  ///< p is not checked: see check()

  [[nodiscard]] const Leg& arm() const { return arm_; }

  /// Pose at the joint angles theta, rad; NaN beyond the range of sin_cos.
  [[nodiscard]] Pose pose(const Vec2<S>& theta) const {
    Pose p{Leg::pose(theta), {}};
    p.effector = arm_.tip(p.arm);
    return p;
  }
  /// Inverse kinematics [F17] of the effector (m) in the working mode. Empty: out of reach, at base, or NaN.
  [[nodiscard]] std::optional<Pose> inverse(const Vec2<S>& effector, const Mode& mode) const {
    Pose p;
    return inverse(effector, mode, p) ? std::optional<Pose>(p) : std::nullopt;
  }
  /// Inverse kinematics [F17] of the effector (m) into `p`. False: no such pose or NaN, `p` is undefined.
  [[nodiscard]] bool inverse(const Vec2<S>& effector, const Mode& mode, Pose& p) const {
    p.effector = effector;
    return dyad_inverse(arm_, effector, mode.working, p.arm);
  }
  /// Sets `out` to (cos, sin) of theta1 and of theta2.
  static void base_directions(const Pose& p, List<Vec2<S>, 2>& out) { out = p.arm.turn; }
  /// (theta1, theta2) of a pose, rad, each in [-pi, pi].
  [[nodiscard]] static Vec2<S> angles(const Pose& p) { return angles_of(p.arm.turn); }
  [[nodiscard]] static Vec2<S> base_angles(const Pose& p) { return angles(p); }  ///< both are base joints
  [[nodiscard]] static S sin_type1(const Pose& p) { return p.arm.turn[1].y(); }  ///< sin theta2
  static S min_abs_sin_type1(const Pose& p) { return sin_type1(p) < S(0) ? -sin_type1(p) : sin_type1(p); }

  /// 1, the largest distance from type 2, which the arm does not have.
  [[nodiscard]] static S abs_sin_type2(const Pose&) { return S(1); }
  [[nodiscard]] static S sin_type2_in_mode(const Pose&, const Mode&) { return S(1); }  ///< 1: no type 2
  /// True if sin theta2 has the sign of the mode; false at type 1 and for a NaN.
  [[nodiscard]] static bool in_working_mode(const Pose& p, const Mode& mode) {
    return sin_type1(p) * S(mode.working) > S(0);
  }

  // ---- what a control law needs: the same names and meanings as in FiveBar, Coupling ----

  static constexpr bool is_angle(int row) { return row < 2 * Leg::joints; }  ///< true: angle; false: length
  [[nodiscard]] static Vec2<S> independent(const Rates& r) { return r; }     ///< joint rates, rad/s
  [[nodiscard]] static Vec2<S> base(const Rates& r) { return r; }            ///< joint rates, rad/s
  /// theta_d - theta of both joints, rad, in [-pi, pi].
  [[nodiscard]] static Vec2<S> independent_error(const Pose& desired, const Pose& actual) {
    Vec2<S> out;
    unroll<2>([&](auto i) {
      const Vec2<S>& a = actual.arm.turn[i];
      const Vec2<S>& d = desired.arm.turn[i];
      out[i] = angle_of_unit(cross(a, d), dot(a, d));
    });
    return out;
  }
  [[nodiscard]] static Vec2<S> base_error(const Pose& desired, const Pose& actual) {
    return independent_error(desired, actual);
  }
  /// Calls f(row, e, e', q''_d) once per channel [F29] of a Tracking t; see Serial::for_each_error_row.
  template <bool joint_rows = true, class Tracking, class F>
  ESMC_INLINE void for_each_error_row(const Tracking& t, F&& f) const {
    arm_.template for_each_error_row<joint_rows>(t.desired_pose.arm, t.desired_rates, t.desired_acceleration,
                                                 t.pose.arm, t.rates, f);
  }
  /// Calls f(row, C sigma, C acceleration + Cdot(a) b) once per channel [F33]; see Serial.
  template <class F>
  ESMC_INLINE void for_each_reference_row(const Pose& p, const Rates& sigma, const Rates& acceleration,
                                          const Rates& a, const Rates& b, F&& f) const {
    arm_.for_each_reference_row(p.arm, sigma, acceleration, a, b, f);
  }
  static void fill_joint_rows(Channels& s) { Leg::fill_joint_rows(s); }                   ///< see Serial
  [[nodiscard]] Rates chain_rates(const Pose&, const Independent& p) const { return p; }  ///< p: joint rates
  [[nodiscard]] Rates chain_accelerations(const Pose&, const Rates&, const Independent& a) const { return a; }
  [[nodiscard]] Rates chain_bias(const Pose&, const Rates&, const Rates&) const { return Rates::Zero(); }
  [[nodiscard]] Rates base_rates(const Pose&, const Vec2<S>& b) const { return b; }  ///< b: joint rates
  [[nodiscard]] Rates base_accelerations(const Pose&, const Rates&, const Vec2<S>& b) const { return b; }
  [[nodiscard]] Channels channel_rates(const Pose& p, const Rates& r) const { return arm_.rates(p.arm, r); }
  /// C acceleration + Cdot(a) b: accelerations of all channels, rad/s2 and m/s2 [F5].
  [[nodiscard]] Channels channel_accelerations(const Pose& p, const Rates& a, const Rates& b,
                                               const Rates& acceleration) const {
    return arm_.rates(p.arm, acceleration) + arm_.bias(p.arm, a, b);
  }
  /// C acceleration + Cdot r: accelerations of all channels at joint rates r.
  [[nodiscard]] Channels channel_accelerations(const Pose& p, const Rates& r,
                                               const Rates& acceleration) const {
    return channel_accelerations(p, r, r, acceleration);
  }
  /// M v + f + g, forces on the channels, N m and N: see Serial::force.
  [[nodiscard]] Channels force(const Channels& v, const Rates& r) const { return arm_.force(v, r); }
  /// Adds the share of the rotor at the elbow to the accelerations v of the channels: Serial::add_rotors.
  void add_rotors(Channels& v) const { arm_.add_rotors(v); }
  [[nodiscard]] Channels mass() const { return arm_.mass(); }  ///< diagonal of M, kg m2 and kg
  /// C^T w (1), N m: torques of both joints of forces w on the channels.
  [[nodiscard]] Vec2<S> base_torque(const Pose& p, const Channels& w) const {
    return arm_.joint_torques(p.arm, w);
  }
  [[nodiscard]] Vec2<S> tip_rate(const Pose& p, const Rates& r) const { return arm_.tip_rate(p.arm, r); }
  /// Joint rates (rad/s) at the effector's velocity v (m/s) [F8]. Not finite at type 1.
  [[nodiscard]] Rates rates_of_effector(const Pose& p, const Vec2<S>& v) const {
    return arm_.tip_inverse(p.arm, v);
  }
  /// Joint accelerations (rad/s2) at the effector's acceleration a (m/s2) and rates r. Not finite at type 1.
  [[nodiscard]] Rates accelerations_of_effector(const Pose& p, const Rates& r, const Vec2<S>& a) const {
    return arm_.tip_inverse(p.arm, a - arm_.tip_bias(p.arm, r, r));
  }

 private:
  Leg arm_{};
};

}  // namespace esmc
