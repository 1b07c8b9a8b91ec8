#pragma once
/// The coupling algorithm of the report, eqs. (37)-(47): a platform and serial legs, joined at their tips.
/// model.md section 3.
///
/// With the platform's p0# as independent coordinates, leg j turns at J_j^-1 (velocity of its attachment
/// point), so that C = blkdiag(C_0, C_1, ..) C^ [F10], [F11] is evaluated leg by leg: neither C nor A is
/// formed. `chain_*` and `channel_*` go from p# to all channels (C), `gather` goes back (C^T).

#include "firmware/mechanism/serial.hpp"
#include "firmware/types.hpp"

namespace esmc {

/// A platform that is a point mass (48): q0 = (x, y), every leg is attached to the point itself.
///
/// Coupling needs these members of a platform. A platform that can rotate adds its orientation to `Pose`,
/// sets `turns` and has `attachment_bias(pose, leg, a, b)`: acceleration (m/s2) of an attachment point at
/// constant platform rates a and b, bilinear.
template <class S>
struct PointMass {
  static constexpr int dof = 2;
  static constexpr int channels = 2;
  static constexpr bool turns = false;
  /// Configuration of the platform.
  struct Pose {
    Vec2<S> effector;  ///< in N, m
  };
  S mass{};     ///< m0, kg
  S gravity{};  ///< m/s2

  /// Velocity (m/s) of a leg's attachment point by p0#: (dq/dq0) D+ of (39), here 1.
  [[nodiscard]] static Vec2<S> attachment_rate(const Pose&, int, const Vec2<S>& v) { return v; }
  /// Transpose of attachment_rate: force on p0# (N) by a force on the attachment point (N).
  [[nodiscard]] static Vec2<S> attachment_force(const Pose&, int, const Vec2<S>& f) { return f; }
  /// e = q_d - q, m.
  [[nodiscard]] static Vec2<S> error(const Pose& desired, const Pose& actual) {
    return desired.effector - actual.effector;
  }
  /// M_0 v' + g_0, N, of an acceleration v' (m/s2).
  [[nodiscard]] Vec2<S> force(const Vec2<S>& v) const { return {mass * v.x(), mass * (v.y() + gravity)}; }
  [[nodiscard]] Vec2<S> weight() const { return Vec2<S>::Constant(mass); }  ///< diagonal of M_0, kg
};

/// Frame Nj of leg j in N: its origin, and whether it is mirrored (x to the left, angles clockwise).
template <class S>
struct LegFrame {
  Vec2<S> base = Vec2<S>::Zero();  ///< m
  S mirror{1};                     ///< +1 parallel to N, -1 mirrored: S_j = diag(mirror, 1) (56)

  /// S_j v: components in Nj of a vector in N. S_j is its own inverse.
  [[nodiscard]] Vec2<S> to_leg(const Vec2<S>& v) const { return {mirror * v.x(), v.y()}; }
  [[nodiscard]] Vec2<S> from_leg(const Vec2<S>& v) const { return to_leg(v); }  ///< its inverse, Nj to N
  [[nodiscard]] Vec2<S> point_to_leg(const Vec2<S>& p) const { return to_leg(p - base); }  ///< point, N to Nj
  [[nodiscard]] Vec2<S> point_from_leg(const Vec2<S>& p) const { return base + from_leg(p); }  ///< point to N
};

/// A platform held by `Legs` serial chains (37)-(47). S: scalar type; see the top of the file.
template <class S, class Platform, class Leg, int Legs>
class Coupling {
 public:
  using Scalar = S;
  static constexpr int legs = Legs;
  static constexpr int joints = Legs * Leg::joints;
  static constexpr int channels = Platform::channels + Legs * Leg::channels;
  using Independent = Vec<S, Platform::dof>;  ///< p0#: platform coordinates
  using Channels = Vec<S, channels>;          ///< rows of p in the order of model.md section 4

  /// [p0#; joint rates] = C^ p# [F10], or the accelerations of both. Not initialised by itself.
  struct Rates {
    Independent platform;
    List<typename Leg::Joints, Legs> leg;

    [[nodiscard]] static Rates Zero() {
      Rates r;
      r.platform.setZero();
      for (auto& j : r.leg.items) j.setZero();
      return r;
    }
    Rates& operator+=(const Rates& other) {
      platform += other.platform;
      unroll<Legs>([&](auto j) ESMC_INLINE { leg[j] += other.leg[j]; });
      return *this;
    }
  };

  /// Configuration of platform and legs.
  struct LegPoses : Platform::Pose {
    List<typename Leg::Pose, Legs> leg;
  };

  Coupling() = default;
  Coupling(const Platform& platform, const List<Leg, Legs>& leg, const List<LegFrame<S>, Legs>& frame)
      : platform_(platform), leg_(leg), frame_(frame) {}

