#include "host_sim/spatial/spatial.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "host_sim/effects/random.hpp"
#include "host_sim/error.hpp"
#include "host_sim/loop/progress.hpp"
#include "host_sim/record/finish.hpp"
#include "host_sim/spatial/controller.hpp"
#include "host_sim/spatial/plant.hpp"
#include "host_sim/spatial/scene.hpp"

namespace esmc::host {
namespace {

using Json = nlohmann::ordered_json;
using V3 = Vec3<double>;
using Q = Quaternion<double>;

constexpr double degrees = 57.295779513082320877;

Q attitude_of(const SpatialState& s) { return {s.attitude[0], s.attitude.tail<3>()}; }

// ---- from a scene to the configuration of its controller

PhaseClock clock_of(double rate, double tick) {
  constexpr double turn_of_phase = 18446744073709551616.0;  // 2^64
  const double turns = rate * tick / 6.283185307179586477, part = turns - std::floor(turns);
  return {0, static_cast<std::uint64_t>(std::min(part * turn_of_phase, turn_of_phase * (1.0 - 0x1p-53)))};
}

Vec3<double> spatial_start(const SpatialScene& s) {
  return Vec3<double>((s.platform ? s.platform->home : Vec3<double>::Zero()) + s.reference.position);
}

template <class S>
SpatialReference<S> make_spatial_reference(const SpatialScene& s) {
  const auto& r = s.reference;
  SpatialReference<S> out;
  out.kind = r.type;
  const Quaternion<double> start = exponential(r.rotation);
  const double rate = r.type == SpatialReferenceKind::sway ? 6.283185307179586477 * r.frequency : r.rate;
  out.position = spatial_start(s).cast<S>();
  out.attitude = normalised(Quaternion<S>{S(start.w), start.v.cast<S>()});
  out.axis = r.axis.cast<S>();
  out.second_axis = r.second_axis.cast<S>();
  out.angle = S(r.angle);
  out.shift = r.shift.cast<S>();
  out.duration = S(r.duration);
  out.rate = S(rate);
  out.second_rate = S(r.second_rate);
  out.phase = clock_of(rate, s.tick());
  out.second_phase = clock_of(r.second_rate, s.tick());
  return out;
}

/// The believed mechanism.
template <class S>
RigidBodyParams<S> believed(const RigidBodyParams<double>& p, const SpatialScene::Model& m) {
  return {S(p.mass * m.mass), (p.inertia * m.inertia).cast<S>()};
}
template <class S>
void believed_mechanism(const SpatialScene& s, FreeBody<S>& out) {
  out = make_free_body(believed<S>(s.body, s.model), S(s.gravity));
}
template <class S>
void believed_mechanism(const SpatialScene& s, Hexapod<S>& out) {
  const HexapodParams<double>& p = *s.platform;
  HexapodParams<S> b;
  b.platform = believed<S>(p.platform, s.model);
  for (int j = 0; j < 6; ++j) {
    b.base[j] = p.base[j].cast<S>();
    b.joint[j] = p.joint[j].cast<S>();
  }
  b.home = p.home.cast<S>();
  const auto strut = [&](const StrutParams<double>& x) {
    const double f = s.model.legs;
    return StrutParams<S>{S(x.centre), S(x.mass * f), S(x.transverse * f), S(x.axial * f), S(x.viscous)};
  };
  b.cylinder = strut(p.cylinder);
  b.rod = strut(p.rod);
  b.gravity = S(p.gravity);
  out = make_hexapod(b);
}

template <class M>
SpatialConfig<M> make_spatial_config(const SpatialScene& s) {
  using S = typename M::Scalar;
  SpatialConfig<M> c;
  believed_mechanism(s, c.mechanism);
  c.law = s.law;
  static_assert(static_cast<int>(ReachingChoice::implicit) == static_cast<int>(Reaching::implicit));
  c.reaching = static_cast<Reaching>(s.reaching);
  const auto kind = [&](std::size_t i) {
    const bool implicit = c.reaching == Reaching::implicit;
    return typename SpatialGains<S>::Kind{
        S(s.lambda[i]), S(s.gain[i]),
        implicit ? implicit_layer(S(s.gain[i]), S(s.tick()), S(0)) : S(s.layer[i])};
  };
  c.gains.point = kind(0);
  c.gains.turn = kind(1);
  c.hysteresis = S(s.hysteresis);
  c.force_limit = S(s.force_limit);
  c.moment_limit = S(s.moment_limit);
  if (s.platform) c.length = S(s.platform->joint[0].head<2>().norm());
  return c;
}

// ---- a run

/// Figures of a run for its summary.
struct Account {
  ErrorStatistics angle, distance;  ///< rad, m; settled: the last quarter
  Digest digest;
  double force_max = 0.0, moment_max = 0.0, change = 0.0, norm_drift = 0.0;
  double work = 0.0, balance = 0.0, scale = 0.0, momentum = 0.0;
  std::uint64_t ticks = 0, saturated = 0;
  std::string fault;
  double fault_t = 0.0, wall_s = 0.0;
  bool interrupted = false;
  SpatialState end;
};

/// A measurement with noise, in odd ticks with the other sign of the quaternion.
template <class S>
SpatialSample<S> measured(const SpatialState& s, std::uint32_t n, const SpatialScene::Measurement& m,
                          Normal& noise) {
  const auto draw = [&] {
    const double x = noise(), y = noise(), z = noise();
    return V3(x, y, z);
  };
  Q q = attitude_of(s);
  V3 position = s.position, velocity = s.velocity, turning = rotated(q.conjugate(), s.turning);
  if (m.position_noise > 0.0) position += draw() * m.position_noise;
  if (m.attitude_noise > 0.0) q = q * exponential(V3(draw() * m.attitude_noise));
  if (m.rate_noise > 0.0) {
    velocity += draw() * m.rate_noise;
    turning += draw() * m.rate_noise;
  }
  if (m.alternate_sign && n % 2 == 1) q = q.negative();
  return {position.cast<S>(), velocity.cast<S>(), {S(q.w), q.v.cast<S>()}, turning.cast<S>()};
}

std::vector<std::string> log_columns() {
  std::vector<std::string> c{"t"};
  for (const char* of : {"", "_ref"})
    for (const char* name : {"x", "y", "z", "qw", "qx", "qy", "qz"}) c.push_back(std::string(name) + of);
  for (const char* name : {"vx", "vy", "vz", "wx", "wy", "wz", "angle_deg", "distance"}) c.emplace_back(name);
  for (const char* name : {"u", "s"})
    for (int i = 1; i <= 6; ++i) c.push_back(name + std::to_string(i));
  return c;
}

/// The state as the digest takes it: position, attitude, velocity, angular velocity.
std::array<double, 13> listed(const SpatialState& s) {
  std::array<double, 13> out{};
  Eigen::Map<Vec<double, 13>>(out.data()) << s.position, s.attitude, s.velocity, s.turning;
  return out;
}

/// A run of `esmc spatial`, tick by tick.
template <class M>
class SpatialRun {
 public:
  SpatialRun(const SpatialScene& scene, std::uint64_t seed, std::FILE* log)
      : scene_(scene),
        plant_(scene.platform ? SpatialPlant(*scene.platform) : SpatialPlant(scene.body, scene.gravity)),
        reference_(make_spatial_reference<S>(scene)),
        controller_(make_spatial_config<M>(scene)),
        noise_(seed, 3000),
        ticks_(static_cast<std::uint32_t>(std::llround(scene.duration * scene.rate_hz))),
        log_(log, log_columns(), ticks_) {
    s_.position = spatial_start(scene) + scene.initial.position;
    const Q start = exponential(scene.reference.rotation) * exponential(scene.initial.rotation);
    s_.attitude << start.w, start.v;
    s_.attitude.normalize();
    s_.velocity = scene.initial.velocity;
    s_.turning = rotated(attitude_of(s_), scene.initial.turning);
  }

