#include "host_sim/identify/identify.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <nlohmann/json.hpp>

#include "host_sim/controller/controller_config.hpp"
#include "host_sim/error.hpp"
#include "host_sim/identify/identification.hpp"
#include "host_sim/identify/uncertainty.hpp"
#include "host_sim/record/output.hpp"
#include "host_sim/record/recording.hpp"
#include "host_sim/report/study_page.hpp"
#include "host_sim/scene/edit.hpp"
#include "host_sim/scene/toml_text.hpp"

namespace esmc::host {
namespace {

using Json = nlohmann::ordered_json;

constexpr double unexplained_max = 0.3;  // of the torque
constexpr double delay_half_max = 2.0;   // ticks, half of the interval
constexpr double torque_factor_off_max = 0.5;

IdentifyProblem read_problem(const RecordedRun& run, const IdentifyOptions& o) {
  IdentifyProblem p;
  const Scene& scene = run.scene;
  p.five_bar = scene.type == MechanismType::five_bar;
  const FiveBarParams<double> believed = believed_mechanism(scene);
  p.l0 = p.five_bar ? believed.l0 : 0.0;
  for (std::size_t leg = 0; leg < 2; ++leg) {
    p.l1[leg] = believed.legs[leg].l1;
    p.l2[leg] = believed.legs[leg].l2;
  }
  p.assembly = scene.assembly_mode;
  p.gravity = believed.g;
  p.tick = scene.tick();
  p.window = o.window;
  p.observer_bandwidth = o.observer_bandwidth;
  p.nominal = standard_values(believed, p.five_bar);
  p.asymmetry = friction_of(believed).asymmetry;
  for (std::size_t leg = 0; leg < (p.five_bar ? 2U : 1U); ++leg)
    p.rotor[2 * leg + 1] = believed.legs[leg].rotor2;

  const auto joints = joint_names(scene.type);
  const std::size_t second = joints.size() / 2;
  std::vector<std::string> names{"t", joints[0] + "_meas", joints[second] + "_meas"};
  const std::vector<std::size_t> motors = scene.motor_joints();
  for (const std::size_t m : motors) names.push_back("tau" + joints[m].substr(5) + "_cmd");
  const char* const kind = p.five_bar ? "a five-bar" : "an RR arm";
  const RecordedTable log = read_table(
      run.log, names, fmt::format(": the log of {} that ran under its controller is needed", kind), "state");
  require_ascending(log, 0);
  for (std::size_t i = 0; i < log.words.size(); ++i) {
    if (log.words[i] == "running") continue;  // before and after, the torques are not those of the columns
    refuse_at(log.where(i),
              "state is '{}': only rows of a running controller tell torques, leave the others out",
              printable(log.words[i].substr(0, 40)));
  }
  require_every_tick(log, 0, p.tick);
  const std::size_t needed = ticks_needed(p);
  if (log.rows() < needed)
    refuse("{}: {} rows are too few: twenty windows of {:g} s need {}, {:.3g} s of motion", run.log,
           log.rows(), o.window, needed, static_cast<double>(needed) * p.tick);
  p.angle = {log.columns[1], log.columns[2]};
  for (std::size_t m = 0; m < motors.size(); ++m) {
    p.motors.push_back(static_cast<int>(motors[m]));
    p.ripple_amplitude[motors[m]] = scene.model.ripple_amplitude[m];
    p.ripple_per_turn[motors[m]] = scene.model.ripple_per_turn[m];
    p.ripple_phase[motors[m]] = scene.model.ripple_phase[m];
  }
  for (std::size_t i = 0; i < log.rows(); ++i) {
    std::array<double, 4> torque{};
    for (std::size_t m = 0; m < motors.size(); ++m)
      torque[motors[m]] = scene.model.torque_factor[m] * log.columns[3 + m][i];
    p.torque.push_back(torque);
  }
  return p;
}

/// One line on a defect that was found.
std::string text_of(const Defect& d, const RecordedRun& run, double coverage) {
  const std::string joint = joint_names(run.scene.type)[static_cast<std::size_t>(d.joint)];
  const double half = coverage * d.sigma;
  switch (d.kind) {
    case DefectKind::direction:
      return fmt::format(
          "the dry friction of {} depends on the direction, by {:.3g} +- {:.2g} N m either way", joint,
          d.amount, half);
    case DefectKind::rotor:
      return fmt::format("a rotor behind the gear of {} that the model has not: {:.3g} +- {:.2g} kg m2",
                         joint, d.amount, half);
    case DefectKind::torque_constant:
      return fmt::format("the motor of {} gives {:.4g} +- {:.2g} times the torque that is asked of it", joint,
                         1.0 + d.amount, half);
    case DefectKind::cogging:
      return fmt::format("cogging of {}: {:.3g} +- {:.2g} N m, about {:g} times per turn", joint, d.amount,
                         half, d.periods);
    case DefectKind::spring:
      return fmt::format("the gear of {} gives way: {:.3g} +- {:.2g} rad per N m", joint, d.amount, half);
    case DefectKind::eccentric:
      return fmt::format("the encoder of {} is off its centre: {:.3g} +- {:.2g} rad once per turn", joint,
                         d.amount, half);
  }
  return {};
}

void judge(const Identification& r, const RecordedRun& run, const IdentifyOptions& o) {
  const auto refuse_weak = [&] {
    refuse("{}: the motion does not determine {}{}: move faster, and both joints differently", run.log,
           r.weak.front(),
           r.weak.size() > 1
               ? fmt::format(", nor {} more combination{}", r.weak.size() - 1, r.weak.size() > 2 ? "s" : "")
               : "");
  };
  if (!r.weak.empty() && r.covariance.size() == 0) refuse_weak();
  for (std::size_t j = 0; j < 2; ++j) {
    if (!(r.effort[j] > 0.0)) refuse("{}: motor {} has no torque at all in this log", run.log, j + 1);
    if (!(r.residual[j] <= unexplained_max * std::max(r.effort[0], r.effort[1])))
      refuse(
          "{}: {:.2g} of {:.2g} N m rms stay unexplained: is it the log of this mechanism, and are its "
          "lengths calibrated?",
          run.log, r.residual[j], r.effort[j]);
  }
  if (!r.weak.empty()) refuse_weak();
  for (const Defect& d : r.defects) {
    if (d.kind != DefectKind::torque_constant || std::abs(d.amount) <= torque_factor_off_max) continue;
    refuse("{}: {}: are the torques those that moved it, with their signs?", run.log,
           text_of(d, run, o.coverage));
  }
  const double half = o.coverage * r.delay_sigma;
  if (!(half <= delay_half_max && r.delay_ticks + half >= -1.0))
    refuse(
        "{}: the torque would be {:.3g} +- {:.2g} ticks late: are the torques those that moved it, with "
        "their signs?",
        run.log, r.delay_ticks, half);
  for (const BaseParameter& b : r.parameters) {
    const StandardParameter& s = b.of;
    if (!s.inertial && b.value + 2.0 * o.coverage * b.sigma < 0.0)
      refuse(
          "{}: {} would be {:.3g} {}, and friction brakes: are the torques those that moved it, with their "
          "signs, and is nothing else in the way?",
          run.log, s.name, b.value, s.unit);
  }
}

Json json_of(const Identification& r, const RecordedRun& run, const IdentifyProblem& p,
             const IdentifyOptions& o, const UncertaintyTable& table) {
  Json j;
  j["scene"] = run.scene.name;
  j["log"] = run.log;
  j["rows"] = p.torque.size();
  j["windows"] = r.windows;
  j["coverage"] = o.coverage;
  j["parameters"] = Json::array();
  for (const BaseParameter& b : r.parameters) {
    Json share = Json::object();
    Eigen::Index i = 0;
    for (const StandardParameter& s : standard_parameters(p.five_bar)) {
      if (const double x = b.share[i++]; x != 0.0) share[s.name] = x;
    }
    j["parameters"].push_back({{"name", b.text},
                               {"unit", b.of.unit},
                               {"inertial", b.of.inertial},
                               {"share", share},
                               {"nominal", b.nominal},
                               {"value", b.value},
                               {"sigma", b.sigma},
                               {"lower", b.value - o.coverage * b.sigma},
                               {"upper", b.value + o.coverage * b.sigma}});
  }
  j["delay"] = {{"ticks", r.delay_ticks},
                {"sigma", r.delay_sigma},
                {"lower", r.delay_ticks - o.coverage * r.delay_sigma},
                {"upper", r.delay_ticks + o.coverage * r.delay_sigma}};
  j["residual_nm_rms"] = r.residual;
  j["torque_nm_rms"] = r.effort;
  j["misfits"] = Json::array();
  for (const Defect& d : r.defects)
    j["misfits"].push_back({{"code", defect_codes[static_cast<std::size_t>(d.kind)]},
                            {"where", joint_names(run.scene.type)[static_cast<std::size_t>(d.joint)]},
                            {"amount", d.amount},
                            {"sigma", d.sigma},
                            {"text", text_of(d, run, o.coverage)}});
  j["warnings"] = table.warnings;
  j["toml"] = table.toml;
  return j;
}

std::string text_of(const Identification& r, const RecordedRun& run, const IdentifyProblem& p,
                    const IdentifyOptions& o, const UncertaintyTable& table) {
  std::string out;
  const auto add = [&out]<class... T>(fmt::format_string<T...> f, T&&... v) {
    out += fmt::format(f, std::forward<T>(v)...);
  };
  add("{}: {} ticks, {} windows of {:g} s, {} base parameters; intervals are {:g} standard uncertainties to "
      "either side\n",
      printable(run.scene.name), p.torque.size(), r.windows, o.window, r.parameters.size(), o.coverage);
  add("{:<18}{:>12}{:>12}{:>12}{:>12}\n", "", "nominal", "estimate", "from", "to");
  std::string sums;
  for (const BaseParameter& b : r.parameters) {
    const StandardParameter& s = b.of;
    const bool sum = b.text != s.name;
    if (sum) sums += fmt::format("{}*: {}\n", s.name, b.text);
    add("{:<18}{:>12.4g}{:>12.4g}{:>12.4g}{:>12.4g} {}\n", s.name + (sum ? "*" : ""), b.nominal, b.value,
        b.value - o.coverage * b.sigma, b.value + o.coverage * b.sigma, s.unit);
  }
  add("{:<18}{:>12}{:>12.4g}{:>12.4g}{:>12.4g} ticks\n", "torque delay", "", r.delay_ticks,
      r.delay_ticks - o.coverage * r.delay_sigma, r.delay_ticks + o.coverage * r.delay_sigma);
  add("{}\n{}",
      p.five_bar ? "per leg j: aj = J1 + m1 lg1^2 + m2 l1^2, cj = J2 + m2 lg2^2, hj = m2 lg2, sj = m1 "
                   "lg1 + m2 l1; m0 the effector's mass"
                 : "a = J1 + m1 lg1^2 + m2 l1^2, c = J2 + m2 lg2^2, h = m2 lg2, s = m1 lg1 + m2 l1",
      sums);
  add("unexplained: {:.2g} and {:.2g} N m rms of {:.2g} and {:.2g}\n", r.residual[0], r.residual[1],
      r.effort[0], r.effort[1]);
  for (const Defect& d : r.defects)
    add("warning: {}: {}; an unknown of the intervals, not in the table\n",
        defect_codes[static_cast<std::size_t>(d.kind)], text_of(d, run, o.coverage));
  for (const std::string& w : table.warnings) add("warning: {}\n", w);
  add("\n{}", table.toml);
  return out;
}

/// Writes the motor map: the model's values plus the identified ones; per motor one cogging torque, the
/// larger.
void put_motors(toml::table& model, const Identification& r, const IdentifyProblem& p,
                const ModelFactors& believed) {
  const std::size_t n = p.motors.size();
  const auto of_motors = [n](const PerJoint& v) {
    return std::vector<double>(v.begin(), v.begin() + static_cast<std::ptrdiff_t>(n));
  };
  std::vector<double> factor = of_motors(believed.torque_factor),
                      per_turn = of_motors(believed.ripple_per_turn);
  std::vector<std::complex<double>> cogging(n);
  for (std::size_t m = 0; m < n; ++m)
    cogging[m] = believed.ripple_amplitude[m] * std::polar(1.0, believed.ripple_phase[m]);
  for (const Defect& d : r.defects) {
    const auto m = static_cast<std::size_t>(std::ranges::find(p.motors, d.joint) - p.motors.begin());
    if (d.kind == DefectKind::torque_constant) factor[m] *= 1.0 + d.amount;
    if (d.kind != DefectKind::cogging) continue;
    const auto more = std::polar(d.amount, d.phase);
    if (cogging[m] != 0.0 && per_turn[m] == d.periods) {
      cogging[m] += more;
    } else if (std::abs(more) > std::abs(cogging[m])) {
      cogging[m] = more;
      per_turn[m] = d.periods;
    }
  }
  if (std::ranges::any_of(factor, [](double x) { return x != 1.0; }))
    model.insert("torque_factor", number_array(factor));
  if (std::ranges::all_of(cogging, [](auto x) { return x == 0.0; })) return;
  std::vector<double> amplitude, phase;
  for (const auto& c : cogging) {
    amplitude.push_back(std::abs(c));
    phase.push_back(std::arg(c));
  }
  for (double& periods : per_turn) {
    if (periods == 0.0) periods = 1.0;  // of a motor without cogging
  }
  toml::table ripple{{"amplitude", number_array(amplitude)},
                     {"per_turn", number_array(per_turn)},
                     {"phase", number_array(phase)}};
  ripple.is_inline(true);
  model.insert("ripple", std::move(ripple));
}

std::string identified_scene(const Identification& r, const RecordedRun& run, const IdentifyProblem& p,
                             double coverage) {
  const FiveBarParams<double> found = identified_mechanism(r, p, believed_mechanism(run.scene), coverage);
  toml::table scene = parse_scene_file(run.scene_file, {});
  toml::table mechanism{{"type", name(run.scene.type)}};
  set_mechanism(mechanism, run.scene.type, found, true);
  mechanism.insert("working_mode", *scene["mechanism"]["working_mode"].as_array());
  std::vector<double> viscous, coulomb, asymmetry;
  for (std::size_t leg = 0; leg < (p.five_bar ? 2U : 1U); ++leg) {
    const LegParams<double>& l = found.legs[leg];
    viscous.insert(viscous.end(), {l.d1, l.d2});
    coulomb.insert(coulomb.end(), {l.gamma1, l.gamma2});
    asymmetry.insert(asymmetry.end(), {l.asymmetry1, l.asymmetry2});
  }
  toml::table friction{{"viscous", number_array(viscous)}, {"coulomb", number_array(coulomb)}};
  if (std::ranges::any_of(asymmetry, [](double x) { return x != 0.0; }))
    friction.insert("asymmetry", number_array(asymmetry));
  friction.is_inline(true);
  toml::table model{{"mechanism", mechanism}, {"friction", friction}};
  put_motors(model, r, p, run.scene.model);
  sub_table(scene, "control").insert_or_assign("model", std::move(model));
  toml::table& uncertainty = sub_table(scene, "uncertainty");
  for (const char* key : {"m1", "m2", "J1", "J2", "payload"}) uncertainty.erase(key);
  toml::table around = parse_scene_text(uncertainty_table(r, p, found, coverage).toml, "", {});
  for (auto&& [key, value] : *around["uncertainty"].as_table()) uncertainty.insert_or_assign(key, value);
  return edited_scene(std::move(scene), run.scene_file);
}

}  // namespace

int run_identify(const IdentifyOptions& o) {
  const RecordedRun run = open_run(o.log, o.scene);
  refuse_overwrite("--write", o.write, {run.log, run.scene_file});
  OutputDirectory out(o.out);
  for (const std::string& file : {run.log, run.scene_file}) out.spare(file);
  // Shorter ones are not smooth beside the rates' own smoothing: the delay comes out too large.
  const double least = std::max(20.0 * run.scene.tick(), 0.05);
  if (o.window < least || o.window > 10.0)
    refuse("--window {:g}: from 20 ticks and 0.05 s ({:g} s) to 10 s are allowed", o.window, least);
  const IdentifyProblem p = read_problem(run, o);
  const Identification r = [&] {
    try {
      return identify(p);
    } catch (const InputError& e) {
      refuse_at(run.log, "{}", e.what());
    }
  }();
  judge(r, run, o);
  const UncertaintyTable table = uncertainty_table(r, p, believed_mechanism(run.scene), o.coverage);
  if (!o.write.empty()) print_or_write(identified_scene(r, run, p, o.coverage), o.write);
  const Json j = json_of(r, run, p, o, table);
  const auto page = [&] {
    const auto warnings = r.defects.size() + table.warnings.size();
    return study_page("What the log of " + run.scene.name + " says of its masses and friction",
                      o.command_line, document_html(j),
                      {warnings > 0 ? StudyVerdict::Level::warn : StudyVerdict::Level::ok,
                       fmt::format("{} base parameters; {} warnings", r.parameters.size(), warnings),
                       fmt::format("Intervals are {:g} standard uncertainties to either side.", o.coverage),
                       {}});
  };
  publish({"identification", j, text_of(r, run, p, o, table), page}, o.json, out);
  return 0;
}

}  // namespace esmc::host
