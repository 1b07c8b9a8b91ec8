#include "host_sim/drives/mit_axis.hpp"

#include <algorithm>
#include <cmath>

namespace esmc::host {

namespace wire = drive::mit;

namespace {

constexpr double kp_max = 500.0, kd_max = 5.0;  // N m/rad, N m s/rad; the same in every drive

/// Linear map of [low, high] to n bits: truncated towards zero, and only the low bits sent.
std::uint16_t to_field(double value, double low, double high, unsigned bits) {
  const double top = std::ldexp(1.0, static_cast<int>(bits)) - 1.0;
  const double steps = (value - low) * top / (high - low);
  if (!(std::abs(steps) < 1e15)) return 0;
  return static_cast<std::uint16_t>(static_cast<std::int64_t>(steps) & static_cast<std::int64_t>(top));
}
double from_field(std::uint16_t code, double low, double high, unsigned bits) {
  return low + (high - low) * code / (std::ldexp(1.0, static_cast<int>(bits)) - 1.0);
}

}  // namespace

MitAxis::MitAxis(const AxisMount& mount, const Settings& settings, const SensorEffects& sensor, int joint,
                 std::uint64_t seed)
    : EmulatedAxis(mount, sensor, settings.period, joint, seed), settings_(settings) {
  // Nothing arms a V3. In lockstep it confirms when the controller has heard enough to be ready.
  if (v3() && !settings.realtime) confirmations_ = -v3_replies_before;
}

void MitAxis::settle(double joint_angle) {
  reading_ = truth(joint_angle, 0.0);  // in real time a command may come before the first publish()
  sensor_.settle(reading_);
}

void MitAxis::publish(double joint_angle, double joint_rate, const Send& send) {
  reading_ = sensor_.read(truth(joint_angle, joint_rate));
  counted_ = false;
  since_command_ += settings_.period;
  // Half a period of slack: sums of periods must not expire it by rounding.
  const double timeout = settings_.timeout_cycles * settings_.control_period;
  if (since_command_ > timeout + 0.5 * settings_.period && !settings_.defects.watchdog_off) {
    demand_ = {};
    timed_out_ = true;
  }
  if (!settings_.realtime) reply(send);
}

bool MitAxis::mine(const hal::CanFrame& f) const {
  return f.extended == v3() && !f.fd && !f.remote && f.id == (v3() ? wire::v3_command | node() : node());
}

bool MitAxis::receive(const hal::CanFrame& received, const Send& send) {
  if (!mine(received)) return false;
  const hal::CanFrame f = settings_.defects.short_frames_stale ? stale_.fill(received) : received;
  if (f.size != 8) return false;
  if (settings_.realtime) reply(send);
  since_command_ = 0.0;
  if (const auto special = v3() ? std::nullopt : wire::decode_special(f)) {
    act(*special);
    return false;
  }
  if (timed_out_ && settings_.defects.latched_timeout) return true;
  timed_out_ = false;
  enabled_ = enabled_ || v3();
  const wire::Command c = wire::decode_command(f, settings_.dialect);
  demand_.position = from_field(c.position, -settings_.position_range, settings_.position_range, 16);
  demand_.velocity = from_field(c.velocity, -settings_.velocity_range, settings_.velocity_range, 12);
  demand_.kp = from_field(c.kp, 0.0, kp_max, 12);
  demand_.kd = from_field(c.kd, 0.0, kd_max, 12);
  demand_.torque = from_field(c.torque, -settings_.torque_range, settings_.torque_range, 12);
  return true;
}

void MitAxis::act(wire::Special s) {
  switch (s) {
    case wire::Special::enter:
      enabled_ = true;
      timed_out_ = false;
      confirmations_ = 0;
      counted_ = false;
      return;
    case wire::Special::leave:
      enabled_ = false;
      confirmations_ = 0;
      return;
    case wire::Special::set_zero:
      zero_rev_ = reading_.position_rev;
      return;
  }
}

void MitAxis::reply(const Send& send) {
  if (v3()) {
    const auto plus = [](double v) {
      return static_cast<std::uint16_t>(0x8000 + static_cast<int>(std::clamp(v, -32768.0, 32767.0)));
    };
    send(wire::encode_v3_reply(node(), {.position = plus(shaft_angle() * 1800.0 / std::numbers::pi),
                                        .velocity = plus(shaft_rate() / settings_.velocity_unit)}));
    return confirm();
  }
  wire::Reply r;
  r.position = to_field(shaft_angle(), -settings_.position_range, settings_.position_range, 16);
  r.velocity = to_field(shaft_rate(), -settings_.velocity_range, settings_.velocity_range, 12);
  r.torque = to_field(shaft_torque(), -settings_.torque_range, settings_.torque_range, 12);
  if (settings_.dialect == Dialect::damiao) r.error = enabled_ ? 1 : 0;
  send(wire::encode_reply(settings_.master_id, node(), r, settings_.dialect, settings_.reply_size));
  confirm();
}

void MitAxis::confirm() {
  if (enabled_ && !counted_) {
    ++confirmations_;
    counted_ = true;
  }
}

bool MitAxis::commanded_by(const hal::CanFrame& f) const { return mine(f) && f.size == 8; }

double MitAxis::shaft_torque() const {
  if (!enabled_) return 0.0;
  const double torque = demand_.kp * (demand_.position - shaft_angle()) +
                        demand_.kd * (demand_.velocity - shaft_rate()) + demand_.torque;
  return std::clamp(torque, -settings_.torque_range, settings_.torque_range);
}

}  // namespace esmc::host
