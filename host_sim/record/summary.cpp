#include "host_sim/record/summary.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "host_sim/error.hpp"

namespace esmc::host {

using Json = nlohmann::ordered_json;

std::string Digest::text() const { return fmt::format("{:016x}", hash_); }

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
  if (r.has_reference && !fault_time_) {  // what falls without torque is not tracking
    const bool settled = r.t >= settling_time;
    effector_.add(settled, r.effector_error);
    for (const double e : r.base_error) base_.add(settled, std::abs(e));
  }
  if (r.saturated) ++saturated_;
  power_sum_ += r.power;
  for (std::size_t i = 0; i < r.torque.size(); ++i) {
    torque_max_ = larger(torque_max_, std::abs(r.torque[i]));
    if (last_torque_.size() == r.torque.size()) {
      delta_sum_ += std::abs(r.torque[i] - last_torque_[i]);
      ++deltas_;
    }
  }
  last_torque_.assign(r.torque.begin(), r.torque.end());
}

Json Statistics::tracking() const {
  if (!has_reference_) return nullptr;
  const auto known = [](const ErrorStatistics::Moments& m, double v) {
    return m.count > 0 ? Json(v) : Json(nullptr);
  };
  Json t;
  t["rms_m"] = known(effector_.all(), effector_.all().rms());
  t["max_m"] = known(effector_.all(), effector_.all().largest);
  t["rms_rad"] = known(base_.all(), base_.all().rms());
  t["max_rad"] = known(base_.all(), base_.all().largest);
  t["settled_rms_m"] = known(effector_.settled(), effector_.settled().rms());
  t["settled_max_m"] = known(effector_.settled(), effector_.settled().largest);
  t["settled_rms_rad"] = known(base_.settled(), base_.settled().rms());
  t["settled_max_rad"] = known(base_.settled(), base_.settled().largest);
  return t;
}

Json Statistics::torque() const {
  Json t;
  t["max_nm"] = torque_max_;
  t["mean_abs_delta_nm"] = torque_activity();
  t["saturated_ticks"] = saturated_;
  return t;
}

namespace {
const char* law_name(LawChoice l) {
  switch (l) {
    case LawChoice::esmc:
      return "esmc";
    case LawChoice::esmc_projected:
      return "esmc_projected";
    case LawChoice::smc:
      return "smc";
    case LawChoice::ctc:
      return "ctc";
    case LawChoice::pd:
      return "pd";
    case LawChoice::open_loop:
      return "open_loop";
    case LawChoice::none:
      return "none";
  }
  return "";
}
}  // namespace

