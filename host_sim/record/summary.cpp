#include "host_sim/record/summary.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "host_sim/bus/frame_log.hpp"
#include "host_sim/error.hpp"
#include "host_sim/record/verdict.hpp"

namespace esmc::host {

using Json = nlohmann::ordered_json;

BusSummary bus_summary(const FrameLog& frames, std::uint64_t lost, double capacity) {
  return {frames.frames(), lost, capacity > 0.0 ? static_cast<double>(frames.bits()) / capacity : 0.0};
}

void throw_diverged(double t) {
  throw Diverged(
      fmt::format("the state is not finite from t = {:.6g} s on: a smaller simulation.step, or smaller "
                  "torques and forces",
                  t));
}

void Statistics::add(const TickRecord& r) {
  ++ticks_;
  if (r.faulted && !fault_time_) fault_time_ = r.t;
  if (r.has_reference) has_reference_ = true;
  if (r.has_reference && !fault_time_) {  // after a fault nothing is tracked
    for (std::size_t i = 0; i < 2; ++i) {
      reference_low_[i] = std::min(reference_low_[i], r.reference[i]);
      reference_high_[i] = std::max(reference_high_[i], r.reference[i]);
    }
    const bool settled = r.t >= settling_time;
    sums_.effector.add(settled, r.effector_error);
    for (const double e : r.base_error) sums_.base.add(settled, std::abs(e));
  }
  sums_.add(r.torque, r.power, r.saturated);
}

double Statistics::path_size() const {
  return std::max({0.0, reference_high_[0] - reference_low_[0], reference_high_[1] - reference_low_[1]});
}

Json Statistics::tracking() const {
  if (!has_reference_) return nullptr;
  const auto known = [](const ErrorStatistics::Moments& m, double v) {
    return m.count > 0 ? Json(v) : Json(nullptr);
  };
  Json t;
  const auto add = [&](const std::string& prefix, const char* unit, const ErrorStatistics::Moments& m) {
    t[prefix + "rms_" + unit] = known(m, m.rms());
    t[prefix + "max_" + unit] = known(m, m.largest);
  };
  add("", "m", sums_.effector.all());
  add("", "rad", sums_.base.all());
  add("settled_", "m", sums_.effector.settled());
  add("settled_", "rad", sums_.base.settled());
  return t;
}

Json Statistics::torque() const {
  return {{"max_nm", sums_.torque_max},
          {"mean_abs_delta_nm", sums_.torque_activity()},
          {"saturated_ticks", static_cast<std::uint64_t>(sums_.saturated_ticks)}};
}

namespace {
Json accuracy_json(const AccuracyReport& a) {
  const Events& e = a.events;
  return {{"asked", a.asked},
          {"of", name(a.of)},
          {"estimated", a.estimated},
          {"method", a.method},
          {"between", a.between},
          {"step", a.step},
          {"events",
           {{"total", e.total()},
            {"stick", e.stick},
            {"slip", e.slip},
            {"impact", e.impact},
            {"contact", e.contact},
            {"accumulated", e.accumulated},
            {"crowded", e.crowded}}},
          {"passes", a.passes},
          {"evaluations", a.evaluations},
          {"cpu_s", a.cpu_s}};
}
}  // namespace

Json make_summary(const Scene& scene, const Statistics& s, const RunEnd& end) {
  const double simulated = static_cast<double>(s.ticks()) * scene.tick();
  Json effects = Json::array();
  for (const Effect& e : scene.effects) effects.push_back(type_name(e));
  Json j;
  j["scene"] = scene.name;
  j["seed"] = end.seed;
  j["duration_s"] = scene.duration;
  j["simulated_s"] = static_cast<double>(s.ticks()) / scene.rate_hz;
  j["ticks"] = s.ticks();
  j["wall_s"] = end.wall_s;
  j["real_time_factor"] = end.wall_s > 0.0 ? Json(simulated / end.wall_s) : Json(nullptr);
  j["law"] = name(scene.law);
  j["active_effects"] = effects;
  j["state_dimension"] = end.state_dimension;
  j["integrator"] = end.accuracy ? end.accuracy->method : name(end.method);
  j["tracking"] = s.tracking();
  j["torque"] = s.torque();
  j["closure"] = {{"max_m", s.closure_max}};
  j["energy"] = {{"relative_error", s.energy_error}};
  if (end.accuracy) j["accuracy"] = accuracy_json(*end.accuracy);
  j["bus"] = nullptr;
  if (end.bus) j["bus"] = {{"frames", end.bus->frames}, {"load", end.bus->load}, {"lost", end.bus->lost}};
  if (end.bus && end.bus->disturbances) j["bus"].update(*end.bus->disturbances);
  const auto fault_t = s.fault_time() ? s.fault_time() : end.fault_t;
  j["supervisor"] = {{"final_state", end.final_state}, {"faults", Json::array()}, {"fault_t_s", nullptr}};
  const auto known = [](const auto& v) { return v ? Json(*v) : Json(nullptr); };
  for (const FaultRecord& f : end.faults) {
    j["supervisor"]["faults"].push_back(
        {{"name", f.name},
         {"tick", fault_t ? Json(std::llround(*fault_t * scene.rate_hz)) : Json(nullptr)},
         {"t", known(fault_t)},
         {"where", f.where},
         {"measured", known(f.measured)},
         {"limit", known(f.limit)},
         {"unit", f.unit}});
  }
  if (!end.faults.empty() && fault_t) j["supervisor"]["fault_t_s"] = *fault_t;
  if (!end.odd_encoder.empty()) j["supervisor"]["odd_encoder"] = end.odd_encoder;
  j["final_state"] = {{"q", end.q}, {"qd", end.qd}};
  j["digest"] = s.digest.text();
  if (!s.has_truth) {
    for (const char* key : {"closure", "energy", "final_state", "digest", "state_dimension", "integrator"})
      j[key] = nullptr;
  }
  if (end.late_ticks) j["late_ticks"] = *end.late_ticks;
  if (end.interrupted) j["interrupted"] = true;
  j["verdict"] = verdict_of(j, s.path_size(), scene.mechanism.legs[0].l1 + scene.mechanism.legs[0].l2);
  return j;
}

namespace {
double real(const Json& j, const char* key) { return j[key].get<double>(); }
std::uint64_t count(const Json& j, const char* key) { return j[key].get<std::uint64_t>(); }
std::string text(const Json& j, const char* key) { return j[key].get<std::string>(); }
std::string disturbance_text(const Json& bus) {
  std::string out = fmt::format("bus: {}, {} missed, {} duplicated, {} corrupted",
                                plural(count(bus, "errors"), "error frame"), count(bus, "missed"),
                                count(bus, "duplicated"), count(bus, "corrupted"));
  double latency = 0.0;
  for (const Json& m : bus["messages"]) latency = std::max(latency, real(m, "latency_max_s"));
  if (bus["timed"].get<bool>()) out += fmt::format(", latency {:.0f} us at most", 1e6 * latency);
  for (const Json& n : bus["nodes"]) {
    if (n["error_state"] != "active")
      out += fmt::format("; {} is error-{}", text(n, "name"), text(n, "error_state"));
  }
  return out + "\n";
}

std::string tracking_text(const Json& t) {
  if (t.is_null() || t["max_m"].is_null()) return "";
  const bool settled = !t["settled_max_m"].is_null();
  const auto value = [&](const char* key) {
    return t[(settled ? "settled_" : "") + std::string(key)].get<double>();
  };
  return fmt::format(
      "tracking {} {} s: effector {:.3g} mm rms, {:.3g} mm max; base joints {:.3g} rad rms, {:.3g} rad max\n",
      settled ? "after" : "in the first", settling_time, 1e3 * value("rms_m"), 1e3 * value("max_m"),
      value("rms_rad"), value("max_rad"));
}
}  // namespace

std::string summary_text(const Json& s) {
  const Json &u = s["torque"], &bus = s["bus"];
  std::string out = fmt::format(
      "{}: {} law, {} ({} s{}), {}\n", printable(text(s, "scene")), text(s, "law"),
      plural(count(s, "ticks"), "tick"), real(s, "simulated_s"),
      s.contains("interrupted") ? fmt::format(" of {} s, interrupted", real(s, "duration_s")) : "",
      plural(s["supervisor"]["faults"].size(), "fault"));
  out += tracking_text(s["tracking"]);
  out += fmt::format("torque: {:.3g} N m max, {:.3g} N m mean change per tick, saturated in {}\n",
                     real(u, "max_nm"), real(u, "mean_abs_delta_nm"),
                     plural(count(u, "saturated_ticks"), "tick"));
  if (!s["closure"].is_null())
    out += fmt::format("closure {:.2g} m, energy balance {:.2g}\n", real(s["closure"], "max_m"),
                       real(s["energy"], "relative_error"));
  if (s.contains("accuracy")) {
    const Json& a = s["accuracy"];
    out += fmt::format(
        "accuracy: {:.1g} asked, {:.1g} estimated; {}, {}, {} accumulated, {:.2g} s of CPU time\n",
        real(a, "asked"), real(a, "estimated"), text(a, "method"),
        plural(count(a["events"], "total"), "event"), count(a["events"], "accumulated"), real(a, "cpu_s"));
  }
  if (!bus.is_null()) {
    out += fmt::format("bus: {} frames, {} lost, load {:.0f} %\n", count(bus, "frames"), count(bus, "lost"),
                       100.0 * real(bus, "load"));
    if (bus.contains("errors")) out += disturbance_text(bus);
  }
  if (s["real_time_factor"].is_number())
    out += fmt::format("{:.0f} x real time", real(s, "real_time_factor"));
  if (s["digest"].is_string()) out += ", digest " + text(s, "digest");
  return out + "\n";
}

}  // namespace esmc::host
