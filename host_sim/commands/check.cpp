#include "host_sim/commands/check.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

#include "host_sim/commands/finish.hpp"
#include "host_sim/commands/halves.hpp"
#include "host_sim/commands/recorder.hpp"
#include "host_sim/loop/bus_load.hpp"

namespace esmc::host {
namespace {

using Json = nlohmann::ordered_json;

/// Smallest margins and largest demands along the reference, for the true mechanism.
struct Margins {
  double sin_type1 = 1.0, sin_type2 = 1.0;
  double joint_speed = 0.0;
  std::vector<double> torque;                               ///< largest per motor, N m
  double x[2] = {1e300, -1e300}, y[2] = {1e300, -1e300};    ///< extent of the effector's path, m
  double angle[2][2] = {{1e300, -1e300}, {1e300, -1e300}};  ///< of the base joints, rad
  std::string unreachable;                                  ///< when the reference cannot be followed
};

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
  Reference<double> reference = bundle.get();
  if (reference.kind == ReferenceKind::hold_start) {
    const M start(make_mechanism(truth, static_cast<M*>(nullptr)));
    Vec<double, M::joints> q;
    for (int i = 0; i < M::joints; ++i) q[i] = scene.start_angle[static_cast<std::size_t>(i)];
    reference.centre = start.pose(q).effector;
  }
  const std::uint32_t ticks = std::min<std::uint32_t>(tick_count(scene), 2'000'000U);
  std::vector<double> row;
  for (std::uint32_t n = 0; n < ticks; ++n) {
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
    Vec<double, M::joints> tau = Vec<double, M::joints>::Zero();
    bool allocated = false;
    if constexpr (M::joints == 4) {
      if (scene.all_motors) {
        tau = allocate_all(m, d->pose, w, Vec<double, 4>::Ones().eval());
        allocated = true;
      }
    }
    if (!allocated) {
      const Vec2<double> base = m.base_torque(d->pose, w);
      for (int i = 0; i < 2; ++i) tau[ControllerConfig<M>::joint_of(i, 2)] = base[i];
    }
    row.assign({n * scene.tick(), d->pose.effector.x(), d->pose.effector.y(), base_angle[0], base_angle[1]});
    for (std::size_t i = 0; i < out.torque.size(); ++i) {
      const double t = tau[ControllerConfig<M>::joint_of(static_cast<int>(i), scene.motors())];
      out.torque[i] = std::max(out.torque[i], std::abs(t));
      row.push_back(t);
    }
    row.push_back(M::min_abs_sin_type1(d->pose));
    if (scene.type == MechanismType::five_bar) row.push_back(M::abs_sin_type2(d->pose));
    if (log.wanted()) log.row(row, "");
  }
  return out;
}

class Findings {
 public:
  void error(std::string text) { add("error", std::move(text)); }
  void warning(std::string text) { add("warning", std::move(text)); }
  [[nodiscard]] bool refused() const { return refused_; }
  [[nodiscard]] const Json& list() const { return list_; }

