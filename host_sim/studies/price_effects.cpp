/// Effects that a scene does not name, with plausible parameters.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "host_sim/check/margins.hpp"
#include "host_sim/scene/toml_text.hpp"
#include "host_sim/studies/price.hpp"

namespace esmc::host {
namespace {

constexpr double pi = 3.14159265358979323846;

/// Sizes that parameters are made from.
struct Sizes {
  double torque;   ///< N m, of a base motor
  double speed;    ///< rad/s, of a base joint
  double inertia;  ///< kg m2, of a leg about its base, its distal bar as a point
  double mass;     ///< kg, distal bars and effector
  double reach;    ///< m
  std::array<Extent, 2> angle;
};

Sizes sizes_of(const Scene& s) {
  Log log(nullptr, {}, 0);
  const Margins m = margins(s, log);
  const LegParams<double>& leg = s.mechanism.legs[0];
  Sizes z{};
  z.inertia = leg.J1 + leg.m1 * leg.lg1 * leg.lg1 + leg.m2 * leg.l1 * leg.l1;
  z.mass = leg.m2 + (s.type == MechanismType::five_bar ? s.mechanism.legs[1].m2 + s.mechanism.m0 : 0.0);
  z.reach = leg.l1 + leg.l2;
  z.speed = std::max(m.joint_speed[0], m.joint_speed[1]);
  if (!(z.speed > 0.1)) z.speed = 1.0;
  for (const double limit : s.torque_limit) z.torque = z.torque > 0.0 ? std::min(z.torque, limit) : limit;
  if (!(z.torque > 0.0)) z.torque = (leg.m1 * leg.lg1 + leg.m2 * z.reach) * std::max(s.mechanism.g, 1.0);
  for (std::size_t i = 0; i < 2; ++i) {
    z.angle[i] = m.angle[i];
    z.angle[i].widen(s.start_angle[i * s.start_angle.size() / 2]);
  }
  return z;
}

/// Per joint of a leg: the second one of an arm has a motor too, that of a five-bar only a bearing.
std::string per_joint(const Scene& s, double base) {
  return fmt::format("[{:.3g}, {:.3g}]", base, s.type == MechanismType::rr ? 0.5 * base : 0.2 * base);
}

}  // namespace

std::string Candidate::parameters() const {
  toml::table rest = entry;
  rest.erase("type");
  std::string text = toml_text(rest), out;
  if (!text.empty()) text.pop_back();
  for (const char c : text) out += c == '\n' ? std::string(", ") : std::string(1, c);
  return out;
}

std::vector<Candidate> plausible_effects(const Scene& s) {
  const Sizes z = sizes_of(s);
  const double rotor = 0.1 * z.inertia, resonance = 2.0 * pi * s.rate_hz / 20.0;  // rad/s
  const double stiffness = resonance * resonance / (1.0 / rotor + 1.0 / z.inertia);
  const std::string gear = fmt::format("stiffness = {:.3g}, damping = {:.3g}, rotor_inertia = {:.3g}",
                                       stiffness, 0.04 * stiffness / resonance, rotor);
  const auto stops = [&](double side) {
    const auto at = [&](std::size_t i) { return side < 0.0 ? z.angle[i].low - 0.2 : z.angle[i].high + 0.2; };
    return fmt::format("[{:.4g}, {:.4g}]", at(0), at(1));
  };
  const double quantum = 2.0 * pi / 16384.0;
  std::string list = "effects = [\n";
  const auto add = [&](const char* type, const std::string& parameters) {
    list += fmt::format("{{ type = \"{}\", {} }},\n", type, parameters);
  };
  add(ViscousFriction::type, "coefficient = " + per_joint(s, 0.05 * z.torque / z.speed));
  add(CoulombFriction::type, "torque = " + per_joint(s, 0.05 * z.torque));
  add(JointFlexibility::type, gear);
  add(Backlash::type, "gap = 0.001, " + gear);
  add(EndStops::type, fmt::format("lower = {}, upper = {}, stiffness = {:.3g}, restitution = 0.5", stops(-1),
                                  stops(1), 20.0 * z.torque));
  add(Payload::type, fmt::format("mass = {:.3g}", 0.1 * z.mass));
  add(ExternalForce::type,
      fmt::format("force = [{:.3g}, 0.0], from = {:.4g}", 0.05 * z.torque / z.reach, 0.5 * s.duration));
  add(TorqueLag::type, fmt::format("time_constant = {:.3g}", std::max(1e-6, 0.5 * s.tick())));
  add(TorqueRipple::type, fmt::format("amplitude = {:.3g}, per_turn = 14.0", 0.01 * z.torque));
  add(TorqueSaturation::type, fmt::format("limit = {:.3g}", 0.8 * z.torque));
  if (s.closed_loop()) {  // without ticks and readings these do nothing
    add(ThermalLimit::type, fmt::format("continuous = {:.3g}, time_constant = 10.0", z.torque / 3.0));
    add(Encoder::type, "bits = 14");
    add(SensorNoise::type, fmt::format("sigma = {:.2g}", 0.25 * quantum));
    add(SensorBias::type, "angle = [0.001, 0.0]");
    add(SensorDelay::type, "ticks = 1");
    add(Jitter::type, fmt::format("sigma = {:.3g}", 0.05 * s.tick()));
    add(ComputeDelay::type, fmt::format("time = {:.3g}", s.tick()));
  }
  std::vector<Candidate> out;
  const toml::table parsed = toml::parse(list + "]");
  for (const toml::node& item : *parsed["effects"].as_array()) {
    const Candidate c{*item.as_table(), false};
    const auto same = [&](const Effect& e) { return type_name(e) == c.type(); };
    if (std::ranges::none_of(s.effects, same)) out.push_back(c);
  }
  return out;
}

}  // namespace esmc::host
