#include "host_sim/operate/status_text.hpp"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

namespace esmc::host {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::array reaction_names{"none", "zero_torque", "halt"};
constexpr std::array source_names{"hold", "reference", "stream"};
constexpr std::array pace_names{"full", "reduced", "held"};

template <class T>
Json or_null(const std::optional<T>& v) {
  return v ? Json(*v) : Json(nullptr);
}

Json fault_json(const link::FaultRecord& r) {
  return {{"name", name(r.fault)},
          {"axis", r.axis == link::no_axis ? Json(nullptr) : Json(r.axis + 1)},
          {"count", r.count},
          {"time_s", static_cast<double>(r.time_us) * 1e-6},
          {"drive_error", r.drive_error}};
}

}  // namespace

nlohmann::ordered_json status_json(const Connection& c) {
  const ControllerNews& n = c.news();
  const link::Status& s = *n.status;
  Json j{{"state", name(s.state)},
         {"fault", name(s.fault)},
         {"reaction", reaction_names[static_cast<std::size_t>(s.reaction)]},
         {"source", source_names[static_cast<std::size_t>(s.source)]},
         {"streaming", s.streaming},
         {"pace", pace_names[static_cast<std::size_t>(s.pace)]},
         {"zero_known", !s.zero_unknown},
         {"tick", s.tick},
         {"session", s.session},
         {"scene", fmt::format("{:08x}", n.scene.value_or(0))},
         {"protocol_version", n.version},
         {"effector", or_null(n.pose())},
         {"error", or_null(n.error)},
         {"joints", Json::array()},
         {"parameters", Json::object()},
         {"store", n.store ? name(n.store->state) : "none"},
         {"faults", Json::array()}};
  for (const auto& joint : n.joint) {
    if (joint) j["joints"].push_back({{"angle", (*joint)[0]}, {"torque", (*joint)[1]}});
  }
  for (std::size_t i = 0; i < parameter_names.size(); ++i)
    j["parameters"][parameter_names[i]] = {{"value", n.parameter[i].value},
                                           {"writable", n.parameter[i].writable}};
  if (n.counters)
    j["frames"] = {{"obeyed", n.counters->obeyed},
                   {"bad_crc", n.counters->bad_crc},
                   {"bad_counter", n.counters->bad_counter},
                   {"refused", n.counters->refused}};
  for (const link::FaultRecord& r : n.faults) j["faults"].push_back(fault_json(r));
  return j;
}

std::string status_text(const Connection& c) {
  const ControllerNews& n = c.news();
  const link::Status& s = *n.status;
  std::string out =
      fmt::format("{}, fault {}, source {}, tick {}, scene {:08x}", name(s.state), name(s.fault),
                  source_names[static_cast<std::size_t>(s.source)], s.tick, n.scene.value_or(0));
  if (s.pace != link::Pace::full)
    out += fmt::format("\nreference {}", pace_names[static_cast<std::size_t>(s.pace)]);
  if (s.zero_unknown) out += "\nzero not confirmed: home, or zero in the zero pose";
  if (const auto pose = n.pose()) out += fmt::format("\neffector {:.6f} {:.6f} m", (*pose)[0], (*pose)[1]);
  for (std::size_t i = 0; i < n.joint.size(); ++i) {
    if (n.joint[i])
      out += fmt::format("\njoint {}: {:.6f} rad, {:.4f} N m", i + 1, (*n.joint[i])[0], (*n.joint[i])[1]);
  }
  for (std::size_t i = 0; i < link::gain_count; ++i)
    out += fmt::format("\n{} = {}{}", parameter_names[i], n.parameter[i].value,
                       n.parameter[i].writable ? "" : " (fixed)");
  for (const link::FaultRecord& r : n.faults) {
    out += fmt::format("\nfault record: {}, {} times, last at {:.3f} s", name(r.fault), r.count,
                       static_cast<double>(r.time_us) * 1e-6);
    if (r.axis != link::no_axis)
      out += fmt::format(", axis {}, drive error 0x{:x}", r.axis + 1, r.drive_error);
  }
  return out;
}

}  // namespace esmc::host
