#pragma once
/// `esmc accuracy`: the cost of accuracy in time, measured in every run.

#include <string>
#include <vector>

#include "host_sim/problems/work_precision.hpp"

namespace esmc::host {

struct AccuracyOptions {
  bool quick = false;
  bool json = false;
  std::string out;
  std::string command_line;
};

/// Error against work of every integrator on every problem, and the orders shown. `effort` scales the CPU
/// time.
WorkPrecision integrator_study(double effort);

/// One closed loop of the comparison scenario with one thing changed.
struct TrackingPoint {
  std::string study, setting;  ///< the parameter that varies, and its value
  double settled_max_rad = 0.0, settled_rms_m = 0.0;
  double chatter_nm = 0.0;   ///< mean change of torque per tick
  double us_per_tick = 0.0;  ///< of the whole loop, plant included
  std::string fault;         ///< empty: none
};
std::vector<TrackingPoint> tracking_study(bool quick);

/// An effect on the comparison scenario: the deviation without it, and its cost.
struct EffectPoint {
  std::string effect, parameters, integrator;
  double deviation_m = 0.0;      ///< largest distance between the effector with it and without
  double settled_max_rad = 0.0;  ///< with it
  double without_rad = 0.0;      ///< without it, by RK4 at the same step
  int states = 0;                ///< added
  double ns_per_step = 0.0;      ///< of the plant's step, with it
  double ns_without = 0.0;       ///< without it, by RK4
  std::string fault;
};
std::vector<EffectPoint> effect_study();

/// Runs `esmc accuracy`. Returns the exit status: 1 where an integrator did not show its order.
int run_accuracy(const AccuracyOptions& o);

}  // namespace esmc::host
