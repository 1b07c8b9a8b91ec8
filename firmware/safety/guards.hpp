#pragma once
/// The checks that every torque passes. Plain scalars, independent of mechanism and law.
/// Every condition states the allowed range (<=, >=): a NaN then fails it.

#include <array>
#include <cstdint>
#include <limits>

#include "firmware/safety/faults.hpp"

namespace esmc {

inline constexpr int base_joint_count = 2;

/// -limit <= v <= limit, in one comparison; false where either is NaN.
template <class S>
[[nodiscard]] constexpr bool within(S v, S limit) {
  if constexpr (sizeof(S) == sizeof(float)) {
    return __builtin_fabsf(v) <= limit;
  } else {
    return __builtin_fabs(v) <= limit;
  }
}
/// True for a number that is neither NaN nor infinite, without libm.
template <class S>
[[nodiscard]] constexpr bool finite(S v) {
  return within(v, std::numeric_limits<S>::max());
}

/// The result of comparing two S: bool, or one truth per lane where S is several numbers side by side.
template <class S>
using Truth = decltype(S() < S());

/// A closed interval.
template <class S>
struct Range {
  S lower = -std::numeric_limits<S>::max();
  S upper = std::numeric_limits<S>::max();
  [[nodiscard]] constexpr Truth<S> contains(S v) const { return lower <= v && v <= upper; }  ///< NaN: false
};

/// Limits of the guards. A measured quantity beyond one is a latched fault; see guard().
template <class S>
struct Limits {
  S min_abs_sin_type1{};                  ///< of sin theta_j2, dimensionless
  S min_abs_sin_type2{};                  ///< of D2, dimensionless
  S joint_speed{};                        ///< rad/s, base joints
  S closure{};                            ///< m: distance of the leg tips with passive encoders
  Range<S> workspace_x{}, workspace_y{};  ///< m
  std::array<Range<S>, base_joint_count> joint_angle{};  ///< rad
  std::uint32_t max_age_ticks = 0;                       ///< samples missed in a row that are extrapolated
  S feedback_jump{};      ///< rad per tick between an angle and its prediction; 0: not checked
  S join_acceleration{};  ///< rad/s2, base joints while joining the reference; 0: not checked
  S rest_speed{};         ///< rad/s at which a joint may be at rest for all that its drive can tell

  /// These limits without workspace and joint angles, which a mechanism may have crossed when a halt begins.
  [[nodiscard]] constexpr Limits while_halting() const {
    Limits l = *this;
    l.workspace_x = l.workspace_y = {};
    l.joint_angle = {};
    return l;
  }
};

/// Quantities that the guards check, from the measured state.
template <class S>
struct Measured {
  S abs_sin_type1{};             ///< smallest over the legs
  S sin_type2{};                 ///< D2, > 0 in the assembly mode; 1 without type 2 (RR, four motors)
  S closure{};                   ///< m, 0 without passive encoders
  S x{}, y{};                    ///< effector, m
  Truth<S> working_mode_kept{};  ///< every leg bends to its configured side
  std::array<S, base_joint_count> joint_angle{}, joint_rate{};  ///< rad, rad/s
};

/// Fault of the first limit that `m` is beyond, in a fixed order, joints first. A NaN is beyond every limit.
template <class S>
constexpr Fault guard(const Limits<S>& limit, const Measured<S>& m) {
  for (int i = 0; i < base_joint_count; ++i) {
    const auto u = static_cast<unsigned>(i);
    if (!within(m.joint_rate[u], limit.joint_speed)) return Fault::joint_speed;
    if (!limit.joint_angle[u].contains(m.joint_angle[u])) return Fault::joint_angle;
  }
  if (!(m.closure <= limit.closure)) return Fault::loop_not_closed;
  if (!(m.abs_sin_type1 >= limit.min_abs_sin_type1)) return Fault::type1_singularity;
  if (!(m.sin_type2 >= limit.min_abs_sin_type2)) return Fault::type2_singularity;
  if (!m.working_mode_kept) return Fault::working_mode;
  if (!limit.workspace_x.contains(m.x) || !limit.workspace_y.contains(m.y)) return Fault::workspace;
  return Fault::none;
}

/// Result of limit_torque.
enum class TorqueCheck : std::uint8_t { passed, limited, not_finite };

/// Clamps `torque` to +-limit (N m). not_finite, torque 0: it is not finite, or the limit is NaN or negative.
template <class S>
constexpr TorqueCheck limit_torque(S& torque, S limit) {
  if (!finite(torque) || !(limit >= S(0))) {
    torque = S(0);
    return TorqueCheck::not_finite;
  }
  if (within(torque, limit)) return TorqueCheck::passed;
  torque = torque < S(0) ? -limit : limit;
  return TorqueCheck::limited;
}

}  // namespace esmc
