#include "host_sim/check/check.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <numbers>

#include "host_sim/bus/response.hpp"
#include "host_sim/check/sampled.hpp"
#include "host_sim/design/efforts.hpp"
#include "host_sim/loop/halves.hpp"
#include "host_sim/record/finish.hpp"
#include "host_sim/record/recorder.hpp"

namespace esmc::host {
namespace {

using Json = nlohmann::ordered_json;

/// Smallest margins and largest demands along the reference, for the true mechanism.
struct Margins {
  double sin_type1 = 1.0, sin_type2 = 1.0;
  double joint_speed = 0.0;
  std::vector<double> torque;                               ///< largest per motor, N m
  bool together = false;                                    ///< four motors share what is asked
  double share = 0.0, share_t = 0.0;                        ///< of torque_limit, the largest, and when, s
  std::vector<double> share_torque;                         ///< per motor at that time, N m
  double x[2] = {1e300, -1e300}, y[2] = {1e300, -1e300};    ///< extent of the effector's path, m
  double angle[2][2] = {{1e300, -1e300}, {1e300, -1e300}};  ///< of the base joints, rad
  std::vector<double> preload,
      preload_t;  ///< least torque towards control.preload per motor, N m, and when; where none is asked, 0
  std::string unreachable;  ///< when the reference cannot be followed
};

double sign_of(double v) { return std::copysign(1.0, v); }

/// Where the run begins: the first tick is guarded like every other.
struct Start {
  double sin_type1 = 1.0, sin_type2 = 1.0;
  std::array<double, 2> effector{}, base{}, rate{};
};

template <class World>
Start start_of(const Scene& scene) {
  using M = typename World::Mechanism;
  const M m = make_mechanism(scene.mechanism, static_cast<M*>(nullptr));
  Vec<double, M::joints> q;
  for (int i = 0; i < M::joints; ++i) q[i] = scene.start_angle[static_cast<std::size_t>(i)];
  const typename M::Pose p = m.pose(q);
  Start s;
  s.sin_type1 = M::min_abs_sin_type1(p);
  s.sin_type2 = M::abs_sin_type2(p);
  s.effector = {p.effector.x(), p.effector.y()};
  for (std::size_t i = 0; i < 2; ++i) {
    const auto joint = static_cast<std::size_t>(ControllerConfig<M>::joint_of(static_cast<int>(i), 2));
    s.base[i] = scene.start_angle[joint];
    s.rate[i] = scene.start_rate[joint];
  }
  return s;
}

/// Columns of check.csv: what the reference asks of each joint and motor, tick by tick.
template <class World>
std::vector<std::string> columns(const Scene& scene) {
  using M = typename World::Mechanism;
  const auto joint = [](int i, int of) {
    return static_cast<std::size_t>(ControllerConfig<M>::joint_of(i, of));
  };
  std::vector<std::string> c{"t", "x_ref", "y_ref"};
  for (int i = 0; i < 2; ++i) c.push_back(World::joint_names[joint(i, 2)] + std::string("_ref"));
  for (int i = 0; i < scene.motors(); ++i) c.emplace_back(World::torque_names[joint(i, scene.motors())]);
  c.emplace_back("min_abs_sin_type1");
  if (scene.type == MechanismType::five_bar) c.emplace_back("abs_D2");
  return c;
}

/// How torques are shared out: as the controller does it; without one, by motors that have no limits.
template <class M>
ControllerConfig<M> sharing(const Scene& scene, const ReferenceBundle<double>& reference) {
  if (scene.closed_loop()) return make_controller<M>(scene, Pacing::lockstep, reference);
  ControllerConfig<M> c;
  c.torque_limit.setConstant(std::numeric_limits<double>::infinity());
  c.allocate = allocation_for<M>(scene.all_motors ? Motors::all : Motors::base);
  return c;
}

template <class World>
Margins margins(const Scene& scene, Log& log) {
  using M = typename World::Mechanism;
  Margins out;
  out.torque.assign(static_cast<std::size_t>(scene.motors()), 0.0);
  if (scene.reference.type == ReferenceType::none) return out;
  FiveBarParams<double> truth = scene.mechanism;
  if (const auto f = find_effect<ViscousFriction>(scene.effects)) {
    for (std::size_t j = 0; j < 2; ++j) {
      truth.legs[j].d1 = f->coefficient[2 * j];
      truth.legs[j].d2 = f->coefficient[2 * j + 1];
    }
  }
  const M m = make_mechanism(truth, static_cast<M*>(nullptr));
  const typename M::Mode mode = mode_of(scene, static_cast<M*>(nullptr));
  const ReferenceBundle<double> bundle = make_reference(scene, Pacing::lockstep);
  ControllerConfig<M> controller = sharing<M>(scene, bundle);
  controller.mechanism = m;
  out.together = controller.allocate != nullptr;
  Reference<double> reference = bundle.get();
  if (reference.kind == ReferenceKind::hold_start) {
    const M start(make_mechanism(truth, static_cast<M*>(nullptr)));
    Vec<double, M::joints> q;
    for (int i = 0; i < M::joints; ++i) q[i] = scene.start_angle[static_cast<std::size_t>(i)];
    reference.centre = start.pose(q).effector;
  }
  const std::uint32_t ticks = std::min<std::uint32_t>(tick_count(scene), 2'000'000U);
  for (const double asked : scene.preload) out.preload.push_back(std::abs(asked));
  out.preload_t.assign(out.preload.size(), 0.0);
  std::vector<double> row;
  for (std::uint32_t n = 0; n < ticks; ++n) {
    if (stop_requested()) throw RunError("interrupted");
    const Motion2<double> r = reference.at(n, scene.tick());
    const auto d = reference.space == ReferenceSpace::effector
                       ? desired_at_effector(m, mode, r.position, r.velocity, r.acceleration)
                       : desired_at_base(m, mode, r.position, r.velocity, r.acceleration);
    if (!d) {
      out.unreachable =
          fmt::format("the reference leaves the reach of the mechanism at t = {:.3f} s", n * scene.tick());
      return out;
    }
    out.sin_type1 = std::min(out.sin_type1, M::min_abs_sin_type1(d->pose));
    out.sin_type2 = std::min(out.sin_type2, M::abs_sin_type2(d->pose));
    const auto widen = [](double(&range)[2], double v) {
      range[0] = std::min(range[0], v);
      range[1] = std::max(range[1], v);
    };
    const Vec2<double> base_angle = M::base_angles(d->pose);
    widen(out.x, d->pose.effector.x());
    widen(out.y, d->pose.effector.y());
    for (int i = 0; i < 2; ++i) widen(out.angle[i], base_angle[i]);
    const Vec2<double> rate = M::base(d->rates);
    out.joint_speed = std::max({out.joint_speed, std::abs(rate[0]), std::abs(rate[1])});
    const auto w = m.force(m.channel_accelerations(d->pose, d->rates, d->acceleration), d->rates);
    const auto effort = design::effort(controller, d->pose, w);
    const double share = design::share_of_limits(controller, d->pose, w, effort);
    const bool most = !(share <= out.share);
    if (most) {
      out.share = share;
      out.share_t = n * scene.tick();
      out.share_torque.clear();
    }
    row.assign({n * scene.tick(), d->pose.effector.x(), d->pose.effector.y(), base_angle[0], base_angle[1]});
    for (std::size_t i = 0; i < out.torque.size(); ++i) {
      const double t = effort.torque[ControllerConfig<M>::joint_of(static_cast<int>(i), scene.motors())];
      out.torque[i] = std::max(out.torque[i], std::abs(t));
      row.push_back(t);
      if (most) out.share_torque.push_back(t);
      if (i >= out.preload.size() || scene.preload[i] == 0.0) continue;
      const double towards = sign_of(scene.preload[i]) * t;
      if (!(towards < out.preload[i])) continue;
      out.preload[i] = towards;
      out.preload_t[i] = n * scene.tick();
    }
    row.push_back(M::min_abs_sin_type1(d->pose));
    if (scene.type == MechanismType::five_bar) row.push_back(M::abs_sin_type2(d->pose));
    if (log.wanted()) log.row(row, "");
  }
  return out;
}

/// With every joint driven and measured, type 2 is no singularity of the loop.
bool guarded_type2(const Scene& s) {
  return s.type == MechanismType::five_bar && !(s.all_motors && s.all_sensors);
}

void judge_start(const Scene& s, const Start& at, Findings& f) {
  const auto beyond = [](double v, const std::array<double, 2>& allowed) {
    return !(v >= allowed[0] && v <= allowed[1]);
  };
  if (!(at.sin_type1 >= s.limits.min_abs_sin_type1)) {
    f.error(fmt::format("|sin theta_j2| = {:.3g} at the start, below limits.min_abs_sin_type1 = {}",
                        at.sin_type1, s.limits.min_abs_sin_type1));
  }
  if (guarded_type2(s) && !(at.sin_type2 >= s.limits.min_abs_sin_type2)) {
    f.error(fmt::format("|D2| = {:.3g} at the start, below limits.min_abs_sin_type2 = {}", at.sin_type2,
                        s.limits.min_abs_sin_type2));
  }
  if (s.limits.workspace && (beyond(at.effector[0], (*s.limits.workspace)[0]) ||
                             beyond(at.effector[1], (*s.limits.workspace)[1]))) {
    f.error(fmt::format("the start ({:.3g}, {:.3g}) m is beyond limits.workspace", at.effector[0],
                        at.effector[1]));
  }
  for (std::size_t i = 0; i < 2; ++i) {
    if (s.limits.joint_angle && beyond(at.base[i], (*s.limits.joint_angle)[i])) {
      f.error(
          fmt::format("base joint {} starts at {:.3g} rad, beyond limits.joint_angle", i + 1, at.base[i]));
    }
    if (!(std::abs(at.rate[i]) <= s.limits.joint_speed)) {
      f.error(fmt::format("base joint {} starts at {:.3g} rad/s, limits.joint_speed = {}", i + 1, at.rate[i],
                          s.limits.joint_speed));
    }
  }
}

/// Effects that act tick by tick have no place where there are no ticks.
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
  f.warning(fmt::format("without a controller there are no ticks and no readings: {} {} no effect", idle,
                        idle.find(',') == std::string::npos ? "has" : "have"));
}

constexpr double much = 0.7;  ///< share of a limit that leaves little to correct errors with

void judge_each(const Scene& s, const Margins& m, Findings& f) {
  for (std::size_t i = 0; i < m.torque.size(); ++i) {
    const double share = m.torque[i] / s.torque_limit[i];
    const std::string text =
        fmt::format("motor {}: the reference alone takes {:.3g} N m of torque_limit = {} N m", i + 1,
                    m.torque[i], s.torque_limit[i]);
    if (!(share <= 1.0)) {
      f.error(text);
    } else if (share > much) {
      f.warning(text + "; little is left to correct errors with");
    }
  }
}

/// Of four motors one gives what another one may not: none of them is at fault by itself.
void judge_together(const Scene& s, const Margins& m, Findings& f) {
  if (!(m.share <= 1.0)) {
    std::vector<std::size_t> held;
    for (std::size_t i = 0; i < m.share_torque.size(); ++i) {
      if (!(std::abs(m.share_torque[i]) < s.torque_limit[i] * (1.0 - 1e-9))) held.push_back(i + 1);
    }
    std::string names;
    for (std::size_t k = 0; k < held.size(); ++k) {
      names += fmt::format("{}{}", k == 0 ? "" : (k + 1 == held.size() ? " and " : ", "), held[k]);
    }
    f.error(
        fmt::format("motor{} {}: at their torque_limit the four motors together give {:.3g} % of what "
                    "the reference alone takes (t = {:.3f} s)",
                    held.size() == 1 ? "" : "s", names, 100.0 / m.share, m.share_t));
  } else if (m.share > much) {
    f.warning(
        fmt::format("the reference alone takes {:.3g} % of what the four motors together give within "
                    "torque_limit (t = {:.3f} s); little is left to correct errors with",
                    100.0 * m.share, m.share_t));
  }
}

void judge(const Scene& s, const Start& at, const Margins& m, Findings& f) {
  judge_step(s, f);
  if (!s.closed_loop()) judge_open_loop(s, f);
  if (s.closed_loop()) judge_start(s, at, f);
  if (!m.unreachable.empty()) {
    f.error(m.unreachable);
    return;
  }
  if (!s.closed_loop()) return;
  if (m.sin_type1 < s.limits.min_abs_sin_type1) {
    f.error(
        fmt::format("|sin theta_j2| falls to {:.3g} along the reference, below limits.min_abs_sin_type1 = {}",
                    m.sin_type1, s.limits.min_abs_sin_type1));
  }
  if (guarded_type2(s) && m.sin_type2 < s.limits.min_abs_sin_type2) {
    f.error(fmt::format("|D2| falls to {:.3g} along the reference, below limits.min_abs_sin_type2 = {}",
                        m.sin_type2, s.limits.min_abs_sin_type2));
  }
  if (m.joint_speed > s.limits.joint_speed) {
    f.error(fmt::format("a base joint turns at {:.3g} rad/s along the reference, limits.joint_speed = {}",
                        m.joint_speed, s.limits.joint_speed));
  }
  const auto outside = [](const double(&range)[2], const std::array<double, 2>& allowed) {
    return range[0] < allowed[0] || range[1] > allowed[1];
  };
  if (s.limits.workspace &&
      (outside(m.x, (*s.limits.workspace)[0]) || outside(m.y, (*s.limits.workspace)[1]))) {
    f.error(fmt::format(
        "the reference spans x = [{:.3g}, {:.3g}], y = [{:.3g}, {:.3g}] m, beyond limits.workspace", m.x[0],
        m.x[1], m.y[0], m.y[1]));
  }
  for (std::size_t i = 0; s.limits.joint_angle && i < 2; ++i) {
    if (outside(m.angle[i], (*s.limits.joint_angle)[i])) {
      f.error(fmt::format(
          "base joint {} spans [{:.3g}, {:.3g}] rad along the reference, beyond limits.joint_angle", i + 1,
          m.angle[i][0], m.angle[i][1]));
    }
  }
  for (std::size_t i = 0; i < m.preload.size(); ++i) {
    const double asked = std::abs(s.preload[i]);
    if (!(m.preload[i] < asked * (1.0 - 1e-9))) continue;
    f.warning(
        fmt::format("motor {}: of control.preload = {:g} N m {:.3g} N m are left at t = {:.3f} s{}: other "
                    "signs, less of it, or a higher "
                    "torque_limit",
                    i + 1, s.preload[i], sign_of(s.preload[i]) * m.preload[i], m.preload_t[i],
                    m.preload[i] > 0.0 ? "" : ", its sign is lost and the gear changes sides"));
  }
  if (m.together) {
    judge_together(s, m, f);
  } else {
    judge_each(s, m, f);
  }
  judge_gains(s, f);
}

void judge_bus(const Scene& s, const BusAnalysis& bus, Findings& f) {
  if (bus.load > 1.0) {
    f.error(
        fmt::format("the bus cannot carry the loop: load {:.0f} % at {} bit/s", 100.0 * bus.load, s.bitrate));
    return;
  }
  if (bus.load > 0.8)
    f.warning(fmt::format("bus load {:.0f} %: above 80 % frames wait for each other", 100.0 * bus.load));
  if (bus.answers_s > patience_ticks * s.tick()) {
    f.warning(
        fmt::format("the drives' answers to SYNC take up to {:.0f} us, and against the clock the controller "
                    "waits {:.0f} us (40 % of a "
                    "tick): what is later is used one tick old{}; on a bus of their own they are in time up "
                    "to {:.0f} Hz, less what the drives need",
                    1e6 * bus.answers_s, 1e6 * patience_ticks * s.tick(),
                    s.drives.torque_mismatch > 0.0 && s.drives.torque_time < s.tick()
                        ? ", and torques are compared a tick late: drives.torque_time is shorter"
                        : "",
                    std::floor(patience_ticks / bus.answers_s)));
  }
  if (s.command) {
    std::uint32_t last = 0;
    for (const BusMessage& m : bus_messages(s)) {
      if (m.role != BusMessage::Role::other && !m.extended) last = std::max(last, m.id);
    }
    if (static_cast<std::uint32_t>(s.command->base_id) < last) {
      f.warning(fmt::format(
          "command.base_id 0x{:X} comes before drive frames (up to 0x{:X}) on the bus: orders that nobody "
          "foresees delay them, beyond the latencies stated here",
          s.command->base_id, last));
    }
  }
  const BusAnalysis::Message* before = nullptr;
  for (const BusAnalysis::Message& m : bus.messages) {
    if (before != nullptr && before->id == m.id && before->extended == m.extended) {
      f.warning(fmt::format(
          "the frames \"{}\" and \"{}\" share the identifier 0x{:X}: sent at the same time they destroy "
          "each other; give each its own",
          before->name, m.name, m.id));
    }
    before = &m;
    if (m.name == "babbling_node" || (m.response_s && *m.response_s <= m.period_s)) continue;
    f.warning(fmt::format(
        "the frame \"{}\" (identifier 0x{:X}) can be {}, and the next one is due after {:.0f} us", m.name,
        m.id, m.response_s ? fmt::format("{:.0f} us late", 1e6 * *m.response_s) : "late without bound",
        1e6 * m.period_s));
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

struct Verdict {
  Margins margins;
  BusAnalysis bus;
  Findings findings;
};

/// Heartbeats are 10 ms apart, as they are asked of drives; in MIT mode every answer counts as one.
void judge_heartbeats(const Scene& scene, Findings& f) {
  constexpr double period = 0.01, late = 0.1;
  const double timeout = scene.drives.heartbeat_timeout;
  if (scene.drives.protocol == Protocol::mit) return;
  if (timeout < period) {
    f.warning(fmt::format(
        "drives.heartbeat_timeout = {:g} s is less than the 10 ms between two heartbeats: heartbeat_lost",
        timeout));
  }
  if (timeout > late) {
    f.warning(
        fmt::format("drives.heartbeat_timeout = {:g} s: for so long a drive without heartbeats is believed "
                    "to give torque",
                    timeout));
  }
}

template <class World>
Verdict judge(const Scene& scene, Log& log) {
  Verdict v{margins<World>(scene, log), analyse_bus(scene), {}};
  Findings& f = v.findings;
  judge(scene, start_of<World>(scene), v.margins, f);
  const bool odrive =
      scene.drives.protocol == Protocol::odrive || scene.drives.protocol == Protocol::odrive_0_5;
  judge_bus(scene, v.bus, f);
  judge_heartbeats(scene, f);
  if (odrive &&
      std::find(scene.drives.nodes.begin(), scene.drives.nodes.end(), 0) != scene.drives.nodes.end()) {
    f.warning(
        "drives.nodes names node 0: its command 0 has the identifier of CANopen's NMT, and a drive that "
        "nobody has "
        "given a number may be 0; take 1 or more");
  }
  if (odrive && scene.rate_hz > 1000.0) f.warning("ODrive sends encoder estimates at 1 kHz at most");
  return v;
}

template <class World>
int report(const Scene& scene, const RunOptions& o) {
  OutputDirectory out(o.out);
  Log log(out.open("check.csv"), columns<World>(scene), tick_count(scene));
  const auto [m, bus, f] = judge<World>(scene, log);
  log.close();
  const std::string obstacle = bus_obstacle(scene).what;
  Json j;
  j["scene"] = scene.name;
  j["runs"] = !f.refused();
  j["runs_on_bus"] = !f.refused() && obstacle.empty();
  j["not_on_bus_because"] = obstacle.empty() ? Json(nullptr) : Json(obstacle);
  j["margins"] = {
      {"min_abs_sin_type1", m.sin_type1},
      {"min_abs_sin_type2", scene.type == MechanismType::five_bar ? Json(m.sin_type2) : Json(nullptr)},
      {"max_joint_speed", m.joint_speed},
      {"max_torque_nm", m.torque},
      {"torque_share", scene.closed_loop() && std::isfinite(m.share) ? Json(m.share) : Json(nullptr)},
      {"least_preload_nm", m.preload.empty() ? Json(nullptr) : Json(m.preload)}};
  j["bus"] = bus_json(bus);
  j["findings"] = f.list();
  if (out.wanted()) {
    write_scene(scene, out);
    out.commit();
  }
  if (o.json) {
    fmt::print("{}\n", j.dump(2));
  } else {
    fmt::print("{}: {}\n", printable(scene.name),
               f.refused()        ? "would not run through"
               : obstacle.empty() ? "fit to run"
                                  : "fit for sim, not for a bus: " + obstacle);
    const std::string type2 =
        scene.type == MechanismType::five_bar ? fmt::format(" |D2| >= {:.3g},", m.sin_type2) : std::string();
    fmt::print("along the reference: |sin theta_j2| >= {:.3g},{} base joints <= {:.3g} rad/s\n", m.sin_type1,
               type2, m.joint_speed);
    for (std::size_t i = 0; i < m.torque.size(); ++i)
      fmt::print("motor {}: <= {:.3g} N m\n", i + 1, m.torque[i]);
    if (m.together && scene.closed_loop())
      fmt::print("four motors together: <= {:.3g} % of what they give within torque_limit\n",
                 100.0 * m.share);
    fmt::print("{}", bus_text(bus));
    for (const Json& item : f.list()) {
      fmt::print("{}: {}\n", item["level"].get<std::string>(), item["text"].get<std::string>());
    }
    if (out.wanted()) fmt::print("torques along the reference: {}/check.csv\n", out.directory());
  }
  return f.refused() ? 1 : 0;
}

}  // namespace

std::string refusal_of(const Scene& scene) {
  Log log(nullptr, {}, 0);
  const Findings f = scene.type == MechanismType::five_bar ? judge<FiveBarWorld>(scene, log).findings
                                                           : judge<RrWorld>(scene, log).findings;
  for (const Json& item : f.list()) {
    if (item["level"] == "error") return item["text"].get<std::string>();
  }
  return bus_obstacle(scene).what;
}

int run_check(const RunOptions& o) {
  const Scene scene = read_scene(o.scene, o.sets);
  return scene.type == MechanismType::five_bar ? report<FiveBarWorld>(scene, o) : report<RrWorld>(scene, o);
}

}  // namespace esmc::host
