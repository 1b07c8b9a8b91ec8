/// Closed loops of the comparison scenario: tracking errors by setting, and effects.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <tuple>
#include <utility>

#include "host_sim/loop/trace.hpp"
#include "host_sim/record/recorder.hpp"
#include "host_sim/scene/scene.hpp"
#include "host_sim/studies/accuracy.hpp"

namespace esmc::host {
namespace {

Scene comparison(std::vector<std::string> sets) {
  return read_scene_text(std::string(starting_scene("five_bar")), "comparison scenario", sets);
}

double number(const nlohmann::ordered_json& j, const char* key) {
  return j.is_object() && j[key].is_number() ? j[key].get<double>()
                                             : std::numeric_limits<double>::quiet_NaN();
}

struct Timed {
  Trace trace;
  double cpu_s = 0.0;
};
Timed timed(const Scene& scene, bool single_precision, int runs) {
  Timed out;
  for (int k = 0; k < runs; ++k) {
    const double begin = thread_cpu_s();
    out.trace = trace(scene, single_precision);
    const double took = thread_cpu_s() - begin;
    out.cpu_s = k == 0 ? took : std::min(out.cpu_s, took);
  }
  return out;
}

std::string fault_of(const Trace& t) { return t.end.faults.empty() ? "" : t.end.faults.front(); }

class TrackingStudy {
 public:
  explicit TrackingStudy(int runs) : runs_(runs) {}
  void add(const std::string& study, const std::string& setting, const std::vector<std::string>& sets,
           bool single_precision = false) {
    const Scene scene = comparison(sets);
    const Timed t = timed(scene, single_precision, runs_);
    const auto tracking = t.trace.statistics.tracking();
    points.push_back({study, setting, number(tracking, "settled_max_rad"), number(tracking, "settled_rms_m"),
                      number(t.trace.statistics.torque(), "mean_abs_delta_nm"),
                      1e6 * t.cpu_s / static_cast<double>(t.trace.statistics.ticks()), fault_of(t.trace)});
  }
  std::vector<TrackingPoint> points;

