#include "host_sim/operate/telemetry_mcap.hpp"

#include <fmt/format.h>

#include <cmath>

#include "host_sim/record/recording.hpp"

namespace esmc::host {
namespace {

/// "11" of theta11, by motor.
std::vector<std::string> motor_names(const Scene* scene) {
  std::vector<std::string> out;
  if (scene == nullptr) {
    for (unsigned i = 1; i <= link::joints_max; ++i) out.push_back(fmt::format("_motor{}", i));
    return out;
  }
  const auto joints = joint_names(scene->type);
  for (const std::size_t joint : scene->motor_joints()) out.push_back(joints[joint].substr(5));
  return out;
}

}  // namespace

TelemetryMcap::TelemetryMcap(Connection& connection, const Scene* scene, const std::string& file)
    : link_(connection),
      file_(file),
      motors_(0),
      statuses_(connection.news().statuses),
      begin_(connection.news().ticks) {
  const auto names = motor_names(scene);
  motors_ = names.size();
  std::vector<std::string> columns{"t", "x", "y", "x_error", "y_error"};
  for (const char* what : {"theta", "tau"}) {
    for (const std::string& n : names) columns.push_back(what + n);
  }
  columns.insert(columns.end(), {"fault", "state"});
  file_.columns(columns);
  link_.tap(this, [this](std::int64_t time_us, const hal::CanFrame& f, bool) { take(time_us, f); });
}

TelemetryMcap::~TelemetryMcap() { link_.tap(this, {}); }

void TelemetryMcap::take(std::int64_t time_us, const hal::CanFrame& f) {
  file_.frame(time_us, f);
  const ControllerNews& n = link_.news();
  if (n.statuses == statuses_) return;
  statuses_ = n.statuses;
  std::vector<double> row{static_cast<double>(n.ticks - begin_) *
                          static_cast<double>(link_.parameter(link::Index::sample_time))};
  const auto value = [&](const std::optional<std::array<float, 2>>& v, std::size_t i) {
    row.push_back(v ? static_cast<double>((*v)[i]) : std::nan(""));
  };
  for (const auto& pair : {n.effector, n.error}) value(pair, 0), value(pair, 1);
  for (std::size_t which = 0; which < 2; ++which) {
    for (std::size_t i = 0; i < motors_; ++i) value(n.joint[i], which);
  }
  row.push_back(static_cast<double>(n.status->fault));
  file_.row(row, name(n.status->state));
}

void TelemetryMcap::commit() {
  link_.tap(this, {});
  file_.commit();
}

}  // namespace esmc::host
