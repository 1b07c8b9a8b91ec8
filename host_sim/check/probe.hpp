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
inline constexpr std::uint32_t slow_ticks = 80;    ///< of them, of the scene at a lower rate

/// A part of a scene as it ran.
struct ProbePart {
  enum class Kind {
    begin,    ///< the start of the scene
    slow,     ///< at a lower rate, from the start, and from just before a late load
    typical,  ///< from a state on the reference; the mean of these parts is that of the run
  };
  double t = 0.0;  ///< s, where it begins
  std::uint32_t ticks = 0;
  double rate_hz = 0.0;
  Kind kind = Kind::typical;
  double change = 0.0;               ///< mean change of torque per tick, as share of torque_limit, at the end
  double growth = 1.0;               ///< of that change per tick
  double saturated = 0.0;            ///< share of the ticks at the end; `slow`: of all
  double error = 0.0;                ///< m, largest of the effector; `slow`: once settled
  std::string fault{};               ///< that ended it; empty: none
  double fault_t = 0.0;              ///< s, of the fault
  std::optional<double> diverged{};  ///< s, from when on the state was not finite
};

/// Runs at most probe_ticks of a closed loop: its start, the scene at a lower rate (for what takes longer
/// than these ticks), and three places along the reference; a scene that is no longer than that as a whole.
/// Of a start off the reference more is run, and nothing at a lower rate.
std::vector<ProbePart> probe_scene(const Scene& scene, const Margins& m);
/// Share of the ticks in which the motors were saturated at the lower rate; empty: not all of the scene ran
/// so, or it rang or ended in a fault.
std::optional<double> saturated_ticks(const Scene& scene, const std::vector<ProbePart>& parts);
/// Adds findings on the loop as it ran.
void judge_probe(const Scene& scene, const Margins& m, const std::vector<ProbePart>& parts, Findings& f);

}  // namespace esmc::host
