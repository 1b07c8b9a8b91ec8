#include "host_sim/calibrate/calibrate.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>
#include <tuple>

#include "host_sim/calibrate/geometry.hpp"
#include "host_sim/controller/controller_config.hpp"
#include "host_sim/error.hpp"
#include "host_sim/record/derivatives.hpp"
#include "host_sim/record/output.hpp"
#include "host_sim/record/recording.hpp"
#include "host_sim/report/study_page.hpp"
#include "host_sim/scene/edit.hpp"
#include "host_sim/scene/toml_text.hpp"

namespace esmc::host {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::size_t rows_min = 200, rows_used_max = 40'000;
constexpr double gap_max = 5.0;  // of the mean distance of rows: angles between are those of a straight line
constexpr double encoder_sigma_odd = 3e-4;  // rad; ten times the rounding of 16 bit
constexpr double encoder_sigma_max = 0.02;  // rad; lengths that fit no better than this are none

struct JointLog {
  RecordedTable table;  ///< t, then the joints
  [[nodiscard]] MeasuredAngles angles(std::size_t row) const {
    MeasuredAngles a{};
    for (std::size_t j = 0; j + 1 < table.columns.size(); ++j) a[j] = table.columns[j + 1][row];
    return a;
  }
};

JointLog read_log(const RecordedRun& run) {
  std::vector<std::string> names{"t"};
  for (const std::string& j : joint_names(run.scene.type)) names.push_back(j + "_meas");
  const bool five_bar = run.scene.type == MechanismType::five_bar;
  JointLog log{read_table(
      run.log, names,
      five_bar ? ": what four encoders say is needed, of a five-bar that ran with control.sensors = \"all\""
               : ": the log of an RR arm that ran under its controller is needed")};
  require_ascending(log.table, 0);
  if (five_bar && log.table.rows() < rows_min)
    refuse("{}: {} rows are too few: {} or more are needed", run.log, log.table.rows(), rows_min);
  return log;
}

/// The log as it was before observers of this bandwidth followed it (critically damped: late by acceleration
/// / bandwidth^2), or a share of that. Rows must stand at equal distances.
JointLog without_lag(const JointLog& log, double bandwidth, double share) {
  JointLog out = log;
  const std::size_t rows = log.table.rows();
  if (rows < 2) return out;
  const std::vector<double>& t = log.table.columns[0];
  const double tick = (t.back() - t.front()) / static_cast<double>(rows - 1);
  for (std::size_t c = 1; c < log.table.columns.size(); ++c)
    out.table.columns[c] = before_observer(log.table.columns[c], bandwidth * tick, share);
  return out;
}

/// Readings of the effector, with the angles of their instants. `reach`: the mechanism's, m, by its nominal
/// lengths.
std::vector<EffectorReading> read_effector(const std::string& file, const JointLog& log, double reach,
                                           bool free_frame) {
  if (file.empty()) return {};
  const RecordedTable readings =
      read_table(file, {"t", "x", "y"}, ": the header of effector readings is t,x,y");
  const std::vector<double>& t = log.table.columns[0];
  std::vector<EffectorReading> out;
  for (std::size_t i = 0; i < readings.rows(); ++i) {
    const double at = readings.columns[0][i];
    if (t.size() < 2 || !(at >= t.front() && at <= t.back()))
      refuse_at(readings.where(i), "t = {} s is outside the log, which goes from {} to {} s", at,
                t.empty() ? 0.0 : t.front(), t.empty() ? 0.0 : t.back());
    const auto after = std::clamp<std::ptrdiff_t>(std::upper_bound(t.begin(), t.end(), at) - t.begin(), 1,
                                                  static_cast<std::ptrdiff_t>(t.size()) - 1);
    const auto k = static_cast<std::size_t>(after);
    if (at > t[k - 1] && at < t[k] &&
        t[k] - t[k - 1] > gap_max * (t.back() - t.front()) / static_cast<double>(t.size() - 1))
      refuse_at(readings.where(i), "t = {} s is in a gap of the log, from {:g} to {:g} s", at, t[k - 1],
                t[k]);
    const double u = (at - t[k - 1]) / (t[k] - t[k - 1]);
    EffectorReading r{{}, readings.columns[1][i], readings.columns[2][i]};
    if (!free_frame && std::hypot(r.x, r.y) > 2.0 * reach)
      refuse_at(readings.where(i),
                "({:g}, {:g}) m is {:.3g} m from the base, and the mechanism reaches {:.3g} m: metres are "
                "needed, in the frame of the base (else --free-frame)",
                r.x, r.y, std::hypot(r.x, r.y), reach);
    const MeasuredAngles a = log.angles(k - 1), b = log.angles(k);
    for (std::size_t j = 0; j < a.size(); ++j) r.angle[j] = a[j] + u * (b[j] - a[j]);
    out.push_back(r);
  }
  return out;
}

Unknowns nominal_of(const FiveBarParams<double>& p, bool five_bar) {
  Unknowns u = Unknowns::Zero(unknowns);
  if (five_bar) u[unknown_l0] = p.l0;
  for (int leg = 0; leg < (five_bar ? 2 : 1); ++leg) {
    u[unknown_l11 + 2 * leg] = p.legs[static_cast<std::size_t>(leg)].l1;
    u[unknown_l12 + 2 * leg] = p.legs[static_cast<std::size_t>(leg)].l2;
  }
  return u;
}

/// Farther from the base's centre than this, m, no effector can be.
double reach_of(const CalibrationProblem& p) {
  const Unknowns& u = p.nominal;
  const double one = u[unknown_l11] + u[unknown_l12], two = u[unknown_l21] + u[unknown_l22];
  return p.five_bar ? std::min(one, two) + u[unknown_l0] : one;
}

void require_scale(const CalibrationProblem& p, const CalibrateOptions& o) {
  const std::size_t n = p.effector.size();
  if (!o.effector.empty() && n < (p.five_bar ? 2U : 3U))
    refuse_at(o.effector, "{} readings of the effector are too few: {} or more are needed", n,
              p.five_bar ? 2 : 3);
  if (p.five_bar && o.effector.empty() && !p.half_base_known)
    refuse(
        "encoders tell the shape of the mechanism but not its scale: --half-base M (measured), "
        "--trust-half-base (the scene's is right) or --effector FILE with two or more readings is needed");
  if (!p.five_bar && o.effector.empty())
    refuse(
        "an RR arm has no loop whose closure its encoders could contradict: --effector FILE with three or "
        "more readings is needed");
  if (!p.five_bar && o.free_frame)
    refuse(
        "--free-frame: the angle of the readings' frame and the offset of an RR arm's first joint are the "
        "same unknown: give the readings in the frame of the base");
  if (!p.five_bar && (o.half_base || o.trust_half_base))
    refuse("{}: an RR arm has none", o.half_base ? "--half-base" : "--trust-half-base");
}

/// The problem of a log. Throws InputError.
CalibrationProblem problem_of(const RecordedRun& run, const CalibrateOptions& o, const JointLog& log) {
  CalibrationProblem p;
  p.five_bar = run.scene.type == MechanismType::five_bar;
  p.nominal = nominal_of(believed_mechanism(run.scene), p.five_bar);
  p.half_base_known = p.five_bar && (o.trust_half_base || o.half_base);
  if (o.half_base) p.nominal[unknown_l0] = *o.half_base;
  p.free_frame = o.free_frame;
  p.effector_sigma = o.effector_sigma;
  p.effector = read_effector(o.effector, log, reach_of(p), o.free_frame);
  require_scale(p, o);
  const std::size_t stride = (log.table.rows() + rows_used_max - 1) / rows_used_max;
  for (std::size_t i = 0; i < log.table.rows(); i += stride) p.angles.push_back(log.angles(i));
  return p;
}

/// Throws where the result is no calibration of this mechanism.
void judge(const Calibration& c, const CalibrationProblem& p, const RecordedRun& run,
           const CalibrateOptions& o) {
  if (!c.in_numbers)
    refuse(
        "{}: no lengths near the nominal ones fit it even roughly: is it the log of this mechanism, in s and "
        "rad{}?",
        run.log, o.effector.empty() ? "" : ", and the effector readings in m");
  if (c.encoder_sigma > encoder_sigma_max)
    refuse("{}: no lengths make the loop close better than {:.2g} mm rms: is it the log of this mechanism?",
           run.log, 1e3 * c.closure_rms);
  // Expected misfit from the accuracy of readings and encoders; five times as much has another cause. It also
  // makes every length look undetermined.
  const double expected = std::numbers::sqrt2 * p.effector_sigma + 4.0 * reach_of(p) * c.encoder_sigma;
  if (!(c.effector_rms <= 5.0 * expected))
    refuse_at(o.effector,
              "no lengths meet the effector readings better than {:.3g} mm rms, {:.2g} mm are to be expected "
              "of --effector-sigma and the encoders: are they in m, in the frame of the base (else "
              "--free-frame), and on the clock of the log?",
              1e3 * c.effector_rms, 1e3 * expected);
  if (!c.weak.empty() && !o.keep_nominal) {
    std::string names;
    for (std::size_t i = 0; i < std::min<std::size_t>(c.weak.size(), 3); ++i)
      names += (i > 0 ? "; " : "") + c.weak[i].text;
    if (c.weak.size() > 3) names += fmt::format("; and {} more", c.weak.size() - 3);
    if (c.encoder_sigma > encoder_sigma_odd)
      refuse(
          "{}: its angles are beside every loop by {:.2g} rad rms, and so it does not determine {}: did an "
          "encoder slip or jump, or is this noise? --keep-nominal leaves these as they are",
          run.log, c.encoder_sigma, names);
    refuse(
        "{}: does not determine {}: let the mechanism move further{}; --keep-nominal leaves these as they "
        "are",
        run.log, names, p.five_bar ? ", in both legs" : "");
  }
  if (!c.converged) throw RunError("the least-squares fit did not converge");
  for (const int u : c.estimated) {
    const double change = is_length(u) ? std::abs(c.value[u] / p.nominal[u] - 1.0) : 0.0;
    if (change > o.within)
      refuse(
          "{}: {} would be {:.4g} m, {:.0f} % from the nominal {:.4g} m: is it the log of this mechanism? "
          "--within allows more than {:g}",
          run.log, name_of(u, p.five_bar), c.value[u], 100.0 * change, p.nominal[u], o.within);
  }
}

/// Effect of the geometry on the effector, along the log: nominal against estimated, and its uncertainty.
struct EffectorError {
  double rms = 0.0, max = 0.0, sigma = 0.0;  // m
};
EffectorError effector_error(const Calibration& c, const CalibrationProblem& p, const JointLog& log) {
  EffectorError e;
  double sum = 0.0, count = 0.0;
  const std::size_t stride = std::max<std::size_t>(1, log.table.rows() / 500);
  for (std::size_t i = 0; i < log.table.rows(); i += stride) {
    const MeasuredAngles a = log.angles(i);
    const auto before = effector_from_base(p.nominal, p.five_bar, a),
               after = effector_from_base(c.value, p.five_bar, a);
    if (!before || !after) continue;
    const double d = std::abs(*before - *after);
    sum += d * d;
    count += 1.0;
    e.max = std::max(e.max, d);
    e.sigma = std::max(e.sigma, effector_sigma(c, p.five_bar, a));
  }
  e.rms = count > 0.0 ? std::sqrt(sum / count) : 0.0;
  return e;
}

std::string scale_text(const CalibrationProblem& p) {
  std::string text = p.half_base_known ? "scale from half_base" : "";
  if (!p.effector.empty()) {
    text += fmt::format("{}{} effector readings{}", text.empty() ? "scale from " : ", ", p.effector.size(),
                        p.free_frame ? " in a frame of their own" : "");
  }
  return text;
}

/// What a calibration found, for its output.
struct Found {
  EffectorError effector;
  std::vector<EccentricEncoder> eccentric;
  std::string snippet;
};

std::string text_of(const EccentricEncoder& e) {
  return fmt::format("the encoder of {} is off its centre: {:.2g} +- {:.1g} rad once per turn",
                     joint_names(MechanismType::five_bar)[static_cast<std::size_t>(e.joint)], e.amount,
                     e.sigma);
}

Json json_of(const Calibration& c, const CalibrationProblem& p, const RecordedRun& run, const JointLog& log,
             const Found& found) {
  const EffectorError& e = found.effector;
  Json j;
  j["scene"] = run.scene.name;
  j["log"] = run.log;
  j["rows"] = log.table.rows();
  j["mechanism"] = p.five_bar ? "five_bar" : "rr";
  j["scale"] = scale_text(p);
  j["unknowns"] = Json::array();
  for (const int u : c.estimated) {
    j["unknowns"].push_back({{"name", name_of(u, p.five_bar)},
                             {"unit", unit_of(u)},
                             {"nominal", p.nominal[u]},
                             {"value", c.value[u]},
                             {"sigma", c.sigma(u)}});
  }
  j["kept_nominal"] = Json::array();
  for (const WeakDirection& w : c.weak) {
    j["kept_nominal"].push_back(
        {{"direction", w.text}, {"sigma", std::isfinite(w.sigma) ? Json(w.sigma) : Json(nullptr)}});
  }
  j["encoder_sigma_rad"] = p.five_bar ? Json(c.encoder_sigma) : Json(nullptr);
  j["closure"] =
      p.five_bar ? Json{{"nominal_rms_m", c.closure_rms_nominal}, {"rms_m", c.closure_rms}} : Json(nullptr);
  j["effector_readings_rms_m"] = p.effector.empty() ? Json(nullptr) : Json(c.effector_rms);
  j["effector"] = {{"nominal_rms_m", e.rms}, {"nominal_max_m", e.max}, {"sigma_m", e.sigma}};
  j["misfits"] = Json::array();
  for (const EccentricEncoder& x : found.eccentric)
    j["misfits"].push_back({{"code", "eccentric_encoder"},
                            {"where", joint_names(run.scene.type)[static_cast<std::size_t>(x.joint)]},
                            {"amount", x.amount},
                            {"sigma", x.sigma},
                            {"text", text_of(x)}});
  j["toml"] = found.snippet;
  return j;
}

std::string text_of(const Calibration& c, const CalibrationProblem& p, const RecordedRun& run,
                    const JointLog& log, const Found& found) {
  std::string out;
  const auto add = [&out]<class... T>(fmt::format_string<T...> f, T&&... v) {
    out += fmt::format(f, std::forward<T>(v)...);
  };
  const EffectorError& e = found.effector;
  add("{}: {} rows, {}\n", printable(run.scene.name), log.table.rows(), scale_text(p));
  add("{:<16} {:>12} {:>16} {:>12}\n", "", "nominal", "estimate", "+-");
  for (const int u : c.estimated) {
    add("{:<16} {:>12.6g} {:>16.8g} {:>12.2g} {}\n", name_of(u, p.five_bar), p.nominal[u], c.value[u],
        c.sigma(u), unit_of(u));
  }
  for (const WeakDirection& w : c.weak)
    add("kept nominal, the log does not determine it (taken as known to 0.5 % of a length, 5 mrad): {}\n",
        w.text);
  if (p.five_bar) {
    add("loop closes to {:.3g} mm rms, with nominal values {:.3g} mm; encoders: {:.2g} rad rms\n",
        1e3 * c.closure_rms, 1e3 * c.closure_rms_nominal, c.encoder_sigma);
  }
  if (!p.effector.empty()) add("effector readings are met to {:.3g} mm rms\n", 1e3 * c.effector_rms);
  add("effector from the base encoders: nominal values put it {:.3g} mm rms, {:.3g} mm max beside these; "
      "these are good for "
      "{:.2g} mm (standard uncertainty)\n",
      1e3 * e.rms, 1e3 * e.max, 1e3 * e.sigma);
  for (const EccentricEncoder& x : found.eccentric)
    add("warning: eccentric_encoder: {}; the uncertainties have grown by what it shifts\n", text_of(x));
  add("\n{}", found.snippet);
  return out;
}

// ---- the scene with the values of a calibration

/// The offsets of what [drives] and [sensors] name, in their order; or, where the zero is set in a pose, the
/// angles of that pose.
void correct_offsets(toml::table& into, const Scene& scene, const Unknowns& value) {
  const auto section = [&](const char* name) -> toml::table& { return sub_table(into, name); };
  const bool five_bar = scene.type == MechanismType::five_bar;
  const std::size_t joints = five_bar ? 4 : 2;
  const auto correction = [&](std::size_t joint) { return value[unknown_o11 + static_cast<int>(joint)]; };
  const bool all = scene.all_sensors || !five_bar;
  if (scene.drives.zero != Zero::absolute) {
    std::vector<double> pose;
    std::size_t sensed = 0;
    for (std::size_t j = 0; j < joints; ++j) {
      if (!all && j % 2 == 1) continue;
      const double was =
          scene.drives.zero_pose.empty() ? scene.start_angle[j] : scene.drives.zero_pose[sensed];
      pose.push_back(was + correction(j));
      ++sensed;
    }
    section("drives").insert_or_assign("zero_pose", number_array(pose));
    return;
  }
  std::vector<double> drives, sensors;
  const std::vector<std::size_t> motors = scene.motor_joints();
  const auto offset = [&](std::size_t i) {
    return i < scene.drives.offset.size() ? scene.drives.offset[i] : 0.0;
  };
  for (std::size_t m = 0; m < motors.size(); ++m) drives.push_back(offset(m) + correction(motors[m]));
  section("drives").insert_or_assign("offset", number_array(drives));
  if (!(five_bar && scene.all_sensors && !scene.all_motors)) return;
  for (std::size_t i = 0; i < 2; ++i) sensors.push_back(offset(2 + i) + correction(2 * i + 1));
  toml::table& encoders = section("sensors");
  if (!encoders.contains("nodes"))  // a scene without a bus may leave them out, one with offsets may not
    encoders.insert("nodes", toml::array{scene.drives.nodes[2], scene.drives.nodes[3]});
  encoders.insert_or_assign("offset", number_array(sensors));
}

/// `p` with the lengths of a calibration, without these rotors.
FiveBarParams<double> with_lengths(FiveBarParams<double> p, MechanismType type, const Unknowns& value,
                                   const std::array<double, 2>& rotors) {
  for (std::size_t leg = 0; leg < 2; ++leg) p.legs[leg].J1 -= rotors[leg];
  if (type == MechanismType::five_bar) p.l0 = value[unknown_l0];
  for (int leg = 0; leg < (type == MechanismType::five_bar ? 2 : 1); ++leg) {
    p.legs[static_cast<std::size_t>(leg)].l1 = value[unknown_l11 + 2 * leg];
    p.legs[static_cast<std::size_t>(leg)].l2 = value[unknown_l12 + 2 * leg];
  }
  return p;
}

/// TOML to paste: [mechanism] and the corrected offsets, and nothing else.
std::string calibrated_snippet(const Scene& scene, const Unknowns& value) {
  toml::table out;
  set_mechanism(sub_table(out, "mechanism"), scene.type,
                with_lengths(scene.mechanism, scene.type, value, scene.rotor_inertia), false);
  correct_offsets(out, scene, value);
  const std::string text = toml_text(out);
  return text.substr(text.find_first_not_of('\n'));
}

/// Half widths of the lengths, as shares, into [uncertainty]: `sigmas` standard uncertainties of the leg
/// whose length is known less well.
void set_length_uncertainty(toml::table& uncertainty, const Calibration& c, bool five_bar) {
  constexpr double sigmas = 3.0;
  const auto share = [&](int unknown) { return std::min(0.5, sigmas * c.sigma(unknown) / c.value[unknown]); };
  if (five_bar) uncertainty.insert_or_assign("half_base", share(unknown_l0));
  for (const auto& [key, one, two] :
       {std::tuple("l1", unknown_l11, unknown_l21), std::tuple("l2", unknown_l12, unknown_l22)})
    uncertainty.insert_or_assign(key, five_bar ? std::max(share(one), share(two)) : share(one));
}

/// The whole scene of a run with these values, also in the mechanism that control.model states; a file and
/// factors on lengths that control.model names are gone. Throws InputError where it is not possible.
std::string calibrated_scene(const RecordedRun& run, const Calibration& c) {
  const Scene& of = run.scene;
  toml::table scene = parse_scene_file(run.scene_file, {});
  set_mechanism(*scene["mechanism"].as_table(), of.type,
                with_lengths(of.mechanism, of.type, c.value, of.rotor_inertia), false);
  correct_offsets(scene, of, c.value);
  // Four joint angles close the loop of the nominal lengths alone; two follow by the modes.
  if (toml::array* joints = scene["initial"]["joints"].as_array(); joints != nullptr && joints->size() == 4) {
    joints->erase(joints->begin() + 3);
    joints->erase(joints->begin() + 1);
  }
  set_length_uncertainty(sub_table(scene, "uncertainty"), c, of.type == MechanismType::five_bar);
  if (toml::table* model = scene["control"]["model"].as_table()) {
    for (const char* key : {"half_base", "l1", "l2"}) model->erase(key);
    if (toml::table* own = (*model)["mechanism"].as_table()) {
      set_elbow_rotors(*own, of.type, *of.believed);  // those of the base are part of J1
      set_mechanism(*own, of.type, with_lengths(*of.believed, of.type, c.value, {}), false);
    } else {
      model->erase("mechanism");
    }
    if (model->empty()) scene["control"].as_table()->erase("model");
  }
  return edited_scene(std::move(scene), run.scene_file);
}

}  // namespace

