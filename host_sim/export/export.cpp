#include "host_sim/export/export.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>
#include <string_view>
#include <vector>

#include "host_sim/error.hpp"
#include "host_sim/version.hpp"

namespace esmc::host {
namespace {

/// One bar and the joint that it turns about. Its frame lies in that joint, x along the bar, z along the
/// axis.
struct RigidBar {
  std::string name, joint;
  double length, mass, centre, inertia;        ///< m, kg, m along the bar, kg m2 about the centre
  double damping, dry_friction, rotor;         ///< of the joint: N m s/rad, N m, kg m2
  std::optional<std::array<double, 2>> stops;  ///< rad
  std::optional<double> torque_limit;          ///< N m; of the joints with a motor
  bool driven;                                 ///< has a motor
  double angle, rate;                          ///< at the start: rad, rad/s
};

/// Two bars, the proximal one first.
struct Chain {
  std::vector<RigidBar> bars;
  double base;    ///< x of the base joint, m
  bool mirrored;  ///< its frame is turned by half a turn about the vertical
};

/// Throws InputError for a bar without mass or inertia.
std::vector<Chain> chains_of(const Scene& scene) {
  const bool arm = scene.type == MechanismType::rr;
  const auto viscous = find_effect<ViscousFriction>(scene.effects);
  const auto dry = find_effect<CoulombFriction>(scene.effects);
  const auto stops = find_effect<EndStops>(scene.effects);
  std::vector<Chain> out;
  for (std::size_t leg = 0; leg < (arm ? 1U : 2U); ++leg) {
    const LegParams<double>& p = scene.mechanism.legs[leg];
    Chain chain{{}, arm ? 0.0 : (leg == 0 ? scene.mechanism.l0 : -scene.mechanism.l0), leg == 1};
    for (std::size_t k = 0; k < 2; ++k) {
      const std::size_t i = 2 * leg + k;
      const std::string number = arm ? std::to_string(k + 1) : fmt::format("{}{}", leg + 1, k + 1);
      RigidBar b{.name = "bar" + number,
                 .joint = "theta" + number,
                 .length = k == 0 ? p.l1 : p.l2,
                 .mass = k == 0 ? p.m1 : p.m2,
                 .centre = k == 0 ? p.lg1 : p.lg2,
                 .inertia = k == 0 ? p.J1 : p.J2,
                 .damping = viscous ? viscous->coefficient[i] : 0.0,
                 .dry_friction = dry ? dry->torque[i] : 0.0,
                 .rotor = k == 0 ? 0.0 : p.rotor2,
                 .stops = {},
                 .torque_limit = {},
                 .driven = false,
                 .angle = scene.start_angle[i],
                 .rate = scene.start_rate[i]};
      const std::size_t base = arm ? k : leg;
      if (stops && (arm || k == 0)) b.stops = {stops->lower[base], stops->upper[base]};
      if (!(b.mass > 0.0 && b.inertia > 0.0))
        refuse(
            "{}: the bar of {} has m = {} kg and J = {} kg m2; programs that read MJCF or URDF need m > 0 "
            "and J > 0 (small values will do)",
            scene.file, b.joint, b.mass, b.inertia);
      chain.bars.push_back(b);
    }
    out.push_back(chain);
  }
  const std::vector<std::size_t> joints = scene.motor_joints();
  for (std::size_t m = 0; m < joints.size(); ++m) {
    RigidBar& bar = out[joints[m] / 2].bars[joints[m] % 2];
    bar.driven = true;
    if (scene.closed_loop()) bar.torque_limit = scene.torque_limit[m];  // by the controller
  }
  return out;
}

/// Text for an attribute or a comment: without markup, control characters and "--".
std::string xml_text(const std::string& text) {
  std::string out, legal = printable(text);
  for (const char* none : {"\xEF\xBF\xBE", "\xEF\xBF\xBF"}) {  // U+FFFE, U+FFFF: no characters of XML
    for (std::size_t at = 0; (at = legal.find(none, at)) != std::string::npos;) legal.replace(at, 3, 1, '?');
  }
  constexpr std::string_view marks = "&<>\"";
  constexpr std::array entities{"&amp;", "&lt;", "&gt;", "&quot;"};
  for (const char c : legal) {
    const std::size_t mark = marks.find(c);
    if (c == '-' && out.ends_with('-')) out += ' ';  // "--" would end a comment
    out += mark < entities.size() ? entities[mark] : std::string(1, c);
  }
  return out;
}

/// Text of a comment: conventions, and the effects of the scene that are not in `expressed`.
std::string preamble(const Scene& scene, const std::vector<std::string>& expressed) {
  std::string out = fmt::format(
      "Made by esmc export {} from the scene \"{}\". SI units, radians.\n"
      "     The plane of the mechanism is x, z of the world: (x, y) of the scene is (x, z) here, -z is "
      "down.\n"
      "     Joint values are the scene's: the angle of the proximal bar, and of the distal bar relative to "
      "it.\n",
      version, xml_text(scene.name));
  if (scene.type == MechanismType::five_bar)
    out +=
        "     The frame of leg 2 is turned by half a turn about the vertical, which is how a mechanism in a "
        "plane is mirrored:\n"
        "     theta21, theta22 are positive clockwise, seen along +y.\n";
  out +=
      "     J acts about the axis of the joints. The other two moments of inertia never act; they are set "
      "equal to it.\n";
  std::string left;
  if (const auto dry = find_effect<CoulombFriction>(scene.effects); dry && dry->asymmetry != PerJoint{})
    left = "the difference of dry friction between the directions";
  for (const Effect& e : scene.effects) {
    const std::string name = type_name(e);
    if (std::ranges::find(expressed, name) == expressed.end()) left += (left.empty() ? "" : ", ") + name;
  }
  if (const auto dry = find_effect<CoulombFriction>(scene.effects); dry && dry->regularised > 0.0)
    out += fmt::format("     Dry friction acts in full at any rate; in the scene by tanh(rate / {} rad/s).\n",
                       dry->regularised);
  if (!left.empty()) out += "     Omitted, because this format cannot express it: " + left + ".\n";
  return out;
}

// ---- MJCF ----

/// s: what the simulation integrates by.
double step_of(const Scene& scene) {
  return scene.tick() / std::max(1.0, std::ceil(scene.tick() / scene.step - 1e-9));
}

/// MuJoCo's constraints are springs and dampers in acceleration. As stiff as the step allows (solref: time
/// constant and damping ratio), and as hard as it lets a constraint be (solimp).
std::string hard(const Scene& scene, const char* suffix) {
  return fmt::format("solref{0}=\"{1} 1\" solimp{0}=\"0.9999 0.9999 0.001 0.5 2\"", suffix,
                     4.0 * step_of(scene));
}

std::string joint(const Scene& scene, const RigidBar& b) {
  std::string out =
      fmt::format("<joint name=\"{}\" type=\"hinge\" axis=\"0 0 1\" ref=\"{}\"", b.joint, b.angle);
  if (b.damping > 0.0) out += fmt::format(" damping=\"{}\"", b.damping);
  if (b.dry_friction > 0.0)
    out += fmt::format(" frictionloss=\"{}\" {}", b.dry_friction, hard(scene, "friction"));
  if (b.rotor > 0.0) out += fmt::format(" armature=\"{}\"", b.rotor);
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

// ---- URDF ----

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
      b.joint, b.stops ? "revolute" : "continuous", parent, b.name, x, mirrored ? std::numbers::pi : 0.0);
  if (b.stops || b.torque_limit) {
    out += "    <limit";
    if (b.stops) out += fmt::format(" lower=\"{}\" upper=\"{}\"", (*b.stops)[0], (*b.stops)[1]);
    // 0 would mean that nothing may drive it; the format has no word for a motor without a limit.
    out += fmt::format(" effort=\"{}\" velocity=\"{}\"/>\n", b.torque_limit.value_or(b.driven ? 1e9 : 0.0),
                       scene.limits.joint_speed);
  }
  if (b.damping > 0.0 || b.dry_friction > 0.0)
    out += fmt::format("    <dynamics damping=\"{}\" friction=\"{}\"/>\n", b.damping, b.dry_friction);
  return out + "  </joint>\n";
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
  constexpr double quarter = std::numbers::sqrt2 / 2.0;  // the quaternion of a quarter turn
  out += fmt::format(
      "-->\n<mujoco model=\"{}\">\n"
      "  <compiler angle=\"radian\" inertiafromgeom=\"false\"/>\n"
      "  <option timestep=\"{}\" gravity=\"0 0 {}\" integrator=\"RK4\" solver=\"Newton\" iterations=\"100\" "
      "tolerance=\"1e-14\"/>\n"
      "  <default><geom contype=\"0\" conaffinity=\"0\" rgba=\"0.3 0.5 0.7 1\"/></default>\n"
      "  <worldbody>\n    <body name=\"frame\" quat=\"{} {} 0 0\">\n{}    </body>\n  </worldbody>\n",
      xml_text(scene.name), step_of(scene), -scene.mechanism.g, quarter, quarter, bodies);
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
  if (has_elbow_rotors(scene.mechanism))
    out += "     The rotors behind the elbows' gears are not part of a URDF.\n";
  out += "     Gravity is not part of a URDF; the scene has " + fmt::format("{}", scene.mechanism.g) +
         " m/s2.\n";
  out += fmt::format(
      "-->\n<robot name=\"{}\">\n  <link name=\"world\"/>\n  <link name=\"base\"/>\n"
      "  <joint name=\"frame\" type=\"fixed\">\n    <parent link=\"world\"/>\n    <child link=\"base\"/>\n"
      "    <origin xyz=\"0 0 0\" rpy=\"{} 0 0\"/>\n  </joint>\n",
      xml_text(scene.name), std::numbers::pi / 2.0);
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
