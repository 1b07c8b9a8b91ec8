#pragma once
/// A few ticks of a scene, simulated where analysis does not suffice: does the loop ring, do the motors
/// saturate?

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "host_sim/check/findings.hpp"
#include "host_sim/check/margins.hpp"
#include "host_sim/scene/scene.hpp"

namespace esmc::host {

inline constexpr std::uint32_t probe_ticks = 200;  ///< at most, of all parts together

/// A part of a scene as it ran from a state on its reference.
struct ProbePart {
  double t = 0.0;  ///< s, where it begins
  std::uint32_t ticks = 0;
  bool typical = true;               ///< one of those whose mean is that of the run
  double change = 0.0;               ///< mean change of torque per tick, as share of torque_limit, at the end
  double growth = 1.0;               ///< of that change per tick
  double saturated = 0.0;            ///< share of the ticks at the end
  double error = 0.0;                ///< m, largest of the effector
  std::string fault{};               ///< that ended it; empty: none
  std::optional<double> diverged{};  ///< s, from when on the state was not finite
};

/// Runs at most probe_ticks of a closed loop: its start, from where the torque is largest, and four places
/// along the reference; a scene that is no longer than that as a whole. Of a start off the reference more is
/// run, and nothing where the torque is largest.
std::vector<ProbePart> probe_scene(const Scene& scene, const Margins& m);
/// Adds findings on the loop as it ran.
void judge_probe(const Scene& scene, const Margins& m, const std::vector<ProbePart>& parts, Findings& f);

}  // namespace esmc::host