 private:
  int runs_;
};

}  // namespace

std::vector<TrackingPoint> tracking_study(bool quick) {
  TrackingStudy t(quick ? 1 : 5);
  const std::string ctc = "control.law=ctc", fast = "control.lambda=200.0";
  t.add("law", "esmc", {});
  t.add("law", "esmc_projected", {"control.law=esmc_projected"});
  t.add("law", "smc", {"control.law=smc"});
  t.add("law", "ctc, lambda 40", {ctc});
  t.add("law", "ctc, lambda 200", {ctc, fast});
  for (const char* reaching : {"sign", "saturation", "tanh", "implicit"}) {
    t.add("reaching law (layer 1.0)", reaching,
          {fmt::format("control.reaching={}", reaching), "control.layer=1.0"});
  }
  for (const int rate : {250, 500, 1000, 2000, 4000}) {
    t.add("tick rate", fmt::format("{} Hz", rate), {fmt::format("control.rate_hz={}", rate)});
  }
  t.add("scalar type", "double", {});
  t.add("scalar type", "float", {}, true);
  for (const int bits : {12, 14, 16, 18, 20}) {
    const std::string encoder = fmt::format("effects=[{{ type = \"encoder\", bits = {} }}]", bits);
    t.add("encoder (told delay 2)", fmt::format("{} bits", bits), {encoder, "control.delay_ticks=2"});
    t.add("encoder, ctc lambda 200", fmt::format("{} bits", bits), {encoder, ctc, fast});
  }
  for (const double delay : {0.0, 0.5, 1.0, 1.5, 2.0}) {
    const std::string late = fmt::format("effects=[{{ type = \"compute_delay\", time = {} }}]", 1e-3 * delay);
    t.add("latency, untold", fmt::format("{} ticks", delay), {late});
    t.add("latency, told", fmt::format("{} ticks", delay),
          {late, fmt::format("control.delay_ticks={}", delay)});
    t.add("latency, ctc lambda 200", fmt::format("{} ticks", delay), {late, ctc, fast});
  }
  for (const char* method : {"semi_implicit_euler", "rk4", "dopri8"}) {
    for (const double step : {1e-3, 5e-4, 2.5e-4, 1.25e-4}) {
      t.add(fmt::format("integrator {}", method), fmt::format("{} s", step),
            {fmt::format("simulation.integrator={}", method), fmt::format("simulation.step={}", step)});
    }
  }
  return t.points;
}

namespace {

struct NamedEffect {
  const char* parameters;  ///< TOML of the effect
  const char* step;        ///< s: short enough for it
};

/// Parameters of a small laboratory five-bar with cheap gears.
constexpr NamedEffect named[] = {
    {"type = \"viscous_friction\", coefficient = [0.01, 0.002]", "5e-4"},
    {"type = \"coulomb_friction\", torque = [0.02, 0.005]", "5e-4"},
    {"type = \"coulomb_friction\", torque = [0.02, 0.005], regularised = 0.01", "5e-4"},
    {"type = \"joint_flexibility\", stiffness = 100.0, damping = 0.02, rotor_inertia = 1e-3", "2e-4"},
    {"type = \"backlash\", gap = 0.001, stiffness = 200.0, damping = 0.1, rotor_inertia = 1e-3", "2e-4"},
    {"type = \"end_stops\", lower = [-1.0, -1.0], upper = [2.0, 2.0]", "5e-4"},
    {"type = \"end_stops\", lower = [-1.0, -1.0], upper = [2.0, 2.0], stiffness = 1000.0, restitution = 0.5",
     "5e-4"},
    {"type = \"payload\", mass = 0.05, from = 0.5", "5e-4"},
    {"type = \"external_force\", force = [0.5, 0.0], from = 0.5, to = 1.0", "5e-4"},
    {"type = \"external_force\", kind = \"human\", anchor = [0.0, 0.17], stiffness = 10.0, damping = 0.5",
     "5e-4"},
    {"type = \"torque_lag\", time_constant = 0.0005", "5e-4"},
    {"type = \"torque_saturation\", limit = 0.5", "5e-4"},
    {"type = \"torque_ripple\", amplitude = 0.01, per_turn = 14.0", "5e-4"},
    {"type = \"thermal_limit\", continuous = 0.4, time_constant = 10.0", "5e-4"},
    {"type = \"encoder\", bits = 16", "5e-4"},
    {"type = \"noise\", sigma = 1e-5", "5e-4"},
    {"type = \"bias\", angle = [0.002, 0.0]", "5e-4"},
    {"type = \"delay\", ticks = 1", "5e-4"},
    {"type = \"jitter\", sigma = 1e-4", "5e-4"},
    {"type = \"compute_delay\", time = 5e-4", "5e-4"},
};

/// CPU time of one step of the plant alone, ns.
double ns_per_step(const Scene& scene) {
  constexpr int ticks = 2000;
  const int substeps = std::max(1, static_cast<int>(std::ceil(scene.tick() / scene.step - 1e-9)));
  auto motion = make_motion<FiveBarWorld>(scene);
  const double begin = thread_cpu_s();
  for (int n = 0; n < ticks; ++n) {
    // Torques that nearly hold the mechanism: every effect acts in an ordinary state.
    motion.advance(n * scene.tick(), scene.tick(), substeps, {{0.05, 0.0, 0.05, 0.0}, nullptr});
  }
  return 1e9 * (thread_cpu_s() - begin) / (ticks * substeps);
}

/// Least of nine measurements of each, taken in turns, so that a slow moment of the machine affects both.
std::pair<double, double> paired_ns(const Scene& a, const Scene& b) {
  std::pair<double, double> best{1e300, 1e300};
  for (int k = 0; k < 9; ++k) {
    best.first = std::min(best.first, ns_per_step(a));
    best.second = std::min(best.second, ns_per_step(b));
  }
  return best;
}

}  // namespace

std::vector<EffectPoint> effect_study() {
  std::vector<EffectPoint> out;
  for (const NamedEffect& n : named) {
    const std::vector<std::string> with{fmt::format("effects=[{{ {} }}]", n.parameters),
                                        fmt::format("simulation.step={}", n.step)};
    const Trace effect = trace(comparison(with));
    const std::string method = name(effect.end.method);
    const std::vector<std::string> without{fmt::format("simulation.step={}", n.step)};
    const Trace bare = trace(comparison(without));
    EffectPoint p;
    const std::string text(n.parameters);
    p.effect = text.substr(8, text.find('"', 8) - 8);
    const std::size_t comma = text.find(", ");
    p.parameters = comma == std::string::npos ? "" : text.substr(comma + 2);
    p.integrator = method;
    for (std::size_t i = 0; i < effect.effector.size() && i < bare.effector.size(); ++i) {
      const V2 d = effect.effector[i] - bare.effector[i];
      p.deviation_m = std::max(p.deviation_m, std::hypot(d.x, d.y));
    }
    p.settled_max_rad = number(effect.statistics.tracking(), "settled_max_rad");
    p.without_rad = number(bare.statistics.tracking(), "settled_max_rad");
    p.states = effect.end.state_dimension - bare.end.state_dimension;
    std::tie(p.ns_per_step, p.ns_without) = paired_ns(comparison(with), comparison(without));
    p.fault = fault_of(effect);
    out.push_back(p);
  }
  return out;
}

}  // namespace esmc::host
