#pragma once
/// `esmc accuracy`: the cost of accuracy in time, measured in every run.

#include <nlohmann/json_fwd.hpp>
#include <string>

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

/// Closed loops of the comparison scenario with one thing changed, a flat object each: the parameter that
/// varies (study) and its value (setting), errors, mean change of torque per tick, time per tick of the whole
/// loop, fault or null.
nlohmann::ordered_json tracking_study(bool quick);

/// Effects on the comparison scenario, a flat object each: the largest distance between the effector with it
/// and without, errors, states, time per step of the plant. What is without it is integrated by RK4.
nlohmann::ordered_json effect_study();

/// Runs `esmc accuracy`. Returns the exit status: 1 where an integrator did not show its order.
int run_accuracy(const AccuracyOptions& o);

}  // namespace esmc::host
