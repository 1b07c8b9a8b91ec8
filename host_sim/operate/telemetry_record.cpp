#include "host_sim/operate/telemetry_record.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <nlohmann/json.hpp>
#include <utility>
#include <vector>

#include "host_sim/bus/frame_log.hpp"
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

TelemetryTap::TelemetryTap(Connection& connection, Connection::Tap frame, Row row) : link_(connection) {
  link_.taps[this] = [this, frame = std::move(frame), row = std::move(row), begin = link_.news().ticks,
                      statuses = link_.news().statuses](std::int64_t time_us,
                                                        const hal::CanFrame& f) mutable {
    frame(time_us, f);
    const ControllerNews& n = link_.news();
    if (std::exchange(statuses, n.statuses) != n.statuses)
      row(link_.seconds(n.ticks - begin), n.values(), *n.status);
  };
}

TelemetryRecord::TelemetryRecord(Connection& connection, const std::string& directory)
    : link_(connection),
      out_(directory),
      frames_(out_.open("frames.log")),
      log_(out_.open("log.csv")),
      tap_(
          connection,
          [this](std::int64_t time_us, const hal::CanFrame& f) {
            fmt::print(frames_.get(), "{}\n", candump_line(time_us, link_.bus().interface(), f));
          },
          [this](double t, const ControllerNews::Values& values, const link::Status& s) {
            fmt::print(log_.get(), "{},{},{},{}\n", t, fmt::join(values, ","), name(s.fault), name(s.state));
            ++rows_;
          }) {
  std::fputs("t,x,y,x_error,y_error,angle1,tau1,angle2,tau2,angle3,tau3,angle4,tau4,fault,state\n",
             log_.get());
}

void TelemetryRecord::close() {
  tap_.end();
  const bool written = std::ferror(frames_.get()) == 0 && std::ferror(log_.get()) == 0;
  if (std::fclose(frames_.release()) != 0 || std::fclose(log_.release()) != 0 || !written)
    throw RunError("the record could not be written completely (disk full?)");
  out_.write("summary.json",
             document_text({{"command", "operate"}, {"rows", rows_}, {"fault", name(link_.status().fault)}}));
  out_.commit();
}

TelemetryMcap::TelemetryMcap(Connection& connection, const Scene* scene, const std::string& file)
    : file_(file),
      tap_(
          connection, [this](std::int64_t time_us, const hal::CanFrame& f) { file_.frame(time_us, f); },
          [this, motors = motor_names(scene).size()](double t, const ControllerNews::Values& values,
                                                     const link::Status& s) {
            std::vector<double> row{t};
            row.insert(row.end(), values.begin(), values.begin() + 4);
            for (const std::size_t which : {4U, 5U}) {  // angles, then torques
              for (std::size_t i = 0; i < motors; ++i)
                row.push_back(static_cast<double>(values[which + 2 * i]));
            }
            row.push_back(static_cast<double>(s.fault));
            file_.row(row, name(s.state));
          }) {
  std::vector<std::string> columns{"t", "x", "y", "x_error", "y_error"};
  for (const char* what : {"theta", "tau"}) {
    for (const std::string& n : motor_names(scene)) columns.push_back(what + n);
  }
  columns.insert(columns.end(), {"fault", "state"});
  file_.columns(columns);
}

void TelemetryMcap::commit() {
  tap_.end();
  file_.commit();
}

}  // namespace esmc::host
