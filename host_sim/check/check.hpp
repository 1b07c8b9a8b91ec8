#pragma once
/// `esmc check`: margins of a scene along its reference, of the true mechanism; the sampled loop; steps.

#include <optional>
#include <string>

#include "host_sim/check/findings.hpp"
#include "host_sim/record/run_options.hpp"
#include "host_sim/scene/scene.hpp"

namespace esmc::host {

struct Margins;

/// `esmc check`: findings about a scene without running it to its end. Exit status 1: unfit.
int run_check(const RunOptions& o);
/// Why not to run the scene: the first finding of `esmc check` that is an error. `on_bus`, why a board must
/// not: also one about torque or gain margins that are used up, or what a bus cannot carry. Empty: none.
std::string refusal_of(const Scene& scene, bool on_bus = true);

/// `esmc margins`: by how much loop gain, phase and delay may grow before the sampled loop rings, at poses
/// along the reference. Throws InputError where no law closes the loop, or the reference leaves the reach.
int run_margins(const RunOptions& o);

/// Adds findings on limits and torques at the start and along the reference (margins.hpp), on gains and
/// steps. `saturated`: share of the ticks as simulated (saturated_ticks()), if known.
void judge_motion(const Scene& scene, const Margins& start, const Margins& m, std::optional<double> saturated,
                  Findings& f);
/// Adds hints at lengths, mass centres, inertias and angles that look like another unit, and at a fixed step
/// longer than 1.5 ticks.
void judge_units(const Scene& scene, Findings& f);
/// Adds findings on a linear law, or one with a layer, whose sampled loop is unstable at poses along the
/// reference. None where the controller does not run there.
void judge_stability(const Scene& scene, Findings& f);
/// Adds findings on the disturbance observer and, for sliding laws, on gains, lambda, the delay that the law
/// is told, and the layer (by judge_layer): docs/theory.md, "Boundary layers and the implicit law". Throws
/// InputError like robust_gains() where a law with a layer takes gain = "robust".
void judge_gains(const Scene& scene, Findings& f);
/// Adds findings on the layers of `saturation` and `tanh`. `stiffness`: largest decay rate within them, 1/s.
void judge_layer(const Scene& scene, double stiffness, Findings& f);
/// Adds findings on springs too stiff for an explicit method with a fixed step.
void judge_step(const Scene& scene, Findings& f);

}  // namespace esmc::host
