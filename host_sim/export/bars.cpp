#include "host_sim/export/bars.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <string_view>

#include "host_sim/error.hpp"
#include "host_sim/version.hpp"

namespace esmc::host {
namespace {

void require_inertia(const Scene& scene, const RigidBar& b) {
  if (b.mass > 0.0 && b.inertia > 0.0) return;
  refuse(
      "{}: the bar of {} has m = {} kg and J = {} kg m2; programs that read MJCF or URDF need m > 0 and J > "
      "0 (small values will do)",
      scene.file, b.joint, b.mass, b.inertia);
}

}  // namespace

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
                 .stops = {},
                 .torque_limit = {},
                 .angle = scene.start_angle[i],
                 .rate = scene.start_rate[i]};
      const std::size_t base = arm ? k : leg;
      if (stops && (arm || k == 0)) b.stops = {stops->lower[base], stops->upper[base]};
      require_inertia(scene, b);
      chain.bars.push_back(b);
    }
    out.push_back(chain);
  }
  const std::vector<std::size_t> joints = scene.motor_joints();
  for (std::size_t m = 0; m < std::min(joints.size(), scene.torque_limit.size()); ++m)
    out[joints[m] / 2].bars[joints[m] % 2].torque_limit = scene.torque_limit[m];
  return out;
}

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
  std::vector<std::string> seen = expressed;
  std::string left;
  for (const Effect& e : scene.effects) {
    const std::string name = type_name(e);
    if (std::find(seen.begin(), seen.end(), name) != seen.end()) continue;
    seen.push_back(name);
    left += (left.empty() ? "" : ", ") + name;
  }
  if (!left.empty()) out += "     Left out, because this format cannot say it: " + left + ".\n";
  return out;
}

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

}  // namespace esmc::host
