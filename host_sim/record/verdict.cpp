#include "host_sim/record/verdict.hpp"

#include <fmt/format.h>

#include <cstdint>
#include <nlohmann/json.hpp>
#include <vector>

#include "host_sim/error.hpp"
#include "host_sim/record/run_sums.hpp"

namespace esmc::host {
namespace {

using Json = nlohmann::ordered_json;

std::string fault_text(const Json& f, const Json& supervisor) {
  std::string out = f["name"].get<std::string>();
  if (f["t"].is_number()) out += fmt::format(" at t = {:.3f} s", f["t"].get<double>());
  std::string more = f["where"].get<std::string>();
  if (f["measured"].is_number()) {
    const auto measured = f["measured"].get<double>();
    const auto unit = f["unit"].get<std::string>();
    more += more.empty() ? "" : ", ";
    // Drives' manuals list error codes in hexadecimal.
    more += unit.starts_with("error code")
                ? fmt::format("0x{:X}, {}", static_cast<std::uint32_t>(measured), unit)
                : fmt::format("{:.4g} {}", measured, unit);
  }
  if (f["limit"].is_number()) more += fmt::format(", limit {:.4g}", f["limit"].get<double>());
  if (supervisor.contains("odd_encoder"))
    more += fmt::format("; the encoder of {} contradicts the others",
                        supervisor["odd_encoder"].get<std::string>());
  return more.empty() ? out : out + ": " + more;
}

bool controlled(const Json& s) { return s["law"] != "open_loop" && s["law"] != "none"; }

/// Where the effector stayed; the tracking error counts until a fault.
std::string followed(const Json& tracking, bool controlled, bool fault) {
  if (!controlled) return "there was no controller";
  if (tracking.is_null()) return "there was no reference to follow";
  const Json& settled = tracking["settled_max_m"];
  if (!settled.is_number())
    return fmt::format("{} before tracking had settled, in the first {} s",
                       fault ? "the fault came" : "the run ended", settling_time);
  return fmt::format("{}after the first {} s, the effector stayed within {:.3g} mm of the reference",
                     fault ? "until the fault, " : "", settling_time, 1e3 * settled.get<double>());
}

std::vector<std::string> concerns(const Json& s, double path, double leg, bool fault) {
  std::vector<std::string> out;
  const Json &u = s["torque"], &bus = s["bus"], &t = s["tracking"];
  const bool rests = path <= rest_share * leg;
  const double most = rests ? rest_error_share * leg : error_share * path;
  if (controlled(s) && !fault && t.is_object() && t["settled_max_m"].is_number() &&
      !(t["settled_max_m"].get<double>() <= most)) {
    out.push_back(rests ? fmt::format("the error is above {:g} % of a leg's length", 100.0 * rest_error_share)
                        : fmt::format("the error is above {:.0f} % of the path", 100.0 * error_share));
  }
  const double change = u["mean_abs_delta_nm"].get<double>(), largest = u["max_nm"].get<double>();
  if (controlled(s) && change > chatter_share * largest) {
    out.push_back(fmt::format(
        "chatter: from tick to tick the torque changes by {:.0f} % of its maximum (docs/get-started.md, "
        "\"Too much chatter?\")",
        100.0 * change / largest));
  }
  const auto ticks = s["ticks"].get<std::uint64_t>(), saturated = u["saturated_ticks"].get<std::uint64_t>();
  const double share = ticks > 0 ? static_cast<double>(saturated) / static_cast<double>(ticks) : 0.0;
  if (share > saturated_share) {
    out.push_back(fmt::format("saturated in {} of {}: the torque limit decides what happens, not the law",
                              saturated, plural(ticks, "tick")));
  } else if (share > 0.05) {
    out.push_back(fmt::format("saturated in {} of {}", saturated, plural(ticks, "tick")));
  }
  if (!bus.is_null()) {
    if (!bus.value("timed", false) && bus["load"].get<double>() > 1.0) {
      out.push_back(
          fmt::format("bus load {:.0f} %: a real bus cannot carry this loop; here frames take no time",
                      100.0 * bus["load"].get<double>()));
    }
    if (bus["lost"].get<std::uint64_t>() > 0)
      out.push_back(plural(bus["lost"].get<std::uint64_t>(), "frame") + " lost on the bus");
  }
  if (const auto late = s.value("late_ticks", std::uint64_t{0}); late > 0)
    out.push_back(plural(late, "tick") + " late by more than a tick of the wall clock");
  return out;
}

}  // namespace

Json verdict_of(const Json& s, double path, double leg) {
  const Json &supervisor = s["supervisor"], &faults = supervisor["faults"];
  const bool fault = !faults.empty();
  std::vector<std::string> reasons;
  for (const Json& f : faults) reasons.push_back(fault_text(f, supervisor));
  for (std::string& one : concerns(s, path, leg, fault)) reasons.push_back(std::move(one));
  const bool ok = reasons.empty();
  reasons.push_back(followed(s["tracking"], controlled(s), fault));
  if (!fault) reasons.emplace_back("no fault");
  return {{"ok", ok}, {"word", fault ? "FAULT" : ok ? "OK" : "CHECK"}, {"reasons", reasons}};
}

std::string verdict_line(const Json& summary) {
  const Json& v = summary["verdict"];
  std::string out = v["word"].get<std::string>() + ": ";
  for (const Json& one : v["reasons"]) out += (out.ends_with(": ") ? "" : "; ") + one.get<std::string>();
  return printable(out);
}

}  // namespace esmc::host
