#pragma once
/// Common parts of MJCF and URDF: bars, their joints, and comments.

#include <optional>
#include <string>
#include <vector>

#include "host_sim/scene/scene.hpp"

namespace esmc::host {

/// One bar and the joint that it turns about. Its frame lies in that joint, x along the bar, z along the
/// axis.
struct RigidBar {
  std::string name, joint;
  double length, mass, centre, inertia;        ///< m, kg, m along the bar, kg m2 about the centre
  double damping, dry_friction;                ///< of the joint: N m s/rad, N m
  std::optional<std::array<double, 2>> stops;  ///< rad
  std::optional<double> torque_limit;          ///< N m; of the joints with a motor
  double angle, rate;                          ///< at the start: rad, rad/s
};

/// Two bars, the proximal one first. Throws InputError for a bar without mass or inertia.
struct Chain {
  std::vector<RigidBar> bars;
  double base;    ///< x of the base joint, m
  bool mirrored;  ///< its frame is turned by half a turn about the vertical
};
std::vector<Chain> chains_of(const Scene& scene);

/// Text of a comment: conventions, and the effects of the scene that are not in `expressed`.
std::string preamble(const Scene& scene, const std::vector<std::string>& expressed);

/// Text for an attribute or a comment: without markup, control characters and "--".
std::string xml_text(const std::string& text);

}  // namespace esmc::host
