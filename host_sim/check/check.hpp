#pragma once
/// `esmc check`: margins of a scene along its reference, of the true mechanism; the sampled loop; steps.

#include <array>
#include <string>
#include <vector>

#include "host_sim/check/findings.hpp"
#include "host_sim/record/log.hpp"
#include "host_sim/record/run_options.hpp"
#include "host_sim/scene/scene.hpp"

namespace esmc::host {

/// `esmc check`: findings about a scene without running it to its end. Exit status 1: unfit.
int run_check(const RunOptions& o);
/// Why a board must not run the scene: the first finding of `esmc check` that is an error, or about torque or
/// gain margins that are used up; or what a bus cannot carry. Empty: none.
std::string refusal_of(const Scene& scene);

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

/// Smallest margins and largest demands along the reference, or at the start.
struct Margins {
  double sin_type1 = 1.0, sin_type2 = 1.0;
  std::array<double, 2> joint_speed{};  ///< of the base joints, rad/s
  std::vector<double> torque;           ///< largest per motor, N m
  bool together = false;                ///< four motors share the load
  double share = 0.0, share_t = 0.0;    ///< largest share of torque_limit, and when, s
  std::vector<double> share_torque;     ///< per motor at that time, N m
  Extent x, y;                          ///< of the effector's path, m
  std::array<Extent, 2> angle;          ///< of the base joints, rad
  std::vector<double> preload,
      preload_t;            ///< least torque towards control.preload per motor, N m, and when, s
  std::string unreachable;  ///< why the reference cannot be followed; empty: it can
};

/// Of the start alone, which the controller guards like every later tick.
Margins start_margins(const Scene& scene);

/// Columns of check.csv: what the reference asks of each joint and motor, tick by tick.
std::vector<std::string> check_columns(const Scene& scene);

/// Follows the reference for at most 2e6 ticks, a row of `log` each. Throws RunError where it is interrupted.
Margins margins(const Scene& scene, Log& log);

/// Adds findings on gains, layer and lambda: docs/theory.md, "Boundary layers and the implicit law".
void judge_gains(const Scene& scene, Findings& f);
/// Adds findings on the layers of `saturation` and `tanh`. `stiffness`: largest decay rate within them, 1/s.
void judge_layer(const Scene& scene, double stiffness, Findings& f);
/// Adds findings on springs too stiff for an explicit method with a fixed step.
void judge_step(const Scene& scene, Findings& f);

}  // namespace esmc::host
