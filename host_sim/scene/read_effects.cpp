#include "host_sim/scene/readers.hpp"

#include <fmt/format.h>

#include <tuple>
#include <utility>

namespace esmc::host {
namespace {

/// Reads one table into the effect its `type` names.
class EffectReader {
 public:
  EffectReader(Section& s, const Scene& scene) : s_(s), scene_(scene) {}

  Effect read(const std::string& type) {
    if (type == ViscousFriction::type) return ViscousFriction{per_joint("coefficient")};
    if (type == CoulombFriction::type)
      return CoulombFriction{per_joint("torque"), s_.optional_number("regularised").value_or(0.0)};
    if (type == JointFlexibility::type) {
      return JointFlexibility{per_motor("stiffness"), per_motor("damping"), per_motor("rotor_inertia")};
    }
    if (type == Backlash::type) {
      return Backlash{s_.number("gap"), s_.number("stiffness"), s_.number("damping"),
                      s_.number("rotor_inertia")};
    }
    if (type == EndStops::type) return end_stops();
    if (type == Payload::type) {
      const auto [from, to] = interval();
      return Payload{s_.number("mass"), from, to};
    }
    if (type == ExternalForce::type) return external_force();
    if (type == TorqueLag::type) return TorqueLag{s_.number("time_constant")};
    if (type == TorqueSaturation::type) return TorqueSaturation{s_.number("limit")};
    if (type == TorqueRipple::type) return TorqueRipple{s_.number("amplitude"), s_.number("per_turn")};
    if (type == ThermalLimit::type) return ThermalLimit{s_.number("continuous"), s_.number("time_constant")};
    if (type == Encoder::type) {
      const int bits = s_.integer("bits");
      return Encoder{bits, s_.number("bandwidth")};
    }
    if (type == SensorNoise::type) return SensorNoise{s_.number("sigma"), s_.number("bandwidth")};
    if (type == SensorBias::type) return SensorBias{per_joint("angle")};
    if (type == SensorDelay::type) return SensorDelay{s_.integer("ticks")};
    if (type == Jitter::type) return Jitter{s_.number("sigma")};
    if (type == ComputeDelay::type) return ComputeDelay{s_.number("time")};
    return on_bus(type);
  }

 private:
  PerJoint filled(const std::vector<double>& v) const {
    PerJoint out{};
    for (std::size_t i = 0; i < 4; ++i) out[i] = v.size() == 4 ? v[i] : v[i % v.size()];
    return out;
  }
  PerJoint per_joint(const char* key) {
    const auto sizes = scene_.joints() == 4 ? std::vector<std::size_t>{2, 4} : std::vector<std::size_t>{2};
    return filled(s_.numbers(key, sizes));
  }
  PerJoint per_motor(const char* key) {
    return filled(s_.each(key, static_cast<std::size_t>(scene_.motors())));
  }
  std::pair<double, double> interval() {
    const double from = s_.number("from"), to = s_.number("to");
    if (!(from < to)) s_.fail("to", "must be later than from");
    return {from, to};
  }
  Span span() {
    const auto [from, to] = interval();
    return {from, to};
  }
  int drive() {
    const int n = s_.integer("drive"), drives = static_cast<int>(scene_.drives.nodes.size());
    if (n > drives)
      s_.fail("drive", fmt::format("is {}, and there are {} entries in [drives] and [sensors]", n, drives));
    return n;
  }
  Effect on_bus(const std::string& type) {
    if (type == Loss::type) {
      const std::string at = s_.text("at");
      return Loss{s_.number("probability"), at != "drives", at != "controller", span()};
    }
    if (type == Duplication::type) return Duplication{s_.number("probability"), span()};
    if (type == Corruption::type) {
      const double detected = s_.number("detected"), undetected = s_.number("undetected");
      if (!(detected > 0.0 || undetected > 0.0)) s_.fail("", "needs detected > 0 or undetected > 0");
      return Corruption{detected, undetected, s_.integer("bits"), span()};
    }
    if (type == BabblingNode::type) return babbling_node();
    if (type == BusOff::type) {
      const double at = s_.number("at");
      return BusOff{at, drive(), s_.boolean("restart")};
    }
    if (type == DriveDropout::type) {
      const int which = drive();
      return DriveDropout{which, span()};
    }
    return BitTiming{};
  }
  Effect babbling_node() {
    BabblingNode b;
    b.identifier = static_cast<std::uint32_t>(s_.integer("identifier"));
    b.extended = s_.boolean("extended");
    if (!b.extended && b.identifier > 0x7FF)
      s_.fail("identifier", "is at most 2047 (0x7FF) without extended = true");
    b.size = s_.integer("size");
    b.rate_hz = s_.number("rate_hz");
    b.when = span();
    return b;
  }
  Effect end_stops() {
    const EndStops e{s_.pair("lower"), s_.pair("upper"), s_.optional_number("stiffness"),
                     s_.number("restitution")};
    const std::size_t stride = scene_.start_angle.size() / 2;
    for (std::size_t i = 0; i < 2; ++i) {
      if (!(e.lower[i] < e.upper[i])) s_.fail("lower", "must be below upper for each base joint");
      const double start = scene_.start_angle[i * stride];
      if (!(start >= e.lower[i] && start <= e.upper[i])) {
        s_.fail("", fmt::format("base joint {} starts at {:.6g} rad, beyond its stops", i + 1, start));
      }
    }
    return e;
  }
  Effect external_force() {
    ExternalForce e;
    e.human = s_.text("kind") == "human";
    std::tie(e.from, e.to) = interval();
    if (e.human) {
      e.anchor = s_.pair("anchor");
      e.stiffness = s_.number("stiffness");
      e.damping = s_.number("damping");
    } else {
      e.force = s_.pair("force");
    }
    return e;
  }

  Section& s_;
  const Scene& scene_;
};

}  // namespace

std::vector<Effect> read_effects(Section& root, const Scene& scene) {
  std::vector<Effect> out;
  bool gear_given = false;
  for (Section s : root.sections("effects")) {
    s.use_schema("effects");
    const std::string type = s.text("type");
    for (const Effect& e : out) {
      if (type == type_name(e)) s.fail("type", "names an effect for the second time");
    }
    s.use_schema("effects[" + type + "]");
    if (type == Backlash::type) gear_given = s.has("stiffness") || s.has("damping") || s.has("rotor_inertia");
    out.push_back(EffectReader(s, scene).read(type));
    s.finish();
  }
  if (gear_given && find_effect<JointFlexibility>(out)) {
    root.fail("effects",
              "backlash beside joint_flexibility takes that one's stiffness, damping and rotor_inertia: give "
              "its gap only");
  }
  if (find_effect<BabblingNode>(out) && !find_effect<BitTiming>(out)) {
    root.fail(
        "effects",
        "babbling_node needs bit_timing beside it: without it frames take no time and delay no other frame");
  }
  return out;
}

void refuse_bus_effects(const Scene& scene, const std::string& why) {
  for (const Effect& e : scene.effects) {
    if (!acts_on_bus(e)) continue;
    throw InputError(
        scene.bus_effects_where,
        fmt::format(
            "effect '{}' cannot act: {}; allowed on the virtual bus: esmc hil SCENE, without --realtime",
            type_name(e), why));
  }
}

}  // namespace esmc::host
