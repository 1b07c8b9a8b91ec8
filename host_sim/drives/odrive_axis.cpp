#include "host_sim/drives/odrive_axis.hpp"

#include <algorithm>
#include <bit>
#include <cmath>

namespace esmc::host {

namespace wire = drive::odrive;

namespace {
constexpr std::uint32_t error_bad_setpoint = 0x2;  // SYSTEM_LEVEL
constexpr double clock_error = 1e-4;               // of an unsynchronised drive: periods per period
}  // namespace

OdriveAxis::OdriveAxis(const AxisMount& mount, const Settings& settings, const SensorEffects& sensor,
                       int joint, std::uint64_t seed)
    : EmulatedAxis(mount, sensor, settings.period, joint, seed),
      settings_(settings),
      phase_(0.3 + 0.4 * (joint % 2)) {}

void OdriveAxis::publish(double joint_angle, double joint_rate, const Send& send) {
  reading_ = sampled(joint_angle, joint_rate);
  since_fed_ += settings_.period;
  // Half a period of slack: sums of periods must not expire a watchdog by rounding.
  if (closed_loop() && since_fed_ > settings_.watchdog_timeout + 0.5 * settings_.period) expire();
  since_heartbeat_ += settings_.period;
  if (since_heartbeat_ > settings_.heartbeat_period - 0.5 * settings_.period) {
    since_heartbeat_ = 0.0;
    confirmations_ = closed_loop() && error_ == 0 ? confirmations_ + 1 : 0;
    send(heartbeat());
    if (settings_.says_torque) send(torques());
  }
  send(estimates());
}

ShaftReading OdriveAxis::sampled(double joint_angle, double joint_rate) {
  ShaftReading r = sensor_.read(truth(joint_angle, joint_rate));
  if (settings_.defects.unsynchronised) {
    r.position_rev -= phase_ * settings_.period * r.velocity_rev_s;
    phase_ = std::fmod(phase_ + clock_error, 1.0);
  }
  return r;
}

void OdriveAxis::expire() {
  if (settings_.defects.watchdog_off) return;
  if (settings_.defects.timeout_stays_enabled) {
    input_torque_ = 0.0F;
    return;
  }
  disarm(new_version() ? wire::error_watchdog_0_6 : wire::error_watchdog_0_5_6);
  dead_ = settings_.defects.latched_timeout;
}

bool OdriveAxis::receive(const hal::CanFrame& received, const Send& send) {
  const bool to_partner = settings_.partner >= 0 && !received.extended &&
                          received.id >> 5U == static_cast<std::uint32_t>(settings_.partner);
  if (settings_.defects.clears_both_axes && to_partner &&
      static_cast<wire::Message>(received.id & 0x1FU) == wire::Message::clear_errors)
    error_ = 0;
  if (received.extended || received.fd || (received.id >> 5U) != node()) return false;
  const bool stale = settings_.defects.short_frames_stale && !received.remote;
  const hal::CanFrame f = stale ? stale_.fill(received) : received;
  if (settings_.defects.watchdog_any_frame) since_fed_ = 0.0;
  // 0.5.6 feeds its watchdog with any message to the axis, requests included; 0.6 with setpoints only.
  if (!new_version()) since_fed_ = 0.0;
  const auto message = static_cast<wire::Message>(f.id & 0x1FU);
  if (f.remote) {
    if (message == wire::Message::heartbeat) send(heartbeat());
    if (message == wire::Message::encoder_estimates) send(estimates());
    if (!new_version()) return false;
    if (message == wire::Message::get_version)
      send(wire::encode_version(node(), settings_.endpoints.firmware));
    if (message == wire::Message::get_error) send(wire::encode_errors(node(), error_, disarm_reason_));
    if (message == wire::Message::get_torques) send(torques());
    return false;
  }
  switch (message) {
    case wire::Message::set_axis_state:
      if (const auto s = wire::decode_axis_state_request(f)) request_state(*s);
      break;
    case wire::Message::set_controller_mode:
      if (const auto m = wire::decode_controller_mode(f)) {
        control_mode_ = m->control;
        input_mode_ = m->input;
      }
      break;
    case wire::Message::set_input_torque:
      if (const auto torque = wire::decode_torque(f)) {
        setpoint(*torque);
        return true;
      }
      break;
    case wire::Message::clear_errors:
      if (!dead_) error_ = 0;
      break;
    case wire::Message::estop:
      disarm(new_version() ? wire::error_estop_0_6 : wire::error_estop_0_5_6);
      break;
    case wire::Message::rx_sdo:
      serve(f, send);
      break;
    default:  // frames of drives, and requests that are remote frames
      break;
  }
  return false;
}

/// Answers reads; the configuration cannot be written.
void OdriveAxis::serve(const hal::CanFrame& request, const Send& send) const {
  if (!new_version() || request.size < 4 || request.data[0] != 0) return;
  for (const OdriveEndpoint& e : settings_.endpoints.list) {
    if (e.id == wire::endpoint_of(request)) send(wire::encode_value(node(), e.id, raw(e.value)));
  }
}

std::uint32_t OdriveAxis::raw(OdriveValue v) const {
  const auto real = [](double x) { return std::bit_cast<std::uint32_t>(static_cast<float>(x)); };
  switch (v) {
    case OdriveValue::enable_watchdog:
      return settings_.defects.watchdog_off ? 0 : 1;
    case OdriveValue::watchdog_timeout:
      return real(settings_.watchdog_timeout);
    case OdriveValue::control_mode:
      return control_mode_;
    case OdriveValue::input_mode:
      return input_mode_;
    case OdriveValue::torque_mode_limit:
      return settings_.defects.torque_mode_limit ? 1 : 0;
    case OdriveValue::vel_limit:
      return real(settings_.vel_limit);
    case OdriveValue::overspeed_error:
      return settings_.overspeed_error ? 1 : 0;
    case OdriveValue::torque_constant:
      return real(settings_.torque_constant);
    case OdriveValue::current_limit:
      return real(settings_.current_limit);
    case OdriveValue::heartbeat_period:
      return static_cast<std::uint32_t>(std::lround(settings_.heartbeat_period * 1e3));
  }
  return 0;
}

bool OdriveAxis::commanded_by(const hal::CanFrame& f) const {
  if (f.extended || f.fd || f.remote || (f.id >> 5U) != node()) return false;
  const auto message = static_cast<wire::Message>(f.id & 0x1FU);
  return message == wire::Message::set_axis_state || message == wire::Message::set_controller_mode ||
         message == wire::Message::set_input_torque || message == wire::Message::clear_errors;
}

double OdriveAxis::shaft_torque() const {
  const bool torque_mode =
      control_mode_ == wire::control_mode_torque && input_mode_ == wire::input_mode_passthrough;
  if (!closed_loop() || !torque_mode) return 0.0;
  // Of a NaN, which comes here without a check only, fmin makes full torque.
  const auto limited = [&](double v) {
    return std::fmax(std::fmin(v, settings_.torque_max), -settings_.torque_max);
  };
  const double torque = limited(static_cast<double>(input_torque_)), speed = reading_.velocity_rev_s;
  if (!settings_.defects.torque_mode_limit) return torque;
  return limited(std::clamp(torque, (-settings_.vel_limit - speed) * settings_.vel_gain,
                            (settings_.vel_limit - speed) * settings_.vel_gain));
}

hal::CanFrame OdriveAxis::heartbeat() const { return wire::encode_heartbeat(node(), error_, state_); }

hal::CanFrame OdriveAxis::estimates() const {
  const bool seen = connected_ || !settings_.defects.zero_until_closed_loop;
  return wire::encode_encoder_estimates(node(), seen ? static_cast<float>(reading_.position_rev) : 0.0F,
                                        seen ? static_cast<float>(reading_.velocity_rev_s) : 0.0F);
}

hal::CanFrame OdriveAxis::torques() const {
  return wire::encode_torques(node(), {input_torque_, static_cast<float>(shaft_torque())});
}

void OdriveAxis::disarm(std::uint32_t error) {
  error_ |= error;
  disarm_reason_ = error;
  state_ = wire::AxisState::idle;
  input_torque_ = 0.0F;
  confirmations_ = 0;
}

void OdriveAxis::request_state(std::uint32_t state) {
  if (state != static_cast<std::uint32_t>(wire::AxisState::closed_loop_control)) return disarm(0);
  if (error_ != 0 || closed_loop()) return;  // a drive with an error refuses until it is cleared
  state_ = wire::AxisState::closed_loop_control;
  connected_ = true;
  input_torque_ = 0.0F;
  since_fed_ = 0.0;
}

void OdriveAxis::setpoint(float torque) {
  since_fed_ = 0.0;
  if (!std::isfinite(torque) && !settings_.defects.no_nan_check) return disarm(error_bad_setpoint);
  input_torque_ = torque;
}

}  // namespace esmc::host
