#include <fmt/format.h>

#include "host_sim/export/bars.hpp"
#include "host_sim/export/export.hpp"

namespace esmc::host {
namespace {

constexpr double pi = 3.14159265358979323846;

std::string link(const std::string& name, double mass, double centre, double inertia) {
  return fmt::format(
      "  <link name=\"{}\">\n    <inertial>\n      <origin xyz=\"{} 0 0\"/>\n      <mass value=\"{}\"/>\n"
      "      <inertia ixx=\"{}\" iyy=\"{}\" izz=\"{}\" ixy=\"0\" ixz=\"0\" iyz=\"0\"/>\n    </inertial>\n  "
      "</link>\n",
      name, centre, mass, inertia, inertia, inertia);
}

std::string fixed(const std::string& name, const std::string& parent, const std::string& child, double x) {
  return fmt::format(
      "  <joint name=\"{}\" type=\"fixed\">\n    <parent link=\"{}\"/>\n    <child link=\"{}\"/>\n"
      "    <origin xyz=\"{} 0 0\"/>\n  </joint>\n",
      name, parent, child, x);
}

std::string hinge(const Scene& scene, const RigidBar& b, const std::string& parent, double x, bool mirrored) {
  std::string out = fmt::format(
      "  <joint name=\"{}\" type=\"{}\">\n    <parent link=\"{}\"/>\n    <child link=\"{}\"/>\n"
      "    <origin xyz=\"{} 0 0\" rpy=\"0 {} 0\"/>\n    <axis xyz=\"0 0 1\"/>\n",
      b.joint, b.stops ? "revolute" : "continuous", parent, b.name, x, mirrored ? pi : 0.0);
  if (b.stops || b.torque_limit) {
    out += "    <limit";
    if (b.stops) out += fmt::format(" lower=\"{}\" upper=\"{}\"", (*b.stops)[0], (*b.stops)[1]);
    out += fmt::format(" effort=\"{}\" velocity=\"{}\"/>\n", b.torque_limit.value_or(0.0),
                       scene.limits.joint_speed);
  }
  if (b.damping > 0.0 || b.dry_friction > 0.0)
    out += fmt::format("    <dynamics damping=\"{}\" friction=\"{}\"/>\n", b.damping, b.dry_friction);
  return out + "  </joint>\n";
}

}  // namespace

std::string urdf(const Scene& scene) {
  const bool loop = scene.type == MechanismType::five_bar;
  const std::vector<Chain> chains = chains_of(scene);
  std::string out = "<?xml version=\"1.0\"?>\n<!-- " +
                    preamble(scene, {ViscousFriction::type, CoulombFriction::type, EndStops::type});
  if (loop)
    out +=
        "     URDF describes trees, so the joint between the distal bars is cut. The links effector (end of "
        "leg 1) and\n"
        "     effector_cut (end of leg 2) are the same point of the mechanism: a program that can close "
        "loops has to hold\n"
        "     their origins together; the bars turn freely about it. Without that this is two arms.\n";
  out += "     Gravity is not part of a URDF; the scene has " + fmt::format("{}", scene.mechanism.g) +
         " m/s2.\n";
  out += fmt::format(
      "-->\n<robot name=\"{}\">\n  <link name=\"world\"/>\n  <link name=\"base\"/>\n"
      "  <joint name=\"frame\" type=\"fixed\">\n    <parent link=\"world\"/>\n    <child link=\"base\"/>\n"
      "    <origin xyz=\"0 0 0\" rpy=\"{} 0 0\"/>\n  </joint>\n",
      xml_text(scene.name), pi / 2.0);
  for (const Chain& c : chains) {
    std::string parent = "base";
    double x = c.base;
    for (const RigidBar& b : c.bars) {
      out += link(b.name, b.mass, b.centre, b.inertia);
      out += hinge(scene, b, parent, x, c.mirrored && parent == "base");
      parent = b.name;
      x = b.length;
    }
    const std::string tip = c.mirrored ? "effector_cut" : "effector";
    const double mass = loop && !c.mirrored ? scene.mechanism.m0 : 0.0;
    out += mass > 0.0 ? link(tip, mass, 0.0, 0.0) : "  <link name=\"" + tip + "\"/>\n";
    out += fixed(tip + "_fixed", parent, tip, x);
  }
  return out + "</robot>\n";
}

}  // namespace esmc::host
