#pragma once
/// The coupling algorithm of the report, eqs. (37)-(47): a platform and serial legs, joined at their tips.
///
/// With the platform's p0# as independent coordinates, leg j turns at qd_j = J_j^-1 (velocity of its
/// attachment point), so that the whole C = blkdiag(C_0, C_1, ..) C^ of model.md [F10], [F11] is leg-wise:
/// neither C nor A is formed. `chain_*` go from p# to everything (C), `gather` comes back (C^T).

#include "firmware/mechanism/serial.hpp"
#include "firmware/types.hpp"

namespace esmc {

/// A point mass that all legs hold: q0 = (x, y), every leg is attached to the point itself.
///
/// What Coupling asks of a platform, leg by leg, is here. A platform with bodies to turn has a Pose that says
/// how it lies, and `turns`: its attachment points then accelerate by `attachment_bias` at constant rates.
template <class S>
struct PointMass {
  static constexpr int dof = 2;
  static constexpr int channels = 2;
  static constexpr bool turns = false;
  struct Pose {};
  S mass{};
  S gravity{};

  [[nodiscard]] static Vec2<S> attachment_rate(const Pose&, int, const Vec2<S>& v) { return v; }
  /// Transpose of attachment_rate: what a force on the attachment point does to p0#.
  [[nodiscard]] static Vec2<S> attachment_force(const Pose&, int, const Vec2<S>& f) { return f; }
  [[nodiscard]] Vec2<S> force(const Vec2<S>& v) const { return {mass * v.x(), mass * (v.y() + gravity)}; }
  [[nodiscard]] Vec2<S> weight() const { return Vec2<S>::Constant(mass); }  ///< diagonal of M_0
};

/// How the frame of a leg lies in N: its origin, and whether it is mirrored (x to the left, angles
/// clockwise).
template <class S>
struct LegFrame {
  Vec2<S> base = Vec2<S>::Zero();
  S mirror{1};  ///< +1 parallel to N, -1 mirrored: S_j = diag(mirror, 1) of model.md (56)

  [[nodiscard]] Vec2<S> to_leg(const Vec2<S>& v) const { return {mirror * v.x(), v.y()}; }
  [[nodiscard]] Vec2<S> from_leg(const Vec2<S>& v) const { return {mirror * v.x(), v.y()}; }
  [[nodiscard]] Vec2<S> point_to_leg(const Vec2<S>& p) const { return to_leg(p - base); }
  [[nodiscard]] Vec2<S> point_from_leg(const Vec2<S>& p) const { return base + from_leg(p); }
};

/// A platform held by `Legs` serial chains (37)-(47). S: scalar type; see the top of the file.
template <class S, class Platform, class Leg, int Legs>
class Coupling {
 public:
  using Scalar = S;
  static constexpr int legs = Legs;
  static constexpr int dof = Platform::dof;
  static constexpr int joints = Legs * Leg::joints;
  static constexpr int channels = Platform::channels + Legs * Leg::channels;
  using Independent = Vec<S, dof>;    ///< p0#: platform coordinates
  using Channels = Vec<S, channels>;  ///< rows of p in the order of model.md section 4
  using Joints = Vec<S, joints>;

  /// Velocities (or accelerations) of platform and joints together: what p# determines through C^. Like a
  /// vector, not initialised by itself.
  struct Rates {
    Independent platform;
    List<typename Leg::Joints, Legs> leg;

    [[nodiscard]] static Rates zero() {
      Rates r;
      r.platform.setZero();
      for (auto& j : r.leg.items) j.setZero();
      return r;
    }
    friend void add(Rates& to, const Rates& what) {
      to.platform += what.platform;
      unroll<Legs>([&](auto j) ESMC_INLINE { to.leg[j] += what.leg[j]; });
    }
  };

  /// Configuration of the legs and of the platform.
  struct LegPoses {
    List<typename Leg::Pose, Legs> leg;
    [[no_unique_address]] typename Platform::Pose platform;
  };

  Coupling() = default;
  Coupling(const Platform& platform, const List<Leg, Legs>& leg, const List<LegFrame<S>, Legs>& frame)
      : platform_(platform), leg_(leg), frame_(frame) {}

  [[nodiscard]] const Leg& leg(int j) const { return leg_[j]; }
  [[nodiscard]] const LegFrame<S>& frame(int j) const { return frame_[j]; }
  [[nodiscard]] const Platform& platform() const { return platform_; }
  static constexpr int row_leg(int j) { return Platform::channels + j * Leg::channels; }
  static constexpr bool has_mass(int row) {
    return row < Platform::channels || Leg::has_mass((row - Platform::channels) % Leg::channels);
  }

  /// C^ p#. Pole at type 1 of any leg.
  [[nodiscard]] Rates chain_rates(const LegPoses& p, const Independent& platform) const {
    Rates out;
    out.platform = platform;
    unroll<Legs>([&](auto j) ESMC_INLINE {
      out.leg[j] =
          leg_[j].tip_inverse(p.leg[j], frame_[j].to_leg(platform_.attachment_rate(p.platform, j, platform)));
    });
    return out;
  }