  [[nodiscard]] const Leg& leg(int j) const { return leg_[j]; }
  [[nodiscard]] const LegFrame<S>& frame(int j) const { return frame_[j]; }
  [[nodiscard]] const Platform& platform() const { return platform_; }
  /// Row of p with which leg j begins.
  static constexpr int row_leg(int j) { return Platform::channels + j * Leg::channels; }
  /// True for rows with a mass or an inertia in M; false for the rows of joints: see Serial::force.
  static constexpr bool has_mass(int row) {
    return row < Platform::channels || Leg::has_mass((row - Platform::channels) % Leg::channels);
  }

  /// C^ p# (39), [F10], for the 5R [F12]: joint rates (rad/s) for platform rates (m/s). Pole at type 1.
  [[nodiscard]] Rates chain_rates(const LegPoses& p, const Independent& platform) const {
    Rates out;
    out.platform = platform;
    unroll<Legs>([&](auto j) ESMC_INLINE {
      out.leg[j] = leg_[j].tip_inverse(p.leg[j], frame_[j].to_leg(platform_.attachment_rate(p, j, platform)));
    });
    return out;
  }

  /// d/dt (C^ p#) [F22]: joint accelerations J_j^-1 (S_j a - Jdot_j qd_j), rad/s2, of the acceleration a =
  /// `platform` (m/s2) in a pose with these rates. Pole at type 1 of any leg.
  [[nodiscard]] Rates chain_accelerations(const LegPoses& p, const Rates& rates,
                                          const Independent& platform) const {
    Rates out;
    out.platform = platform;
    unroll<Legs>([&](auto j) ESMC_INLINE {
      out.leg[j] = leg_[j].tip_inverse(p.leg[j], frame_[j].to_leg(platform_.attachment_rate(p, j, platform)) -
                                                     closure_bias(p, j, rates, rates));
    });
    return out;
  }

  /// d/dt of C^ along motion a, applied to b: -J_j^-1 Jdot_j(a) b, q''_j0 of [F16] for a = b. Pole at type 1.
  [[nodiscard]] Rates chain_bias(const LegPoses& p, const Rates& a, const Rates& b) const {
    Rates out;
    out.platform.setZero();
    unroll<Legs>([&](auto j)
                     ESMC_INLINE { out.leg[j] = leg_[j].tip_inverse(p.leg[j], -closure_bias(p, j, a, b)); });
    return out;
  }

  /// blkdiag(C_j) (40), [F11]: rates of all channels from platform and joint rates, which must agree.
  [[nodiscard]] Channels channel_rates(const LegPoses& p, const Rates& r) const {
    return assembled(r.platform, [&](auto j) ESMC_INLINE { return leg_[j].rates(p.leg[j], r.leg[j]); });
  }

  /// blkdiag(C_j) times joint accelerations plus Cdot_j(a) b: all channel accelerations [F16].
  [[nodiscard]] Channels channel_accelerations(const LegPoses& p, const Rates& a, const Rates& b,
                                               const Rates& acceleration) const {
    Channels out;
    out.template head<Platform::channels>() = acceleration.platform;
    unroll<Legs>([&](auto j) ESMC_INLINE {
      rows_of(out, j) =
          leg_[j].rates(p.leg[j], acceleration.leg[j]) + leg_[j].bias(p.leg[j], a.leg[j], b.leg[j]);
    });
    return out;
  }
  /// All channel accelerations pdot = C a + c [F20] at the rates r; a: `acceleration` of platform and joints.
  [[nodiscard]] Channels channel_accelerations(const LegPoses& p, const Rates& r,
                                               const Rates& acceleration) const {
    return channel_accelerations(p, r, r, acceleration);
  }

  /// M v' + f + g of (37) and (95), [F11], channel by channel, N m and N; f from the joint rates.
  [[nodiscard, gnu::always_inline]] Channels force(const Channels& v, const Rates& r) const {
    return assembled(platform_.force(v.template head<Platform::channels>()),
                     [&](auto j) ESMC_INLINE { return leg_[j].force(rows_of(v, j), r.leg[j]); });
  }

  /// Adds the rotors' share to the accelerations v of all channels; see Serial::add_rotors.
  void add_rotors(Channels& v) const {
    for (int j = 0; j < Legs; ++j) leg_[j].add_rotors(v, row_leg(j));
  }

  /// Diagonal of M (43), kg m2 and kg.
  [[nodiscard]] Channels mass() const {
    return assembled(platform_.weight(), [&](auto j) ESMC_INLINE { return leg_[j].mass(); });
  }

