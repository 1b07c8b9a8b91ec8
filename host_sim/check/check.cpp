#include "host_sim/check/check.hpp"
#include "host_sim/check/margins.hpp"
#include "host_sim/check/probe.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "firmware/cycle/four_motors.hpp"
#include "host_sim/bus/response.hpp"
#include "host_sim/design/efforts.hpp"
#include "host_sim/loop/run.hpp"
#include "host_sim/record/finish.hpp"
#include "host_sim/record/recorder.hpp"
#include "host_sim/report/study_page.hpp"

namespace esmc::host {
namespace {

using Json = nlohmann::ordered_json;

/// False with every joint driven and measured: type 2 is then no singularity of the loop.
bool guarded_type2(const Scene& s) {
  return s.type == MechanismType::five_bar && !(s.all_motors && s.all_sensors);
}

/// Without a controller there are no ticks, in which some effects act.
void judge_open_loop(const Scene& s, Findings& f) {
  std::string idle;
  for (const Effect& e : s.effects) {
    const std::string type = type_name(e);
    constexpr std::string_view ticked[] = {ThermalLimit::type, Jitter::type,      ComputeDelay::type,
                                           Encoder::type,      SensorNoise::type, SensorBias::type,
                                           SensorDelay::type};
    if (std::ranges::find(ticked, type) != std::end(ticked)) idle += (idle.empty() ? "" : ", ") + type;
  }
  if (idle.empty()) return;
  f.warning(Code::effect_idle, "effects",
            "without a controller there are no ticks and no readings: {} {} no effect", idle,
            idle.find(',') == std::string::npos ? "has" : "have");
}

constexpr const char* torque_key = "control.torque_limit";
constexpr double much = 0.7;  ///< share of a limit that leaves little to correct errors with

/// Torque that is short for a moment is a warning.
Level shortage(const Margins& m) { return m.short_ticks > 0.1 * m.ticks ? Level::error : Level::warning; }

void judge_each(const Scene& s, const Margins& m, Findings& f) {
  for (std::size_t i = 0; i < m.torque.size(); ++i) {
    const double share = m.torque[i] / s.torque_limit[i];
    const std::string text =
        fmt::format("motor {}: the reference alone takes {:.3g} N m of torque_limit = {} N m", i + 1,
                    m.torque[i], s.torque_limit[i]);
    if (!(share <= 1.0)) {
      f.add(shortage(m), Code::torque_exceeded, torque_key, "{}", text);
    } else if (share > much) {
      f.warning(Code::torque_margin, torque_key, "{}; little is left to correct errors with", text);
    }
  }
}

/// Four motors share the load: only their sum can be too small.
void judge_together(const Scene& s, const Margins& m, Findings& f) {
  if (!(m.share <= 1.0)) {
    std::vector<std::size_t> held;
    for (std::size_t i = 0; i < m.share_torque.size(); ++i) {
      if (!(std::abs(m.share_torque[i]) < s.torque_limit[i] * (1.0 - 1e-9))) held.push_back(i + 1);
    }
    std::string names = fmt::format("{}", fmt::join(held, ", "));
    if (const std::size_t last = names.rfind(", "); last != std::string::npos)
      names.replace(last, 2, " and ");
    f.add(shortage(m), Code::torque_exceeded, torque_key,
          "motor{} {}: at their torque_limit the four motors together give {:.3g} % of what the reference "
          "alone takes (t = {:.3f} s)",
          held.size() == 1 ? "" : "s", names, 100.0 / m.share, m.share_t);
  } else if (m.share > much) {
    f.warning(
        Code::torque_margin, torque_key,
        "the reference alone takes {:.3g} % of what the four motors together give within torque_limit (t = "
        "{:.3f} s); little is left to correct errors with",
        100.0 * m.share, m.share_t);
  }
}

/// What the drives cut, and jumps that no motor follows.
void judge_drives(const Scene& s, const Margins& m, Findings& f) {
  for (std::size_t i = 0; i < m.drive_short.size(); ++i) {
    if (m.drive_short[i] == 0.0) continue;
    f.add(shortage(m), Code::torque_exceeded, "effects",
          "motor {}: the reference alone takes {:.3g} N m, and its drive gives less ({}); the motors are "
          "short in {:.2g} % of "
          "the ticks",
          i + 1, m.drive_short[i],
          find_effect<ThermalLimit>(s.effects) ? "thermal_limit" : "torque_saturation",
          100.0 * m.short_ticks / m.ticks);
  }
  const char* unit = s.reference.type == ReferenceType::joint_sine ? "rad" : "m";
  if (m.position_jump > 0.0)
    f.error(Code::reference_jumps, "reference", "the reference jumps by {:.3g} {} in one tick",
            m.position_jump, unit);
  if (m.speed_jump > 0.05 * m.speed_max) {
    f.warning(Code::reference_jumps, "reference",
              "at t = {:.3f} s the speed of the reference jumps by {:.3g} {}/s: a blow for the motors, and "
              "no law follows "
              "it{}",
              m.jump_t, m.speed_jump, unit,
              s.reference.type == ReferenceType::file ? "; let the table end at rest" : "");
  }
}

/// Splines through the corners of a table leave the box of its points.
void judge_table(const Scene& s, const Margins& m, Findings& f) {
  if (s.reference.type != ReferenceType::file) return;
  Extent x, y;
  for (const PathPoint& p : s.reference.table) {
    x.widen(p.x);
    y.widen(p.y);
  }
  const double beyond = std::max({x.low - m.x.low, m.x.high - x.high, y.low - m.y.low, m.y.high - y.high});
  if (beyond > 0.02 * std::max(x.high - x.low, y.high - y.low)) {
    f.warning(Code::reference_overshoots, "reference.path",
              "between its points the spline goes {:.3g} mm beyond all of them: more points at the corners",
              1e3 * beyond);
  }
}

/// Limits of the controller, at the start or along the reference.
void judge_limits(const Scene& s, const Margins& m, bool start, Findings& f) {
  const auto least = [&](double v) {
    return fmt::format(fmt::runtime(start ? "= {:.3g} at the start" : "falls to {:.3g} along the reference"),
                       v);
  };
  if (!(m.sin_type1 >= s.limits.min_abs_sin_type1)) {
    f.error(Code::limit_crossed, "limits.min_abs_sin_type1",
            "|sin theta_j2| {}, below limits.min_abs_sin_type1 = {}", least(m.sin_type1),
            s.limits.min_abs_sin_type1);
  }
  if (guarded_type2(s) && !(m.sin_type2 >= s.limits.min_abs_sin_type2))
    f.error(Code::limit_crossed, "limits.min_abs_sin_type2", "|D2| {}, below limits.min_abs_sin_type2 = {}",
            least(m.sin_type2), s.limits.min_abs_sin_type2);
  if (const auto& w = s.limits.workspace; w && (m.x.beyond((*w)[0]) || m.y.beyond((*w)[1]))) {
    f.error(Code::limit_crossed, "limits.workspace", "{} beyond limits.workspace",
            start ? fmt::format("the start ({:.3g}, {:.3g}) m is", m.x.low, m.y.low)
                  : fmt::format("the reference spans x = [{:.3g}, {:.3g}], y = [{:.3g}, {:.3g}] m,", m.x.low,
                                m.x.high, m.y.low, m.y.high));
  }
  for (std::size_t i = 0; i < 2; ++i) {
    const Extent& angle = m.angle[i];
    if (s.limits.joint_angle && angle.beyond((*s.limits.joint_angle)[i])) {
      f.error(Code::limit_crossed, "limits.joint_angle", "base joint {} {}, beyond limits.joint_angle", i + 1,
              start ? fmt::format("starts at {:.3g} rad", angle.low)
                    : fmt::format("spans [{:.3g}, {:.3g}] rad along the reference", angle.low, angle.high));
    }
    if (!(m.joint_speed[i] <= s.limits.joint_speed)) {
      f.error(Code::limit_crossed, "limits.joint_speed",
              "base joint {} {} at {:.3g} rad/s{}, limits.joint_speed = {}", i + 1,
              start ? "starts" : "turns", m.joint_speed[i], start ? "" : " along the reference",
              s.limits.joint_speed);
    }
  }
}

void judge_preload(const Scene& s, const Margins& m, Findings& f) {
  for (std::size_t i = 0; i < m.preload.size(); ++i) {
    if (!(m.preload[i] < std::abs(s.preload[i]) * (1.0 - 1e-9))) continue;
    f.warning(
        Code::preload_lost, "control.preload",
        "motor {}: of control.preload = {:g} N m {:.3g} N m are left at t = {:.3f} s{}: other signs, less of "
        "it, or a higher torque_limit",
        i + 1, s.preload[i], std::copysign(1.0, s.preload[i]) * m.preload[i], m.preload_t[i],
        m.preload[i] > 0.0 ? "" : ", its sign is lost and the gear changes sides");
  }
}

void judge_motion(const Scene& s, const Margins& start, const Margins& m, Findings& f) {
  judge_step(s, f);
  if (s.closed_loop())
    judge_limits(s, start, true, f);
  else
    judge_open_loop(s, f);
  if (!m.unreachable.empty()) f.error(Code::unreachable, "reference", "{}", m.unreachable);
  if (!m.unreachable.empty() || !s.closed_loop()) return;
  judge_limits(s, m, false, f);
  judge_preload(s, m, f);
  if (m.together)
    judge_together(s, m, f);
  else
    judge_each(s, m, f);
  judge_drives(s, m, f);
  judge_table(s, m, f);
  judge_gains(s, f);
}

void judge_bus(const Scene& s, const BusAnalysis& bus, Findings& f) {
  if (bus.load > 1.0) {
    f.error(Code::bus_load, "bus.bitrate", "the bus cannot carry the loop: load {:.0f} % at {} bit/s",
            100.0 * bus.load, s.bitrate);
    return;
  }
  if (bus.load > 0.8)
    f.warning(Code::bus_load, "bus.bitrate", "bus load {:.0f} %: above 80 % frames wait for each other",
              100.0 * bus.load);
  if (bus.answers_s > patience_ticks * s.tick()) {
    f.warning(
        Code::bus_latency, "control.rate_hz",
        "the drives' answers to SYNC take up to {:.0f} us, and against the clock the controller waits {:.0f} "
        "us (40 % of a tick): what is later is used one tick old{}; on a bus of their own they are in time "
        "up to {:.0f} Hz, less what the drives need",
        1e6 * bus.answers_s, 1e6 * patience_ticks * s.tick(),
        s.drives.torque_mismatch > 0.0 && s.drives.torque_time < s.tick()
            ? ", and torques are compared a tick late: drives.torque_time is shorter"
            : "",
        std::floor(patience_ticks / bus.answers_s));
  }
  if (s.command) {
    std::uint32_t last = 0;
    for (const BusMessage& m : bus_messages(s)) {
      if (m.role != BusMessage::Role::other && !m.extended) last = std::max(last, m.id);
    }
    if (static_cast<std::uint32_t>(s.command->base_id) < last) {
      f.warning(Code::bus_latency, "command.base_id",
                "command.base_id 0x{:X} comes before drive frames (up to 0x{:X}) on the bus: unscheduled "
                "orders delay them, beyond the latencies stated here",
                s.command->base_id, last);
    }
  }
  const BusAnalysis::Message* before = nullptr;
  for (const BusAnalysis::Message& m : bus.messages) {
    if (before != nullptr && before->id == m.id && before->extended == m.extended) {
      f.warning(
          Code::identifier_clash, "drives",
          "the frames \"{}\" and \"{}\" share the identifier 0x{:X}: sent at the same time they destroy each "
          "other; give each its own",
          before->name, m.name, m.id);
    }
    before = &m;
    if (m.name == "babbling_node" || (m.response_s && *m.response_s <= m.period_s)) continue;
    f.warning(Code::bus_latency, "bus.bitrate",
              "the frame \"{}\" (identifier 0x{:X}) can be {}, and the next one is due after {:.0f} us",
              m.name, m.id,
              m.response_s ? fmt::format("{:.0f} us late", 1e6 * *m.response_s) : "late without bound",
              1e6 * m.period_s);
  }
}

Json bus_json(const BusAnalysis& bus) {
  const auto known = [](const std::optional<double>& v) { return v ? Json(*v) : Json(nullptr); };
  Json j = {{"load", bus.load}, {"tick_frames_s", bus.tick_s}, {"worst_latency_s", known(bus.loop_s)}};
  j["messages"] = Json::array();
  for (const BusAnalysis::Message& m : bus.messages) {
    j["messages"].push_back({{"name", m.name},
                             {"id", m.id},
                             {"extended", m.extended},
                             {"period_s", m.period_s},
                             {"bits", m.bits},
                             {"response_s", known(m.response_s)}});
  }
  return j;
}

std::string bus_text(const BusAnalysis& bus) {
  const auto us = [](const std::optional<double>& v) {
    return v ? fmt::format("{:.0f}", 1e6 * *v) : "no bound";
  };
  std::string out = fmt::format(
      "bus: load {:.0f} %, frames of one tick take {} us at worst\nlatency at worst, us:", 100.0 * bus.load,
      us(bus.tick_s));
  for (const BusAnalysis::Message& m : bus.messages) out += fmt::format(" {} {},", m.name, us(m.response_s));
  return out + fmt::format(" from sample to torque {}\n", us(bus.loop_s));
}

struct Judgement {
  Margins margins;
  BusAnalysis bus;
  std::vector<ProbePart> parts;
  Findings findings;
};

/// Heartbeats are 10 ms apart, as they are asked of drives; in MIT mode every answer counts as one.
void judge_heartbeats(const Scene& scene, Findings& f) {
  constexpr double period = 0.01, late = 0.1;
  const double timeout = scene.drives.heartbeat_timeout;
  if (scene.drives.protocol == Protocol::mit) return;
  if (timeout < period) {
    f.warning(
        Code::heartbeat_timeout, "drives.heartbeat_timeout",
        "drives.heartbeat_timeout = {:g} s is less than the 10 ms between two heartbeats: heartbeat_lost",
        timeout);
  }
  if (timeout > late) {
    f.warning(Code::heartbeat_timeout, "drives.heartbeat_timeout",
              "drives.heartbeat_timeout = {:g} s: for so long a drive without heartbeats is believed to give "
              "torque",
              timeout);
  }
}

void judge_odrive(const Scene& scene, Findings& f) {
  if (!scene.odrive()) return;
  if (std::ranges::find(scene.drives.nodes, 0) != scene.drives.nodes.end())
    f.warning(Code::node_zero, "drives.nodes",
              "drives.nodes names node 0, which no bus may have; take 1 or more");
  if (scene.rate_hz > 1000.0)
    f.warning(Code::sample_rate, "control.rate_hz", "ODrive sends encoder estimates at 1 kHz at most");
}

Judgement judge(const Scene& scene, Log& log) {
  Judgement v{margins(scene, log), analyse_bus(scene), {}, {}};
  judge_motion(scene, start_margins(scene), v.margins, v.findings);
  judge_bus(scene, v.bus, v.findings);
  judge_heartbeats(scene, v.findings);
  judge_odrive(scene, v.findings);
  judge_units(scene, v.findings);
  if (scene.closed_loop() && v.margins.unreachable.empty() && v.margins.ticks > 1) {
    v.parts = probe_scene(scene, v.margins);
    judge_probe(v.margins, v.parts, v.findings);
  }
  return v;
}

const char* verdict(const Findings& f) {
  return f.refused() ? "unfit" : f.count(Level::warning) > 0 ? "warnings" : "fit";
}

Json report_json(const Scene& scene, const Judgement& v, const std::string& obstacle) {
  const auto& [m, bus, parts, f] = v;
  const bool five_bar = scene.type == MechanismType::five_bar;
  Json j;
  j["scene"] = scene.name;
  j["verdict"] = verdict(f);
  j["runs"] = !f.refused();
  j["runs_on_bus"] = !f.refused() && obstacle.empty();
  j["not_on_bus_because"] = obstacle.empty() ? Json(nullptr) : Json(obstacle);
  j["margins"] = {
      {"min_abs_sin_type1", m.sin_type1},
      {"min_abs_sin_type2", five_bar ? Json(m.sin_type2) : Json(nullptr)},
      {"max_joint_speed", std::max(m.joint_speed[0], m.joint_speed[1])},
      {"max_torque_nm", m.torque},
      {"torque_share", scene.closed_loop() && std::isfinite(m.share) ? Json(m.share) : Json(nullptr)},
      {"least_preload_nm", m.preload.empty() ? Json(nullptr) : Json(m.preload)}};
  j["bus"] = bus_json(bus);
  j["simulated"] = Json::array();
  for (const ProbePart& p : v.parts) {
    j["simulated"].push_back({{"t", p.t},
                              {"ticks", p.ticks},
                              {"mean_change_share", p.change},
                              {"growth_per_tick", p.growth},
                              {"max_error_m", p.error},
                              {"saturated_share", p.saturated},
                              {"fault", p.fault.empty() ? Json(nullptr) : Json(p.fault)}});
  }
  j["findings"] = Json::array();
  for (const Finding& one : f.list()) {
    j["findings"].push_back(
        {{"level", name(one.level)}, {"code", name(one.code)}, {"where", one.where}, {"text", one.text}});
  }
  return j;
}

std::string headline(const Findings& f, const std::string& obstacle) {
  const auto warnings = f.count(Level::warning);
  return fmt::format(
      "{}{}",
      f.refused()        ? "would not run through"
      : obstacle.empty() ? "fit to run"
                         : "fit for sim, not for a bus: " + obstacle,
      f.refused() || warnings == 0 ? "" : fmt::format("; {} warning{}", warnings, warnings == 1 ? "" : "s"));
}

/// Torques along the reference, and the verdict. `log`: check.csv.
std::string check_page(const RunOptions& o, const Scene& scene, const Json& j, const std::string& words,
                       const Findings& f, const Log& log) {
  std::vector<Series> torques;
  for (std::size_t c = 0; c < log.columns().size(); ++c) {
    if (!log.columns()[c].starts_with("tau")) continue;
    torques.push_back({log.columns()[c], {}});
    for (const SeriesRow& row : log.thinned())
      torques.back().points.emplace_back(row.values[0], row.values[c]);
  }
  using enum StudyVerdict::Level;
  return study_page("Check of " + scene.name, o.command_line,
                    figures_html({chart_svg("Torque along the reference", "t, s", "N m", torques,
                                            Scale::linear, Scale::linear)}) +
                        document_html(j),
                    {f.refused()                   ? bad
                     : f.count(Level::warning) > 0 ? warn
                                                   : ok,
                     words,
                     "",
                     {}});
}

std::string report_text(const Scene& scene, const Judgement& v, const std::string& obstacle) {
  const auto& [m, bus, parts, f] = v;
  std::string out = fmt::format("{}: {}\n", printable(scene.name), headline(f, obstacle));
  const bool five_bar = scene.type == MechanismType::five_bar;
  out += fmt::format("along the reference: |sin theta_j2| >= {:.3g},{} base joints <= {:.3g} rad/s\n",
                     m.sin_type1, five_bar ? fmt::format(" |D2| >= {:.3g},", m.sin_type2) : "",
                     std::max(m.joint_speed[0], m.joint_speed[1]));
  for (std::size_t i = 0; i < m.torque.size(); ++i)
    out += fmt::format("motor {}: <= {:.3g} N m\n", i + 1, m.torque[i]);
  if (m.together && scene.closed_loop()) {
    out += fmt::format("four motors together: <= {:.3g} % of what they give within torque_limit\n",
                       100.0 * m.share);
  }
  out += bus_text(bus);
  for (const Finding& one : f.list()) out += fmt::format("{}: {}\n", name(one.level), one.text);
  return out;
}

}  // namespace

std::string refusal_of(const Scene& scene, bool on_bus) {
  Log log(nullptr, {}, 0);
  const Findings f = judge(scene, log).findings;
  for (const Finding& one : f.list()) {
    const bool used_up = one.code == Code::torque_exceeded || one.code == Code::gain_margin;
    if (one.level == Level::error || (on_bus && used_up)) return one.text;
  }
  return on_bus ? bus_obstacle(scene).what : "";
}

int run_check(const RunOptions& o) {
  const Scene scene = read_scene(o.scene, o.sets);
  OutputDirectory out(o.out);
  Log log(out.open("check.csv"), check_columns(scene), tick_count(scene));
  const Judgement v = judge(scene, log);
  log.close();
  if (out.wanted()) write_scene(scene, out);
  const std::string obstacle = bus_obstacle(scene).what;
  const Json j = report_json(scene, v, obstacle);
  publish({"check", j, report_text(scene, v, obstacle),
           [&] { return check_page(o, scene, j, headline(v.findings, obstacle), v.findings, log); }},
          o.json, out);
  return v.findings.refused() ? 1 : 0;
}

}  // namespace esmc::host
