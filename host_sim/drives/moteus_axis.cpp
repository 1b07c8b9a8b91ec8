#include "host_sim/drives/moteus_axis.hpp"

#include <algorithm>
#include <bit>
#include <cmath>

namespace esmc::host {

namespace wire = drive::moteus;

namespace {

constexpr double moteus_kp = 4.0, moteus_kd = 0.05;  // N m/turn, N m s/turn: as delivered
constexpr double cut_torque = 0.05;                  // N m, of defects.low_max_torque
constexpr std::uint8_t fault_stop_position = 45;
constexpr std::uint32_t unknown_register = 1;

/// A value of a register as its bytes: an integer is rounded and limited, its lowest one stands for NaN.
std::uint32_t register_bits(double v, wire::Type t, std::uint32_t name) {
  if (t == wire::Type::f32) return std::bit_cast<std::uint32_t>(static_cast<float>(v));
  const double most = std::ldexp(1.0, 8 * wire::width(t) - 1) - 1.0;
  const double steps = std::round(v / static_cast<double>(wire::unit(name, t)));
  return static_cast<std::uint32_t>(
      static_cast<std::int64_t>(std::isnan(steps) ? -most - 1.0 : std::clamp(steps, -most, most)));
}

bool is_for(const hal::CanFrame& f, std::uint8_t node) {
  return !f.remote && f.id <= 0xFFFF && (f.id & 0xFFU) == node;
}

}  // namespace

MoteusAxis::MoteusAxis(const AxisMount& mount, const Settings& settings, const SensorEffects& sensor,
                       int joint, std::uint64_t seed)
    : EmulatedAxis(mount, sensor, settings.period, joint, seed), settings_(settings) {
  wire::put_query(request_, node(), false);
}

void MoteusAxis::settle(double joint_angle) {
  reading_ = truth(joint_angle, 0.0);  // in real time a command may come before the first publish()
  sensor_.settle(reading_);
}

void MoteusAxis::publish(double joint_angle, double joint_rate, const Send& send) {
  reading_ = sensor_.read(truth(joint_angle, joint_rate));
  since_command_ += settings_.period;
  const double timeout =
      demand(wire::reg::watchdog_timeout) == 0.0 ? settings_.timeout : demand(wire::reg::watchdog_timeout);
  // Half a period of slack: sums of periods must not expire it by rounding. A NaN never does.
  if (closed_loop() && !settings_.defects.watchdog_off && since_command_ > timeout + 0.5 * settings_.period) {
    mode_ = wire::mode_timeout;
    confirmations_ = 0;
  }
  shown_ = mode_;
  if (!settings_.realtime) reply(request_, send);
}

bool MoteusAxis::receive(const hal::CanFrame& f, const Send& send) {
  if (!is_for(f, node())) return false;
  const bool commanded = write(f);
  const bool answer = (f.id & wire::reply_wanted) != 0;
  if (answer && settings_.realtime) reply(f, send);
  if (answer && (f.id & 0x7F00U) == 0) request_ = f;  // of the controller
  shown_ = mode_;
  return commanded;
}

/// Registers of a command, in which it is written.
bool MoteusAxis::takes(std::uint32_t name) const {
  if (settings_.defects.refuses_watchdog && name == wire::reg::watchdog_timeout) return false;
  return name - wire::reg::position_command < wire::reg::commands;
}

/// Takes the registers of a frame that writes the mode first. False: it does not.
bool MoteusAxis::write(const hal::CanFrame& f) {
  std::optional<std::uint8_t> mode;
  wire::Subframes in(f);
  for (wire::Subframe s; in.next(s);) {
    for (std::uint32_t i = 0; s.kind == wire::Kind::write && i < s.count; ++i) {
      const auto at = static_cast<std::uint8_t>(s.at + i * wire::width(s.type));
      const double v = static_cast<double>(wire::value_at(f, at, s.type, s.first + i));
      if (s.first + i == wire::reg::mode) {
        mode = static_cast<std::uint8_t>(v >= 0.0 && v <= 255.0 ? v : 255.0);
        demand_ = unwritten;
      }
      if (mode && takes(s.first + i)) demand_[s.first + i - wire::reg::position_command] = v;
    }
  }
  if (mode) act(*mode);
  return mode.has_value();
}

void MoteusAxis::act(std::uint8_t mode) {
  since_command_ = 0.0;
  if (mode == wire::mode_stopped) {
    mode_ = mode;
    fault_ = 0;
    confirmations_ = 0;
  }
  // Out of a fault or a time-out leads a stop only.
  if (mode != wire::mode_position || mode_ == wire::mode_fault || mode_ == wire::mode_timeout) return;
  if (!std::isnan(demand(wire::reg::stop_position)) && !std::isnan(demand(wire::reg::velocity_limit))) {
    mode_ = wire::mode_fault;
    fault_ = fault_stop_position;
    confirmations_ = 0;
    return;
  }
  mode_ = mode;
}

std::optional<double> MoteusAxis::value(std::uint32_t name) const {
  const Defects& d = settings_.defects;
  if (name == wire::reg::mode) return shown_;
  if (name == wire::reg::position) return d.position_invalid ? not_set : reading_.position_rev;
  if (name == wire::reg::velocity) return d.position_invalid ? not_set : reading_.velocity_rev_s;
  if (name == wire::reg::torque) return shaft_torque();
  if (name == wire::reg::home_state) return d.relative_position ? 0.0 : 2.0;
  if (name == wire::reg::fault_code) return fault_;
  if (name == wire::reg::map_version) return d.other_registers ? 4.0 : 5.0;
  if (!takes(name)) return std::nullopt;
  return demand(name);
}

void MoteusAxis::reply(const hal::CanFrame& request, const Send& send) {
  hal::CanFrame out;
  wire::Builder b(out, static_cast<std::uint32_t>(node()) << 8U | (request.id >> 8U & 0x7FU));
  wire::Subframes in(request);
  const auto fits = [&](unsigned bytes) { return out.size + bytes <= hal::can_fd_size_max; };
  for (wire::Subframe s; in.next(s);) {
    const bool read = s.kind == wire::Kind::read;
    bool row = s.count <= 3 && fits(4 + s.count * wire::width(s.type));
    for (std::uint32_t i = 0; i < s.count; ++i) row = row && value(s.first + i).has_value();
    for (std::uint32_t i = 0; i < s.count && s.first + i < 0x4000 && fits(8); ++i) {
      const auto v = value(s.first + i);
      if (!v) b.error(read, s.first + i, unknown_register);
      if (!v || !read) continue;
      if (!row || i == 0) b.begin(wire::Kind::reply, s.type, row ? s.count : 1, s.first + i);
      b.value(s.type, static_cast<std::int32_t>(register_bits(*v, s.type, s.first + i)));
    }
  }
  if (settings_.defects.classic_replies) {
    out.fd = out.bit_rate_switch = false;
    out.size = std::min(out.size, hal::can_classic_size_max);
  } else {
    b.pad();
  }
  if (closed_loop() && shown_ == mode_) ++confirmations_;
  send(out);
}

bool MoteusAxis::commanded_by(const hal::CanFrame& f) const { return is_for(f, node()); }

std::uint32_t MoteusAxis::error() const { return mode_ == wire::mode_timeout ? mode_ : fault_; }

/// A NaN as largest torque means the drive's own.
double MoteusAxis::limited(double torque) const {
  const double own = settings_.defects.low_max_torque ? cut_torque : settings_.torque_max;
  const double most = std::isnan(demand(wire::reg::max_torque))
                          ? own
                          : std::min(own, std::abs(demand(wire::reg::max_torque)));
  return std::isnan(torque) ? 0.0 : std::clamp(torque, -most, most);
}

double MoteusAxis::shaft_torque() const {
  const double damping = moteus_kd * -reading_.velocity_rev_s;
  if (mode_ == wire::mode_timeout && settings_.defects.timeout_damps) return limited(damping);
  if (!closed_loop()) return 0.0;
  const auto [position, velocity, torque, kp, kd, most, stop, timeout, limit] = demand_;
  const double off = std::isnan(position) ? 0.0 : position - reading_.position_rev;
  const double rate = std::isnan(velocity) ? 0.0 : velocity - reading_.velocity_rev_s;
  return limited(torque + moteus_kp * kp * off + moteus_kd * kd * rate);
}

}  // namespace esmc::host
