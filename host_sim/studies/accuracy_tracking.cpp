/// Closed loops of the comparison scenario: tracking errors by setting, and effects.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

#include "host_sim/loop/run.hpp"
#include "host_sim/record/recorder.hpp"
#include "host_sim/scene/scene.hpp"
#include "host_sim/studies/studies.hpp"

namespace esmc::host {
namespace {

using Json = nlohmann::ordered_json;

Scene comparison(const std::vector<std::string>& sets) {
  return read_scene_text(std::string(starting_scene("five_bar")), "comparison scenario", sets);
}

Json fault_of(const Trace& t) {
  return t.end.faults.empty() ? Json(nullptr) : Json(t.end.faults.front().name);
}

struct NamedEffect {
  const char *type, *parameters;  ///< TOML of the effect
  const char* step = "5e-4";      ///< s: short enough for it
};

/// Parameters of a small laboratory five-bar with cheap gears.
constexpr NamedEffect named[] = {
    {"viscous_friction", "coefficient = [0.01, 0.002]"},
    {"coulomb_friction", "torque = [0.02, 0.005]"},
    {"coulomb_friction", "torque = [0.02, 0.005], regularised = 0.01"},
    {"joint_flexibility", "stiffness = 100.0, damping = 0.02, rotor_inertia = 1e-3", "2e-4"},
    {"backlash", "gap = 0.001, stiffness = 200.0, damping = 0.1, rotor_inertia = 1e-3", "2e-4"},
    {"end_stops", "lower = [-1.0, -1.0], upper = [2.0, 2.0]"},
    {"end_stops", "lower = [-1.0, -1.0], upper = [2.0, 2.0], stiffness = 1000.0, restitution = 0.5"},
    {"payload", "mass = 0.05, from = 0.5"},
    {"external_force", "force = [0.5, 0.0], from = 0.5, to = 1.0"},
    {"external_force", R"(kind = "human", anchor = [0.0, 0.17], stiffness = 10.0, damping = 0.5)"},
    {"torque_lag", "time_constant = 0.0005"},
    {"torque_saturation", "limit = 0.5"},
    {"torque_ripple", "amplitude = 0.01, per_turn = 14.0"},
    {"thermal_limit", "continuous = 0.4, time_constant = 10.0"},
    {"encoder", "bits = 16"},
    {"noise", "sigma = 1e-5"},
    {"bias", "angle = [0.002, 0.0]"},
    {"delay", "ticks = 1"},
    {"jitter", "sigma = 1e-4"},
    {"compute_delay", "time = 5e-4"},
};

/// CPU time of one step of the plant alone, ns.
double ns_per_step(const Scene& scene) {
  constexpr int ticks = 2000;
  const int substeps = std::max(1, static_cast<int>(std::ceil(scene.tick() / scene.step - 1e-9)));
  auto motion = make_motion<FiveBarTraits>(scene);
  const double begin = thread_cpu_s();
  for (int n = 0; n < ticks; ++n) {
    // Torques that nearly hold the mechanism: every effect acts in an ordinary state.
    motion.advance(n * scene.tick(), scene.tick(), substeps, {{0.05, 0.0, 0.05, 0.0}, nullptr});
  }
  return 1e9 * (thread_cpu_s() - begin) / (ticks * substeps);
}

/// ns_per_step() of a and of b: the least of nine each, taken in turns, so that a slow moment of the machine
/// affects both.
std::pair<double, double> paired_ns_per_step(const Scene& a, const Scene& b) {
  std::pair<double, double> best{1e300, 1e300};
  for (int k = 0; k < 9; ++k) {
    best.first = std::min(best.first, ns_per_step(a));
    best.second = std::min(best.second, ns_per_step(b));
  }
  return best;
}

}  // namespace

Json tracking_study(bool quick, const std::function<void()>& after_run) {
  Json points = Json::array();
  const auto add = [&](const std::string& study, const std::string& setting,
                       const std::vector<std::string>& sets, bool single_precision = false) {
    const Scene scene = comparison(sets);
    Trace t;
    double cpu_s = 1e300;  // of the fastest run
    for (int k = 0; k < (quick ? 1 : 5); ++k) {
      const double begin = thread_cpu_s();
      t = trace(scene, single_precision);
      cpu_s = std::min(cpu_s, thread_cpu_s() - begin);
    }
    after_run();
    const Json tracking = t.statistics.tracking();
    points.push_back({{"study", study},
                      {"setting", setting},
                      {"settled_max_rad", tracking["settled_max_rad"]},
                      {"settled_rms_m", tracking["settled_rms_m"]},
                      {"mean_abs_delta_nm", t.statistics.torque()["mean_abs_delta_nm"]},
                      {"us_per_tick", 1e6 * cpu_s / static_cast<double>(t.statistics.ticks())},
                      {"fault", fault_of(t)}});
  };
  const std::string ctc = "control.law=ctc", fast = "control.lambda=200.0";
  add("law", "esmc", {});
  add("law", "esmc_projected", {"control.law=esmc_projected"});
  add("law", "smc", {"control.law=smc"});
  add("law", "ctc, lambda 40", {ctc});
  add("law", "ctc, lambda 200", {ctc, fast});
  for (const char* reaching : {"sign", "saturation", "tanh", "implicit"}) {
    add("reaching law (layer 1.0)", reaching,
        {fmt::format("control.reaching={}", reaching), "control.layer=1.0"});
  }
  for (const int rate : {250, 500, 1000, 2000, 4000}) {
    add("tick rate", fmt::format("{} Hz", rate), {fmt::format("control.rate_hz={}", rate)});
  }
  add("scalar type", "double", {});
  add("scalar type", "float", {}, true);
  for (const int bits : {12, 14, 16, 18, 20}) {
    const std::string encoder = fmt::format("effects=[{{ type = \"encoder\", bits = {} }}]", bits);
    add("encoder (delay_ticks 2)", fmt::format("{} bits", bits), {encoder, "control.delay_ticks=2"});
    add("encoder, ctc lambda 200", fmt::format("{} bits", bits), {encoder, ctc, fast});
  }
  for (const double delay : {0.0, 0.5, 1.0, 1.5, 2.0}) {
    const std::string late = fmt::format("effects=[{{ type = \"compute_delay\", time = {} }}]", 1e-3 * delay);
    add("latency, unknown to the law", fmt::format("{} ticks", delay), {late});
    add("latency, known to the law", fmt::format("{} ticks", delay),
        {late, fmt::format("control.delay_ticks={}", delay)});
    add("latency, ctc lambda 200", fmt::format("{} ticks", delay), {late, ctc, fast});
  }
  for (const char* method : {"semi_implicit_euler", "rk4", "dopri8"}) {
    for (const double step : {1e-3, 5e-4, 2.5e-4, 1.25e-4}) {
      add(fmt::format("integrator {}", method), fmt::format("{} s", step),
          {fmt::format("simulation.integrator={}", method), fmt::format("simulation.step={}", step)});
    }
  }
  return points;
}

Json effect_study(const std::function<void()>& after_run) {
  Json out = Json::array();
  for (const NamedEffect& n : named) {
    const std::string step = fmt::format("simulation.step={}", n.step);
    const Scene with =
        comparison({fmt::format(R"(effects=[{{ type = "{}", {} }}])", n.type, n.parameters), step});
    const Scene without = comparison({step});
    const Trace effect = trace(with), bare = trace(without);
    double deviation = 0.0;
    for (std::size_t i = 0; i < effect.effector.size() && i < bare.effector.size(); ++i) {
      const V2 d = effect.effector[i] - bare.effector[i];
      deviation = std::max(deviation, std::hypot(d.x, d.y));
    }
    after_run();
    const auto [ns_with, ns_without] = paired_ns_per_step(with, without);
    out.push_back({{"effect", n.type},
                   {"parameters", n.parameters},
                   {"integrator", name(effect.end.method)},
                   {"deviation_m", deviation},
                   {"settled_max_rad", effect.statistics.tracking()["settled_max_rad"]},
                   {"without_rad", bare.statistics.tracking()["settled_max_rad"]},
                   {"states_added", effect.end.state_dimension - bare.end.state_dimension},
                   {"ns_per_step", ns_with},
                   {"ns_without", ns_without},
                   {"fault", fault_of(effect)}});
  }
  return out;
}

}  // namespace esmc::host
