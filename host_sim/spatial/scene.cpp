#include "host_sim/spatial/scene.hpp"

#include <fmt/format.h>

#include <cmath>

#include "host_sim/scene/reader.hpp"

namespace esmc::host {
namespace {

using V3 = Vec<double, 3>;

V3 vector(Section& s, const std::string& key) {
  const auto v = s.numbers(key, {3});
  return {v[0], v[1], v[2]};
}

V3 unit(Section& s, const std::string& key) {
  const V3 v = vector(s, key);
  if (!(v.norm() > 1e-9)) s.fail(key, "must not be zero: it is a direction");
  return v.normalized();
}

RigidBodyParams<double> read_inertia(Section& s) {
  RigidBodyParams<double> p;
  p.mass = s.number("mass");
  p.inertia = vector(s, "inertia");
  const V3& i = p.inertia;
  const double most = i.maxCoeff();
  if (i.sum() - most < most * (1.0 - 1e-9))
    s.fail("inertia", "is of no body: none may be larger than the sum of the other two");
  return p;
}

StrutParams<double> read_strut(Section s, bool rod) {
  StrutParams<double> p;
  p.centre = s.number("centre");
  p.mass = s.number("mass");
  p.transverse = s.number("transverse");
  p.axial = s.number("axial");
  if (rod) p.viscous = s.number("viscous");
  s.finish();
  return p;
}

void read_platform(Section s, SpatialScene& scene) {
  HexapodParams<double> p;
  scene.body = p.platform = read_inertia(s);
  scene.gravity = p.gravity = s.number("gravity");
  const double base = s.number("base_radius"), base_spread = s.number("base_spread"),
               radius = s.number("radius"), spread = s.number("spread"), height = s.number("joint_height");
  for (int j = 0; j < 6; ++j) {
    const int of_pair = j / 2;
    const double pair = of_pair * 2.0943951023931953, side = j % 2 == 0 ? -1.0 : 1.0;
    const double low = pair + side * base_spread, high = pair + side * spread;
    p.base[j] = {base * std::cos(low), base * std::sin(low), 0.0};
    p.joint[j] = {radius * std::cos(high), radius * std::sin(high), height};
  }
  if (std::abs(base_spread - spread) < 1e-3)
    s.fail("spread",
           "must differ from base_spread: similar hexagons that face each other are a singular platform");
  p.home = {0.0, 0.0, s.number("home")};
  if (!(p.home.z() + height > 0.0)) s.fail("joint_height", "must leave the joints above the base at home");
  p.cylinder = read_strut(s.required_section("cylinder"), false);
  p.rod = read_strut(s.required_section("rod"), true);
  scene.platform = p;
  s.finish();
}

void read_control(Section s, SpatialScene& scene) {
  scene.law = s.choice<SpatialLaw>("law");
  scene.rate_hz = s.number("rate_hz");
  scene.reaching = s.choice<ReachingChoice>("reaching");
  scene.layer = s.per_kind("layer");
  scene.hysteresis = s.number("hysteresis");
  if (const auto m = s.section("model")) {
    Section model = *m;
    scene.model = {model.number("mass"), model.number("inertia"), model.number("legs")};
    model.finish();
  }
  if (scene.law == SpatialLaw::none) {  // keys of the other laws are allowed and have no effect
    for (const char* key : {"lambda", "gain"})
      if (s.has(key)) (void)s.per_kind(key);
    (void)s.optional_number("force_limit");
    (void)s.optional_number("moment_limit");
  } else {
    scene.lambda = s.per_kind("lambda");
    scene.gain = s.per_kind("gain");
    scene.force_limit = s.number("force_limit");
    const auto moment = s.optional_number("moment_limit");
    if (!scene.platform && !moment)
      s.fail("", "missing key 'control.moment_limit' (number > 0, N m): a free body needs it");
    if (scene.platform && moment)
      s.fail("moment_limit", "is of a free body; the motors of a platform have force_limit");
    scene.moment_limit = moment.value_or(0.0);
  }
  s.finish();
}

void read_reference(Section s, SpatialScene& scene) {
  auto& r = scene.reference;
  using Type = SpatialReferenceKind;
  r.type = s.choice<Type>("type");
  r.position = vector(s, "position");
  r.rotation = vector(s, "rotation");
  if (r.type == Type::hold) return s.finish();
  s.use_schema(fmt::format("reference[{}]", name(r.type)));
  r.axis = unit(s, "axis");
  if (r.type == Type::turn) r.duration = s.number("duration");
  if (r.type == Type::sway) r.frequency = s.number("frequency");
  if (r.type == Type::turn || r.type == Type::sway) {
    r.angle = s.number("angle");
    r.shift = vector(s, "shift");
  } else {
    r.rate = s.number("rate");
  }
  if (r.type == Type::tumble) {
    r.second_axis = unit(s, "second_axis");
    r.second_rate = s.number("second_rate");
  }
  s.finish();
}

void read_sections(Section& root, SpatialScene& scene) {
  scene.name = root.text("name");
  const auto body = root.section("body"), platform = root.section("platform");
  if (body.has_value() == platform.has_value()) root.fail("", "either [body] or [platform] is needed");
  if (body) {
    Section s = *body;
    scene.body = read_inertia(s);
    scene.gravity = s.number("gravity");
    s.finish();
  } else {
    read_platform(*platform, scene);
  }
  read_control(root.required_section("control"), scene);
  read_reference(root.required_section("reference"), scene);
  Section initial = root.section_or_empty("initial");
  scene.initial = {vector(initial, "position"), vector(initial, "rotation"), vector(initial, "velocity"),
                   vector(initial, "turning")};
  initial.finish();
  Section m = root.section_or_empty("measurement");
  scene.measurement = {m.number("position_noise"), m.number("attitude_noise"), m.number("rate_noise"),
                       m.boolean("alternate_sign")};
  m.finish();
  Section simulation = root.required_section("simulation");
  scene.duration = simulation.number("duration");
  scene.step = simulation.number("step");
  const double ticks = scene.duration * scene.rate_hz;
  if (ticks < 0.5 || ticks > 4e9) simulation.fail("duration", "must hold between 1 and 4e9 control ticks");
  if (scene.tick() / scene.step > 1e6)
    simulation.fail("step",
                    "cuts a control tick of {:g} s into more than 1e6 steps: {:g} s or more is needed",
                    scene.tick(), scene.tick() / 1e6);
  simulation.finish();
  root.finish();
}

}  // namespace

SpatialScene read_spatial_scene(const std::string& file, const std::vector<std::string>& sets) {
  const toml::table table = parse_scene_file(file, sets);
  Section root(table, file, "", "", spatial_keys());
  SpatialScene scene;
  read_whole(root, [&] { read_sections(root, scene); });
  scene.toml = toml_text(table);
  return scene;
}

}  // namespace esmc::host