 private:
  void add(const char* level, std::string text) {
    refused_ = refused_ || std::string(level) == "error";
    list_.push_back({{"level", level}, {"text", std::move(text)}});
  }
  Json list_ = Json::array();
  bool refused_ = false;
};

/// How late, in ticks, a torque acts on what it was computed from.
struct Delay {
  double certain = 0.0;  ///< compute_delay and delay
  double lag =
      0.0;  ///< of the drive's observer and of torque_lag: a delay for everything slower than they are
};
Delay delay_of(const Scene& s) {
  Delay d;
  if (const auto e = find_effect<ComputeDelay>(s.effects)) d.certain += e->time * s.rate_hz;
  if (const auto e = find_effect<SensorDelay>(s.effects)) d.certain += e->ticks;
  const auto encoder = find_effect<Encoder>(s.effects);
  const auto noise = find_effect<SensorNoise>(s.effects);
  // Two poles at the bandwidth: each is late by its inverse.
  if (encoder || noise) d.lag += 2.0 / (encoder ? encoder->bandwidth : noise->bandwidth) * s.rate_hz;
  if (const auto e = find_effect<TorqueLag>(s.effects)) d.lag += e->time_constant * s.rate_hz;
  return d;
}

/// The sampled loop near the surface: docs/theory.md, "Boundary layers and the implicit law".
void judge_gains(const Scene& s, Findings& f) {
  const bool sliding =
      s.law == LawChoice::esmc || s.law == LawChoice::esmc_projected || s.law == LawChoice::smc;
  if (!sliding) return;
  const Delay d = delay_of(s);
  if (s.reaching == ReachingChoice::sign)
    f.warning("reaching = \"sign\" chatters in a sampled loop; \"implicit\" does not");
  if (s.reaching == ReachingChoice::implicit) {
    const double late = std::round(d.certain + d.lag), told = s.delay_ticks.value_or(0.0);
    if (late > told) {
      f.warning(
          fmt::format("sensors and drives of this scene are late by about {} tick{}, the implicit law is "
                      "told {}: it will "
                      "chatter; set control.delay_ticks = {}",
                      late, late == 1.0 ? "" : "s", told, late));
    }
    return;
  }
  if (s.reaching == ReachingChoice::sign) return;
  // kappa T <= 0.3, and below half of the bound on stability 2 sin(pi/(4 d + 2)) [F39]
  const double kappa_t = std::max(s.gain.position / s.layer.position + s.lambda.position,
                                  s.gain.angle / s.layer.angle + s.lambda.angle) *
                         s.tick();
  const auto half_bound = [](double ticks) { return std::sin(std::numbers::pi / (4.0 * ticks + 2.0)); };
  const std::string is = fmt::format("(gain / layer + lambda) * tick = {:.3g}", kappa_t);
  const std::string cure =
      "a larger control.layer, a smaller gain or lambda (docs/theory.md, \"Boundary layers and the implicit "
      "law\")";
  if (kappa_t > half_bound(d.certain)) {
    f.error(fmt::format("{}, at most {:.2g} with a delay of {:.2g} ticks, or the loop rings by itself: {}",
                        is, half_bound(d.certain), d.certain, cure));
  } else if (const double allowed = std::min(0.3, half_bound(d.certain + d.lag)); kappa_t > allowed) {
    f.warning(fmt::format("{}, better below {:.2g}: {}", is, allowed, cure));
  }
}

void judge(const Scene& s, const Margins& m, Findings& f) {
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
  const bool guarded = s.type == MechanismType::five_bar && !(s.all_motors && s.all_sensors);
  if (guarded && m.sin_type2 < s.limits.min_abs_sin_type2) {
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
  for (std::size_t i = 0; i < m.torque.size(); ++i) {
    const double share = m.torque[i] / s.torque_limit[i];
    const std::string text =
        fmt::format("motor {}: the reference alone takes {:.3g} N m of torque_limit = {} N m", i + 1,
                    m.torque[i], s.torque_limit[i]);
    if (share > 1.0) {
      f.error(text);
    } else if (share > 0.7) {
      f.warning(text + "; little is left to correct errors with");
    }
  }
  judge_gains(s, f);
}

template <class World>
int report(const Scene& scene, const RunOptions& o) {
  OutputDirectory out(o.out);
  Log log(out.path("check.csv"), columns<World>(scene), tick_count(scene));
  const Margins m = margins<World>(scene, log);
  log.close();
  Findings f;
  judge(scene, m, f);
  // Frames of 8 bytes: per tick an encoder estimate from every axis and a torque to every motor, and a
  // heartbeat from every axis each 10 ms.
  const auto axes = static_cast<double>(scene.drives.nodes.size());
  const double tick_bits = (axes + static_cast<double>(scene.motors())) * worst_bits(8);
  const double load = (tick_bits * scene.rate_hz + axes * worst_bits(8) * 100.0) / scene.bitrate;
  const double latency_s = (tick_bits + axes * worst_bits(8)) / scene.bitrate;
  if (load > 1.0) {
    f.error(
        fmt::format("the bus cannot carry the loop: load {:.0f} % at {} bit/s", 100.0 * load, scene.bitrate));
  } else if (load > 0.8) {
    f.warning(fmt::format("bus load {:.0f} %: above 80 % frames wait for each other", 100.0 * load));
  }
  if (std::find(scene.drives.nodes.begin(), scene.drives.nodes.end(), 0) != scene.drives.nodes.end()) {
    f.warning(
        "drives.nodes names node 0: its command 0 has the identifier of CANopen's NMT, and a drive that "
        "nobody has "
        "given a number may be 0; take 1 or more");
  }
  if (scene.rate_hz > 1000.0) f.warning("ODrive sends encoder estimates at 1 kHz at most");
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
      {"max_torque_nm", m.torque}};
  j["bus"] = {{"load", load}, {"worst_latency_s", latency_s}};
  j["findings"] = f.list();
  if (out.wanted()) {
    write_scene(scene, out);
    out.commit();
  }
  if (o.json) {
    fmt::print("{}\n", j.dump(2));
  } else {
    fmt::print("{}: {}\n", scene.name,
               f.refused()        ? "would not run through"
               : obstacle.empty() ? "fit to run"
                                  : "fit for sim, not for a bus: " + obstacle);
    const std::string type2 =
        scene.type == MechanismType::five_bar ? fmt::format(" |D2| >= {:.3g},", m.sin_type2) : std::string();
    fmt::print("along the reference: |sin theta_j2| >= {:.3g},{} base joints <= {:.3g} rad/s\n", m.sin_type1,
               type2, m.joint_speed);
    for (std::size_t i = 0; i < m.torque.size(); ++i)
      fmt::print("motor {}: <= {:.3g} N m\n", i + 1, m.torque[i]);
    fmt::print("bus: load {:.0f} %, frames of one tick take {:.0f} us at worst\n", 100.0 * load,
               1e6 * latency_s);
    for (const Json& item : f.list()) {
      fmt::print("{}: {}\n", item["level"].get<std::string>(), item["text"].get<std::string>());
    }
    if (out.wanted()) fmt::print("torques along the reference: {}/check.csv\n", out.directory());
  }
  return f.refused() ? 1 : 0;
}

}  // namespace

int run_check(const RunOptions& o) {
  const Scene scene = read_scene(o.scene, o.sets);
  return scene.type == MechanismType::five_bar ? report<FiveBarWorld>(scene, o) : report<RrWorld>(scene, o);
}

}  // namespace esmc::host