  Account run() {
    const auto begin = std::chrono::steady_clock::now();
    const V3 momentum = plant_.angular_momentum(s_);
    start_ = plant_.energy(s_);
    const int steps = std::max(1, static_cast<int>(std::ceil(scene_.tick() / scene_.step - 1e-9)));
    Progress progress(ticks_);
    for (std::uint32_t n = 0; n < ticks_ && !a_.interrupted; ++n) {
      progress.at(n);
      const Vec<double, 6> u = control(n);
      if (n % 16 == 0) account_energy();
      ++a_.ticks;
      for (int k = 0; k < steps; ++k) {
        const double drift =
            plant_.step(s_, {u[0], u[1], u[2], u[3], u[4], u[5]}, scene_.tick() / steps, a_.work);
        a_.norm_drift = larger(a_.norm_drift, drift);
      }
      a_.interrupted = stop_requested();
    }
    log_.close();
    account_energy();
    const double size = momentum.norm();
    a_.momentum = size > 0.0 ? (plant_.angular_momentum(s_) - momentum).norm() / size : 0.0;
    a_.end = s_;
    a_.wall_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    return a_;
  }

 private:
  using S = typename M::Scalar;

  /// The controller's tick n: its input to the plant, which is accounted for and logged.
  Vec<double, 6> control(std::uint32_t n) {
    const double t = n * scene_.tick();
    const SpatialMotion<S> wanted = reference_.at(n, S(scene_.tick()));
    SpatialResult<S> result;
    if (scene_.law != SpatialLaw::none)
      result = controller_.tick(measured<S>(s_, n, scene_.measurement, noise_), wanted);
    if (result.fault != SpatialFault::none && a_.fault.empty()) {
      a_.fault = name(result.fault);
      a_.fault_t = t;
    }
    const Vec<double, 6> u = result.input.template cast<double>();
    const double force = scene_.platform ? u.cwiseAbs().maxCoeff() : u.head<3>().cwiseAbs().maxCoeff();
    a_.force_max = larger(a_.force_max, force);
    a_.moment_max = larger(a_.moment_max, u.tail<3>().cwiseAbs().maxCoeff());
    if (n > 0) a_.change += (u - before_).cwiseAbs().mean();
    before_ = u;
    if (result.saturated) ++a_.saturated;
    const auto state = listed(s_);
    require_finite(state, t);
    a_.digest.add(state);
    const Q desired{double(wanted.attitude.w), wanted.attitude.v.template cast<double>()},
        q = attitude_of(s_);
    const V3 there = wanted.position.template cast<double>();
    const V3 left = logarithm(Q(q.conjugate() * desired));
    const double angle = std::sqrt(dot(left, left)), distance = (there - s_.position).norm();
    if (a_.fault.empty()) {
      a_.angle.add(n >= ticks_ - ticks_ / 4, angle);
      a_.distance.add(n >= ticks_ - ticks_ / 4, distance);
    }
    if (log_.wanted()) {
      Vec<double, 35> row;
      row << t, s_.position, s_.attitude, there, desired.w, desired.v, s_.velocity,
          rotated(q.conjugate(), s_.turning), angle * degrees, distance, u,
          result.sliding.template cast<double>();
      log_.row({row.data(), row.data() + row.size()}, "");
    }
    return u;
  }

