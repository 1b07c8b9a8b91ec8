#pragma once
/// `esmc accuracy`, `esmc eval`, `esmc design` and `esmc plan`.

#include <cstdint>
#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "host_sim/problems/work_precision.hpp"
#include "host_sim/record/run_options.hpp"
#include "host_sim/scene/scene.hpp"

namespace esmc::host {

struct AccuracyOptions {
  bool quick = false;
  bool json = false;
  std::string out;
  std::string command_line;
  // Of a scene:
  std::string scene;  ///< empty: the problems
  std::vector<std::string> sets;
  std::string tolerance;  ///< "X" or "X%"; empty: 1%
  std::string metric;     ///< empty: rms_m, or end without a reference
  bool all_effects = false;
  std::string write;  ///< file for the minimal scene; empty: none
};

/// Error against work of every integrator on every problem, and the orders shown. `effort` scales the CPU
/// time. `after_run`, here and below: called after each run; may throw.
WorkPrecision integrator_study(double effort, const std::function<void()>& after_run);

/// Closed loops of the comparison scenario with one thing changed, a flat object each: the parameter that
/// varies (study) and its value (setting), errors, mean change of torque per tick, time per tick of the whole
/// loop, fault or null.
nlohmann::ordered_json tracking_study(bool quick, const std::function<void()>& after_run);

/// Effects on the comparison scenario, a flat object each: the largest distance between the effector with it
/// and without, errors, states, time per step of the plant. What is without it is integrated by RK4.
nlohmann::ordered_json effect_study(const std::function<void()>& after_run);

/// Runs `esmc accuracy SCENE`: what integrators, effects and the loop cost and change in this scene, and the
/// cheapest scene that stays within a tolerance. Returns 0.
int run_price_list(const AccuracyOptions& o);
/// Runs `esmc accuracy`. Returns the exit status: 1 where an integrator did not show its order.
int run_accuracy(const AccuracyOptions& o);

/// Evaluates every case of a document in the schema of tests/reference/README.md and returns the text of
/// {"cases": [...]} with the computed blocks under the same names. Throws InputError naming file, line, case.
std::string evaluate(const std::string& text, const std::string& file, bool single_precision);

/// Runs `esmc plan`: the program of a scene, timed: its duration, the limits it reaches, its path. Returns 0.
int run_plan(const RunOptions& o);

struct DesignOptions {
  RunOptions run;
  bool workspace = false;      ///< as uncertainty.over = "workspace"
  std::uint64_t simulate = 0;  ///< number of plants from the intervals to simulate
};

/// Runs `esmc design`. Returns 0: gains are printed and every simulated plant stayed in the band; 1: refused,
/// or a plant did not.
int run_design(const DesignOptions& o);

/// The scene, which must have [uncertainty], with plant `index` in place of its own. An even index draws a
/// corner of all intervals, an odd one a point between. Friction and payload are drawn too and replace those
/// effects; the controller's belief stays. Delays are at least those that the controller assumes: of the
/// torque as compute_delay; of measurements, whole ticks as delay, unless there is an encoder or noise.
/// `lengths`: draws l1, l2 and half_base too. Depends on its arguments only. Throws InputError where the
/// start is out of this plant's reach.
Scene sampled_plant(const Scene& scene, std::uint64_t seed, std::uint64_t index, bool lengths);

/// Parameters of the scene's own mechanism and effects outside its [uncertainty], which it must have, one
/// phrase each.
std::vector<std::string> outside(const Scene& scene);
/// Types of the scene's effects that the guarantee of a design does not cover: all but friction, payload and,
/// with the implicit law, delays that the controller assumes.
std::vector<std::string> not_covered(const Scene& scene);

}  // namespace esmc::host
