#include "host_sim/operate/telemetry_record.hpp"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "host_sim/bus/frame_log.hpp"

namespace esmc::host {

TelemetryRecord::TelemetryRecord(Connection& connection, const std::string& directory)
    : link_(connection),
      out_(directory),
      frames_(out_.open("frames.log")),
      log_(out_.open("log.csv")),
      statuses_(connection.news().statuses),
      begin_(connection.news().ticks) {
  std::fputs("t,x,y,x_error,y_error,angle1,tau1,angle2,tau2,angle3,tau3,angle4,tau4,fault,state\n",
             log_.get());
  link_.tap(this, [this](std::int64_t time_us, const hal::CanFrame& f, bool) { take(time_us, f); });
}

TelemetryRecord::~TelemetryRecord() { link_.tap(this, {}); }

void TelemetryRecord::take(std::int64_t time_us, const hal::CanFrame& f) {
  fmt::print(frames_.get(), "{}\n", candump_line(time_us, link_.bus().interface(), f));
  if (link_.news().statuses != statuses_) row();
}

void TelemetryRecord::row() {
  const ControllerNews& n = link_.news();
  statuses_ = n.statuses;
  std::string text = fmt::format("{}", static_cast<double>(n.ticks - begin_) *
                                           static_cast<double>(link_.parameter(link::Index::sample_time)));
  const auto pair = [&](const std::optional<std::array<float, 2>>& v) {
    text += v ? fmt::format(",{},{}", (*v)[0], (*v)[1]) : ",nan,nan";
  };
  pair(n.effector);
  pair(n.error);
  for (const auto& joint : n.joint) pair(joint);
  fmt::print(log_.get(), "{},{},{}\n", text, name(n.status->fault), name(n.status->state));
  ++rows_;
}

void TelemetryRecord::close() {
  link_.tap(this, {});
  const bool written = std::ferror(frames_.get()) == 0 && std::ferror(log_.get()) == 0;
  if (std::fclose(frames_.release()) != 0 || std::fclose(log_.release()) != 0 || !written)
    throw RunError("the record could not be written completely (disk full?)");
  out_.write("summary.json",
             document_text({{"command", "operate"}, {"rows", rows_}, {"fault", name(link_.status().fault)}}));
  out_.commit();
}

}  // namespace esmc::host
