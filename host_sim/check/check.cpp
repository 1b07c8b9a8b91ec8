#include "host_sim/check/check.hpp"
#include "host_sim/check/margins.hpp"
#include "host_sim/check/probe.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "host_sim/bus/response.hpp"
#include "host_sim/controller/axes_config.hpp"
#include "host_sim/loop/run.hpp"
#include "host_sim/record/finish.hpp"
#include "host_sim/record/recorder.hpp"
#include "host_sim/report/study_page.hpp"

namespace esmc::host {
namespace {

using Json = nlohmann::ordered_json;

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
      // With bit_timing the drives answer at the tick, all at once.
      f.add(
          find_effect<BitTiming>(s.effects) ? Level::error : Level::warning, Code::identifier_clash, "drives",
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
  Json j = {{"load", bus.load},
            {"rate_max_hz", bus.rate_max_hz},
            {"tick_frames_s", bus.tick_s},
            {"worst_latency_s", known(bus.loop_s)}};
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
      "bus: load {:.0f} %, frames of one tick take {} us at worst, control.rate_hz up to {:.0f}\nlatency at "
      "worst, us:",
      100.0 * bus.load, us(bus.tick_s), bus.rate_max_hz);
  for (const BusAnalysis::Message& m : bus.messages) out += fmt::format(" {} {},", m.name, us(m.response_s));
  return out + fmt::format(" from sample to torque {}\n", us(bus.loop_s));
}

struct Judgement {
  Margins margins;
  BusAnalysis bus;
  std::vector<ProbePart> parts;
  Findings findings;
};

/// Heartbeats are 10 ms apart, as they are asked of drives; in MIT mode and of a moteus every answer counts
/// as one.
void judge_heartbeats(const Scene& scene, Findings& f) {
  constexpr double period = 0.01, late = 0.1;
  const double timeout = scene.drives.heartbeat_timeout;
  if (scene.drives.protocol == Protocol::mit || scene.drives.protocol == Protocol::moteus) return;
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

/// The controller sends one frame of the link in a tick at most.
void judge_link(const Scene& scene, Findings& f) {
  if (!scene.command) return;
  const CommandScene& c = *scene.command;
  const double set = 2.0 + scene.motors(),  // frames of telemetry
      frames = 1.0 / c.status_ticks + (c.telemetry_ticks > 0 ? set / c.telemetry_ticks : 0.0);
  if (frames > 1.0)
    f.warning(
        Code::bus_load, "command.telemetry_ticks",
        "the link sends one frame in a tick at most; Status every {} and {:g} frames of telemetry every "
        "{} ticks are {:.3g} in a tick: Status, or both, come less often",
        c.status_ticks, set, c.telemetry_ticks, frames);
  if (c.arm_by_link && c.timeout == 0.0)
    f.warning(Code::unattended, "command.timeout",
              "command.timeout = 0: a reference goes on, and a set point is held, when the console is gone");
}

void judge_unattended(const Scene& scene, Findings& f) {
  if (!scene.reference.unattended) return;
  const bool watched = scene.command && scene.command->timeout > 0.0;
  f.add(watched ? Level::warning : Level::hint, Code::unattended, "reference.unattended", "{}",
        watched ? "the reference goes on when the console is gone: only faults, orders and the drives' own "
                  "safe torque off end it"
                : "has no effect: without [command] and command.timeout no sign of life is monitored");
}

/// The brake of homing is critically damped: a double pole at a tenth per tick. In a slow loop a weight gains
/// more speed in a tick than it can take away in its time.
void judge_homing(const Scene& scene, Findings& f) {
  const std::vector<double>& speed = scene.drives.homing_speed;
  if (speed.empty()) return;
  with_world(scene, [&]<class World>(World) {  // what no controller takes is an error here, too
    const auto reference = make_reference(scene, Pacing::lockstep);
    (void)make_cycle_config<typename World::Mechanism>(scene, Pacing::lockstep, reference);
  });
  const double ticks = std::max(40.0, 4.0 * scene.limits.halt_time * scene.rate_hz);
  for (std::size_t i = 0; i < speed.size(); ++i) {
    const HomingLoad load = homing_load(scene, i);
    const double gained = load.weight / load.inertia * scene.tick();
    const double left = gained * ticks * std::exp(-0.1 * ticks),
                 most = std::max(std::abs(speed[0]), std::abs(speed[1]));
    // Before the integral carries it; of the weight by experiment, for it seldom pulls its worst.
    const double sinks = 0.75 * load.weight / (load.inertia * homing_bandwidth(scene));
    if (left <= 0.25 * std::abs(speed[i]) && gained <= 0.8 * most && sinks <= 4.0 * most) continue;
    f.warning(
        Code::homing_sinks, "drives.homing_speed",
        "joint {}: its weight gains {:.2g} rad/s in a tick of control.rate_hz = {:g}: in homing it may sink "
        "faster than allowed (joint_speed), or not come to rest in time (halt_failed); a faster loop, a "
        "larger "
        "homing_speed, or homing without gravity",
        i + 1, gained, scene.rate_hz);
    return;
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
  if (scene.closed_loop() && v.margins.unreachable.empty() && v.margins.ticks > 1)
    v.parts = probe_scene(scene, v.margins);
  judge_motion(scene, start_margins(scene), v.margins, saturated_ticks(scene, v.parts), v.findings);
  if (scene.closed_loop()) {  // else it runs in sim alone, which has no bus
    judge_bus(scene, v.bus, v.findings);
    judge_heartbeats(scene, v.findings);
    judge_odrive(scene, v.findings);
    judge_link(scene, v.findings);
  }
  judge_unattended(scene, v.findings);
  judge_homing(scene, v.findings);
  judge_units(scene, v.findings);
  if (!v.parts.empty()) judge_probe(scene, v.margins, v.parts, v.findings);
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
                              {"rate_hz", p.rate_hz},
                              {"mean_change_share", p.change},
                              {"growth_per_tick", p.growth},
                              {"max_error_m", p.error},
                              {"saturated_share", p.saturated},
                              {"fault", p.fault.empty() ? Json(nullptr) : Json(p.fault)},
                              {"diverged_s", p.diverged ? Json(*p.diverged) : Json(nullptr)}});
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
    const bool used_up = one.code == Code::torque_exceeded || one.code == Code::gain_margin,
               of_bus = one.code == Code::bus_load || one.code == Code::identifier_clash;
    if (on_bus ? used_up || one.level == Level::error : one.level == Level::error && !of_bus) return one.text;
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
  if (o.capture != nullptr) {
    o.capture->document = document_text(j);
    return v.findings.refused() ? 1 : 0;
  }
  publish({"check", j, report_text(scene, v, obstacle),
           [&] { return check_page(o, scene, j, headline(v.findings, obstacle), v.findings, log); }},
          o.json, out);
  return v.findings.refused() ? 1 : 0;
}

}  // namespace esmc::host