namespace {
void add_disturbances(const BusSummary::Disturbances& d, Json& bus) {
  bus["timed"] = d.timed;
  bus["errors"] = d.errors;
  bus["missed"] = d.missed;
  bus["duplicated"] = d.duplicated;
  bus["corrupted"] = d.corrupted;
  bus["messages"] = Json::array();
  for (const BusSummary::Message& m : d.messages) {
    bus["messages"].push_back({{"id", m.id},
                               {"extended", m.extended},
                               {"count", m.frames},
                               {"latency_mean_s", m.mean_s},
                               {"latency_max_s", m.max_s}});
  }
  bus["nodes"] = Json::array();
  for (const BusSummary::Node& n : d.nodes) {
    bus["nodes"].push_back(
        {{"name", n.name}, {"error_state", n.state}, {"tec", n.transmit_errors}, {"rec", n.receive_errors}});
  }
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
  j["law"] = law_name(scene.law);
  j["active_effects"] = effects;
  j["state_dimension"] = end.state_dimension;
  j["integrator"] = name(end.method);
  j["tracking"] = s.tracking();
  j["torque"] = s.torque();
  j["closure"] = {{"max_m", s.closure_max}};
  j["energy"] = {{"relative_error", s.energy_error}};
  j["bus"] = nullptr;
  if (end.bus) j["bus"] = {{"frames", end.bus->frames}, {"load", end.bus->load}, {"lost", end.bus->lost}};
  if (end.bus && end.bus->disturbances) add_disturbances(*end.bus->disturbances, j["bus"]);
  j["supervisor"] = {{"final_state", end.final_state}, {"faults", end.faults}, {"fault_t_s", nullptr}};
  const auto fault_t = s.fault_time() ? s.fault_time() : end.fault_t;
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
  return j;
}

namespace {
std::string plural(std::uint64_t n, const char* word) {
  return fmt::format("{} {}{}", n, word, n == 1 ? "" : "s");
}

std::string fault_text(const Json& supervisor) {
  std::string out;
  for (const Json& f : supervisor["faults"]) {
    out += "fault " + f.get<std::string>();
    if (supervisor.contains("odd_encoder"))
      out += fmt::format(" (the encoder of {} contradicts the others)",
                         supervisor["odd_encoder"].get<std::string>());
    if (supervisor["fault_t_s"].is_number()) {
      out +=
          fmt::format(" at t = {:.3f} s; tracking counts until then", supervisor["fault_t_s"].get<double>());
    }
    out += "\n";
  }
  return out;
}

std::string disturbance_text(const Json& bus) {
  std::string out = fmt::format("bus: {}, {} missed, {} duplicated, {} corrupted",
                                plural(bus["errors"].get<std::uint64_t>(), "error frame"),
                                bus["missed"].get<std::uint64_t>(), bus["duplicated"].get<std::uint64_t>(),
                                bus["corrupted"].get<std::uint64_t>());
  double latency = 0.0;
  for (const Json& m : bus["messages"]) latency = std::max(latency, m["latency_max_s"].get<double>());
  if (bus["timed"].get<bool>()) out += fmt::format(", latency {:.0f} us at most", 1e6 * latency);
  for (const Json& n : bus["nodes"]) {
    if (n["error_state"] != "active")
      out +=
          fmt::format("; {} is error-{}", n["name"].get<std::string>(), n["error_state"].get<std::string>());
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
      settled ? "after" : "in the first", Statistics::settling_time, 1e3 * value("rms_m"),
      1e3 * value("max_m"), value("rms_rad"), value("max_rad"));
}
}  // namespace

std::vector<std::string> concerns(const Json& s) {
  std::vector<std::string> out;
  const bool controlled = s["law"] != "open_loop" && s["law"] != "none";
  const Json& u = s["torque"];
  const double change = u["mean_abs_delta_nm"].get<double>(), largest = u["max_nm"].get<double>();
  const auto saturated = u["saturated_ticks"].get<std::uint64_t>(), ticks = s["ticks"].get<std::uint64_t>();
  if (controlled && change > chatter_share * largest) {
    out.push_back(fmt::format(
        "chatter: from tick to tick the torque changes by {:.0f} % of its maximum (docs/get-started.md, "
        "\"Too much chatter?\")",
        100.0 * change / largest));
  }
  if (ticks > 0 && static_cast<double>(saturated) > saturated_share * static_cast<double>(ticks)) {
    out.push_back(fmt::format("saturated in {} of {}: the torque limit decides what happens, not the law",
                              saturated, plural(ticks, "tick")));
  }
  const bool timed = !s["bus"].is_null() && s["bus"].contains("timed") && s["bus"]["timed"].get<bool>();
  if (!s["bus"].is_null() && !timed && s["bus"]["load"].get<double>() > 1.0) {
    out.push_back(
        fmt::format("bus load {:.0f} %: a real bus cannot carry this loop; here frames take no time",
                    100.0 * s["bus"]["load"].get<double>()));
  }
  if (s.contains("late_ticks") && s["late_ticks"].get<std::uint64_t>() > 0) {
    out.push_back(fmt::format("{} late by more than a tick of the wall clock",
                              plural(s["late_ticks"].get<std::uint64_t>(), "tick")));
  }
  return out;
}

std::string summary_text(const Json& s) {
  std::string out = fmt::format(
      "{}: {} law, {} ({} s{}), {}\n", printable(s["scene"].get<std::string>()), s["law"].get<std::string>(),
      plural(s["ticks"].get<std::uint64_t>(), "tick"), s["simulated_s"].get<double>(),
      s.contains("interrupted") ? fmt::format(" of {} s, interrupted", s["duration_s"].get<double>()) : "",
      plural(s["supervisor"]["faults"].size(), "fault"));
  out += fault_text(s["supervisor"]) + tracking_text(s["tracking"]);
  const Json& u = s["torque"];
  out += fmt::format("torque: {:.3g} N m max, {:.3g} N m mean change per tick, saturated in {}\n",
                     u["max_nm"].get<double>(), u["mean_abs_delta_nm"].get<double>(),
                     plural(u["saturated_ticks"].get<std::uint64_t>(), "tick"));
  if (!s["closure"].is_null()) {
    out += fmt::format("closure {:.2g} m, energy balance {:.2g}\n", s["closure"]["max_m"].get<double>(),
                       s["energy"]["relative_error"].get<double>());
  }
  if (!s["bus"].is_null()) {
    out += fmt::format("bus: {} frames, {} lost, load {:.0f} %\n", s["bus"]["frames"].get<std::uint64_t>(),
                       s["bus"]["lost"].get<std::uint64_t>(), 100.0 * s["bus"]["load"].get<double>());
  }
  if (!s["bus"].is_null() && s["bus"].contains("errors")) out += disturbance_text(s["bus"]);
  for (const std::string& text : concerns(s)) out += text + "\n";
  if (s["real_time_factor"].is_number()) {
    out += fmt::format("{:.0f} x real time", s["real_time_factor"].get<double>());
  }
  if (s["digest"].is_string()) out += fmt::format(", digest {}", s["digest"].get<std::string>());
  return out + "\n";
}

}  // namespace esmc::host
