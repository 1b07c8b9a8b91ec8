#pragma once
/// The checks no torque passes without. Plain scalars: nothing here knows a mechanism or a law.
/// Every condition is what is allowed (<=, >=), never what is forbidden: a NaN then fails it.

#include <array>
#include <cstdint>
#include <limits>

#include "firmware/safety/faults.hpp"

namespace esmc {

inline constexpr int base_joints = 2;

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

/// A closed interval.
template <class S>
struct Range {
  S lower = -std::numeric_limits<S>::max();
  S upper = std::numeric_limits<S>::max();
  [[nodiscard]] constexpr bool contains(S v) const { return lower <= v && v <= upper; }
};

/// What must not be crossed; each a latched fault.
template <class S>
struct Limits {
  S min_abs_sin_type1{};                  ///< of sin theta_j2, dimensionless
  S min_abs_sin_type2{};                  ///< of D2, dimensionless
  S joint_speed{};                        ///< rad/s, base joints
  S closure{};                            ///< m: how far the leg tips may be apart with passive encoders
  Range<S> workspace_x{}, workspace_y{};  ///< m
  std::array<Range<S>, base_joints> joint_angle{};  ///< rad
  std::uint32_t max_age_ticks = 0;                  ///< missed samples that are extrapolated
  S feedback_jump{};      ///< rad per tick by which an angle may differ from what its rate says; 0: any
  S join_acceleration{};  ///< rad/s2, base joints on the way onto the reference; 0: any

  /// Without the limits that a mechanism may already have crossed while it is brought to rest.
  [[nodiscard]] constexpr Limits while_halting() const {
    Limits l = *this;
    l.workspace_x = l.workspace_y = {};
    l.joint_angle = {};
    return l;
  }
};

/// What the guards look at, taken from the measured state.
template <class S>
struct Measured {
  S abs_sin_type1{};  ///< smallest over the legs
  S sin_type2{};      ///< D2, > 0 in the assembly mode; 1 where nothing is to guard (RR, four motors)
  S closure{};        ///< m, 0 without passive encoders
  S x{}, y{};         ///< effector, m
  bool working_mode_kept = false;
  std::array<S, base_joints> joint_angle{}, joint_rate{};
};

template <class S>
constexpr Fault guard(const Limits<S>& limit, const Measured<S>& m) {
  for (int i = 0; i < base_joints; ++i) {
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

/// What became of a torque at the clamp.
enum class TorqueCheck : std::uint8_t { passed, limited, not_finite };

/// Hard clamp to +-limit. A torque that is not finite becomes 0 and is reported, never clamped to the limit;
/// so does every torque when the limit itself is none (NaN or negative).
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
