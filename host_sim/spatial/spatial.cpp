#include "host_sim/spatial/spatial.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <utility>

#include "host_sim/effects/random.hpp"
#include "host_sim/error.hpp"
#include "host_sim/loop/progress.hpp"
#include "host_sim/record/log.hpp"
#include "host_sim/record/output.hpp"
#include "host_sim/record/summary.hpp"
#include "host_sim/spatial/plant.hpp"
#include "host_sim/spatial/setup.hpp"

namespace esmc::host {
namespace {

using Json = nlohmann::ordered_json;
using V3 = Vec3<double>;
using Q = Quaternion<double>;

constexpr double degrees = 57.295779513082320877;

Q attitude_of(const SpatialState& s) { return {s.attitude[0], s.attitude.tail<3>()}; }

/// What the summary needs of a run.
struct Account {
  ErrorStatistics angle, distance;  ///< rad, m; settled: the last quarter
  Digest digest;
  double force_max = 0.0, moment_max = 0.0, change = 0.0, norm_drift = 0.0;
  double start_energy = 0.0, work = 0.0, balance = 0.0, scale = 0.0, momentum = 0.0;
  std::uint64_t ticks = 0, saturated = 0;
  std::string fault;
  double fault_t = 0.0, wall_s = 0.0;
  bool interrupted = false;
  SpatialState end;
};

class Energy {
 public:
  Energy(const SpatialPlant& plant, const SpatialState& s) : plant_(plant), start_(plant.energy(s)) {}
  void look(const SpatialState& s, Account& a) const {
    const SpatialEnergy e = plant_.energy(s);
    const double rise = e.potential - start_.potential, left = e.kinetic - start_.kinetic + rise - a.work;
    a.scale = std::max({a.scale, e.kinetic, std::abs(rise), std::abs(a.work)});
    a.balance = larger(a.balance, std::abs(left));
  }

 private:
  const SpatialPlant& plant_;
  SpatialEnergy start_;
};

/// Noise and signs between the plant and the controller.
class Measuring {
 public:
  Measuring(const SpatialScene::Measurement& m, std::uint64_t seed) : m_(m), noise_(seed, 3000) {}
  template <class S>
  SpatialSample<S> operator()(const SpatialState& s, std::uint32_t n) {
    Q q = attitude_of(s);
    V3 position = s.position, velocity = s.velocity, turning = rotated(q.conjugate(), s.turning);
    if (m_.position_noise > 0.0) position += draw() * m_.position_noise;
    if (m_.attitude_noise > 0.0) q = q * exponential(V3(draw() * m_.attitude_noise));
    if (m_.rate_noise > 0.0) {
      velocity += draw() * m_.rate_noise;
      turning += draw() * m_.rate_noise;
    }
    if (m_.alternate_sign && n % 2 == 1) q = q.negative();
    return {position.cast<S>(), velocity.cast<S>(), {S(q.w), q.v.cast<S>()}, turning.cast<S>()};
  }

