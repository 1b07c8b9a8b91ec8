#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>

#include "host_sim/bus/host_bus.hpp"
#include "host_sim/drives/cia402_axis.hpp"
#include "host_sim/drives/mit_axis.hpp"
#include "host_sim/drives/moteus_axis.hpp"
#include "host_sim/drives/odrive_axis.hpp"
#include "host_sim/loop/run.hpp"
#include "host_sim/loop/waiting.hpp"
#include "host_sim/names.hpp"
#include "host_sim/record/output.hpp"
#include "host_sim/scene/drive_defects.hpp"

namespace esmc::host {
namespace {

using Json = nlohmann::ordered_json;
using Clock = std::chrono::steady_clock;

Defects read_defects(const DriveOptions& o) {
  Defects out;
  for (const std::string& name : o.defects) {
    const std::string why = set_defect(out, name, o.protocol);
    if (!why.empty()) throw InputError("", "--defect " + name + ": " + why);
  }
  return out;
}

void require(bool allowed, const std::string& option, double value, const char* what) {
  if (!allowed) throw InputError("", fmt::format("--{} {}: must be {}", option, value, what));
}

void check(const DriveOptions& o) {
  const auto positive = [](double v) { return v > 0.0 && v <= 1e6; };
  require(positive(o.shaft.inertia), "inertia", o.shaft.inertia, "> 0 and <= 1e6, kg m2");
  require(o.shaft.friction >= 0.0 && o.shaft.friction <= 1e6, "friction", o.shaft.friction,
          "from 0 to 1e6, N m s/rad");
  require(std::abs(o.shaft.load) <= 1e6, "load", o.shaft.load, "from -1e6 to 1e6, N m");
  require(std::abs(o.shaft.angle) <= 1e6, "angle", o.shaft.angle, "from -1e6 to 1e6, rad");
  require(o.rate_hz >= 1.0 && o.rate_hz <= 1e4, "rate", o.rate_hz, "from 1 to 10000, Hz");
  require(o.watchdog > 0.0 && o.watchdog <= 1e3, "watchdog", o.watchdog, "> 0 and <= 1000, s");
  require(!o.duration || positive(*o.duration), "duration", o.duration.value_or(0.0), "> 0 and <= 1e6, s");
  for (const auto& [name, value] :
       {std::pair{"position-range", o.position_range}, std::pair{"velocity-range", o.velocity_range},
        std::pair{"torque-range", o.torque_range}, std::pair{"rated-torque", o.rated_torque}}) {
    require(positive(value), name, value, "> 0 and <= 1e6");
  }
  const bool odrive = o.protocol.starts_with("odrive"), damiao = o.protocol == "mit" && o.dialect == "damiao";
  const int low = odrive ? 0 : 1, high = odrive                   ? 62
                                         : o.protocol == "cia402" ? 127
                                         : o.protocol == "moteus" ? 126
                                         : damiao                 ? 15
                                                                  : 255;
  if (o.node < low || o.node > high) {
    throw InputError("", fmt::format("--node {}: must be from {} to {} with --protocol {}", o.node, low, high,
                                     o.protocol));
  }
  if (o.master_id < 0 || o.master_id > 0x7FF)
    throw InputError("", fmt::format("--master-id {}: must be from 0 to 2047", o.master_id));
}

std::unique_ptr<EmulatedAxis> make_drive(const DriveOptions& o, const Defects& defects) {
  const AxisMount mount{.node = o.node};
  const SensorEffects ideal({});
  if (o.protocol == "mit") {
    MitAxis::Settings s;
    s.dialect = *from_name<drive::mit::Dialect>(o.dialect);
    s.reply_size = s.dialect == MitAxis::Dialect::mini_cheetah ? 6 : 8;
    s.master_id = static_cast<std::uint16_t>(o.master_id);
    s.position_range = o.position_range;
    s.velocity_range = o.velocity_range;
    s.torque_range = o.torque_range;
    s.period = 1.0 / o.rate_hz;
    s.timeout_cycles = static_cast<int>(std::llround(o.watchdog / s.control_period));
    s.realtime = true;
    s.defects = defects;
    return std::make_unique<MitAxis>(mount, s, ideal, 0, 1);
  }
  if (o.protocol == "moteus") {
    const MoteusAxis::Settings s{
        .period = 1.0 / o.rate_hz, .timeout = o.watchdog, .realtime = true, .defects = defects};
    return std::make_unique<MoteusAxis>(mount, s, ideal, 0, 1);
  }
  if (o.protocol == "cia402") {
    Cia402Axis::Settings s;
    s.lockstep = false;
    s.period = 1.0 / o.rate_hz;
    s.rated_torque = o.rated_torque;
    s.defects = defects;
    return std::make_unique<Cia402Axis>(mount, s, ideal, 0, 1);
  }
  OdriveAxis::Settings s;
  s.version = o.protocol == "odrive" ? OdriveAxis::Version::v0_6 : OdriveAxis::Version::v0_5_6;
  s.period = 1.0 / o.rate_hz;
  s.watchdog_timeout = o.watchdog;
  s.says_torque = s.version == OdriveAxis::Version::v0_6;
  s.partner = o.node ^ 1;
  s.defects = defects;
  return std::make_unique<OdriveAxis>(mount, s, ideal, 0, 1);
}

class Drive {
 public:
  Drive(const DriveOptions& o, HostBus& bus, std::unique_ptr<EmulatedAxis> axis)
      : options_(o), bus_(bus), axis_(std::move(axis)), shaft_(o.shaft), period_(1.0 / o.rate_hz) {
    axis_->settle(shaft_.angle);
  }