  /// C_j^T w: joint torques (N m) of forces on the channels of each leg, the transpose of `channel_rates`.
  [[nodiscard, gnu::always_inline]] List<typename Leg::Joints, Legs> leg_torques(const LegPoses& p,
                                                                                 const Channels& w) const {
    List<typename Leg::Joints, Legs> out;
    unroll<Legs>([&](auto j) ESMC_INLINE { out[j] = leg_[j].joint_torques(p.leg[j], rows_of(w, j)); });
    return out;
  }

  /// C^^T [w0; tau]: force on p0# by forces w0 on the platform and torques tau at all joints, the transpose
  /// of `chain_rates`. Pole at type 1.
  [[nodiscard]] Independent gather(const LegPoses& p, const Independent& w0,
                                   const List<typename Leg::Joints, Legs>& tau) const {
    Independent out = w0;
    unroll<Legs>([&](auto j) ESMC_INLINE {
      out += platform_.attachment_force(p, j, frame_[j].from_leg(leg_[j].tip_force(p.leg[j], tau[j])));
    });
    return out;
  }

  /// F = C^T w of (95), [F20]: force on p0# (N) by forces w (N, N m) on the channels. Pole at type 1.
  [[nodiscard]] Independent platform_force(const LegPoses& p, const Channels& w) const {
    return gather(p, w.template head<Platform::channels>(), leg_torques(p, w));
  }

  /// Calls f(row, e, e', q''_d) once per channel (90), [F29] of a Tracking t; see Serial::for_each_error_row.
  template <bool joint_rows = true, class Tracking, class F>
  ESMC_INLINE void for_each_error_row(const Tracking& t, F&& f) const {
    const Independent e = Platform::error(t.desired_pose, t.pose);
    unroll<Platform::channels>([&](auto i) ESMC_INLINE {
      f(i, e[i], S(t.desired_rates.platform[i] - t.rates.platform[i]), t.desired_acceleration.platform[i]);
    });
    unroll<Legs>([&](auto j) ESMC_INLINE {
      leg_[j].template for_each_error_row<joint_rows>(
          t.desired_pose.leg[j], t.desired_rates.leg[j], t.desired_acceleration.leg[j], t.pose.leg[j],
          t.rates.leg[j], [&](auto row, S of, S rate, S acceleration) ESMC_INLINE {
            f(std::integral_constant<int, row_leg(j) + row>{}, of, rate, acceleration);
          });
    });
  }

  /// Calls f(row, C sigma, C a_r + Cdot(a) b) once for every channel [F33]; see
  /// Serial::for_each_reference_row.
  template <class F>
  ESMC_INLINE void for_each_reference_row(const LegPoses& p, const Rates& sigma, const Rates& acceleration,
                                          const Rates& a, const Rates& b, F&& f) const {
    unroll<Platform::channels>([&](auto i)
                                   ESMC_INLINE { f(i, sigma.platform[i], acceleration.platform[i]); });
    unroll<Legs>([&](auto j) ESMC_INLINE {
      leg_[j].for_each_reference_row(
          p.leg[j], sigma.leg[j], acceleration.leg[j], a.leg[j], b.leg[j],
          [&](auto row, S of_sigma, S reference)
              ESMC_INLINE { f(std::integral_constant<int, row_leg(j) + row>{}, of_sigma, reference); });
    });
  }
  /// Sets the joint rows of every leg from those of its bars; see Serial::fill_joint_rows.
  static void fill_joint_rows(Channels& s) {
    unroll<Legs>([&](auto j) ESMC_INLINE { Leg::fill_joint_rows(s, row_leg(j)); });
  }

 private:
  /// Platform rows, then those that leg(j) returns.
  template <class F>
  [[nodiscard]] ESMC_INLINE static Channels assembled(const Vec<S, Platform::channels>& platform, F&& leg) {
    Channels out;
    out.template head<Platform::channels>() = platform;
    unroll<Legs>([&](auto j) ESMC_INLINE { rows_of(out, j) = leg(j); });
    return out;
  }
  /// The rows of leg j.
  template <class V>
  [[nodiscard]] static auto rows_of(V& v, int j) {
    return v.template segment<Leg::channels>(row_leg(j));
  }
  /// Acceleration of leg j's tip less that of its attachment point, in Nj, while both move at constant rates.
  ESMC_INLINE Vec2<S> closure_bias(const LegPoses& p, int j, const Rates& a, const Rates& b) const {
    const Vec2<S> tip = leg_[j].tip_bias(p.leg[j], a.leg[j], b.leg[j]);
    if constexpr (Platform::turns) {
      return tip - frame_[j].to_leg(platform_.attachment_bias(p, j, a.platform, b.platform));
    } else {
      return tip;
    }
  }

  Platform platform_{};
  List<Leg, Legs> leg_{};
  List<LegFrame<S>, Legs> frame_{};
};

}  // namespace esmc