int run_calibrate(const CalibrateOptions& o) {
  const RecordedRun run = open_run(o.log, o.scene);
  refuse_overwrite("--write", o.write, {run.log, run.scene_file, o.effector});
  OutputDirectory out(o.out);
  for (const std::string& file : {run.log, run.scene_file, o.effector}) out.spare(file);
  const JointLog read = read_log(run);
  // The lag of the drives' observers is unknown: half of the largest, and an even distribution over the
  // range.
  const bool late = o.observer_bandwidth > 0.0;
  if (late)
    require_even(read.table, 0,
                 "; --observer-bandwidth 0 takes rows as they are, without what the drives' observers lag");
  const JointLog log = late ? without_lag(read, o.observer_bandwidth, 0.5) : read;
  const CalibrationProblem p = problem_of(run, o, log);
  Calibration c = calibrate(p);
  judge(c, p, run, o);
  if (late) {
    const Calibration none = calibrate(problem_of(run, o, read)),
                      whole = calibrate(problem_of(run, o, without_lag(read, o.observer_bandwidth, 1.0)));
    const Unknowns range = whole.value - none.value;
    c.covariance += gram(range.transpose()) / 12.0;
  }
  Found found;
  found.eccentric = name_eccentric(p, c);
  found.effector = effector_error(c, p, log);
  found.snippet = calibrated_snippet(run.scene, c.value);
  if (!o.write.empty()) print_or_write(calibrated_scene(run, c), o.write);
  const Json j = json_of(c, p, run, log, found);
  const auto page = [&] {
    const auto warnings = c.weak.size() + found.eccentric.size();
    return study_page(
        "What the log of " + run.scene.name + " says of its geometry", o.command_line, document_html(j),
        {warnings > 0 ? StudyVerdict::Level::warn : StudyVerdict::Level::ok,
         fmt::format("the effector is known to {:.2g} mm; the nominal values put it {:.3g} mm beside",
                     1e3 * found.effector.sigma, 1e3 * found.effector.rms),
         fmt::format("{} misfits; {} directions kept nominal", found.eccentric.size(), c.weak.size()),
         {}});
  };
  publish({"calibration", j, text_of(c, p, run, log, found), page}, o.json, out);
  return 0;
}

}  // namespace esmc::host