  void account_energy() {
    const SpatialEnergy e = plant_.energy(s_);
    const double rise = e.potential - start_.potential, left = e.kinetic - start_.kinetic + rise - a_.work;
    a_.scale = std::max({a_.scale, e.kinetic, std::abs(rise), std::abs(a_.work)});
    a_.balance = larger(a_.balance, std::abs(left));
  }

  const SpatialScene& scene_;
  SpatialPlant plant_;
  SpatialEnergy start_;
  SpatialReference<S> reference_;
  SpatialController<M> controller_;
  Normal noise_;
  std::uint32_t ticks_;
  Log log_;
  SpatialState s_;
  Account a_;
  Vec<double, 6> before_ = Vec<double, 6>::Zero();
};

template <class V>
std::vector<double> listed(const V& v) {
  return {v.data(), v.data() + v.size()};
}

Json tracking_json(const Account& a) {
  Json j;
  const auto put = [&](const std::string& which, const ErrorStatistics::Moments& m, const std::string& unit,
                       double per_unit) {
    // A run that ends in a fault before its last quarter has nothing settled.
    j[which + "rms_" + unit] = m.count > 0 ? Json(m.rms() * per_unit) : Json(nullptr);
    j[which + "max_" + unit] = m.count > 0 ? Json(m.largest * per_unit) : Json(nullptr);
  };
  put("", a.angle.all(), "deg", degrees);
  put("settled_", a.angle.settled(), "deg", degrees);
  put("", a.distance.all(), "m", 1.0);
  put("settled_", a.distance.settled(), "m", 1.0);
  return j;
}

/// Bounds on integration errors: norm of the quaternion per step, energy as a share of the exchanged energy.
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
  const bool driven = s.law != SpatialLaw::none;
  Json j;
  j["scene"] = s.name;
  j["seed"] = o.seed;
  j["mechanism"] = s.platform ? "platform" : "body";
  j["law"] = name(s.law);
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

std::string pretty_text(const Json& j) {
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

template <template <class> class M>
Account run(const SpatialScene& scene, const RunOptions& o, std::FILE* log) {
  return o.single_precision ? SpatialRun<M<float>>(scene, o.seed, log).run()
                            : SpatialRun<M<double>>(scene, o.seed, log).run();
}

}  // namespace

int run_spatial(const RunOptions& o) {
  const SpatialScene scene = read_spatial_scene(o.scene, o.sets);
  OutputDirectory out = output_of(o);
  out.spare(o.scene);
  std::FILE* const log = out.open("log.csv");
  const Account a = scene.platform ? run<Hexapod>(scene, o, log) : run<FreeBody>(scene, o, log);
  const Json summary = summary_of(scene, o, a);
  out.write("scene.toml", scene.toml);
  const int status = publish_summary(o, summary, pretty_text(summary), !a.fault.empty(), out);
  return status == 0 && a.interrupted ? exit_interrupted : status;
}

}  // namespace esmc::host
