#include "host_sim/commands/summary.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

namespace esmc::host {

using Json = nlohmann::ordered_json;

std::string Digest::text() const { return fmt::format("{:016x}", hash_); }

void Statistics::add(const TickRecord& r) {
  ++ticks_;
  digest.add(r.q);
  digest.add(r.qd);
  if (r.has_reference) {
    has_reference_ = true;
    const bool settled = r.t >= settling_time;
    effector_.add(settled, r.effector_error);
    for (const double e : r.base_error) base_.add(settled, std::abs(e));
  }
  if (r.saturated) ++saturated_;
  for (std::size_t i = 0; i < r.torque.size(); ++i) {
    torque_max_ = std::max(torque_max_, std::abs(r.torque[i]));
    if (last_torque_.size() == r.torque.size()) {
      delta_sum_ += std::abs(r.torque[i] - last_torque_[i]);
      ++deltas_;
    }
  }
  last_torque_.assign(r.torque.begin(), r.torque.end());
}

Json Statistics::tracking() const {
  if (!has_reference_) return nullptr;
  const auto settled = [](const ErrorStatistics::Moments& m, double v) {
    return m.count > 0 ? Json(v) : Json(nullptr);
  };
  Json t;
  t["rms_m"] = effector_.all().rms();
  t["max_m"] = effector_.all().largest;
  t["rms_rad"] = base_.all().rms();
  t["max_rad"] = base_.all().largest;
  t["settled_rms_m"] = settled(effector_.settled(), effector_.settled().rms());
  t["settled_max_m"] = settled(effector_.settled(), effector_.settled().largest);
  t["settled_rms_rad"] = settled(base_.settled(), base_.settled().rms());
  t["settled_max_rad"] = settled(base_.settled(), base_.settled().largest);
  return t;
}

Json Statistics::torque() const {
  Json t;
  t["max_nm"] = torque_max_;
  t["mean_abs_delta_nm"] = deltas_ > 0 ? delta_sum_ / static_cast<double>(deltas_) : 0.0;
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

Json make_summary(const Scene& scene, const Statistics& s, const RunEnd& end) {
  const double simulated = static_cast<double>(s.ticks()) * scene.tick();
  Json effects = Json::array();
  for (const Effect& e : scene.effects) effects.push_back(type_name(e));
  Json j;
  j["scene"] = scene.name;
  j["seed"] = end.seed;
  j["duration_s"] = scene.duration;
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
  j["supervisor"] = {{"final_state", end.final_state}, {"faults", end.faults}};
  j["final_state"] = {{"q", end.q}, {"qd", end.qd}};
  j["digest"] = s.digest.text();
  if (!s.has_truth) {
    for (const char* key : {"closure", "energy", "final_state", "digest", "state_dimension", "integrator"})
      j[key] = nullptr;
  }
  if (end.interrupted) j["interrupted"] = true;
  return j;
}

std::string summary_text(const Json& s) {
  std::string out =
      fmt::format("{}: {} law, {} ticks ({} s{}), {} fault{}", s["scene"].get<std::string>(),
                  s["law"].get<std::string>(), s["ticks"].get<std::uint64_t>(), s["duration_s"].get<double>(),
                  s.contains("interrupted") ? ", interrupted" : "", s["supervisor"]["faults"].size(),
                  s["supervisor"]["faults"].size() == 1 ? "" : "s");
  for (const Json& f : s["supervisor"]["faults"]) out += ": " + f.get<std::string>();
  out += "\n";
  const Json& t = s["tracking"];
  if (!t.is_null() && !t["settled_max_rad"].is_null()) {
    out += fmt::format(
        "tracking after {} s: effector {:.3g} mm rms, {:.3g} mm max; base joints {:.3g} rad rms, "
        "{:.3g} rad max\n",
        Statistics::settling_time, 1e3 * t["settled_rms_m"].get<double>(),
        1e3 * t["settled_max_m"].get<double>(), t["settled_rms_rad"].get<double>(),
        t["settled_max_rad"].get<double>());
  }
  const Json& u = s["torque"];
  out += fmt::format("torque: {:.3g} N m max, {:.3g} N m mean change per tick, saturated in {} ticks\n",
                     u["max_nm"].get<double>(), u["mean_abs_delta_nm"].get<double>(),
                     u["saturated_ticks"].get<std::uint64_t>());
  if (!s["closure"].is_null()) {
    out += fmt::format("closure {:.2g} m, energy balance {:.2g}\n", s["closure"]["max_m"].get<double>(),
                       s["energy"]["relative_error"].get<double>());
  }
  if (!s["bus"].is_null()) {
    out += fmt::format("bus: {} frames, {} lost, load {:.0f} %\n", s["bus"]["frames"].get<std::uint64_t>(),
                       s["bus"]["lost"].get<std::uint64_t>(), 100.0 * s["bus"]["load"].get<double>());
  }
  if (s["real_time_factor"].is_number()) {
    out += fmt::format("{:.0f} x real time", s["real_time_factor"].get<double>());
  }
  if (s["digest"].is_string()) out += fmt::format(", digest {}", s["digest"].get<std::string>());
  return out + "\n";
}

}  // namespace esmc::host
