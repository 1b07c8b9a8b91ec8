#include <algorithm>
#include <cmath>
#include <filesystem>
#include <span>
#include <utility>

#include "host_sim/plant/kinematics.hpp"
#include "host_sim/scene/fields.hpp"

namespace esmc::host {
namespace {

LegParams<double> read_leg(Section s) {
  LegParams<double> p;
  for (const LegKey& k : leg_keys) p.*k.value = s.number(k.name);
  s.finish();
  if (check(p) == ParamError::no_inertia) {
    s.fail("",
           "a bar without mass and inertia cannot move: J1, J2 or the masses beyond the joint must be > 0");
  }
  return p;
}

void read_mechanism(Section s, Scene& scene) {
  s.read_fields(scene);
  const bool five_bar = scene.type == MechanismType::five_bar;
  if (five_bar) {
    scene.mechanism.l0 = s.number("half_base");
    scene.mechanism.m0 = s.number("effector_mass");
    if (const auto mode = s.optional_text("assembly_mode")) scene.assembly_mode = *mode == "+" ? 1 : -1;
  }
  const auto one = s.section("leg");
  const auto two = five_bar ? s.sections("legs", "mechanism.leg") : std::vector<Section>{};
  if (one.has_value() == (five_bar && s.has("legs"))) {
    s.fail("", "[mechanism] {}",
           five_bar ? "needs either leg = {...} for both legs or [[mechanism.legs]] twice"
                    : "of an rr needs leg = {...}");
  }
  if (!one && two.size() != 2) s.fail("legs", "must be given exactly twice, leg 1 (right) first");
  for (std::size_t j = 0; j < 2; ++j) scene.mechanism.legs[j] = read_leg(one ? *one : two[j]);
  const auto rotor =
      s.numbers("rotor_inertia", five_bar ? std::vector<std::size_t>{2, 4} : std::vector<std::size_t>{2});
  for (std::size_t j = 0; j < (five_bar ? 2U : 1U); ++j) {
    LegParams<double>& leg = scene.mechanism.legs[j];
    const bool elbows = rotor.size() == (five_bar ? 4 : 2);
    scene.rotor_inertia[j] = rotor[elbows ? 2 * j : j];
    leg.J1 += scene.rotor_inertia[j];  // turns with bar 1
    if (elbows) leg.rotor2 = rotor[2 * j + 1];
    if (check(leg) == ParamError::rotor) s.fail("rotor_inertia", "of an elbow needs J1 and J2 above 0");
  }
  std::ranges::copy(s.signs("working_mode", five_bar ? 2 : 1), scene.working_mode.begin());
  s.finish();
}

/// The mechanism that the controller believes in: a table, or the [mechanism] of another scene.
FiveBarParams<double> read_belief(Section& s, Scene& scene) {
  Scene other;
  if (s.is_table("mechanism")) {
    Section own = s.required_section("mechanism");
    own.use_schema("mechanism");
    read_mechanism(own, other);
    if (other.type != scene.type) s.fail("mechanism", "is of another type than [mechanism]");
    return other.mechanism;
  }
  const std::string name = *s.optional_text("mechanism");
  const std::filesystem::path path = std::filesystem::path(scene.file).parent_path() / name;
  if (name.find('\0') != std::string::npos) s.fail("mechanism", "must be a file name, without NUL");
  std::string text;
  try {
    text = read_text_file(path.string(), "scene file");
  } catch (const InputError& e) {
    s.fail("mechanism", "must name a scene file, relative to this one: {}", e.what());
  }
  const toml::table table = parse_scene_text(text, path.string(), {});
  Section root(table, path.string(), "", "");
  read_mechanism(root.required_section("mechanism"), other);
  root.throw_errors();
  if (other.type != scene.type)
    s.fail("mechanism", "names a scene of another type of mechanism: {}", path.string());
  scene.companions.push_back({model_copy, std::move(text), path.string()});
  return other.mechanism;
}

void read_model(Section s, Scene& scene) {
  ModelFactors& f = scene.model;
  if (s.has("mechanism")) scene.believed = read_belief(s, scene);
  s.read_fields(scene);
  if (s.is_table("friction")) {
    Section friction = s.required_section("friction");
    friction.read_fields(scene);
    require_friction(friction, f.friction.dry, f.friction.asymmetry, "coulomb");
    friction.finish();
  } else {
    f.exact_friction = s.text("friction") == "exact";
  }
  if (s.has("ripple")) {
    Section ripple = s.required_section("ripple");
    ripple.read_fields(scene);
    ripple.finish();
    if (scene.all_motors && !scene.all_sensors &&
        (f.ripple_amplitude[1] != 0.0 || f.ripple_amplitude[3] != 0.0))
      s.fail("ripple", "of an elbow's motor needs its angle: control.sensors = \"all\"");
  }
  s.finish();
  for (LegParams<double> leg : scene.believed ? scene.believed->legs : scene.mechanism.legs) {
    for (const LegKey& k : std::span(leg_keys).last<4>()) leg.*k.value *= f.*k.factor;  // masses, inertias
    if (check(leg) == ParamError::no_inertia)
      s.fail("",
             "'control.model' believes in a bar without mass and inertia, which no torque could be computed "
             "for: m1, m2, J1, J2 must leave some");
    if (check(leg) == ParamError::rotor)
      s.fail("", "'control.model' needs J1 and J2 above 0 beside the rotor of an elbow");
  }
}

/// Fails where values differ by more than a factor `most`: both scalar types must hold their squares.
void require_alike(const Section& s, const char* key, const std::vector<double>& values, double most) {
  if (values.empty()) return;
  const auto [least, largest] = std::minmax_element(values.begin(), values.end());
  if (*largest > most * *least)
    s.fail(key, "must not differ by more than a factor of {:g}: {:g} and {:g}", most, *least, *largest);
}

std::vector<Waveform> read_waveforms(Section& control, std::size_t motors) {
  std::vector<Waveform> out;
  for (Section s : control.sections("torque")) {
    Waveform w;
    w.offset = s.number("offset");
    for (Section t : s.sections("terms")) {
      w.terms.push_back({t.number("amp"), t.number("omega"), t.number("phase")});
      t.finish();
    }
    s.finish();
    out.push_back(w);
  }
  if (out.size() != motors)
    control.fail("torque", "must have {} entries for law = \"open_loop\", one per motor", motors);
  return out;
}

void read_gains(Section& s, Scene& scene) {
  const bool sliding = scene.sliding();
  const bool own_gains = scene.kp && scene.kd;
  if (sliding || (scene.law == LawChoice::ctc && !own_gains) || s.has("lambda"))
    take(s, "lambda", scene.lambda);
  const bool robust = s.is_word("gain", "robust");
  scene.robust_gain = robust && sliding;
  if (!robust && (sliding || s.has("gain"))) take(s, "gain", scene.gain);
  if (scene.law == LawChoice::pd && !own_gains) s.fail("", "law = \"pd\" needs control.kp and control.kd");
}

/// Fails where the optional parts of the controller do not fit the rest of [control].
void require_parts_fit(Section& s, const Scene& scene) {
  const bool sliding = scene.sliding();
  const bool modelled = sliding || scene.law == LawChoice::ctc, observes = scene.disturbance_observer > 0.0;
  const bool twists = sliding && scene.reaching == ReachingChoice::super_twisting;
  const bool couples = sliding && scene.reaching == ReachingChoice::implicit_coupled;
  if (couples && scene.law == LawChoice::smc) {
    s.fail("reaching",
           "must not be implicit_coupled with law = \"smc\", whose two coordinates are not coupled: implicit "
           "is the same");
  }
  if (observes && !modelled)
    s.fail("disturbance_observer", "needs a law with a model: esmc, esmc_projected, smc or ctc");
  if (scene.predictor && !modelled)
    s.fail("predictor", "needs a law with a model: esmc, esmc_projected, smc or ctc");
  if (scene.robust_gain && (twists || couples || observes || scene.predictor)) {
    s.fail("gain",
           "must be numbers with super_twisting, implicit_coupled, disturbance_observer and predictor: "
           "\"robust\" is designed for the plain laws");
  }
  const bool part = observes || scene.predictor || twists || couples;
  if (part && scene.all_motors && scene.all_sensors) {
    s.fail("sensors",
           "must be \"base\" with super_twisting, implicit_coupled, disturbance_observer and predictor where "
           "motors = \"all\": they work in the base joints, which lose the mechanism at type 2");
  }
  const double told = scene.delay_ticks.value_or(0.0);
  if ((observes || scene.predictor || twists) && (told > 8.0 || told != std::round(told))) {
    s.fail("delay_ticks",
           "must be a whole number from 0 to 8 with super_twisting, disturbance_observer and predictor");
  }
  if (scene.predictor && scene.delay_ticks && told < 1.0)
    s.fail("delay_ticks", "must be at least 1 with predictor = true: there is nothing to predict");
}

void read_control(Section s, Scene& scene) {
  const bool five_bar = scene.type == MechanismType::five_bar;
  s.read_fields(scene);
  read_gains(s, scene);
  scene.all_motors = s.text("motors") == "all" && five_bar;
  scene.all_sensors = s.text("sensors") == "all" && five_bar;
  if (s.has("encoder_sigma")) {
    if (!scene.all_sensors) s.fail("encoder_sigma", "is for a five_bar with control.sensors = \"all\"");
    scene.encoder_sigma = s.each("encoder_sigma", 4);
    require_alike(s, "encoder_sigma", scene.encoder_sigma, 1e3);
  }
  require_parts_fit(s, scene);
  const auto motors = static_cast<std::size_t>(scene.motors());
  if (scene.closed_loop() || s.has("torque_limit")) scene.torque_limit = s.each("torque_limit", motors);
  scene.torque_weight = s.optional_numbers("torque_weight", {motors}).value_or(std::vector<double>{});
  if (scene.all_motors) {
    require_alike(s, "torque_weight", scene.torque_weight, 1e8);
    if (scene.torque_weight.empty()) require_alike(s, "torque_limit", scene.torque_limit, 1e4);
  }
  scene.preload = s.optional_numbers("preload", {motors}).value_or(std::vector<double>{});
  if (!scene.preload.empty() && !scene.all_motors)
    s.fail("preload", "needs control.motors = \"all\": two motors have no torque that moves nothing");
  if (const auto model = s.section("model")) read_model(*model, scene);
  for (std::size_t i = 0; i < scene.torque_limit.size(); ++i) {
    const ModelFactors& f = scene.model;
    const double given = scene.torque_limit[i] * f.torque_factor[i] - std::abs(f.ripple_amplitude[i]);
    if (!(given > 0.0))
      s.fail("model", "believes in a ripple that takes all of motor {}'s torque_limit, {:g} N m", i + 1,
             scene.torque_limit[i]);
    if (i < scene.preload.size() && !(std::abs(scene.preload[i]) <= given))
      s.fail("preload", "must be within torque_limit: motor {} has {} N m of {} N m", i + 1, scene.preload[i],
             given);
  }
  if (scene.law == LawChoice::open_loop || s.has("torque")) {
    const auto torque = read_waveforms(s, motors);
    if (scene.law == LawChoice::open_loop) scene.torque = torque;
  }
  s.finish();
}

void read_initial(Section s, Scene& scene) {
  InitialScene& i = scene.initial;
  const auto at = s.optional_text("at");
  s.read_fields(scene);
  const std::vector<std::size_t> sizes =
      scene.type == MechanismType::five_bar ? std::vector<std::size_t>{2, 4} : std::vector<std::size_t>{2};
  i.joints = s.optional_numbers("joints", sizes).value_or(std::vector<double>{});
  const auto rates = s.optional_numbers("joint_rates", sizes);
  const int ways = (at ? 1 : 0) + (i.position ? 1 : 0) + (i.joints.empty() ? 0 : 1);
  if (ways > 1) s.fail("", "[initial] takes one of at, position, joints");
  if (s.has("velocity") && !i.position) s.fail("velocity", "goes with initial.position");
  if (rates && i.joints.empty()) s.fail("joint_rates", "goes with initial.joints");
  if (rates && rates->size() != i.joints.size())
    s.fail("joint_rates", "must have as many values as initial.joints");
  i.joint_rates = rates.value_or(std::vector<double>(i.joints.size(), 0.0));
  i.at_reference = !i.position && i.joints.empty();
  s.finish();
}

void read_limits(Section s, Scene& scene) {
  LimitsScene& l = scene.limits;
  s.read_fields(scene);
  l.feedback_jump = s.optional_number("feedback_jump").value_or(l.joint_speed * scene.tick());
  l.join_acceleration = s.optional_number("join_acceleration").value_or(0.0);
  l.after_halt = s.has("after_halt")       ? s.choice<AfterHalt>("after_halt")
                 : scene.mechanism.g > 0.0 ? AfterHalt::lower
                                           : AfterHalt::release;
  const auto range = [](Section& of, const char* key) {
    const auto r = of.pair(key);
    if (!(r[0] < r[1])) of.fail(key, "must be [lower, upper] with lower < upper");
    return r;
  };
  if (auto w = s.section("workspace")) {
    l.workspace = {range(*w, "x"), range(*w, "y")};
    w->finish();
  }
  const auto pairs = s.pairs("joint_angle");
  if (!pairs.empty()) {
    if (pairs.size() != 2 || !(pairs[0][0] < pairs[0][1]) || !(pairs[1][0] < pairs[1][1]))
      s.fail("joint_angle", "must be [lower, upper] with lower < upper for each of the two base joints");
    l.joint_angle = {pairs[0], pairs[1]};
  }
  s.finish();
}

constexpr double substeps_max = 1e6;  // of a tick, for fixed steps

void read_simulation(Section s, Scene& scene) {
  s.read_fields(scene);
  if (scene.accuracy && (s.has("integrator") || s.has("step")))
    s.fail("accuracy", "chooses method and step: leave out integrator and step");
  if (!scene.accuracy && s.has("accuracy_of")) s.fail("accuracy_of", "needs 'accuracy'");
  s.finish();
  if (scene.tick() / scene.step > substeps_max) {
    s.fail("step", "cuts a control tick of {:g} s into more than {:g} steps: {:g} s or more is needed",
           scene.tick(), substeps_max, scene.tick() / substeps_max);
  }
  const double ticks = scene.duration * scene.rate_hz;
  if (ticks < 0.5 || ticks > 2e9) s.fail("duration", "must hold between 1 and 2e9 control ticks");
}

/// Every section in its order, each of which needs those before.
void read_sections(Section& root, Scene& scene) {
  scene.name = root.text("name");
  read_mechanism(root.required_section("mechanism"), scene);
  read_control(root.required_section("control"), scene);
  if (const auto s = root.section("uncertainty")) read_uncertainty(*s, scene);
  if (scene.robust_gain && !scene.uncertainty) {
    throw InputError(root.where("control"),
                     "'control.gain' = \"robust\" needs the table [uncertainty], which says what against");
  }
  if (const auto s = root.section("reference")) read_reference(*s, scene);
  if (scene.closed_loop() && scene.reference.type == ReferenceType::none)
    root.fail("", "missing table [reference]: a closed loop needs one");
  read_initial(root.section_or_empty("initial"), scene);
  read_limits(root.section_or_empty("limits"), scene);
  read_drives(root.section_or_empty("drives"), scene);
  read_sensors(root.section("sensors"), root, scene);
  if (const auto s = root.section("command")) read_command(*s, scene);
  if (!scene.drives.homing_speed.empty() && !scene.command)
    root.fail("drives", "'homing_speed' needs the table [command], whose order it is for");
  Section bus = root.section_or_empty("bus");
  bus.read_fields(scene);
  const bool fd = scene.drives.protocol == Protocol::moteus;
  if (fd) scene.data_bitrate = 5'000'000;
  if (bus.given("data_bitrate")) scene.data_bitrate = static_cast<int>(bus.integer("data_bitrate"));
  if (!fd && scene.data_bitrate != 0)
    bus.fail("data_bitrate", "is for CAN FD, which drives.protocol = \"moteus\" alone speaks");
  if (fd && scene.data_bitrate < scene.bitrate)
    bus.fail("data_bitrate", "must be at least bus.bitrate, {}", scene.bitrate);
  bus.finish();
  read_simulation(root.required_section("simulation"), scene);
  scene.control_where = root.where("control");
  scene.reference_where = root.where("reference", {"mechanism"});
  scene.simulation_where = root.where("simulation");
  if (root.errors().empty()) {
    set_start(scene, root.where("initial", {"mechanism", "reference"}),
              root.where("reference", {"mechanism", "initial"}));
  } else {
    scene.start_angle.assign(static_cast<std::size_t>(scene.joints()), 0.0);
  }
  read_effects(root, scene);
  if (scene.reference.type == ReferenceType::program && root.errors().empty()) complete_program(scene);
  scene.bus_effects_where = root.where("effects");
  scene.uncertainty_where = root.where("uncertainty", {"control"});
  root.finish();
}

}  // namespace

Scene read_scene_table(toml::table table, const std::string& file) {
  Section root(table, file, "", "");
  Scene scene;
  scene.file = file;
  read_whole(root, [&] { read_sections(root, scene); });
  // The scene as run names the copies of its files, which lie beside it.
  std::ranges::sort(scene.companions, {}, &Companion::name);
  for (const Companion& c : scene.companions) {
    const std::string key = c.key();
    const std::size_t dot = key.rfind('.');
    table.at_path(key.substr(0, dot)).as_table()->insert_or_assign(key.substr(dot + 1), c.name);
  }
  scene.toml = toml_text(table);
  return scene;
}

// Embedded at build time from host_sim/scenes, so that what is printed is what the tests run.
extern const std::string_view five_bar_scene;
extern const std::string_view rr_scene;

std::string_view starting_scene(const std::string& kind) { return kind == "rr" ? rr_scene : five_bar_scene; }

Scene read_scene(const std::string& file, const std::vector<std::string>& sets) {
  return read_scene_table(parse_scene_file(file, sets), file);
}

Scene read_scene_text(const std::string& text, const std::string& name,
                      const std::vector<std::string>& sets) {
  return read_scene_table(parse_scene_text(text, name, sets), name);
}

}  // namespace esmc::host
