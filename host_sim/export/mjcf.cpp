#include <fmt/format.h>

#include "host_sim/export/bars.hpp"
#include "host_sim/export/export.hpp"

namespace esmc::host {
namespace {

constexpr double half_root = 0.70710678118654752440;  // of 2: the quaternion of a quarter turn

/// MuJoCo's constraints are springs and dampers in acceleration. As stiff as the step allows (solref: time
/// constant and damping ratio), and as hard as it lets a constraint be (solimp).
std::string hard(const Scene& scene, const char* suffix) {
  return fmt::format("solref{0}=\"{1} 1\" solimp{0}=\"0.9999 0.9999 0.001 0.5 2\"", suffix, 4.0 * scene.step);
}

std::string joint(const Scene& scene, const RigidBar& b) {
  std::string out =
      fmt::format("<joint name=\"{}\" type=\"hinge\" axis=\"0 0 1\" ref=\"{}\"", b.joint, b.angle);
  if (b.damping > 0.0) out += fmt::format(" damping=\"{}\"", b.damping);
  if (b.dry_friction > 0.0)
    out += fmt::format(" frictionloss=\"{}\" {}", b.dry_friction, hard(scene, "friction"));
  if (b.stops)
    out += fmt::format(" limited=\"true\" range=\"{} {}\" {}", (*b.stops)[0], (*b.stops)[1],
                       hard(scene, "limit"));
  return out + "/>\n";
}

std::string chain_text(const Scene& scene, const Chain& chain) {
  std::string out, indent = "      ";
  double x = 0.0;
  if (!chain.bars.empty() && scene.type == MechanismType::five_bar) {
    out += fmt::format("{}<body name=\"{}\" pos=\"{} 0 0\"{}>\n", indent, chain.mirrored ? "leg2" : "leg1",
                       chain.base, chain.mirrored ? " quat=\"0 0 1 0\"" : "");
    indent += "  ";
  }
  for (const RigidBar& b : chain.bars) {
    out += fmt::format("{}<body name=\"{}\" pos=\"{} 0 0\" axisangle=\"0 0 1 {}\">\n", indent, b.name, x,
                       b.angle);
    indent += "  ";
    out += indent + joint(scene, b);
    out += fmt::format("{}<inertial pos=\"{} 0 0\" mass=\"{}\" diaginertia=\"{} {} {}\"/>\n", indent,
                       b.centre, b.mass, b.inertia, b.inertia, b.inertia);
    out += fmt::format("{}<geom type=\"capsule\" fromto=\"0 0 0 {} 0 0\" size=\"{}\"/>\n", indent, b.length,
                       0.03 * b.length);
    x = b.length;
  }
  if (!chain.mirrored)
    out += fmt::format("{}<site name=\"effector\" pos=\"{} 0 0\" size=\"{}\"/>\n", indent, x, 0.04 * x);
  if (!chain.mirrored && scene.type == MechanismType::five_bar && scene.mechanism.m0 > 0.0) {
    out += fmt::format(
        "{0}<body name=\"effector_mass\" pos=\"{1} 0 0\">\n{0}  <inertial pos=\"0 0 0\" mass=\"{2}\" "
        "diaginertia=\"0 0 0\"/>\n{0}</body>\n",
        indent, x, scene.mechanism.m0);
  }
  while (indent.size() > 6) {
    indent.resize(indent.size() - 2);
    out += indent + "</body>\n";
  }
  return out;
}

std::string motors(const Scene& scene, const std::vector<Chain>& chains) {
  const auto saturation = find_effect<TorqueSaturation>(scene.effects);
  std::string out;
  int number = 0;
  for (const std::size_t joint : scene.motor_joints()) {
    const RigidBar& b = chains[joint / 2].bars[joint % 2];
    out += fmt::format("    <motor name=\"motor{}\" joint=\"{}\"", ++number, b.joint);
    if (b.torque_limit)
      out += fmt::format(" ctrllimited=\"true\" ctrlrange=\"{} {}\"", -*b.torque_limit, *b.torque_limit);
    if (saturation)
      out +=
          fmt::format(" forcelimited=\"true\" forcerange=\"{} {}\"", -saturation->limit, saturation->limit);
    out += "/>\n";
  }
  return out;
}

}  // namespace

std::string mjcf(const Scene& scene) {
  const std::vector<Chain> chains = chains_of(scene);
  std::string bodies, angles, rates;
  for (const Chain& c : chains) {
    bodies += chain_text(scene, c);
    for (const RigidBar& b : c.bars) {
      angles += fmt::format("{}{}", angles.empty() ? "" : " ", b.angle);
      rates += fmt::format("{}{}", rates.empty() ? "" : " ", b.rate);
    }
  }
  std::string out = "<!-- " + preamble(scene, {ViscousFriction::type, CoulombFriction::type, EndStops::type,
                                               TorqueSaturation::type});
  if (find_effect<EndStops>(scene.effects))
    out += "     End stops do not rebound here, and have MuJoCo's stiffness.\n";
  if (scene.type == MechanismType::five_bar)
    out +=
        "     The tips of bar12 and bar22 are held together by a constraint. The bodies stand in the start "
        "pose, where it is met.\n";
  out += fmt::format(
      "-->\n<mujoco model=\"{}\">\n"
      "  <compiler angle=\"radian\" inertiafromgeom=\"false\"/>\n"
      "  <option timestep=\"{}\" gravity=\"0 0 {}\" integrator=\"RK4\" solver=\"Newton\" iterations=\"100\" "
      "tolerance=\"1e-14\"/>\n"
      "  <default><geom contype=\"0\" conaffinity=\"0\" rgba=\"0.3 0.5 0.7 1\"/></default>\n"
      "  <worldbody>\n    <body name=\"frame\" quat=\"{} {} 0 0\">\n{}    </body>\n  </worldbody>\n",
      xml_text(scene.name), scene.step, -scene.mechanism.g, half_root, half_root, bodies);
  if (scene.type == MechanismType::five_bar) {
    out += fmt::format(
        "  <equality>\n    <connect name=\"closure\" body1=\"bar12\" body2=\"bar22\" anchor=\"{} 0 0\" "
        "{}/>\n  </equality>\n",
        scene.mechanism.legs[0].l2, hard(scene, ""));
  }
  out += "  <actuator>\n" + motors(scene, chains) + "  </actuator>\n";
  out += fmt::format("  <keyframe><key name=\"start\" qpos=\"{}\" qvel=\"{}\"/></keyframe>\n</mujoco>\n",
                     angles, rates);
  return out;
}

}  // namespace esmc::host