  /// d/dt (C^ p#): joint accelerations that go with a platform acceleration, closure kept. Pole at type 1.
  [[nodiscard]] Rates chain_accelerations(const LegPoses& p, const Rates& rates,
                                          const Independent& platform) const {
    Rates out;
    out.platform = platform;
    unroll<Legs>([&](auto j) ESMC_INLINE {
      const Vec2<S> tip = frame_[j].to_leg(platform_.attachment_rate(p.platform, j, platform)) -
                          leg_[j].tip_bias(p.leg[j], rates.leg[j], rates.leg[j]);
      if constexpr (Platform::turns) {
        const Vec2<S> drift = platform_.attachment_bias(p.platform, j, rates.platform, rates.platform);
        out.leg[j] = leg_[j].tip_inverse(p.leg[j], tip + frame_[j].to_leg(drift));
      } else {
        out.leg[j] = leg_[j].tip_inverse(p.leg[j], tip);
      }
    });
    return out;
  }

  /// d/dt of C along motion a, applied to b: Cdot(a) b of all channels. Symmetric; c = bias(a, a) [F16].
  /// `ddq` are the joint accelerations C^dot(a) b, from chain_bias.
  [[nodiscard]] Rates chain_bias(const LegPoses& p, const Rates& a, const Rates& b) const {
    Rates out;
    out.platform.setZero();
    unroll<Legs>([&](auto j) ESMC_INLINE {
      if constexpr (Platform::turns) {
        const Vec2<S> drift = platform_.attachment_bias(p.platform, j, a.platform, b.platform);
        out.leg[j] = leg_[j].tip_inverse(
            p.leg[j], frame_[j].to_leg(drift) - leg_[j].tip_bias(p.leg[j], a.leg[j], b.leg[j]));
      } else {
        out.leg[j] = leg_[j].tip_inverse(p.leg[j], -leg_[j].tip_bias(p.leg[j], a.leg[j], b.leg[j]));
      }
    });
    return out;
  }

  /// blkdiag(C_j): all channels from platform and joint rates.
  [[nodiscard]] Channels channel_rates(const LegPoses& p, const Rates& r) const {
    Channels out;
    out.template head<Platform::channels>() = r.platform;
    unroll<Legs>([&](auto j) ESMC_INLINE {
      out.template segment<Leg::channels>(row_leg(j)) = leg_[j].rates(p.leg[j], r.leg[j]);
    });
    return out;
  }

  /// blkdiag(C_j) times joint accelerations plus Cdot_j(a) b: all channel accelerations.
  [[nodiscard]] Channels channel_accelerations(const LegPoses& p, const Rates& a, const Rates& b,
                                               const Rates& acceleration) const {
    Channels out;
    out.template head<Platform::channels>() = acceleration.platform;
    unroll<Legs>([&](auto j) ESMC_INLINE {
      out.template segment<Leg::channels>(row_leg(j)) =
          leg_[j].rates(p.leg[j], acceleration.leg[j]) + leg_[j].bias(p.leg[j], a.leg[j], b.leg[j]);
    });
    return out;
  }
  [[nodiscard]] Channels channel_accelerations(const LegPoses& p, const Rates& r,
                                               const Rates& acceleration) const {
    return channel_accelerations(p, r, r, acceleration);
  }

  /// M v' + f + g, channel by channel [F11]; f from the joint rates.
  [[nodiscard, gnu::always_inline]] Channels force(const Channels& v, const Rates& r) const {
    Channels out;
    out.template head<Platform::channels>() = platform_.force(v.template head<Platform::channels>());
    unroll<Legs>([&](auto j) ESMC_INLINE {
      out.template segment<Leg::channels>(row_leg(j)) =
          leg_[j].force(v.template segment<Leg::channels>(row_leg(j)), r.leg[j]);
    });
    return out;
  }

  /// Diagonal of M.
  [[nodiscard]] Channels mass() const {
    Channels out;
    out.template head<Platform::channels>() = platform_.weight();
    unroll<Legs>([&](auto j)
                     ESMC_INLINE { out.template segment<Leg::channels>(row_leg(j)) = leg_[j].mass(); });
    return out;
  }

  /// C_j^T w: what forces on the channels of each leg do on its joints.
  [[nodiscard, gnu::always_inline]] List<typename Leg::Joints, Legs> leg_torques(const LegPoses& p,
                                                                                 const Channels& w) const {
    List<typename Leg::Joints, Legs> out;
    unroll<Legs>([&](auto j) ESMC_INLINE {
      out[j] = leg_[j].joint_torques(p.leg[j], w.template segment<Leg::channels>(row_leg(j)));
    });
    return out;
  }

  /// C^^T [w0; tau]: forces on the platform and torques at all joints, gathered on p0#. Pole at type 1.
  [[nodiscard]] Independent gather(const LegPoses& p, const Independent& w0,
                                   const List<typename Leg::Joints, Legs>& tau) const {
    Independent out = w0;
    unroll<Legs>([&](auto j) ESMC_INLINE {
      out +=
          platform_.attachment_force(p.platform, j, frame_[j].from_leg(leg_[j].tip_force(p.leg[j], tau[j])));
    });
    return out;
  }

  /// F = C^T w of [F20].
  [[nodiscard]] Independent platform_force(const LegPoses& p, const Channels& w) const {
    return gather(p, w.template head<Platform::channels>(), leg_torques(p, w));
  }

 private:
  Platform platform_{};
  List<Leg, Legs> leg_{};
  List<LegFrame<S>, Legs> frame_{};
};

}  // namespace esmc