 private:
  V3 draw() {
    const double x = noise_(), y = noise_(), z = noise_();
    return {x, y, z};
  }
  SpatialScene::Measurement m_;
  Normal noise_;
};

std::vector<std::string> log_columns() {
  std::vector<std::string> c{"t"};
  for (const char* of : {"", "_ref"})
    for (const char* name : {"x", "y", "z", "qw", "qx", "qy", "qz"}) c.push_back(std::string(name) + of);
  for (const char* name : {"vx", "vy", "vz", "wx", "wy", "wz", "angle_deg", "distance"}) c.emplace_back(name);
  for (const char* name : {"u", "s"})
    for (int i = 1; i <= 6; ++i) c.push_back(name + std::to_string(i));
  return c;
}

template <class M>
Account simulate(const SpatialScene& scene, const RunOptions& o, std::FILE* log_file) {
  using S = typename M::Scalar;
  const auto begin = std::chrono::steady_clock::now();
  const SpatialPlant plant =
      scene.platform ? SpatialPlant(*scene.platform) : SpatialPlant(scene.body, scene.gravity);
  const SpatialReference<S> reference = make_spatial_reference<S>(scene);
  SpatialController<M> controller(make_spatial_config<M>(scene));
  SpatialState s;
  s.position = spatial_start(scene) + scene.initial.position;
  const Q start = exponential(scene.reference.rotation) * exponential(scene.initial.rotation);
  s.attitude << start.w, start.v;
  s.attitude.normalize();
  s.velocity = scene.initial.velocity;
  s.turning = rotated(attitude_of(s), scene.initial.turning);
  const V3 momentum = plant.angular_momentum(s);

  Account a;
  const Energy energy(plant, s);
  Measuring measure(scene.measurement, o.seed);
  const std::uint32_t ticks = spatial_ticks(scene);
  const double tick = scene.tick();
  const int steps = std::max(1, static_cast<int>(std::ceil(tick / scene.step - 1e-9)));
  Log log(log_file, log_columns(), ticks);
  Progress progress(ticks);
  Vec<double, 6> before = Vec<double, 6>::Zero();
  for (std::uint32_t n = 0; n < ticks && !a.interrupted; ++n) {
    progress.at(n);
    const double t = n * tick;
    const SpatialMotion<S> wanted = reference.at(n, S(tick));
    SpatialResult<S> result;
    if (scene.law != SpatialLawName::none) result = controller.tick(measure.operator()<S>(s, n), wanted);
    if (result.fault != SpatialFault::none && a.fault.empty()) {
      a.fault = name(result.fault);
      a.fault_t = t;
    }
    const Vec<double, 6> u = result.input.template cast<double>();
    const Q desired{double(wanted.attitude.w), wanted.attitude.v.template cast<double>()}, q = attitude_of(s);
    const V3 there = wanted.position.template cast<double>();
    const V3 left = logarithm(Q(q.conjugate() * desired));
    const double angle = std::sqrt(dot(left, left)), distance = (there - s.position).norm();
    if (a.fault.empty()) {
      a.angle.add(n >= ticks - ticks / 4, angle);
      a.distance.add(n >= ticks - ticks / 4, distance);
    }
    a.force_max = larger(
        a.force_max, (scene.platform ? u : Vec<double, 6>(u.cwiseProduct(Vec<double, 6>(1, 1, 1, 0, 0, 0))))
                         .cwiseAbs()
                         .maxCoeff());
    a.moment_max = larger(a.moment_max, u.tail<3>().cwiseAbs().maxCoeff());
    if (n > 0) a.change += (u - before).cwiseAbs().mean();
    before = u;
    if (result.saturated) ++a.saturated;
    const std::array<double, 13> state{s.position[0], s.position[1], s.position[2], s.attitude[0],
                                       s.attitude[1], s.attitude[2], s.attitude[3], s.velocity[0],
                                       s.velocity[1], s.velocity[2], s.turning[0],  s.turning[1],
                                       s.turning[2]};
    require_finite(state, t);
    a.digest.add(state);
    if (log.wanted()) {
      const V3 turning = rotated(q.conjugate(), s.turning);
      std::vector<double> row{t,
                              state[0],
                              state[1],
                              state[2],
                              q.w,
                              q.v[0],
                              q.v[1],
                              q.v[2],
                              there[0],
                              there[1],
                              there[2],
                              desired.w,
                              desired.v[0],
                              desired.v[1],
                              desired.v[2],
                              s.velocity[0],
                              s.velocity[1],
                              s.velocity[2],
                              turning[0],
                              turning[1],
                              turning[2],
                              angle * degrees,
                              distance};
      for (int i = 0; i < 6; ++i) row.push_back(u[i]);
      for (int i = 0; i < 6; ++i) row.push_back(double(result.sliding[i]));
      log.row(row, "");
    }
    if (n % 16 == 0) energy.look(s, a);
    ++a.ticks;
    for (int k = 0; k < steps; ++k)
      a.norm_drift =
          larger(a.norm_drift, plant.step(s, {u[0], u[1], u[2], u[3], u[4], u[5]}, tick / steps, a.work));
    a.interrupted = stop_requested();
  }
  log.close();
  energy.look(s, a);
  const double size = momentum.norm();
  a.momentum = size > 0.0 ? (plant.angular_momentum(s) - momentum).norm() / size : 0.0;
  a.end = s;
  a.wall_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  return a;
}

template <class V>
std::vector<double> listed(const V& v) {
  return {v.data(), v.data() + v.size()};
}

Json tracking_json(const Account& a) {
  // A run that ends in a fault before its last quarter has nothing settled.
  const auto moments = [](const ErrorStatistics::Moments& m, double unit) {
    return m.count > 0 ? std::pair<Json, Json>(m.rms() * unit, m.largest * unit)
                       : std::pair<Json, Json>(nullptr, nullptr);
  };
  const auto turn = moments(a.angle.all(), degrees), settled_turn = moments(a.angle.settled(), degrees),
             distance = moments(a.distance.all(), 1.0), settled = moments(a.distance.settled(), 1.0);
  return {{"rms_deg", turn.first},
          {"max_deg", turn.second},
          {"settled_rms_deg", settled_turn.first},
          {"settled_max_deg", settled_turn.second},
          {"rms_m", distance.first},
          {"max_m", distance.second},
          {"settled_rms_m", settled.first},
          {"settled_max_m", settled.second}};
}

/// Beyond these the plant is not the mechanism: norm of the quaternion per step, energy as a part of what is
/// exchanged.
constexpr double norm_drift_most = 1e-6, energy_error_most = 1e-3;

std::vector<std::string> warnings_of(const SpatialScene& s, const Account& a) {
  const double balance = a.scale > 0.0 ? a.balance / a.scale : 0.0;
  if (a.norm_drift <= norm_drift_most && balance <= energy_error_most) return {};
  return {
      fmt::format("the plant is not integrated to what it does: norm drift per step {:.1g}, energy balance "
                  "{:.1g}; a smaller simulation.step than {:g} s",
                  a.norm_drift, balance, s.step)};
}

Json summary_of(const SpatialScene& s, const RunOptions& o, const Account& a) {
  const bool driven = s.law != SpatialLawName::none;
  Json j;
  j["scene"] = s.name;
  j["seed"] = o.seed;
  j["mechanism"] = s.platform ? "platform" : "body";
  j["law"] = s.law_name;
  j["scalar"] = o.single_precision ? "float" : "double";
  j["duration_s"] = s.duration;
  j["simulated_s"] = static_cast<double>(a.ticks) * s.tick();
  j["ticks"] = a.ticks;
  if (a.interrupted) j["interrupted"] = true;
  j["wall_s"] = a.wall_s;
  j["real_time_factor"] = a.wall_s > 0.0 ? static_cast<double>(a.ticks) * s.tick() / a.wall_s : 0.0;
  j["tracking"] = driven && a.angle.all().count > 0 ? tracking_json(a) : Json(nullptr);
  j["input"] = {{"force_max_n", a.force_max},
                {"moment_max_nm", s.platform ? Json(nullptr) : Json(a.moment_max)},
                {"mean_abs_delta", a.ticks > 1 ? a.change / static_cast<double>(a.ticks - 1) : 0.0},
                {"saturated_ticks", a.saturated}};
  j["norm"] = {{"drift_max", a.norm_drift}};
  j["energy"] = {{"relative_error", a.scale > 0.0 ? a.balance / a.scale : 0.0}};
  j["momentum"] = {{"relative_error", driven || s.platform ? Json(nullptr) : Json(a.momentum)}};
  j["warnings"] = warnings_of(s, a);
  j["fault"] = a.fault.empty() ? Json(nullptr) : Json{{"name", a.fault}, {"t", a.fault_t}};
  j["final_state"] = {{"position", listed(a.end.position)},
                      {"attitude", listed(a.end.attitude)},
                      {"velocity", listed(a.end.velocity)},
                      {"turning", listed(V3(rotated(attitude_of(a.end).conjugate(), a.end.turning)))}};
  j["digest"] = a.digest.text();
  return j;
}

std::string text_of(const Json& j) {
  const auto number = [](const Json& v) { return fmt::format("{:.3g}", v.get<double>()); };
  std::string out = fmt::format(
      "{}: {} on a {}, {} ticks ({} s{})\n", printable(j["scene"].get<std::string>()),
      j["law"].get<std::string>(), j["mechanism"].get<std::string>(), j["ticks"].get<std::uint64_t>(),
      j["simulated_s"].get<double>(), j.contains("interrupted") ? ", interrupted" : "");
  if (!j["fault"].is_null()) {
    out += fmt::format("fault: {} at {} s, no force from there on\n", j["fault"]["name"].get<std::string>(),
                       j["fault"]["t"].get<double>());
  }
  if (const Json& t = j["tracking"]; !t.is_null()) {
    const auto errors = [&](const std::string& what, const std::string& unit) {
      const auto at = [&](const char* key) -> const Json& { return t[key + ("_" + unit)]; };
      out += fmt::format("{}: {} {} rms, {} {} max", what, number(at("rms")), unit, number(at("max")), unit);
      if (!at("settled_rms").is_null())
        out += fmt::format("; last quarter {} {} rms, {} {} max", number(at("settled_rms")), unit,
                           number(at("settled_max")), unit);
      out += "\n";
    };
    errors("attitude", "deg");
    errors("position", "m");
    const Json& u = j["input"];
    out +=
        fmt::format("{} N max{}, {} mean change per tick, saturated in {} ticks\n", number(u["force_max_n"]),
                    u["moment_max_nm"].is_null() ? "" : ", " + number(u["moment_max_nm"]) + " N m max",
                    number(u["mean_abs_delta"]), u["saturated_ticks"].get<std::uint64_t>());
  }
  out += fmt::format("norm drift per step {:.1g}, energy balance {:.1g}",
                     j["norm"]["drift_max"].get<double>(), j["energy"]["relative_error"].get<double>());
  if (const Json& m = j["momentum"]["relative_error"]; !m.is_null())
    out += fmt::format(", angular momentum kept to {:.1g}", m.get<double>());
  out += "\n";
  for (const auto& w : j["warnings"]) out += "warning: " + w.get<std::string>() + "\n";
  return out + fmt::format("{:.0f} x real time, digest {}\n", j["real_time_factor"].get<double>(),
                           j["digest"].get<std::string>());
}

}  // namespace

int run_spatial(const RunOptions& o) {
  const SpatialScene scene = read_spatial_scene(o.scene, o.sets);
  OutputDirectory out(o.out);
  out.spare(o.scene);
  std::FILE* const log = out.open("log.csv");
  const Account a = scene.platform ? (o.single_precision ? simulate<Hexapod<float>>(scene, o, log)
                                                         : simulate<Hexapod<double>>(scene, o, log))
                                   : (o.single_precision ? simulate<FreeBody<float>>(scene, o, log)
                                                         : simulate<FreeBody<double>>(scene, o, log));
  const Json summary = summary_of(scene, o, a);
  if (out.wanted()) {
    out.write("scene.toml", scene.toml);
    out.write("summary.json", summary.dump(2) + "\n");
    out.commit();
  }
  fmt::print("{}{}", o.json ? summary.dump(2) : text_of(summary), o.json ? "\n" : "");
  return a.fault.empty() ? 0 : 1;
}

}  // namespace esmc::host
