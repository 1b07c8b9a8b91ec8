#pragma once
/// What the reference of a scene asks of its mechanism and motors, tick by tick.

#include <algorithm>
#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "firmware/types.hpp"
#include "host_sim/record/log.hpp"
#include "host_sim/scene/scene.hpp"

namespace esmc::host {

/// Smallest and largest of some values.
struct Extent {
  double low = 1e300, high = -1e300;
  void widen(double v) {
    low = v < low ? v : low;
    high = v > high ? v : high;
  }
  /// Whether a value is beyond [lower, upper].
  [[nodiscard]] bool beyond(const std::array<double, 2>& allowed) const {
    return !(low >= allowed[0] && high <= allowed[1]);
  }
};

/// A state on the reference.
struct Moment {
  std::uint32_t tick = 0;
  std::vector<double> angle, rate;  ///< of all joints, rad and rad/s
};

/// Rates of all joints, rad/s, in the order of the model.
template <class M>
Vec<double, M::joints> joints_of(const typename M::Rates& r) {
  if constexpr (M::joints == 4) {
    return Vec<double, 4>(r.leg[0][0], r.leg[0][1], r.leg[1][0], r.leg[1][1]);
  } else {
    return r;
  }
}

/// Smallest margins and largest demands along the reference, or at the start.
struct Margins {
  double sin_type1 = 1.0, sin_type2 = 1.0;
  std::array<double, 2> joint_speed{};  ///< of the base joints, rad/s
  std::vector<double> torque;           ///< largest per motor, N m
  std::vector<double> torque_limit;     ///< per motor, N m: what it gives at control.torque_limit
  bool together = false;                ///< four motors share the load
  double share = 0.0, share_t = 0.0;    ///< largest share of torque_limit, and when, s
  std::vector<double> share_torque;     ///< per motor at that time, N m
  Extent x, y;                          ///< of the effector's path, m
  std::array<Extent, 2> angle;          ///< of the base joints, rad
  std::vector<double> preload,
      preload_t;  ///< least torque towards control.preload per motor, N m, and when, s
  std::uint32_t ticks = 0, short_ticks = 0;  ///< followed; of them with less torque than needed
  std::vector<double> drive_short;           ///< largest torque that the drive cuts, per motor, N m; 0: none
  double speed_max = 0.0, speed_jump = 0.0, position_jump = 0.0,
         jump_t = 0.0;         ///< of the reference: m or rad, per s; the largest jump of speed, and when, s
  double start_off = 0.0;      ///< m, of the effector at the start from the reference
  double start_speed = 0.0;    ///< m/s, of the reference there
  bool off_reference = false;  ///< start_off is large, and no join leads onto the reference
  double tick_speed = 0.0;     ///< of the reference, m/s or rad/s: what the torque left stops in a tick
  double sag = 0.0;            ///< m, largest, of the effector under pd: the torques over kp
  std::string unreachable;     ///< why the reference cannot be followed; empty: it can

  /// Extent of the effector's path, m.
  [[nodiscard]] double path() const { return std::max({0.0, x.high - x.low, y.high - y.low}); }
};

/// Of the start alone, which the controller guards like every later tick.
Margins start_margins(const Scene& scene);

/// The state on the reference, without join; empty: out of reach. Where the reference is slower than `least`,
/// m/s or rad/s, the state moves on with that.
std::optional<Moment> moment_at(const Scene& scene, std::uint32_t tick, double least = 0.0);

/// False with every joint driven and measured: type 2 is then no singularity of the loop.
[[nodiscard]] bool guarded_type2(const Scene& scene);

/// Delay, s, from a tick to the effect of its torque: compute_delay plus, with bit_timing, the longest time
/// on the bus from sample to torque (no bound: a tick); `usual`: the usual time, if less than a tick.
[[nodiscard]] double torque_delay(const Scene& scene, bool usual = false);

/// Columns of check.csv: what the reference asks of each joint and motor, tick by tick.
std::vector<std::string> check_columns(const Scene& scene);

/// Follows the reference for at most 2e6 ticks, a row of `log` each. Throws RunError where it is interrupted.
Margins margins(const Scene& scene, Log& log);

}  // namespace esmc::host
