#include "host_sim/scene/reader.hpp"

#include "host_sim/scene/fields.hpp"
#include "host_sim/scene/scene.hpp"

namespace esmc::host {
namespace {

void read_span(Section& s, double& from, double& to) {
  from = s.number("from");
  to = s.number("to");
  if (!(from < to)) s.fail("to", "must be later than from");
}

// What the table of keys does not say of an effect that has been read.
template <class T>
void complete(Section& s, const Scene& scene, T& e) {
  if constexpr (requires { e.drive; }) {
    if (const auto drives = static_cast<int>(scene.drives.nodes.size()); e.drive > drives)
      s.fail("drive", "is {}, and there are {} entries in [drives] and [sensors]", e.drive, drives);
  }
}
void complete(Section& s, const Scene&, CoulombFriction& e) {
  e.regularised = s.optional_number("regularised").value_or(0.0);
  require_friction(s, e.torque, e.asymmetry, "torque");
}
void complete(Section& s, const Scene& scene, EndStops& e) {
  const std::size_t stride = scene.start_angle.size() / 2;
  for (std::size_t i = 0; i < 2; ++i) {
    if (!(e.lower[i] < e.upper[i])) s.fail("lower", "must be below upper for each base joint");
    const double start = scene.start_angle[i * stride];
    if (!(start >= e.lower[i] && start <= e.upper[i]))
      s.fail("", "base joint {} starts at {:.6g} rad, beyond its stops", i + 1, start);
  }
}
void complete(Section& s, const Scene&, ExternalForce& e) {
  e.human = s.text("kind") == "human";
  if (e.human) {
    e.anchor = s.pair("anchor");
    e.stiffness = s.number("stiffness");
    e.damping = s.number("damping");
  } else {
    e.force = s.pair("force");
  }
}
void complete(Section& s, const Scene&, Loss& e) {
  const std::string at = s.text("at");
  e.at_controller = at != "drives";
  e.at_drives = at != "controller";
}
void complete(Section& s, const Scene&, Corruption& e) {
  if (!(e.detected > 0.0 || e.undetected > 0.0)) s.fail("", "needs detected > 0 or undetected > 0");
}
void complete(Section& s, const Scene&, BabblingNode& e) {
  if (!e.extended && e.identifier > 0x7FF)
    s.fail("identifier", "is at most 2047 (0x7FF) without extended = true");
}

/// Appends an effect by the name of its type.
template <class... T>
void append(std::vector<std::variant<T...>>& effects, std::string_view type) {
  (void)((type == T::type && (effects.emplace_back(T{}), true)) || ...);
}

}  // namespace

void read_effects(Section& root, Scene& scene) {
  std::vector<Effect>& effects = scene.effects;
  bool gear_given = false;
  for (Section s : root.sections("effects")) {
    s.use_schema("effects");
    const std::string type = s.text("type");
    for (const Effect& e : effects) {
      if (type == type_name(e)) s.fail("type", "names an effect for the second time");
    }
    append(effects, type);
    s.use_schema("effects[" + type + "]");
    s.read_fields(scene);
    std::visit(
        [&](auto& e) {
          if constexpr (requires { e.when; }) read_span(s, e.when.from, e.when.to);
          if constexpr (requires { e.from; }) read_span(s, e.from, e.to);
          complete(s, scene, e);
        },
        effects.back());
    if (type == Backlash::type) gear_given = s.has("stiffness") || s.has("damping") || s.has("rotor_inertia");
    s.finish();
  }
  if (gear_given && find_effect<JointFlexibility>(effects)) {
    root.fail("effects",
              "backlash beside joint_flexibility takes that one's stiffness, damping and rotor_inertia: give "
              "its gap only");
  }
  if (find_effect<BabblingNode>(effects) && !find_effect<BitTiming>(effects)) {
    root.fail(
        "effects",
        "babbling_node needs bit_timing beside it: without it frames take no time and delay no other frame");
  }
}

void refuse_bus_effects(const Scene& scene, const std::string& why) {
  for (const Effect& e : scene.effects) {
    if (!acts_on_bus(e)) continue;
    refuse_at(scene.bus_effects_where,
              "effect '{}' cannot act: {}; allowed on the virtual bus: esmc hil SCENE, without --realtime",
              type_name(e), why);
  }
}

}  // namespace esmc::host
