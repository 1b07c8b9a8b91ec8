#include "host_sim/loop/drive_reports.hpp"

#include <fmt/format.h>

#include <cmath>
#include <iterator>
#include <optional>

namespace esmc::host {

template <class World, class C>
std::string DriveReports<World, C>::odd_encoder() const {
  return std::visit(
      [](const auto& c) -> std::string {
        const int odd = c.controller().odd_encoder();
        return c.supervisor().fault() == Fault::loop_not_closed && odd != 0 ? World::joint_names[odd - 1]
                                                                            : "";
      },
      cycle_);
}

template <class World, class C>
std::string DriveReports<World, C>::refusal() const {
  const Fault fault = std::visit([](const auto& c) { return c.supervisor().fault(); }, cycle_);
  std::string out = name(fault);
  const std::string waiting = unready(), odd = odd_encoder();
  if (fault == Fault::enabling_timeout && !waiting.empty()) out += " (not ready: " + waiting + ")";
  if (!odd.empty()) out += " (the encoder of " + odd + " contradicts the others)";
  for_each_axis([&](const auto& a, std::size_t i) { out += reported(a, motor_[i]); });
  return out;
}

template <class World, class C>
void DriveReports<World, C>::add_details(const Torques& expected, FaultRecord& f) const {
  std::visit(
      [&](const auto& c) {
        for (std::size_t i = nodes_.size(); i-- > 0;)
          add_details(c.axis(static_cast<int>(i)), i, expected, f);
      },
      cycle_);
}

namespace {

/// The vendor's names of faults of a moteus; a time-out is its mode.
std::string moteus_error_name(std::uint32_t code) {
  constexpr const char* names[] = {"calibration fault",    "motor driver fault",
                                   "over voltage",         "encoder fault",
                                   "motor not configured", "pwm cycle overrun",
                                   "over temperature",     "outside limit",
                                   "under voltage",        "config changed",
                                   "theta invalid",        "position invalid",
                                   "driver enable fault",  "stop position deprecated",
                                   "timing violation",     "bemf feedforward without acceleration limit",
                                   "invalid limits"};
  constexpr std::uint32_t first = 32;
  if (code == drive::MoteusAxis::timed_out) return "time-out";
  return code >= first && code - first < std::size(names) ? names[code - first] : "not documented";
}

}  // namespace

/// Reasons not to arm that the axis knows of.
template <class World, class C>
template <class Axis>
std::string DriveReports<World, C>::reported(const Axis& a, bool motor) const {
  std::string out;
  if constexpr (requires { a.encoder_unconnected(); }) {
    if (!motor && a.encoder_unconnected()) {
      out += fmt::format(
          " (node {} reports position 0, as firmware 0.5.6 does until its first closed loop: no passive "
          "encoder)",
          a.node());
    }
  }
  if constexpr (requires { a.refused_endpoint(); }) {
    if (const auto e = a.refused_endpoint())
      out += fmt::format(" (node {}, {})", a.node(), endpoint_path(*e));
  }
  if constexpr (requires { a.refused_register(); }) {
    if (a.refused_register() != drive::moteus::no_register)
      out += fmt::format(" (node {}, register {:03X})", a.node(), a.refused_register());
    if (a.last_error() != 0)
      out += fmt::format(" (node {}, fault {}: {})", a.node(), a.last_error(),
                         moteus_error_name(a.last_error()));
  }
  if constexpr (requires { a.contradicting_object(); }) {
    if (const auto o = a.contradicting_object())
      out += fmt::format(" (node {}, object {:04X}:{:02X})", a.node(), o->index, o->sub);
  }
  return out;
}

template <class World, class C>
template <class Axis>
void DriveReports<World, C>::add_details(const Axis& a, std::size_t i, const Torques& expected,
                                         FaultRecord& f) const {
  constexpr int joints = World::Mechanism::joints;
  const int joint = static_cast<int>(i) * (nodes_.size() == joints ? 1 : joints / 2);
  const std::string node = fmt::format("node {}", nodes_[i]);
  const auto put = [&](std::optional<double> measured, std::optional<double> limit, const std::string& unit) {
    f.where = fmt::format("{}, {}", World::joint_names[joint], node);
    f.measured = measured;
    f.limit = limit;
    f.unit = unit;
  };
  if (f.where == World::joint_names[joint]) f.where += ", " + node;
  const auto is = [&](Fault fault) { return f.name == name(fault); };
  const double age = a.heartbeat_age_ticks() * scene_.tick();
  if (is(Fault::emergency_stop) && a.emergency_stopped()) put({}, {}, "");
  if (is(Fault::drive_configuration) && a.config_mismatch()) put({}, {}, "");
  if (!motor_[i]) return;
  if (is(Fault::drive_error) && a.error()) {
    std::string unit = "error code";
    if constexpr (std::is_same_v<Axis, drive::MoteusAxis>)
      unit += fmt::format(" ({})", moteus_error_name(a.error_code()));
    put(a.error_code(), {}, unit);
  }
  if (is(Fault::drive_disarmed) && !a.closed_loop()) put({}, {}, "");
  if (is(Fault::heartbeat_lost) && age > scene_.drives.heartbeat_timeout)
    put(age, scene_.drives.heartbeat_timeout, "s without a heartbeat");
  if (is(Fault::stale_feedback) && f.where.empty() &&
      a.sample_age_ticks() > static_cast<std::uint32_t>(scene_.limits.max_age_ticks))
    put(a.sample_age_ticks(), scene_.limits.max_age_ticks, "ticks without a sample");
  if constexpr (requires { a.observed_torque(); }) {
    if (const auto seen = a.observed_torque(); is(Fault::torque_mismatch) && seen) {
      const double off = std::abs(static_cast<double>(*seen) - expected[joint]);
      if (off > f.measured.value_or(0.0)) put(off, scene_.drives.torque_mismatch, "N m from its command");
    }
  }
}

/// The vendor's name of an endpoint of the scene.
template <class World, class C>
std::string DriveReports<World, C>::endpoint_path(std::uint16_t id) const {
  if (id == drive::OdriveReadBack::version_endpoint) return "version of the firmware";
  if (const auto& endpoints = scene_.drives.endpoints) {
    for (const OdriveEndpoint& e : endpoints->list) {
      if (e.id == id) return odrive_values[static_cast<std::size_t>(e.value)].path;
    }
  }
  return fmt::format("endpoint {}", id);
}

template class DriveReports<FiveBarTraits>;
template class DriveReports<FiveBarTraits, FiveBar<float>>;
template class DriveReports<RrTraits>;
template class DriveReports<RrTraits, Rr<float>>;

}  // namespace esmc::host