  void run() {
    const auto step = std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(period_));
    auto next = Clock::now();
    log_state();
    while (!stop_requested() && !(options_.duration && time() >= *options_.duration - 0.5 * period_)) {
      next += step;
      if (Clock::now() > next + step) {  // late periods are skipped
        ++late_;
        next = Clock::now();
      }
      while (Clock::now() < next && !stop_requested()) {
        (void)wait_for_frame(bus_, std::max(next - Clock::now(), Clock::duration::zero()));
        receive();
      }
      receive();
      if (bus_.gone()) throw BusGone();
      const double torque = axis_->joint_torque();
      max_torque_ = std::max(max_torque_, std::abs(torque));
      shaft_.advance(torque, period_);
      ++periods_;
      axis_->publish(shaft_.angle, shaft_.rate, sender());
      log_state();
    }
  }

  [[nodiscard]] Json summary(const Defects& defects) const {
    Json j;
    j["protocol"] = options_.protocol;
    j["node"] = options_.node;
    j["bus"] = options_.bus;
    j["defects"] = Json::array();
    for (const DefectName& d : defect_names) {
      if (defects.*(d.flag)) j["defects"].push_back(d.name);
    }
    j["duration_s"] = time();
    j["late_periods"] = late_;
    j["interrupted"] = stop_requested().load();
    j["frames"] = {{"received", received_}, {"commands", commands_}, {"sent", sent_}, {"lost", lost_}};
    j["state"] = {{"closed_loop", axis_->closed_loop()},
                  {"error", axis_->error()},
                  {"angle_rad", shaft_.angle},
                  {"rate_rad_s", shaft_.rate},
                  {"torque_nm", axis_->joint_torque()}};
    j["max_torque_nm"] = max_torque_;
    j["events"] = events_;
    return j;
  }

 private:
  static constexpr int frames_at_once = 256;  ///< read before the next look at the clock
  static constexpr std::size_t events_max = 10000;

  [[nodiscard]] double time() const { return static_cast<double>(periods_) * period_; }
  [[nodiscard]] EmulatedAxis::Send sender() {
    return [this](const hal::CanFrame& f) { ++(bus_.try_send(f) == hal::SendStatus::ok ? sent_ : lost_); };
  }
  void receive() {
    hal::CanFrame f;
    for (int n = 0; n < frames_at_once && bus_.try_receive(f); ++n) {
      ++received_;
      if (axis_->commanded_by(f)) ++commands_;
      (void)axis_->receive(f, sender());
      log_state();
    }
  }
  void log_state() {
    const bool closed = axis_->closed_loop();
    const std::uint32_t error = axis_->error();
    if (logged_ && closed == closed_ && error == error_) return;
    logged_ = true;
    closed_ = closed;
    error_ = error;
    if (events_.size() < events_max)
      events_.push_back({{"t", time()}, {"closed_loop", closed}, {"error", error}});
    if (options_.json) return;
    fmt::print("{:.3f} s: {}, error 0x{:x}\n", time(), closed ? "torque control" : "idle", error);
    std::fflush(stdout);
  }

  const DriveOptions& options_;
  HostBus& bus_;
  std::unique_ptr<EmulatedAxis> axis_;
  LoneShaft shaft_;
  double period_;
  double max_torque_ = 0.0;
  std::uint64_t periods_ = 0, late_ = 0, received_ = 0, commands_ = 0, sent_ = 0, lost_ = 0;
  bool logged_ = false, closed_ = false;
  std::uint32_t error_ = 0;
  Json events_ = Json::array();
};

}  // namespace

std::string defects_text() {
  std::string out = "Defects for --defect:\n";
  for (const DefectName& d : defect_names)
    out += fmt::format("  {:<28} {} ({})\n", d.name, d.meaning, d.protocols);
  return out;
}

int run_drive(const DriveOptions& o) {
  check(o);
  const Defects defects = read_defects(o);
  HostBus bus = open_bus(o.bus, o.bit_rate, o.protocol == "moteus");
  Drive drive(o, bus, make_drive(o, defects));
  drive.run();
  const Json s = drive.summary(defects);
  if (o.json) {
    fmt::print("{}", document_text(s));
  } else {
    fmt::print(
        "{} s, {} frames received ({} commands), {} sent; shaft at {:.6g} rad, {:.6g} rad/s, largest torque "
        "{:.6g} N m\n",
        s["duration_s"].get<double>(), s["frames"]["received"].get<std::uint64_t>(),
        s["frames"]["commands"].get<std::uint64_t>(), s["frames"]["sent"].get<std::uint64_t>(),
        s["state"]["angle_rad"].get<double>(), s["state"]["rate_rad_s"].get<double>(),
        s["max_torque_nm"].get<double>());
  }
  return 0;
}

}  // namespace esmc::host
